//! Contradictions between the flags of planes and those of pictures.

use super::{Draw, PlanarFlags};
use crate::cli::Failure;
use crate::cli::render::view_flags::{Mode, ViewFlags};

impl PlanarFlags {
    /// Refuses contradictory flags, before any work.
    ///
    /// # Errors
    /// [`Failure`] with the flag and the remedy.
    pub(in crate::cli::render) fn check(&self, view_flags: &ViewFlags) -> Result<(), Failure> {
        let refuse = |text: String| Err(Failure::new(text));
        if self.draw.as_ref().is_some_and(|draw| draw.contains(&Draw::None) && draw.len() > 1) {
            return refuse("--draw none: cannot be combined with other names; leave them out".into());
        }
        if view_flags.mode != Mode::Slice {
            let given =
                [("--at", self.at.is_some()), ("--plane", self.plane.is_some()), ("--overlay", self.overlay.is_some())];
            return match given.iter().find(|(_, given)| *given) {
                Some((flag, _)) => {
                    refuse(format!("{flag}: applies to planes only; give --mode slice, or leave it out"))
                }
                None => Ok(()),
            };
        }
        let usual = ViewFlags::usual();
        let other = [
            ("--view", view_flags.view.is_some()),
            ("--perspective", view_flags.perspective.is_some()),
            ("--transfer", view_flags.transfer.is_some()),
            ("--crop", view_flags.crop.is_some()),
            ("--step", view_flags.step != usual.step),
            ("--arity", view_flags.arity.is_some()),
            ("--stop", view_flags.stop.is_some()),
            ("--adaptive", view_flags.adaptive != 0.0),
            ("--parts", view_flags.parts.is_some()),
            ("--background", view_flags.background != usual.background),
        ];
        if let Some((flag, _)) = other.iter().find(|(_, given)| *given) {
            return refuse(format!(
                "{flag}: does not apply to --mode slice; leave it out, and give --at or --plane for planes and \
                --window for greys"
            ));
        }
        if self.at.is_some() && self.plane.is_some() {
            return refuse("--at, --plane: give --at for three planes, or --plane for a free one".into());
        }
        if let Some(what) = self.drawn().into_iter().find(|what| *what != Draw::Scale) {
            return refuse(format!(
                "--draw {}: cannot be drawn on planes; with --mode slice give scale or none",
                what.name()
            ));
        }
        self.free().map(|_| ())
    }
}

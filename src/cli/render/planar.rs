//! The flags of planes, and of what is drawn over pictures.

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use super::look::{Look, Mode};
use crate::cli::{Failure, values};
pub(in crate::cli) use crate::config::look::Draw;
use crate::config::numbers;
use crate::export::sections::{Sheet, Wash};
use crate::render::section::{Box3, Plane, Sampled};

/// Planes through a volume.
#[derive(Debug, Args)]
#[command(next_help_heading = "Planes (--mode slice) and what is drawn over pictures")]
pub(in crate::cli) struct PlanarFlags {
    /// Where the three planes cross, world mm [default: the middle of what was seen]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// One free plane instead of three: a point of it and its normal, world mm; upwards in the picture [default: the world's +z, or +y where the normal lies along z]
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ[,UX,UY,UZ]", value_parser = free_plane, allow_hyphen_values = true)]
    plane: Option<FreePlane>,
    /// A wash of colour over planes: the weight that voxels have, or what was not seen
    #[arg(long, value_enum, value_name = "WASH")]
    overlay: Option<Overlay>,
    /// What is drawn over the picture, separated by commas; slice and probe are those that came last in a replay [default: nothing; in pictures on the way
    /// slice,probe; around planes titles, axes and a legend, which are `scale`]
    #[arg(long, value_enum, value_name = "WHAT", value_delimiter = ',')]
    draw: Option<Vec<Draw>>,
}

/// A point, a normal, and where upwards is.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FreePlane {
    point: DVec3,
    normal: DVec3,
    up: Option<DVec3>,
}

fn free_plane(text: &str) -> Result<FreePlane, String> {
    let three = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
    match text.split(',').count() {
        9 => {
            numbers::<9>(text).map(|n| FreePlane { point: three(&n), normal: three(&n[3..]), up: Some(three(&n[6..])) })
        }
        _ => numbers::<6>(text)
            .map(|n| FreePlane { point: three(&n), normal: three(&n[3..]), up: None })
            .map_err(|e| format!("{e}; it takes a point, a normal and, if wanted, an upward direction")),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Overlay {
    /// The voxels' weight
    Weight,
    /// What was not seen
    Coverage,
}

/// What was drawn of planes, for statistics.
#[derive(Debug, Clone, Serialize)]
pub(in crate::cli) struct SheetNumbers {
    /// Pixels to the right and down.
    image_size: [u32; 2],
    /// Edge of a plane's pixel, mm.
    mm_per_px: f64,
    overlay: Option<&'static str>,
    /// What stands around the planes.
    drawn: &'static [&'static str],
    planes: Vec<PlaneNumbers>,
}

#[derive(Debug, Clone, Serialize)]
struct PlaneNumbers {
    title: String,
    /// The plane's first pixel in the picture, and its pixels.
    corner_px: [u32; 2],
    size_px: [u32; 2],
    /// Centre of its first pixel, and from one pixel to the next to the right and down; world mm.
    first_mm: [f64; 3],
    right_mm: [f64; 3],
    down_mm: [f64; 3],
    /// Pixels that show a grey level.
    pixels_seen: u64,
}

impl std::fmt::Display for SheetNumbers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.image_size;
        let titles: Vec<&str> = self.planes.iter().map(|plane| plane.title.as_str()).collect();
        write!(f, "{width}×{height} pixels, {}, {:.3} mm a pixel", titles.join("; "), self.mm_per_px)
    }
}

impl PlanarFlags {
    /// Whether a wash needs the volume's weights.
    pub(in crate::cli) fn wants_weights(&self) -> bool {
        self.overlay == Some(Overlay::Weight)
    }

    /// What is drawn over a picture where the user has not said otherwise; sorted, each once.
    pub(in crate::cli) fn drawn(&self, usual: &[Draw]) -> Vec<Draw> {
        let mut draw = self.draw.clone().unwrap_or_else(|| usual.to_vec());
        draw.retain(|what| *what != Draw::None);
        draw.sort_unstable();
        draw.dedup();
        draw
    }

    /// Fails before any work where flags do not go together.
    ///
    /// # Errors
    /// [`Failure`]: the flag, and what to do.
    pub(super) fn check(&self, look: &Look) -> Result<(), Failure> {
        let refuse = |text: String| Err(Failure(text));
        if self.draw.as_ref().is_some_and(|draw| draw.contains(&Draw::None) && draw.len() > 1) {
            return refuse("--draw none: draws nothing, so nothing else can be named beside it".into());
        }
        if look.mode != Mode::Slice {
            let given =
                [("--at", self.at.is_some()), ("--plane", self.plane.is_some()), ("--overlay", self.overlay.is_some())];
            return match given.iter().find(|(_, given)| *given) {
                Some((flag, _)) => refuse(format!("{flag}: is of planes; give --mode slice, or leave it out")),
                None => Ok(()),
            };
        }
        let usual = Look::usual();
        let other = [
            ("--view", look.view.is_some()),
            ("--perspective", look.perspective.is_some()),
            ("--transfer", look.transfer.is_some()),
            ("--step", look.step != usual.step),
            ("--arity", look.arity.is_some()),
            ("--stop", look.stop.is_some()),
            ("--adaptive", look.adaptive != 0.0),
            ("--background", look.background != usual.background),
        ];
        if let Some((flag, _)) = other.iter().find(|(_, given)| *given) {
            return refuse(format!(
                "{flag}: does not apply to --mode slice, whose planes lie by --at or --plane and whose greys are by --window; leave it out"
            ));
        }
        if self.at.is_some() && self.plane.is_some() {
            return refuse("--at, --plane: are for three planes and for a free one; give one of them".into());
        }
        if let Some(what) = self.drawn(&[]).into_iter().find(|what| *what != Draw::Scale) {
            return refuse(format!(
                "--draw {}: is drawn in space, not on planes; with --mode slice give scale or none",
                what.name()
            ));
        }
        self.free().map(|_| ())
    }

    fn free(&self) -> Result<Option<Plane>, Failure> {
        let plane = self.plane.map(|p| Plane::new(p.point, p.normal, p.up));
        plane.transpose().map_err(|e| Failure(format!("--plane: {e}")))
    }

    /// The planes of a volume's box, in a picture.
    ///
    /// # Errors
    /// [`Failure`] where they miss it, or the picture has no room.
    pub(in crate::cli) fn sheet(&self, place: &Box3, size: [u32; 2]) -> Result<Sheet, Failure> {
        let lettered = self.drawn(&[Draw::Scale]).contains(&Draw::Scale);
        match self.free()? {
            Some(plane) => Sheet::free(place, &plane, size, lettered).map_err(|e| Failure(format!("--plane: {e}"))),
            None => Sheet::three(place, self.at, size, lettered).map_err(|e| match self.at {
                Some(_) => Failure(format!("--at: {e}")),
                None => e.into(),
            }),
        }
    }

    pub(in crate::cli) fn wash(&self) -> Wash {
        match self.overlay {
            None => Wash::Clear,
            Some(Overlay::Weight) => Wash::Weight,
            Some(Overlay::Coverage) => Wash::Coverage,
        }
    }

    /// The numbers of a picture of planes.
    pub(in crate::cli) fn numbers(&self, sheet: &Sheet, sampled: &[Vec<Sampled>]) -> SheetNumbers {
        let planes = sheet.panels.iter().zip(sampled).map(|(panel, sampled)| PlaneNumbers {
            title: panel.title.clone(),
            corner_px: panel.corner,
            size_px: panel.section.size,
            first_mm: panel.section.first.to_array(),
            right_mm: panel.section.right.to_array(),
            down_mm: panel.section.down.to_array(),
            pixels_seen: sampled.iter().filter(|s| s.is_seen()).count() as u64,
        });
        SheetNumbers {
            image_size: sheet.size,
            mm_per_px: sheet.mm_per_px(),
            overlay: self.overlay.map(|overlay| match overlay {
                Overlay::Weight => "weight",
                Overlay::Coverage => "coverage",
            }),
            drawn: if sheet.lettered { &["scale"] } else { &[] },
            planes: planes.collect(),
        }
    }
}

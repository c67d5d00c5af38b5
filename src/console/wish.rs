//! What pages and programs may want, in the words that they say it by: JSON, one thing at a time.

use std::time::Duration;

use serde::Deserialize;

use super::dress::Choice;
use super::planes::Move;
use super::sight::{From, Steer};
use super::{Served, snapshot};
use crate::config::bedside::Trial;
use crate::desk::Deed;

/// What is said.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
enum Said {
    Show {
        slice: bool,
        view: bool,
        #[serde(default)]
        planes: bool,
    },
    Shown {
        kind: u8,
        sequence: u32,
        #[serde(default)]
        had_ms: f64,
    },
    Control {},
    Turn {
        right: f64,
        up: f64,
        clockwise: f64,
    },
    Zoom {
        by: f64,
    },
    Centre {
        at: [f64; 2],
    },
    Look {
        from: From,
    },
    /// All planes go through this point, world mm.
    Cross {
        at: [f64; 3],
    },
    /// Turns the free plane, degrees.
    Tilt {
        right: f64,
        up: f64,
        clockwise: f64,
    },
    /// The planes' greys.
    Window {
        black: f64,
        white: f64,
    },
    /// How the volume's picture looks: a preset or the configuration's transfer function, and points in the place of its opacities.
    Transfer {
        #[serde(default)]
        preset: Option<String>,
        #[serde(default)]
        points: Option<Vec<[f64; 2]>>,
    },
    /// As at the beginning.
    Reset {
        of: Reset,
    },
    Record {},
    Scan {},
    Stop {},
    Freeze {
        on: bool,
    },
    Clear {},
    Save {},
    Snapshot {},
    /// Runs a recording again, by what it was recorded by but for these keys.
    Again {
        #[serde(default)]
        settings: Trial,
    },
    /// Shows a frame of a recording.
    Frame {
        number: u64,
    },
}

/// What is to be as at the beginning; the transfer function is where nothing is chosen of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Reset {
    Planes,
    Window,
}

/// What is wanted.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Wish {
    /// To be sent these kinds of pictures.
    Show {
        /// The scanner's.
        slice: bool,
        /// The volume's.
        view: bool,
        /// The planes'.
        planes: bool,
    },
    /// Nothing: a picture was drawn, or left out.
    Shown {
        /// Its kind.
        kind: u8,
        /// Its number.
        sequence: u32,
        /// From when it came to the page until now: what is left of the time since it was sent, the line took.
        had: Duration,
    },
    /// To steer.
    Control,
    /// Something that changes what all see, or what the session does.
    Act(Act),
}

/// Something that changes what all see, or what the session does.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Act {
    /// The view.
    Steer(Steer),
    /// The planes.
    Move(Move),
    /// How the volume looks.
    Choose(Choice),
    /// The session.
    Deed(Deed),
    /// The pictures that are seen are kept.
    Snapshot,
    /// A recording is run again.
    Again(Trial),
    /// A frame of a recording is shown.
    Frame(u64),
}

impl Wish {
    /// What a text says.
    ///
    /// # Errors
    /// A sentence for one that says nothing that there is to want.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let said = serde_json::from_str(text);
        let said = said.map_err(|error| format!("this is nothing that a page can want: {error}"))?;
        Ok(match said {
            Said::Show { slice, view, planes } => Self::Show { slice, view, planes },
            Said::Shown { kind, sequence, had_ms } => {
                let had = Duration::try_from_secs_f64(had_ms / 1e3);
                let had = had.map_err(|_| format!("a page cannot have had a picture for {had_ms} ms"))?;
                Self::Shown { kind, sequence, had }
            }
            Said::Control {} => Self::Control,
            Said::Turn { right, up, clockwise } => Self::Act(Act::Steer(Steer::Turn { right, up, clockwise })),
            Said::Zoom { by } => Self::Act(Act::Steer(Steer::Zoom(by))),
            Said::Centre { at } => Self::Act(Act::Steer(Steer::Centre(at))),
            Said::Look { from } => Self::Act(Act::Steer(Steer::Look(from))),
            Said::Cross { at } => Self::Act(Act::Move(Move::Cross(at))),
            Said::Tilt { right, up, clockwise } => Self::Act(Act::Move(Move::Tilt { right, up, clockwise })),
            Said::Window { black, white } => Self::Act(Act::Move(Move::Window([black, white]))),
            Said::Transfer { preset, points } => Self::Act(Act::Choose(Choice { preset, points })),
            Said::Reset { of: Reset::Planes } => Self::Act(Act::Move(Move::Home)),
            Said::Reset { of: Reset::Window } => Self::Act(Act::Move(Move::HomeWindow)),
            Said::Record {} => Self::Act(Act::Deed(Deed::Record)),
            Said::Scan {} => Self::Act(Act::Deed(Deed::Scan)),
            Said::Stop {} => Self::Act(Act::Deed(Deed::Stop)),
            Said::Freeze { on } => Self::Act(Act::Deed(Deed::Freeze(on))),
            Said::Clear {} => Self::Act(Act::Deed(Deed::Clear)),
            Said::Save {} => Self::Act(Act::Deed(Deed::Save)),
            Said::Snapshot {} => Self::Act(Act::Snapshot),
            Said::Again { settings } => Self::Act(Act::Again(settings)),
            Said::Frame { number } => Self::Act(Act::Frame(number)),
        })
    }
}

impl Act {
    /// Does it, or begins to; what is done, in a sentence, where it is not seen anyway.
    ///
    /// # Errors
    /// A sentence, and nothing has changed.
    pub(super) fn act(self, served: &Served) -> Result<Option<String>, String> {
        match self {
            Self::Steer(steer) => served.shown.screen.steer(steer).map(|()| None),
            Self::Move(what) => served.shown.screen.move_planes(what).map(|()| None),
            Self::Choose(choice) => served.shown.screen.choose(choice).map(|()| None),
            Self::Deed(deed) => served.shown.desk.wish(deed).map(Some),
            Self::Snapshot => snapshot::keep(served).map(Some),
            Self::Again(trial) => served.shown.desk.again(trial).map(Some),
            Self::Frame(number) => served.shown.desk.look(number).map(|()| None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_wish_is_understood_and_nothing_else_is() {
        for (text, deed) in [
            ("{\"do\":\"record\"}", Deed::Record),
            ("{\"do\":\"scan\"}", Deed::Scan),
            ("{\"do\":\"stop\"}", Deed::Stop),
            ("{\"do\":\"freeze\",\"on\":true}", Deed::Freeze(true)),
            ("{\"do\":\"clear\"}", Deed::Clear),
            ("{\"do\":\"save\"}", Deed::Save),
        ] {
            assert_eq!(Wish::parse(text), Ok(Wish::Act(Act::Deed(deed))), "{text}");
        }
        assert_eq!(Wish::parse("{\"do\":\"control\"}"), Ok(Wish::Control));
        for text in ["", "{}", "{\"do\":\"reboot\"}", "{\"do\":\"freeze\"}", "{\"do\":\"save\",\"to\":\"/etc\"}", "[1]"]
        {
            let why = Wish::parse(text).unwrap_err();
            assert!(why.starts_with("this is nothing that a page can want: "), "{text}: {why}");
        }
    }

    #[test]
    fn how_long_a_page_has_had_a_picture_is_a_time() {
        let shown = |had: &str| Wish::parse(&format!("{{\"do\":\"shown\",\"kind\":2,\"sequence\":7{had}}}"));
        let had = |had| Ok(Wish::Shown { kind: 2, sequence: 7, had });
        assert_eq!([shown(",\"had_ms\":12.5"), shown("")], [had(Duration::from_micros(12_500)), had(Duration::ZERO)]);
        for wrong in ["-1", "1e300"] {
            assert!(
                shown(&format!(",\"had_ms\":{wrong}"))
                    .unwrap_err()
                    .starts_with("a page cannot have had a picture for ")
            );
        }
    }
}

//! Messages of pages and programs, each a JSON object: commands to the session, and changes of
//! the view.

use std::time::Duration;

use serde::Deserialize;

use config::bedside::SettingsOverride;
use pipeline::command::{Command, Marker, MarkerSource, MaskChange};
use pipeline::control::CorrectionRequest;
use sonoweave_core::clock::{Clock as _, Monotonic};

use super::orbit_camera::{From, Steer};
use super::planes::Move;
use super::request_error::RequestError;
use super::served::{ConsoleSession, Served};
use super::snapshot;
use super::style::Choice;

/// A message's JSON form.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
enum MessageJson {
    Show {
        slice: bool,
        view: bool,
        #[serde(default)]
        planes: bool,
        #[serde(default)]
        bricks: bool,
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
    #[serde(rename = "look")]
    Side {
        from: From,
    },
    /// Moves all planes through this point, world mm.
    Cross {
        at: [f64; 3],
    },
    /// Turns the free plane, degrees.
    Tilt {
        right: f64,
        up: f64,
        clockwise: f64,
    },
    /// Sets the planes' grey value window.
    Window {
        black: f64,
        white: f64,
    },
    /// Shows or hides the standard errors of the planes' voxels.
    Errors {
        on: bool,
    },
    /// Shows or hides which places were seen weakly.
    WeaklySeen {
        on: bool,
    },
    /// Sets the style of the volume's picture: a preset or the configured transfer function,
    /// and points that replace its opacities.
    Transfer {
        #[serde(default)]
        preset: Option<String>,
        #[serde(default)]
        points: Option<Vec<[f64; 2]>>,
    },
    /// Resets to the initial state.
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
    /// Changes the mask of later slices, or confirms the present one.
    Mask {
        #[serde(rename = "as")]
        change: MaskChange,
    },
    /// Marks a moment in the recording, so many ms ago.
    Mark {
        #[serde(default)]
        ago_ms: f64,
    },
    Save {},
    Snapshot {},
    /// Replays a recording with its recorded settings, except for these keys.
    Again {
        #[serde(default)]
        settings: SettingsOverride,
    },
    /// Computes a correction of a recording, and stores it.
    Correct {
        by: Correction,
    },
    /// Undoes a correction of a recording.
    Undo {
        correction: u64,
    },
    /// Shows a frame of a recording.
    Frame {
        number: u64,
    },
}

/// The method of a correction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Correction {
    Smoothing,
    Calibration,
    Drift,
    Jitter,
    /// Against the sweep of this number with light contact, from 1.
    Pressure {
        light: usize,
    },
    Gate,
}

/// The part to reset. The transfer function is reset by an empty `Transfer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Reset {
    Planes,
    Window,
}

/// A message.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ClientMessage {
    /// A command to the session.
    Command(Command),
    /// Replays a recording with its recorded settings, except for these.
    Replay(SettingsOverride),
    /// Changes the corrections of a recording.
    Correct(CorrectionRequest),
    /// Changes what all viewers see.
    View(ViewMessage),
    /// Concerns only the connection of the page that sends it.
    Page(PageMessage),
}

/// A change of what all viewers see, or a snapshot of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ViewMessage {
    /// Changes the view of the volume.
    Steer(Steer),
    /// Changes the planes.
    Move(Move),
    /// Changes the style of the volume's picture.
    Style(Choice),
    /// Shows a frame of a recording.
    Frame(u64),
    /// Saves the displayed pictures.
    Snapshot,
}

/// A message about the connection of the page that sends it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PageMessage {
    /// Subscribes to these kinds of pictures.
    Show {
        /// The B-mode image.
        slice: bool,
        /// The volume.
        view: bool,
        /// The planes.
        planes: bool,
        /// The volume's bricks: the page draws the volume itself.
        bricks: bool,
    },
    /// Acknowledges a picture, drawn or left out.
    Shown {
        /// Its kind.
        kind: u8,
        /// Its sequence number.
        sequence: u32,
        /// Time since the picture arrived at the page. The rest of the time since sending was
        /// transmission.
        had: Duration,
    },
    /// Takes control.
    Control,
}

impl ClientMessage {
    /// Parses a message.
    ///
    /// # Errors
    /// [`RequestError`] if the text is not a valid message.
    pub(super) fn parse(text: &str) -> Result<Self, RequestError> {
        let json = serde_json::from_str(text);
        let json = json.map_err(|error: serde_json::Error| RequestError::Command(error.to_string()))?;
        Ok(match json {
            MessageJson::Show { slice, view, planes, bricks } => {
                Self::Page(PageMessage::Show { slice, view, planes, bricks })
            }
            MessageJson::Shown { kind, sequence, had_ms } => {
                let had = duration("had_ms", had_ms)?;
                Self::Page(PageMessage::Shown { kind, sequence, had })
            }
            MessageJson::Control {} => Self::Page(PageMessage::Control),
            MessageJson::Turn { right, up, clockwise } => Steer::Turn { right, up, clockwise }.into(),
            MessageJson::Zoom { by } => Steer::Zoom(by).into(),
            MessageJson::Centre { at } => Steer::Centre(at).into(),
            MessageJson::Side { from } => Steer::Side(from).into(),
            MessageJson::Cross { at } => Move::Cross(at).into(),
            MessageJson::Tilt { right, up, clockwise } => Move::Tilt { right, up, clockwise }.into(),
            MessageJson::Window { black, white } => Move::Window([black, white]).into(),
            MessageJson::Errors { on } => Move::Errors(on).into(),
            MessageJson::WeaklySeen { on } => Move::WeaklySeen(on).into(),
            MessageJson::Reset { of: Reset::Planes } => Move::Home.into(),
            MessageJson::Reset { of: Reset::Window } => Move::HomeWindow.into(),
            MessageJson::Transfer { preset, points } => Self::View(ViewMessage::Style(Choice { preset, points })),
            MessageJson::Frame { number } => Self::View(ViewMessage::Frame(number)),
            MessageJson::Snapshot {} => Self::View(ViewMessage::Snapshot),
            MessageJson::Record {} => Self::Command(Command::Record),
            MessageJson::Scan {} => Self::Command(Command::Scan),
            MessageJson::Stop {} => Self::Command(Command::Stop),
            MessageJson::Freeze { on } => Self::Command(Command::Freeze(on)),
            MessageJson::Clear {} => Self::Command(Command::Clear),
            MessageJson::Mask { change } => Self::Command(Command::Mask(change)),
            MessageJson::Mark { ago_ms } => {
                let at_ns = Monotonic.now_ns() - duration("ago_ms", ago_ms)?.as_nanos() as i64;
                let marker = Marker { at_ns, by: MarkerSource::Operator };
                Self::Command(Command::Mark(marker))
            }
            MessageJson::Save {} => Self::Command(Command::Save),
            MessageJson::Again { settings } => Self::Replay(settings),
            MessageJson::Correct { by } => Self::Correct(match by {
                Correction::Smoothing => CorrectionRequest::Smoothing,
                Correction::Calibration => CorrectionRequest::Calibration,
                Correction::Drift => CorrectionRequest::Drift,
                Correction::Jitter => CorrectionRequest::Jitter,
                Correction::Pressure { light } => CorrectionRequest::Pressure { light },
                Correction::Gate => CorrectionRequest::Gate,
            }),
            MessageJson::Undo { correction } => Self::Correct(CorrectionRequest::Undo(correction)),
        })
    }

    /// Executes the message, or begins to. Returns a sentence if the result is not visible
    /// anyway.
    ///
    /// # Errors
    /// [`RequestError`]; nothing has changed.
    pub(super) fn execute(self, served: &Served) -> Result<Option<String>, RequestError> {
        let ConsoleSession { broadcaster, controller, .. } = &served.session;
        match self {
            Self::Command(command) => controller.execute(command).map(Some).map_err(RequestError::of_session),
            Self::Replay(settings) => controller.again(settings).map(Some).map_err(RequestError::of_session),
            Self::Correct(request) => controller.correct(request).map(Some).map_err(RequestError::of_session),
            Self::View(ViewMessage::Steer(steer)) => broadcaster.steer(steer).map(|()| None),
            Self::View(ViewMessage::Move(planes)) => broadcaster.move_planes(planes).map(|()| None),
            Self::View(ViewMessage::Style(choice)) => broadcaster.choose(choice).map(|()| None),
            Self::View(ViewMessage::Frame(number)) => {
                controller.show_frame(number).map(|()| None).map_err(RequestError::of_session)
            }
            Self::View(ViewMessage::Snapshot) => snapshot::keep(served).map(Some),
            Self::Page(_) => Err(RequestError::PagesOnly),
        }
    }
}

/// Returns a duration of a message, which is not longer than eleven days.
fn duration(name: &'static str, ms: f64) -> Result<Duration, RequestError> {
    let is_valid = (0.0..=1e9).contains(&ms);
    let duration = is_valid.then(|| Duration::try_from_secs_f64(ms / 1e3).ok()).flatten();
    duration.ok_or(RequestError::Duration { name, ms })
}

impl std::convert::From<Steer> for ClientMessage {
    fn from(steer: Steer) -> Self {
        Self::View(ViewMessage::Steer(steer))
    }
}

impl std::convert::From<Move> for ClientMessage {
    fn from(planes: Move) -> Self {
        Self::View(ViewMessage::Move(planes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::SECOND;
    use sonoweave_core::region::{ClipRect, Fan};

    #[test]
    fn every_command_parses_and_others_are_refused() {
        for (text, command) in [
            ("{\"do\":\"record\"}", Command::Record),
            ("{\"do\":\"scan\"}", Command::Scan),
            ("{\"do\":\"stop\"}", Command::Stop),
            ("{\"do\":\"freeze\",\"on\":true}", Command::Freeze(true)),
            ("{\"do\":\"clear\"}", Command::Clear),
            ("{\"do\":\"save\"}", Command::Save),
            ("{\"do\":\"mask\",\"as\":\"keep\"}", Command::Mask(MaskChange::Keep)),
            ("{\"do\":\"mask\",\"as\":\"whole\"}", Command::Mask(MaskChange::Whole)),
            (
                "{\"do\":\"mask\",\"as\":{\"rectangle\":{\"x\":1,\"y\":2,\"width\":3,\"height\":4}}}",
                Command::Mask(MaskChange::Rectangle(ClipRect { x: 1, y: 2, width: 3, height: 4 })),
            ),
            (
                "{\"do\":\"mask\",\"as\":{\"fan\":{\"origin_px\":[9,-2],\"radii_px\":[3,8],\"angles_deg\":[-30,31]}}}",
                Command::Mask(MaskChange::Fan(Fan::new([9.0, -2.0], [3.0, 8.0], [-30.0, 31.0]).unwrap())),
            ),
        ] {
            assert_eq!(ClientMessage::parse(text), Ok(ClientMessage::Command(command)), "{text}");
        }
        let before_ns = Monotonic.now_ns();
        let Ok(ClientMessage::Command(Command::Mark(marker))) = ClientMessage::parse("{\"do\":\"mark\"}") else {
            panic!("a marker")
        };
        assert!((before_ns..=Monotonic.now_ns()).contains(&marker.at_ns) && marker.by == MarkerSource::Operator);
        let earlier = ClientMessage::parse("{\"do\":\"mark\",\"ago_ms\":9e8}");
        let Ok(ClientMessage::Command(Command::Mark(earlier))) = earlier else { panic!("a marker") };
        assert!((before_ns..=Monotonic.now_ns()).contains(&(earlier.at_ns + 900_000 * SECOND)));
        for (text, request) in [
            ("{\"do\":\"correct\",\"by\":\"smoothing\"}", CorrectionRequest::Smoothing),
            ("{\"do\":\"correct\",\"by\":\"calibration\"}", CorrectionRequest::Calibration),
            ("{\"do\":\"correct\",\"by\":\"drift\"}", CorrectionRequest::Drift),
            ("{\"do\":\"correct\",\"by\":\"jitter\"}", CorrectionRequest::Jitter),
            ("{\"do\":\"correct\",\"by\":{\"pressure\":{\"light\":2}}}", CorrectionRequest::Pressure { light: 2 }),
            ("{\"do\":\"correct\",\"by\":\"gate\"}", CorrectionRequest::Gate),
            ("{\"do\":\"undo\",\"correction\":3}", CorrectionRequest::Undo(3)),
        ] {
            assert_eq!(ClientMessage::parse(text), Ok(ClientMessage::Correct(request)), "{text}");
        }
        assert_eq!(ClientMessage::parse("{\"do\":\"control\"}"), Ok(ClientMessage::Page(PageMessage::Control)));
        let no_rectangle = "{\"do\":\"mask\",\"as\":{\"rectangle\":{\"x\":-1,\"y\":2,\"width\":3,\"height\":4}}}";
        let no_number =
            "{\"do\":\"mask\",\"as\":{\"fan\":{\"origin_px\":[null,0],\"radii_px\":[3,8],\"angles_deg\":[-3,3]}}}";
        for text in [
            no_rectangle,
            no_number,
            "{\"do\":\"mask\"}",
            "",
            "{}",
            "{\"do\":\"reboot\"}",
            "{\"do\":\"freeze\"}",
            "{\"do\":\"correct\"}",
            "{\"do\":\"correct\",\"by\":\"pressure\"}",
            "{\"do\":\"correct\",\"by\":\"gate\",\"light\":1}",
            "{\"do\":\"undo\",\"correction\":-1}",
            "{\"do\":\"save\",\"to\":\"/etc\"}",
            "{\"do\":\"mark\",\"at\":3}",
            "[1]",
        ] {
            let why = ClientMessage::parse(text).unwrap_err().to_string();
            assert!(why.starts_with("this is not a valid command: "), "{text}: {why}");
        }
    }

    #[test]
    fn picture_time_must_be_valid_duration() {
        let shown = |had: &str| ClientMessage::parse(&format!("{{\"do\":\"shown\",\"kind\":2,\"sequence\":7{had}}}"));
        let had = |had| Ok(ClientMessage::Page(PageMessage::Shown { kind: 2, sequence: 7, had }));
        assert_eq!([shown(",\"had_ms\":12.5"), shown("")], [had(Duration::from_micros(12_500)), had(Duration::ZERO)]);
        assert!(
            ClientMessage::parse("{\"do\":\"mark\",\"ago_ms\":-1}").unwrap_err().to_string().starts_with("ago_ms must")
        );
        for wrong in ["-1", "1e300"] {
            assert!(
                shown(&format!(",\"had_ms\":{wrong}"))
                    .unwrap_err()
                    .to_string()
                    .starts_with("had_ms must be a number of milliseconds from 0 to 10⁹, not ")
            );
        }
    }
}

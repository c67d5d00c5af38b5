//! Reasons why a request of a page or program is refused.

/// Reason why a request is refused; it changes nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum RequestError {
    /// A message about a page's connection, sent by a program.
    #[error("this command is possible over a WebSocket only; connect to /v1/stream")]
    PagesOnly,
    /// A text that is no message, with the parser's reason.
    #[error("this is not a valid command: {0}")]
    Command(String),
    /// A time that is no duration, or is too long, ms.
    #[error("{name} must be a number of milliseconds from 0 to 10⁹, not {ms}")]
    Duration {
        /// The field.
        name: &'static str,
        /// Its value.
        ms: f64,
    },
    /// The session's own refusal.
    #[error("{0}")]
    Session(String),
    /// A turn of the view beyond this angle, degrees.
    #[error("a view turns by {0}° at most at a time; send several turns")]
    ViewTurn(f64),
    /// A zoom that is no number.
    #[error("a zoom must be a finite number of doublings")]
    Zoom,
    /// A point outside the picture.
    #[error("a point in the picture must be two fractions of its sides, from 0 to 1")]
    PicturePoint,
    /// A point of a picture that does not exist yet.
    #[error("there is no picture yet to centre a point in; wait for the first slices")]
    NoPicture,
    /// A turn of the free plane beyond this angle, degrees.
    #[error("the free plane turns by {0}° at most at a time; send several turns")]
    PlaneTurn(f64),
    /// A request that needs a volume, with its purpose.
    #[error("there is no volume yet to {0} in; wait for the first slices")]
    NoVolume(&'static str),
    /// A window without two ascending grey values of at most this magnitude.
    #[error("a window must be the grey level of black and a larger one of white, within ±{0}")]
    Window(f64),
    /// A crossing point that is not finite.
    #[error("the crossing point of planes must be three finite numbers, world mm")]
    CrossingPoint,
    /// A point outside the volume; all as text in world mm.
    #[error("the point {at} mm lies outside the volume, which extends from {low} to {high} mm; choose a point inside")]
    OutsideVolume { at: String, low: String, high: String },
    /// No surface at a point of the picture.
    #[error("nothing opaque is visible there; point at something else")]
    NothingVisible,
    /// A style where no volume is drawn.
    #[error("no volume is drawn in this session; start it with a picture")]
    NoStyle,
    /// An opacity curve with too many points.
    #[error("an opacity curve must have at most {most} points, not {given}")]
    CurvePoints { most: usize, given: usize },
    /// A point of an opacity curve at a grey value beyond this magnitude.
    #[error("a point of the opacity curve is at {grey}: give grey levels within ±{most}")]
    CurveGrey { grey: f64, most: f64 },
    /// An impossible opacity curve, with the reason.
    #[error("a point of the opacity curve {0}")]
    Curve(String),
    /// An impossible transfer function, with the reason.
    #[error("{0}")]
    Transfer(String),
    /// A snapshot without a picture.
    #[error("there is no picture yet to save; wait for the first slices")]
    NothingToSave,
    /// A snapshot while one is being written.
    #[error("the last snapshot is still being written; wait for it")]
    SnapshotBusy,
    /// The thread of a snapshot cannot be started.
    #[error("cannot start a thread for it: {0}")]
    SnapshotThread(String),
}

impl RequestError {
    /// Returns the session's refusal as this error.
    pub(super) fn of_session(why: impl std::fmt::Display) -> Self {
        Self::Session(why.to_string())
    }
}

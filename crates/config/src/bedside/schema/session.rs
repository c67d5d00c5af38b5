//! Sections of the session: calibration, pairing, scanner, recording, status, viewers and process.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

use super::values::{Name, RelativePath, TextOr, named};

/// Position of the image relative to the probe, and the part of the image that is data. A virtual
/// bedside needs no such section
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Calibration {
    /// Calibration file of sonoweave, or a PLUS XML; for an arm it also contains the joints
    pub(crate) file: Option<RelativePath>,
    /// Name of a preset of the calibration file; default: the only one
    pub(crate) preset: Option<String>,
    /// Age of the probe's calibration above which a warning is given
    #[schemars(range(min = 1, max = 36_500))]
    #[default(180)]
    pub(crate) warn_after_days: u32,
    /// Transform from pixels to mm at the probe's sensor, instead of a file
    #[schemars(extend("x-takes" = "16 numbers, row major"))]
    pub(crate) image_to_probe: Option<[f64; 16]>,
    /// Rectangle of the image that is data; default: the calibration file's, else detected in the
    /// first frames
    #[schemars(extend("x-takes" = "[x, y, width, height], \"auto\" or \"none\""))]
    pub(crate) clip_px: Option<TextOr<[u32; 4]>>,
    /// Sector of the image that is data, in degrees from straight down, positive to the right;
    /// default: the calibration file's
    #[schemars(extend("x-takes" = "{ origin_px, radii_px, angles_deg }"))]
    pub(crate) fan: Option<Fan>,
}

/// A sector.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Fan {
    pub(crate) origin_px: [f64; 2],
    pub(crate) radii_px: [f64; 2],
    pub(crate) angles_deg: [f64; 2],
}

/// The assignment of poses to frames
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Pairing {
    /// Longest time that a frame waits for poses around its time
    #[schemars(range(min = 0, max = 10_000))]
    #[default(500.0)]
    pub(crate) wait_ms: f64,
    /// Longest time between two poses for interpolation
    #[schemars(range(min = 1, max = 10_000))]
    #[default(100.0)]
    pub(crate) longest_gap_ms: f64,
    /// Time before and after a frame over which a tracker's poses are smoothed; 0: interpolation
    /// between two poses. Only white noise is averaged out
    #[schemars(range(min = 0, max = 1000))]
    pub(crate) smoothing_ms: f64,
    /// Part of the time after the frame that smoothing uses; a frame waits for it
    #[schemars(range(min = 0, max = 1000))]
    #[default(33.0)]
    pub(crate) smoothing_ahead_ms: f64,
}

/// The ultrasound scanner
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Scanner {
    /// Time of equal frames at changing poses after which the scanner counts as frozen
    #[schemars(range(min = 0.05, max = 60), extend("x-at-once" = true))]
    #[default(0.5)]
    pub(crate) frozen_s: f64,
    /// Length along the scanner's depth ruler, at its present setting; presets of another depth are
    /// refused; default: no comparison
    #[schemars(extend("x-takes" = "{ px, mm }"))]
    pub(crate) ruler: Option<Ruler>,
}

/// A length on the screen, and by its labels.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Ruler {
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) px: f64,
    #[schemars(extend("exclusiveMinimum" = 0))]
    pub(crate) mm: f64,
}

/// The recording of a session; `--record` begins one too
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Record {
    /// Folder of recordings; default: no recording, except with `--record`
    pub(crate) folder: Option<RelativePath>,
    /// True to record whole video frames; pixels outside the scanner's image may show the
    /// patient's name
    pub(crate) full_frame: bool,
    /// Free space on the disk at which the recording ends
    #[schemars(extend("x-at-once" = true))]
    #[default(1024)]
    pub(crate) keep_free_mb: u32,
}

/// The session's page, status and metrics, and access to them
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Status {
    /// Address of the page, status and metrics; default: none. An address that other machines can
    /// reach needs certificate, key and token_file
    #[schemars(extend("x-takes" = "\"ADDRESS:PORT\", such as \"127.0.0.1:9110\""))]
    pub(crate) listen: Option<String>,
    /// The server's certificate as PEM, followed by intermediate certificates; the server then uses
    /// HTTPS; default: plain HTTP
    pub(crate) certificate: Option<RelativePath>,
    /// The certificate's private key as PEM; only its owner and group may have permission to read
    /// it
    pub(crate) key: Option<RelativePath>,
    /// File with the access token: one line of 32 characters or more, readable by its owner only.
    /// Every viewer and client must present the token; default: no token
    pub(crate) token_file: Option<RelativePath>,
    /// File with another token, in the same form. It gives the metrics and nothing else, for a
    /// server that watches this session; default: none
    pub(crate) metrics_token_file: Option<RelativePath>,
    /// Further names of this machine, besides its own addresses and the certificate's names
    #[schemars(extend("x-takes" = "a list of names or addresses"))]
    pub(crate) names: Vec<String>,
}

/// The OpenIGTLink server for viewers such as 3D Slicer, which the flag `--igtl` starts
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Igtl {
    /// Networks of other machines that may connect; 127.0.0.1 and ::1 always may. Without networks,
    /// the server listens on this machine only. A network of all addresses is refused
    #[schemars(extend(
        "x-takes" = "a list of networks or addresses, such as [\"192.168.0.0/24\", \"fd00::/64\"]",
        "x-at-once" = true
    ))]
    pub(crate) allow: Vec<String>,
}

/// A line on which a chest belt or an ECG marks moments while a session is recorded
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Markers {
    /// Serial port whose input is watched; default: none
    pub(crate) port: Option<String>,
    /// Input of the port: clear to send, or carrier detect
    #[default(Name(MarkerInput::Cts))]
    pub(crate) input: Name<MarkerInput>,
    /// Edge that marks a moment
    #[default(Name(MarkerEdge::Rising))]
    pub(crate) edge: Name<MarkerEdge>,
}

/// An input of a serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkerInput {
    /// Clear to send.
    Cts,
    /// Data carrier detect.
    Dcd,
}

/// An edge of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkerEdge {
    /// From off to on.
    Rising,
    /// From on to off.
    Falling,
}

/// The session's priority among the machine's programs
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Process {
    /// Real-time priority for threads that receive data, and memory that is not paged out. A
    /// virtual bedside does not use if-permitted; with required, the session does not begin without
    /// permission
    #[default(Name(Realtime::IfPermitted))]
    pub(crate) realtime: Name<Realtime>,
}

/// Real-time scheduling, and memory that is not paged out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Realtime {
    /// Used as far as the system permits it.
    IfPermitted,
    /// Not even if it is permitted.
    Never,
    /// Required: no session runs without it.
    Required,
}

named! {
    Realtime:
        [("if-permitted", Realtime::IfPermitted), ("never", Realtime::Never), ("required", Realtime::Required)];
    MarkerInput: [("cts", MarkerInput::Cts), ("dcd", MarkerInput::Dcd)];
    MarkerEdge: [("rising", MarkerEdge::Rising), ("falling", MarkerEdge::Falling)];
}

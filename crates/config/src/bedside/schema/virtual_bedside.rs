//! Sections of the virtual bedside and its faults.

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smart_default::SmartDefault;

use phantom::bedside::stylus::StylusMotion;
use phantom::named::{ProbeName, SceneName, TrajectoryName};

use super::values::{Name, named, of_flag};

/// The virtual bedside, for devices that are "virtual": a simulated hand sweeps to and fro over a
/// body
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Virtual {
    /// Scanned object
    #[schemars(extend("x-takes" = "a scene of `phantom`, such as doll"))]
    #[default(Name(SceneName::Doll))]
    pub(crate) scene: Name<SceneName>,
    /// Transducer of the scanner, for scenes with simulated echoes; default: linear for an arm,
    /// whose planar path needs a rectangular image, else the usual one of the scene
    pub(crate) probe: Option<Name<ProbeName>>,
    /// Motion of the probe; default: freehand, for an arm arm
    #[schemars(extend("x-takes" = "a trajectory of `phantom`, such as freehand"))]
    pub(crate) trajectory: Option<Name<TrajectoryName>>,
    /// Motion of the stylus, if there is a `tracker.stylus_station`; default: pivot
    #[schemars(extend("x-takes" = "pivot or landmarks"))]
    pub(crate) stylus: Option<Name<StylusMotion>>,
    /// Number of video frames of a sweep in one direction
    #[schemars(range(min = 2, max = 100_000))]
    #[default(300)]
    pub(crate) frames: u32,
    /// Mean distance between frames; default: 1 for a sweep round a point, the distance that covers
    /// a whole body, else 0.35
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub(crate) gap_mm: Option<f64>,
    /// Size of a pixel; default: the size that shows the scanner's whole field, else 0.1
    #[schemars(range(max = 1000), extend("exclusiveMinimum" = 0))]
    pub(crate) pixel_mm: Option<f64>,
    /// Noise of the frames, in grey levels; default: the usual noise of the scene
    #[schemars(range(min = 0, max = 255))]
    pub(crate) noise_sd: Option<f64>,
    /// Noise of each tracker sensor along each axis
    #[schemars(range(min = 0, max = 10))]
    pub(crate) tracker_noise_mm: f64,
    /// Noise of each tracker sensor about each axis
    #[schemars(range(min = 0, max = 10))]
    pub(crate) tracker_noise_deg: f64,
    /// Drift of the tracker's sensor on the transducer: from 0 to so much and back, each minute
    #[schemars(range(min = 0, max = 10))]
    pub(crate) tracker_drift_mm: f64,
    /// Displacement of the skin by the probe in all sweeps but the first, for scenes without
    /// simulated echoes
    #[schemars(range(min = 0, max = 5))]
    pub(crate) pressure_mm: f64,
    /// Seed of all random numbers
    #[schemars(range(max = u32::MAX))]
    #[default(1)]
    pub(crate) seed: u32,
    /// True to paint all frames of the sweep before the session begins, for measurements of their
    /// processing
    pub(crate) painted: bool,
}

named! {
    ProbeName: of_flag(ProbeName::value_variants());
    SceneName: of_flag(SceneName::value_variants());
    StylusMotion: of_flag(StylusMotion::value_variants());
    TrajectoryName: of_flag(TrajectoryName::value_variants());
}

/// Faults between a virtual tracker or arm and the host; default: none
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Line {
    /// Delay of all delivered data
    #[schemars(range(min = 0, max = 10_000))]
    pub(crate) latency_ms: f64,
    /// Largest additional delay, random for each delivery
    #[schemars(range(min = 0, max = 10_000))]
    pub(crate) jitter_ms: f64,
    /// Time between packets of bytes, as from an adapter that collects bytes; with 0, bytes arrive
    /// at once
    #[schemars(range(min = 0, max = 1000))]
    pub(crate) packet_ms: f64,
    /// Deviation of its clock's rate; positive for a faster clock
    #[schemars(range(min = -10_000, max = 10_000))]
    pub(crate) drift_ppm: f64,
    /// Share of bytes that are lost on the line
    #[schemars(range(min = 0, max = 1))]
    pub(crate) drop: f64,
    /// Share of bytes that arrive with another value
    #[schemars(range(min = 0, max = 1))]
    pub(crate) noise: f64,
    /// Share of readings that are never sent
    #[schemars(range(min = 0, max = 1))]
    pub(crate) dropout: f64,
}

/// Faults of a virtual grabber; default: none
#[derive(Debug, SmartDefault, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(crate) struct Grabber {
    /// Delay of all delivered frames
    #[schemars(range(min = 0, max = 10_000))]
    pub(crate) latency_ms: f64,
    /// Largest additional delay, random for each frame
    #[schemars(range(min = 0, max = 10_000))]
    pub(crate) jitter_ms: f64,
    /// Deviation of its clock's rate; positive for a faster clock
    #[schemars(range(min = -10_000, max = 10_000))]
    pub(crate) drift_ppm: f64,
    /// Share of frames that are never sent
    #[schemars(range(min = 0, max = 1))]
    pub(crate) dropout: f64,
}

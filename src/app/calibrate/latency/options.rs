//! Flags for the recording of a lag, and for its search.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::super::guide::Gathering;

/// The recording of a lag, and the search for it.
#[derive(Debug, Args)]
pub(crate) struct Options {
    /// Video frames: a sequence (.mha, .mhd, .nrrd, .nhdr); the poses come from --tracker
    #[arg(long, value_name = "SEQUENCE", requires = "tracker")]
    pub(super) video: Option<PathBuf>,
    /// Poses: a tracked sequence, which needs no video frames
    #[arg(long, value_name = "SEQUENCE", requires = "video")]
    pub(super) tracker: Option<PathBuf>,
    /// Video frames with their poses: a tracked sequence
    #[arg(long, value_name = "SEQUENCE")]
    pub(super) sequence: Option<PathBuf>,
    /// Video frames and poses: a recorded session (.mcap). Its own latencies are ignored
    #[arg(long, value_name = "SESSION")]
    pub(super) session: Option<PathBuf>,
    /// Session configuration: record its devices now, show instructions, and end when there is
    /// enough
    #[arg(long, value_name = "BEDSIDE.toml")]
    pub(super) live: Option<PathBuf>,
    #[command(flatten)]
    pub(super) gathering: Gathering,
    /// Method to find the lag [default: line, and crossings if no video frame shows a floor]
    #[arg(long, value_enum, value_name = "METHOD")]
    pub(super) method: Option<Method>,
    /// Latency of the video frames' time stamps behind their contents, ms [default: the
    /// session's, else 0]
    #[arg(long, value_name = "MS", allow_hyphen_values = true)]
    pub(super) video_latency_ms: Option<f64>,
    /// Search for lags from -MS to +MS
    #[arg(long, value_name = "MS", default_value_t = 500.0)]
    pub(super) range_ms: f64,
    /// Transform from image to probe: our TOML or a PLUS XML [default: the session's]
    #[arg(short, long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
}

/// Method to find a lag.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Method {
    /// The line of a water tank's floor
    Line,
    /// Slices that cross
    Crossings,
}

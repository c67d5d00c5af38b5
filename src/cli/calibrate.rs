//! `sonoweave calibrate`: the calibration subcommands, one file each.

mod advice;
pub mod arm;
pub mod crossings;
mod done;
pub mod drawing;
pub(crate) mod keywords;
pub mod landmarks;
pub mod latency;
pub mod pivot;
pub mod probe;
pub mod tracker;

use clap::{Args, Subcommand};

use super::Failure;
use done::by_flags;

/// Flags of `calibrate`: the quantity to calibrate.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Find the image plane's transform to the probe's sensor, from a scan of a wire phantom
    Probe(Box<probe::Arguments>),
    /// Find the latency of the tracker's poses relative to the video frames
    Latency(Box<latency::Arguments>),
    /// Check a probe's calibration by slices that cross, and correct it without a phantom
    Crossings(Box<crossings::Arguments>),
    /// Find the tip of a stylus that is swung while its tip rests in one place
    Pivot(Box<pivot::Arguments>),
    /// Find an arm's link lengths and encoder zeros from touches, or check that they still hold
    Arm(Box<arm::Arguments>),
    /// Find the pose of a phantom, from its landmarks touched with the stylus
    Landmarks(Box<landmarks::Arguments>),
    /// Draw the construction of a wire phantom with two plates, at 1:1 on paper
    Drawing(drawing::Arguments),
    /// Measure a tracker on site: the noise of a resting sensor, or a map of its field's
    /// distortion by metal
    Tracker(Box<tracker::Arguments>),
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the result, or is not good enough; nothing
/// is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.what {
        What::Probe(arguments) => by_flags(&**arguments),
        What::Latency(arguments) => by_flags(&**arguments),
        What::Crossings(arguments) => by_flags(&**arguments),
        What::Pivot(arguments) => by_flags(&**arguments),
        What::Arm(arguments) => by_flags(&**arguments),
        What::Landmarks(arguments) => by_flags(&**arguments),
        What::Drawing(arguments) => drawing::run(arguments),
        What::Tracker(arguments) => by_flags(&**arguments),
    }
}

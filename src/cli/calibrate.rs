//! `sonoweave calibrate`: what can be calibrated, a file each.

pub mod arm;
pub mod drawing;
pub mod guide;
pub mod landmarks;
pub mod latency;
mod outputs;
pub mod pivot;
pub mod poses;
pub mod probe;
mod recorded;
mod tip;
pub mod tracker;

use clap::{Args, Subcommand};

use super::Failure;

/// What is to be calibrated.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Find where the picture lies in the frame of the probe's sensor, from a scan of a phantom of wires
    Probe(Box<probe::Arguments>),
    /// Find how much later the tracker's poses come than the pictures
    Latency(Box<latency::Arguments>),
    /// Find the tip of a stylus that is swung while its tip rests in one place
    Pivot(Box<pivot::Arguments>),
    /// Find an arm's lengths and zeros from touches, or whether it still has them
    Arm(Box<arm::Arguments>),
    /// Find where a phantom is held, from its landmarks touched with the stylus
    Landmarks(Box<landmarks::Arguments>),
    /// Draw how a phantom of wires between two plates is built, at 1:1 on paper
    Drawing(drawing::Arguments),
    /// Measure a tracker where it stands: the noise of a still sensor, or a map of where metal bends its field
    Tracker(Box<tracker::Arguments>),
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not say what is sought, or is not good enough; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match &arguments.what {
        What::Probe(arguments) => probe::run(arguments),
        What::Latency(arguments) => latency::run(arguments),
        What::Pivot(arguments) => pivot::run(arguments),
        What::Arm(arguments) => arm::run(arguments),
        What::Landmarks(arguments) => landmarks::run(arguments),
        What::Drawing(arguments) => drawing::run(arguments),
        What::Tracker(arguments) => tracker::run(arguments),
    }
}

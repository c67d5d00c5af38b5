//! `sonoweave reconstruct`: a recorded sweep becomes a volume.

pub(super) mod filling;
pub(super) mod flags;
pub(super) mod outputs;
mod weighing;

use std::path::PathBuf;

use clap::Args;

use super::{Failure, input};
use crate::pipeline;
use flags::Flags;
use outputs::Request;

/// Flags of `reconstruct`.
#[derive(Debug, Args)]
#[command(after_help = "\
A sequence needs a way from its pictures to the world: transforms like ProbeToTracker and ReferenceToTracker in the sequence, and the \
probe's calibration ImageToProbe in --config or --image-to-probe. A sequence that holds ImageToReference, ImageToWorld or \
ImageToTracker needs no calibration.

Example: sonoweave reconstruct sweep.igs.mha --config PlusConfiguration.xml -o volume.mha --planes volume.png")]
pub struct Arguments {
    /// The recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    sequence: PathBuf,
    /// Where to write the volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, or .dcm for DICOM)
    #[arg(short, long, value_name = "VOL.mha")]
    output: PathBuf,
    #[command(flatten)]
    flags: Flags,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let (request, job) = Request::new(&arguments.sequence, Some(&arguments.output), &arguments.flags)?;
    let bar = input::progress("weaving", 1);
    let result = pipeline::reconstruct(job, &mut (), |p| {
        bar.set_length(p.total);
        bar.set_position(p.done);
    });
    bar.finish_and_clear();
    request.finish(result?, None::<&()>)
}

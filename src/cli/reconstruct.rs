//! `sonoweave reconstruct`: a recorded sweep becomes a volume.

mod batch;
pub(super) mod beside;
pub(super) mod filling;
pub(super) mod flags;
pub(super) mod outputs;
mod weighing;

use std::path::{Path, PathBuf};

use clap::Args;

use super::{Failure, input};
use crate::pipeline;
use crate::statistics::Statistics;
use beside::Beside;
use flags::Flags;
use outputs::Request;

/// Flags of `reconstruct`.
#[derive(Debug, Args)]
#[command(after_help = "\
A sequence needs a way from its pictures to the world: transforms like ProbeToTracker and ReferenceToTracker in the sequence, and the \
probe's calibration ImageToProbe in --config or --image-to-probe. A sequence that holds ImageToReference, ImageToWorld or \
ImageToTracker needs no calibration.

Of several sweeps -o, --weights, --planes and --stats name folders, which may be the same: a sweep NAME.igs.mha has NAME.mha, NAME.weights.mha, NAME.planes.png and \
NAME.stats.json there.

Example: sonoweave reconstruct sweep.igs.mha --config PlusConfiguration.xml -o volume.mha --planes volume.png
         sonoweave reconstruct monday.igs.mha tuesday.igs.mha --config PlusConfiguration.xml -o volumes --stats volumes")]
pub struct Arguments {
    /// The recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr); of several each becomes a volume of its name
    #[arg(required = true, value_name = "SEQUENCE")]
    sequences: Vec<PathBuf>,
    /// Where to write the volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, or .dcm for DICOM); of several sweeps the folder for their volumes
    #[arg(short, long, value_name = "VOL.mha")]
    output: PathBuf,
    #[command(flatten)]
    flags: Flags,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then; of several sweeps, not those that failed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { sequences, output, flags } = arguments;
    match sequences.as_slice() {
        [sequence] => weave(sequence, output, flags, flags.beside.clone()).map(drop),
        _ => batch::run(sequences, output, flags),
    }
}

/// A recorded sweep to a volume and what is beside it; what was done, in numbers.
fn weave(sequence: &Path, output: &Path, flags: &Flags, beside: Beside) -> Result<Statistics, Failure> {
    let (request, job) = Request::new(sequence, Some(output), flags, beside)?;
    let bar = input::progress("weaving", 1);
    let result = pipeline::reconstruct(job, &mut (), |p| {
        bar.set_length(p.total);
        bar.set_position(p.done);
    });
    bar.finish_and_clear();
    request.finish(result?, None::<&()>)
}

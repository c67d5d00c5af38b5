//! `sonoweave reconstruct`: reconstructs a recorded sweep into a volume.

mod beside;
pub(super) mod filling;
pub(crate) mod flags;
pub(super) mod one;
mod several;
mod weighing;

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use crate::app::reconstruct::beside::Beside;
use flags::Flags;
use one::reconstruct;

/// File formats of volumes, by the ends of their names.
pub(super) const FORMATS: [&str; 8] = ["mha", "mhd", "nrrd", "nhdr", "nii", "nii.gz", "ome.zarr", "dcm"];

/// Flags of `reconstruct`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A sequence needs a chain of transforms from its frames to the world: ProbeToTracker and ReferenceToTracker in the \
sequence, and the probe's calibration ImageToProbe in --config or --image-to-probe. A sequence that holds \
ImageToReference, ImageToWorld or ImageToTracker needs no calibration.

For several sweeps, give folders as -o, --weights, --error, --planes and --json=; they may be the same. A sweep \
NAME.igs.mha results in NAME.mha (or another --format), NAME.weights.mha, NAME.error.mha, NAME.planes.png and NAME.json.

Example: sonoweave reconstruct sweep.igs.mha --config PlusConfiguration.xml -o volume.mha --planes volume.png
         sonoweave reconstruct monday.igs.mha tuesday.igs.mha --config PlusConfiguration.xml -o volumes \
--json=volumes")]
pub struct Arguments {
    /// Recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr); each of several becomes a
    /// volume of its name
    #[arg(required = true, value_name = "SEQUENCE")]
    sequences: Vec<PathBuf>,
    /// Write the volume to this file (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .dcm for DICOM, or
    /// .ome.zarr for OME-Zarr with weights); for several sweeps, to this folder
    #[arg(short, long, value_name = "VOL.mha")]
    output: PathBuf,
    /// File format of the volumes of several sweeps [default: mha]
    #[arg(long, value_name = "FORMAT", value_parser = FORMATS)]
    format: Option<String>,
    /// Reconstruct an .ome.zarr volume in regions that fit into --max-memory, each from the frames
    /// that reach it: the same voxels. Done by itself if memory does not suffice. An interrupted
    /// run goes on where it was
    #[arg(long)]
    out_of_core: bool,
    #[command(flatten)]
    flags: Flags,
}

impl Arguments {
    /// Checks the flags without reading the recording.
    ///
    /// # Errors
    /// [`Failure`] when flags contradict each other or have wrong values.
    pub(super) fn check(&self) -> Result<(), Failure> {
        let [sequence] = &self.sequences[..] else { fail_usage!("several recordings; give one") };
        let (request, _) = self.flags.request(sequence, Some(&self.output), Beside::default())?;
        if self.out_of_core { request.check_regions() } else { Ok(()) }
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then; for several sweeps, the failed ones were not written.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { sequences, output, format, flags, out_of_core } = arguments;
    match sequences.as_slice() {
        [_] if format.is_some() => {
            Err(Failure::usage("--format: is for several sweeps; give -o the name that a volume of this format has"))
        }
        [sequence] => {
            let (_, document) = reconstruct(sequence, output, flags, flags.beside.beside(), *out_of_core)?;
            flags.beside.json.write_text(&document)
        }
        _ if *out_of_core => Err(Failure::usage("--out-of-core: is for one sweep; give one, with -o NAME.ome.zarr")),
        _ => several::run(sequences, (output, format.as_deref().unwrap_or("mha")), flags),
    }
}

//! `sonoweave contours`: makes the body between contours on planes, and measures it.

use std::path::{Path, PathBuf};

use clap::Args;

use super::Failure;
use super::dicom::flags::DicomFlags;
use super::progress::say;
use crate::app::contours::Request;
use crate::app::input;
use crate::app::json::JsonFlag;

/// Flags of `contours`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A file of contours lists closed curves on planes, in the order of the sweep. The planes may be tilted against each \
other, but must not cross within the curves. The body ends flat at the first plane and at the last one.

Its volume is given twice: by the surface, and by the areas and centroids of the contours alone. If both are more \
than 3 % apart, a note warns.

Examples: sonoweave contours contours.toml -o body.stl
          sonoweave contours contours.toml -o region.nrrd --spacing 0.5 --json")]
pub struct Arguments {
    /// Contours (.toml)
    contours: PathBuf,
    /// Write the body: a mesh (.stl, .ply, .obj, .glb), a label volume (.nrrd, .nhdr, .mha, .mhd,
    /// .nii, .nii.gz) or a DICOM segmentation (.dcm) [default: not written]
    #[arg(short, long, value_name = "BODY.stl")]
    output: Option<PathBuf>,
    /// Edge of the body's voxels, mm [default: a hundredth of its longest edge]
    #[arg(long, value_name = "MM")]
    spacing: Option<f64>,
    /// Threads; any number gives the same body [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory limit for the voxels and the mesh, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
    #[command(flatten)]
    json: JsonFlag,
    #[command(flatten)]
    dicom: DicomFlags,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let identifiers = arguments.dicom.identifiers();
    identifiers.check()?;
    let Arguments { contours, output, spacing, threads, json, .. } = arguments;
    let output = output.as_deref();
    if let Some(path) = output {
        input::check_output(path)?;
        input::check_is_not(path, contours)?;
    }
    json.check([contours.as_path()])?;
    let memory_bytes = super::render::gibibytes(arguments.max_memory)?;
    let limits = (input::threads(*threads), memory_bytes);
    let request = Request::new(contours, output, *spacing, identifiers, limits)?;
    say(&format!("note: {}", request.plan()));
    let made = request.run()?;
    made.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let name = output.unwrap_or(Path::new("contours")).display().to_string();
    print_line!("{name}: {}", made.text());
    json.write(&made)
}

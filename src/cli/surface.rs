//! `sonoweave surface`: makes a mesh of a grey value of a volume, and measures it.

use std::path::{Path, PathBuf};

use clap::Args;

use render::crop::Crop;
use surface::Format;

use super::Failure;
use super::progress::say;
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::surface::{Blur, Request};

/// Flags of `surface`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The surface lies between voxels above and below --isovalue, where all voxels around are seen. If coverage ends on it, \
it is open, and no volume is given.

The kernel of the reconstruction and the scanner's resolution shrink a bright body. --blur moves the surface back by \
their width; both volumes are given then. The files are in mm of the volume's world, .glb in metres.

Examples: sonoweave surface volume.mha --weights weights.mha -o body.stl --isovalue 90
          sonoweave surface volume.mha -o body.glb --crop crop.toml --largest --blur kernel")]
pub struct Arguments {
    /// Volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .ome.zarr)
    volume: PathBuf,
    /// Write the mesh to this file (.stl, .ply, .obj, .glb) [default: not written]
    #[arg(short, long, value_name = "MESH.stl")]
    output: Option<PathBuf>,
    /// Volume's weights, as `reconstruct --weights` wrote them: 0 marks unseen voxels
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
    /// Grey value of the surface [default: halfway between black and white of the volume]
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    isovalue: Option<f32>,
    /// Leave out the parts of the volume that a crop file names; the surface is open at cuts
    #[arg(long, value_name = "FILE.toml")]
    crop: Option<PathBuf>,
    /// Keep only the part with the most triangles
    #[arg(long)]
    largest: bool,
    /// Move the surface back by a blur: its standard deviation, mm, or kernel for that of the
    /// volume's kernel by its header; 0 corrects for the voxels alone [default: not moved]
    #[arg(long, value_name = "MM|kernel", value_parser = parsed_blur)]
    blur: Option<Blur>,
    /// Threads; any number gives the same mesh [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory limit for the volume and the mesh, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
    #[command(flatten)]
    json: JsonFlag,
}

/// Parses a blur.
fn parsed_blur(text: &str) -> Result<Blur, String> {
    if text == "kernel" {
        return Ok(Blur::Kernel);
    }
    let mm = text.parse().ok().filter(|mm: &f64| mm.is_finite() && *mm >= 0.0);
    mm.map(Blur::Mm).ok_or_else(|| "must be a number of mm that is not negative, or kernel".into())
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { volume, output, weights, isovalue, largest, blur, threads, json, .. } = arguments;
    let inputs = [Some(volume), weights.as_ref(), arguments.crop.as_ref()];
    let inputs = || inputs.into_iter().flatten().map(PathBuf::as_path);
    if let Some(path) = output {
        Format::of(path)?;
        input::check_output(path)?;
        inputs().try_for_each(|from| input::check_is_not(path, from))?;
    }
    json.check(inputs())?;
    let crop = arguments.crop.as_deref().map(Crop::read).transpose()?;
    let request = Request {
        volume,
        weights: weights.as_deref(),
        output: output.as_deref(),
        isovalue: *isovalue,
        crop: crop.unwrap_or_default(),
        largest: *largest,
        blur: *blur,
        threads: input::threads(*threads),
        memory_bytes: super::render::gibibytes(arguments.max_memory)?,
    };
    let made = request.run()?;
    made.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let name = output.as_deref().unwrap_or(Path::new("surface")).display().to_string();
    print_line!("{name}: {}", made.text());
    json.write(&made)
}

//! `sonoweave region`: finds the region of a volume that a seed lies in, and measures it.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::DVec3;

use segment::Growth;
use sonoweave_core::keys::numbers;

use super::Failure;
use super::dicom::flags::DicomFlags;
use super::progress::say;
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::labels::Form;
use crate::app::region::Request;

/// Flags of `region`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The region is all voxels in the range that are connected with the seed by faces, by values that are smoothed over \
seen voxels. It never passes an unseen voxel. Pockets that it encloses are filled. --open removes bridges thinner \
than twice its radius, through which a region leaks, and keeps the part with the seed.

A label volume has 0 outside, 1 in the region and 255 where no slice was. The error of the volume is half of the \
border's voxels: it covers a border half a voxel farther in or out, but no error of range, calibration or tracking.

Examples: sonoweave region volume.mha --weights weights.mha --seed 12,-3.5,40 -o region.nrrd
          sonoweave region volume.mha --seed 12,-3.5,40 --range 0,60 --open 1.5 -o region.stl")]
pub struct Arguments {
    /// Volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .ome.zarr)
    volume: PathBuf,
    /// A point of the region, mm of the volume's world
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parsed_seed)]
    seed: DVec3,
    /// Write the region: a label volume (.nrrd, .nhdr, .mha, .mhd, .nii, .nii.gz), a DICOM
    /// segmentation (.dcm) or a mesh (.stl, .ply, .obj, .glb) [default: not written]
    #[arg(short, long, value_name = "REGION.nrrd")]
    output: Option<PathBuf>,
    /// Volume's weights, as `reconstruct --weights` wrote them: 0 marks unseen voxels
    #[arg(long, value_name = "FILE.mha")]
    weights: Option<PathBuf>,
    /// Lowest and highest smoothed value [default: mean ± 2 standard deviations around the seed]
    #[arg(long, value_name = "LOW,HIGH", allow_hyphen_values = true, value_parser = parsed_range)]
    range: Option<Range>,
    /// Radius of the ball around the seed whose voxels give the default range, mm
    #[arg(long, value_name = "MM", default_value_t = 2.0)]
    radius: f64,
    /// Standard deviation of the smoothing, mm; 0 for none [default: one voxel]
    #[arg(long, value_name = "MM")]
    smooth: Option<f64>,
    /// Open the region by a ball of this radius, mm; 0 for none
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    open: f64,
    /// Largest volume, ml; a region that grows beyond it is refused
    #[arg(long, value_name = "ML", default_value_t = 200.0)]
    limit: f64,
    /// Threads; any number gives the same region [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory limit for the volume and the region, GiB
    #[arg(long, value_name = "GIB", default_value_t = 8.0)]
    max_memory: f64,
    #[command(flatten)]
    json: JsonFlag,
    #[command(flatten)]
    dicom: DicomFlags,
}

// clap takes an array for its own notation of repeated values; named types are single values to
// it.
type Range = [f32; 2];

fn parsed_seed(text: &str) -> Result<DVec3, String> {
    Ok(DVec3::from_array(numbers::<3>(text)?))
}

fn parsed_range(text: &str) -> Result<Range, String> {
    Ok(numbers::<2>(text)?.map(|value| value as f32))
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: nothing was written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let identifiers = arguments.dicom.identifiers();
    identifiers.check()?;
    let Arguments { volume, output, weights, threads, json, .. } = arguments;
    let inputs = || [Some(volume), weights.as_ref()].into_iter().flatten().map(PathBuf::as_path);
    if let Some(path) = output {
        Form::of(path)?;
        input::check_output(path)?;
        inputs().try_for_each(|from| input::check_is_not(path, from))?;
    }
    json.check(inputs())?;
    let request = Request {
        volume,
        weights: weights.as_deref(),
        output: output.as_deref(),
        growth: Growth {
            seed: arguments.seed,
            range: arguments.range,
            radius_mm: arguments.radius,
            smoothing_mm: arguments.smooth,
            opening_mm: arguments.open,
            limit_ml: arguments.limit,
            grey_level: 0.0,
        },
        identifiers,
        threads: input::threads(*threads),
        memory_bytes: super::render::gibibytes(arguments.max_memory)?,
    };
    let made = request.run()?;
    made.notes.iter().for_each(|note| say(&format!("note: {note}")));
    let name = output.as_deref().unwrap_or(Path::new("region")).display().to_string();
    print_line!("{name}: {}", made.text());
    json.write(&made)
}

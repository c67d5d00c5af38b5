//! What a run did, in numbers: the content of `--stats`, and of what a session tells while it runs.

mod live;
mod picture;
mod process;

use std::path::Path;
use std::time::Duration;

use serde::Serialize;

pub use live::LiveStatistics;
pub use picture::{PictureNumbers, PictureStatistics};
pub use process::ProcessNumbers;

use crate::config::Settings as Config;
use crate::export::fill::{FillWork, Filled};
use crate::export::volume::DenseBox;
use crate::export::whole::write_whole;
use crate::ledger::Ledger;
use crate::mask::MaskSettings;
use crate::pipeline::Outcome;
use crate::reconstruct::Compounding;

/// Spread of the time that slices took, ms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Milliseconds {
    /// Half took at most this.
    pub median: f64,
    /// 95 % took at most this.
    pub p95: f64,
    /// 99 % took at most this.
    pub p99: f64,
    /// The slowest.
    pub max: f64,
    /// All together.
    pub total: f64,
}

impl Milliseconds {
    /// `None` without samples. Quantiles are samples (the nearest rank).
    pub fn of(samples: &[f64]) -> Option<Self> {
        let mut sorted = samples.to_vec();
        sorted.sort_by(f64::total_cmp);
        let rank = |q: f64| sorted.get(((q * sorted.len() as f64).ceil() as usize).saturating_sub(1)).copied();
        Some(Self {
            median: rank(0.5)?,
            p95: rank(0.95)?,
            p99: rank(0.99)?,
            max: rank(1.0)?,
            total: samples.iter().sum(),
        })
    }
}

/// Where the written volume lies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GridNumbers {
    /// World position of the centre of voxel (0, 0, 0), mm.
    pub origin: [f64; 3],
    /// Voxels along x, y, z.
    pub size: [u64; 3],
    /// Distance between voxels, mm.
    pub spacing: [f64; 3],
    /// Direction of each index axis in the world.
    pub direction: [[f64; 3]; 3],
}

/// Work done, for seeing what was skipped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct WorkNumbers {
    /// Pixels read by the in-plane filter.
    pub pixels_filtered: u64,
    /// Nodes that it computed.
    pub nodes: u64,
    /// Products that it summed.
    pub taps: u64,
    /// Bricks that intervals could not exclude, summed over slices.
    pub bricks_considered: u64,
    /// Columns that intervals could not exclude, summed over slices, on the planar path.
    pub columns_considered: u64,
    /// Columns that changed, summed over slices, on the planar path.
    pub columns_touched: u64,
    /// Bricks that changed, summed over slices.
    pub bricks_touched: u64,
    /// Voxels sampled, in whole vectors.
    pub voxels_sampled: u64,
}

/// A decay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DecayNumbers {
    /// Its course.
    pub mode: &'static str,
    /// How fast the past fades, 1/s.
    pub rate_per_s: f64,
    /// For how long it does not, s.
    pub wait_s: f64,
}

impl DecayNumbers {
    fn of(compounding: Compounding) -> Option<Self> {
        let Compounding::Decay(decay) = compounding else { return None };
        Some(Self { mode: decay.name(), rate_per_s: decay.rate_per_s(), wait_s: decay.wait_s() })
    }
}

/// Holes that were filled in what was written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FillNumbers {
    /// What with.
    pub law: &'static str,
    /// From how far away, mm.
    pub radius_mm: f64,
    /// Bricks of 8³ voxels of the box that seen voxels may reach.
    pub bricks_considered: u64,
    /// Those that were worked on.
    pub bricks_touched: u64,
    /// Their voxels that were not seen.
    pub holes: u64,
    /// Those that were filled.
    pub filled: u64,
}

impl FillNumbers {
    /// Of a filled volume.
    pub fn of(filled: &Filled<'_>) -> Self {
        let (FillWork { bricks_considered, bricks_touched, holes, filled: count }, how) =
            (filled.work(), filled.filling());
        let (law, radius_mm) = (how.law.name(), how.radius_mm);
        Self { law, radius_mm, bricks_considered, bricks_touched, holes, filled: count }
    }
}

/// The numbers of a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Statistics {
    /// What became of the frames, and what was repaired or left out.
    #[serde(flatten)]
    pub ledger: Ledger,
    /// Time for slices to enter the volume: in-plane filtering included, file reading excluded.
    pub insert_ms: Option<Milliseconds>,
    /// Time from the command's begin to the last file written, s.
    pub wall_s: f64,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// The path that slices went: `general`, `planar`, or `planar, then general`.
    pub path: String,
    /// Why that path, and if it was left, why.
    pub path_reason: String,
    /// Blocks of 8³ voxels that are held.
    pub bricks: u64,
    /// Memory of the volume, bytes.
    pub bytes: u64,
    /// Threads that filtered and wove.
    pub threads: usize,
    /// Instruction set.
    pub simd: &'static str,
    /// Where the volume lies.
    pub grid: GridNumbers,
    /// Frame in which it lives.
    pub world: String,
    /// Transforms from the image to that frame.
    pub route: String,
    /// Holes that were filled in the files, if that was asked for.
    pub fill: Option<FillNumbers>,
    /// Scalar type of the file, if one was written.
    pub scalar: Option<&'static str>,
    /// The kernel's kind.
    pub method: &'static str,
    /// How slices that reach the same voxel make its value.
    pub compounding: &'static str,
    /// How the past fades, if it does.
    pub decay: Option<DecayNumbers>,
    /// Slices whose time was earlier than the newest before them: they count as of that time.
    pub times_backwards: u64,
    /// Slices whose time lay a day after the newest before them, or ten seconds before it: a clock was set.
    pub times_absurd: u64,
    /// Nominal σ along u, v, n, mm.
    pub sigma_mm: [f64; 3],
    /// σ of the kernel as cut and lowered, mm.
    pub sigma_effective_mm: [f64; 3],
    /// Half width of its support, mm.
    pub support_mm: [f64; 3],
    /// Pixel size along u and v, mm.
    pub pixel_mm: [f64; 2],
    /// Pixels from node to node of the filtered picture, along u and v.
    pub decimation: [f64; 2],
    /// How far its samples may be from the exact in-plane sum, as a fraction of the picture's range.
    pub decimation_deviation: f64,
    /// Pixels of the picture that are data.
    pub data_pixels: u64,
    /// The smallest rectangle around them: x, y, width, height.
    pub data_rectangle: Option<[u32; 4]>,
    /// Voxels whose weight was clamped, summed over slices.
    pub w_clamped: u64,
    /// Work counters.
    pub work: WorkNumbers,
    /// What the user should know: sentences.
    pub notes: Vec<String>,
}

impl Statistics {
    /// Of a finished run.
    pub fn new(outcome: &Outcome, space: &DenseBox, scalar: Option<&'static str>, wall: Duration) -> Self {
        let reconstructor = &outcome.reconstructor;
        let (settings, work) = (reconstructor.settings(), reconstructor.work());
        let kernels = reconstructor.kernels();
        let per_axis =
            |f: fn(&crate::reconstruct::kernel::AxisKernel) -> f64| kernels.map_or([0.0; 3], |k| k.each_ref().map(f));
        let grid = &space.grid;
        let chosen = &outcome.chosen;
        let (path, path_reason) = match reconstructor.upgraded() {
            None => (chosen.path.name().to_owned(), chosen.why.clone()),
            Some(departure) => {
                let ways = format!("{}, then {}", chosen.path.name(), reconstructor.path().name());
                (ways, format!("{}; {departure}", chosen.why))
            }
        };
        let (decimation, decimation_deviation) = reconstructor.decimation().unwrap_or_default();
        Self {
            ledger: outcome.ledger.clone(),
            insert_ms: Milliseconds::of(&outcome.insert_ms),
            wall_s: wall.as_secs_f64(),
            voxels_updated: outcome.voxels_updated,
            path,
            path_reason,
            bricks: reconstructor.volume().blocks().count() as u64,
            bytes: reconstructor.volume().bytes(),
            threads: settings.threads,
            simd: settings.simd.name(),
            grid: GridNumbers {
                origin: grid.origin.to_array(),
                size: grid.size,
                spacing: grid.spacing.to_array(),
                direction: [grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis].map(|a| a.to_array()),
            },
            world: outcome.world.clone(),
            route: outcome.route.clone(),
            fill: None,
            scalar,
            method: settings.method.name(),
            compounding: settings.compounding.name(),
            decay: DecayNumbers::of(settings.compounding),
            times_backwards: work.times_backwards,
            times_absurd: work.times_absurd,
            sigma_mm: per_axis(|k| k.sigma_mm),
            sigma_effective_mm: per_axis(|k| k.sigma_effective_mm()),
            support_mm: per_axis(|k| k.support_mm),
            pixel_mm: reconstructor.pixel_mm().unwrap_or_default(),
            decimation,
            decimation_deviation,
            data_pixels: outcome.mask.area(),
            data_rectangle: outcome.mask.bounds().map(|r| [r.x, r.y, r.width, r.height]),
            w_clamped: work.weights_clamped,
            work: WorkNumbers {
                pixels_filtered: work.filter.pixels,
                nodes: work.filter.nodes,
                taps: work.filter.taps,
                bricks_considered: work.bricks_considered,
                columns_considered: work.columns_considered,
                columns_touched: work.columns_touched,
                bricks_touched: work.bricks_touched,
                voxels_sampled: work.voxels_sampled,
            },
            notes: outcome.notes.clone(),
        }
    }

    /// Writes the numbers as JSON, with the input, the effective settings, and what rendering on the side did; whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path, source: &Source, picture: Option<&impl Serialize>) -> Result<(), std::io::Error> {
        #[derive(Serialize)]
        struct File<'a, P: Serialize> {
            version: &'static str,
            input: &'a Path,
            input_sha256: &'a str,
            #[serde(flatten)]
            statistics: &'a Statistics,
            frame_range: Option<[u64; 2]>,
            mask: &'a MaskSettings,
            config: &'a Config,
            #[serde(flatten)]
            picture: Option<&'a P>,
        }
        let file = File {
            version: env!("CARGO_PKG_VERSION"),
            input: source.input,
            input_sha256: source.sha256,
            statistics: self,
            frame_range: source.frames,
            mask: source.mask,
            config: source.config,
            picture,
        };
        write_json(path, &file)
    }
}

/// What a run was given.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The recording.
    pub input: &'a Path,
    /// Its hash.
    pub sha256: &'a str,
    /// Frames asked for, if not all.
    pub frames: Option<[u64; 2]>,
    /// What of the picture was to be data.
    pub mask: &'a MaskSettings,
    /// Calibration and volume settings.
    pub config: &'a Config,
}

/// Writes numbers as JSON, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_json(path: &Path, numbers: &impl Serialize) -> Result<(), std::io::Error> {
    write_whole(path, |to| {
        serde_json::to_writer_pretty(&mut *to, numbers)?;
        to.write_all(b"\n")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_samples_at_their_rank() {
        let samples: Vec<f64> = (1..=200).rev().map(f64::from).collect();
        let ms = Milliseconds::of(&samples).unwrap();
        assert_eq!([ms.median, ms.p95, ms.p99, ms.max, ms.total], [100.0, 190.0, 198.0, 200.0, 20100.0]);
        let one = Milliseconds::of(&[3.0]).unwrap();
        assert_eq!([one.median, one.p99], [3.0, 3.0]);
        assert_eq!(Milliseconds::of(&[]), None);
    }
}

//! Numbers of a run: the content of `--json`, and of a session's status while it runs.

mod live;
mod picture;
mod process;
mod work;

use std::path::Path;
use std::time::Duration;

use serde::Serialize;

pub use live::{IgtlNumbers, LiveStatistics};
pub use picture::{PartNumbers, PictureNumbers, PictureStatistics};
pub use process::ProcessNumbers;
pub use work::{RegionNumbers, RegionWork, WorkNumbers};

use config::Settings as Config;
use export::fill::{FillWork, Filled};
use export::volume::DenseBox;
use formats::whole::write_whole;
use mask::{MaskFound, MaskSettings};
use pipeline::{Outcome, SmoothingStatus};
use reconstruct::Compounding;
use reconstruct::ShadowWeights;
use reconstruct::first_moment::Correction;
use sonoweave_core::ledger::Ledger;

/// Distribution of the slices' insertion times, ms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Milliseconds {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
    /// Sum.
    pub total: f64,
}

impl Milliseconds {
    /// Returns the distribution; `None` without samples. Quantiles are samples (the nearest
    /// rank).
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

/// Geometry of the written volume.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GridNumbers {
    /// World position of the centre of voxel (0, 0, 0), mm.
    pub origin: [f64; 3],
    /// Voxels along x, y, z.
    pub size: [u64; 3],
    /// Voxel spacing, mm.
    pub spacing: [f64; 3],
    /// Direction of each index axis in the world.
    pub direction: [[f64; 3]; 3],
}

/// A decay rule.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DecayNumbers {
    /// Its form.
    pub mode: &'static str,
    /// Decay rate of old data, 1/s.
    pub rate_per_s: f64,
    /// Time before the decay begins, s.
    pub wait_s: f64,
}

impl DecayNumbers {
    fn of(compounding: Compounding) -> Option<Self> {
        let Compounding::Decay(decay) = compounding else { return None };
        Some(Self { mode: decay.name(), rate_per_s: decay.rate_per_s(), wait_s: decay.wait_s() })
    }
}

/// Holes filled in the written volume.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FillNumbers {
    /// Filling method.
    pub law: &'static str,
    /// Filling radius, mm.
    pub radius_mm: f64,
    /// Bricks of 8³ voxels of the box that seen voxels may reach.
    pub bricks_considered: u64,
    /// Those of them that were processed.
    pub bricks_touched: u64,
    /// Unseen voxels in the latter.
    pub holes: u64,
    /// Voxels that were filled.
    pub filled: u64,
}

impl FillNumbers {
    /// Returns the numbers of a filled volume.
    pub fn of(filled: &Filled<'_>) -> Self {
        let (FillWork { bricks_considered, bricks_touched, holes, filled: count }, how) =
            (filled.work(), filled.filling());
        let (law, radius_mm) = (how.method.name(), how.radius_mm);
        Self { law, radius_mm, bricks_considered, bricks_touched, holes, filled: count }
    }
}

/// Weights of pixels by their shadows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShadowNumbers {
    /// Their settings.
    #[serde(flatten)]
    pub settings: ShadowWeights,
    /// Slices whose picture is dark in most places or at the end of all beams, so that it tells
    /// nothing of shadows: all its pixels count in full.
    pub dark_slices: u64,
}

/// First-moment correction of the written values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MomentNumbers {
    /// Mean distance of the slices from their voxel, mm: the median over the seen voxels.
    pub distance_mm: f64,
    /// Change of the value, up or down, grey levels: the median.
    pub change: f64,
    /// Its 95th percentile, grey levels.
    pub change_p95: f64,
}

impl MomentNumbers {
    /// Returns the numbers of a corrected volume.
    pub fn of(correction: &Correction) -> Self {
        let Correction { distance_mm, change, change_p95 } = *correction;
        Self { distance_mm, change, change_p95 }
    }
}

/// Standard errors of a volume's voxels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorNumbers {
    /// Standard deviation of one slice's filtered values by noise, grey levels.
    pub noise: f64,
    /// Error of places by the noise of poses that is included, mm; `None` if it is unknown.
    pub pose_mm: Option<f64>,
    /// Median over the seen voxels, grey levels.
    pub median: f64,
    /// 95th percentile, grey levels.
    pub p95: f64,
    /// Median of the effective number of slices that reach a voxel.
    pub slices: f64,
}

/// The numbers of a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Statistics {
    /// The frame ledger, with repaired and skipped frames.
    #[serde(flatten)]
    pub ledger: Ledger,
    /// Insertion time of the slices, including in-plane filtering, excluding file reading.
    pub insert_ms: Option<Milliseconds>,
    /// Time from the command's start to the last file written, s.
    pub wall_s: f64,
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// The insertion path: `general`, `planar`, or `planar, then general`.
    pub path: String,
    /// Reason for the path, and for leaving it.
    pub path_reason: String,
    /// Stored blocks of 8³ voxels.
    pub bricks: u64,
    /// Memory of the volume, bytes; of its largest region if it was reconstructed in regions.
    pub bytes: u64,
    /// Threads that filtered and inserted.
    pub threads: usize,
    /// Instruction set.
    pub simd: &'static str,
    /// Geometry of the volume.
    pub grid: GridNumbers,
    /// Frame in which it lies.
    pub world: String,
    /// Transforms from the image to that frame.
    pub route: String,
    /// Frames by the smoothing of their poses; `None` if they are used as recorded.
    pub smoothing: Option<SmoothingStatus>,
    /// First-moment correction of the files, if requested.
    pub first_moment: Option<MomentNumbers>,
    /// Holes that were filled in the files, if requested.
    pub fill: Option<FillNumbers>,
    /// Standard errors, if they were written.
    pub standard_error: Option<ErrorNumbers>,
    /// Scalar type of the file, if one was written.
    pub scalar: Option<&'static str>,
    /// The kernel's kind.
    pub method: &'static str,
    /// Rule that combines the values of several slices in a voxel.
    pub compounding: &'static str,
    /// Whether slices are weighted by the gaps beside them.
    pub gap_weights: bool,
    /// Weights of pixels by their shadows, if they count.
    pub shadow_weights: Option<ShadowNumbers>,
    /// Decay of old data, if any.
    pub decay: Option<DecayNumbers>,
    /// Slices whose time was earlier than the newest before them: they get that time.
    pub times_backwards: u64,
    /// Slices whose time was a day later than the newest before them, or ten seconds earlier: a
    /// clock was set.
    pub times_absurd: u64,
    /// Nominal σ along u, v, n, mm.
    pub sigma_mm: [f64; 3],
    /// σ of the kernel after truncation and subtraction of its pedestal, mm.
    pub sigma_effective_mm: [f64; 3],
    /// Half width of its support, mm.
    pub support_mm: [f64; 3],
    /// Pixel size along u and v, mm.
    pub pixel_mm: [f64; 2],
    /// Pixels between nodes of the filtered image, along u and v.
    pub decimation: [f64; 2],
    /// Bound on the deviation of its samples from the exact in-plane sum, as a fraction of the
    /// image's range.
    pub decimation_deviation: f64,
    /// Data pixels of the frame.
    pub data_pixels: u64,
    /// Their bounding rectangle: x, y, width, height.
    pub data_rectangle: Option<[u32; 4]>,
    /// Their shape, and how certain it is.
    pub mask_found: MaskFound,
    /// Voxels whose weight was clamped, summed over slices.
    pub w_clamped: u64,
    /// Work counters. Those of regions are summed.
    pub work: WorkNumbers,
    /// The regions, if the volume was reconstructed in such.
    pub regions: Option<RegionNumbers>,
    /// Notes for the user, as sentences.
    pub notes: Vec<String>,
}

impl Statistics {
    /// Returns the numbers of a finished run.
    pub fn new(outcome: &Outcome, space: &DenseBox, scalar: Option<&'static str>, wall: Duration) -> Self {
        let reconstructor = &outcome.reconstructor;
        let (settings, work) = (reconstructor.settings(), reconstructor.work());
        let kernels = reconstructor.kernels();
        let per_axis =
            |f: fn(&reconstruct::kernel::AxisKernel) -> f64| kernels.map_or([0.0; 3], |k| k.each_ref().map(f));
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
            smoothing: outcome.smoothing.clone(),
            first_moment: None,
            fill: None,
            standard_error: None,
            scalar,
            method: settings.method.name(),
            compounding: settings.compounding.name(),
            gap_weights: settings.gap_weights,
            shadow_weights: settings
                .shadow_weights
                .map(|settings| ShadowNumbers { settings, dark_slices: work.without_shadows }),
            decay: DecayNumbers::of(settings.compounding),
            times_backwards: work.times_backwards,
            times_absurd: work.times_absurd,
            sigma_mm: per_axis(|k| k.sigma_mm),
            sigma_effective_mm: per_axis(|k| k.sigma_effective_mm()),
            support_mm: per_axis(|k| k.support_mm),
            pixel_mm: reconstructor.pixel_mm().unwrap_or_default(),
            decimation,
            decimation_deviation,
            data_pixels: outcome.mask.mask.area(),
            data_rectangle: outcome.mask.mask.bounds().map(|r| [r.x, r.y, r.width, r.height]),
            mask_found: outcome.mask.clone(),
            w_clamped: work.weights_clamped,
            work: WorkNumbers::of(&work),
            regions: None,
            notes: outcome.notes.clone(),
        }
    }

    /// Enters the work of a reconstruction in regions.
    pub fn enter_regions(&mut self, numbers: RegionNumbers, work: RegionWork) {
        let RegionWork { voxels_updated, w_clamped, bricks, bytes, work } = work;
        (self.voxels_updated, self.w_clamped) = (voxels_updated, w_clamped);
        (self.bricks, self.bytes, self.work) = (bricks, bytes, work);
        self.regions = Some(numbers);
    }

    /// Returns the report of a reconstruction: the numbers with the input, the effective
    /// settings, and the numbers of a rendered picture.
    pub fn report<'a>(&'a self, source: &'a Source<'_>, picture: Option<&'a impl Serialize>) -> impl Serialize + 'a {
        #[derive(Serialize)]
        struct Report<'a, P: Serialize> {
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
        Report {
            version: env!("CARGO_PKG_VERSION"),
            input: source.input,
            input_sha256: source.sha256,
            statistics: self,
            frame_range: source.frames,
            mask: source.mask,
            config: source.config,
            picture,
        }
    }
}

/// Inputs of a run.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The recording.
    pub input: &'a Path,
    /// Its hash.
    pub sha256: &'a str,
    /// Requested frames, if not all.
    pub frames: Option<[u64; 2]>,
    /// Settings of the frame's data region.
    pub mask: &'a MaskSettings,
    /// Calibration and volume settings.
    pub config: &'a Config,
}

/// Writes numbers as JSON; writes the whole file or none.
///
/// # Errors
/// If the file cannot be written.
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

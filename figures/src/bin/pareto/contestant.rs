//! Who takes part: a path, its kernel at the default's effective width, a voxel size, a number of threads.

use std::error::Error;
use std::time::Instant;

use glam::DVec3;
use sonoweave::mask::Mask;
use sonoweave::reconstruct::kernel::{AxisKernel, Method, Support};
use sonoweave::reconstruct::reference::Reference;
use sonoweave::reconstruct::settings::{IN_PLANE_SIGMA, IN_PLANE_SUPPORT, OFF_PLANE_SIGMA_MM, OFF_PLANE_SUPPORT};
use sonoweave::reconstruct::{Reconstructor, Settings};
use sonoweave::slice::Slice;
use sonoweave::sync::FramePose;
use sonoweave::sync::survey::gap;
use sonoweave::volume::Grid;

use crate::baselines::{Drop, Splat};
use crate::field::Field;
use crate::timing::each;

/// Voxels of the default configuration.
pub(crate) const DEFAULT_VOXEL_MM: f64 = 0.5;
/// Voxels by the smallest nominal σ of the default configuration, the one in the plane.
pub(crate) const VOXELS: [f64; 4] = [0.5, 0.75, 1.0, 1.5];
/// Energies outside the support.
pub(crate) const ENERGIES: [f64; 5] = [0.1, 0.05, 0.01, 0.001, 1e-4];
/// No plane of pixels meets a plane of voxels: a favour that no hand does.
pub(crate) const LATTICE_ORIGIN_MM: DVec3 = DVec3::new(0.057, 0.083, 0.041);
/// Trilinear weights are exact to 1e-7: voxels with less weight than this would show little else.
const LEAST_DROPPED: f32 = 1e-3;

/// How slices become a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Path {
    /// The reconstructor for 6 degrees of freedom, with a kernel's kind and the energy outside its support (`None`: the defaults of each axis).
    General(Method, Option<f64>),
    /// The same with its defaults, but σ across the plane half the widest gap, as `--sigma auto` takes it: another width, the scan's own.
    AutoSigma,
    /// The default kernel's equations in f64, voxel by voxel and pixel by pixel.
    BruteForce,
    /// Each pixel dropped into voxels; holes filled when all are in, if any.
    Splat(Drop),
}

/// How far a contestant's effective width is the default's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Match {
    /// On each axis.
    Whole,
    /// Across the plane only: in it the kernel is the pixels'.
    AcrossPlane,
    /// In the plane only.
    InPlane,
    /// On none: the width is the voxels'.
    None,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contestant {
    pub(crate) path: Path,
    pub(crate) voxel_mm: f64,
    pub(crate) threads: usize,
}

/// What a contestant is given.
pub(crate) struct Input<'a> {
    pub(crate) slices: &'a [Slice],
    pub(crate) mask: &'a Mask,
    pub(crate) pixel_mm: [f64; 2],
    /// Effective σ of u, v and the normal that all are to have, mm.
    pub(crate) effective_mm: [f64; 3],
    /// The default's σ across the plane, mm; `None` for the default of the default.
    pub(crate) sigma_n_mm: Option<f64>,
    /// 90 % of neighbouring slices are no farther apart, mm: holes are filled over as much, and `--sigma auto` takes half of it.
    pub(crate) gap_mm: f64,
    /// A grid that holds all slices, by spacing in mm.
    pub(crate) grid: &'a dyn Fn(f64) -> Result<Grid, Box<dyn Error>>,
}

/// What a run leaves.
pub(crate) enum Woven {
    Bricks(Box<Reconstructor>),
    Exact(Reference),
    Dense(Field),
}

impl Contestant {
    pub(crate) fn new(path: Path, voxel_mm: f64) -> Self {
        Self { path, voxel_mm, threads: 1 }
    }

    /// What `sonoweave` does when nothing is asked for.
    pub(crate) fn default_configuration() -> Self {
        Self::new(Path::General(Method::default(), None), DEFAULT_VOXEL_MM)
    }

    pub(crate) fn on_threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    /// The default kernel on default voxels, on however many threads.
    pub(crate) fn is_default(&self) -> bool {
        self.on_threads(1) == Self::default_configuration()
    }

    /// Voxel spacing in the default's in-plane σ.
    pub(crate) fn voxel_sigmas(&self) -> f64 {
        self.voxel_mm / (IN_PLANE_SIGMA * DEFAULT_VOXEL_MM)
    }

    /// What it does, without voxel and threads.
    pub(crate) fn method(&self) -> String {
        match self.path {
            Path::General(method, None) => method.name().to_owned(),
            Path::General(method, Some(energy)) => format!("{} E_e {energy}", method.name()),
            Path::AutoSigma => format!("{}, auto σ", Method::default().name()),
            Path::BruteForce => "brute force, f64".into(),
            Path::Splat(Drop::Trilinear) => "trilinear + holes".into(),
            Path::Splat(Drop::Nearest | Drop::NearestInBytes) => "nearest voxel + holes".into(),
        }
    }

    pub(crate) fn name(&self) -> String {
        let threads = if self.threads == 1 { String::new() } else { format!(", {} threads", self.threads) };
        format!("{}, {} mm{threads}", self.method(), crate::report::digits(self.voxel_mm, 3))
    }

    pub(crate) fn matching(&self) -> Match {
        match self.path {
            Path::General(method, _) if method.interpolates() => Match::AcrossPlane,
            Path::General(..) | Path::BruteForce => Match::Whole,
            Path::AutoSigma => Match::InPlane,
            Path::Splat(_) => Match::None,
        }
    }

    /// Settings of the general path; `None` for other paths.
    ///
    /// # Errors
    /// When no σ gives the width.
    pub(crate) fn settings(&self, input: &Input<'_>) -> Result<Option<Settings>, Box<dyn Error>> {
        let (method, energy) = match self.path {
            Path::General(method, energy) => (method, energy),
            Path::AutoSigma => (Method::default(), None),
            Path::BruteForce | Path::Splat(_) => return Ok(None),
        };
        let mut settings = Settings {
            method,
            support: energy.map(Support::Energy),
            threads: self.threads,
            lattice_origin_mm: LATTICE_ORIGIN_MM,
            ..Settings::new(DVec3::splat(self.voxel_mm))
        };
        if self.is_default() {
            settings.sigma_mm[2] = input.sigma_n_mm;
            return Ok(Some(settings));
        }
        for axis in 0..3 {
            if axis == 2 || !method.interpolates() {
                settings.sigma_mm[axis] = Some(matched_sigma(method, energy, axis, input.effective_mm[axis])?);
            }
        }
        if self.path == Path::AutoSigma {
            settings.sigma_mm[2] = Some(0.5 * input.gap_mm);
        }
        Ok(Some(settings))
    }

    /// Weaves all slices: milliseconds an insert, and the result. What follows the last insert is spread over all.
    ///
    /// # Errors
    /// When a slice is refused.
    pub(crate) fn weave(&self, input: &Input<'_>) -> Result<(Vec<f64>, Woven), Box<dyn Error>> {
        let Input { slices, mask, .. } = *input;
        match self.path {
            Path::General(..) | Path::AutoSigma => {
                let settings = self.settings(input)?.ok_or("the general path has settings")?;
                let mut reconstructor = Reconstructor::new(settings, mask.clone())?;
                let times = each(slices, |slice| reconstructor.insert(slice).map(drop))?;
                Ok((times, Woven::Bricks(Box::new(reconstructor))))
            }
            Path::BruteForce => {
                let kernels = default_kernels_across(input.pixel_mm, input.sigma_n_mm)?;
                let mut reference = Reference::new((input.grid)(self.voxel_mm)?);
                let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build()?;
                let times = pool.install(|| {
                    let timed = slices.iter().map(|slice| {
                        let start = Instant::now();
                        reference.insert(slice, mask, &kernels);
                        start.elapsed().as_secs_f64() * 1e3
                    });
                    timed.collect()
                });
                Ok((times, Woven::Exact(reference)))
            }
            Path::Splat(how) => {
                let grid = (input.grid)(self.voxel_mm)?;
                let mut splat = Splat::new(how, &grid)?;
                let mut times = each(slices, |slice| splat.insert(slice, mask))?;
                let start = Instant::now();
                let mut field = Field::of_splat(&splat, grid, LEAST_DROPPED);
                field.fill_holes((0.5 * input.gap_mm / self.voxel_mm).ceil() as usize + 1);
                let filling = start.elapsed().as_secs_f64() * 1e3 / slices.len() as f64;
                times.iter_mut().for_each(|ms| *ms += filling);
                Ok((times, Woven::Dense(field)))
            }
        }
    }

    /// The result to be read between its voxels.
    ///
    /// # Errors
    /// When no grid holds the slices.
    pub(crate) fn field(&self, input: &Input<'_>, woven: Woven) -> Result<Field, Box<dyn Error>> {
        Ok(match woven {
            Woven::Bricks(reconstructor) => Field::of_bricks(&reconstructor, (input.grid)(self.voxel_mm)?),
            Woven::Exact(reference) => Field::of_reference(&reference),
            Woven::Dense(field) => field,
        })
    }
}

/// A grid of the lattice through the world's origin, moved to where all contestants' voxels lie.
pub(crate) fn on_lattice(grid: Grid) -> Grid {
    Grid { origin: grid.origin + LATTICE_ORIGIN_MM, ..grid }
}

/// 90 % of neighbouring slices are no farther apart, mm.
///
/// # Errors
/// When there are no two slices.
pub(crate) fn widest_gap(slices: &[Slice]) -> Result<f64, Box<dyn Error>> {
    let pose = |(slice, item): (&Slice, u32)| FramePose {
        item: item.into(),
        time_ns: slice.time_ns,
        size: [slice.image.width(), slice.image.height()],
        world_from_image: slice.world_from_image,
    };
    let poses: Vec<FramePose> = slices.iter().zip(0..).map(pose).collect();
    Ok(gap(&poses).ok_or("the slices have no gap")?)
}

/// The kernels of the default configuration.
///
/// # Errors
/// When the pixels have no size.
pub(crate) fn default_kernels(pixel_mm: [f64; 2]) -> Result<[AxisKernel; 3], Box<dyn Error>> {
    default_kernels_across(pixel_mm, None)
}

/// The same with another σ across the plane.
///
/// # Errors
/// As [`default_kernels`], and when σ is not positive.
pub(crate) fn default_kernels_across(
    pixel_mm: [f64; 2],
    sigma_n_mm: Option<f64>,
) -> Result<[AxisKernel; 3], Box<dyn Error>> {
    let method = Method::default();
    let in_plane =
        |axis: usize| AxisKernel::new(method, IN_PLANE_SIGMA * DEFAULT_VOXEL_MM.max(pixel_mm[axis]), IN_PLANE_SUPPORT);
    let across = AxisKernel::new(method, sigma_n_mm.unwrap_or(OFF_PLANE_SIGMA_MM), OFF_PLANE_SUPPORT)?;
    Ok([in_plane(0)?, in_plane(1)?, across])
}

/// The nominal σ at which a kernel's effective width is `effective_mm`: the two are proportional where the support is a share of energy.
///
/// # Errors
/// When the support is no share.
pub(crate) fn matched_sigma(
    method: Method,
    energy: Option<f64>,
    axis: usize,
    effective_mm: f64,
) -> Result<f64, Box<dyn Error>> {
    let usual = if axis == 2 { OFF_PLANE_SUPPORT } else { IN_PLANE_SUPPORT };
    let kernel = AxisKernel::new(method, 1.0, energy.map_or(usual, Support::Energy))?;
    Ok(effective_mm / kernel.sigma_effective_mm())
}

/// The few that every scan is given.
pub(crate) fn short_list() -> Vec<Contestant> {
    use Method::{BSpline3, Gaussian, GaussianTruncated, Linear, Nearest};
    let ours = Contestant::default_configuration();
    let kernel = |method, energy| Contestant::new(Path::General(method, energy), DEFAULT_VOXEL_MM);
    let mut list = vec![ours, ours.on_threads(2)];
    list.extend([0.1, 0.05, 0.001].map(|energy| kernel(Gaussian, Some(energy))));
    list.extend([GaussianTruncated, BSpline3, Linear, Nearest].map(|method| kernel(method, None)));
    list.push(Contestant { path: Path::AutoSigma, ..ours });
    list.extend([VOXELS[1], VOXELS[3]].map(|v| Contestant { voxel_mm: by_sigma(v), ..ours }));
    list.extend([Drop::Nearest, Drop::Trilinear].map(|drop| Contestant::new(Path::Splat(drop), DEFAULT_VOXEL_MM)));
    list
}

/// Every kernel with every support and every voxel, the splats with every voxel, and two threads with every kernel.
pub(crate) fn full_list() -> Vec<Contestant> {
    let voxels: Vec<f64> = VOXELS.map(by_sigma).into_iter().chain([DEFAULT_VOXEL_MM]).collect();
    let ours = Contestant::default_configuration();
    let mut list = vec![ours, Contestant { path: Path::AutoSigma, ..ours }];
    let mut add = |contestant: Contestant| {
        if !list.contains(&contestant) {
            list.push(contestant);
        }
    };
    for voxel_mm in voxels {
        for method in Method::ALL {
            let energies = if method.takes_support() { &ENERGIES[..] } else { &[] };
            let supports = std::iter::once(None).chain(energies.iter().copied().map(Some));
            supports.for_each(|energy| add(Contestant::new(Path::General(method, energy), voxel_mm)));
        }
        for drop in [Drop::Nearest, Drop::Trilinear] {
            add(Contestant::new(Path::Splat(drop), voxel_mm));
        }
    }
    for method in Method::ALL {
        add(Contestant::new(Path::General(method, None), DEFAULT_VOXEL_MM).on_threads(2));
    }
    list
}

fn by_sigma(sigmas: f64) -> f64 {
    sigmas * IN_PLANE_SIGMA * DEFAULT_VOXEL_MM
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_that_can_has_the_defaults_effective_width() {
        let target = default_kernels([0.2; 2]).unwrap().map(|k| k.sigma_effective_mm());
        for contestant in full_list() {
            let Path::General(method, energy) = contestant.path else { continue };
            for (axis, target) in target.into_iter().enumerate() {
                let sigma = matched_sigma(method, energy, axis, target).unwrap();
                let usual = if axis == 2 { OFF_PLANE_SUPPORT } else { IN_PLANE_SUPPORT };
                let kernel = AxisKernel::new(method, sigma, energy.map_or(usual, Support::Energy)).unwrap();
                assert!((kernel.sigma_effective_mm() / target - 1.0).abs() < 1e-12, "{contestant:?} {axis}");
            }
        }
    }

    #[test]
    fn lists_begin_with_the_default_and_name_nobody_twice() {
        for list in [short_list(), full_list()] {
            assert_eq!(list[0], Contestant::default_configuration());
            let mut names: Vec<String> = list.iter().map(Contestant::name).collect();
            let all = names.len();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), all);
        }
        assert_eq!(full_list().iter().filter(|c| c.voxel_mm == DEFAULT_VOXEL_MM && c.threads == 1).count(), 23);
    }
}

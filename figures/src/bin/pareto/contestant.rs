//! Contestants: an insertion path, its kernel at the default's effective width, a voxel size,
//! and a number of threads.

use std::error::Error;
use std::time::Instant;

use glam::DVec3;

use calibration::tracker::noise::TrackerNoise;
use mask::Mask;
use reconstruct::kernel::{AxisKernel, Method, Support};
use reconstruct::planar::{OnDeparture, PlanarReconstructor, PlanarSettings};
use reconstruct::reference::Reference;
use reconstruct::settings::{IN_PLANE_SIGMA, IN_PLANE_SUPPORT, OFF_PLANE_SUPPORT};
use reconstruct::{PathReconstructor, Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use volume::Grid;

use crate::baselines::{Drop, Splat};
use crate::correction::Correction;
use crate::field::Field;
use crate::timing::each;

/// Voxel spacing of the default configuration.
pub(crate) const DEFAULT_VOXEL_MM: f64 = 0.5;
/// Voxel spacings relative to the smallest nominal σ of the default configuration, the one in
/// the plane.
pub(crate) const VOXELS: [f64; 4] = [0.5, 0.75, 1.0, 1.5];
/// Energies outside the support across the plane, besides the default's.
pub(crate) const ACROSS: [f64; 6] = [0.1, 0.05, 0.02, 0.005, 0.001, 1e-4];
/// The same in the plane.
pub(crate) const IN_PLANE: [f64; 2] = [0.01, 1e-4];
/// No plane of pixels coincides with a plane of voxels, which would favour a method and never
/// happens freehand.
pub(crate) const LATTICE_ORIGIN_MM: DVec3 = DVec3::new(0.057, 0.083, 0.041);
/// Trilinear weights are exact to 1e-7: the value of voxels with less weight than this would be
/// mostly rounding.
const LEAST_DROPPED: f32 = 1e-3;

/// Shares of a Gaussian's energy outside its support, in the plane and across it; `None` for the
/// default's.
pub(crate) type Energies = [Option<f64>; 2];
/// The default's energies.
pub(crate) const USUAL: Energies = [None; 2];
/// The default's energy across the plane.
pub(crate) const USUAL_ACROSS: f64 = match OFF_PLANE_SUPPORT {
    Support::Energy(energy) => energy,
    _ => panic!("the default ends by its share of energy"),
};

/// Method of reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Path {
    /// The reconstructor with a kind of kernel and the energies outside its support.
    Kernel(Method, Energies),
    /// The same with its defaults, but σ across the plane is half the widest gap, like `--sigma
    /// auto`: another width, the scan's own.
    AutoSigma,
    /// A kernel with its default ends, and the first moment of all values corrected.
    FirstMoment(Method),
    /// The default kernel, over corrected poses.
    Corrected(Correction),
    /// The default kernel's equations in f64, voxel by voxel and pixel by pixel.
    BruteForce,
    /// Each pixel is dropped into voxels; afterwards holes are filled, if any.
    Splat(Drop),
}

/// Axes on which a contestant's effective width equals the default's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Match {
    /// All axes.
    Whole,
    /// Across the plane only: in it the kernel is the pixels', or has no variance.
    AcrossPlane,
    /// In the plane only.
    InPlane,
    /// None: the voxels determine the width.
    None,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Contestant {
    pub(crate) path: Path,
    pub(crate) voxel_mm: f64,
    pub(crate) threads: usize,
    /// Whether the reconstructor is the one for scans that stay perpendicular to a plane.
    planar: bool,
    /// Whether it is the choice of `sonoweave` for the scan without options.
    default: bool,
}

/// Inputs of a contestant.
pub(crate) struct Input<'a> {
    pub(crate) slices: &'a [Slice],
    pub(crate) mask: &'a Mask,
    pub(crate) pixel_mm: [f64; 2],
    /// Effective σ of u, v and the normal for all contestants, mm.
    pub(crate) effective_mm: [f64; 3],
    /// The default's σ across the plane, mm; `None` for the default of the default.
    pub(crate) sigma_n_mm: Option<f64>,
    /// 90th percentile of the gaps between neighbouring slices, mm. Holes are filled over this
    /// distance, and `--sigma auto` takes half of it.
    pub(crate) gap_mm: f64,
    /// Noise of the tracker.
    pub(crate) noise: TrackerNoise,
    /// Returns a grid that contains all slices, for a spacing in mm.
    pub(crate) grid: &'a dyn Fn(f64) -> Result<Grid, Box<dyn Error>>,
}

/// Result of a run.
pub(crate) enum Reconstructed {
    Bricks(Box<Reconstructor>),
    Columns(Box<PlanarReconstructor>),
    Exact(Reference),
    Dense(Field),
}

impl Contestant {
    pub(crate) fn new(path: Path, voxel_mm: f64) -> Self {
        Self { path, voxel_mm, threads: 1, planar: false, default: false }
    }

    /// Returns the choice of `sonoweave` without options: planar scans use the planar path.
    pub(crate) fn default_configuration(planar: bool) -> Self {
        Self { planar, default: true, ..Self::new(Path::Kernel(Method::default(), USUAL), DEFAULT_VOXEL_MM) }
    }

    pub(crate) fn on_threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    /// Returns it on the planar path, if its kernel supports it.
    fn planar_if(self, planar: bool) -> Self {
        let can = match self.path {
            Path::Kernel(method, _) => !method.interpolates() && method != Method::Gaussian4,
            Path::AutoSigma => true,
            Path::FirstMoment(_) | Path::Corrected(_) | Path::BruteForce | Path::Splat(_) => false,
        };
        Self { planar: planar && can, ..self }
    }

    /// Returns whether it is the default configuration, on any number of threads.
    pub(crate) fn is_default(&self) -> bool {
        self.default
    }

    /// Returns whether both use the same kernel and voxels, on any path; false for the default.
    pub(crate) fn does_as(&self, other: &Self) -> bool {
        !self.default && self.path == other.path && self.voxel_mm == other.voxel_mm && self.threads == other.threads
    }

    /// Returns whether both use the same path of the reconstructor.
    pub(crate) fn goes_with(&self, other: &Self) -> bool {
        self.planar == other.planar
    }

    /// Returns whether both are equal except for the default flag.
    pub(crate) fn same(&self, other: &Self) -> bool {
        Self { default: false, ..*self } == Self { default: false, ..*other }
    }

    /// Returns the voxel spacing relative to the default's in-plane σ.
    pub(crate) fn voxel_sigmas(&self) -> f64 {
        self.voxel_mm / (IN_PLANE_SIGMA * DEFAULT_VOXEL_MM)
    }

    /// Returns the method's name, without voxel size and threads.
    pub(crate) fn method(&self) -> String {
        let planar = if self.planar { ", planar" } else { "" };
        match self.path {
            Path::Kernel(method, [in_plane, across]) => {
                let ends = [(across, ""), (in_plane, " in the plane")];
                let energies = ends.map(|(e, place)| e.map_or_else(String::new, |e| format!(", E_e {e}{place}")));
                format!("{}{}{planar}", method.name(), energies.concat())
            }
            Path::AutoSigma => format!("{}, auto σ{planar}", Method::default().name()),
            Path::FirstMoment(method) => format!("{}, first moment", method.name()),
            Path::Corrected(correction) => format!("{}, {}", Method::default().name(), correction.name()),
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
            Path::Kernel(Method::Gaussian4, _) | Path::FirstMoment(Method::Gaussian4) => Match::AcrossPlane,
            Path::Kernel(method, _) if method.interpolates() => Match::AcrossPlane,
            Path::Kernel(..) | Path::FirstMoment(_) | Path::Corrected(_) | Path::BruteForce => Match::Whole,
            Path::AutoSigma => Match::InPlane,
            Path::Splat(_) => Match::None,
        }
    }

    /// Returns settings of the reconstructor; `None` for other methods.
    ///
    /// # Errors
    /// If no σ gives the width.
    pub(crate) fn settings(&self, input: &Input<'_>) -> Result<Option<Settings>, Box<dyn Error>> {
        let (method, energies) = match self.path {
            Path::Kernel(method, energies) => (method, energies),
            Path::AutoSigma | Path::Corrected(_) => (Method::default(), USUAL),
            Path::FirstMoment(method) => (method, USUAL),
            Path::BruteForce | Path::Splat(_) => return Ok(None),
        };
        let mut settings = Settings {
            method,
            support: energies.map(|e| e.map(Support::Energy)),
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
                settings.sigma_mm[axis] = Some(matched_sigma(method, energies, axis, input.effective_mm[axis])?);
            }
        }
        if self.path == Path::AutoSigma {
            settings.sigma_mm[2] = Some(0.5 * input.gap_mm);
        }
        Ok(Some(settings))
    }

    /// Inserts all slices; returns milliseconds per insertion, and the result. Time after the
    /// last insertion is spread over all.
    ///
    /// # Errors
    /// If a slice is refused.
    pub(crate) fn reconstruct(&self, input: &Input<'_>) -> Result<(Vec<f64>, Reconstructed), Box<dyn Error>> {
        let Input { slices, mask, .. } = *input;
        match self.path {
            Path::Kernel(..) | Path::AutoSigma => {
                let settings = self.settings(input)?.ok_or("a reconstructor has settings")?;
                if self.planar {
                    let planar = PlanarSettings { on_departure: OnDeparture::Refuse, ..PlanarSettings::default() };
                    let mut reconstructor = PlanarReconstructor::new(settings, planar, mask.clone())?;
                    let times = each(slices, |slice| reconstructor.insert(slice).map(drop))?;
                    return Ok((times, Reconstructed::Columns(Box::new(reconstructor))));
                }
                let mut reconstructor = Reconstructor::new(settings, mask.clone())?;
                let times = each(slices, |slice| reconstructor.insert(slice).map(drop))?;
                Ok((times, Reconstructed::Bricks(Box::new(reconstructor))))
            }
            Path::FirstMoment(_) => {
                let settings = self.settings(input)?.ok_or("a reconstructor has settings")?;
                let mut reconstructor = PathReconstructor::general(settings, mask.clone())?;
                let mut times = each(slices, |slice| reconstructor.insert(slice).map(drop))?;
                let start = Instant::now();
                let corrected = reconstructor.first_moment().ok_or("nothing is corrected")?;
                let field = Field::of_volume(&corrected, reconstructor.world_from_lattice(), reconstructor.settings());
                spread(&mut times, start);
                Ok((times, Reconstructed::Dense(field)))
            }
            Path::Corrected(correction) => {
                let settings = self.settings(input)?.ok_or("a reconstructor has settings")?;
                let start = Instant::now();
                let slices = correction.correct(slices, mask, input.noise)?;
                let correcting = start.elapsed();
                let mut reconstructor = Reconstructor::new(settings, mask.clone())?;
                let mut times = each(&slices, |slice| reconstructor.insert(slice).map(drop))?;
                let ms = correcting.as_secs_f64() * 1e3 / times.len().max(1) as f64;
                times.iter_mut().for_each(|time| *time += ms);
                Ok((times, Reconstructed::Bricks(Box::new(reconstructor))))
            }
            Path::BruteForce => {
                let kernels = default_kernels(input.pixel_mm, input.sigma_n_mm)?;
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
                Ok((times, Reconstructed::Exact(reference)))
            }
            Path::Splat(how) => {
                let grid = (input.grid)(self.voxel_mm)?;
                let mut splat = Splat::new(how, &grid)?;
                let mut times = each(slices, |slice| splat.insert(slice, mask))?;
                let start = Instant::now();
                let mut field = Field::of_splat(&splat, grid, LEAST_DROPPED);
                field.fill_holes((0.5 * input.gap_mm / self.voxel_mm).ceil() as usize + 1);
                spread(&mut times, start);
                Ok((times, Reconstructed::Dense(field)))
            }
        }
    }
}

/// Adds the time since `start` to all insertions.
fn spread(times: &mut [f64], start: Instant) {
    let ms = start.elapsed().as_secs_f64() * 1e3 / times.len() as f64;
    times.iter_mut().for_each(|time| *time += ms);
}

impl Reconstructed {
    /// Returns the result as a field that can be interpolated.
    pub(crate) fn field(self) -> Field {
        match self {
            Self::Bricks(r) => Field::of_volume(r.volume(), r.world_from_lattice(), r.settings()),
            Self::Columns(r) => Field::of_volume(r.volume(), r.world_from_lattice(), r.settings()),
            Self::Exact(reference) => Field::of_reference(&reference),
            Self::Dense(field) => field,
        }
    }
}

/// Returns a grid of the lattice through the world's origin, moved to the common offset of all
/// contestants.
pub(crate) fn on_lattice(grid: Grid) -> Grid {
    Grid { origin: grid.origin + LATTICE_ORIGIN_MM, ..grid }
}

/// Returns the kernels of the default configuration, with another σ across the plane if given.
///
/// # Errors
/// If the pixels have no size, or σ is not positive.
pub(crate) fn default_kernels(pixel_mm: [f64; 2], sigma_n_mm: Option<f64>) -> Result<[AxisKernel; 3], Box<dyn Error>> {
    let settings = Settings { sigma_mm: [None, None, sigma_n_mm], ..Settings::new(DVec3::splat(DEFAULT_VOXEL_MM)) };
    Ok(settings.kernels(pixel_mm)?)
}

/// Returns the nominal σ at which a kernel's effective width is `effective_mm`: the two are
/// proportional if the support is a share of energy. The kernel of fourth order has no such width
/// in the plane: there it gets the Gaussian's σ, at which it lets as much noise through.
///
/// # Errors
/// If the support is not a share of energy.
pub(crate) fn matched_sigma(
    method: Method,
    energies: Energies,
    axis: usize,
    effective_mm: f64,
) -> Result<f64, Box<dyn Error>> {
    let method = if method == Method::Gaussian4 && axis < 2 { Method::Gaussian } else { method };
    Ok(effective_mm / unit_kernel(method, energies, axis)?.sigma_effective_mm())
}

/// Returns a method's kernel along an axis for a nominal σ of 1.
fn unit_kernel(method: Method, [in_plane, across]: Energies, axis: usize) -> Result<AxisKernel, Box<dyn Error>> {
    let support = |energy: Option<f64>, usual| energy.map_or(usual, Support::Energy);
    Ok(match axis {
        2 => AxisKernel::new(method, 1.0, support(across, OFF_PLANE_SUPPORT))?,
        _ => method.in_plane(1.0, support(in_plane, IN_PLANE_SUPPORT), 1.0)?,
    })
}

/// Returns the few contestants for every scan; the default comes first.
pub(crate) fn short_list(planar: bool) -> Vec<Contestant> {
    let ours = Contestant::default_configuration(planar);
    let mut list = with_kernels(DEFAULT_VOXEL_MM);
    list.retain(|c| !matches!(c.path, Path::Kernel(Method::Linear, [_, Some(_)])));
    list.push(Contestant::new(Path::AutoSigma, DEFAULT_VOXEL_MM));
    list.extend([VOXELS[1], VOXELS[3]].map(|v| Contestant::new(Path::Kernel(Method::default(), USUAL), by_sigma(v))));
    list.extend([Drop::Nearest, Drop::Trilinear].map(|drop| Contestant::new(Path::Splat(drop), DEFAULT_VOXEL_MM)));
    with_default(ours, &[ours.on_threads(2)], list)
}

/// Returns every kernel with every support and voxel size, the splats with every voxel size, and
/// two threads with every kernel.
pub(crate) fn full_list(planar: bool) -> Vec<Contestant> {
    let voxels: Vec<f64> = VOXELS.map(by_sigma).into_iter().chain([DEFAULT_VOXEL_MM]).collect();
    let mut list = vec![Contestant::new(Path::AutoSigma, DEFAULT_VOXEL_MM)];
    for voxel_mm in voxels {
        list.extend(with_kernels(voxel_mm));
        list.extend([Drop::Nearest, Drop::Trilinear].map(|drop| Contestant::new(Path::Splat(drop), voxel_mm)));
    }
    let on_two = |method| Contestant::new(Path::Kernel(method, USUAL), DEFAULT_VOXEL_MM).on_threads(2);
    list.extend(Method::ALL.map(on_two));
    let ours = Contestant::default_configuration(planar);
    with_default(ours, &[ours.on_threads(2)], list)
}

/// Returns every kernel with each support, across the plane and in it.
fn with_kernels(voxel_mm: f64) -> Vec<Contestant> {
    let mut list = Vec::new();
    for method in Method::ALL {
        let mut ends = vec![USUAL];
        if method.takes_support() {
            ends.extend(ACROSS.map(|energy| [None, Some(energy)]));
        }
        if method.takes_support() && !method.interpolates() {
            ends.extend(IN_PLANE.map(|energy| [Some(energy), None]));
        }
        list.extend(ends.into_iter().map(|ends| Contestant::new(Path::Kernel(method, ends), voxel_mm)));
    }
    list.extend(corrected().map(|path| Contestant::new(path, voxel_mm)));
    list
}

/// Returns the kernels whose first moment is corrected, too.
pub(crate) fn corrected() -> [Path; 2] {
    [Method::default(), Method::Gaussian4].map(Path::FirstMoment)
}

/// Returns the default first and then the others, on the default's path if possible, plus once
/// on the general one. Removes duplicates.
fn with_default(default: Contestant, more: &[Contestant], others: Vec<Contestant>) -> Vec<Contestant> {
    let general = Contestant::new(default.path, default.voxel_mm);
    let others = others.into_iter().map(|c| c.planar_if(default.planar));
    let mut list = vec![default];
    for contestant in more.iter().copied().chain(others).chain([general]) {
        if !list.iter().any(|c| c.same(&contestant)) {
            list.push(contestant);
        }
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
    fn kernels_have_the_default_effective_width() {
        let target = default_kernels([0.2; 2], None).unwrap().map(|k| k.sigma_effective_mm());
        for contestant in full_list(false) {
            let Path::Kernel(method, energies) = contestant.path else { continue };
            for (axis, target) in target.into_iter().enumerate() {
                // In the plane it has the σ of a Gaussian of that width.
                let method = if method == Method::Gaussian4 && axis < 2 { Method::Gaussian } else { method };
                let sigma = matched_sigma(method, energies, axis, target).unwrap();
                let width = sigma * unit_kernel(method, energies, axis).unwrap().sigma_effective_mm();
                assert!((width / target - 1.0).abs() < 1e-12, "{contestant:?} {axis}");
            }
        }
    }

    #[test]
    fn lists_begin_with_default_without_duplicates() {
        for (list, planar) in [false, true].into_iter().flat_map(|p| [(short_list(p), p), (full_list(p), p)]) {
            assert_eq!(list[0], Contestant::default_configuration(planar));
            assert_eq!(list.iter().filter(|c| c.is_default()).count(), 2, "on one and on two threads");
            let mut names: Vec<String> = list.iter().map(Contestant::name).collect();
            let all = names.len();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), all);
        }
        let alone =
            |planar| full_list(planar).iter().filter(|c| c.voxel_mm == DEFAULT_VOXEL_MM && c.threads == 1).count();
        assert_eq!(alone(true), alone(false) + 1, "on the planar path there is the general one besides");
    }
}

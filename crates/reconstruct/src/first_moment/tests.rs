//! Tests of the first-moment correction: against exact moments, closed forms and painted ramps.

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use super::*;
use crate::kernel::{Method, Support};
use crate::planar::PlanarSettings;
use crate::{Compounding, PathReconstructor, Settings};

const SIZE: [u32; 2] = [60, 50];
const PIXEL_MM: f64 = 0.2;
const SIGMA_MM: f64 = 0.4;
/// Gaps, mm, again and again: 0.35 on average.
const GAPS_MM: [f64; 5] = [0.2, 0.55, 0.3, 0.5, 0.2];

/// A slice of a scene with its middle at `middle`, its rows along `u` and its columns along `v`.
fn slice(scene: impl Fn(DVec3) -> f64, middle: DVec3, u: DVec3, v: DVec3) -> Slice {
    let corner = middle - (u * f64::from(SIZE[0] - 1) + v * f64::from(SIZE[1] - 1)) * 0.5 * PIXEL_MM;
    let pose = DAffine3 { matrix3: DMat3::from_cols(u * PIXEL_MM, v * PIXEL_MM, u.cross(v)), translation: corner };
    let grey = |i: u32| scene(pose.transform_point3(DVec3::new(f64::from(i % SIZE[0]), f64::from(i / SIZE[0]), 0.0)));
    let pixels = (0..SIZE[0] * SIZE[1]).map(|i| grey(i) as f32).collect();
    let image = Image::new(SIZE[0], SIZE[1], Pixels::F32(pixels));
    Slice { image, time_ns: 0, world_from_image: Transform::from_affine(pose) }
}

/// A sweep along the normal u × v, of slices with gaps in turn.
fn sweep(scene: impl Fn(DVec3) -> f64, u: DVec3, v: DVec3, gaps_mm: &[f64]) -> Vec<Slice> {
    let mut at = -5.0;
    let mut slices = Vec::new();
    for gap in gaps_mm.iter().cycle() {
        if at > 5.0 {
            break;
        }
        slices.push(slice(&scene, u.cross(v) * at, u, v));
        at += gap;
    }
    slices
}

fn settings(spacing_mm: f64) -> Settings {
    Settings { sigma_mm: [Some(SIGMA_MM); 3], ..Settings::new(DVec3::splat(spacing_mm)) }
}

fn mask() -> Mask {
    Mask::full(SIZE[0], SIZE[1])
}

fn reconstructed(settings: Settings, slices: &[Slice]) -> PathReconstructor {
    let gaps = settings.weights_by_gaps();
    let mut reconstructor = PathReconstructor::general(settings, mask()).unwrap();
    let poses = slices.iter().map(|slice| slice.world_from_image);
    let weights = gaps.map_or_else(|| vec![1.0; slices.len()], |gaps| gaps.of_sweep(poses, SIZE));
    for (slice, weight) in slices.iter().zip(weights) {
        reconstructor.insert_weighted(slice, weight).unwrap();
    }
    reconstructor
}

/// Root mean squares of the errors of the mean and of the corrected value, within `inside` mm of
/// the middle.
fn errors(reconstructor: &PathReconstructor, scene: impl Fn(DVec3) -> f64, inside: f64) -> [f64; 2] {
    let both: [&dyn Voxels; 2] = [reconstructor.volume(), &reconstructor.first_moment().unwrap()];
    let world = reconstructor.world_from_lattice();
    let most = (inside / reconstructor.settings().spacing_mm.x) as i64;
    let mut sums = [0.0; 2];
    let range = || -most..=most;
    for at in range().flat_map(|z| range().flat_map(move |y| range().map(move |x| [x, y, z]))) {
        let truth = scene(world.point(DVec3::from_array(at.map(|x| x as f64))));
        for (sum, volume) in sums.iter_mut().zip(both) {
            let (r, w) = volume.voxel(at);
            assert!(w > SEEN, "{at:?}");
            *sum += (f64::from(r / w) - truth).powi(2);
        }
    }
    sums.map(|sum| (sum / f64::from(2 * most as i32 + 1).powi(3)).sqrt())
}

fn ramp(at: DVec3) -> f64 {
    100.0 + at.dot(DVec3::new(3.0, -4.0, 9.0))
}

#[test]
fn ramp_of_uneven_gaps_is_straightened() {
    // A pose is turned in the world, so that all axes of the lattice take part.
    let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_y(0.3);
    for (spacing_mm, u, v, most) in [
        (0.2, DVec3::X, DVec3::Y, 0.2),
        (0.2, turn.x_axis, turn.y_axis, 0.2),
        (0.4, turn.x_axis, turn.y_axis, 0.3),
        (0.7, DVec3::X, DVec3::Y, 0.85),
    ] {
        for method in [Method::GaussianTruncated, Method::Gaussian4, Method::BSpline3, Method::Linear] {
            let slices = sweep(ramp, u, v, &GAPS_MM);
            let volume = reconstructed(Settings { method, ..settings(spacing_mm) }, &slices);
            let [mean, corrected] = errors(&volume, ramp, 2.0);
            assert!(mean > 0.1 && corrected < most * mean, "{method:?}, {spacing_mm} mm: {corrected} of {mean}");
        }
    }
}

#[test]
fn weights_by_gaps_straighten_ramp_by_themselves() {
    let slices = sweep(ramp, DVec3::X, DVec3::Y, &GAPS_MM);
    let [mean, corrected] = errors(&reconstructed(settings(0.2), &slices), ramp, 2.0);
    let weighted = Settings { gap_weights: true, ..settings(0.2) };
    let [weighted, both] = errors(&reconstructed(weighted, &slices), ramp, 2.0);
    assert!(weighted < 0.5 * mean, "{weighted} of {mean}");
    assert!(both < corrected, "{both} and {corrected} of {mean}");
}

#[test]
fn ramp_of_crossing_sweeps_is_straightened() {
    let mut slices = sweep(ramp, DVec3::X, DVec3::Y, &GAPS_MM);
    slices.extend(sweep(ramp, DVec3::NEG_Z, DVec3::Y, &GAPS_MM));
    let [mean, corrected] = errors(&reconstructed(settings(0.2), &slices), ramp, 2.0);
    assert!(mean > 0.05 && corrected < 0.16 * mean, "{corrected} of {mean}");
}

#[test]
fn mean_distances_match_exact_moments() {
    let slices = sweep(ramp, DVec3::X, DVec3::Y, &GAPS_MM);
    let volume = reconstructed(settings(0.2), &slices);
    let kernel = volume.kernels().unwrap()[2];
    let places: Vec<f64> = slices.iter().map(|slice| slice.world_from_image.point(DVec3::ZERO).z).collect();
    let corrected = volume.first_moment().unwrap();
    let (mut moments, mut differences) = (0.0, 0.0);
    for z in -15..=15_i64 {
        corrected.corrections([0, 0, z], 1, |_, Corrected { mean_mm, .. }| {
            let at = z as f64 * 0.2;
            let sums = places.iter().fold([0.0; 2], |[w, m], place| {
                let weight = kernel.weight(place - at);
                [w + weight, m + weight * (place - at)]
            });
            moments += (sums[1] / sums[0]).powi(2);
            differences += (mean_mm - DVec3::Z * (sums[1] / sums[0])).length_squared();
        });
    }
    assert!(moments > 31.0 * 0.01_f64.powi(2), "{moments}");
    assert!(differences < 0.02 * moments, "{differences} of {moments}");
    let Correction { distance_mm, change, change_p95 } = corrected.correction().unwrap();
    let rms_mm = (moments / 31.0_f64).sqrt();
    assert!((0.5 * rms_mm..2.0 * rms_mm).contains(&distance_mm), "{distance_mm} for {rms_mm} mm");
    // The ramp rises by 9 levels per mm along the normal.
    assert!((change / distance_mm - 9.0).abs() < 1.0 && change_p95 > change, "{change} for {distance_mm} mm");
}

#[test]
fn even_gaps_constants_and_single_slices_stay() {
    let near = |slices: &[Slice], most: f64| {
        let volume = reconstructed(settings(0.25), slices);
        let corrected = volume.first_moment().unwrap();
        for block in volume.volume().blocks() {
            let start = block.map(|b| i64::from(b) * 8);
            for voxel in (0..512).map(|i| [start[0] + i % 8, start[1] + i / 8 % 8, start[2] + i / 64]) {
                let ((r, w), (corrected, weight)) = (volume.volume().voxel(voxel), corrected.voxel(voxel));
                assert_eq!(w.to_bits(), weight.to_bits());
                let change = f64::from(corrected - r).abs() / f64::from(w.max(SEEN));
                assert!(change <= most, "{voxel:?}: {change}");
            }
        }
    };
    near(&sweep(|_| 77.0, DVec3::X, DVec3::Y, &GAPS_MM), 1e-4);
    // Along its normal, a single slice gives one value to all voxels.
    let steep = |at: DVec3| 100.0 + 5.0 * at.x - 7.0 * at.y;
    near(&[slice(steep, DVec3::ZERO, DVec3::X, DVec3::Y)], 2e-3);
    let volume = reconstructed(settings(0.25), &sweep(ramp, DVec3::X, DVec3::Y, &[0.3]));
    // The kernel's end is a step, of 0.036: less than a hundredth of a mm.
    let [mean, corrected] = errors(&volume, ramp, 2.0);
    assert!(mean < 0.09 && corrected < 0.09, "{corrected} of {mean}");
}

#[test]
fn image_borders_shift_no_values() {
    // Steep across the borders of the image only.
    let steep = |at: DVec3| 100.0 + 20.0 * at.x + 20.0 * at.y;
    let volume = reconstructed(settings(0.25), &sweep(steep, DVec3::X, DVec3::Y, &GAPS_MM));
    let corrected = volume.first_moment().unwrap();
    let mut borders = 0;
    for x in -40..=40 {
        for y in [-20, 0, 19] {
            let ((r, w), (shifted, _)) = (volume.volume().voxel([x, y, 0]), corrected.voxel([x, y, 0]));
            assert!((shifted - r).abs() <= 1e-4 * r.abs(), "{x} {y}: {} for {}", shifted / w, r / w);
            borders += i32::from(w > SEEN && w < 0.7 * volume.volume().voxel([0, 0, 0]).1);
        }
    }
    assert!(borders >= 6, "{borders}");
}

#[test]
fn planar_and_general_path_are_corrected_alike() {
    let slices = sweep(ramp, DVec3::Y, DVec3::Z, &GAPS_MM);
    let mut planar = PathReconstructor::planar(settings(0.25), PlanarSettings::default(), mask()).unwrap();
    slices.iter().for_each(|slice| drop(planar.insert(slice).unwrap()));
    assert_eq!(planar.path(), crate::Path::Planar);
    let lattice = planar.settings().lattice_direction;
    let general = reconstructed(Settings { lattice_direction: lattice, ..settings(0.25) }, &slices);
    let volumes = [planar.first_moment().unwrap(), general.first_moment().unwrap()];
    let [first, second] = volumes.each_ref().map(|volume| volume.correction().unwrap());
    assert!((first.change / second.change - 1.0).abs() < 0.02, "{first:?} {second:?}");
    for at in -6..=6 {
        let values = volumes.each_ref().map(|volume| {
            let (r, w) = volume.voxel([at, -at, 2 * at]);
            r / w
        });
        assert!((values[0] - values[1]).abs() < 0.02, "{at}: {values:?}");
    }
}

#[test]
fn nothing_else_than_means_is_corrected() {
    let slices = sweep(ramp, DVec3::X, DVec3::Y, &GAPS_MM);
    assert!(PathReconstructor::general(settings(0.5), mask()).unwrap().first_moment().is_none());
    for compounding in [Compounding::Maximum, Compounding::Latest] {
        assert!(reconstructed(Settings { compounding, ..settings(0.5) }, &slices).first_moment().is_none());
    }
    assert!(reconstructed(Settings { method: Method::Nearest, ..settings(0.5) }, &slices).first_moment().is_none());
}

#[test]
fn factor_is_variance_of_gaussian_on_fine_lattice() {
    let kernel = AxisKernel::new(Method::Gaussian, 0.7, Support::Energy(1e-6)).unwrap();
    assert!((factor(&kernel, 0.0) / 0.49 - 1.0).abs() < 0.01, "{}", factor(&kernel, 0.0));
    // The difference of a Gaussian over ±h is blunted by exp(−h²/4σ²) in this mean.
    let wide = factor(&kernel, 0.7) / 0.49;
    assert!(wide > 1.2 && wide < 1.4, "{wide}");
}

#[test]
fn largest_eigenvalues_match_known_matrices() {
    let turn = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(-1.1);
    for values in [[0.2, 0.7, 0.1], [0.5, 0.5, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.4, 0.399, 0.2]] {
        let matrix = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
        let most = values.into_iter().fold(0.0, f64::max);
        assert!((largest_eigenvalue(&matrix) / most - 1.0).abs() < 1e-9, "{values:?}");
    }
    assert_eq!(largest_eigenvalue(&DMat3::ZERO), 0.0);
}

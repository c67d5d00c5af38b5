//! Tests of standard errors: against the definition, closed forms and painted truth.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3};

use mask::Mask;
use phantom::scene::Blobs;
use phantom::{Motion, Scan, ScanSettings, Scene, truth};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::Grid;

use volume::brick::CELLS;

use super::cell::{ACROSS, voxels_of};
use super::*;
use crate::reference::Reference;
use crate::{Compounding, Decay, PathReconstructor, Settings, SettingsError, Simd};

const SPACING_MM: f64 = 0.5;
const NOISE_SD: f64 = 3.0;
const PIXEL_MM: f64 = 0.2;

fn settings(sigma_mm: f64) -> Settings {
    let settings = Settings::new(DVec3::splat(SPACING_MM));
    Settings { sigma_mm: [Some(sigma_mm); 3], standard_error: true, ..settings }
}

fn scan(scene: Scene, motion: Motion, frames: u32) -> Scan {
    Scan::new(ScanSettings {
        scene,
        motion,
        frames,
        gap_mm: 0.35,
        image_size: [90, 80],
        pixel_mm: [PIXEL_MM; 2],
        noise_sd: NOISE_SD,
        seed: 7,
        ..ScanSettings::default()
    })
    .unwrap()
}

fn reconstructed(settings: Settings, mask: &Mask, slices: &[Slice]) -> Reconstructor {
    let mut reconstructor = Reconstructor::new(settings, mask.clone()).unwrap();
    for slice in slices {
        reconstructor.insert(slice).unwrap();
    }
    reconstructor
}

fn errors(reconstructor: &Reconstructor, pose_mm: f64) -> StandardErrors<'_> {
    StandardErrors::new(reconstructor, pose_mm).unwrap()
}

/// Lattice indices of a block's voxels, x fastest.
fn voxels(block: BrickIndex) -> impl Iterator<Item = [i64; 3]> {
    let first = block.map(|b| i64::from(b) * EDGE as i64);
    let at = [1, EDGE, EDGE * EDGE];
    (0..VOXELS).map(move |i| std::array::from_fn(|a| first[a] + (i / at[a] % EDGE) as i64))
}

/// All seen voxels with their errors.
fn all(errors: &StandardErrors<'_>) -> Vec<([i64; 3], VoxelError)> {
    let seen = |block: BrickIndex| {
        let of_block: Vec<_> = voxels(block).zip(errors.errors(block).iter().copied()).collect();
        of_block.into_iter().filter_map(|(at, error)| Some((at, error?)))
    };
    errors.volume.blocks().flat_map(seen).collect()
}

/// Sums of squares of all cells, in the order of the lattice, as bits.
fn bits(reconstructor: &Reconstructor) -> Vec<(BrickIndex, Vec<u32>)> {
    let mut blocks: Vec<BrickIndex> = reconstructor.volume().blocks().collect();
    blocks.sort_unstable();
    let of_block = |block| {
        let squares = reconstructor.volume().squares(block).unwrap();
        (block, squares.tiles.as_flattened().iter().map(|x| x.to_bits()).collect())
    };
    blocks.into_iter().map(of_block).collect()
}

#[test]
fn sums_of_squares_match_their_definition() {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), Motion::Freehand, 12);
    let slices = scan.slices(0..scan.frames());
    let fast = reconstructed(settings(0.4), scan.mask(), &slices);
    let (low, high) = fast.volume().seen_bounds().unwrap();
    let origin = DVec3::from_array(low.map(|x| x as f64)) * SPACING_MM;
    let size = [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64);
    let grid = Grid { origin, spacing: DVec3::splat(SPACING_MM), direction: glam::DMat3::IDENTITY, size };
    // Numerators and weights of each slice alone.
    let alone: Vec<Reference> = slices
        .iter()
        .map(|slice| {
            let mut reference = Reference::new(grid);
            reference.insert(slice, scan.mask(), fast.kernels().unwrap());
            reference
        })
        .collect();
    let [nx, ny, _] = size.map(|n| n as usize);
    let (mut compared, mut differ) = (0, 0);
    for block in fast.volume().blocks() {
        let squares = fast.volume().squares(block).unwrap();
        for cell in 0..CELLS {
            let at = position(cell, ACROSS);
            let of_cell: Vec<[i64; 3]> = voxels_of(at).map(|i| voxels(block).nth(i).unwrap()).collect();
            let (mut expected_w2, mut expected_s, mut is_same, mut most) = (0.0, 0.0, true, 0);
            for voxel in &of_cell {
                let index = [0, 1, 2].map(|a| usize::try_from(voxel[a] - low[a]).unwrap_or(usize::MAX));
                let is_in = (0..3).all(|a| (index[a] as u64) < size[a]);
                let index = if is_in { (index[2] * ny + index[1]) * nx + index[0] } else { usize::MAX };
                let sums = alone.iter().filter_map(|one| Some([*one.r.get(index)?, *one.w.get(index)?]));
                let samples: Vec<[f64; 2]> = sums.filter(|[_, w]| *w > 0.0).collect();
                let [r, w] = samples.iter().fold([0.0; 2], |[r, w], one| [r + one[0], w + one[1]]);
                is_same &= (f64::from(fast.volume().voxel(*voxel).1) - w).abs() <= 1e-3;
                expected_w2 += samples.iter().map(|[_, w]| w * w).sum::<f64>();
                expected_s += samples.iter().map(|[value, w1]| w1 * (value / w1 - r / w).powi(2)).sum::<f64>();
                most = most.max(samples.len());
            }
            if !is_same {
                // At the end of a slice's support.
                differ += 1;
                continue;
            }
            let found = squares.cell(at);
            assert!((f64::from(found.w2) - expected_w2).abs() <= 1e-2, "{at:?}: {found:?} {expected_w2}");
            // The filtered image deviates by a small part of the range.
            let deviation = 2.0 + 0.2 * expected_s.sqrt();
            assert!((f64::from(found.s) - expected_s).abs() <= deviation, "{at:?}: {found:?} {expected_s}");
            compared += usize::from(most > 1);
        }
    }
    assert!(compared > 1000 && differ * 20 < compared, "{differ} of {compared}");
}

#[test]
fn mean_has_same_bits_with_and_without_squares() {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), Motion::Freehand, 8);
    let slices = scan.slices(0..scan.frames());
    let with = reconstructed(settings(0.4), scan.mask(), &slices);
    let without = reconstructed(Settings { standard_error: false, ..settings(0.4) }, scan.mask(), &slices);
    assert!(with.volume().iter().eq_by_bits(without.volume().iter()));
    assert!(without.volume().blocks().all(|block| without.volume().squares(block).is_none()));
    assert!(StandardErrors::new(&without, 0.0).is_none());
    assert_eq!([with, without].map(|one| one.settings().brick_bytes().unwrap()), [4608, 4096]);
}

/// Comparison of bricks by their bits.
trait EqByBits {
    fn eq_by_bits(self, other: Self) -> bool;
}

impl<'a, I: Iterator<Item = (BrickIndex, &'a volume::Brick)>> EqByBits for I {
    fn eq_by_bits(self, other: Self) -> bool {
        self.map(|(at, brick)| (at, bytemuck::bytes_of(brick)))
            .eq(other.map(|(at, brick)| (at, bytemuck::bytes_of(brick))))
    }
}

#[test]
fn squares_have_same_bits_for_any_threads_and_instructions() {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), Motion::Freehand, 8);
    let slices = scan.slices(0..scan.frames());
    // Some weights are clamped.
    let settings = Settings { max_weight: 1.5, ..settings(0.4) };
    let expected = bits(&reconstructed(settings.clone(), scan.mask(), &slices));
    for simd in [Simd::Portable, Simd::Avx2, Simd::Avx512].into_iter().filter(|simd| simd.is_available()) {
        for threads in [1, 3] {
            let other = reconstructed(Settings { simd, threads, ..settings.clone() }, scan.mask(), &slices);
            assert!(bits(&other) == expected, "{} {threads}", simd.name());
        }
    }
}

/// Slices side by side of noise about a grey level, scaled by a contrast.
fn noisy(frames: u32, [level, contrast]: [f32; 2], step_mm: f64) -> Vec<Slice> {
    let scan = scan(Scene::Constant(100.0), Motion::Parallel, frames);
    let size = scan.settings().image_size;
    let slice = |frame: u32| {
        let painted = scan.slice(frame);
        let Pixels::U8(pixels) = painted.image.pixels() else { panic!("8 bits") };
        let pixels: Vec<f32> = pixels.iter().map(|grey| level + contrast * (f32::from(*grey) - 100.0)).collect();
        let pose = DAffine3::from_translation(DVec3::Z * step_mm * f64::from(frame))
            * DAffine3::from_scale(DVec3::new(PIXEL_MM, PIXEL_MM, 1.0));
        Slice {
            image: Image::new(size[0], size[1], Pixels::F32(pixels.into())),
            world_from_image: Transform::from_affine(pose),
            ..painted
        }
    };
    (0..frames).map(slice).collect()
}

#[test]
fn error_of_noise_is_its_deviation_over_root_of_slices() {
    let slices = noisy(40, [100.0, 1.0], 0.25);
    let sigma = 0.5;
    let reconstructor = reconstructed(settings(sigma), &Mask::full(90, 80), &slices);
    let errors = errors(&reconstructor, 0.0);
    // The noise of filtered values: that of one slice's, in its plane.
    let alone = reconstructed(settings(sigma), &Mask::full(90, 80), &slices[..1]);
    let grey = |x: i64| (3..29).map(move |y| [x, y, 0]);
    let (mut squares, mut count) = (0.0, 0.0);
    for at in (3..33).flat_map(grey) {
        let (r, w) = alone.volume().voxel(at);
        squares += f64::from(r / w - 100.0).powi(2);
        count += 1.0;
    }
    let filtered = f64::sqrt(squares / count);
    assert!((errors.noise() / filtered - 1.0).abs() < 0.1, "{} {filtered}", errors.noise());
    // A Gaussian lowers the noise of pixels.
    assert!((filtered / (NOISE_SD * PIXEL_MM / (2.0 * PI.sqrt() * sigma)) - 1.0).abs() < 0.1, "{filtered}");
    let inside = |at: [i64; 3]| (3..33).contains(&at[0]) && (3..29).contains(&at[1]) && (4..16).contains(&at[2]);
    let found: Vec<_> = all(&errors).into_iter().filter(|(at, _)| inside(*at)).collect();
    assert!(found.len() > 8000);
    let ratio = |(_, error): &([i64; 3], VoxelError)| error.standard_error.powi(2) * error.slices / filtered.powi(2);
    let mean = (found.iter().map(ratio).sum::<f64>() / found.len() as f64).sqrt();
    assert!((mean - 1.0).abs() < 0.05, "{mean}");
    // The errors that are there: the volume's deviation from its level.
    let deviation = |(at, _): &([i64; 3], VoxelError)| {
        let (r, w) = reconstructor.volume().voxel(*at);
        f64::from(r / w - 100.0).powi(2)
    };
    let actual = (found.iter().map(deviation).sum::<f64>() / found.len() as f64).sqrt();
    let said = (found.iter().map(|(_, e)| e.standard_error.powi(2)).sum::<f64>() / found.len() as f64).sqrt();
    assert!((said / actual - 1.0).abs() < 0.1, "{said} {actual}");
}

#[test]
fn errors_are_linear_in_contrast_and_independent_of_level() {
    let errors_of = |parts| {
        let reconstructor = reconstructed(settings(0.5), &Mask::full(90, 80), &noisy(12, parts, 0.25));
        let found = errors(&reconstructor, 0.0);
        all(&found)
    };
    let plain = errors_of([0.0, 1.0]);
    for (parts, tolerance) in [([0.0, 4.0], 1e-5), ([200.0, 1.0], 2e-3), ([60_000.0, 20.0], 5e-3)] {
        let other = errors_of(parts);
        assert_eq!(other.len(), plain.len());
        for ((at, one), (same, scaled)) in plain.iter().zip(&other) {
            assert_eq!(at, same);
            let ratio = scaled.standard_error / (f64::from(parts[1]) * one.standard_error);
            assert!((ratio - 1.0).abs() < tolerance, "{at:?} {parts:?}: {ratio}");
        }
    }
}

#[test]
fn order_of_slices_changes_rounding_only() {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), Motion::Crossing, 24);
    let mut slices = scan.slices(0..scan.frames());
    let forward = reconstructed(settings(0.4), scan.mask(), &slices);
    slices.reverse();
    let backward = reconstructed(settings(0.4), scan.mask(), &slices);
    let (forward, backward) = (errors(&forward, 0.0), errors(&backward, 0.0));
    let mut compared = 0;
    for (at, one) in all(&forward) {
        let other = backward.at(at).unwrap();
        assert!((other.standard_error / one.standard_error - 1.0).abs() < 1e-3, "{at:?}");
        compared += 1;
    }
    assert!(compared > 5000);
}

#[test]
fn clamped_weights_keep_spread_and_limit_slices() {
    let slices = noisy(400, [100.0, 1.0], 0.0);
    let free = reconstructed(Settings { max_weight: 1e4, ..settings(0.5) }, &Mask::full(90, 80), &slices);
    let most = 20.0;
    let clamped = reconstructed(Settings { max_weight: most, ..settings(0.5) }, &Mask::full(90, 80), &slices);
    let (free, clamped) = (errors(&free, 0.0), errors(&clamped, 0.0));
    let (all_slices, limited) = (free.at([20, 20, 0]).unwrap(), clamped.at([20, 20, 0]).unwrap());
    assert!((all_slices.slices - 400.0).abs() < 0.5, "{}", all_slices.slices);
    // A running mean of N slices is an exponential one, whose effective number is nearly 2N.
    assert!((limited.slices / (2.0 * most) - 1.0).abs() < 0.12, "{}", limited.slices);
    let [of_free, of_clamped] = [&free, &clamped].map(|errors| errors.noise());
    assert!((of_clamped / of_free - 1.0).abs() < 0.05, "{of_clamped} {of_free}");
}

#[test]
fn voxel_of_one_slice_has_noise_of_volume_and_unseen_none() {
    let slices = noisy(12, [100.0, 1.0], 0.25);
    let far = Slice {
        world_from_image: Transform::from_affine(
            DAffine3::from_translation(DVec3::Z * 40.0) * slices[0].world_from_image.affine(),
        ),
        ..slices[0].clone()
    };
    let alone = reconstructed(settings(0.5), &Mask::full(90, 80), std::slice::from_ref(&far));
    assert!(StandardErrors::new(&alone, 0.0).is_none(), "one slice says nothing about noise");
    let reconstructor = reconstructed(settings(0.5), &Mask::full(90, 80), &[slices, vec![far]].concat());
    let errors = errors(&reconstructor, 0.0);
    let one = errors.at([20, 20, 80]).unwrap();
    assert_eq!(one.slices, 1.0);
    assert!((one.standard_error / errors.noise() - 1.0).abs() < 1e-6, "{one:?}");
    assert_eq!(errors.at([20, 20, 40]), None);
    assert_eq!((errors.voxel([20, 20, 40]), errors.at([i64::MAX, 0, 0])), ((0.0, 0.0), None));
    // A row, a block and a voxel read the same.
    let (mut r, mut w) = ([9.0; 50], [9.0; 50]);
    errors.row([-5, 20, 3], &mut r, &mut w);
    for (x, (r, w)) in (-5..).zip(r.into_iter().zip(w)) {
        assert_eq!(errors.voxel([x, 20, 3]), (r, w));
        assert_eq!(errors.at([x, 20, 3]).map(|error| error.standard_error as f32), (w > 0.0).then_some(r));
    }
    assert!(w[0] == 0.0 && w[20] == 1.0 && r[20] > 0.0);
    for block in errors.blocks() {
        let (mut r, mut w) = ([9.0; VOXELS], [9.0; VOXELS]);
        errors.block(block, &mut r, &mut w);
        for (i, at) in voxels(block).enumerate() {
            assert_eq!(errors.at(at).map(|error| error.standard_error as f32), (w[i] > 0.0).then_some(r[i]), "{at:?}");
        }
    }
}

#[test]
fn slices_that_halve_the_error_are_told_where_others_have_them() {
    let slices = noisy(60, [100.0, 1.0], 0.25);
    let far = DAffine3::from_translation(DVec3::Z * 40.0) * slices[0].world_from_image.affine();
    let far = Slice { world_from_image: Transform::from_affine(far), ..slices[0].clone() };
    let reconstructor = reconstructed(settings(0.5), &Mask::full(90, 80), &[slices, vec![far]].concat());
    let noise = StandardErrors::noise_of(&reconstructor, MOST).unwrap();
    let errors = errors(&reconstructor, 0.0);
    let [one, usual] = [80, 14].map(|z| errors.at([20, 20, z]).unwrap());
    assert!(noise.slices > 3.0 && (noise.slices / usual.slices - 1.0).abs() < 0.3, "{noise:?} {usual:?}");
    assert_eq!([one, usual].map(|error| error.halved_by(&noise)), [Some(3.0), None]);
}

#[test]
fn error_of_poses_is_a_part_of_each_slices_noise() {
    // Grey levels grow by 2 per mm along x.
    let ramp = |slice: Slice| {
        let grey: std::sync::Arc<[f32]> =
            (0..90 * 80).map(|i| 50.0 + 2.0 * PIXEL_MM as f32 * (i % 90) as f32).collect();
        Slice { image: Image::new(90, 80, Pixels::F32(grey)), ..slice }
    };
    let slices: Vec<Slice> = noisy(12, [100.0, 1.0], 0.25).into_iter().map(ramp).collect();
    let reconstructor = reconstructed(settings(0.5), &Mask::full(90, 80), &slices);
    let (exact, moved) = (errors(&reconstructor, 0.0), errors(&reconstructor, 0.3));
    let [exact, moved] = [exact, moved].map(|errors| errors.at([18, 16, 4]).unwrap());
    assert!(exact.standard_error < 1e-3 && exact.slices == moved.slices && exact.slices > 3.0, "{exact:?}");
    // A third of its square lies along the gradient.
    let expected = 2.0 * 0.3 / (3.0 * moved.slices).sqrt();
    assert!((moved.standard_error / expected - 1.0).abs() < 1e-3, "{moved:?}");
}

#[test]
fn edge_has_gradient_in_the_world_and_no_error_of_poses() {
    let ramp = |slice: Slice| {
        let grey: std::sync::Arc<[f32]> =
            (0..90 * 80).map(|i| 50.0 + 2.0 * PIXEL_MM as f32 * (i % 90) as f32).collect();
        Slice { image: Image::new(90, 80, Pixels::F32(grey)), ..slice }
    };
    let slices: Vec<Slice> = noisy(12, [100.0, 1.0], 0.25).into_iter().map(ramp).collect();
    let turned = DMat3::from_rotation_z(0.4);
    let lattice_direction = turned;
    let settings = Settings { lattice_direction, ..settings(0.5) };
    let reconstructor = reconstructed(settings, &Mask::full(90, 80), &slices);
    let errors = errors(&reconstructor, 0.3);
    let place = turned.transpose() * DVec3::new(9.0, 8.0, 2.0) / SPACING_MM;
    let voxel = place.round().to_array().map(|x| x as i64);
    let edge = errors.edge(voxel).unwrap();
    assert!(edge.gradient.distance(DVec3::X * 2.0) < 1e-3, "{edge:?}");
    let [exact, moved] = [0.0, 0.3].map(|pose_mm| super::tests::errors(&reconstructor, pose_mm).at(voxel).unwrap());
    assert_eq!(edge.standard_error, exact.standard_error);
    assert!(moved.standard_error > 10.0 * exact.standard_error, "{exact:?} {moved:?}");
    assert_eq!(errors.edge([0, 0, 40]), None, "unseen");
}

#[test]
fn intervals_hold_truth_of_blobs() {
    // Voxels in all, and those whose interval holds the scene's grey level: 68 % and 95 %.
    let mut counts = [0_usize; 3];
    for (seed, motion) in (1..7).flat_map(|seed| [Motion::Freehand, Motion::Crossing].map(|motion| (seed, motion))) {
        let scene = Scene::Blobs(Blobs::draw(seed));
        let scan = scan(scene.clone(), motion, 60);
        let reconstructor = reconstructed(settings(0.3), scan.mask(), &scan.slices(0..scan.frames()));
        let (low, high) = reconstructor.volume().seen_bounds().unwrap();
        let origin = DVec3::from_array(low.map(|x| x as f64)) * SPACING_MM;
        let size = [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64);
        let grid = Grid { origin, spacing: DVec3::splat(SPACING_MM), direction: glam::DMat3::IDENTITY, size };
        let grey = truth::sample(&scene, &grid).unwrap();
        let found = all(&errors(&reconstructor, 0.0));
        let mut weights: Vec<f32> = found.iter().map(|(at, _)| reconstructor.volume().voxel(*at).1).collect();
        let middle = weights.len() / 2;
        let median = *weights.select_nth_unstable_by(middle, f32::total_cmp).1;
        for (at, error) in found {
            let (r, w) = reconstructor.volume().voxel(at);
            // Inside the sweep.
            if w < 0.5 * median {
                continue;
            }
            let [x, y, z] = [0, 1, 2].map(|a| (at[a] - low[a]) as u64);
            let truth = grey[((z * size[1] + y) * size[0] + x) as usize];
            let deviation = f64::from((r / w - truth).abs());
            let half_width_68 = error.half_width(0.994_458);
            counts[0] += 1;
            counts[1] += usize::from(deviation <= half_width_68);
            counts[2] += usize::from(deviation <= error.half_width_95());
        }
    }
    let share = |n: usize| n as f64 / counts[0] as f64;
    let [held_68, held_95] = [share(counts[1]), share(counts[2])];
    assert!((0.64..=0.74).contains(&held_68) && (0.93..=0.98).contains(&held_95), "{held_68} {held_95}");
}

#[test]
fn quantiles_match_tables() {
    for (degrees, expected) in [(10.0, 2.228_14), (12.0, 2.178_81), (20.0, 2.085_96), (1e9, 1.959_96)] {
        assert!((student(1.959_964, degrees) - expected).abs() < 1e-3, "{degrees}");
    }
}

#[test]
fn other_compoundings_and_planar_path_refused() {
    let decay = Decay::Exponential { rate_per_s: 1.0 };
    for compounding in [Compounding::Maximum, Compounding::Latest, Compounding::Decay(decay)] {
        let refused = Reconstructor::new(Settings { compounding, ..settings(0.5) }, Mask::full(90, 80)).err();
        assert_eq!(refused, Some(SettingsError::StandardError(compounding.name())));
    }
    assert_eq!(settings(0.5).beyond_planar().as_deref(), Some("standard errors"));
    let planar = PathReconstructor::planar(settings(0.5), Default::default(), Mask::full(90, 80)).err();
    assert!(matches!(planar, Some(SettingsError::BeyondPlanar(_))), "{planar:?}");
}

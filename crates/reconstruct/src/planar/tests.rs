//! Tests of the planar path against the equations, the general path and itself.

mod decay;
mod departures;

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};

use mask::Mask;
use simd::dispatch;
use sonoweave_core::frames::Transform;
use sonoweave_core::region::{ClipRect, Fan};
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::brick::BrickIndex;
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use super::strip::{Sum, add};
use super::{Departure, OnDeparture, PlanarReconstructor, PlanarSettings, reference, worst_departure};
use crate::kernel::{Method, Support};
use crate::reference::Reference;
use crate::{Path, PathReconstructor, Reconstructor, Refused, Settings, SettingsError, Simd, Touched};

const SIZE: [u32; 2] = [40, 36];
const PIXEL_MM: [f64; 2] = [0.7, 0.4];

/// An image of hashed grey levels: every pixel matters.
fn picture(seed: u32) -> Image {
    let grey = |i: u32| ((i + 7919 * seed).wrapping_mul(2_654_435_761) >> 24) as u8;
    Image::new(SIZE[0], SIZE[1], Pixels::U8((0..SIZE[0] * SIZE[1]).map(grey).collect()))
}

/// A slice of an arm: u along the base's z, v at an angle to the base's x, the first pixel at
/// `place`.
fn slice(base: DQuat, place: DVec3, angle: f64, image: Image) -> Slice {
    let (sin, cos) = angle.sin_cos();
    let v = DVec3::new(cos, sin, 0.0);
    let pose = DAffine3 {
        matrix3: DMat3::from_cols(DVec3::Z * PIXEL_MM[0], v * PIXEL_MM[1], DVec3::Z.cross(v)),
        translation: place,
    };
    Slice { image, time_ns: 0, world_from_image: Transform::from_affine(DAffine3::from_quat(base) * pose) }
}

/// A sweep that shifts and turns, with all of it turned about the base's z first.
pub(super) fn sweep(base: DQuat, turn: f64, frames: u32) -> Vec<Slice> {
    let base = base * DQuat::from_rotation_z(turn);
    (0..frames)
        .map(|i| {
            let at = f64::from(i);
            let place = DVec3::new(3.13 + 0.61 * at, -2.71 - 0.13 * at * at / 9.0, -4.4);
            slice(base, place, FRAC_PI_2 + 0.05 * at, picture(i))
        })
        .collect()
}

pub(super) fn settings() -> Settings {
    Settings { sigma_mm: [None, None, Some(0.8)], ..Settings::new(DVec3::splat(0.5)) }
}

pub(super) fn refusing() -> PlanarSettings {
    PlanarSettings { on_departure: OnDeparture::Refuse, ..PlanarSettings::default() }
}

pub(super) fn reconstructed(
    settings: &Settings,
    planar: PlanarSettings,
    mask: &Mask,
    slices: &[Slice],
) -> PlanarReconstructor {
    let mut r = PlanarReconstructor::new(settings.clone(), planar, mask.clone()).unwrap();
    for slice in slices {
        r.insert(slice).unwrap();
    }
    r
}

pub(super) fn full() -> Mask {
    Mask::full(SIZE[0], SIZE[1])
}

/// All blocks, bit by bit.
pub(super) fn bits(volume: &dyn Voxels) -> Vec<(BrickIndex, Vec<u32>)> {
    let (mut r, mut w) = ([0.0; 8], [0.0; 8]);
    let mut blocks: Vec<BrickIndex> = volume.blocks().collect();
    blocks.sort_unstable();
    let block = |index: BrickIndex| {
        let first = index.map(|i| i64::from(i) * 8);
        let rows = (0..64).flat_map(|i| {
            volume.row([first[0], first[1] + i % 8, first[2] + i / 8], &mut r, &mut w);
            r.iter().chain(&w).map(|x| x.to_bits()).collect::<Vec<_>>()
        });
        (index, rows.collect())
    };
    blocks.into_iter().map(block).collect()
}

/// Returns the grid of all seen voxels with a margin, in the lattice of a reconstructor, and
/// its first voxel.
pub(super) fn grid_around(volume: &dyn Voxels, settings: &Settings) -> (Grid, [i64; 3]) {
    let (low, high) = volume.seen_bounds().expect("something was seen");
    let low = low.map(|x| x - 4);
    let size = [0, 1, 2].map(|a| (high[a] + 5 - low[a]) as u64);
    let lattice = settings.world_from_lattice();
    let origin = lattice.transform_point3(DVec3::from_array(low.map(|x| x as f64)));
    (Grid { origin, spacing: settings.spacing_mm, direction: settings.lattice_direction, size }, low)
}

/// Iterates over the voxels of a grid: index, lattice index.
pub(super) fn voxels(grid: &Grid, low: [i64; 3]) -> impl Iterator<Item = (usize, [i64; 3])> {
    let [nx, ny, nz] = grid.size.map(|n| n as usize);
    (0..nx * ny * nz)
        .map(move |i| (i, [low[0] + (i % nx) as i64, low[1] + (i / nx % ny) as i64, low[2] + (i / nx / ny) as i64]))
}

/// Worst deviations from the equations of numerator, weight and value, relative to the largest
/// possible. Also the numbers of voxels seen by only one of the two, and by both.
fn against_equations(r: &PlanarReconstructor, mask: &Mask, slices: &[Slice]) -> ([f64; 3], [usize; 2]) {
    let (grid, low) = grid_around(r.volume(), r.settings());
    let mut slow = Reference::new(grid);
    for slice in slices {
        reference::insert(&mut slow, slice, mask, r.kernels().unwrap());
    }
    let most = slow.w.iter().fold(0.0_f64, |most, w| most.max(*w));
    let (mut worst, mut counts) = ([0.0_f64; 3], [0; 2]);
    for (i, voxel) in voxels(&grid, low) {
        let (r, w) = r.volume().voxel(voxel);
        let errors = [(f64::from(r) - slow.r[i]).abs() / (255.0 * most), (f64::from(w) - slow.w[i]).abs() / most];
        // At the very end of the support, or at the threshold of a fifth of the kernel, a voxel
        // may fall either way for one slice of many.
        if errors[1] > 1e-5 {
            counts[0] += 1;
            continue;
        }
        worst = [worst[0].max(errors[0]), worst[1].max(errors[1]), worst[2]];
        if let Some(value) = slow.value(i).filter(|_| slow.w[i] > 0.05 && w > SEEN) {
            counts[1] += 1;
            worst[2] = worst[2].max((f64::from(r / w) - value).abs() / 255.0);
        }
    }
    (worst, counts)
}

#[test]
fn planar_path_matches_separable_sum_in_f64() {
    let anywhere = DQuat::from_euler(EulerRot::YXZ, 0.7, -0.4, 0.3);
    let narrow = Settings {
        method: Method::GaussianTruncated,
        support: [Some(Support::Energy(0.01)); 2],
        spacing_mm: DVec3::new(0.5, 0.6, 0.45),
        ..settings()
    };
    let clip = Mask::rect(SIZE[0], SIZE[1], ClipRect::new(5, 3, 30, 28).unwrap());
    let identity = PlanarSettings { direction: Some(DMat3::IDENTITY), ..refusing() };
    let cases = [
        (settings(), refusing(), full(), anywhere, 0.0),
        (narrow, refusing(), clip.clone(), anywhere, 0.0),
        // Turned about the arm's axis, on a fixed lattice.
        (settings(), identity, full(), DQuat::IDENTITY, 0.0),
        (settings(), identity, full(), DQuat::IDENTITY, FRAC_PI_2),
        (settings(), identity, clip, DQuat::IDENTITY, PI),
        (settings(), identity, full(), DQuat::IDENTITY, 37.0_f64.to_radians()),
    ];
    for (i, (settings, planar, mask, base, turn)) in cases.into_iter().enumerate() {
        let slices = sweep(base, turn, 9);
        let r = reconstructed(&settings, planar, &mask, &slices);
        let ([numerator, weight, value], [differ, seen]) = against_equations(&r, &mask, &slices);
        assert!(numerator <= 1e-5 && weight <= 1e-5 && value <= 1e-5, "case {i}: {numerator} {weight} {value}");
        assert!(seen > 10_000 && differ * 1000 < seen, "case {i}: {differ} of {seen}");
    }
}

#[test]
fn lattice_turned_with_scan_gives_same_volume() {
    // The lattice's x is the first slice's v for any turn, and its origin is the world's, about
    // which everything turns.
    let value = |turn: f64| {
        let r = reconstructed(&settings(), refusing(), &full(), &sweep(DQuat::IDENTITY, turn, 5));
        let (low, high) = r.volume().seen_bounds().unwrap();
        let (mut value, mut weight) = (vec![0.0; 60], vec![0.0; 60]);
        r.volume().row([low[0], (low[1] + high[1]) / 2, (low[2] + high[2]) / 2], &mut value, &mut weight);
        (low, high, value, weight)
    };
    let straight = value(0.0);
    for turn in [FRAC_PI_2, PI, 0.6] {
        let turned = value(turn);
        assert_eq!((straight.0, straight.1), (turned.0, turned.1));
        assert!(straight.3.iter().filter(|w| **w > SEEN).count() > 20);
        for i in 0..60 {
            assert!((straight.2[i] - turned.2[i]).abs() < 1e-2 && (straight.3[i] - turned.3[i]).abs() < 1e-5, "{i}");
        }
    }
}

#[test]
fn simd_and_threads_give_same_bits() {
    let slices = sweep(DQuat::from_rotation_x(0.3), 0.0, 8);
    let run = |simd, threads| {
        let settings = Settings { simd, threads, max_weight: 1.5, ..settings() };
        let mut r = PlanarReconstructor::new(settings, refusing(), full()).unwrap();
        let touched: Vec<Touched> = slices.iter().map(|s| r.insert(s).unwrap()).collect();
        (touched, bits(r.volume()), r.work())
    };
    let expected = run(Simd::Portable, 1);
    assert!(expected.2.weights_clamped > 0, "the clamp is part of what must agree");
    for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
        for threads in [1, 2, 7] {
            assert!(run(simd, threads) == expected, "{} with {threads} threads", simd.name());
        }
    }
}

dispatch!(fn add_to => add(column: &mut [f32], sum: &Sum<'_>));

#[test]
fn column_summed_in_parts_has_same_bits() {
    let (stride, taps) = (16 * 23, 7);
    let float = |i: usize| ((i * 7919) % 1013) as f32 / 7.0 - 70.0;
    let rows: Vec<f32> = (0..stride * taps).map(float).collect();
    let before: Vec<f32> = (0..stride).map(|i| float(i * 31 + 5)).collect();
    let weights: Vec<f32> = (0..taps).map(|t| float(t) / 300.0).collect();
    for [fade, lost] in [[1.0, 0.0], [0.7, 0.1]] {
        let (level, gained) = (93.0, 0.3);
        let sum = |from: usize| Sum { rows: &rows[from..], stride, weights: &weights, level, gained, fade, lost };
        let mut whole = before.clone();
        add_to(Simd::Portable, &mut whole, &sum(0));
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            for parts in [1, 2, 3, 5, 23] {
                let mut column = before.clone();
                let length = 16 * 23_usize.div_ceil(parts);
                for (i, part) in column.chunks_mut(length).enumerate() {
                    add_to(simd, part, &sum(i * length));
                }
                assert!(
                    column.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()),
                    "{} in {parts}",
                    simd.name()
                );
            }
        }
        assert!(whole != before);
    }
}

#[test]
fn constant_stays_constant_to_border() {
    for constant in [77.3_f32, 0.1, 200.0] {
        let image = Image::new(SIZE[0], SIZE[1], Pixels::F32(vec![constant; (SIZE[0] * SIZE[1]) as usize].into()));
        let slices: Vec<Slice> = sweep(DQuat::IDENTITY, 0.2, 10);
        let slices: Vec<Slice> = slices.into_iter().map(|s| Slice { image: image.clone(), ..s }).collect();
        let r = reconstructed(&settings(), refusing(), &full(), &slices);
        let ulp = f32::from_bits(constant.to_bits() + 1) - constant;
        let (grid, low) = grid_around(r.volume(), r.settings());
        let (mut worst, mut seen) = (0.0_f32, 0);
        for (_, voxel) in voxels(&grid, low) {
            let (r, w) = r.volume().voxel(voxel);
            if w > SEEN {
                seen += 1;
                worst = worst.max((r / w - constant).abs() / ulp);
            }
        }
        assert!(seen > 20_000 && worst <= 4.0, "{constant}: {worst} ulp over {seen} voxels");
    }
}

#[test]
fn constant_does_not_drift_with_clamped_weights() {
    let constant = 77.3_f32;
    let image = Image::new(SIZE[0], SIZE[1], Pixels::F32(vec![constant; (SIZE[0] * SIZE[1]) as usize].into()));
    let tight = Settings { max_weight: 20.0, ..settings() };
    let mut r = PlanarReconstructor::new(tight, refusing(), full()).unwrap();
    for i in 0..3000 {
        // The pose always differs from the one before, and the columns are always the same.
        let place = DVec3::new(1e-3 * f64::from(i % 7), 0.0, -4.4);
        r.insert(&slice(DQuat::IDENTITY, place, 0.3, image.clone())).unwrap();
    }
    assert!(r.work().weights_clamped > 3000 * 1000);
    let (grid, low) = grid_around(r.volume(), r.settings());
    let once = reconstructed(&settings(), refusing(), &full(), &[slice(DQuat::IDENTITY, DVec3::Z * -4.4, 0.3, image)]);
    let (mut worst, mut seen) = (0.0_f32, 0);
    for (_, voxel) in voxels(&grid, low) {
        let (r, w) = r.volume().voxel(voxel);
        // A slice's contribution must exceed some thousand rounding units: at the very end of
        // the kernel a mean stops moving before it is right.
        if once.volume().voxel(voxel).1 > 0.2 {
            assert!(w > 3.0);
            seen += 1;
            worst = worst.max((r / w / constant - 1.0).abs());
        }
    }
    assert!(seen > 5_000 && worst <= 2e-6, "{worst} over {seen} voxels");
}

/// Compares voxels of two volumes. Returns the number that got the same slices, and the number
/// that did not (in the image's corners and at the end of the support). The third result is the
/// worst value difference, grey levels.
fn compared(a: &dyn Voxels, b: &dyn Voxels, settings: &Settings, deviation: f64) -> (usize, usize, f64) {
    let (grid, low) = grid_around(a, settings);
    let (mut same, mut differ, mut value) = (0, 0, 0.0_f64);
    for (_, voxel) in voxels(&grid, low) {
        let ((r, w), (s, v)) = (a.voxel(voxel), b.voxel(voxel));
        if f64::from((w - v).abs()) > 1e-3 + 2.0 * deviation * f64::from(w.max(v)) {
            differ += 1;
        } else if w > 0.05 {
            same += 1;
            value = value.max(f64::from((r / w - s / v).abs()));
        }
    }
    (same, differ, value)
}

#[test]
fn planar_agrees_with_general_path_within_deviation() {
    let slices = sweep(DQuat::from_rotation_y(0.9), 0.0, 9);
    let planar = reconstructed(&settings(), refusing(), &full(), &slices);
    let mut general = Reconstructor::new(planar.settings().clone(), full()).unwrap();
    for slice in &slices {
        general.insert(slice).unwrap();
    }
    let (_, deviation) = general.decimation().unwrap();
    assert!(deviation <= 0.002);
    let (same, differ, value) = compared(planar.volume(), general.volume(), planar.settings(), deviation);
    assert!(same > 15_000 && differ * 50 < same, "{differ} of {same}");
    // Numerator and weight may both deviate, and the weight at a border is a fifth.
    assert!(value <= 5.0 * 2.0 * deviation * 255.0, "{value}");
}

#[test]
fn slice_work_follows_touched_columns() {
    let mut r = PlanarReconstructor::new(settings(), refusing(), full()).unwrap();
    let slices = sweep(DQuat::IDENTITY, 0.4, 3);
    let touched = r.insert(&slices[0]).unwrap();
    let (grid, low) = grid_around(r.volume(), r.settings());
    let seen = voxels(&grid, low).filter(|(_, v)| r.volume().voxel(*v).1 > 0.0).count() as u64;
    // A voxel at the very end of the support has no weight, and may have been counted.
    assert!(touched.voxels >= seen && touched.voxels <= seen + 4 * r.volume().depth() as u64, "{touched:?} {seen}");
    let work = r.work();
    assert_eq!(work.columns_touched * r.volume().depth() as u64, touched.voxels);
    assert_eq!(work.voxels_updated, touched.voxels);
    // 14.4 mm of rows and 4.1 mm across in voxels of 0.5 mm, and the same with a whole tile
    // around it.
    let area = (14.4 * 4.1) / 0.25;
    assert!((work.columns_touched as f64 / area - 1.0).abs() < 0.1, "{} of {area}", work.columns_touched);
    assert!(work.columns_considered as f64 <= (14.4 + 11.0) * (4.1 + 11.0) / 0.25, "{work:?}");
    // The blocks that changed are those reported.
    let mut expected: Vec<BrickIndex> = r.volume().blocks().collect();
    expected.sort_by_key(|[x, y, z]| [*z, *y, *x]);
    assert_eq!(touched.bricks, expected);
    let before = bits(r.volume());
    let touched = r.insert(&slices[1]).unwrap();
    let after = bits(r.volume());
    let mut changed: Vec<BrickIndex> = after.iter().filter(|block| !before.contains(block)).map(|b| b.0).collect();
    changed.sort_by_key(|[x, y, z]| [*z, *y, *x]);
    assert_eq!(touched.bricks, changed);
    assert_eq!(r.work().slices, 2);
}

#[test]
fn memory_is_about_four_bytes_per_voxel() {
    // 40 pixels of 0.7 mm in voxels of 0.11 mm: 256 voxels along z. The sweep fills its tiles'
    // rows.
    let fine = Settings { spacing_mm: DVec3::new(0.5, 0.5, 0.11), ..settings() };
    let r = reconstructed(&fine, refusing(), &full(), &sweep(DQuat::IDENTITY, 0.0, 30));
    let volume = r.volume();
    let bytes = volume.bytes() as f64 / volume.voxels() as f64;
    assert!(bytes <= 4.0 * volume.depth().next_multiple_of(16) as f64 / volume.depth() as f64 + 0.05, "{bytes}");
    assert!(volume.tiles() > 15 && volume.depth() > 250, "{} of {}", volume.tiles(), volume.depth());
}

type Expected = fn(&Refused) -> bool;

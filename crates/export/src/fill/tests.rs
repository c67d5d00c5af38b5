//! Hole filling compared with a brute-force search of all voxels.

use glam::DMat3;
use proptest::prelude::*;

use volume::brick::offset;
use volume::brick_volume::SEEN;
use volume::{BrickVolume, Grid};

use super::reach::finest;
use super::*;

/// A lattice voxel and its value.
type Seen = ([i64; 3], f32);

fn volume(seen: &[Seen]) -> BrickVolume {
    let mut volume = BrickVolume::new();
    volume.reserve(seen.len()).unwrap();
    for (at, value) in seen {
        let (slot, _) = volume.find_or_insert(at.map(|i| i.div_euclid(8) as i32));
        let [x, y, z] = at.map(|i| i.rem_euclid(8) as usize);
        let brick = volume.brick_mut(slot);
        // Weights other than 1, and next to each a weight too small to count.
        (brick.r[offset(x, y, z)], brick.w[offset(x, y, z)]) = (value * 0.5, 0.5);
        let beside = offset((x + 1) % 8, y, z);
        if brick.w[beside] == 0.0 {
            (brick.r[beside], brick.w[beside]) = (9e9 * 0.5 * SEEN, 0.5 * SEEN);
        }
    }
    volume
}

fn space(first: [i64; 3], size: [u64; 3], spacing: [f64; 3]) -> DenseBox {
    let spacing = DVec3::from_array(spacing);
    let origin = spacing * DVec3::from_array(first.map(|i| i as f64));
    DenseBox { first, grid: Grid { origin, spacing, direction: DMat3::IDENTITY, size } }
}

/// Expected values of a box voxel, from a search of every seen voxel; `None` if it is not
/// filled.
struct Plain {
    nearest: Option<f32>,
    gaussian: Option<f64>,
}

fn plain(at: [i64; 3], seen: &[Seen], spacing: [f64; 3], radius: f64) -> Plain {
    let unit = (2.0_f64).powi(28);
    let (mut best, mut sum, mut weights) = (None, 0.0, 0.0);
    for (voxel, value) in seen {
        let squares: [f64; 3] = std::array::from_fn(|a| {
            let part = (voxel[a] - at[a]).abs() as f64 * spacing[a] / radius;
            (part * part * unit).round()
        });
        let square = squares.iter().sum::<f64>();
        if square > unit {
            continue;
        }
        let weight = (-2.0 * square / unit).exp();
        sum += weight * f64::from(*value);
        weights += weight;
        let [x, y, z] = *voxel;
        let candidate = ((square as i64, z, y, x), *value);
        if best.is_none_or(|(key, _)| candidate.0 < key) {
            best = Some(candidate);
        }
    }
    Plain { nearest: best.map(|(_, value)| value), gaussian: best.map(|_| sum / weights) }
}

fn voxels(space: &DenseBox) -> impl Iterator<Item = [i64; 3]> {
    let ([x0, y0, z0], [nx, ny, nz]) = (space.first, space.grid.size.map(|n| n as i64));
    (0..nx * ny * nz).map(move |i| [x0 + i % nx, y0 + i / nx % ny, z0 + i / (nx * ny)])
}

/// Returns all values and weights of a filled volume in a box, as bits.
fn bits(filled: &Filled<'_>, space: &DenseBox) -> Vec<[u32; 2]> {
    voxels(space)
        .map(|at| {
            let (r, w) = filled.voxel(at);
            [r.to_bits(), w.to_bits()]
        })
        .collect()
}

fn fill<'a>(
    method: FillMethod,
    radius_mm: f64,
    volume: &'a BrickVolume,
    space: &DenseBox,
    threads: usize,
) -> Filled<'a> {
    Filling { method, radius_mm }.fill(volume, space, threads, u64::MAX).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]
    #[test]
    fn filling_matches_brute_force_search(
        seen in proptest::collection::btree_map(proptest::array::uniform3(-20..20_i64), -300.0..300.0_f32, 1..60),
        spacing in prop_oneof![Just([0.5; 3]), Just([0.5, 0.5, 1.0]), proptest::array::uniform3(0.3..1.5f64)],
        steps in 1.0..6.0f64,
        first in proptest::array::uniform3(-24..12_i64),
        size in proptest::array::uniform3(1..40_u64),
    ) {
        let seen: Vec<Seen> = seen.into_iter().collect();
        let (volume, space) = (volume(&seen), space(first, size, spacing));
        // Whole and half multiples give ties, and voxels exactly at the radius.
        let radius = (steps * 2.0).round() / 2.0 * finest(spacing);
        let nearest = fill(FillMethod::Nearest, radius, &volume, &space, 1);
        let gaussian = fill(FillMethod::Gaussian, radius, &volume, &space, 1);
        let (mut filled, mut holes) = (0, FxHashMap::<[i64; 3], u64>::default());
        for at in voxels(&space) {
            let here = nearest.voxel(at);
            if let Some((_, value)) = seen.iter().find(|(voxel, _)| *voxel == at) {
                prop_assert_eq!(here, (value * 0.5, 0.5), "seen voxels are as they were");
                prop_assert_eq!(gaussian.voxel(at), here);
                continue;
            }
            *holes.entry(at.map(|i| i.div_euclid(8))).or_default() += 1;
            let plain = plain(at, &seen, spacing, radius);
            let value = |(r, w): (f32, f32)| (w == FILLED).then(|| r / w);
            prop_assert!(value(here).is_some() || here.1 <= SEEN, "what is not filled is not seen: {here:?}");
            prop_assert_eq!(value(here), plain.nearest, "at {:?} within {}", at, radius);
            match (value(gaussian.voxel(at)), plain.gaussian) {
                (Some(found), Some(expected)) => {
                    prop_assert!((f64::from(found) - expected).abs() < 300.0 * 2e-5, "{found} for {expected} at {at:?}");
                }
                (found, expected) => prop_assert_eq!(found.is_some(), expected.is_some()),
            }
            filled += u64::from(plain.nearest.is_some());
        }
        // Exactly the bricks with a hole in the box and a seen voxel within the radius along
        // each axis of their part in it.
        let near = |brick: &[i64; 3]| seen.iter().any(|(voxel, _)| (0..3).all(|a| {
            let steps = (radius / spacing[a] * (1.0 + 1e-9)).floor() as i64;
            let low = (brick[a] * 8).max(first[a]) - steps;
            (low..(brick[a] * 8 + 8).min(first[a] + size[a] as i64) + steps).contains(&voxel[a])
        }));
        let touched: Vec<u64> = holes.iter().filter(|(brick, _)| near(brick)).map(|(_, n)| *n).collect();
        for work in [nearest.work(), gaussian.work()] {
            prop_assert_eq!((work.filled, work.bricks_touched), (filled, touched.len() as u64));
            prop_assert_eq!(work.holes, touched.iter().sum::<u64>());
            prop_assert!(work.bricks_considered >= work.bricks_touched);
        }
        for (method, alone) in [(FillMethod::Nearest, &nearest), (FillMethod::Gaussian, &gaussian)] {
            for threads in [2, 3] {
                let shared = fill(method, radius, &volume, &space, threads);
                prop_assert_eq!(shared.work(), alone.work());
                prop_assert_eq!(bits(&shared, &space), bits(alone, &space), "{} threads", threads);
            }
        }
    }
}

#[test]
fn equal_distance_uses_first_lattice_voxel() {
    let all =
        [([1, 0, 0], 1.0), ([-1, 0, 0], 2.0), ([0, 1, 0], 3.0), ([0, -1, 0], 4.0), ([0, 0, 1], 5.0), ([0, 0, -1], 6.0)];
    // Lowest z, then y, then x: each removal makes the next one win.
    let order = [6.0, 4.0, 2.0, 1.0, 3.0, 5.0];
    let mut left = all.to_vec();
    for expected in order {
        let volume = volume(&left);
        let filled = fill(FillMethod::Nearest, 0.5, &volume, &space([0; 3], [1; 3], [0.5; 3]), 1);
        assert_eq!(filled.voxel([0; 3]), (-expected, FILLED), "of {left:?}");
        left.retain(|(_, value)| *value != expected);
    }
}

#[test]
fn bricks_without_reachable_holes_are_skipped() {
    // A full cube of 3×3×3 bricks except for one voxel in the middle.
    let full: Vec<Seen> = (0..24 * 24 * 24)
        .map(|i| [i % 24, i / 24 % 24, i / 576])
        .filter(|at| *at != [12, 12, 12])
        .map(|at| (at, at[0] as f32))
        .collect();
    let volume = volume(&full);
    let cube = space([0; 3], [24; 3], [1.0; 3]);
    let work = fill(FillMethod::Gaussian, 2.0, &volume, &cube, 2).work();
    assert_eq!(work, FillWork { bricks_considered: 27, bricks_touched: 1, holes: 1, filled: 1 });
    // A box next to it, of which the radius reaches a layer of two voxels.
    let beside = space([24, 0, 0], [40, 24, 24], [1.0; 3]);
    let work = fill(FillMethod::Nearest, 2.0, &volume, &beside, 1).work();
    assert_eq!((work.bricks_touched, work.holes, work.filled), (9, 9 * 512, 2 * 24 * 24));
    // A box that the radius does not reach.
    let far = space([100, 0, 0], [40, 24, 24], [1.0; 3]);
    assert_eq!(fill(FillMethod::Nearest, 2.0, &volume, &far, 1).work(), FillWork::default());
}

#[test]
fn filled_voxels_do_not_count_as_seen() {
    let volume = volume(&[([0; 3], 7.0), ([20, 3, 3], 9.0)]);
    let filled = fill(FillMethod::Nearest, 3.0, &volume, &space([-8; 3], [40; 3], [1.0; 3]), 1);
    assert!(filled.work().filled > 100);
    assert_eq!(filled.seen_bounds(), volume.seen_bounds());
    let (mut value, mut weight) = ([1.0; 3], [1.0; 3]);
    volume::Values::values(&filled, [-1, 0, 0], &mut value, &mut weight);
    assert_eq!((value, weight), ([0.0, 7.0, 0.0], [0.0, 0.5, 0.0]));
    let blocks: Vec<BrickIndex> = filled.blocks().collect();
    assert_eq!(blocks[..2], volume.blocks().collect::<Vec<_>>());
    let each: FxHashSet<_> = blocks.iter().collect();
    assert!(each.contains(&[-1, 0, 0]) && each.len() == blocks.len());
}

#[test]
fn invalid_radius_and_low_memory_are_refused() {
    let volume = volume(&[([0; 3], 7.0)]);
    let space = space([-8; 3], [16; 3], [0.5, 0.4, 1.0]);
    let refusal = |radius_mm: f64, limit: u64| {
        Filling { method: FillMethod::Nearest, radius_mm }.fill(&volume, &space, 1, limit).map(drop)
    };
    for radius in [0.39, 0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(
            matches!(refusal(radius, u64::MAX), Err(ExportError::RadiusTooSmall { nearest_mm: 0.4, .. })),
            "{radius}"
        );
    }
    assert!(matches!(refusal(13.1, u64::MAX), Err(ExportError::RadiusTooLarge { most: 32, .. })));
    assert!(matches!(refusal(1.0, 100), Err(ExportError::Memory { limit_mib: 0 })));
    assert!(refusal(0.4, u64::MAX).is_ok());
}

//! The flood by bits, and the smoothing by axes, against plain ones voxel by voxel.

use std::collections::BTreeSet;

use surface::block::Block;

use super::*;
use crate::flood::Flood;
use crate::smoothing::Smoothing;

const EDGES: DVec3 = DVec3::new(0.5, 0.4, 0.6);

/// Returns the connected voxels in the range, one by one.
fn plain(open: impl Fn([i64; 3]) -> bool, seed: [i64; 3]) -> BTreeSet<[i64; 3]> {
    let mut found = BTreeSet::new();
    let mut next = vec![seed];
    while let Some(voxel) = next.pop() {
        if open(voxel) && found.insert(voxel) {
            for (axis, step) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
                let mut beside = voxel;
                beside[axis] += step;
                next.push(beside);
            }
        }
    }
    found
}

#[test]
fn flood_by_bits_equals_flood_by_voxels() {
    // Near the share at which clusters of sites begin to span, so that paths wind through bricks.
    for share in [0.25, 0.35, 0.5, 0.9] {
        let is_within = |voxel: [i64; 3]| voxel.iter().all(|at| (-21..=18).contains(at));
        let is_unseen = |voxel: [i64; 3]| noise([voxel[1], voxel[2], voxel[0]]) < 0.05;
        let is_seed = |voxel: [i64; 3]| voxel.iter().all(|at| at.abs() <= 1);
        let open = |voxel: [i64; 3]| is_seed(voxel) || (is_within(voxel) && !is_unseen(voxel) && noise(voxel) < share);
        let value = |voxel| (is_seed(voxel) || !is_unseen(voxel)).then(|| if open(voxel) { 10.0 } else { 90.0 });
        let scene = Scene { low: [-21; 3], high: [18; 3], value };
        let smoothing = Smoothing::new(0.0, EDGES).unwrap();
        let flood = Flood::new(&scene, &smoothing, [0.0, 20.0], [0; 3], u64::MAX).unwrap();
        let expected = plain(open, [0; 3]);
        assert_eq!(flood.voxels, expected.len() as u64);
        assert!(flood.iter().collect::<BTreeSet<_>>() == expected, "{share}");
        assert!(Flood::new(&scene, &smoothing, [0.0, 20.0], [0; 3], flood.voxels).is_some());
        assert!(Flood::new(&scene, &smoothing, [0.0, 20.0], [0; 3], flood.voxels - 1).is_none());
    }
}

#[test]
fn smoothing_by_axes_equals_plain_weighted_mean() {
    let is_unseen = |voxel: [i64; 3]| noise(voxel) < 0.3;
    let value = |voxel: [i64; 3]| (!is_unseen(voxel)).then(|| (255.0 * noise([voxel[2], 7, voxel[0]])) as f32);
    let scene = Scene { low: [-3; 3], high: [30; 3], value };
    let sigma = 0.7;
    let smoothed = Smoothing::new(sigma, EDGES).unwrap().brick(&scene, [0, 1, 0], &mut Block::default());
    let reach = (3.0 * sigma / EDGES.min_element()).ceil() as i64;
    for (n, smoothed) in smoothed.iter().enumerate() {
        let voxel = [n % 8, n / 8 % 8 + 8, n / 64].map(|at| at as i64);
        let (mut sum, mut weights) = (0.0, 0.0);
        for at in 0..(2 * reach + 1).pow(3) {
            let edge = 2 * reach + 1;
            let offset = [at % edge - reach, at / edge % edge - reach, at / (edge * edge) - reach];
            let other = [0, 1, 2].map(|a| voxel[a] + offset[a]);
            let mm = DVec3::from_array(offset.map(|at| at as f64)) * EDGES;
            let weight = (-mm.length_squared() / (2.0 * sigma * sigma)).exp();
            if let Some(value) = value(other).filter(|_| other.iter().all(|at| (-3..=30).contains(at))) {
                sum += weight * f64::from(value);
                weights += weight;
            }
        }
        assert_eq!(smoothed.is_nan(), is_unseen(voxel), "{voxel:?}");
        assert!(is_unseen(voxel) || (f64::from(*smoothed) - sum / weights).abs() < 1e-3, "{voxel:?}");
    }
}

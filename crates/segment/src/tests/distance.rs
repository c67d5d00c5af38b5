//! Distances and openings against those between all pairs of voxels.

use super::*;
use crate::distance::Edges;
use crate::field::VoxelBox;

const SPACE: VoxelBox = VoxelBox { low: [0; 3], size: [13, 11, 9] };
const EDGES: Edges = Edges { size: SPACE.size, spacing: DVec3::new(0.5, 0.4, 0.7) };

/// Returns the squared distance of two voxels, mm², by the same sums.
fn squared(a: usize, b: usize) -> f32 {
    let (a, b) = (SPACE.voxel(a), SPACE.voxel(b));
    (0..3).fold(0.0, |sum, axis| {
        let mm = (a[axis] - b[axis]).abs() as f64 * EDGES.spacing[axis];
        sum + (mm * mm) as f32
    })
}

/// Some voxels, none at the border of the box.
fn some(share: f64) -> Vec<bool> {
    let is_inner = |voxel: [i64; 3]| (0..3).all(|a| voxel[a] > 0 && voxel[a] + 1 < SPACE.size[a] as i64);
    (0..SPACE.voxels()).map(|place| is_inner(SPACE.voxel(place)) && noise(SPACE.voxel(place)) < share).collect()
}

#[test]
fn distances_equal_those_of_all_pairs() {
    let set = some(0.01);
    let distances = EDGES.squared(|place| set[place], 1.5);
    for (place, distance) in distances.iter().enumerate() {
        let nearest = (0..set.len()).filter(|other| set[*other]).map(|other| squared(place, other)).fold(9e9, f32::min);
        assert!(*distance == nearest || nearest > 2.25, "{place}: {distance} for {nearest}");
    }
}

#[test]
fn opening_equals_the_union_of_balls_within() {
    for radius in [0.0_f64, 0.4, 0.75, 1.0] {
        let set = some(0.97);
        let most = (radius * radius) as f32;
        let near = |place: usize| (0..set.len()).filter(move |other| squared(place, *other) <= most);
        let centres: Vec<bool> = (0..set.len()).map(|place| near(place).all(|other| set[other])).collect();
        let expected: Vec<bool> = (0..set.len()).map(|place| near(place).any(|other| centres[other])).collect();
        assert!(EDGES.open(&set, radius).unwrap() == expected, "{radius} mm");
        assert!(radius > 0.8 || expected.iter().any(|inside| *inside));
    }
}

//! Surface nets without bricks, bits or tables: all cells of a box in f64, one after the other.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::*;
use crate::cell::BORDER;

/// A lattice edge: its lower voxel, and its axis.
type Edge = ([i64; 3], usize);

/// A cell, by its lowest voxel, and the number of the lowest edge that a sheet crosses in it.
pub(super) type Key = ([i64; 3], i64);

/// Vertices in voxels, and quads of their keys, counter-clockwise as seen from outside.
pub(super) struct Reference {
    pub(super) vertices: BTreeMap<Key, DVec3>,
    pub(super) quads: BTreeSet<[Key; 4]>,
}

/// Number of an edge in a cell.
fn number(cell: [i64; 3], (voxel, axis): Edge) -> i64 {
    let offset = |a: usize| voxel[a % 3] - cell[a % 3];
    4 * axis as i64 + offset(axis + 1) + 2 * offset(axis + 2)
}

fn step(voxel: [i64; 3], axis: usize, by: i64) -> [i64; 3] {
    let mut voxel = voxel;
    voxel[axis] += by;
    voxel
}

/// Values of voxels, `None` where unseen.
struct Voxels<'a, V>(&'a V, f64);

impl<V: Values> Voxels<'_, V> {
    fn value(&self, voxel: [i64; 3]) -> Option<f64> {
        let (mut value, mut weight) = ([0.0], [0.0]);
        self.0.values(voxel, &mut value, &mut weight);
        (weight[0] > 0.0).then_some(f64::from(value[0]))
    }

    fn is_inside(&self, voxel: [i64; 3]) -> bool {
        self.value(voxel).is_some_and(|value| value >= self.1)
    }

    fn is_crossed(&self, (voxel, axis): Edge) -> bool {
        self.is_inside(voxel) != self.is_inside(step(voxel, axis, 1))
    }

    /// Pairs of crossed edges of a face that one curve joins. The face has its lowest voxel, and
    /// lies across `axis`.
    fn curves(&self, low: [i64; 3], axis: usize) -> Vec<[Edge; 2]> {
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let edges = [(low, b), (step(low, b, 1), c), (step(low, c, 1), b), (low, c)];
        let crossed: Vec<Edge> = edges.into_iter().filter(|edge| self.is_crossed(*edge)).collect();
        match crossed.len() {
            2 => vec![[crossed[0], crossed[1]]],
            4 if self.is_inside(low) => vec![[edges[0], edges[3]], [edges[1], edges[2]]],
            4 => vec![[edges[0], edges[1]], [edges[2], edges[3]]],
            _ => Vec::new(),
        }
    }

    /// The sheets of a cell, each as the set of its crossed edges.
    fn sheets(&self, cell: [i64; 3]) -> Vec<BTreeSet<Edge>> {
        let faces = (0..3).flat_map(|axis| [(cell, axis), (step(cell, axis, 1), axis)]);
        let mut sheets: Vec<BTreeSet<Edge>> = Vec::new();
        for curve in faces.flat_map(|(low, axis)| self.curves(low, axis)) {
            let (joined, mut kept): (Vec<_>, Vec<_>) =
                sheets.into_iter().partition(|sheet| curve.iter().any(|edge| sheet.contains(edge)));
            kept.push(joined.into_iter().flatten().chain(curve).collect());
            sheets = kept;
        }
        sheets
    }

    fn is_seen(&self, cell: [i64; 3]) -> bool {
        (0..8).all(|k| self.value([0, 1, 2].map(|a| cell[a] + ((k >> a) & 1))).is_some())
    }

    /// Value at a place in a cell: the mean of its corners, weighted by the opposite volumes.
    fn trilinear(&self, cell: [i64; 3], t: DVec3) -> f64 {
        let corner = |k: i64| {
            let bits = [0, 1, 2].map(|a| (k >> a) & 1);
            let weight: f64 = (0..3).map(|a| if bits[a] == 1 { t[a] } else { 1.0 - t[a] }).product();
            weight * self.value([0, 1, 2].map(|a| cell[a] + bits[a])).unwrap_or(f64::NAN)
        };
        (0..8).map(corner).sum()
    }

    fn vertex(&self, cell: [i64; 3], sheet: &BTreeSet<Edge>) -> DVec3 {
        let crossing = |(voxel, axis): &Edge| {
            let (from, to) = (self.value(*voxel).unwrap(), self.value(step(*voxel, *axis, 1)).unwrap());
            let mut at = DVec3::from_array([0, 1, 2].map(|a| (voxel[a] - cell[a]) as f64));
            at[*axis] += (self.1 - from) / (to - from);
            at
        };
        let mean = sheet.iter().map(crossing).sum::<DVec3>() / sheet.len() as f64;
        // The values are linear along each axis: their difference over the cell is the derivative.
        let slope = |a: usize| {
            let at = |t: f64| {
                let mut place = mean;
                place[a] = t;
                self.trilinear(cell, place)
            };
            at(1.0) - at(0.0)
        };
        let gradient = DVec3::new(slope(0), slope(1), slope(2));
        let value = self.trilinear(cell, mean);
        let step = gradient * (value - self.1) / gradient.length_squared();
        let moved = if step.is_finite() { mean - step } else { mean };
        DVec3::from_array(cell.map(|at| at as f64)) + moved.clamp(DVec3::splat(BORDER), DVec3::splat(1.0 - BORDER))
    }
}

/// Meshes a box of voxels, both ends inclusive.
pub(super) fn reference<V: Values>(volume: &V, iso: f32, low: [i64; 3], high: [i64; 3]) -> Reference {
    let voxels = Voxels(volume, f64::from(iso));
    let cells = (low[2]..=high[2])
        .flat_map(|z| (low[1]..=high[1]).flat_map(move |y| (low[0]..=high[0]).map(move |x| [x, y, z])));
    let mut found = Reference { vertices: BTreeMap::new(), quads: BTreeSet::new() };
    let mut of_edge: BTreeMap<([i64; 3], Edge), Key> = BTreeMap::new();
    for cell in cells.clone().filter(|cell| voxels.is_seen(*cell)) {
        for sheet in voxels.sheets(cell) {
            let key = (cell, sheet.iter().map(|edge| number(cell, *edge)).min().unwrap());
            found.vertices.insert(key, voxels.vertex(cell, &sheet));
            of_edge.extend(sheet.iter().map(|edge| ((cell, *edge), key)));
        }
    }
    for edge in cells.flat_map(|voxel| (0..3).map(move |axis| (voxel, axis))) {
        let (voxel, axis) = edge;
        let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
        let around = [voxel, step(voxel, b, -1), step(step(voxel, b, -1), c, -1), step(voxel, c, -1)];
        let keys: Vec<Key> = around.iter().filter_map(|cell| of_edge.get(&(*cell, edge)).copied()).collect();
        if let Ok(mut quad) = <[Key; 4]>::try_from(keys) {
            if !voxels.is_inside(voxel) {
                quad.reverse();
            }
            let first = (0..4).min_by_key(|i| quad[*i]).unwrap();
            quad.rotate_left(first);
            found.quads.insert(quad);
        }
    }
    found
}

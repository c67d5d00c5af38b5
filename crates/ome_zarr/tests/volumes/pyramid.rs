//! Coarser levels: weighted means of what was seen.

use ome_zarr::{Meta, OmeZarr, Scalar};

use crate::scene::{Scene, bits, meta, read_level, tree};

/// A level in memory, in the simplest form: size along x, y, z.
struct Dense {
    size: [usize; 3],
    values: Vec<f64>,
    weights: Vec<f64>,
}

impl Dense {
    /// Returns the next level; `store` is how the files keep values.
    fn halved(&self, unseen: f64, store: impl Fn(f64) -> f64) -> Self {
        let [nx, ny, nz] = self.size;
        let size = self.size.map(|n| n.div_ceil(2));
        let mut halved = Self { size, values: Vec::new(), weights: Vec::new() };
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let (mut weight, mut sum) = (0.0, 0.0);
                    for z in 2 * z..(2 * z + 2).min(nz) {
                        for y in 2 * y..(2 * y + 2).min(ny) {
                            for x in 2 * x..(2 * x + 2).min(nx) {
                                let at = (z * ny + y) * nx + x;
                                weight += self.weights[at];
                                sum += self.weights[at] * self.values[at];
                            }
                        }
                    }
                    halved.values.push(if weight > 0.0 { store(sum / weight) } else { unseen });
                    halved.weights.push(f64::from((weight / 8.0) as f32));
                }
            }
        }
        halved
    }
}

fn compare(meta: &Meta, seed: u64, store: impl Fn(f64) -> f64 + Copy) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let scene = Scene::new(meta.clone(), seed);
    scene.write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    let wide = |all: &[f32]| all.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
    let size = meta.extent.size.map(|n| n as usize);
    let mut expected = Dense { size, values: wide(&scene.values), weights: wide(&scene.weights) };
    let unseen = f64::from(meta.unseen);
    for level in 1..volume.levels() {
        let finer = (expected.size, expected.weights.clone());
        expected = expected.halved(unseen, store);
        let (values, weights) = read_level(&volume, level);
        assert_eq!(volume.grid(level).unwrap().size.map(|n| n as usize), expected.size);
        let narrow = |all: &[f64]| all.iter().map(|v| *v as f32).collect::<Vec<_>>();
        assert_eq!(bits(&values), bits(&narrow(&expected.values)), "level {level}");
        assert_eq!(bits(&weights), bits(&narrow(&expected.weights)), "level {level}");
        // Seen iff a child is.
        let mut is_child_seen = vec![false; weights.len()];
        for (at, _) in finer.1.iter().enumerate().filter(|(_, w)| **w > 0.0) {
            let [nx, ny, _] = finer.0;
            let [x, y, z] = [at % nx, at / nx % ny, at / (nx * ny)].map(|i| i / 2);
            is_child_seen[(z * expected.size[1] + y) * expected.size[0] + x] = true;
        }
        assert!(weights.iter().zip(is_child_seen).all(|(w, seen)| (*w > 0.0) == seen));
        // The label has the same.
        let (label, _) = read_level(&OmeZarr::open(&path.join("labels/seen")).unwrap(), level);
        assert!(weights.iter().zip(label).all(|(w, seen)| f32::from(u8::from(*w > 0.0)) == seen));
    }
    assert!(volume.levels() >= 3);
}

#[test]
fn levels_equal_reference_in_double_precision() {
    compare(&meta([-48, 0, 16], [301, 21, 7], Scalar::F32), 1, |mean| f64::from(mean as f32));
    compare(&meta([0, -16, 16], [19, 259, 35], Scalar::U8), 2, f64::round_ties_even);
    compare(&meta([0, -16, 16], [3, 9, 515], Scalar::U16), 3, f64::round_ties_even);
}

#[test]
fn constant_with_holes_stays_constant() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    for (scalar, constant) in [(Scalar::U8, 201.0), (Scalar::U16, 40_001.0), (Scalar::F32, 0.1)] {
        let mut scene = Scene::new(meta([0; 3], [520, 21, 9], scalar), 4);
        for (value, weight) in scene.values.iter_mut().zip(&scene.weights) {
            *value = if *weight > 0.0 { constant } else { *value };
        }
        scene.write(&path);
        let volume = OmeZarr::open(&path).unwrap();
        for level in 0..volume.levels() {
            let (values, weights) = read_level(&volume, level);
            let seen = values.iter().zip(&weights).filter(|(_, w)| **w > 0.0);
            assert!(seen.clone().count() > 100 && seen.clone().all(|(v, _)| *v == constant), "{scalar:?} {level}");
            let unseen = values.iter().zip(&weights).filter(|(_, w)| **w == 0.0);
            assert!(unseen.clone().count() > 0 && unseen.clone().all(|(v, _)| *v == scene.meta.unseen));
        }
    }
}

#[test]
fn means_of_whole_cells_agree_to_a_millionth() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let mut scene = Scene::new(meta([0; 3], [1030, 20, 11], Scalar::F32), 6);
    // Values of one sign: their mean is not next to 0.
    scene.values.iter_mut().for_each(|value| *value = value.abs() + 1.0);
    scene.write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    let level = volume.levels() - 1;
    let (values, weights) = read_level(&volume, level);
    let (size, edge) = (volume.grid(level).unwrap().size.map(|n| n as usize), 1 << level);
    let [nx, ny, nz] = scene.meta.extent.size.map(|n| n as usize);
    for (at, (value, weight)) in values.iter().zip(&weights).enumerate() {
        let cell = [at / (size[0] * size[1]), at / size[0] % size[1], at % size[0]].map(|i| i * edge);
        let count = std::array::from_fn(|a| edge.min([nz, ny, nx][a] - cell[a]));
        let (v, w) = scene.cut(cell, count);
        let sums = v.iter().zip(&w).map(|(v, w)| (f64::from(*v) * f64::from(*w), f64::from(*w)));
        let (sum, total) = sums.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        if total > 0.0 {
            assert!((f64::from(*value) / (sum / total) - 1.0).abs() < 1e-6);
            assert!((f64::from(*weight) * 8_f64.powi(level as i32) / total - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn level_places_lie_in_the_middle_of_their_children() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let turned = glam::DMat3::from_rotation_z(0.3) * glam::DMat3::from_rotation_x(-1.1);
    for direction in [glam::DMat3::IDENTITY, turned] {
        let meta = Meta { direction, ..meta([-16, 0, 32], [600, 4, 4], Scalar::U8) };
        Scene::new(meta.clone(), 1).write(&path);
        let volume = OmeZarr::open(&path).unwrap();
        let finest = volume.world_from_volume(0).unwrap();
        assert_eq!(finest.affine(), meta.grid().world_from_volume().affine(), "bits");
        for level in 0..volume.levels() {
            let middle = glam::DVec3::splat(f64::from((1 << level) - 1) / 2.0);
            for element in [[0.0, 0.0, 0.0], [7.0, 3.0, 1.0]].map(glam::DVec3::from_array) {
                let world = finest.point(element * f64::from(1 << level) + middle);
                let by_level = volume.world_from_volume(level).unwrap().point(element);
                let by_grid = volume.grid(level).unwrap().world_from_volume().point(element);
                assert!(world.distance(by_level) < 1e-9 && world.distance(by_grid) < 1e-9);
            }
        }
        let own = tree(&path)["zarr.json"].clone();
        assert_eq!(String::from_utf8(own).unwrap().contains("world_from_volume"), direction == turned);
    }
}

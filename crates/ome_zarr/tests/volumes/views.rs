//! Renderers find the same voxels as in a volume file of another format.

use std::collections::HashSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use glam::{DMat3, DVec3};
use ome_zarr::{LevelValues, Meta, OmeZarr, Scalar};
use rayon::prelude::*;
use simd::team::Team;
use sonoweave_core::reading::PixelType;
use volume::dense::UNSEEN_FIELD;
use volume::{DenseVolume, Values};

use crate::scene::{Scene, bits, meta};

/// Writes a scene as values and weights in files of another format.
fn write_dense(scene: &Scene, folder: &Path) -> [PathBuf; 2] {
    [("v.mha", &scene.values), ("w.mha", &scene.weights)].map(|(name, voxels)| {
        let (path, meta) = (folder.join(name), &scene.meta);
        let d = meta.direction;
        let header = VolumeHeader {
            spacing: meta.spacing.to_array(),
            origin: meta.origin.to_array(),
            axes: [d.x_axis, d.y_axis, d.z_axis].map(|axis| axis.to_array()),
            fields: vec![(UNSEEN_FIELD.into(), meta.unseen.to_string())],
            ..VolumeHeader::new(meta.extent.size.map(|n| n as u32), PixelType::F32)
        };
        let mut file = VolumeWriter::create(&path, &header).unwrap();
        file.write_all(&voxels.iter().flat_map(|v| v.to_ne_bytes()).collect::<Vec<_>>()).unwrap();
        file.finish().unwrap();
        path
    })
}

/// Compares all bricks of both, and rows that cross chunks.
fn compare(dense: &DenseVolume, level: &LevelValues) {
    assert_eq!(level.placed().world_from_lattice().affine(), dense.world_from_lattice().affine());
    assert_eq!(level.placed().bounds(), dense.bounds());
    let offered: HashSet<_> = level.bricks().collect();
    let bricks: Vec<_> = dense.bricks().collect();
    assert!(bricks.iter().all(|brick| offered.contains(brick)));
    assert_eq!(offered.len(), level.bricks().count(), "each brick once");
    let all: HashSet<_> = offered.into_iter().chain(bricks).collect();
    all.into_par_iter().for_each(|brick| {
        let read = |volume: &dyn Values| {
            let (mut value, mut weight) = ([9.0; 512], [9.0; 512]);
            volume.brick(brick, &mut value, &mut weight);
            (bits(&value), bits(&weight))
        };
        assert!(read(dense) == read(level), "{brick:?}");
    });
    let [low, high] = dense.bounds();
    for z in low[2] - 1..=high[2] + 1 {
        let read = |volume: &dyn Values| {
            let (mut value, mut weight) = ([9.0; 70], [9.0; 70]);
            volume.values([low[0] - 5, (low[1] + high[1]) / 2, z], &mut value, &mut weight);
            (bits(&value), bits(&weight))
        };
        assert!(read(dense) == read(level));
    }
    assert!(level.fault().is_none());
}

#[test]
fn bits_are_those_of_dense_volume() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let away = DVec3::new(0.13, -7.77, 1e3 / 3.0);
    for (direction, origin) in
        [(DMat3::IDENTITY, DVec3::new(-8.0, 4.0, 4.8)), (DMat3::IDENTITY, away), (turned, DVec3::ONE), (turned, away)]
    {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ome.zarr");
        let meta = Meta { direction, origin, ..meta([-16, 16, 16], [53, 21, 34], Scalar::F32) };
        let scene = Scene::new(meta, 20);
        scene.write(&path);
        let [values, weights] = write_dense(&scene, folder.path());
        let dense = DenseVolume::open(&values, Some(&weights), u64::MAX).unwrap();
        // Enough for a few chunks only, and for none.
        for bytes in [1 << 20, 20_000, 0] {
            compare(&dense, &LevelValues::new(&OmeZarr::open(&path).unwrap(), 0, bytes).unwrap());
        }
        std::fs::remove_dir_all(path.join("weight")).unwrap();
        let dense = DenseVolume::open(&values, None, u64::MAX).unwrap();
        compare(&dense, &LevelValues::new(&OmeZarr::open(&path).unwrap(), 0, 1 << 20).unwrap());
    }
}

#[test]
fn box_to_view_is_that_of_the_slices() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let slices_box = Some([[-20, 14, 16], [41, 40, 30]]);
    let meta = Meta { slices_box, ..meta([-16, 16, 16], [140, 21, 34], Scalar::U8) };
    Scene::new(meta, 21).write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    assert_eq!(volume.slices_box(), slices_box);
    let level = LevelValues::new(&volume, 0, 1 << 20).unwrap();
    assert_eq!(level.placed().bounds(), [[-4, -2, 0], [57, 24, 14]].map(|element| level.placed().index(element)));
    let coarse = LevelValues::new(&volume, 1, 1 << 20).unwrap();
    // As in a volume read slice by slice.
    assert_eq!(coarse.placed().bounds(), [[-2, -1, 0], [28, 12, 7]].map(|element| coarse.placed().index(element)));
    assert_eq!(coarse.placed().grid().size, [70, 11, 17]);
}

#[test]
fn loaded_chunks_are_read_once_by_any_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    Scene::new(meta([-16, 16, 16], [53, 41, 34], Scalar::F32), 22).write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    let team = Team::new("test", 4).unwrap();
    for team in [None, team.as_ref()] {
        let level = LevelValues::new(&volume, 0, 1 << 20).unwrap();
        let bricks: Vec<_> = level.bricks().collect();
        let before = level.work();
        assert_eq!((before.chunks_read, level.range(team)), (0, [0.0, 255.0]), "the range is known");
        assert_eq!(level.groups(&bricks).map(<[_]>::len).sum::<usize>(), bricks.len());
        let (first, rest) = bricks.split_at(bricks.len() / 2);
        level.load(first, team);
        let half = level.work();
        assert!((1..half.chunks).contains(&half.chunks_read), "{half:?}");
        level.load(rest, team);
        let loaded = level.work();
        assert_eq!(loaded.chunks_read, loaded.chunks, "{loaded:?}");
        assert!(loaded.bytes_read > half.bytes_read && half.bytes_read > before.bytes_read);
        bricks.par_iter().for_each(|brick| level.brick(*brick, &mut [0.0; 512], &mut [0.0; 512]));
        assert_eq!(level.work(), loaded, "nothing is read again");
    }
}

//! Written voxels are read again, bit for bit.

use ome_zarr::{Extent, OmeZarr, OmeZarrWriter, Samples, Scalar};
use proptest::prelude::*;

use crate::scene::{Scene, bits, meta, read_level, tree};

const SCALARS: [Scalar; 3] = [Scalar::U8, Scalar::U16, Scalar::F32];

#[test]
fn values_and_weights_of_all_types_keep_their_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    for scalar in SCALARS {
        for (first, size) in [([-32, 0, 48], [37, 1, 5]), ([0, -160, -16], [150, 33, 17]), ([16, 16, 16], [1, 1, 1])] {
            let mut scene = Scene::new(meta(first, size, scalar), size[0]);
            // Something is seen in any case.
            (scene.values[0], scene.weights[0]) = (7.0, 0.25);
            scene.write(&path);
            let volume = OmeZarr::open(&path).unwrap();
            let (values, weights) = read_level(&volume, 0);
            assert_eq!((bits(&values), bits(&weights)), (bits(&scene.values), bits(&scene.weights)), "{scalar:?}");
            assert_eq!(volume.first(0).unwrap(), first);
            assert_eq!(volume.grid(0).unwrap(), scene.meta.grid());
            assert_eq!(volume.fields(), scene.meta.fields);
            assert_eq!(volume.content_key(), Some("key"));
            assert_eq!((volume.range().unwrap(), volume.notes().len()), ([0.0, 255.0], 0));
            assert!(volume.is_own() && volume.has_weights());
        }
    }
}

#[test]
fn shard_of_full_size_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let extent = Extent::around([[-5, 0, 3], [130, 20, 9]]);
    let scene = Scene::new(ome_zarr::Meta { extent, ..meta([0; 3], [1; 3], Scalar::U8) }, 1);
    scene.write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    assert_eq!((volume.levels(), volume.first(1).unwrap()), (3, [-64, 0, 0]));
    assert_eq!(bits(&read_level(&volume, 0).0), bits(&scene.values));
}

#[test]
fn unseen_value_may_be_no_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    for unseen in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, 1e-40] {
        let mut meta = meta([0; 3], [20, 3, 2], Scalar::F32);
        meta.unseen = unseen;
        let scene = Scene::new(meta, 5);
        scene.write(&path);
        let volume = OmeZarr::open(&path).unwrap();
        assert_eq!(bits(&read_level(&volume, 0).0), bits(&scene.values), "{unseen}");
        std::fs::remove_dir_all(path.join("weight")).unwrap();
        let without = OmeZarr::open(&path).unwrap();
        let seen: Vec<f32> = scene.weights.iter().map(|w| f32::from(u8::from(*w > 0.0))).collect();
        assert_eq!(read_level(&without, 0).1, seen, "{unseen}");
    }
}

#[test]
fn filled_voxels_keep_value_and_weight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let (writer, _) = OmeZarrWriter::create(&path, &meta([0; 3], [130, 1, 1], Scalar::U8)).unwrap();
    let mut weights = [0.0; 16];
    weights[3] = -1.0;
    writer.shards().write_shard([0, 0, 0], Samples::U8(&[9; 16]), &weights).unwrap();
    writer.finish().unwrap();
    let volume = OmeZarr::open(&path).unwrap();
    let (values, read) = volume.read(0, [0; 3], [16, 1, 1]).unwrap();
    assert_eq!((values[3], values[4], read.as_slice()), (9.0, 3.0, &weights[..]));
    assert!(read_level(&volume, 1).1.iter().all(|w| *w == 0.0), "filled voxels are not seen");
}

#[test]
fn empty_space_has_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let meta = meta([0; 3], [200, 40, 40], Scalar::F32);
    let (writer, _) = OmeZarrWriter::create(&path, &meta).unwrap();
    let (values, mut weights) = (vec![5.0; 4096], vec![0.0; 4096]);
    writer.shards().write_shard([1, 1, 1], Samples::F32(&values), &weights).unwrap();
    writer.shards().leave_out([1, 1, 2]).unwrap();
    weights[77] = 1.0;
    writer.shards().write_shard([1, 1, 4], Samples::F32(&values), &weights).unwrap();
    assert!([[1, 1, 1], [1, 1, 2], [1, 1, 4]].iter().all(|index| writer.shards().is_done(0, *index)));
    assert!(!writer.shards().is_done(0, [0, 0, 0]));
    writer.finish().unwrap();
    let files = tree(&path);
    let shards: Vec<&String> = files.keys().filter(|key| key.contains("/c/")).collect();
    let expected = ["0/c/1/1/4", "1/c/0/0/2", "labels/seen/0/c/1/1/4", "labels/seen/1/c/0/0/2"];
    assert_eq!(shards[..4], expected);
    assert_eq!(shards[4..], ["weight/0/c/1/1/4", "weight/1/c/0/0/2"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn boxes_of_any_place_and_size_are_those_of_the_volume(
        first in proptest::array::uniform3(-3..3i64),
        size in proptest::array::uniform3(1..40u64),
        scalar in 0..3usize,
        seed in 0..1000u64,
        boxes in proptest::collection::vec((proptest::array::uniform3(-9..45i64), proptest::array::uniform3(0..30u64)), 5),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ome.zarr");
        let first = first.map(|at| at * 16);
        let scene = Scene::new(meta(first, size, SCALARS[scalar]), seed);
        scene.write(&path);
        let volume = OmeZarr::open(&path).unwrap();
        for (start, count) in boxes {
            let from = std::array::from_fn(|a| first[a] + start[a]);
            let (values, weights) = volume.read(0, from, count).unwrap();
            let mut at = 0;
            for z in start[2]..start[2] + count[2] as i64 {
                for y in start[1]..start[1] + count[1] as i64 {
                    for x in start[0]..start[0] + count[0] as i64 {
                        let inside = [x, y, z].iter().zip(size).all(|(at, n)| (0..n as i64).contains(at));
                        let element = if inside { scene.cut([z, y, x].map(|at| at as usize), [1; 3]) }
                            else { (vec![scene.meta.unseen], vec![0.0]) };
                        prop_assert_eq!((values[at], weights[at]), (element.0[0], element.1[0]));
                        at += 1;
                    }
                }
            }
            prop_assert_eq!(values.len(), at);
        }
    }
}

//! Neither the order of shards nor the number of threads changes a byte; memory is bounded.

use std::path::Path;

use ome_zarr::{OmeZarrWriter, Scalar, ShardIndex};
use rayon::prelude::*;

use crate::scene::{Scene, meta, tree};

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Writes a volume and returns the most shards in memory, before the pyramid and with it.
fn write(scene: &Scene, path: &Path, order: &[ShardIndex], threads: usize) -> usize {
    let (writer, _) = OmeZarrWriter::create(path, &scene.meta).unwrap();
    pool(threads).install(|| {
        order.par_iter().for_each(|index| scene.write_shard(writer.shards(), *index).unwrap());
        // Some parents by hand, as far as their children are done.
        writer.write_parent(1, [0, 0, 0]).unwrap();
        let most = writer.shards().most_shards_in_memory();
        writer.finish().unwrap();
        most
    })
}

#[test]
fn bytes_are_those_of_one_thread_in_order() {
    let folder = tempfile::tempdir().unwrap();
    for scalar in [Scalar::U8, Scalar::F32] {
        let scene = Scene::new(meta([-32, 16, 0], [140, 30, 20], scalar), 8);
        let mut order: Vec<ShardIndex> = scene.meta.extent.shard_indices(0).collect();
        let path = folder.path().join("one.ome.zarr");
        write(&scene, &path, &order, 1);
        let expected = tree(&path);
        for (number, threads) in [1, 2, 8].into_iter().enumerate() {
            fastrand::Rng::with_seed(number as u64).shuffle(&mut order);
            let path = folder.path().join("other.ome.zarr");
            write(&scene, &path, &order, threads);
            assert!(tree(&path) == expected, "{threads} threads");
        }
    }
}

#[test]
fn shards_in_memory_do_not_grow_with_the_volume() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    for threads in [1, 2] {
        for size in [[140, 20, 20], [280, 40, 40]] {
            let scene = Scene::new(meta([0; 3], size, Scalar::U16), 9);
            let order: Vec<ShardIndex> = scene.meta.extent.shard_indices(0).collect();
            let most = write(&scene, &path, &order, threads);
            assert!((1..=6 * threads).contains(&most), "{most} shards, {threads} threads, {size:?}");
        }
    }
}

#[test]
fn changed_shard_renews_its_parents() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let (old, new) =
        (Scene::new(meta([0; 3], [300, 20, 9], Scalar::U8), 1), Scene::new(meta([0; 3], [300, 20, 9], Scalar::U8), 2));
    new.write(&path);
    let expected = tree(&path);
    let path = folder.path().join("b.ome.zarr");
    let (writer, _) = OmeZarrWriter::create(&path, &old.meta).unwrap();
    for scene in [&old, &new] {
        for index in scene.meta.extent.shard_indices(0) {
            scene.write_shard(writer.shards(), index).unwrap();
        }
        for level in [1, 2] {
            for index in scene.meta.extent.shard_indices(level).filter(|index| !writer.shards().is_done(level, *index))
            {
                writer.write_parent(level, index).unwrap();
            }
        }
    }
    writer.shards().leave_out([0, 0, 3]).unwrap();
    assert!(!writer.shards().is_done(1, [0, 0, 1]) && writer.shards().is_done(1, [0, 0, 0]));
    new.write_shard(writer.shards(), [0, 0, 3]).unwrap();
    writer.finish().unwrap();
    assert!(tree(&path) == expected);
}

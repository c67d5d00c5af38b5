//! Writers of regions beside each other give the files of one writer.

use std::path::Path;

use ome_zarr::{Begun, Meta, OmeZarrError, OmeZarrWriter, RegionWriter, Scalar, ShardIndex, plan_path};

use crate::scene::{Scene, meta, tree};

fn scene() -> Scene {
    Scene::new(meta([-16, 0, 16], [150, 37, 20], Scalar::F32), 5)
}

/// Deals the shards of level 0 to so many regions.
fn regions(scene: &Scene, count: usize) -> Vec<Vec<ShardIndex>> {
    let mut regions = vec![Vec::new(); count];
    scene.meta.extent.shard_indices(0).enumerate().for_each(|(at, shard)| regions[at % count].push(shard));
    regions
}

fn begin(path: &Path, meta: &Meta) {
    drop(OmeZarrWriter::create(path, meta).unwrap());
}

fn write(scene: &Scene, mut writer: RegionWriter, shards: &[ShardIndex], name: &str) {
    shards.iter().for_each(|shard| scene.write_shard(writer.shards(), *shard).unwrap());
    writer.finish(name, &format!("region {name} has {} shards", shards.len())).unwrap();
}

#[test]
fn regions_written_beside_each_other_are_the_whole() {
    let scene = scene();
    let folder = tempfile::tempdir().unwrap();
    let [whole, path] = ["whole.ome.zarr", "a.ome.zarr"].map(|name| folder.path().join(name));
    scene.write(&whole);
    begin(&path, &scene.meta);
    std::fs::write(plan_path(&path), "{}").unwrap();
    let regions = regions(&scene, 5);
    std::thread::scope(|scope| {
        for (at, shards) in regions.iter().enumerate() {
            let (scene, path) = (&scene, &path);
            // The third is written by two at once.
            for _ in 0..if at == 2 { 2 } else { 1 } {
                scope.spawn(move || {
                    write(scene, RegionWriter::join(path, &scene.meta).unwrap(), shards, &at.to_string());
                });
            }
        }
    });
    let (writer, begun) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    let shards = scene.meta.extent.shard_indices(0).count();
    assert_eq!(begun, Begun::Continued { shards: 3 * shards });
    let notes = writer.notes().unwrap();
    assert_eq!(notes.len(), 5);
    assert_eq!(notes["2"], format!("region 2 has {} shards", regions[2].len()));
    assert!(plan_path(&path).is_file());
    writer.finish().unwrap();
    assert!(tree(&path) == tree(&whole));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn region_without_its_log_is_written_again() {
    let scene = scene();
    let folder = tempfile::tempdir().unwrap();
    let [whole, path] = ["whole.ome.zarr", "a.ome.zarr"].map(|name| folder.path().join(name));
    scene.write(&whole);
    begin(&path, &scene.meta);
    let [first, second] = regions(&scene, 2).try_into().unwrap();
    write(&scene, RegionWriter::join(&path, &scene.meta).unwrap(), &first, "0");
    // A writer that ends in its midst leaves shards and a half one.
    let ended = RegionWriter::join(&path, &scene.meta).unwrap();
    scene.write_shard(ended.shards(), second[0]).unwrap();
    drop(ended);
    let part = folder.path().join("a.ome.zarr.part");
    std::fs::write(part.join("0/c/0/0/.sonoweave-abc.part"), "half").unwrap();
    std::fs::write(part.join("regions/1.log"), "sonoweave-ome-zarr-1 abc\nnote other\n").unwrap();
    let writer = RegionWriter::join(&path, &scene.meta).unwrap();
    assert!(first.iter().all(|shard| writer.shards().is_done(0, *shard)));
    assert!(second.iter().all(|shard| !writer.shards().is_done(0, *shard)));
    write(&scene, writer, &second, "1");
    OmeZarrWriter::create(&path, &scene.meta).unwrap().0.finish().unwrap();
    assert!(tree(&path) == tree(&whole));
}

#[test]
fn pyramid_follows_a_region_that_is_written_anew() {
    let mut scene = scene();
    let folder = tempfile::tempdir().unwrap();
    let [whole, path] = ["whole.ome.zarr", "a.ome.zarr"].map(|name| folder.path().join(name));
    let shards: Vec<ShardIndex> = scene.meta.extent.shard_indices(0).collect();
    begin(&path, &scene.meta);
    write(&scene, RegionWriter::join(&path, &scene.meta).unwrap(), &shards, "0");
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    writer.write_parent(1, [0, 0, 0]).unwrap();
    drop(writer);
    scene.values.iter_mut().for_each(|value| *value += 1.0);
    scene.write(&whole);
    write(&scene, RegionWriter::join(&path, &scene.meta).unwrap(), &shards, "0");
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    assert!(!writer.shards().is_done(1, [0, 0, 0]));
    writer.finish().unwrap();
    assert!(tree(&path) == tree(&whole));
}

#[test]
fn region_of_no_begun_volume_is_refused() {
    let scene = scene();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let refused = |meta: &Meta| RegionWriter::join(&path, meta).err().unwrap();
    assert!(matches!(refused(&scene.meta), OmeZarrError::NotBegun { .. }));
    let (whole, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    assert!(matches!(refused(&scene.meta), OmeZarrError::Busy { .. }));
    drop(whole);
    let before = tree(folder.path());
    let other = Meta { content_key: "other".into(), ..scene.meta.clone() };
    assert!(matches!(refused(&other), OmeZarrError::NotBegun { .. }));
    assert!(tree(folder.path()) == before);
    let region = RegionWriter::join(&path, &scene.meta).unwrap();
    // No writer of the whole while a region is written.
    assert!(matches!(OmeZarrWriter::create(&path, &scene.meta), Err(OmeZarrError::Busy { .. })));
    drop(region);
    OmeZarrWriter::create(&path, &scene.meta).unwrap();
}

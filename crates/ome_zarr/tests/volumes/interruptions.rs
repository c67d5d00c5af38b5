//! A writer that goes on after another gives the files of one that was not interrupted.

use std::collections::BTreeMap;
use std::path::Path;

use ome_zarr::{Begun, Meta, OmeZarrError, OmeZarrWriter, Scalar, ShardIndex};

use crate::scene::{Scene, meta, tree};

fn scene() -> Scene {
    Scene::new(meta([-16, 0, 0], [262, 16, 9], Scalar::U16), 3)
}

/// All shards of all levels, in the order in which they are written.
fn steps(meta: &Meta) -> Vec<(usize, ShardIndex)> {
    (0..meta.extent.levels()).flat_map(|level| meta.extent.shard_indices(level).map(move |i| (level, i))).collect()
}

fn write(scene: &Scene, writer: &OmeZarrWriter, (level, index): (usize, ShardIndex)) {
    if level == 0 { scene.write_shard(writer.shards(), index) } else { writer.write_parent(level, index) }.unwrap();
}

fn uninterrupted(scene: &Scene) -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    scene.write(&path);
    tree(&path)
}

/// Goes on with a volume, and finishes it.
fn finish(scene: &Scene, path: &Path) -> Begun {
    let (writer, begun) = OmeZarrWriter::create(path, &scene.meta).unwrap();
    for step in steps(&scene.meta) {
        if !writer.shards().is_done(step.0, step.1) {
            write(scene, &writer, step);
        }
    }
    writer.finish().unwrap();
    begun
}

#[test]
fn writer_stopped_at_any_shard_is_continued() {
    let scene = scene();
    let (expected, steps) = (uninterrupted(&scene), steps(&scene.meta));
    assert!(steps.len() > 20);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    for stop in 0..=steps.len() {
        let (writer, begun) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
        assert_eq!(begun, Begun::New);
        steps[..stop].iter().for_each(|step| write(&scene, &writer, *step));
        drop(writer);
        assert_eq!(finish(&scene, &path), Begun::Continued { shards: 3 * stop });
        assert!(tree(&path) == expected, "stopped at {stop}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "the unfinished volume is gone");
        std::fs::remove_dir_all(&path).unwrap();
    }
}

#[test]
fn damaged_rests_of_an_interruption_are_written_again() {
    let scene = scene();
    let expected = uninterrupted(&scene);
    let folder = tempfile::tempdir().unwrap();
    let (path, part) = (folder.path().join("a.ome.zarr"), folder.path().join("a.ome.zarr.part"));
    let rests: [&dyn Fn(); 8] = [
        &|| std::fs::write(part.join("0/c/0/0/.sonoweave-abc.part"), "half").unwrap(),
        &|| std::fs::write(part.join("0/c/0/0/0"), "short").unwrap(),
        &|| std::fs::remove_file(part.join("weight/0/c/0/0/2")).unwrap(),
        &|| std::fs::remove_file(part.join("0/zarr.json")).unwrap(),
        &|| std::fs::write(part.join("weight/zarr.json"), "{").unwrap(),
        &|| std::fs::write(part.join("zarr.json"), "{}").unwrap(),
        &|| std::fs::write(part.join("1/c/0/0/0"), "a file without its line").unwrap(),
        &|| {
            let mut log = std::fs::read(part.join("shards.log")).unwrap();
            log.truncate(log.len() - 9);
            std::fs::write(part.join("shards.log"), log).unwrap();
        },
    ];
    for (number, damage) in rests.into_iter().enumerate() {
        let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
        for step in steps(&scene.meta).into_iter().filter(|(level, _)| *level == 0) {
            write(&scene, &writer, step);
        }
        if number == 6 {
            std::fs::create_dir_all(part.join("1/c/0/0")).unwrap();
        }
        drop(writer);
        damage();
        assert!(matches!(finish(&scene, &path), Begun::Continued { .. }));
        assert!(tree(&path) == expected, "rest {number}");
    }
}

#[test]
fn other_description_starts_anew() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let first = scene();
    let change: [&dyn Fn(&mut Meta); 5] = [
        &|meta| meta.content_key = "other".into(),
        &|meta| meta.fields[0].1 = "2".into(),
        &|meta| meta.spacing.x *= 1.0 + f64::EPSILON,
        &|meta| meta.label = false,
        &|meta| meta.extent.first[2] += 16,
    ];
    for change in change {
        let (writer, begun) = OmeZarrWriter::create(&path, &first.meta).unwrap();
        assert!(matches!(begun, Begun::New | Begun::Anew));
        write(&first, &writer, (0, [0, 0, 1]));
        drop(writer);
        let mut second = scene();
        change(&mut second.meta);
        let (writer, begun) = OmeZarrWriter::create(&path, &second.meta).unwrap();
        assert_eq!(begun, Begun::Anew);
        assert!(!writer.shards().is_done(0, [0, 0, 1]));
        assert_eq!(tree(&folder.path().join("a.ome.zarr.part")).keys().filter(|key| key.contains("/c/")).count(), 0);
    }
}

#[test]
fn earlier_volume_stays_until_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let earlier = Scene::new(meta([0; 3], [30, 5, 5], Scalar::F32), 1);
    earlier.write(&path);
    let before = tree(&path);
    let scene = scene();
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    steps(&scene.meta).into_iter().for_each(|step| write(&scene, &writer, step));
    assert!(tree(&path) == before);
    let part = folder.path().join("a.ome.zarr.part");
    assert!(!part.join("zarr.json").exists(), "the root is written last");
    writer.finish().unwrap();
    assert!(tree(&path) == uninterrupted(&scene));
    assert!(!part.exists());
}

#[test]
fn volume_behind_a_link_is_replaced_and_the_link_stays() {
    let (folder, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (path, link) = (folder.path().join("a.ome.zarr"), other.path().join("b.ome.zarr"));
    Scene::new(meta([0; 3], [30, 5, 5], Scalar::F32), 1).write(&path);
    std::os::unix::fs::symlink(&path, &link).unwrap();
    let scene = scene();
    scene.write(&link);
    assert!(link.is_symlink() && tree(&path) == uninterrupted(&scene));
    assert_eq!([&folder, &other].map(|folder| std::fs::read_dir(folder.path()).unwrap().count()), [1, 1]);
}

#[test]
fn refused_write_leaves_the_rest_to_go_on() {
    let scene = scene();
    let expected = uninterrupted(&scene);
    let folder = tempfile::tempdir().unwrap();
    let (path, part) = (folder.path().join("a.ome.zarr"), folder.path().join("a.ome.zarr.part"));
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    // Neither a full disk nor missing permission can be had everywhere: a folder is in the way.
    std::fs::create_dir_all(part.join("weight/0/c/0/0/4/in the way")).unwrap();
    let refused = scene.write_shard(writer.shards(), [0, 0, 4]).unwrap_err();
    assert!(matches!(&refused, OmeZarrError::Io { path, .. } if path.ends_with("a.ome.zarr.part/weight/0/c/0/0/4")));
    assert!(!writer.shards().is_done(0, [0, 0, 4]));
    drop(writer);
    assert!(!path.exists());
    finish(&scene, &path);
    assert!(tree(&path) == expected);
}

//! Damaged files are refused with a sentence, or give the same voxels; never others.

use std::path::Path;

use ome_zarr::{LevelValues, OmeZarr, OmeZarrError, OmeZarrWriter, Scalar};
use volume::Values as _;

use crate::scene::{Scene, bits, meta, read_level, tree};

fn scene() -> Scene {
    Scene::new(meta([0; 3], [21, 17, 9], Scalar::U8), 12)
}

/// Reads everything; all voxels of level 0 as bits.
fn read_all(path: &Path) -> Result<(Vec<u32>, Vec<u32>), OmeZarrError> {
    let volume = OmeZarr::open(path)?;
    let (values, weights) = volume.read(0, [0; 3], [21, 17, 9])?;
    Ok((bits(&values), bits(&weights)))
}

#[test]
fn every_changed_byte_of_a_shard_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let scene = scene();
    scene.write(&path);
    let expected = (bits(&scene.values), bits(&scene.weights));
    assert!(read_all(&path).unwrap() == expected);
    for key in ["0/c/0/1/1", "weight/0/c/0/0/1"] {
        let file = path.join(key);
        let whole = std::fs::read(&file).unwrap();
        for at in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[at] ^= 1 << (at % 8);
            std::fs::write(&file, damaged).unwrap();
            match read_all(&path) {
                Err(OmeZarrError::Damaged { key: named, .. }) => assert!(key.starts_with(&format!("{named}/"))),
                other => panic!("byte {at} of {key}: {:?}", other.map(|read| read == expected)),
            }
        }
        for length in [0, 1, 15, 20, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&file, &whole[..length]).unwrap();
            assert!(matches!(read_all(&path), Err(OmeZarrError::Damaged { .. })), "{length} bytes of {key}");
        }
        std::fs::write(&file, whole).unwrap();
    }
}

#[test]
fn damaged_child_is_named_and_no_volume_appears() {
    let folder = tempfile::tempdir().unwrap();
    let (path, part) = (folder.path().join("a.ome.zarr"), folder.path().join("a.ome.zarr.part"));
    let scene = Scene::new(meta([0; 3], [140, 17, 9], Scalar::F32), 13);
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    for index in scene.meta.extent.shard_indices(0) {
        scene.write_shard(writer.shards(), index).unwrap();
    }
    let file = part.join("weight/0/c/0/0/3");
    let mut damaged = std::fs::read(&file).unwrap();
    damaged[100] ^= 4;
    std::fs::write(&file, &damaged).unwrap();
    let error = writer.write_parent(1, [0, 0, 1]).unwrap_err();
    assert!(matches!(&error, OmeZarrError::Damaged { key, .. } if key == "weight/0/c/0/0/3"), "{error}");
    assert!(matches!(writer.finish(), Err(OmeZarrError::Damaged { .. })));
    assert!(!path.exists());
}

#[test]
fn changed_metadata_is_refused_or_harmless() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let scene = scene();
    scene.write(&path);
    let mut random = fastrand::Rng::with_seed(1);
    for key in ["zarr.json", "0/zarr.json", "weight/zarr.json", "weight/0/zarr.json"] {
        let file = path.join(key);
        let whole = std::fs::read(&file).unwrap();
        for _ in 0..300 {
            let mut damaged = whole.clone();
            match random.u8(..3) {
                0 => damaged[random.usize(..whole.len())] = *b"0123456789\"[]{},.:-ex".get(random.usize(..21)).unwrap(),
                1 => damaged.truncate(random.usize(..whole.len())),
                _ => drop(damaged.drain(random.usize(..whole.len())..).take(3).collect::<Vec<_>>()),
            }
            std::fs::write(&file, damaged).unwrap();
            if let Ok(volume) = OmeZarr::open(&path) {
                let grid = volume.grid(0).unwrap();
                if grid.voxels().is_some_and(|n| n < 1 << 20) {
                    let _ = volume.read(0, volume.first(0).unwrap(), grid.size);
                }
            }
        }
        std::fs::write(&file, whole).unwrap();
    }
}

#[test]
fn missing_parts_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let scene = scene();
    scene.write(&path);
    let sentence = |error: OmeZarrError| error.to_string().replace(&*path.to_string_lossy(), "v");
    let without = |key: &str| {
        let aside = folder.path().join("aside");
        std::fs::rename(path.join(key), &aside).unwrap();
        let error = OmeZarr::open(&path).err();
        std::fs::rename(&aside, path.join(key)).unwrap();
        sentence(error.unwrap())
    };
    assert_eq!(
        without("zarr.json"),
        "v: has no zarr.json, and is no OME-Zarr volume; give the folder that holds this file"
    );
    for (key, array) in [("0", "0"), ("weight/0", "weight/0"), ("weight/0/zarr.json", "weight/0")] {
        let expected = format!("array {array} cannot be read: {array}/zarr.json is missing; copy or convert");
        assert!(without(key).contains(&expected), "{}", without(key));
    }
    // A shard that is missing has nothing seen: only the whole folder knows that it was there.
    let files = tree(&path).len();
    std::fs::remove_file(path.join("0/c/0/0/0")).unwrap();
    let (values, _) = read_level(&OmeZarr::open(&path).unwrap(), 0);
    assert!(values[0] == scene.meta.unseen && tree(&path).len() == files - 1);
}

#[test]
fn renderers_see_nothing_where_data_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    scene().write(&path);
    let file = path.join("0/c/0/0/0");
    let mut damaged = std::fs::read(&file).unwrap();
    damaged[3] ^= 1;
    std::fs::write(&file, &damaged).unwrap();
    let values = LevelValues::new(&OmeZarr::open(&path).unwrap(), 0, 1 << 20).unwrap();
    let (mut value, mut weight) = ([9.0; 21], [9.0; 21]);
    let start = values.placed().index([0, 0, 0]);
    values.values(start, &mut value, &mut weight);
    assert_eq!((&value[..8], &weight[..8]), (&[0.0; 8][..], &[0.0; 8][..]));
    assert!(weight[8..].iter().any(|w| *w > 0.0), "other chunks are read");
    assert!(matches!(values.fault(), Some(OmeZarrError::Damaged { .. })));
    assert!(values.fault().is_none());
}

#[test]
fn shards_in_each_others_place_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    // Two shards of one value each: their files have the same length, and decode without fault.
    let mut scene = Scene::new(meta([0; 3], [144, 16, 16], Scalar::U8), 1);
    for (at, (value, weight)) in scene.values.iter_mut().zip(&mut scene.weights).enumerate() {
        (*value, *weight) = (if at % 32 < 16 { 50.0 } else { 60.0 }, 1.0);
    }
    let (writer, _) = OmeZarrWriter::create(&path, &scene.meta).unwrap();
    for index in [[0, 0, 0], [0, 0, 1]] {
        scene.write_shard(writer.shards(), index).unwrap();
    }
    let [a, b] = ["0/c/0/0/0", "0/c/0/0/1"].map(|key| folder.path().join("a.ome.zarr.part").join(key));
    let [first, second] = [&a, &b].map(|file| std::fs::read(file).unwrap());
    assert!(first.len() == second.len() && first != second);
    std::fs::write(&a, second).unwrap();
    std::fs::write(&b, first).unwrap();
    assert!(matches!(writer.write_parent(1, [0, 0, 0]), Err(OmeZarrError::Damaged { .. })));
}

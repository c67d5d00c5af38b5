//! Refusals say what is wrong, where, and what to do; nothing changes.

use std::path::Path;

use ome_zarr::{BadMeta, BadShard, Begun, Meta, OmeZarr, OmeZarrError, OmeZarrWriter, Samples, Scalar};

use crate::scene::{Scene, meta, tree};

/// A change of a description.
type Change<'a> = &'a dyn Fn(&mut Meta);

fn small() -> Meta {
    meta([0; 3], [20, 5, 5], Scalar::U8)
}

fn refused(path: &Path, meta: &Meta) -> OmeZarrError {
    OmeZarrWriter::create(path, meta).err().unwrap()
}

#[test]
fn descriptions_without_meaning_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let size = "a volume must have at least one voxel along each axis, and at most 2⁶² in all";
    let place = "the spacing must be positive, the origin finite, and the direction three axes that span space";
    let change: [(Change, &str); 11] = [
        (&|meta| meta.extent.size[1] = 0, size),
        (&|meta| meta.extent.size = [u64::MAX, 2, 2], size),
        (
            &|meta| meta.extent.first[1] = -8,
            "element 0 has the lattice index -8 along y, which must be a multiple of 16, the shard's edge",
        ),
        (
            &|meta| meta.extent.shard = 15,
            "a shard has 15 voxels along its edge and a chunk 8; the first must be even, and a multiple of the second",
        ),
        (
            &|meta| meta.extent.chunk = 0,
            "a shard has 16 voxels along its edge and a chunk 0; the first must be even, and a multiple of the second",
        ),
        (&|meta| meta.spacing.y = 0.0, place),
        (&|meta| meta.origin.y = f64::NAN, place),
        (&|meta| meta.direction.z_axis = meta.direction.x_axis, place),
        (&|meta| meta.unseen = 256.0, "the value 256 of unseen voxels is none of u8; give one that is"),
        (&|meta| meta.unseen = 0.5, "the value 0.5 of unseen voxels is none of u8; give one that is"),
        (
            &|meta| (meta.scalar, meta.unseen) = (Scalar::U16, f32::NAN),
            "the value NaN of unseen voxels is none of u16; give one that is",
        ),
    ];
    for (change, sentence) in change {
        let mut meta = small();
        change(&mut meta);
        let error = refused(&path, &meta);
        assert!(matches!(&error, OmeZarrError::Unwritable { source, .. } if source.to_string() == sentence), "{error}");
        assert_eq!(error.to_string(), format!("{}: {sentence}", path.display()));
    }
    assert!(matches!(BadMeta::Size, BadMeta::Size));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn shards_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let (writer, _) = OmeZarrWriter::create(&path, &meta([0; 3], [200, 5, 5], Scalar::F32)).unwrap();
    let before = tree(folder.path());
    let (values, weights) = (vec![1.0; 400], vec![1.0; 400]);
    let mut bad = weights.clone();
    bad[7] = f32::NAN;
    let source = |result: Result<(), OmeZarrError>| match result.unwrap_err() {
        OmeZarrError::Shard { source, .. } => source,
        other => panic!("{other}"),
    };
    for (result, expected) in [
        (writer.shards().write_shard([0, 0, 13], Samples::F32(&values), &weights), BadShard::Outside),
        (writer.shards().leave_out([1, 0, 0]), BadShard::Outside),
        (writer.write_parent(0, [0, 0, 0]), BadShard::Outside),
        (writer.write_parent(2, [0, 0, 0]), BadShard::Outside),
        (writer.write_parent(1, [0, 0, 7]), BadShard::Outside),
        (
            writer.shards().write_shard([0, 0, 0], Samples::U8(&[0; 400]), &weights),
            BadShard::Type { given: "u8", expected: "f32" },
        ),
        (
            writer.shards().write_shard([0, 0, 0], Samples::F32(&values[1..]), &weights),
            BadShard::Length { what: "values", given: 399, expected: 400 },
        ),
        (
            writer.shards().write_shard([0, 0, 12], Samples::F32(&values[..200]), &weights),
            BadShard::Length { what: "weights", given: 400, expected: 200 },
        ),
        (
            writer.shards().write_shard([0, 0, 0], Samples::F32(&values), &bad),
            BadShard::NotFinite { what: "a weight", at: 7 },
        ),
        (
            writer.shards().write_shard([0, 0, 0], Samples::F32(&bad), &weights),
            BadShard::NotFinite { what: "a value", at: 7 },
        ),
        (writer.write_parent(1, [0, 0, 3]), BadShard::Pending { child: "0/c/0/0/6".into() }),
    ] {
        assert_eq!(source(result), expected);
    }
    assert!(tree(folder.path()) == before);
    let text = writer.write_parent(1, [0, 0, 3]).unwrap_err().to_string();
    let expected = "shard 1/c/0/0/3: its child 0/c/0/0/6 is not written yet; write it before its parent";
    assert!(text.ends_with(expected), "{text}");
}

#[test]
fn second_writer_is_refused_while_the_first_lives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let (first, _) = OmeZarrWriter::create(&path, &small()).unwrap();
    let other = Meta { content_key: "other".into(), ..small() };
    let before = tree(folder.path());
    for meta in [small(), other] {
        assert!(matches!(refused(&path, &meta), OmeZarrError::Busy { .. }));
    }
    assert!(tree(folder.path()) == before);
    drop(first);
    let (_, begun) = OmeZarrWriter::create(&path, &small()).unwrap();
    assert_eq!(begun, Begun::Continued { shards: 0 });
}

#[test]
fn files_and_other_folders_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let (path, part) = (folder.path().join("a.ome.zarr"), folder.path().join("a.ome.zarr.part"));
    std::fs::write(&path, "a file").unwrap();
    assert!(matches!(refused(&path, &small()), OmeZarrError::IsFile { path: at } if at == path));
    assert!(matches!(OmeZarr::open(&path), Err(OmeZarrError::IsFile { .. })));
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&part, "a file").unwrap();
    assert!(matches!(refused(&path, &small()), OmeZarrError::IsFile { path } if path == part));
    std::fs::remove_file(&part).unwrap();
    for folder in [&path, &part] {
        std::fs::create_dir(folder).unwrap();
        std::fs::write(folder.join("thesis.txt"), "").unwrap();
        assert!(matches!(refused(&path, &small()), OmeZarrError::NotReplaced { path } if path == *folder));
        std::fs::remove_dir_all(folder).unwrap();
    }
    let missing = folder.path().join("missing/a.ome.zarr");
    let error = refused(&missing, &small());
    assert!(matches!(&error, OmeZarrError::Io { doing: "creating the folder", .. }), "{error}");
    assert!(matches!(OmeZarr::open(&missing), Err(OmeZarrError::Io { doing: "reading", .. })));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn place_taken_meanwhile_is_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    let (writer, _) = OmeZarrWriter::create(&path, &small()).unwrap();
    std::fs::write(&path, "a file").unwrap();
    assert!(matches!(writer.finish(), Err(OmeZarrError::IsFile { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"a file");
}

#[test]
fn levels_and_boxes_beyond_the_volume_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ome.zarr");
    Scene::new(small(), 1).write(&path);
    let volume = OmeZarr::open(&path).unwrap();
    let sentence = |error: OmeZarrError| error.to_string().replace(&*path.to_string_lossy(), "v");
    assert_eq!(sentence(volume.grid(1).unwrap_err()), "v: has no level 1; give one below 1");
    let size = [1 << 40, 1 << 20, 1 << 20];
    let error = sentence(volume.read(0, [0; 3], size).unwrap_err());
    let expected = "v: 1099511627776×1048576×1048576 voxels of level 0 do not fit into memory; read a smaller box";
    assert!(error.starts_with(expected), "{error}");
    assert_eq!(volume.read(0, [i64::MAX, 0, i64::MIN], [2, 1, 1]).unwrap().1, [0.0; 2]);
}

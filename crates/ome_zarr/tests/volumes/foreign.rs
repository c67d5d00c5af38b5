//! Volumes of other programs: other types, codecs, chunks, axes, and no weights.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use ome_zarr::{LevelValues, OmeZarr, OmeZarrError, Scalar};
use serde_json::{Value, json};
use volume::Values as _;
use zarrs::array::{Array, ArrayMetadata, Element};
use zarrs::storage::store::MemoryStore;
use zarrs::storage::{ListableStorageTraits as _, ReadableStorageTraits as _};

use crate::scene::{Scene, meta};

/// Size along z, y, x.
const SIZE: [u64; 3] = [7, 9, 11];

fn array(leading: &[u64], data_type: &str, chunks: &[u64], codecs: Value) -> Value {
    let shape: Vec<u64> = leading.iter().copied().chain(SIZE).collect();
    json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": data_type,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunks}},
        "chunk_key_encoding": {"name": "v2", "configuration": {"separator": "."}},
        "fill_value": 0, "codecs": codecs, "attributes": {},
    })
}

fn image(axes: &Value, rank: usize) -> Value {
    let scale: Vec<f64> = [1.0, 1.0, 2000.0, 500.0, 250.0][5 - rank..].to_vec();
    let datasets = json!([{"path": "scale0", "coordinateTransformations": [{"type": "scale", "scale": scale}]}]);
    let image = json!({"axes": axes, "datasets": datasets, "name": "theirs"});
    json!({"zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": [image]}}})
}

fn axes(leading: &[&str], unit: &str) -> Value {
    let before =
        leading.iter().map(|name| json!({"name": name, "type": if *name == "t" { "time" } else { "channel" }}));
    let space = ["z", "y", "x"].map(|name| json!({"name": name, "type": "space", "unit": unit}));
    before.chain(space).collect()
}

/// Writes an image by the array library, as other programs have it.
fn write<T: Element>(path: &Path, group: &Value, array: &Value, voxels: &[T]) {
    let metadata: ArrayMetadata = serde_json::from_value(array.clone()).unwrap();
    let store = Arc::new(MemoryStore::new());
    let opened = Array::new_with_metadata(store.clone(), "/scale0", metadata).unwrap();
    opened.store_metadata().unwrap();
    opened.store_array_subset(&opened.subset_all(), voxels).unwrap();
    for key in store.list().unwrap() {
        let file = path.join(key.as_str());
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, store.get(&key).unwrap().unwrap()).unwrap();
    }
    std::fs::write(path.join("zarr.json"), group.to_string()).unwrap();
}

fn numbers() -> impl Iterator<Item = u16> {
    (0..SIZE.iter().product::<u64>() as u16).map(|n| n % 251)
}

/// Writes numbers of a type, reads them in whole and through the renderers' interface.
fn check<T: Element>(data_type: &str, leading: &[&str], codecs: Value, of: impl Fn(u16) -> T) {
    let folder = tempfile::tempdir().unwrap();
    let ones = vec![1; leading.len()];
    let chunks: Vec<u64> = ones.iter().copied().chain([4, 6, 10]).collect();
    let group = image(&axes(leading, "micrometer"), leading.len() + 3);
    let array = array(&ones, data_type, &chunks, codecs);
    write(folder.path(), &group, &array, &numbers().map(of).collect::<Vec<T>>());
    let volume = OmeZarr::open(folder.path()).unwrap();
    assert!(!volume.is_own() && !volume.has_weights() && volume.fields().is_empty());
    assert_eq!((volume.levels(), volume.first(0).unwrap()), (1, [0; 3]));
    let grid = volume.grid(0).unwrap();
    assert_eq!((grid.spacing, grid.size), (DVec3::new(0.25, 0.5, 2.0), [11, 9, 7]));
    let (values, weights) = volume.read(0, [0; 3], grid.size).unwrap();
    assert_eq!(values, numbers().map(f32::from).collect::<Vec<_>>());
    assert!(weights.iter().all(|w| *w == 1.0), "voxels of the fill value are seen, too");
    let range = match data_type {
        "uint8" => [0.0, 255.0],
        "uint16" => [0.0, 65535.0],
        _ => [0.0, 250.0],
    };
    assert_eq!(volume.range().unwrap(), range);

    let level = LevelValues::new(&volume, 0, 4000).unwrap();
    assert_eq!(level.range(None), range);
    for z in -1..8 {
        for y in -1..10 {
            let (mut value, mut weight) = ([9.0; 17], [9.0; 17]);
            level.values(level.placed().index([-3, y, z]), &mut value, &mut weight);
            let is_inside = (0..9).contains(&y) && (0..7).contains(&z);
            for (x, (value, weight)) in (-3..).zip(value.into_iter().zip(weight)) {
                let at = ((z * 9 + y) * 11 + x) as usize;
                let expected = if is_inside && (0..11).contains(&x) { (values[at], 1.0) } else { (0.0, 0.0) };
                assert_eq!((value, weight), expected, "{x} {y} {z}");
            }
        }
    }
    let mut seen = 0.0;
    for brick in level.bricks() {
        let (mut value, mut weight) = ([9.0; 512], [9.0; 512]);
        level.brick(brick, &mut value, &mut weight);
        seen += weight.iter().sum::<f32>();
    }
    assert_eq!(seen as usize, values.len());
    assert!(level.fault().is_none());
}

fn endian(endian: &str) -> Value {
    json!({"name": "bytes", "configuration": {"endian": endian}})
}

#[test]
fn types_codecs_and_axes_of_others_are_read() {
    let zstd = json!({"name": "zstd", "configuration": {"level": 1, "checksum": true}});
    check("uint8", &[], json!([{"name": "bytes"}]), |n| n as u8);
    check("uint16", &["c"], json!([endian("big"), zstd]), |n| n);
    check("int16", &["t", "c"], json!([endian("little"), zstd]), |n| n as i16);
    check("uint32", &["t"], json!([endian("big")]), u32::from);
    check("int32", &[], json!([endian("little"), {"name": "crc32c"}]), i32::from);
    check("float32", &["t", "c"], json!([endian("big"), zstd]), f32::from);
    check("float64", &[], json!([endian("little")]), f64::from);
    let inner = [endian("big"), zstd];
    for (leading, chunk) in [(&[][..], json!([2, 3, 5])), (&["t", "c"][..], json!([1, 1, 2, 3, 5]))] {
        let sharding = json!({"name": "sharding_indexed", "configuration": {"chunk_shape": chunk,
            "codecs": inner, "index_codecs": [endian("little"), {"name": "crc32c"}], "index_location": "start"}});
        check("float32", leading, json!([sharding]), f32::from);
    }
}

/// Opens an image after a change of its metadata.
fn changed(change: impl FnOnce(&mut Value, &mut Value)) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let (mut group, whole) =
        (image(&axes(&[], "millimeter"), 3), array(&[], "uint8", &[4, 6, 10], json!([{"name": "bytes"}])));
    write(folder.path(), &group, &whole, &numbers().map(|n| n as u8).collect::<Vec<_>>());
    let mut array = whole;
    change(&mut group, &mut array);
    std::fs::write(folder.path().join("zarr.json"), group.to_string()).unwrap();
    std::fs::write(folder.path().join("scale0/zarr.json"), array.to_string()).unwrap();
    let read = OmeZarr::open(folder.path()).map(drop);
    read.map_err(|error| error.to_string().replace(&*folder.path().to_string_lossy(), "v"))
}

#[test]
fn unsupported_images_are_refused_by_field() {
    changed(|_, _| ()).unwrap();
    for (error, begins) in [
        (
            changed(|group, _| group["attributes"]["ome"]["version"] = json!("0.6")),
            "v: is OME-Zarr 0.6, of which only 0.5 is read; convert it to 0.5",
        ),
        (
            changed(|group, _| group["attributes"] = json!({"ome": {"version": "0.5", "plate": {}}})),
            "v: zarr.json describes no image (no multiscales); give the folder of an image within it",
        ),
        (
            changed(|_, array| array["data_type"] = json!("complex64")),
            "v: scale0/zarr.json: field data_type: is complex64: uint8, uint16",
        ),
        (
            changed(|_, array| array["data_type"] = json!({"name": "struct"})),
            "v: scale0/zarr.json: field data_type: is {\"name\":\"struct\"}: uint8",
        ),
        (
            changed(|_, array| array["codecs"] = json!([{"name": "bytes"}, {"name": "blosc", "configuration": {}}])),
            "v: array scale0 cannot be read: codec blosc is not supported",
        ),
        (changed(|_, array| array["shape"] = json!([7, 9])), "v: array scale0 cannot be read: "),
        (
            changed(|_, array| array["shape"] = json!([7, 0, 11])),
            "v: scale0/zarr.json: field shape: must have 1 to 2⁴⁰ voxels",
        ),
        (
            changed(|_, array| {
                array["chunk_grid"]["configuration"]["chunk_shape"] = json!([1 << 20, 1 << 20, 1 << 20])
            }),
            "v: scale0/zarr.json: field codecs: have chunks of more than 1 GiB",
        ),
        (
            changed(|group, _| {
                let image = &mut group["attributes"]["ome"]["multiscales"][0];
                image["axes"] = axes(&["c"], "millimeter");
                image["datasets"][0]["coordinateTransformations"] = json!([]);
            }),
            "v: scale0/zarr.json: field shape: has 3 axes, but must have the 4 of the image",
        ),
        (
            changed(|group, _| group["attributes"]["ome"]["multiscales"][0]["axes"][1]["unit"] = json!("smoot")),
            "v: zarr.json: field attributes.multiscales.axes: have the unit \"smoot\"",
        ),
    ] {
        let error = error.unwrap_err();
        assert!(error.starts_with(begins), "{error}");
    }
}

#[test]
fn images_of_several_times_or_channels_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let group = image(&axes(&["c"], "millimeter"), 4);
    let array = array(&[2], "uint8", &[1, 4, 6, 10], json!([{"name": "bytes"}]));
    let voxels: Vec<u8> = numbers().chain(numbers()).map(|n| n as u8).collect();
    write(folder.path(), &group, &array, &voxels);
    let error = OmeZarr::open(folder.path()).err().unwrap().to_string();
    assert!(error.contains("has several times or channels"), "{error}");
}

#[test]
fn earlier_version_is_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(".zattrs"), "{}").unwrap();
    let error = OmeZarr::open(folder.path()).err().unwrap();
    assert!(matches!(&error, OmeZarrError::Version { found, .. } if found.starts_with("0.4")), "{error}");
    std::fs::write(folder.path().join("zarr.json"), "{\"attributes\": ").unwrap();
    assert!(matches!(OmeZarr::open(folder.path()), Err(OmeZarrError::Json { .. })));
}

#[test]
fn image_named_weight_of_others_may_be_anything() {
    let folder = tempfile::tempdir().unwrap();
    let group = image(&axes(&[], "millimeter"), 3);
    let array = array(&[], "uint8", &[4, 6, 10], json!([{"name": "bytes"}]));
    write(folder.path(), &group, &array, &numbers().map(|n| n as u8).collect::<Vec<_>>());
    std::fs::create_dir(folder.path().join("weight")).unwrap();
    std::fs::write(folder.path().join("weight/zarr.json"), "{}").unwrap();
    let volume = OmeZarr::open(folder.path()).unwrap();
    assert!(!volume.has_weights());
    assert!(volume.notes()[0].starts_with("the image weight is no weights of this volume"), "{:?}", volume.notes());
    // In this program's own volume that is an error.
    Scene::new(meta([0; 3], [20, 5, 5], Scalar::U8), 1).write(&folder.path().join("a.ome.zarr"));
    std::fs::write(folder.path().join("a.ome.zarr/weight/zarr.json"), "{}").unwrap();
    assert!(matches!(OmeZarr::open(&folder.path().join("a.ome.zarr")), Err(OmeZarrError::NoImage { .. })));
}

#[test]
fn chunk_of_another_size_takes_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let group = image(&axes(&[], "millimeter"), 3);
    let codecs = json!([{"name": "bytes"}, {"name": "zstd", "configuration": {"level": 1, "checksum": false}}]);
    write(
        folder.path(),
        &group,
        &array(&[], "uint8", &[7, 9, 11], codecs),
        &numbers().map(|n| n as u8).collect::<Vec<_>>(),
    );
    // A frame of one segment that claims 2⁶² bytes.
    let frame = [0x28, 0xb5, 0x2f, 0xfd, 0xe0, 0, 0, 0, 0, 0, 0, 0, 0x40, 0, 0];
    std::fs::write(folder.path().join("scale0/0.0.0"), frame).unwrap();
    let error = OmeZarr::open(folder.path()).unwrap().read(0, [0; 3], [11, 9, 7]).unwrap_err();
    assert!(matches!(&error, OmeZarrError::Damaged { problem, .. } if problem.contains("claims")), "{error}");
}

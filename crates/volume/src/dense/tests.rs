//! Volumes written to files and read back.

use std::io::Write as _;

use tempfile::TempDir;

use formats::image::write::VolumeWriter;

use super::*;

const PLENTY: u64 = 1 << 30;

struct Files(TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, header: &VolumeHeader, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        let mut file = VolumeWriter::create(&path, header).unwrap();
        file.write_all(bytes).unwrap();
        file.finish().unwrap();
        path
    }

    fn floats(&self, name: &str, header: &VolumeHeader, values: &[f32]) -> PathBuf {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        self.put(name, &VolumeHeader { pixel: PixelType::F32, ..header.clone() }, &bytes)
    }
}

fn header(size: [u32; 3], fields: &[(&str, &str)]) -> VolumeHeader {
    let fields = fields.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    VolumeHeader {
        origin: [-0.5, 7.0, 3.0],
        spacing: [0.5, 1.0, 1.5],
        fields,
        ..VolumeHeader::new(size, PixelType::U8)
    }
}

/// Value and weight of the voxels along x from `start`.
fn row<const N: usize>(volume: &DenseVolume, start: [i64; 3]) -> ([f32; N], [f32; N]) {
    let (mut value, mut weight) = ([9.0; N], [9.0; N]);
    volume.values(start, &mut value, &mut weight);
    (value, weight)
}

#[test]
fn every_scalar_type_is_read() {
    let files = Files::new();
    let check = |name: &str, pixel: PixelType, bytes: &[u8], values: [f32; 2]| {
        let path = files.put(&format!("{name}.mha"), &VolumeHeader { pixel, ..header([2, 1, 1], &[]) }, bytes);
        let volume = DenseVolume::open(&path, None, PLENTY).unwrap();
        assert_eq!(row::<2>(&volume, [-1, 7, 2]), (values, [1.0; 2]), "{name}");
        assert_eq!((volume.seen(), volume.notes().len(), volume.bytes()), (2, 0, 8));
    };
    check("u8", PixelType::U8, &[3, 255], [3.0, 255.0]);
    check("i8", PixelType::I8, &[3, 255], [3.0, -1.0]);
    check("u16", PixelType::U16, &[500_u16, 65_535].map(u16::to_ne_bytes).concat(), [500.0, 65_535.0]);
    check("i16", PixelType::I16, &[-500_i16, 7].map(i16::to_ne_bytes).concat(), [-500.0, 7.0]);
    check("u32", PixelType::U32, &[1_u32 << 24, 7].map(u32::to_ne_bytes).concat(), [16_777_216.0, 7.0]);
    check("i32", PixelType::I32, &[-70_000_i32, 7].map(i32::to_ne_bytes).concat(), [-70_000.0, 7.0]);
    check("u64", PixelType::U64, &[70_000_u64, 7].map(u64::to_ne_bytes).concat(), [70_000.0, 7.0]);
    check("i64", PixelType::I64, &[-70_000_i64, 7].map(i64::to_ne_bytes).concat(), [-70_000.0, 7.0]);
    check("f32", PixelType::F32, &[-0.1_f32, 1e9].map(f32::to_ne_bytes).concat(), [-0.1, 1e9]);
    check("f64", PixelType::F64, &[-0.1_f64, 1e9].map(f64::to_ne_bytes).concat(), [-0.1, 1e9]);
}

#[test]
fn rows_cross_file_borders() {
    let files = Files::new();
    let bytes: Vec<u8> = (1..=24).collect();
    let volume = DenseVolume::open(&files.put("v.mha", &header([4, 3, 2], &[]), &bytes), None, PLENTY).unwrap();
    // Origin −0.5, 7, 3 with spacings 0.5, 1, 1.5: the first voxel is (−1, 7, 2).
    assert_eq!(volume.bounds(), [[-1, 7, 2], [2, 9, 3]]);
    assert_eq!(volume.world_from_lattice().affine().translation, DVec3::ZERO);
    assert_eq!(row::<3>(&volume, [-2, 7, 2]), ([0.0, 1.0, 2.0], [0.0, 1.0, 1.0]));
    assert_eq!(row::<6>(&volume, [-2, 9, 3]), ([0.0, 21.0, 22.0, 23.0, 24.0, 0.0], [0.0, 1.0, 1.0, 1.0, 1.0, 0.0]));
    assert_eq!(row::<2>(&volume, [2, 8, 2]), ([8.0, 0.0], [1.0, 0.0]));
    for beside in [[-9, 7, 2], [3, 7, 2], [0, 6, 2], [0, 10, 2], [0, 7, 1], [0, 7, 4], [i64::MAX / 2, 7, 2]] {
        assert_eq!(row::<2>(&volume, beside), ([0.0; 2], [0.0; 2]), "{beside:?}");
    }
    let mut bricks: Vec<BrickIndex> = volume.bricks().collect();
    bricks.sort_unstable();
    assert_eq!(bricks, [[-1, 0, 0], [-1, 1, 0], [0, 0, 0], [0, 1, 0]]);
}

#[test]
fn seen_from_weights_else_from_header() {
    let files = Files::new();
    let unseen = header([4, 1, 1], &[(UNSEEN_FIELD, "7")]);
    let path = files.floats("v.mha", &unseen, &[7.0, 1.0, f32::NAN, 3.0]);
    let weights = files.floats("w.mha", &unseen, &[2.0, SEEN, 4.0, 0.5]);
    let volume = DenseVolume::open(&path, Some(&weights), PLENTY).unwrap();
    assert_eq!(row::<4>(&volume, [-1, 7, 2]), ([7.0, 0.0, 0.0, 3.0], [2.0, 0.0, 0.0, 0.5]));
    assert_eq!((volume.seen(), volume.extremes(), volume.bytes()), (2, Some([3.0, 7.0]), 32));
    assert!(matches!(volume.notes(), [note] if note.starts_with("1 voxels have a value that is not finite")));

    let volume = DenseVolume::open(&path, None, PLENTY).unwrap();
    assert_eq!(row::<4>(&volume, [-1, 7, 2]), ([0.0, 1.0, 0.0, 3.0], [0.0, 1.0, 0.0, 1.0]));
    assert_eq!((volume.seen(), volume.extremes()), (2, Some([1.0, 3.0])));
    let notes = volume.notes().join("\n");
    assert!(notes.contains("1 voxels of the value 7") && notes.contains("the weights would show"), "{notes}");

    let path = files.floats("n.mha", &header([2, 1, 1], &[(UNSEEN_FIELD, "NaN")]), &[f32::NAN; 2]);
    let volume = DenseVolume::open(&path, None, PLENTY).unwrap();
    assert_eq!((volume.seen(), volume.bricks().count(), volume.extremes()), (0, 0, None));
}

#[test]
fn range_and_box_from_header_if_plausible() {
    let files = Files::new();
    let open = |pixel: PixelType, fields: &[(&str, &str)], values: [f32; 2]| {
        let header = VolumeHeader { pixel, ..header([2, 1, 1], fields) };
        let bytes: Vec<u8> = match pixel {
            PixelType::U8 => values.map(|v| v as u8).to_vec(),
            PixelType::U16 => values.map(|v| (v as u16).to_ne_bytes()).concat(),
            _ => values.map(f32::to_ne_bytes).concat(),
        };
        DenseVolume::open(&files.put("v.mha", &header, &bytes), None, PLENTY).unwrap()
    };
    let range = |pixel, fields: &[(&str, &str)]| open(pixel, fields, [3.0, 9.0]).range();
    assert_eq!(range(PixelType::U8, &[]), [0.0, 255.0]);
    assert_eq!(range(PixelType::U16, &[]), [0.0, 65_535.0]);
    assert_eq!(range(PixelType::F32, &[]), [3.0, 9.0]);
    assert_eq!(range(PixelType::F32, &[("SonoweaveVersion", "0.1.0")]), [0.0, 255.0]);
    assert_eq!(range(PixelType::F32, &[(RANGE_FIELD, "0 1")]), [0.0, 1.0]);
    for wrong in ["1 0", "0", "a b", "0 inf", "nan 1"] {
        assert_eq!(range(PixelType::U16, &[(RANGE_FIELD, wrong)]), [0.0, 65_535.0], "{wrong}");
    }
    assert_eq!(open(PixelType::F32, &[], [4.0; 2]).range(), [4.0, 5.0]);

    let bounds = |text| open(PixelType::U8, &[(SLICES_BOX_FIELD, text)], [1.0, 2.0]).bounds();
    assert_eq!(bounds("-3 -2 -1 5 6 7"), [[-4, 5, 1], [4, 13, 9]]);
    let file = [[-1, 7, 2], [0, 7, 2]];
    for wrong in ["", "0 0 0 1 1", "0 0 0 1 1 x", "1 0 0 0 0 0", "2 0 0 5 5 5", "-9 0 0 -1 0 0", "0 0 0 1073741824 0 0"]
    {
        assert_eq!(bounds(wrong), file, "{wrong}");
    }
}

#[test]
fn unusable_file_refused_with_reason() {
    let files = Files::new();
    let fails = |path: &Path, weights: Option<&Path>, limit: u64, text: &[&str]| {
        let sentence = DenseVolume::open(path, weights, limit).unwrap_err().to_string();
        for part in text {
            assert!(sentence.contains(part), "{sentence} does not say {part}");
        }
    };
    let plain = header([4, 3, 2], &[]);
    let path = files.put("v.mha", &plain, &[1; 24]);
    let two = files.put("two.mha", &VolumeHeader { channels: 2, ..plain.clone() }, &[1; 48]);
    fails(&two, None, PLENTY, &["two.mha", "2 channels", "convert"]);
    fails(&path, Some(&two), PLENTY, &["two.mha", "2 channels"]);
    fails(&path, None, 95, &["v.mha", "4×3×2 voxels", "raise the memory limit"]);
    assert!(DenseVolume::open(&path, None, 96).is_ok());
    fails(&path, Some(&path), 191, &["raise the memory limit"]);
    let flat = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let flat = files.put("flat.mha", &VolumeHeader { axes: flat, ..plain.clone() }, &[1; 24]);
    fails(&flat, None, PLENTY, &["flat.mha", "TransformMatrix", "one plane"]);
    for (what, other) in [
        ("the size", VolumeHeader { size: [4, 2, 3], ..plain.clone() }),
        ("the spacing", VolumeHeader { spacing: [0.5, 1.0, 1.6], ..plain.clone() }),
        ("the direction", VolumeHeader { axes: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], ..plain.clone() }),
        ("the origin", VolumeHeader { origin: [-0.5, 7.0, 3.1], ..plain.clone() }),
    ] {
        let weights = files.put("w.mha", &other, &[1; 24]);
        fails(&path, Some(&weights), PLENTY, &["w.mha", "not the weights of", what]);
    }
    let cut = files.0.path().join("cut.mha");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
    fails(&cut, None, PLENTY, &["cut.mha", "promises 24 bytes"]);
    fails(&files.0.path().join("none.mha"), None, PLENTY, &["none.mha"]);
}

//! Good input: the outputs of `reconstruct`, which depend only on the input and the settings.

use reconstruct::Simd;

use super::place::{Place, Volume};
use super::sequence::{Sequence, grey, pose};

/// A sweep small enough for a test and large enough to be meaningful: 30×27×24 mm of blobs.
const SWEEP: &str = "phantom -o s.mha --image-size 150x136 --pixel 0.2 --frames 61 --gap 0.4";

fn rmse(place: &Place, volume: &str, truth: &str) -> (f64, f64) {
    let report = place.does(&format!("inspect {volume} --json --against {truth} --weights w.mha"));
    let comparison = &serde_json::from_str::<serde_json::Value>(&report).unwrap()["comparison"];
    assert!(comparison["voxels"].as_u64().unwrap() > 20_000, "{comparison}");
    (comparison["rmse"].as_f64().unwrap(), comparison["bias"].as_f64().unwrap())
}

#[test]
fn sweep_over_known_blobs_reproduces_them() {
    for trajectory in ["parallel", "fan", "freehand"] {
        let place = Place::new();
        place.does(&format!("{SWEEP} --trajectory {trajectory} --truth t.mha --noise 3 --spacing 0.5"));
        place.does("reconstruct s.mha --path general -o v.mha --weights w.mha --spacing 0.5 --sigma auto");
        let (rmse, bias) = rmse(&place, "v.mha", "t.mha");
        assert!(rmse < 1.2 && bias.abs() < 0.15, "{trajectory}: RMSE {rmse}, bias {bias}");
    }
}

#[test]
fn constant_scene_is_constant_up_to_the_fan_border() {
    let place = Place::new();
    place.does(&format!("{SWEEP} --scene constant --grey 100 --noise 0 --type f32 --fan --calibration c.toml"));
    place.does("reconstruct s.mha -o v.mha --weights w.mha --config c.toml");
    let (volume, weights) = (place.volume("v.mha"), place.volume("w.mha"));
    let seen: Vec<f32> = pairs(&volume, &weights).filter(|(_, w)| *w > 0.0).map(|(v, _)| v).collect();
    assert!(seen.len() > 50_000, "{}", seen.len());
    let worst = seen.iter().map(|v| (v - 100.0).abs()).fold(0.0, f32::max);
    // 4 √n 2⁻²⁴ of the value under n overlapping slices: here 13, spaced by 0.4 mm within ±2.6
    // mm.
    assert!(worst <= 100.0 * 4.0 * 13.0_f32.sqrt() * 2.0_f32.powi(-24), "{worst}");
    let black = pairs(&volume, &weights).filter(|(v, w)| *w == 0.0 && *v == 0.0).count();
    assert_eq!(black + seen.len(), volume.values.len(), "what is not seen is 0 here, and nothing else is");
}

fn pairs<'a>(values: &'a Volume, weights: &'a Volume) -> impl Iterator<Item = (f32, f32)> + 'a {
    assert_eq!(values.header.size, weights.header.size);
    assert_eq!(values.header.origin, weights.header.origin);
    values.values.iter().copied().zip(weights.values.iter().copied())
}

#[test]
fn ramp_is_not_shifted() {
    let place = Place::new();
    place.does(&format!("{SWEEP} --scene ramp --noise 0 --type f32 --truth t.mha --trajectory parallel"));
    place.does("reconstruct s.mha --path general -o v.mha --weights w.mha --sigma 0.375,0.375,0.375");
    let (volume, truth) = (place.volume("v.mha"), place.volume("t.mha"));
    // Inside, where the kernel sees both sides of every voxel.
    let shift: [i64; 3] =
        std::array::from_fn(|a| ((truth.header.origin[a] - volume.header.origin[a]) / 0.5).round() as i64);
    let size = truth.header.size.map(i64::from);
    let mut compared = 0;
    for z in 6..size[2] - 6 {
        for y in 6..size[1] - 6 {
            for x in 6..size[0] - 6 {
                let value = volume.at([x + shift[0], y + shift[1], z + shift[2]]).unwrap();
                let expected = truth.at([x, y, z]).unwrap();
                // Half a pixel of shift would be 0.11 grey levels along x.
                assert!((value - expected).abs() < 0.05, "{value} for {expected} at {x}, {y}, {z}");
                compared += 1;
            }
        }
    }
    assert!(compared > 10_000, "{compared}");
}

#[test]
fn box_is_cropped_and_padded_exactly() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let spacing = "--spacing 0.5 --sigma 0.5,0.5,0.7";
    place.does(&format!("reconstruct s.mha --path general -o all.mha --weights w.mha {spacing}"));
    place.does(&format!(
        "reconstruct s.mha --path general -o box.mha --unseen 7 --origin 2,3,-4 --size 50,9,14 {spacing}"
    ));
    let (all, weights, cut) = (place.volume("all.mha"), place.volume("w.mha"), place.volume("box.mha"));
    assert_eq!((cut.header.size, cut.header.origin), ([50, 9, 14], [2.0, 3.0, -4.0]));
    let shift: [i64; 3] = std::array::from_fn(|a| ((cut.header.origin[a] - all.header.origin[a]) / 0.5) as i64);
    let (mut inside, mut outside) = (0, 0);
    for z in 0..14 {
        for y in 0..9 {
            for x in 0..50 {
                let there = [x + shift[0], y + shift[1], z + shift[2]];
                let expected = if weights.at(there).is_some_and(|w| w > 0.0) {
                    inside += 1;
                    all.at(there).unwrap()
                } else {
                    outside += 1;
                    7.0
                };
                assert_eq!(cut.at([x, y, z]), Some(expected), "{x}, {y}, {z}");
            }
        }
    }
    assert!(inside > 500 && outside > 500, "{inside} {outside}");
    // A size alone begins at the slices' first voxel.
    place.does(&format!("reconstruct s.mha --path general -o box.mha --size 3,4,5 {spacing}"));
    let cut = place.volume("box.mha");
    assert_eq!((cut.header.size, cut.header.origin), ([3, 4, 5], all.header.origin));
}

#[test]
fn origin_off_the_lattice_moves_the_lattice() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place.does("reconstruct s.mha -o v.mha --spacing 0.5,0.75,1 --origin 0.1,0.2,0.3");
    let header = place.volume("v.mha").header;
    assert_eq!(header.spacing, [0.5, 0.75, 1.0]);
    for (axis, (spacing, origin)) in [(0.5, 0.1), (0.75, 0.2), (1.0, 0.3)].into_iter().enumerate() {
        let steps: f64 = (header.origin[axis] - origin) / spacing;
        assert!((steps - steps.round()).abs() < 1e-9, "axis {axis}: {}", header.origin[axis]);
    }
}

#[test]
fn frame_range_selects_frames() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place.does_narrowly(
        "reconstruct s.mha --path general -o v.mha --frames 2..5 --json=s.json --sigma 0.5,0.5,0.2 --spacing 0.5",
    );
    let statistics = place.json("s.json");
    assert_eq!(statistics["frames"]["used"], 3);
    assert_eq!(statistics["frame_range"], serde_json::json!([2, 5]));
    let header = place.volume("v.mha").header;
    assert!((header.origin[2] - 2.0).abs() <= 0.5 && header.size[2] <= 7, "{header:?}");
    let run = place.run("reconstruct s.mha --path general -o v.mha --frames 4..99 --json=s.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(place.json("s.json")["frames"]["used"], 2);
}

#[test]
fn weights_are_zero_exactly_at_unseen_voxels() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place.does("reconstruct s.mha --path general -o v.mha --weights w.mha --unseen 255 --spacing 0.4");
    let (values, weights) = (place.volume("v.mha"), place.volume("w.mha"));
    // The frames' brightest pixel.
    let brightest = f32::from(grey(39, 29, 5));
    let (mut seen, mut unseen) = (0, 0);
    for (value, weight) in pairs(&values, &weights) {
        assert!(weight >= 0.0);
        if weight > 0.0 {
            assert!((40.0..=brightest).contains(&value), "{value}");
            seen += 1;
        } else {
            assert_eq!(value, 255.0);
            unseen += 1;
        }
    }
    assert!(seen > 10_000, "{seen} seen, {unseen} unseen");
}

#[test]
fn statistics_describe_the_run() {
    let place = Place::new();
    place.put(
        "s.mha",
        Sequence { status: |frame| if frame == 3 { "INVALID" } else { "OK" }, ..Sequence::default() }.bytes(),
    );
    let run = place
        .run("reconstruct s.mha --path general -o v.mha --json=s.json --threads 1 --simd portable --spacing 0.5 --sigma 0.6,0.6,0.8");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let s = place.json("s.json");
    assert_eq!(s["frames"]["total"], 6);
    assert_eq!(s["frames"]["used"], 5);
    assert_eq!(s["frames"]["refused"], serde_json::json!({ "pose_invalid": 1 }));
    let ms = &s["insert_ms"];
    let ordered = ["median", "p95", "p99", "max", "total"].map(|key| ms[key].as_f64().unwrap());
    assert!(ordered.is_sorted() && ordered[0] > 0.0, "{ms}");
    assert!(s["wall_s"].as_f64().unwrap() * 1e3 > ordered[4]);
    assert_eq!((&s["threads"], &s["simd"]), (&1.into(), &"portable".into()));
    let volume = place.volume("v.mha");
    let grid = &s["grid"];
    assert_eq!(grid["size"], serde_json::json!(volume.header.size));
    assert_eq!(grid["origin"], serde_json::json!(volume.header.origin));
    assert_eq!(grid["spacing"], serde_json::json!([0.5, 0.5, 0.5]));
    assert_eq!(grid["direction"], serde_json::json!([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
    assert_eq!(s["sigma_mm"], serde_json::json!([0.6, 0.6, 0.8]));
    for axis in 0..3 {
        let [nominal, effective, support] =
            ["sigma_mm", "sigma_effective_mm", "support_mm"].map(|key| s[key][axis].as_f64().unwrap());
        assert!(effective < nominal && nominal < support, "{effective} {nominal} {support}");
    }
    let voxels: u64 = volume.header.size.iter().map(|n| u64::from(*n)).product();
    let (bricks, bytes) = (s["bricks"].as_u64().unwrap(), s["bytes"].as_u64().unwrap());
    assert!(bricks >= voxels / 512 && bytes <= bricks * 512 * 12 + (64 << 20), "{bricks} bricks, {bytes} bytes");
    assert!(s["voxels_updated"].as_u64().unwrap() > voxels / 2);
    assert_eq!(s["w_clamped"], 0);
    assert_eq!(s["route"], "Image → Reference");
    assert_eq!(s["input_sha256"].as_str().map(str::len), Some(64));
}

#[test]
fn volume_header_has_provenance() {
    let place = Place::new();
    place.put("sweep.mha", Sequence::default().bytes());
    place.does("reconstruct sweep.mha --path general -o v.mha --json=s.json");
    let volume = place.volume("v.mha");
    assert_eq!(volume.field("SonoweaveVersion"), env!("CARGO_PKG_VERSION"));
    let hash = place.json("s.json")["input_sha256"].as_str().unwrap().to_owned();
    assert_eq!(volume.field("SonoweaveInput"), format!("sweep.mha sha256 {hash}"));
    assert_eq!(volume.field("SonoweaveFrame"), "Reference (mm, not anatomical)");
    assert_eq!(volume.field("SonoweaveCalibration"), "in the sequence");
    assert_eq!(volume.field("SonoweaveFrames"), "6 of 6");
    assert_eq!(volume.field("SonoweaveMethod"), "gaussian-truncated");
}

#[test]
fn threads_and_instructions_give_equal_bits() {
    let place = Place::new();
    place.does(&format!("{SWEEP} --seed 4"));
    let bits = |flags: &str| {
        place.does(&format!("reconstruct s.mha -o v.mha --weights w.mha --type f32 {flags}"));
        (place.get("v.mha"), place.get("w.mha"))
    };
    let reference = bits("--threads 1 --simd portable");
    for simd in available() {
        for threads in [1, 2, 3] {
            let flags = format!("--threads {threads} --simd {simd}");
            assert!(bits(&flags) == reference, "{flags}");
        }
    }
    assert!(bits("") == reference, "by default");
}

/// Returns the instruction sets of this machine. The refusal of others is tested on machines
/// without them.
fn available() -> Vec<&'static str> {
    Simd::ALL.into_iter().filter(|simd| simd.is_available()).map(Simd::name).chain(["auto"]).collect()
}

#[test]
fn storage_and_orientation_do_not_change_the_volume() {
    let place = Place::new();
    let short: fn(u32, u32, u32) -> Vec<u8> = |u, v, frame| (u16::from(grey(u, v, frame)) * 200).to_le_bytes().to_vec();
    let base = Sequence { element: "MET_USHORT", pixel: short, ..Sequence::default() };
    let voxels = |sequence: Sequence| {
        place.put("s.mha", sequence.bytes());
        place.does("reconstruct s.mha --path general -o v.mha --clip none");
        place.volume("v.mha").values
    };
    let reference = voxels(base.clone());
    assert!(reference.iter().any(|v| *v > 10_000.0));
    assert!(voxels(Sequence { big_endian: true, ..base.clone() }) == reference, "big-endian");
    assert!(voxels(Sequence { zlib: true, ..base.clone() }) == reference, "zlib");
    let mirrored: fn(u32, u32, u32) -> Vec<u8> =
        |u, v, frame| (u16::from(grey(39 - u, v, frame)) * 200).to_le_bytes().to_vec();
    let lines = "UltrasoundImageOrientation = UFA\n".to_owned();
    assert!(voxels(Sequence { pixel: mirrored, lines, ..base }) == reference, "UF");
}

#[test]
fn every_pixel_type_gives_equal_values() {
    type Pixel = fn(u32, u32, u32) -> Vec<u8>;
    let place = Place::new();
    let types: [(&str, Pixel); 5] = [
        ("MET_UCHAR", |u, v, f| vec![grey(u, v, f)]),
        ("MET_SHORT", |u, v, f| i16::from(grey(u, v, f)).to_le_bytes().to_vec()),
        ("MET_UINT", |u, v, f| u32::from(grey(u, v, f)).to_le_bytes().to_vec()),
        ("MET_FLOAT", |u, v, f| f32::from(grey(u, v, f)).to_le_bytes().to_vec()),
        ("MET_DOUBLE", |u, v, f| f64::from(grey(u, v, f)).to_le_bytes().to_vec()),
    ];
    let mut volumes = Vec::new();
    for (element, pixel) in types {
        for big_endian in [false, true] {
            place.put("s.mha", Sequence { element, pixel, big_endian, ..Sequence::default() }.bytes());
            let run = place.run("reconstruct s.mha -o v.mha --type f32 --clip none");
            assert_eq!(run.code, 0, "{element}: {}", run.stderr);
            volumes.push((element, place.volume("v.mha").values));
        }
    }
    let (_, reference) = &volumes[0];
    for (element, values) in &volumes {
        let worst = values.iter().zip(reference).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // The filtered frame of 8 bits is stored in 16 bits: a few thousandths of a grey level.
        assert!(worst < 0.02, "{element}: {worst}");
    }
}

#[test]
fn window_maps_grey_values_to_full_type_range() {
    let place = Place::new();
    place.put("s.mha", Sequence { pixel: |_, _, _| vec![110], ..Sequence::default() }.bytes());
    for (flags, expected, tolerance) in [
        ("--type u8 --window 50,150", 153.0, 0.0),
        ("--type u16 --window 0,200", 36_044.0, 1.0),
        ("--type f32 --window 0,200", 0.55, 1e-5),
        ("--type u8 --window 110.5,150", 0.0, 0.0),
        ("--type u8 --window 10,90", 255.0, 0.0),
        ("--type f32", 110.0, 1e-3),
    ] {
        place.does(&format!("reconstruct s.mha --path general -o v.mha --weights w.mha --clip none {flags}"));
        let (values, weights) = (place.volume("v.mha"), place.volume("w.mha"));
        for (value, _) in pairs(&values, &weights).filter(|(_, w)| *w > 0.0) {
            assert!((value - expected).abs() <= tolerance, "{flags}: {value}");
        }
    }
}

#[test]
fn repeated_frame_adds_nothing() {
    let place = Place::new();
    let still: fn(u32) -> String = |frame| pose(f64::from(frame / 2));
    place.put(
        "s.mha",
        Sequence { pose: still, pixel: |u, v, f| vec![grey(u, v, f / 2)], ..Sequence::default() }.bytes(),
    );
    let run = place.run("reconstruct s.mha -o v.mha --json=s.json");
    assert!(run.stderr.contains("3 × repeated"), "{}", run.stderr);
    assert_eq!(place.json("s.json")["frames"]["used"], 3);
}

#[test]
fn outputs_are_listed_on_stdout_without_progress_in_pipe() {
    let place = Place::new();
    place.does(SWEEP);
    let said = place.does("reconstruct s.mha -o v.mha --weights w.mha --planes p.png");
    assert!(said.starts_with("v.mha: ") && said.contains("from 61 of 61 frames"), "{said}");
    assert!(said.contains("weights: w.mha\n") && said.contains("middle planes: p.png\n"), "{said}");
    assert!(!said.contains('\u{1b}') && !said.contains('\r'), "{said:?}");
    assert!(place.get("p.png").starts_with(b"\x89PNG\r\n\x1a\n"));
    assert_eq!(place.names().into_iter().collect::<Vec<_>>(), ["p.png", "s.mha", "v.mha", "w.mha"]);
}

//! Choice of the insertion path: automatic, requested, and changed on the way.

use serde_json::Value;

use super::place::{Place, Volume};
use super::sequence::{Sequence, pose};

/// A sweep that turns about image axis u, like that of an arm.
fn arm(flags: &str) -> Place {
    let place = Place::new();
    place.does(&format!(
        "phantom -o s.mha --image-size 60x50 --pixel 0.4 --frames 25 --gap 0.4 --trajectory fan --noise 3 {flags}"
    ));
    place
}

/// Reconstructs; returns the statistics, and the messages on stderr.
fn reconstruct(place: &Place, flags: &str) -> (Value, String) {
    let run = place.run(&format!("reconstruct s.mha -o v.mha --weights w.mha --json=s.json {flags}"));
    assert_eq!(run.code, 0, "{flags}: {}", run.stderr);
    (place.json("s.json"), run.stderr)
}

/// Returns value and weight by world position in tenths of a millimetre, for voxels with
/// sufficient weight.
fn seen(values: &Volume, weights: &Volume) -> std::collections::BTreeMap<[i64; 3], (f32, f32)> {
    let header = &values.header;
    let [nx, ny, _] = header.size.map(|n| n as usize);
    let place = |i: usize| -> [i64; 3] {
        let index = [i % nx, i / nx % ny, i / (nx * ny)];
        std::array::from_fn(|k| {
            let along = |axis: usize| header.axes[axis][k] * header.spacing[axis] * index[axis] as f64;
            (10.0 * (header.origin[k] + along(0) + along(1) + along(2))).round() as i64
        })
    };
    let voxels = values.values.iter().zip(&weights.values).enumerate();
    voxels.filter(|(_, (_, w))| **w > 0.3).map(|(i, (v, w))| (place(i), (*v, *w))).collect()
}

#[test]
fn planar_scan_is_detected_and_aligns_the_volume() {
    let place = arm("");
    let (s, said) = reconstruct(&place, "--clip none");
    assert_eq!(s["path"], "planar");
    assert!(s["path_reason"].as_str().unwrap().contains("perpendicular to one plane"), "{s}");
    assert!(said.contains("planar path") && said.contains("the general path would keep"), "{said}");
    assert_eq!(s["frames"]["used"], 25);
    let volume = place.volume("v.mha");
    assert_eq!(volume.field("SonoweavePath"), "planar");
    // z is the image's u, about which the fan turns: the world's x.
    assert_eq!(volume.header.axes[2], [1.0, 0.0, 0.0]);
    assert!(volume.header.axes[0] != [1.0, 0.0, 0.0]);
    let work = &s["work"];
    assert!(work["columns_touched"].as_u64().unwrap() > 1000, "{work}");
    assert!(work["columns_considered"].as_u64() > work["columns_touched"].as_u64(), "{work}");
    // It is read, rendered and cropped like any other.
    assert!(place.does("inspect v.mha").contains("z along 1, 0, 0"));
    let (_, _) = reconstruct(&place, "--clip none --path planar --size 9,8,7 --planes p.png");
    assert_eq!(place.volume("v.mha").header.size, [9, 8, 7]);
    assert!(place.get("p.png").len() > 1000);
}

#[test]
fn both_paths_agree_on_a_common_lattice() {
    // Parallel slices across z: the lattice of the scan has the world's points in another order.
    let place = Place::new();
    place.put("s.mha", Sequence { pose: |frame| pose(0.7 * f64::from(frame)), ..Sequence::default() }.bytes());
    let (s, _) = reconstruct(&place, "--clip none --type f32 --spacing 0.5");
    assert_eq!(s["path"], "planar");
    let planar = seen(&place.volume("v.mha"), &place.volume("w.mha"));
    let (s, said) = reconstruct(&place, "--clip none --type f32 --spacing 0.5 --path general");
    assert_eq!((s["path"].as_str().unwrap(), said.as_str()), ("general", ""));
    assert_eq!(s["path_reason"], "it was asked for");
    let deviation = s["decimation_deviation"].as_f64().unwrap() as f32 * 255.0;
    let general = seen(&place.volume("v.mha"), &place.volume("w.mha"));
    let common: Vec<_> = planar.iter().filter_map(|(at, a)| Some((a, general.get(at)?))).collect();
    assert!(common.len() > 10_000 && common.len() * 100 > 97 * planar.len().max(general.len()), "{}", common.len());
    for ((value, weight), (other, heavier)) in common {
        // In corners a voxel may have received a slice from one path only.
        if (weight - heavier).abs() < 0.01 * weight {
            assert!((value - other).abs() <= 10.0 * deviation, "{value} {other}");
        }
    }
}

#[test]
fn planar_path_is_equal_for_threads_and_instructions() {
    let place = arm("");
    let bits = |flags: &str| {
        assert_eq!(reconstruct(&place, &format!("--clip none --path planar {flags}")).0["path"], "planar");
        (place.get("v.mha"), place.get("w.mha"))
    };
    let one = bits("--threads 1 --simd portable");
    assert!(one == bits("--threads 3"));
}

#[test]
fn reason_against_planar_path_is_reported() {
    let place = arm("");
    for (flags, why) in [
        ("--clip none --size 20,20,20", "along the world's axes"),
        ("--clip none --origin 0,0,0", "along the world's axes"),
        ("--clip none --spacing 0.5,0.5,0.6", "spacing along x, y and z differs"),
        ("--clip none --frames 3..4", "one slice"),
        ("--fan 30,-30,35,85,-20,20", "no rectangle"),
        ("--clip none --planar-tolerance 0.25 --path general", "asked for"),
    ] {
        let (s, said) = reconstruct(&place, flags);
        assert_eq!(s["path"], "general", "{flags}");
        assert!(s["path_reason"].as_str().unwrap().contains(why), "{flags}: {}", s["path_reason"]);
        assert_eq!(said, "", "{flags}");
    }
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 60x50 --pixel 0.4 --frames 9 --gap 0.4");
    let (s, _) = reconstruct(&place, "--clip none");
    assert_eq!(s["path"], "general");
    assert!(s["path_reason"].as_str().unwrap().contains("voxel off the first one's plane"), "{}", s["path_reason"]);
}

/// Six parallel slices, one of which is tilted.
fn tilted() -> Sequence {
    let pose = |frame: u32| match frame {
        // 0.02 rad about v: 0.2 mm at the image's sides, 0.4 voxel across.
        3 => format!("0.49990 0 0 0 0 0.5 0 0 -0.01 0 1 {frame} 0 0 0 1"),
        _ => pose(f64::from(frame)),
    };
    Sequence { pose, ..Sequence::default() }
}

#[test]
fn tilted_frame_is_refused_or_upgrades_as_requested() {
    let place = Place::new();
    place.put("s.mha", tilted().bytes());
    // By default the recording is not suitable for the planar path.
    let (s, said) = reconstruct(&place, "--clip none --spacing 0.5");
    assert_eq!((s["path"].as_str().unwrap(), said.as_str()), ("general", ""));
    assert!(s["path_reason"].as_str().unwrap().starts_with("frame 3 lies up to 0."), "{}", s["path_reason"]);
    let command = "reconstruct s.mha -o v2.mha --clip none --spacing 0.5 --path planar";
    place.refuses(
        &format!("{command} --departure refuse"),
        &[
            "the planar path was requested, but frame 3",
            "leaves the scan's plane",
            "voxel off, 0.25 is allowed",
            "the upgrade on departure",
        ],
    );
    let (s, said) = reconstruct(&place, "--clip none --spacing 0.5 --path planar");
    assert_eq!(s["path"], "planar, then general");
    assert_eq!(s["frames"]["used"], 6);
    assert!(said.contains("note: frame 3") && said.contains("general path has taken over"), "{said}");
    assert_eq!(place.volume("v.mha").field("SonoweavePath"), "general");
    // A wider tolerance keeps it in the plane.
    let (s, _) = reconstruct(&place, "--clip none --spacing 0.5 --path planar --departure refuse --planar-tolerance 1");
    assert_eq!((s["path"].as_str().unwrap(), &s["frames"]["used"]), ("planar", &6.into()));
}

#[test]
fn non_rectangular_mask_is_refused_or_upgrades_as_requested() {
    let place = arm("");
    let fan = "--fan 30,-30,35,85,-20,20 --path planar";
    place.refuses(
        &format!("reconstruct s.mha -o v2.mha {fan} --departure refuse"),
        &["no rectangle", "the general path", "the upgrade on departure"],
    );
    let (s, said) = reconstruct(&place, fan);
    assert_eq!(s["path"], "planar, then general");
    assert!(said.contains("no rectangle") && said.contains("inserts all slices"), "{said}");
    place.refuses(
        "reconstruct s.mha -o v2.mha --clip none --path planar --planar-tolerance=-1",
        &["tolerance", "0 or more, not -1"],
    );
}

//! `calibrate crossings`: from scans to the corrected calibration file.

use glam::DVec3;

use calibration::file::{CalibrationFile, Latency};

use crate::place::Place;

const SCAN: &str = "phantom -o scan.mha --calibration probe.toml --trajectory three-directions --image-size 160x150 --pixel 0.3 --frames 120 --gap 0.9 --seed 5";

/// Writes a calibration whose sensor has slipped.
fn slipped(place: &Place, by: DVec3) {
    let mut file = CalibrationFile::read(&place.path("probe.toml")).unwrap();
    let affine = file.probe_from_image.unwrap().affine();
    let moved = glam::DAffine3 { translation: affine.translation + by, ..affine };
    file.probe_from_image = Some(sonoweave_core::frames::Transform::from_affine(moved));
    file.spacing_mm = Some([0.7; 3]);
    file.write(&place.path("slipped.toml")).unwrap();
}

/// Returns the largest distance of the corners by two calibrations, mm.
fn apart(place: &Place, a: &str, b: &str) -> f64 {
    let of = |name: &str| CalibrationFile::read(&place.path(name)).unwrap().probe_from_image.unwrap();
    let [a, b] = [of(a), of(b)];
    let corners = [(0.0, 0.0), (159.0, 0.0), (0.0, 149.0), (159.0, 149.0)].map(|(u, v)| DVec3::new(u, v, 0.0));
    corners.iter().map(|p| a.point(*p).distance(b.point(*p))).fold(0.0, f64::max)
}

#[test]
fn slipped_sensor_is_found_and_corrected() {
    let place = Place::new();
    place.does(SCAN);
    let said = place.does("calibrate crossings --sequence scan.mha --config probe.toml --json=right.json");
    assert!(said.contains("the calibration holds") && said.contains("3 directions, 3 sweeps"), "{said}");
    let right = place.json("right.json");
    assert!(right["shift_mm"].as_f64().unwrap() < 0.1 && right["has_slipped"] == false, "{right}");

    slipped(&place, DVec3::new(0.8, -0.5, 0.4));
    let before = place.get("slipped.toml");
    let run = place.run("calibrate crossings --sequence scan.mha --config slipped.toml");
    assert!(run.code == 1 && run.stdout.contains("more than chance explains"), "{}", run.stdout);
    let advice = ["displaces the image by 1.0", "check the sensor on the probe and the scanner's depth"];
    assert!(advice.iter().all(|part| run.stderr.contains(part)), "{}", run.stderr);
    let said = place.does("calibrate crossings --sequence scan.mha --config slipped.toml -o new.toml --json=r.json");
    assert!(said.contains("more than chance explains"), "{said}");
    assert!(apart(&place, "slipped.toml", "probe.toml") > 1.0);
    assert!(apart(&place, "new.toml", "probe.toml") < 0.1, "{said}");
    assert_eq!(place.get("slipped.toml"), before, "the checked file stays");
    // The other contents stay, and the origin is told.
    let new = CalibrationFile::read(&place.path("new.toml")).unwrap();
    assert_eq!((new.spacing_mm, new.latency), (Some([0.7; 3]), None));
    assert!(new.provenance.contains("ImageToProbe: by crossings of scan.mha"), "{}", new.provenance);
    let inputs: Vec<&str> = new.record.origin.inputs.iter().map(|input| &*input.file).collect();
    assert_eq!(inputs, ["scan.mha", "slipped.toml"]);
    // Checked again, the new calibration holds.
    let again = place.does("calibrate crossings --sequence scan.mha --config new.toml");
    assert!(again.contains("the calibration holds"), "{again}");
}

#[test]
fn what_cannot_be_checked_or_corrected_is_refused() {
    let place = Place::new();
    place.does(SCAN);
    let check = "calibrate crossings --sequence scan.mha --config";
    place.refuses(&format!("{check} probe.toml -o new.toml"), &["new.toml: not written: the calibration holds"]);
    place.refuses(&format!("{check} probe.toml -o probe.toml"), &["probe.toml: exists already"]);
    place.refuses("calibrate crossings --sequence scan.mha", &["crossing slices need", "--config"]);
    slipped(&place, DVec3::new(5.0, 0.0, 0.0));
    place.refuses(
        &format!("{check} slipped.toml -o new.toml"),
        &["new.toml: not written", "crossings correct 3 at most; calibrate by a phantom"],
    );
    assert!(!place.path("new.toml").exists());
    slipped(&place, DVec3::new(1.0, 0.0, 0.0));
    place.put("other.toml", "");
    place.refuses(&format!("{check} slipped.toml -o other.toml"), &["other.toml: exists already"]);
    // One direction, and two.
    place.does("phantom -o one.mha --calibration one.toml --trajectory freehand --image-size 60x50 --pixel 0.5");
    place.refuses(
        "calibrate crossings --sequence one.mha --config one.toml",
        &["no check: ", "pairs of slices cross within the image, but 100 are needed", "tilted by 30°"],
    );
    place.does("phantom -o two.mha --calibration two.toml --trajectory crossing --image-size 160x150 --pixel 0.3 --frames 100 --gap 0.9");
    let run = place.run("calibrate crossings --sequence two.mha --config two.toml");
    assert!(run.code == 1 && run.stdout.contains("the sweeps do not tell whether it holds"), "{}", run.stdout);
    assert!(run.stderr.contains("no check: the sweeps have 2 directions") && !run.stdout.contains("calibration holds"));
    place.refuses(
        "calibrate crossings --sequence two.mha --config two.toml -o new.toml",
        &["the sweeps have 2 directions, but 3 determine a calibration"],
    );
}

/// A virtual bedside whose tracker has a latency that its configuration lacks.
const BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "160x150"
latency_ms = 25.0
[volume]
spacing_mm = 1.0
[record]
full_frame = true
[virtual]
scene = "blobs"
trajectory = "three-directions"
frames = 240
gap_mm = 0.45
pixel_mm = 0.3
[virtual.line]
latency_ms = 40.0
"#;

#[test]
fn lag_of_a_session_is_found_beside_its_calibration() {
    let place = Place::new();
    // Sweeps to and fro: going back tells the lag from a displacement.
    let session = place.recorded(BEDSIDE, 14);
    let run = place.run(&format!("calibrate crossings --session {session}"));
    assert!(run.code == 1 && run.stderr.contains("the tracker's latency is off by"), "{} {}", run.stdout, run.stderr);
    let said = place.does(&format!("calibrate crossings --session {session} -o new.toml --json=r.json"));
    let lag_s = place.json("r.json")["lag_s"][0].as_f64().unwrap();
    // The session is paired by −25 ms, and the tracker lags by 40 ms.
    assert!((lag_s - 0.065).abs() < 0.005, "{said}");
    let Latency { video_ms, tracker_ms, .. } = CalibrationFile::read(&place.path("new.toml")).unwrap().latency.unwrap();
    assert!(video_ms == 25.0 && (tracker_ms - 1e3 * lag_s).abs() < 1e-9, "{video_ms} {tracker_ms}");
    // The session itself is corrected without the new file, until that is undone.
    let said = place.does(&format!("correct calibration {session}"));
    assert!(said.contains("calibration: ") && said.contains("stored as correction 1"), "{said}");
    let run = place.run(&format!("replay {session} -o corrected.mha --quiet"));
    assert!(run.code == 0 && run.stderr.contains("corrections applied: 1 calibration"), "{}", run.stderr);
    place.does(&format!("correct undo {session} 1"));
    let run = place.run(&format!("replay {session} -o uncorrected.mha --quiet"));
    assert!(run.stderr.contains("the volume is the same as in the live session, bit by bit"), "{}", run.stderr);
    assert!(place.get("corrected.mha") != place.get("uncorrected.mha"));
    // With both, little is left to correct.
    let again = place.run(&format!("calibrate crossings --session {session} --config new.toml --json=again.json"));
    let left_s = place.json("again.json")["lag_s"][0].as_f64().unwrap();
    assert!(left_s.abs() < 0.005 && again.stdout.contains("the calibration holds"), "{left_s} {}", again.stdout);
}

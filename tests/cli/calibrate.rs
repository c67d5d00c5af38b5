//! `calibrate`: a stylus's tip and a phantom's pose from recordings with known truth, into one
//! calibration file.

use std::fmt::Write as _;

use glam::{DAffine3, DMat4, DQuat, DVec3};
use serde_json::Value;

use calibration::file::CalibrationFile;

use super::place::{Place, SMALL_BEDSIDE};

const TIP: DVec3 = DVec3::new(2.0, -5.0, 140.0);
const LANDMARKS: [[f64; 3]; 5] =
    [[0.0, 0.0, 0.0], [80.0, 5.0, 0.0], [75.0, 50.0, 20.0], [-5.0, 45.0, 5.0], [10.0, 0.0, 40.0]];

/// A sensor's name, pose in the tracker's frame, and status.
type Sensor = (&'static str, DAffine3, &'static str);

/// Returns a tracked sequence without images: the time and the sensors of each reading.
pub(super) fn tracked(readings: &[(f64, Vec<Sensor>)]) -> String {
    let mut text = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\nDimSize = 0 0 {}\n\
         Kinds = domain domain list\nElementNumberOfChannels = 1\nElementType = MET_OTHER\n",
        readings.len()
    );
    for (index, (time, sensors)) in readings.iter().enumerate() {
        for (name, pose, status) in sensors {
            let rows = DMat4::from(*pose).transpose().to_cols_array();
            let rows: Vec<String> = rows.iter().map(f64::to_string).collect();
            writeln!(text, "Seq_Frame{index:04}_{name}ToTrackerTransform = {}", rows.join(" ")).unwrap();
            writeln!(text, "Seq_Frame{index:04}_{name}ToTrackerTransformStatus = {status}").unwrap();
        }
        writeln!(text, "Seq_Frame{index:04}_Timestamp = {}", 100.0 + time).unwrap();
        writeln!(text, "Seq_Frame{index:04}_ImageStatus = INVALID").unwrap();
    }
    text + "ElementDataFile = LOCAL\n"
}

/// Returns 20 readings per second: poses of the stylus in the tracker's frame, in which the
/// reference moves.
fn sequence(tips: &[DVec3], factor: f64, status: fn(usize) -> &'static str) -> String {
    let reading = |(index, tip): (usize, &DVec3)| {
        let time = index as f64 / 20.0;
        let tracker_from_reference = DAffine3::from_rotation_translation(
            DQuat::from_rotation_y(0.5 + 0.02 * time.sin()),
            DVec3::new(200.0, -30.0, 100.0 + time),
        );
        let swing = DVec3::new((2.3 * time).cos(), (2.3 * time).sin(), 0.4 * time.sin()) * 0.5;
        let turn = DQuat::from_scaled_axis(swing) * DQuat::from_scaled_axis(DVec3::new(2.4, 0.3, -0.1));
        let reference_from_stylus = DAffine3::from_rotation_translation(turn, *tip - turn * TIP);
        let stylus = tracker_from_reference * reference_from_stylus;
        let scaled = |pose: DAffine3| DAffine3 { translation: pose.translation * factor, ..pose };
        let sensors =
            vec![("Stylus", scaled(stylus), status(index)), ("Reference", scaled(tracker_from_reference), "OK")];
        (time, sensors)
    };
    tracked(&tips.iter().enumerate().map(reading).collect::<Vec<_>>())
}

fn swing(factor: f64, status: fn(usize) -> &'static str) -> String {
    sequence(&[DVec3::new(30.0, 10.0, -20.0); 240], factor, status)
}

/// Returns the phantom's pose.
fn held() -> DAffine3 {
    DAffine3::from_rotation_translation(
        DQuat::from_scaled_axis(DVec3::new(0.2, -0.9, 0.4)),
        DVec3::new(-12.0, 8.0, 33.0),
    )
}

/// Touches each landmark for 2 s, with 0.7 s in between.
fn touches() -> String {
    let mut tips = Vec::new();
    let mut at = DVec3::new(-90.0, 0.0, 120.0);
    for landmark in LANDMARKS {
        let to = held().transform_point3(DVec3::from_array(landmark));
        tips.extend((1..14).map(|i| at.lerp(to, f64::from(i) / 14.0) + DVec3::Z * f64::from(i * (14 - i))));
        tips.extend([to; 40]);
        at = to;
    }
    sequence(&tips, 1.0, |_| "OK")
}

fn phantom() -> String {
    let mut text = "format = \"sonoweave-phantom\"\nversion = 1\nname = \"five holes\"\n".to_owned();
    for (number, [x, y, z]) in LANDMARKS.iter().enumerate() {
        writeln!(text, "[[landmark]]\nname = \"#{number}\"\nposition_mm = [{x:?}, {y:?}, {z:?}]").unwrap();
    }
    text
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn tip_and_phantom_pose_extend_one_calibration_file() {
    let place = Place::new();
    place.put("swing.mha", swing(1.0, |index| if index % 12 == 5 { "INVALID" } else { "OK" }));
    place.put("cal.toml", "format = \"sonoweave-calibration\"\nversion = 1\nprovenance = \"by hand\"\n\n[volume]\nspacing_mm = [0.5, 0.5, 0.5]\n");
    let said = place.does("calibrate pivot --sequence swing.mha -o cal.toml --json=pivot.json");
    assert!(
        said.contains("tip of Stylus at 2.000, -5.000, 140.000 mm") && said.contains("calibration: cal.toml"),
        "{said}"
    );
    assert!(said.contains("220 of 240 poses agree, 0 do not, refused: 20 pose_invalid"), "{said}");
    let report = place.json("pivot.json");
    let tip = DVec3::from_slice(&numbers(&report["tip_mm"]));
    assert!((tip - TIP).length() < 1e-6, "{tip}");
    assert!(report["residual_mm"].as_f64().unwrap() < 1e-6);
    assert_eq!((&report["poses"]["read"], &report["frame"]), (&Value::from(240), &Value::from("Reference")));
    assert_eq!(report["input"]["sha256"].as_str().unwrap().len(), 64);

    place.put("touched.mha", touches());
    place.put("phantom.toml", phantom());
    let said = place.does(
        "calibrate landmarks --phantom phantom.toml --sequence touched.mha --stylus-tip cal.toml -o cal.toml --json=landmarks.json",
    );
    assert!(said.starts_with("5 of 5 landmarks were touched, 0.000 mm off"), "{said}");
    let report = place.json("landmarks.json");
    let rows = numbers(&report["phantom_to_reference"]);
    let expected = DMat4::from(held()).transpose().to_cols_array();
    assert!(rows.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{rows:?}");
    assert_eq!(report["landmarks"].as_array().unwrap().len(), 5);

    let file = String::from_utf8(place.get("cal.toml")).unwrap();
    for kept in [
        "by hand; StylusTipToStylus: pivot, 220 poses of swing.mha",
        "PhantomToReference: 5 landmarks",
        "spacing_mm = [0.5, 0.5, 0.5]",
        "from = \"StylusTip\"",
    ] {
        assert!(file.contains(kept), "{file}");
    }
    place.does("inspect cal.toml");
    let file = CalibrationFile::read(&place.path("cal.toml")).unwrap();
    place.knows_origin(&file.origins["StylusTipToStylus"], &["swing.mha"]);
    place.knows_origin(&file.origins["PhantomToReference"], &["touched.mha", "phantom.toml"]);
}

#[test]
fn unsuitable_recordings_are_refused_without_output() {
    let place = Place::new();
    place.put("swing.mha", swing(1.0, |_| "OK"));
    place.put("invalid.mha", swing(1.0, |_| "INVALID"));
    place.put("cm.mha", swing(0.1, |_| "OK"));
    place.put("phantom.toml", phantom());
    place.put("touched.mha", touches());
    let pivot =
        |flags: &str, says: &[&str]| place.refuses(&format!("calibrate pivot -o cal.toml --json=r.json {flags}"), says);
    pivot(
        "--sequence invalid.mha",
        &["invalid.mha: none of 240 poses of Stylus is usable; the first: ", "has status INVALID"],
    );
    pivot("--sequence cm.mha", &["cm.mha: the tip ", "check the tracker's units"]);
    pivot("--sequence swing.mha --to 0.3", &["7 usable poses of the stylus are too few; record at least 10"]);
    pivot("--sequence swing.mha --from 3 --to 2", &["--from 3 is not before --to 2"]);
    pivot("--sequence swing.mha --stylus Pen", &["holds no frame Pen, only StylusToTracker, ReferenceToTracker"]);
    pivot("--sequence swing.mha --reference Table", &["no transforms lead from Stylus to Table"]);
    place.refuses("calibrate pivot --sequence swing.mha -o swing.mha", &["swing.mha: is the input"]);
    place.refuses("calibrate pivot --sequence swing.mha -o a --json=a", &["two outputs have the same file"]);
    place.refuses(
        "calibrate landmarks --phantom phantom.toml --sequence touched.mha -o cal.toml",
        &["phantom.toml: lacks the position of the tip of Stylus", "--stylus-tip"],
    );
    place.put("cal.toml", "format = \"sonoweave-calibration\"\nversion = 1\n");
    place.refuses(
        "calibrate landmarks --phantom phantom.toml --sequence touched.mha --stylus-tip cal.toml",
        &["cal.toml: lacks the position of the tip of Stylus", "calibrate pivot"],
    );
}

#[test]
fn session_poses_are_read_by_station_names() {
    let place = Place::new();
    let session = place.recorded(SMALL_BEDSIDE, 2);
    let refused = |flags: &str| {
        let words = format!("calibrate pivot --session {session} {flags}");
        let run = place.run(&words);
        place.check_refusal(&run, &words, &[&session]);
        run.stderr
    };
    let said = refused("");
    assert!(said.contains("holds no frame Stylus, only Probe, Reference; name the frame with --stylus"), "{said}");
    let said = refused("--stylus Probe --reference Table");
    assert!(said.contains("holds no frame Table") && said.contains("--reference"), "{said}");
    // There are poses of one second, and a sweep is not a pivot.
    for reference in ["", "--reference Tracker"] {
        let said = refused(&format!("--stylus Probe {reference}"));
        let swung = [
            "hardly turned",
            "turned about one axis only",
            "contradict the others",
            "the tip is ",
            "the tip strays by",
        ];
        assert!(swung.iter().any(|words| said.contains(words)), "{said}");
    }
    let run = place.run("calibrate pivot");
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(
        run.stderr.contains("--sequence <SEQUENCE>") && run.stderr.contains("--session <SESSION.mcap>"),
        "{}",
        run.stderr
    );
}

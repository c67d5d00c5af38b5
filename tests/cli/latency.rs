//! `calibrate latency`: from a tank's floor and from crossing slices, from files to the
//! calibration file of a session.

use std::f64::consts::TAU;

use calibration::file::CalibrationFile;
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter};
use sonoweave_core::reading::{NamedTransform, PixelType, Stamp, Status};

use super::place::Place;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 140;

/// Height of a probe that moves up and down, mm, without repetition.
fn height(time: f64) -> f64 {
    7.0 * (TAU * 0.9 * time + 1.4 * (TAU * 0.13 * time).sin()).sin() + 1.0 * (TAU * 0.31 * time).cos()
}

fn items(count: u32, time: impl Fn(u32) -> f64, height_of: Option<&dyn Fn(f64) -> f64>) -> Vec<SequenceItem> {
    let item = |i: u32| {
        let stamp = Stamp { item: u64::from(i), source_s: Some(time(i)), ..Stamp::default() };
        let transform = |height: f64| NamedTransform {
            stamp,
            from: "Probe".into(),
            to: "Tracker".into(),
            matrix: [1.0, 0.0, 0.0, 30.0, 0.0, 1.0, 0.0, -20.0, 0.0, 0.0, 1.0, 100.0 + height, 0.0, 0.0, 0.0, 1.0],
            status: Status::Ok,
        };
        let transforms = height_of.map(|of| transform(of(time(i)))).into_iter().collect();
        SequenceItem { stamp, frame_number: Some(u64::from(i)), status: Status::Ok, transforms, fields: Vec::new() }
    };
    (0..count).map(item).collect()
}

fn header(items: Vec<SequenceItem>) -> SequenceHeader {
    SequenceHeader {
        size: [WIDTH, HEIGHT],
        pixel: PixelType::U8,
        channels: 1,
        orientation: "MFA".into(),
        image_type: "BRIGHTNESS".into(),
        compressed: true,
        fields: Vec::new(),
        items,
    }
}

/// Frames of a floor, 0.2 mm per pixel, and poses whose time stamps are `lag` later than the
/// measurement.
fn tank(place: &Place, lag: f64) {
    let time = |i: u32| 100.0 + 0.07 * f64::from(i) + 0.004 * (f64::from(i) * 2.3).sin();
    let mut writer = SequenceWriter::create(&place.path("video.mha"), &header(items(200, time, None))).unwrap();
    for i in 0..200 {
        let row = 70.0 + height(time(i)) / 0.2;
        let pixel = |at: u32| {
            let (u, v) = (f64::from(at % WIDTH), f64::from(at / WIDTH));
            let off = v - row - 0.1 * (u - 80.0);
            // A static letter, brighter than the floor.
            let still = if at % WIDTH < 12 && at / WIDTH < 12 { 250.0 } else { 0.0 };
            let grain = 0.7 + 0.3 * (1.3 * u + 0.2 * f64::from(i)).sin();
            (150.0 * grain * (-0.2 * off * off).exp() + still).min(255.0) as u8
        };
        writer.write_frame(&(0..WIDTH * HEIGHT).map(pixel).collect::<Vec<u8>>()).unwrap();
    }
    writer.finish().unwrap();
    let time = |i: u32| 98.0 + 0.02 * f64::from(i);
    let poses = items(900, time, Some(&|time: f64| height(time - lag)));
    let mut writer = SequenceWriter::create(&place.path("tracker.mha"), &header(poses)).unwrap();
    let empty = vec![0; (WIDTH * HEIGHT) as usize];
    (0..900).for_each(|_| writer.write_frame(&empty).unwrap());
    writer.finish().unwrap();
}

/// Copies a sequence with later time stamps.
fn later(place: &Place, from: &str, to: &str, by: f64) {
    let bytes = place.get(from);
    let mark = b"ElementDataFile = LOCAL\n";
    let end = bytes.windows(mark.len()).position(|window| window == mark).unwrap();
    let line = |line: &str| match line.split_once("_Timestamp = ") {
        Some((name, time)) => format!("{name}_Timestamp = {:.9}\n", time.trim().parse::<f64>().unwrap() + by),
        None => format!("{line}\n"),
    };
    let header: String = std::str::from_utf8(&bytes[..end]).unwrap().lines().map(line).collect();
    place.put(to, [header.as_bytes(), &bytes[end..]].concat());
}

#[test]
fn floor_gives_lag_and_calibration_file_is_extended() {
    let place = Place::new();
    tank(&place, -0.0413);
    place.put(
        "probe.toml",
        "format = \"sonoweave-calibration\"\nversion = 1\nprovenance = \"N-wire\"\n[volume]\nspacing_mm = [0.5, 0.5, 0.5]\n",
    );
    let words =
        "calibrate latency --video video.mha --tracker tracker.mha --video-latency-ms 60 -o probe.toml --json=r.json";
    let said = place.does(words);
    assert!(said.starts_with("lag             -41.") && said.contains("the video lags the tracker"), "{said}");
    let report = place.json("r.json");
    let number = |key: &str| report[key].as_f64().unwrap();
    assert!((number("lag_s") + 0.0413).abs() < 5e-4, "{report}");
    assert!(number("lag_se_s") < 5e-4 && report["method"] == "line", "{report}");
    assert!((number("tracker_ms") - 60.0 - 1e3 * number("lag_s")).abs() < 1e-9, "{report}");
    assert_eq!(report["line"]["frames"]["used"], 200);
    assert!((report["line"]["mm_per_px"].as_f64().unwrap() - 0.2).abs() < 0.01, "{report}");
    let text = String::from_utf8(place.get("probe.toml")).unwrap();
    assert!(text.contains("provenance = \"N-wire; latency: by a tank's floor in video.mha (sha256 "), "{text}");
    assert!(text.contains("[latency]\nvideo_ms = 60.0\ntracker_ms = 18.") && text.contains("spacing_mm"), "{text}");
    let file = CalibrationFile::read(&place.path("probe.toml")).unwrap();
    place.knows_origin(&file.origins["latency"], &["video.mha", "tracker.mha"]);
    // A second run gives the same file, without duplicates.
    place.does(words);
    assert_eq!(String::from_utf8(place.get("probe.toml")).unwrap(), text);
}

#[test]
fn crossing_slices_give_lag_without_phantom() {
    let place = Place::new();
    let sweep = "phantom -o video.mha --calibration probe.toml --trajectory crossing --image-size 160x150 --pixel 0.3 --frames 140 --gap 0.7 --seed 5";
    place.does(sweep);
    let words = "calibrate latency --video video.mha --tracker tracker.mha --config probe.toml --method crossings --range-ms 200 -o probe.toml --json=r.json";
    for by in [0.0437, -0.025] {
        later(&place, "video.mha", "tracker.mha", by);
        let said = place.does(words);
        let report = place.json("r.json");
        let (lag, se) = (report["lag_s"].as_f64().unwrap(), report["lag_se_s"].as_f64().unwrap());
        assert!((lag - by).abs() < 3e-3 && se < 3e-3, "{by}: {said}");
        let text = String::from_utf8(place.get("probe.toml")).unwrap();
        assert!(text.contains("[image_to_probe]") && text.contains("[latency]\nvideo_ms = 0.0\n"), "{text}");
    }
    // A sweep without crossings is reported.
    place.does("phantom -o one.mha --trajectory parallel --image-size 60x50 --pixel 0.5 --frames 60");
    place.refuses(
        "calibrate latency --sequence one.mha --method crossings -o other.toml",
        &["no lag: 0 pairs of 60 slices cross", "sweep the same place twice"],
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
trajectory = "crossing"
frames = 140
gap_mm = 0.7
pixel_mm = 0.3
[virtual.line]
latency_ms = 40.0
[virtual.grabber]
jitter_ms = 1.0
"#;

#[test]
fn session_gives_total_lag_despite_pairing() {
    let place = Place::new();
    let session = place.recorded(BEDSIDE, 6);
    let said =
        place.does(&format!("calibrate latency --session {session} --method crossings -o probe.toml --json=r.json"));
    let report = place.json("r.json");
    let number = |key: &str| report[key].as_f64().unwrap();
    // The devices' times are those of the machine: a loaded one delivers later.
    assert!((number("lag_s") - 0.04).abs() < 8e-3 && number("lag_se_s") < 3e-3, "{said}");
    assert_eq!((number("video_ms"), number("paired_by_ms")), (25.0, -25.0));
    assert!((number("tracker_ms") - 25.0 - 1e3 * number("lag_s")).abs() < 1e-9, "{report}");
    assert!(said.contains("the session was reconstructed with a lag of -25.0 ms"), "{said}");
}

#[test]
fn unsuitable_recordings_are_refused_without_output() {
    let place = Place::new();
    tank(&place, 0.02);
    later(&place, "tracker.mha", "other.mha", 500.0);
    let to = "-o c.toml --json=r.json";
    place.refuses(
        &format!("calibrate latency --video video.mha --tracker other.mha {to}"),
        &["no lag: none of 900 poses is from the frames' time", "of one clock"],
    );
    place.refuses(
        &format!("calibrate latency --video tracker.mha --tracker tracker.mha --method line {to}"),
        &["no lag: 0 of 900 frames show the line of a floor", "900 frames without motion"],
    );
    place.refuses(
        &format!("calibrate latency --sequence video.mha {to}"),
        &["video.mha: holds no valid ProbeToTracker (it holds no transform)"],
    );
    place.refuses(
        &format!("calibrate latency --sequence video.mha --range-ms 5 {to}"),
        &["--range-ms 5: must lie between"],
    );
    place.refuses("calibrate latency --sequence video.mha -o video.mha", &["video.mha: is the input"]);
    place.refuses_with("calibrate latency --video video.mha -o c.toml", &[]);
    place.refuses_with("calibrate latency -o c.toml", &[]);
}

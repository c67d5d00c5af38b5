//! The tracker's latency relative to the video on a real recording of a water tank's floor,
//! compared with PLUS's result and its lines.

use std::path::Path;
use std::process::Command;

use glam::DVec2;
use libtest_mimic::Failed;
use serde_json::Value;

use calibration::latency::line::{Finder, Line, Still};
use calibration::picture::GreyView;
use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use sonoweave_core::{Next, Reading};

use crate::Test;

const VIDEO: &str = "latency/WaterTankBottomTranslationVideoBuffer.igs.mha";
const TRACKER: &str = "latency/WaterTankBottomTranslationTrackerBuffer.igs.mha";
const LINES: &str = "latency/LineSegmentationResultsBaseline.xml";

pub(crate) const TESTS: &[Test] = &[
    Test::of_folder("the_floor_is_found_where_plus_has_found_it", &[VIDEO, LINES], lines),
    Test::of_folder("the_lag_is_plus_s_and_known_to_2_ms", &[VIDEO, TRACKER], lag),
];

fn pictures(path: &Path, mut take: impl FnMut(&GreyView<'_>)) -> Result<(), Failed> {
    let mut device = drivers::open(&OpenSettings::Sequence(SequenceSettings::new(path)))?;
    device.start()?;
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE)? {
        if let Reading::Frame(frame) = reading {
            take(&GreyView::packed(frame.size.map(|side| side as usize), &frame.pixels)?);
        }
    }
    Ok(device.stop()?)
}

/// Returns PLUS's lines: a point and a direction.
fn baseline(path: &Path) -> Result<Vec<[DVec2; 2]>, Failed> {
    let text = std::fs::read_to_string(path)?;
    let document = roxmltree::Document::parse(&text)?;
    let pair = |node: &roxmltree::Node<'_, '_>, name: &str| -> Result<DVec2, Failed> {
        let text = node.attribute(name).ok_or("a line without numbers")?;
        let numbers = text.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        Ok(DVec2::new(numbers[0], numbers[1]))
    };
    let frames = document.descendants().filter(|node| node.has_tag_name("Frame"));
    frames.map(|node| Ok([pair(&node, "LineOriginPointPx")?, pair(&node, "LineDirectionVectorPx")?])).collect()
}

fn lines(folder: &Path) -> Result<(), Failed> {
    let theirs = baseline(&folder.join(LINES))?;
    let mut still: Option<Still> = None;
    pictures(&folder.join(VIDEO), |view| match &mut still {
        None => still = Some(Still::new(view)),
        Some(still) => assert!(still.add(view)),
    })?;
    let mut finder = Finder::new(still.ok_or("no pictures")?);
    let mut found: Vec<Line> = Vec::new();
    let mut without = 0;
    pictures(&folder.join(VIDEO), |view| match finder.find(view) {
        Ok(line) => found.push(line),
        Err(_) => without += 1,
    })?;
    assert_eq!((found.len(), without, theirs.len()), (201, 0, 201));
    let apart = |(line, [point, direction]): (&Line, &[DVec2; 2])| {
        // In the middle of the part that both see.
        let normal = DVec2::new(-direction.y, direction.x);
        let turned = line.angle_deg() - direction.y.atan2(direction.x).to_degrees();
        [normal.dot(line.point_px - *point), turned]
    };
    let apart: Vec<[f64; 2]> = found.iter().zip(&theirs).map(apart).collect();
    let rms = |of: usize| (apart.iter().map(|x| x[of] * x[of]).sum::<f64>() / apart.len() as f64).sqrt();
    let scatter = found.iter().map(|line| line.scatter_px).sum::<f64>() / found.len() as f64;
    println!("from PLUS's lines {:.2} px and {:.2}° rms; the echo scatters by {scatter:.2} px", rms(0), rms(1));
    // PLUS's points are the brightest of a few columns; ours are all columns' centres.
    assert!(rms(0) < 1.5 && rms(1) < 1.0 && scatter < 1.5);
    Ok(())
}

fn lag(folder: &Path) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    let [report, calibration] = ["r.json", "c.toml"].map(|name| place.path().join(name));
    let output = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
        .args(["calibrate", "latency", "--video"])
        .arg(folder.join(VIDEO))
        .arg("--tracker")
        .arg(folder.join(TRACKER))
        .arg("-o")
        .arg(&calibration)
        .arg(format!("--json={}", report.display()))
        .output()?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    println!("{}", String::from_utf8_lossy(&output.stdout));
    let report: Value = serde_json::from_slice(&std::fs::read(&report)?)?;
    let number = |key: &str| report[key].as_f64().ok_or(key.to_owned());
    let (lag_s, se_s) = (number("lag_s")?, number("lag_se_s")?);
    // PLUS: -0.0648266; an independent correlation of its signals: -0.062.
    assert!((lag_s + 0.0648).abs() < 3e-3 && se_s > 2e-4 && se_s <= 2e-3, "{lag_s} ± {se_s}");
    let frames = &report["line"]["frames"];
    assert_eq!((frames["used"].as_u64(), frames["without_line"].as_u64()), (Some(201), Some(0)));
    // The grabber's own count gives this accuracy: the raw stamps fluctuate.
    assert_eq!(report["line"]["stamps"][0], "counted");
    let wander_s = report["line"]["wander_s"][0].as_f64().ok_or("no wander")?;
    assert!((0.015..0.04).contains(&wander_s), "{wander_s}");
    let kept = calibration::file::CalibrationFile::read(&calibration)?.latency.ok_or("no latency")?;
    assert!((kept.tracker_ms - 1e3 * lag_s).abs() < 1e-9 && kept.video_ms == 0.0);
    Ok(())
}

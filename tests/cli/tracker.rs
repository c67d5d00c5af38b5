//! `calibrate tracker`: the noise of a static sensor, and a map of a room with metal in it.

use glam::{DAffine3, DQuat, DVec3};

use calibration::file::CalibrationFile;
use calibration::file::origin::Origin;
use calibration::tracker::noise::RestNoise;
use calibration::tracker::zones::{Zone, Zones};

use sonoweave_core::date::Date;

use super::calibrate::tracked;
use super::place::Place;

/// Returns reproducible pseudo-noise, uniform between −1.7 and 1.7.
fn scatter(index: usize, which: usize) -> f64 {
    let x = ((index * 7919 + which * 104_729) as f64 * 0.618_033_988_75).fract();
    (2.0 * x - 1.0) * 1.7
}

fn lying(drift_mm: f64) -> String {
    let reading = |index: usize| {
        let noise = DVec3::new(scatter(index, 1), scatter(index, 2), scatter(index, 3)) * 0.05;
        let turn = DQuat::from_scaled_axis(DVec3::new(scatter(index, 4), scatter(index, 5), scatter(index, 6)) * 5e-4);
        let at = DVec3::new(200.0 + drift_mm * index as f64 / 600.0, -40.0, 90.0) + noise;
        let status = if index == 7 { "INVALID" } else { "OK" };
        (index as f64 / 60.0, vec![("Probe", DAffine3::from_rotation_translation(turn, at), status)])
    };
    tracked(&(0..600).map(reading).collect::<Vec<_>>())
}

/// Two sensors, 100 mm apart on a rigid bar, carried along x; beyond x = 350 metal displaces the
/// second one.
fn carried() -> String {
    let reading = |index: usize| {
        let t = index as f64 / 600.0;
        let one = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(4.0 * t),
            DVec3::new(100.0 + 400.0 * t, 20.0 * (9.0 * t).sin(), 150.0),
        );
        let mut other = one * DAffine3::from_translation(DVec3::new(0.0, 0.0, 100.0));
        if one.translation.x > 350.0 {
            other.translation.x += 4.0;
        }
        (index as f64 / 60.0, vec![("Probe", one, "OK"), ("Reference", other, "OK")])
    };
    tracked(&(0..600).map(reading).collect::<Vec<_>>())
}

#[test]
fn static_sensor_noise_is_reported_and_moving_refused() {
    let place = Place::new();
    place.put("lying.igs.mha", lying(0.0));
    let said = place.does("calibrate tracker --sequence lying.igs.mha --json=noise.json");
    let report = place.json("noise.json");
    let rms = report["position_rms_mm"].as_f64().unwrap();
    // Uniform over ±1.7·0.05 mm along three axes.
    assert!((rms / 0.085 - 1.0).abs() < 0.1, "{rms}");
    assert_eq!((&report["poses"]["usable"], &report["poses"]["read"]), (&599.into(), &600.into()));
    assert!(said.contains("refused: 1 pose_invalid") && said.contains("report: noise.json"), "{said}");
    place.put("moved.igs.mha", lying(30.0));
    place.refuses(
        "calibrate tracker --sequence moved.igs.mha --json=moved.json",
        &["moved.igs.mha: the sensor has moved", "lay it down"],
    );
    place.refuses("calibrate tracker --sequence lying.igs.mha --sensor Stylus", &["holds no frame Stylus"]);
    place.does("calibrate tracker --sequence lying.igs.mha -o cal.toml");
    let file = CalibrationFile::read(&place.path("cal.toml")).unwrap();
    let noise = file.tracker_noise.unwrap();
    let RestNoise { whole, fast } = noise;
    assert!((whole.position_mm * 3.0_f64.sqrt() / rms - 1.0).abs() < 1e-9 && whole.rotation_deg >= 0.0, "{noise:?}");
    let fast_rms = report["fast_rms_mm"].as_f64().unwrap();
    assert!((fast.unwrap().position_mm * 3.0_f64.sqrt() / fast_rms - 1.0).abs() < 1e-9, "{noise:?}");
    place.knows_origin(&file.origins["tracker_noise"], &["lying.igs.mha"]);
}

#[test]
fn room_map_names_zones_with_metal() {
    let place = Place::new();
    place.put("carried.igs.mha", carried());
    place.put("cal.toml", "format = \"sonoweave-calibration\"\nversion = 1\n[volume]\nspacing_mm = [0.5, 0.5, 0.5]\n");
    let said =
        place.does("calibrate tracker --sequence carried.igs.mha --other Reference -o cal.toml --json=room.json");
    let report = place.json("room.json");
    assert!((report["distance_mm"].as_f64().unwrap() - 100.0).abs() < 0.01, "{report}");
    let cells = report["cells"].as_array().unwrap();
    assert!(cells.iter().any(|cell| cell["warned_of"] == true) && cells.iter().any(|cell| cell["warned_of"] == false));
    for cell in cells {
        let x = cell["low_mm"][0].as_f64().unwrap();
        assert_eq!(cell["warned_of"], x >= 350.0, "{cell}");
    }
    assert!(said.contains("metal distorts the field there") && said.contains("calibration: cal.toml"), "{said}");
    let file = CalibrationFile::read(&place.path("cal.toml")).unwrap();
    let zones = file.distortion.unwrap();
    assert!(zones.count() > 0 && zones.all().all(|zone| zone.low_mm.x >= 350.0 && zone.rms_mm > 1.0), "{zones:?}");
    assert_eq!((zones.cell_mm(), zones.limit_mm(), file.spacing_mm), (50.0, 1.0, Some([0.5; 3])));
    assert!(file.provenance.starts_with("Distortion: "), "{}", file.provenance);
    assert_eq!(zones.measured(), Some(Date::today()));
    let origin = Origin { made: zones.measured(), ..file.origins["distortion"].clone() };
    place.knows_origin(&origin, &["carried.igs.mha"]);
    let printed = place.does("inspect cal.toml");
    assert!(printed.contains("cells of 50 mm where the tracker errs by more than 1 mm"), "{printed}");
    let said = place.does("calibrate tracker --sequence carried.igs.mha --other Reference --limit 5");
    assert!(said.contains("are within 5 mm"), "{said}");
    // Larger cells are fewer, and begin at multiples of their edge.
    place.does("calibrate tracker --sequence carried.igs.mha --other Reference --cell 100 --json=large.json");
    let large = place.json("large.json");
    let large_cells = large["cells"].as_array().unwrap();
    assert!(large["cell_mm"] == 100.0 && !large_cells.is_empty() && large_cells.len() < cells.len(), "{large}");
    let pairs = |cells: &[serde_json::Value]| cells.iter().map(|cell| cell["pairs"].as_u64().unwrap()).sum::<u64>();
    assert_eq!(pairs(large_cells), pairs(cells), "the same pairs lie in them");
    for cell in large_cells {
        assert_eq!(cell["low_mm"][0].as_f64().unwrap() % 100.0, 0.0, "{cell}");
    }
    for (flags, says) in [("--other Reference --cell 0", "must be above 0"), ("--cell 20", "--other <NAME>")] {
        let run = place.run(&format!("calibrate tracker --sequence carried.igs.mha {flags}"));
        assert!(run.code == 2 && run.stderr.contains(says), "{flags}: {}", run.stderr);
    }
}

#[test]
fn session_and_replay_count_frames_in_zones() {
    let place = Place::new();
    let rows = [0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0];
    // The zones are everywhere.
    let corners = (0..8).map(|n| DVec3::new((n & 1).into(), (n >> 1 & 1).into(), (n >> 2).into()));
    let all = corners.map(|corner| Zone { low_mm: (corner - 1.0) * 1e4, rms_mm: 2.0 }).collect();
    let file = CalibrationFile {
        probe_from_image: Some(sonoweave_core::frames::Transform::from_rows(&rows).unwrap()),
        distortion: Some(Zones::new(1e4, 1.0, None, all)),
        ..CalibrationFile::default()
    };
    file.write(&place.path("cal.toml")).unwrap();
    place.put(
        "bedside.toml",
        "format = \"sonoweave-bedside\"\nversion = 1\n[calibration]\nfile = \"cal.toml\"\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n\
         [grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n[record]\nfull_frame = true\n",
    );
    let run = place.run("live --config bedside.toml --check");
    assert!(run.stdout.contains("8 cells of 10000 mm where the tracker errs by more than 1 mm"), "{}", run.stdout);
    let run = place.run("live --config bedside.toml --duration 3 --record sessions --json=live.json --headless");
    assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
    let live = place.json("live.json");
    let frames = live["distortion"]["frames"].as_u64().unwrap();
    assert!(frames > 0 && frames >= live["frames"]["used"].as_u64().unwrap(), "{live}");
    assert_eq!((&live["distortion"]["zones"], &live["distortion"]["entered"]), (&8.into(), &1.into()));
    assert!(run.stderr.contains("has come to where metal bends the tracker's field, by 2.0 mm"), "{}", run.stderr);
    assert!(
        run.stdout.contains(&format!("metal distorted the tracker's field during {frames} frames")),
        "{}",
        run.stdout
    );
    let entry = std::fs::read_dir(place.path("sessions")).unwrap().next().unwrap().unwrap();
    let run = place.run(&format!("replay {} --speed max --json=again.json", entry.path().display()));
    assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
    assert_eq!(place.json("again.json")["distortion"]["frames"], frames);
}

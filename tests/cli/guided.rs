//! `calibrate … --live`: devices are recorded while the program instructs the user, and the
//! recording is used for the calibration.

use super::place::Place;

/// A configuration before the probe calibration: the pose of the image is unknown.
const BEDSIDE: &str = "\
format = \"sonoweave-bedside\"
version = 1
[tracker]
model = \"fastrak\"
port = \"virtual\"
probe_station = 1
reference_station = 2
[grabber]
device = \"/dev/video-of-nobody\"
[virtual]
[virtual.line]
";

#[test]
fn sensor_on_breathing_patient_is_never_static() {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE);
    // It permits no insertion.
    place.refuses("live --config bedside.toml --duration 1", &["[calibration] (line 1): is missing: give file = "]);
    let run = place.run(
        "calibrate tracker --live bedside.toml --sensor Reference --record sessions --duration 5 --json=noise.json",
    );
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{}", run.stderr);
    for says in ["recorded in sessions/", "lay it down, let go of it", "ended: the sensor lies still for ", ".mcap: "] {
        assert!(run.stderr.contains(says), "{says}: {}", run.stderr);
    }
    assert!(!run.stderr.contains("enough"), "{}", run.stderr);
    // The recording is an ordinary one.
    let entry = std::fs::read_dir(place.path("sessions")).unwrap().next().unwrap().unwrap();
    let session = format!("sessions/{}", entry.file_name().to_string_lossy());
    place.refuses_with(
        &format!("calibrate tracker --session {session} --sensor Reference"),
        &["the sensor has moved", "lay it down"],
    );
    place.refuses_with(&format!("replay {session}"), &["[calibration] (line 1): is missing: give file = "]);
}

#[test]
fn missing_motion_is_reported_to_the_user() {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE);
    let run =
        place.run("calibrate pivot --live bedside.toml --stylus Reference --record sessions --duration 3 -o tip.toml");
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{}", run.stderr);
    // While it runs, and at its end.
    let printed = "sonoweave:   0 %: the stylus was hardly turned";
    assert!(
        run.stderr.contains(printed) && run.stderr.contains(".mcap: the stylus was hardly turned"),
        "{}",
        run.stderr
    );
    assert!(!place.names().contains("tip.toml"));
    place.refuses_with("calibrate pivot --live bedside.toml --sequence a.mha", &[]);
    for what in ["pivot --sequence a.mha", "latency --sequence a.mha", "tracker --sequence a.mha"] {
        place.refuses_with(&format!("calibrate {what} --record sessions"), &["--record: applies to --live"]);
    }
    place.refuses_with("calibrate pivot --live bedside.toml --duration 1e300", &["must be 0.1 to 1000000 seconds"]);
    // Frames are recorded by the same rule as elsewhere.
    place.refuses_with("calibrate latency --live bedside.toml --record sessions --duration 1", &["clip_px"]);
}

/// A phantom of N-wires under a grabber with 40 ms of latency; the pose of its image is unknown.
const SCANNED: &str = r#"format = "sonoweave-bedside"
version = 1
[calibration]
clip_px = "none"
[record]
full_frame = true
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "320x240"
[virtual]
scene = "n-wire"
frames = 240
tracker_noise_mm = 0.05
tracker_noise_deg = 0.05
[virtual.grabber]
latency_ms = 40.0
"#;

/// The same with crossing wires, or over a tank's floor, with ample rotation of the probe.
fn turning(scene: &str) -> String {
    SCANNED.replace("scene = \"n-wire\"", &format!("scene = \"{scene}\"\ntrajectory = \"about\""))
}

#[test]
#[ignore = "takes 19 s of processor time: make stress"]
fn point_or_plane_scan_reports_uncertainty_until_goal() {
    // The limits are twice the largest errors of four runs, at the middle and the corners.
    let scans = [("cross-wire", "point", "0.5", [0.24, 0.52]), ("tank-floor", "plane", "0.7", [0.52, 0.72])];
    for (scene, method, goal, within) in scans {
        let place = Place::new();
        place.put("bedside.toml", turning(scene));
        place.does(&format!(
            "phantom -o scan.mha --scene {scene} --frames 2 --image-size 320x240 --calibration truth.toml"
        ));
        let run = place.run(&format!(
            "calibrate probe --live bedside.toml --method {method} --record sessions --goal {goal} --duration 100 -o probe.toml"
        ));
        assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
        assert!(run.stderr.contains("enough: a point is known to 0."), "{}", run.stderr);
        let [middle, corner] = place.pixels_apart(["probe.toml", "truth.toml"], [320, 240]);
        assert!(middle < within[0] && corner < within[1], "{method}: {middle} {corner}; {}", run.stdout);
    }
}

#[test]
fn nwire_scan_reports_uncertainty_until_goal() {
    let place = Place::new();
    place.put("bedside.toml", SCANNED);
    place.does(
        "phantom -o scan.mha --scene n-wire --frames 2 --image-size 320x240 --phantom phantom.toml --calibration truth.toml",
    );
    let run = place.run(
        "calibrate probe --live bedside.toml --phantom phantom.toml --record sessions --goal 0.5 --duration 100 -o probe.toml",
    );
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    assert!(run.stderr.contains("enough: a point is known to 0."), "{}", run.stderr);
    assert!(run.stdout.contains("frames of the phantom n-wire used"), "{}", run.stdout);
    let [middle, corner] = place.pixels_apart(["probe.toml", "truth.toml"], [320, 240]);
    // The scan ends when a corner is known to 0.5 mm (one standard deviation). The limits are twice
    // the largest of six runs, 0.20 and 0.45 mm.
    assert!(middle < 0.4 && corner < 0.9, "{middle} {corner}");
}

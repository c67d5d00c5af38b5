//! `calibrate … --live`: devices are recorded while it is said what to do, and the recording is what is calibrated.

use super::place::Place;

/// A bedside before its probe is calibrated: nobody knows where the picture lies.
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
fn a_still_sensor_s_noise_is_enough_after_ten_seconds_of_stillness() {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE);
    // Nothing can be woven by it.
    place.refuses("live --config bedside.toml --duration 1", &["where does the picture lie against the probe?"]);
    let run = place.run(
        "calibrate tracker --live bedside.toml --sensor Reference --record sessions --duration 60 --report noise.json",
    );
    assert!(run.code == 0 && run.stdout.contains("Reference lay at"), "{}{}", run.stdout, run.stderr);
    for says in ["recorded in sessions/", "lay it down, let go of it", "enough: the sensor lies still for 10 of 10 s"] {
        assert!(run.stderr.contains(says), "{says}: {}", run.stderr);
    }
    let report = place.json("noise.json");
    // A FASTRAK of two sensors gives 60 poses a second of each, for the ten seconds that were asked for and little more.
    let usable = report["poses"]["usable"].as_u64().unwrap();
    assert!((400..900).contains(&usable), "{report}");
    let input = report["input"]["path"].as_str().unwrap();
    assert!(input.starts_with("sessions/") && input.ends_with(".mcap"), "{input}");
    // The recording is one like others.
    let again = place.does(&format!("calibrate tracker --session {input} --sensor Reference --from 2"));
    assert!(again.contains("Reference lay at"), "{again}");
    place.refuses_with(&format!("replay {input}"), &["where does the picture lie against the probe?"]);
}

#[test]
fn who_does_not_do_what_is_asked_is_told_what_is_missing() {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE);
    let run =
        place.run("calibrate pivot --live bedside.toml --stylus Reference --record sessions --duration 3 -o tip.toml");
    assert_eq!((run.code, run.stdout.as_str()), (1, ""), "{}", run.stderr);
    // On the way, and in the end.
    let told = "sonoweave:   0 %: the stylus was hardly turned";
    assert!(run.stderr.contains(told) && run.stderr.contains(".mcap: the stylus was hardly turned"), "{}", run.stderr);
    assert!(!place.names().contains("tip.toml"));
    place.refuses_with("calibrate pivot --live bedside.toml --sequence a.mha", &[]);
    for what in ["pivot --sequence a.mha", "latency --sequence a.mha", "tracker --sequence a.mha"] {
        place.refuses_with(&format!("calibrate {what} --record sessions"), &["--record: is of --live"]);
    }
    // Pictures are recorded by the same rule as elsewhere.
    place.refuses_with("calibrate latency --live bedside.toml --record sessions --duration 1", &["clip_px"]);
}

/// A phantom of N-wires under a grabber that is late by 40 ms; of the place of its picture nothing is known.
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

#[test]
fn who_scans_is_told_how_well_the_picture_s_place_is_known_until_it_is_enough() {
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
    assert!(run.stdout.contains("pictures of the phantom n-wire used"), "{}", run.stdout);
    // Where the picture begins: at the transducer's face, where an error of its turn shows.
    let begins = |name: &str| {
        let file: toml::Table = std::str::from_utf8(&place.get(name)).unwrap().parse().unwrap();
        let rows: Vec<f64> =
            file["image_to_probe"]["matrix"].as_array().unwrap().iter().map(|x| x.as_float().unwrap()).collect();
        glam::DVec3::new(rows[3], rows[7], rows[11])
    };
    let off = begins("probe.toml").distance(begins("truth.toml"));
    assert!(off < 1.5, "{off}");
}

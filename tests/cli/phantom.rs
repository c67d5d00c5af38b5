//! `phantom`: its outputs, and their use by the other commands.

use std::process::Stdio;

use super::place::Place;

const SMALL: &str = "phantom --image-size 60x50 --pixel 0.5 --frames 20 --gap 0.5";

#[test]
fn equal_flags_give_equal_bits() {
    let place = Place::new();
    place.does(&format!("{SMALL} -o a.mha --truth ta.mha --seed 3"));
    place.does(&format!("{SMALL} -o b.mha --truth tb.mha --seed 3"));
    place.does(&format!("{SMALL} -o c.mha --truth tc.mha --seed 4"));
    assert!(place.get("a.mha") == place.get("b.mha") && place.get("ta.mha") == place.get("tb.mha"));
    assert!(place.get("a.mha") != place.get("c.mha") && place.get("ta.mha") != place.get("tc.mha"));
}

#[test]
fn truth_is_on_the_reconstruction_lattice() {
    let place = Place::new();
    for spacing in ["0.5", "0.7", "0.4,0.5,1.1"] {
        place.does(&format!("{SMALL} -o s.mha --truth t.mha --spacing {spacing}"));
        place.does(&format!("reconstruct s.mha -o v.mha --spacing {spacing}"));
        let report = place.does("inspect v.mha --against t.mha --json");
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert!(report["comparison"]["correlation"].as_f64().unwrap() > 0.95, "{report}");
    }
}

#[test]
fn tracker_poses_and_calibration_give_the_same_volume() {
    let place = Place::new();
    for flags in ["", "--fan --compress --type f32 --scene ramp --noise 1"] {
        place.does(&format!("{SMALL} {flags} -o direct.mha"));
        place.does(&format!("{SMALL} {flags} -o tracked.mha --calibration c.toml"));
        place.refuses("reconstruct tracked.mha -o v.mha", &["no way from Image to Reference", "ImageToProbe"]);
        place.does("reconstruct tracked.mha --config c.toml -o t.mha --type f32 --clip none --unseen -1000");
        // It notes that the file's calibration is not needed; the file's fan is.
        let run = place.run("reconstruct direct.mha --config c.toml -o d.mha --type f32 --clip none --unseen -1000");
        assert_eq!(run.code, 0, "{}", run.stderr);
        let (direct, tracked) = (place.volume("d.mha"), place.volume("t.mha"));
        assert_eq!(direct.header.size, tracked.header.size);
        let far = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 0.01;
        let differing = direct.values.iter().zip(&tracked.values).filter(far).count();
        // Rounding may remove a voxel at the support's end from one of the two.
        assert!(differing * 1000 < direct.values.len(), "{differing} of {}", direct.values.len());
    }
}

const SCENES: [&str; 12] = [
    "constant",
    "ramp",
    "blobs",
    "sphere",
    "plane",
    "zone-plate",
    "sinusoid",
    "wires",
    "sheet",
    "marschner-lobb",
    "speckle",
    "pulsating",
];

const TRAJECTORIES: [&str; 10] = [
    "parallel",
    "jittered",
    "fan",
    "rotation",
    "arm",
    "freehand",
    "crossing",
    "three-directions",
    "dwell",
    "out-and-back",
];

#[test]
fn every_scene_and_trajectory_is_simulated() {
    let place = Place::new();
    // Every scene and every trajectory, each with several of the others.
    for (k, scene) in SCENES.iter().enumerate() {
        for trajectory in TRAJECTORIES.iter().skip(k % 3).step_by(3) {
            let said = place.does(&format!(
                "phantom -o s.mha --truth t.mha --truth-blurred b.mha --image-size 20x16 --pixel 1.5 --frames 5 --gap 2 --dwell 2 --noise 2 --spacing 2 --scene {scene} --trajectory {trajectory}"
            ));
            assert!(
                said.contains(&format!("scene {scene}")) && said.contains(&format!("trajectory {trajectory}")),
                "{said}"
            );
            place.does_narrowly("reconstruct s.mha --path general -o v.mha --spacing 2 --clip none");
            let [sharp, blurred] = ["t.mha", "b.mha"].map(|name| place.volume(name));
            assert_eq!(sharp.header.size, blurred.header.size);
            assert!(blurred.values.iter().all(|v| (0.0..=255.0).contains(v)), "{scene}");
            assert_eq!(sharp.values == blurred.values, ["constant", "ramp"].contains(scene), "{scene}");
            let provenance = blurred.field("SonoweavePhantom");
            assert!(provenance.starts_with(&format!("scene {scene}")), "{provenance}");
            assert!(blurred.field("SonoweaveTruthKernel").starts_with("Gaussian, sigma u 1.4"));
        }
    }
}

#[test]
fn blurred_truth_matches_the_reconstruction() {
    let place = Place::new();
    let rmse = |truth: &str| {
        let report = place.does(&format!("inspect v.mha --against {truth} --json"));
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        report["comparison"]["rmse"].as_f64().unwrap()
    };
    for scene in ["blobs", "sphere", "marschner-lobb", "sinusoid"] {
        place.does(&format!(
            "phantom -o s.mha --truth t.mha --truth-blurred b.mha --image-size 100x90 --pixel 0.25 --frames 61 --gap 0.4 --noise 0 --type f32 --scene {scene} --trajectory parallel"
        ));
        place.does("reconstruct s.mha -o v.mha --clip none --path general");
        let (sharp, blurred) = (rmse("t.mha"), rmse("b.mha"));
        // The remaining error is at the ends of the sweep, where the data are one-sided.
        assert!(blurred < 0.35 * sharp, "{scene}: {blurred} against {sharp}");
    }
    // Another kernel has another truth.
    let default = place.get("b.mha");
    place.does(&format!("{SMALL} -o s.mha --truth-blurred b.mha --sigma 0.3,0.3,0.3 --scene sinusoid"));
    assert!(place.get("b.mha") != default);
    assert_eq!(
        place.volume("b.mha").field("SonoweaveTruthKernel"),
        "Gaussian, sigma u 0.300000 v 0.300000 n 0.300000 mm"
    );
}

#[test]
fn moving_scene_truth_is_at_the_requested_time() {
    let place = Place::new();
    let bright = |flags: &str| {
        place.does(&format!("{SMALL} --scene pulsating -o s.mha --truth t.mha {flags}"));
        place.volume("t.mha").values.iter().filter(|v| **v > 120.0).count()
    };
    let (wide, narrow) = (bright("--truth-time 0.25"), bright("--truth-time 0.75"));
    assert!(wide > narrow, "{wide} {narrow}");
    assert_eq!(place.volume("t.mha").field("SonoweaveTruthTime"), "0.75 s");
    // Twenty frames at 4 Hz: the last one is taken after 4.75 s.
    assert_eq!(bright("--rate 4"), narrow);
}

#[test]
fn tracker_noise_changes_poses_only() {
    let place = Place::new();
    place.does(&format!("{SMALL} -o a.mha --truth ta.mha"));
    let said = place.does(&format!("{SMALL} -o b.mha --truth tb.mha --tracker-noise 0.5,0.1"));
    assert!(said.contains("tracker noise 0.5 mm 0.1 deg"), "{said}");
    assert!(place.get("a.mha") != place.get("b.mha"));
    assert!(place.volume("ta.mha").values == place.volume("tb.mha").values);
    let pixels = 60 * 50 * 20;
    let ends = ["a.mha", "b.mha"].map(|name| place.get(name).split_off(place.get(name).len() - pixels));
    assert!(ends[0] == ends[1], "the pictures are the same");
}

#[test]
fn impossible_phantom_is_refused_without_output() {
    let place = Place::new();
    for (flags, says) in [
        ("-o s.mha --frames 0", "a scan of 0 frames cannot be made"),
        ("-o s.mha --gap 0", "the gap between slices is 0 mm"),
        ("-o s.mha --pixel 0", "the distance of pixels is 0 mm"),
        ("-o s.mha --noise nan", "the noise has a standard deviation of NaN"),
        ("-o s.mha --grey inf --scene constant", "--grey inf: must be finite"),
        ("-o s.mha --rate 0", "--rate 0: must lie between"),
        ("-o s.mha --scene speckle --grain 0", "--grain 0: must be a positive, finite length"),
        ("-o s.mha --trajectory rotation --radius 1", "the picture would turn by"),
        ("-o s.mha --trajectory rotation --radius 0", "the radius of the rotation is 0 mm"),
        ("-o s.mha --trajectory dwell --dwell 120", "a dwell of 120 frames leaves nothing of 120 frames"),
        ("-o s.mha --tracker-noise 11,0", "the tracker's noise is 11 mm and 0°"),
        ("-o s.mha --truth t.mha --truth-time 1e12", "--truth-time 1000000000000: must be a time"),
        (
            "-o s.mha --truth-blurred b.mha --scene marschner-lobb --sigma 0.001,1,1 --image-size 60x50 --pixel 0.5",
            "larger smallest σ",
        ),
        ("-o s.mha --truth t.mha --truth-blurred t.mha", "t.mha: is the name of two outputs"),
        ("-o s.mha --truth-blurred b.seq.nrrd", "b.seq.nrrd: volumes are written as .mha"),
        ("-o s.mha --trajectory fan --axis-distance 1", "the fan would turn by"),
        ("-o s.mha --image-size 100000x100000", "cannot be painted"),
        ("-o s.mha --image-size 9x1 --fan", "--fan: "),
        ("-o s.mha --truth t.mha --spacing 0.001", "larger than the limit"),
        ("-o s.mha --truth s.mha", "s.mha: is the name of two outputs"),
        ("-o s.mha --calibration none/c.toml", "none/c.toml: the folder none does not exist"),
        ("-o none/s.mha", "none/s.mha: the folder none does not exist"),
        ("-o s.nii", "s.nii: sequences are written as .mha"),
        ("-o s.mha --truth t.png", "t.png: volumes are written as .mha"),
        ("-o .", "is not a file"),
    ] {
        place.refuses(&format!("phantom {flags}"), &[says]);
    }
}

#[test]
fn every_body_scan_is_usable_by_other_commands() {
    let place = Place::new();
    for (scene, field, crossings) in [
        ("doll", "fan ", 0),
        ("thigh", "fan ", 0),
        ("n-wire", "clip ", 9),
        ("cross-wire", "clip ", 2),
        ("tank-floor", "clip ", 0),
        ("stylus", "clip ", 0),
    ] {
        let said = place.does(&format!(
            "phantom --scene {scene} -o s.mha --truth t.mha --spacing 3 --crossings w.csv --calibration c.toml --image-size 120x100 --frames 4 --trajectory parallel"
        ));
        assert!(said.contains(&format!("scene {scene}")) && said.contains(field) && said.contains("noise 0"), "{said}");
        let wires = String::from_utf8(place.get("w.csv")).unwrap();
        let lines: Vec<&str> = wires.lines().skip(1).filter(|line| !line.starts_with(',')).collect();
        assert_eq!(lines.len(), 4 * crossings, "{scene}: {wires}");
        // The file's fan or clip, and the tracker's poses, lead to a volume.
        place.does_narrowly("reconstruct s.mha --config c.toml --path general -o v.mha --spacing 3");
        assert!(place.volume("v.mha").values.iter().any(|v| *v > 20.0), "{scene}");
        assert!(place.volume("t.mha").values.iter().all(|v| (0.0..=255.0).contains(v)), "{scene}");
    }
}

#[test]
fn scanner_flags_change_frames_and_need_a_body_scene() {
    let place = Place::new();
    let made = |flags: &str| {
        place.does(&format!("phantom --scene thigh -o s.mha --image-size 120x100 --frames 2 {flags}"));
        place.get("s.mha")
    };
    let plain = made("");
    assert!(plain == made("") && plain == made("--probe curvilinear --depth 120"));
    for flags in ["--probe linear --depth 60", "--mhz 5", "--focus 30", "--tgc 1", "--dynamic-range 40", "--seed 2"] {
        assert!(plain != made(flags), "{flags}");
    }
    for effect in
        ["speckle", "surfaces", "attenuation", "reverberation", "ringing", "focusing", "tgc", "noise", "speckle,noise"]
    {
        assert!(plain != made(&format!("--without {effect}")), "{effect}");
    }
    place.refuses("phantom -o r.mha --depth 50", &["need a simulated scanner", "doll"]);
    place.refuses("phantom -o r.mha --crossings w.csv", &["need a simulated scanner"]);
    place.refuses("phantom -o r.mha --scene doll --fan", &["a scanner's field is its own fan"]);
    place.refuses("phantom -o r.mha --scene doll --depth 0", &["the depth, mm, is 0; it must lie between 1 and 400"]);
    place.refuses("phantom -o r.mha --scene doll --pixel 0", &["the distance of pixels is 0 mm"]);
}

#[test]
fn normal_and_frequency_shape_their_scenes() {
    let place = Place::new();
    let truth = |flags: &str| {
        place.does(&format!("{SMALL} -o s.mha --truth t.mha --spacing 1 {flags}"));
        place.volume("t.mha")
    };
    // A plane across an axis and a wave along it change along this axis only.
    for (flags, along) in [
        ("--scene plane --normal 5,0,0", 0),
        ("--scene plane --normal 0,-2,0", 1),
        ("--scene sinusoid --frequency 0.1,0,0", 0),
        ("--scene sinusoid --frequency 0,0,-0.1", 2),
    ] {
        let volume = truth(flags);
        let middle = volume.header.size.map(|size| i64::from(size) / 2);
        let values = |axis: usize| -> Vec<f32> {
            let at = |n: i64| std::array::from_fn(|a| if a == axis { n } else { middle[a] });
            (0..i64::from(volume.header.size[axis])).map(|n| volume.at(at(n)).unwrap()).collect()
        };
        let spread = |axis: usize| {
            let of = values(axis);
            of.iter().copied().fold(f32::MIN, f32::max) - of.iter().copied().fold(f32::MAX, f32::min)
        };
        for axis in 0..3 {
            assert_eq!(spread(axis) > 10.0, axis == along, "{flags}: {} along {axis}", spread(axis));
        }
    }
    for (flags, says) in [
        ("--scene plane --normal 0,0,0", "must not be zero"),
        ("--scene plane --normal 1,2", "3 numbers"),
        ("--scene sinusoid --frequency 101,0,0", "must be at most 100 cycles per mm"),
        ("--scene sinusoid --frequency x,0,0", "number"),
    ] {
        let run = place.run(&format!("{SMALL} -o r.mha {flags}"));
        assert!(run.code == 2 && run.stderr.contains(says), "{flags}: {}", run.stderr);
    }
}

#[test]
fn log_filter_shows_messages_of_its_level() {
    let place = Place::new();
    let said = |filter: &str| place.run(&format!("{SMALL} -o s.mha --log {filter}")).stderr;
    assert_eq!(said("error"), "");
    place.does(&format!("{SMALL} -o s.mha"));
    let run = |filter: &str| place.run(&format!("reconstruct s.mha -o v.mha --log {filter}"));
    let (quiet, told) = (run("off"), run("trace"));
    assert_eq!((quiet.code, told.code), (0, 0), "{} {}", quiet.stderr, told.stderr);
    assert!(told.stderr.len() > quiet.stderr.len(), "{} {}", quiet.stderr, told.stderr);
    place.refuses("inspect s.mha --log a=b=c", &["--log a=b=c: "]);
    place.refuses("inspect s.mha --log warn,bogus", &["\"bogus\" is no level; give error, warn"]);
}

#[test]
fn closed_pipe_is_no_error() {
    let place = Place::new();
    let mut command = crate::program();
    command.args("phantom -o s.igs.mha --scene sphere --frames 4 --image-size 48x40".split(' '));
    command.current_dir(place.path(".")).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut running = command.spawn().unwrap();
    // The program prints after it has written the file.
    drop(running.stdout.take());
    let ended = running.wait_with_output().unwrap();
    assert!(ended.status.success() && ended.stderr.is_empty(), "{}", String::from_utf8_lossy(&ended.stderr));
}

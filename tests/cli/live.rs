//! `live`: reads a session configuration, tests its devices, and reports errors with remedies.

use serde_json::Value;

use super::place::{Place, Run};

/// A small virtual bedside, quickly simulated.
const SMALL: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n[grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n";

fn check(place: &Place, name: &str) -> (Run, Value) {
    let run = place.run(&format!("live --config {name} --check --json"));
    let report = serde_json::from_str(&run.stdout).unwrap_or_else(|e| panic!("{e}: {} {}", run.stdout, run.stderr));
    (run, report)
}

/// Returns the report on one device or file.
fn of<'r>(report: &'r Value, what: &str) -> &'r Value {
    report["checks"].as_array().unwrap().iter().find(|checked| checked["what"] == what).unwrap()
}

fn sentences(checked: &Value, key: &str) -> String {
    checked[key].as_array().unwrap().iter().map(|s| s.as_str().unwrap()).collect::<Vec<_>>().join("\n")
}

#[test]
fn virtual_example_passes_check_and_reports_findings() {
    let place = Place::new();
    place.put("bedside.toml", place.does("live --example virtual"));
    let (run, report) = check(&place, "bedside.toml");
    assert_eq!((run.code, &report["well"]), (0, &Value::Bool(true)), "{} {}", run.stdout, run.stderr);
    let tracker = of(&report, "tracker");
    let says = sentences(tracker, "says");
    assert!(says.starts_with("FASTRAK on a virtual line; runs after "), "{says}");
    assert!(says.contains("probe      station 1 at ") && says.contains("reference  station 2 at "), "{says}");
    assert!(says.contains("ms of configured latency"), "{says}");
    assert!(tracker["numbers"]["streams"]["1"]["seen_hz"].as_f64().unwrap() > 20.0, "{tracker}");
    let grabber = of(&report, "grabber");
    assert_eq!(grabber["numbers"]["picture_size"], serde_json::json!([640, 480]));
    assert_eq!(grabber["numbers"]["latency_ms"], 40.0);
    let calibration = sentences(of(&report, "calibration"), "says");
    assert!(calibration.contains("Image → Probe → Tracker → Reference"), "{calibration}");
    assert!(calibration.contains("pixels are data in a sector"), "{calibration}");
}

#[test]
fn every_tracker_model_has_a_working_simulation() {
    let place = Place::new();
    for model in ["isotrak", "liberty", "patriot", "viper"] {
        place.put("b.toml", SMALL.replace("fastrak", model));
        let said = place.does("live --config b.toml --check");
        let head = format!("b.toml\n✓ tracker     {} on a virtual line; runs after ", model.to_uppercase());
        assert!(said.starts_with(&head) || said.starts_with(&head.replace('✓', "!")), "{said}");
        assert!(said.contains("probe      station 1 at ") && said.contains("reference  station 2 at "), "{said}");
        assert!(
            said.contains("grabber     a virtual grabber")
                && (said.ends_with("all is well\n") || said.ends_with("marked with !\n")),
            "{said}"
        );
    }
}

#[test]
fn virtual_arms_work_and_provide_their_joints() {
    let place = Place::new();
    let device = "[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n";
    for kind in ["ea1", "qsb", "microscribe"] {
        place.put("b.toml", SMALL.replace(device, &format!("[arm]\nkind = \"{kind}\"\nport = \"virtual\"\n")));
        let (run, report) = check(&place, "b.toml");
        assert_eq!(run.code, 0, "{kind}: {} {}", run.stdout, run.stderr);
        let says = sentences(of(&report, "arm"), "says");
        assert!(
            says.contains(" on a virtual line") && says.contains("; runs after") && says.contains("counts "),
            "{says}"
        );
        let calibration = sentences(of(&report, "calibration"), "says");
        assert!(calibration.starts_with("Image → Probe → Tracker\n"), "{calibration}");
        assert!(calibration.contains("revolute, link of 250 mm"), "{calibration}");
    }
}

#[test]
fn errors_are_reported_with_remedy_and_exit_code() {
    let place = Place::new();
    let away = SMALL
        .replace("port = \"virtual\"", "port = \"/dev/nothing\"")
        .replace("device = \"virtual\"", "device = \"/dev/video99\"");
    let calibration = "[calibration]\nimage_to_probe = [0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0]\n";
    place.put("away.toml", format!("{away}{calibration}"));
    let begun = std::time::Instant::now();
    let (run, report) = check(&place, "away.toml");
    let seconds = begun.elapsed().as_secs_f64();
    assert!(seconds < 12.0, "all devices at once, each for 5 s: {seconds}");
    assert_eq!(run.code, 1);
    assert!(run.stderr.contains("away.toml: not well: tracker, grabber"), "{}", run.stderr);
    for (what, device) in [("tracker", "/dev/nothing"), ("grabber", "/dev/video99")] {
        let wrong = sentences(of(&report, what), "wrong");
        assert!(wrong.starts_with("absent after 5 s: ") && wrong.contains("plug it in"), "{wrong}");
        assert!(sentences(of(&report, what), "says").contains(device));
    }
    assert_eq!(of(&report, "calibration")["well"], true);

    // A missing sensor, a rectangle of another frame size, an unreachable world, an invalid
    // folder, an occupied port.
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let broken = format!(
        "{SMALL}[calibration]\nimage_to_probe = [0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0]\nclip_px = [10, 10, 400, 50]\n\
         [volume]\nworld = \"Room\"\n[record]\nfolder = \"none\"\n[status]\nlisten = \"127.0.0.1:{port}\"\n[virtual.grabber]\ndropout = 0.8\n"
    );
    place.put("broken.toml", broken);
    let (run, report) = check(&place, "broken.toml");
    assert_eq!(run.code, 1);
    for (what, says) in [
        (
            "calibration",
            "no way leads from Image to Room: the devices deliver ProbeToTracker, ReferenceToTracker, the calibration has ImageToProbe",
        ),
        ("calibration", "the rectangle of 400×50 pixels from 10, 10 reaches beyond the picture of 96×80"),
        ("recording", "cannot write a file there"),
        ("status", "cannot listen there"),
    ] {
        let wrong = sentences(of(&report, what), "wrong");
        assert!(wrong.contains(says), "{what}: {wrong}");
    }
    assert_eq!(of(&report, "tracker")["well"], true, "{report}");
    let doubts = sentences(of(&report, "grabber"), "doubts");
    assert!(doubts.contains(" of the configured 30.0 a second arrive"), "{doubts}");
}

#[test]
fn arm_without_joints_is_refused() {
    let place = Place::new();
    let text =
        place.does("live --example arm").replace("/dev/video0", "virtual").replace("/dev/ttyACM0", "/dev/nothing");
    place.put(
        "arm.toml",
        text.replace("\n[grabber]", "\n[virtual]\nscene = \"blobs\"\n\n[grabber]\nsize = \"640x480\""),
    );
    let probe = place.does("live --example arm-probe").replace("an example: replace it by", "measured, instead of");
    place.put("arm-probe.toml", &probe);
    let (run, report) = check(&place, "arm.toml");
    assert_eq!(run.code, 1, "the arm is not there");
    let calibration = of(&report, "calibration");
    assert_eq!(calibration["well"], true, "{calibration}");
    assert!(
        sentences(calibration, "says").contains("revolute, link of 220 mm, 40000 counts a turn backwards"),
        "{calibration}"
    );
    let (before, _) = probe.split_once("[[arm.joint]]").unwrap();
    place.put("arm-probe.toml", before);
    let (_, report) = check(&place, "arm.toml");
    assert!(sentences(of(&report, "calibration"), "wrong").contains("it holds no joints"), "{report}");
}

#[test]
fn wrong_kind_of_configuration_is_refused() {
    let place = Place::new();
    place.put("probe.toml", place.does("live --example probe"));
    place.refuses("live --config probe.toml --check", &["probe.toml: is a calibration file", "file = \"probe.toml\""]);
    place.put("b.toml", SMALL);
    place
        .refuses("inspect b.toml", &["b.toml: is a session configuration, for `live`", "a calibration is wanted here"]);
    place.put("b.toml", SMALL.replace("model", "modell"));
    place.refuses(
        "live --config b.toml --check",
        &["b.toml: tracker.modell (line 4): unknown key; did you mean model?"],
    );
    let plus = "<PlusConfiguration><DataCollection><Device Id=\"V\" Type=\"SavedDataSource\"/></DataCollection><CoordinateDefinitions/></PlusConfiguration>";
    place.put("set.xml", plus);
    place.refuses(
        "live --config set.xml --check",
        &["set.xml: the device set lacks a tracker and a frame grabber", "V (SavedDataSource)"],
    );
    place.refuses("live", &["--config: is missing", "live --example virtual"]);
    for words in ["live --check", "live --record sessions", "live --keys --picture p.png"] {
        assert_eq!(place.run(words).code, 2, "{words}");
    }
    place.refuses("live --config b.toml", &["b.toml: tracker.modell (line 4): unknown key"]);
    let schema: Value = serde_json::from_str(&place.does("live --keys-schema")).unwrap();
    let frozen_s = &schema["properties"]["scanner"]["properties"]["frozen_s"];
    assert_eq!((frozen_s["minimum"].as_f64(), frozen_s["default"].as_f64()), (Some(0.05), Some(0.5)));
    let keys = place.does("live --keys");
    assert!(keys.contains("\n[tracker]\n") && keys.contains("\n  latency_ms = -1000 to 1000 *\n"), "{keys}");
}

/// The example of a calibration, with this provenance and rectangle, and without its preset.
fn probe(place: &Place, provenance: &str, clip: [u32; 4]) -> String {
    let example = place.does("live --example probe");
    let [x, y, w, h] = clip;
    let (text, preset) = example.split_once("[[preset]]").unwrap();
    assert!(preset.contains("picture_px = [720, 576]"), "{preset}");
    text.replace("an example: replace it by your probe's", provenance).replace(
        "clip_px = { x = 120, y = 60, width = 480, height = 400 }",
        &format!("clip_px = {{ x = {x}, y = {y}, width = {w}, height = {h} }}"),
    )
}

const SHORTLY: &str = "live --config b.toml --headless --duration 0.5";
const CALIBRATED: &str = "[calibration]\nfile = \"probe.toml\"\n";

#[test]
fn example_as_calibration_is_refused_unless_accepted() {
    let place = Place::new();
    place.put("b.toml", format!("{SMALL}{CALIBRATED}"));
    let refusal = ["probe.toml: provenance: is \"", "not this probe's", "calibrate probe --live", "--accept-example"];
    for provenance in ["an example: replace it by your probe's", "Example", "of the manual's EXAMPLE, 2024"] {
        place.put("probe.toml", probe(&place, provenance, [0, 0, 90, 70]));
        place.refuses(&format!("{SHORTLY} --record r"), &refusal);
        assert!(!place.path("r").exists(), "no session is begun");
    }
    let (run, report) = check(&place, "b.toml");
    assert!(run.code == 1 && run.stderr.contains("not well: calibration"), "{}", run.stderr);
    let wrong = sentences(of(&report, "calibration"), "wrong");
    assert!(refusal.iter().all(|part| wrong.contains(part)), "{wrong}");
    // A trial, which is told.
    let run = place.run("live --config b.toml --check --accept-example");
    assert!(run.code == 0 && run.stdout.contains("! probe.toml: provenance: is "), "{} {}", run.stdout, run.stderr);
    let run = place.run(&format!("{SHORTLY} --accept-example"));
    assert!(run.code == 0 && run.stderr.contains("accepted for a trial: probe.toml: provenance"), "{}", run.stderr);
    // Other numbers are a calibration, and so are those that a virtual bedside makes for itself.
    place.put("probe.toml", probe(&place, "N-wires, exemplary", [0, 0, 90, 70]));
    assert_eq!((place.run(SHORTLY).code, check(&place, "b.toml").0.code), (0, 0));
    place.put("b.toml", SMALL);
    assert_eq!(place.run(SHORTLY).code, 0);
    assert_eq!(place.run("live --accept-example").code, 2, "it needs a configuration");
}

#[test]
fn calibration_of_another_image_size_is_refused() {
    let place = Place::new();
    place.put("b.toml", format!("{SMALL}{CALIBRATED}"));
    place.put("probe.toml", probe(&place, "N-wires", [10, 10, 90, 70]));
    let beyond = "the rectangle of 90×70 pixels from 10, 10 reaches beyond the picture of 96×80";
    place.refuses(SHORTLY, &[beyond, "--accept-example"]);
    assert!(sentences(of(&check(&place, "b.toml").1, "calibration"), "wrong").contains(beyond));
    let run = place.run(&format!("{SHORTLY} --accept-example"));
    assert!(run.code == 0 && run.stderr.contains(beyond), "{}", run.stderr);
    // No frame of another size fits a preset, so that a trial would show nothing.
    let of_preset = place.does("live --example probe").replace("an example: replace it by your probe's", "N-wires");
    place.put("probe.toml", of_preset);
    place.put("b.toml", format!("{SMALL}{CALIBRATED}preset = \"40 mm\"\n"));
    for flag in ["", " --accept-example"] {
        place.refuses(&format!("{SHORTLY}{flag}"), &["40 mm", "720×576", "96×80"]);
    }
    let (run, report) = check(&place, "b.toml");
    assert_eq!(run.code, 1);
    assert!(sentences(of(&report, "calibration"), "wrong").contains("720×576"), "{report}");
}

#[test]
fn calibration_made_with_another_image_size_is_refused() {
    let place = Place::new();
    place.put("b.toml", format!("{SMALL}{CALIBRATED}"));
    let made_with = |size: &str| {
        let text = probe(&place, "N-wires", [0, 0, 90, 70]);
        assert_eq!(text.matches("\nmatrix = [").count(), 1, "{text}");
        text.replace("\nmatrix = [", &format!("\npicture_px = {size}\nmatrix = ["))
    };
    // The rectangle lies inside of both pictures: only the file's own size tells them apart.
    place.put("probe.toml", made_with("[96, 82]"));
    let parts = ["probe.toml: picture_px: ", "96×82", "the grabber's have 96×80", "calibrate anew"];
    for flag in ["", " --accept-example"] {
        place.refuses(&format!("{SHORTLY} --record r{flag}"), &parts);
        assert!(!place.path("r").exists(), "no session is begun");
    }
    let (run, report) = check(&place, "b.toml");
    assert_eq!(run.code, 1, "{}", run.stderr);
    let wrong = sentences(of(&report, "calibration"), "wrong");
    assert!(parts.iter().all(|part| wrong.contains(part)), "{wrong}");
    place.put("probe.toml", made_with("[96, 80]"));
    assert_eq!((place.run(SHORTLY).code, check(&place, "b.toml").0.code), (0, 0));
}

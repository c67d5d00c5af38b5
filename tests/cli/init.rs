//! `init`: a configuration from flags or answers, which is checked.

use std::io::Write as _;
use std::process::Stdio;

use super::place::Place;

const VIRTUAL: &str =
    "init --tracker fastrak --port virtual --grabber virtual --reference-station 2 --record rec --yes";

/// Whether all is well, but for the console's port, which another test's program may have.
fn is_well(said: &str) -> bool {
    !said.contains("not well: ") || said.contains("not well: status\n")
}

#[test]
fn written_configuration_passes_live_check() {
    let place = Place::new();
    let said = place.run(VIRTUAL).stdout;
    assert!(said.contains("all is well") || said.contains("marked with !"), "{said}");
    assert!(said.contains("next: sonoweave live --config bedside.toml"), "{said}");
    let run = place.run("live --config bedside.toml --check");
    assert!(is_well(&run.stderr), "{} {}", run.stdout, run.stderr);
    let run = place.run(&format!("{VIRTUAL} --force --json"));
    let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert!(report["well"] == true || run.code == 1 && is_well(&run.stderr), "{report} {}", run.stderr);
}

#[test]
fn existing_file_needs_force() {
    let place = Place::new();
    place.put("bedside.toml", "mine");
    place.refuses(VIRTUAL, &["bedside.toml: exists", "--force"]);
    assert_eq!(place.get("bedside.toml"), b"mine");
    let run = place.run(&format!("{VIRTUAL} --force"));
    assert!(is_well(&run.stderr), "{}", run.stderr);
    assert!(place.get("bedside.toml").starts_with(b"# Session configuration"));
}

#[test]
fn missing_calibration_is_next_step() {
    let place = Place::new();
    let run = place.run("init --tracker fastrak --port /dev/none --grabber /dev/none --yes -o b.toml");
    assert_eq!(run.code, 1, "{}", run.stdout);
    assert!(run.stdout.contains("next: sonoweave calibrate probe --live b.toml -o probe.toml"), "{}", run.stdout);
    // The devices that are absent are problems, the calibration is none.
    assert!(run.stderr.contains("not well: tracker, grabber\n"), "{}", run.stderr);
    assert!(String::from_utf8(place.get("b.toml")).unwrap().contains("#file = \"probe.toml\""));
}

#[test]
fn answers_are_read_from_stdin() {
    let place = Place::new();
    let mut command = super::program();
    command.arg("init").current_dir(place.path("")).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(b"fastrak\nvirtual\nvirtual\n2\n\nrec\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let asked = String::from_utf8(output.stderr).unwrap();
    assert!(is_well(&asked), "{asked}");
    for question in
        ["tracker (isotrak, fastrak", "port, or virtual", "frame grabber, or virtual", "folder for recordings"]
    {
        assert!(asked.contains(question), "{asked}");
    }
    let text = String::from_utf8(place.get("bedside.toml")).unwrap();
    for line in ["model = \"fastrak\"", "\nreference_station = 2", "\nfolder = \"rec\"", "#file = "] {
        assert!(text.contains(line), "{text}");
    }
}

#[test]
fn wrong_or_missing_answers_leave_no_file() {
    let place = Place::new();
    place.refuses("init --port virtual --grabber virtual --yes", &["--tracker: is missing"]);
    let unknown = place.run("init --tracker nine --port virtual --grabber virtual --yes");
    assert!(unknown.code == 2 && unknown.stderr.contains("isotrak"), "{}", unknown.stderr);
    assert!(!place.path("bedside.toml").exists());
}

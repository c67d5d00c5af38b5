//! The tutorials of the documents: each command works, in order, in an empty folder.

use std::path::Path;
use std::process::Command;

use super::place::Place;

/// Section of a page that is a tutorial.
const SECTION: &str = "\n## Step by step\n";

/// Runs the tutorial of a page by a shell; returns its commands' output, both streams.
fn follow(place: &Place, page: &str) -> String {
    follow_section(place, page, SECTION)
}

/// The same with another section's heading.
fn follow_section(place: &Place, page: &str, heading: &str) -> String {
    let (_, rest) = page.split_once(heading).unwrap();
    let tutorial = rest.split("\n## ").next().unwrap();
    let commands: Vec<&str> = tutorial.lines().filter_map(|line| line.strip_prefix("$ ")).collect();
    assert!(commands.len() > 2, "{commands:?}");
    let program = Path::new(env!("CARGO_BIN_EXE_sonoweave")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let mut said = String::new();
    for command in commands {
        let run = place.output(Command::new("sh").args(["-c", command]).env("PATH", &path));
        assert_eq!(run.code, 0, "{command}: {}", run.stderr);
        said += &(run.stdout + &run.stderr);
    }
    said
}

#[test]
#[ignore = "takes 15 s of processor time: make stress"]
fn tutorial_of_replay_gives_the_same_bits() {
    let place = Place::new();
    let said = follow(&place, include_str!("../../docs/replay.md"));
    assert!(said.contains("the volume is the same as in the live session, bit by bit"), "{said}");
    assert_eq!(place.get("demo/volume.mha"), place.get("again.mha"));
    assert_eq!(place.get("demo/picture.png"), place.get("again.png"));
    assert_ne!(place.get("coarse.png"), place.get("again.png"));
}

#[test]
fn tutorial_of_calibration_finds_the_truth() {
    let place = Place::new();
    let said = follow(&place, include_str!("../../docs/calibrate.md"));
    assert!(said.contains("errors on validation frames:"), "{said}");
    let [middle, corner] = place.pixels_apart(["probe.toml", "truth.toml"], [320, 240]);
    // Twice 0.119 and 0.271 mm.
    assert!(middle < 0.24 && corner < 0.54, "{middle} {corner}");
    assert!(place.path("wires.png").is_file() && place.path("probe.html").is_file());
}

#[test]
fn sample_replays_draws_and_calibrates() {
    let place = Place::new();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/sample.sh");
    let made = place.output(Command::new(script).args([env!("CARGO_BIN_EXE_sonoweave"), "sample"]));
    assert_eq!((made.code, made.stderr.as_str()), (0, ""), "{}", made.stdout);
    let sizes = std::fs::read_dir(place.path("sample")).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len());
    let bytes: u64 = sizes.sum();
    assert!((1_000_000..5_000_000).contains(&bytes), "{bytes} bytes");
    let said = follow_section(&place, include_str!("../../docs/start.md"), "\n### The sample\n");
    assert!(said.contains("the volume is the same as in the live session, bit by bit"), "{said}");
    assert!(place.path("doll.png").is_file());
    let [middle, corner] = place.pixels_apart(["probe.toml", "sample/truth.toml"], [320, 240]);
    // Twice 0.119 and 0.271 mm.
    assert!(middle < 0.24 && corner < 0.54, "{middle} {corner}");
}

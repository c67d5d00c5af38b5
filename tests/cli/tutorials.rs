//! The tutorials of the documents: each command works, in order, in an empty folder.

use std::path::Path;
use std::process::Command;

use super::place::Place;

/// Section of a page that is a tutorial.
const SECTION: &str = "\n## Step by step\n";

/// Runs the tutorial of a page by a shell; returns its commands' output, both streams.
fn follow(place: &Place, page: &str) -> String {
    let (_, rest) = page.split_once(SECTION).unwrap();
    let tutorial = rest.split("\n## ").next().unwrap();
    let commands: Vec<&str> = tutorial.lines().filter_map(|line| line.strip_prefix("$ ")).collect();
    assert!(commands.len() > 3, "{commands:?}");
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
    assert!(middle < 0.3 && corner < 0.5, "{middle} {corner}");
    assert!(place.path("wires.png").is_file() && place.path("probe.html").is_file());
}

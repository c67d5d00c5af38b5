//! `doctor`: a verdict on each item, in text and JSON, with the exit code.

use serde_json::Value;

use super::place::Place;

#[test]
fn every_item_has_verdict_exit_code_follows_problems() {
    let place = Place::new();
    let text = place.run("doctor");
    let run = place.run("doctor --json");
    let findings: Value = serde_json::from_str(&run.stdout).unwrap();
    let findings = findings.as_array().unwrap();
    for item in ["device", "udev rules", "processor", "realtime", "locked memory", "disk", "port", "browser"] {
        let finding = findings.iter().find(|finding| finding["item"] == item).unwrap_or_else(|| panic!("no {item}"));
        let verdict = finding["verdict"].as_str().unwrap();
        assert_eq!(finding["advice"].is_null(), verdict == "ok", "{finding}");
        assert!(["ok", "warning", "problem"].contains(&verdict) && text.stdout.contains(item), "{finding}");
    }
    let has_problem = findings.iter().any(|finding| finding["verdict"] == "problem");
    assert_eq!(run.code, i32::from(has_problem), "{}", run.stdout);
}

#[test]
fn unwritable_folder_is_problem() {
    let place = Place::new();
    let run = place.run("doctor --record none --json");
    let findings: Value = serde_json::from_str(&run.stdout).unwrap();
    let disk = findings.as_array().unwrap().iter().find(|finding| finding["item"] == "disk").unwrap();
    assert_eq!((run.code, &disk["verdict"]), (1, &"problem".into()), "{disk}");
    assert!(run.stderr.contains("found; "), "{}", run.stderr);
}

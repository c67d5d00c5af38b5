//! `reconstruct` of several recordings: one volume each, and a table.

use super::place::Place;
use super::sequence::{Sequence, pose};

#[test]
fn several_recordings_give_volumes_despite_one_failure() {
    let place = Place::new();
    place.put("a.igs.mha", Sequence::default().bytes());
    place.put("b.mha", Sequence { pose: |f| pose(2.0 * f64::from(f)), ..Sequence::default() }.bytes());
    std::fs::create_dir(place.path("out")).unwrap();
    let said = place.does("reconstruct a.igs.mha b.mha -o out --clip none --path general");
    let table: Vec<&str> = said.lines().skip_while(|line| !line.starts_with("recording")).collect();
    assert_eq!(table.len(), 3, "{said}");
    assert!(table[1].starts_with("a.igs.mha  6 of 6") && table[1].ends_with("out/a.mha"), "{said}");
    assert!(table[2].starts_with("b.mha      6 of 6") && table[2].ends_with("out/b.mha"), "{said}");
    // The same bytes as from a separate command for each.
    place.does("reconstruct b.mha -o alone.mha --clip none --path general");
    assert!(place.get("out/b.mha") == place.get("alone.mha"));

    place.put("bad.mha", "no header");
    std::fs::remove_file(place.path("out/a.mha")).unwrap();
    let run = place.run("reconstruct bad.mha a.igs.mha -o out --clip none --path general");
    assert_eq!(run.code, 10);
    assert!(run.stderr.contains("1 of 2 recordings failed"), "{}", run.stderr);
    assert!(run.stdout.contains("failed: bad.mha") && place.path("out/a.mha").is_file(), "{}", run.stdout);
    assert!(!place.path("out/bad.mha").exists());
}

#[test]
fn each_recording_has_outputs_in_the_given_folders() {
    let place = Place::new();
    place.put("a.igs.mha", Sequence::default().bytes());
    place.put("b.mha", Sequence { pose: |f| pose(2.0 * f64::from(f)), ..Sequence::default() }.bytes());
    for folder in ["out", "said"] {
        std::fs::create_dir(place.path(folder)).unwrap();
    }
    let flags = "--clip none --path general";
    place.does(&format!("reconstruct a.igs.mha b.mha -o out --weights out --planes out --json=said {flags}"));
    place.does(&format!("reconstruct b.mha -o v.mha --weights w.mha --planes p.png --json=s.json {flags}"));
    for (one, own) in [("out/b.mha", "v.mha"), ("out/b.weights.mha", "w.mha"), ("out/b.planes.png", "p.png")] {
        assert!(place.get(one) == place.get(own), "{one}: the same bytes as by a command of its own");
    }
    for (name, input) in [("said/a.json", "a.igs.mha"), ("said/b.json", "b.mha")] {
        let statistics = place.json(name);
        assert_eq!(statistics["input"]["path"].as_str().or(statistics["input"].as_str()).unwrap(), input, "{name}");
    }
    assert_eq!(std::fs::read_dir(place.path("out")).unwrap().count(), 6);
    assert_eq!(std::fs::read_dir(place.path("said")).unwrap().count(), 2);
}

#[test]
fn name_clashes_and_single_files_are_refused_first() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    place.put("a.igs.mha", Sequence::default().bytes());
    place.put("b.mha", Sequence::default().bytes());
    place.refuses("reconstruct a.mha b.mha -o v.mha", &["v.mha: is not a folder"]);
    std::fs::create_dir(place.path("out")).unwrap();
    place.refuses_with(
        "reconstruct a.mha a.igs.mha -o out",
        &["a.igs.mha: its volume and another recording's would both be out/a.mha"],
    );
    for flag in ["--json=s.json", "--planes p.png", "--weights none/w.mha"] {
        let says = format!("{flag}: is not a folder, but several recordings need one for their files (NAME.");
        place.refuses_with(&format!("reconstruct a.mha b.mha -o out {flag}"), &[&says]);
    }
    place.refuses_with("reconstruct a.mha b.mha -o .", &["is the input"]);
    assert_eq!(std::fs::read_dir(place.path("out")).unwrap().count(), 0);
}

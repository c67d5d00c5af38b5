//! `reconstruct` of several recordings: a volume each and a table.

use super::place::Place;
use super::sequence::{Sequence, pose};

#[test]
fn several_recordings_become_a_volume_each_and_one_that_fails_keeps_none_from_it() {
    let place = Place::new();
    place.put("a.igs.mha", Sequence::default().bytes());
    place.put("b.mha", Sequence { pose: |f| pose(2.0 * f64::from(f)), ..Sequence::default() }.bytes());
    std::fs::create_dir(place.path("out")).unwrap();
    let said = place.does("reconstruct a.igs.mha b.mha -o out --clip none --path general");
    let table: Vec<&str> = said.lines().skip_while(|line| !line.starts_with("recording")).collect();
    assert_eq!(table.len(), 3, "{said}");
    assert!(table[1].starts_with("a.igs.mha  6 of 6") && table[1].ends_with("out/a.mha"), "{said}");
    assert!(table[2].starts_with("b.mha      6 of 6") && table[2].ends_with("out/b.mha"), "{said}");
    // The same bytes as by a command each.
    place.does("reconstruct b.mha -o alone.mha --clip none --path general");
    assert!(place.get("out/b.mha") == place.get("alone.mha"));

    place.put("bad.mha", "no header");
    std::fs::remove_file(place.path("out/a.mha")).unwrap();
    let run = place.run("reconstruct bad.mha a.igs.mha -o out --clip none --path general");
    assert_eq!(run.code, 1);
    assert!(run.stderr.contains("1 of 2 recordings failed"), "{}", run.stderr);
    assert!(run.stdout.contains("failed: bad.mha") && place.path("out/a.mha").is_file(), "{}", run.stdout);
    assert!(!place.path("out/bad.mha").exists());
}

#[test]
fn names_that_meet_and_files_of_one_recording_are_refused_before_the_work() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    place.put("a.igs.mha", Sequence::default().bytes());
    place.put("b.mha", Sequence::default().bytes());
    place.refuses("reconstruct a.mha b.mha -o v.mha", &["v.mha: is no folder"]);
    std::fs::create_dir(place.path("out")).unwrap();
    place.refuses_with("reconstruct a.mha a.igs.mha -o out", &["a.igs.mha: its volume would be out/a.mha"]);
    place.refuses_with("reconstruct a.mha b.mha -o out --stats s.json", &["--stats name one file"]);
    place.refuses_with("reconstruct a.mha b.mha -o .", &["is the input"]);
    assert_eq!(std::fs::read_dir(place.path("out")).unwrap().count(), 0);
}

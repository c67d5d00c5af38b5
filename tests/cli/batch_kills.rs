//! Batches whose processes are killed, or that run twice at once.

use std::collections::BTreeMap;

use rustix::process::Signal;

use super::batch::{awaits, begins, child_of, ends, plan, results, signal, small_sweeps, tree, tries};
use super::place::Place;

/// Number of sweeps.
const COUNT: usize = 6;

/// Number of sweeps that are done.
fn done(place: &Place) -> usize {
    tree(&place.path("run/sweeps")).keys().filter(|name| name.ends_with("/done.json")).count()
}

/// Results of a run without disturbances.
fn undisturbed(place: &Place) -> BTreeMap<String, Vec<u8>> {
    plan(place, "whole");
    ends(place, 0, "batch run whole --jobs 2");
    results(place, "whole")
}

/// Processes of tries that have begun and not ended.
fn running(place: &Place) -> Vec<u64> {
    (0..COUNT).filter_map(|n| child_of(place, "run", &format!("g{n}"), 1)).collect()
}

#[test]
fn killed_run_goes_on_to_the_same_files() {
    let place = small_sweeps(COUNT);
    let whole = undisturbed(&place);
    let mut kills = 0;
    for finished in [0, 1, 2, 3, 5] {
        let _ = std::fs::remove_dir_all(place.path("run"));
        plan(&place, "run");
        let mut run = begins(&place, "batch run run --jobs 2");
        awaits(|| {
            let has_ended = run.try_wait().unwrap().is_some();
            (has_ended || done(&place) >= finished && tree(&place.path("run/attempts")).len() > finished).then_some(())
        });
        run.kill().unwrap();
        kills += usize::from(run.wait().unwrap().code().is_none());
        // Children end with their run.
        for process in running(&place) {
            awaits(|| {
                let state = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
                let has_ended = state.rsplit_once(')').is_none_or(|(_, rest)| rest.trim_start().starts_with('Z'));
                has_ended.then_some(())
            });
        }
        let before = done(&place);
        ends(&place, 0, "batch run run --jobs 2");
        assert!(whole == results(&place, "run"), "{finished} finished: other files");
        assert!(before >= finished.min(COUNT));
        let started: usize = (0..COUNT).map(|n| tries(&place, "run", &format!("g{n}")).len()).sum();
        assert!(started <= COUNT + 2, "done sweeps are not tried again: {started}");
    }
    assert!(kills > 0, "no run was killed before its end");
}

#[test]
fn killed_children_are_tried_again() {
    let place = small_sweeps(COUNT);
    let whole = undisturbed(&place);
    plan(&place, "run");
    let mut run = begins(&place, "batch run run --jobs 2 --attempts 3");
    let mut killed = Vec::new();
    while run.try_wait().unwrap().is_none() {
        for process in running(&place) {
            if !killed.contains(&process) && killed.len() < 4 {
                // It may have ended meanwhile.
                let _ = signal(process, Signal::KILL);
                killed.push(process);
            }
        }
    }
    assert_eq!(run.wait().unwrap().code(), Some(0));
    assert!(whole == results(&place, "run"));
}

#[test]
fn two_runs_at_once_are_harmless() {
    let place = small_sweeps(COUNT);
    let whole = undisturbed(&place);
    plan(&place, "run");
    let mut runs = [(); 3].map(|()| begins(&place, "batch run run --jobs 2"));
    for run in &mut runs {
        assert_eq!(run.wait().unwrap().code(), Some(0));
    }
    assert!(whole == results(&place, "run"));
    ends(&place, 0, "batch verify run");
}

#[test]
fn child_has_its_limits_and_signal_ends_run() {
    let place = small_sweeps(1);
    place.put("g0.mha", super::batch::long());
    place.put("m.csv", "id,recording,settings\ng0,g0.mha,--spacing 0.05 --clip none\n");
    plan(&place, "run");
    let mut run = begins(&place, "batch run run --memory 2GiB");
    let child = awaits(|| child_of(&place, "run", "g0", 1));
    let limit = |line: &str| line.starts_with("Max address space") && line.contains("2147483648");
    awaits(|| std::fs::read_to_string(format!("/proc/{child}/limits")).unwrap().lines().any(limit).then_some(()));
    let status = std::fs::read_to_string(format!("/proc/{child}/stat")).unwrap();
    let group: u64 = status.rsplit_once(')').unwrap().1.split_whitespace().nth(2).unwrap().parse().unwrap();
    assert_eq!(group, child, "a group of its own");
    signal(run.id().into(), Signal::TERM).unwrap();
    assert_eq!(run.wait().unwrap().code(), Some(1));
    assert!(results(&place, "run").is_empty(), "nothing temporary is left");
    let tried = tries(&place, "run", "g0");
    assert_eq!(tried[0]["state"], "interrupted");
    ends(&place, 0, "batch status run");
    // A stopped process is killed at its time limit.
    let mut run = begins(&place, "batch run run --attempts 1 --timeout 2s");
    let child = awaits(|| child_of(&place, "run", "g0", 2));
    signal(child, Signal::STOP).unwrap();
    assert_eq!(run.wait().unwrap().code(), Some(10));
    assert_eq!(tries(&place, "run", "g0")[1]["exit"], 8);
    assert!(!std::path::Path::new(&format!("/proc/{child}")).exists());
}

//! Corrections of a recorded session: stored beside it, applied by replays, stale, and undone.

use std::time::Instant;

use serde_json::json;

use super::commands::{done, post_command, until};
use super::daemon::Session;
use super::place::Place;

/// A virtual bedside whose tracker has white noise, and whose patient breathes by ±2 mm each 4 s.
/// The sweep is repeated every 5 s, so that each place is seen at four phases of the breathing.
const BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "80x75"
[volume]
spacing_mm = 1.0
[record]
full_frame = true
[virtual]
scene = "blobs"
trajectory = "three-directions"
frames = 50
gap_mm = 0.6
pixel_mm = 0.6
tracker_noise_mm = 0.3
tracker_noise_deg = 0.3
"#;

/// Returns a number of the evidence of a report.
fn evidence(place: &Place, report: &str, name: &str) -> f64 {
    place.json(report)["evidence"][name].as_f64().unwrap_or_else(|| panic!("{report} has no {name}"))
}

/// Checks that a corrected session gives the same voxels with 1 and 3 threads as in `volume`,
/// which was replayed with as many as there are cores.
fn same_for_all_threads(place: &Place, session: &str, bedside: &str, volume: &str) {
    for threads in [1, 3] {
        place.put("threads.toml", bedside.replace("[volume]", &format!("[volume]\nthreads = {threads}")));
        let run = place.run(&format!("replay {session} -c threads.toml -o threads.mha --quiet"));
        assert!(run.code == 0 && run.stderr.contains("corrections applied: "), "{}", run.stderr);
        assert!(place.volume("threads.mha").values == place.volume(volume).values, "{threads} threads");
    }
}

#[test]
fn corrections_are_applied_stale_and_undone() {
    let place = Place::new();
    let session = place.recorded(BEDSIDE, 20);
    let recorded = std::fs::read(place.path(&session)).unwrap();
    let replay = |volume: &str| place.run(&format!("replay {session} -o {volume} --weights w-{volume} --quiet"));
    let volumes = |name: &str| [place.get(name), place.get(&format!("w-{name}"))];
    assert_eq!(replay("before.mha").code, 0);
    assert_eq!(place.does(&format!("correct list {session}")), "no corrections\n");

    // Smoothing is tried, and then stored and applied.
    let tried = place.does(&format!("correct smoothing {session} --dry-run"));
    assert!(tried.ends_with("not stored\n") && !place.path(&session).with_extension("corrections.jsonl").exists());
    let said = place.does(&format!("correct smoothing {session} --json=smoothing.json"));
    assert!(said.contains("stored as correction 1 in SESSION-"), "{said}");
    let [moved, error] = ["moved_rms_mm", "error_rms_mm"].map(|name| evidence(&place, "smoothing.json", name));
    assert!((0.2..1.5).contains(&moved) && error < moved, "{moved} {error}");
    let run = replay("smooth.mha");
    assert!(run.code == 0 && run.stderr.contains("corrections applied: 1 smoothing"), "{}", run.stderr);
    assert!(
        run.stderr.contains("poses before their corrections are the same as in the live session"),
        "{}",
        run.stderr
    );
    assert!(volumes("before.mha") != volumes("smooth.mha"));
    place.refuses_with(
        &format!("correct smoothing {session}"),
        &["correction 1 is a smoothing, too; run `sonoweave correct undo"],
    );

    // A gate stands on it.
    place.does(&format!("correct gate {session} --share 0.4 --json=gate.json"));
    let [period_s, share] =
        [&place.json("gate.json")["evidence"]["breathing"]["period_s"], &place.json("gate.json")["settings"]["share"]]
            .map(|number| number.as_f64().unwrap());
    assert!((3.8..4.2).contains(&period_s) && share == 0.4, "{period_s} {share}");
    let [all_mm, used_mm] =
        [0, 1].map(|at| place.json("gate.json")["evidence"]["motion_mm"][at].as_f64().unwrap_or(f64::NAN));
    assert!((1.2..1.6).contains(&all_mm) && used_mm < 0.5, "{all_mm} {used_mm}");
    let [used, all] = ["frames", "frames_before"].map(|name| evidence(&place, "gate.json", name));
    assert!((used - 0.4 * all).abs() < 1.0, "{used} of {all}");
    let run = place.run(&format!("replay {session} -o gated.mha --json=gated.json --quiet"));
    assert!(run.stderr.contains("corrections applied: 1 smoothing, 2 gate"), "{}", run.stderr);
    let frames = &place.json("gated.json")["frames"];
    assert_eq!((frames["used"].as_f64(), frames["refused"]["gated"].as_f64()), (Some(used), Some(all - used)));
    // A second replay has the same bits. Headers and comparisons name the corrections.
    assert_eq!(place.run(&format!("replay {session} -o again.mha --quiet")).code, 0);
    assert!(place.get("gated.mha") == place.get("again.mha"));
    same_for_all_threads(&place, &session, BEDSIDE, "gated.mha");
    let compared = place.run("compare smooth.mha gated.mha").stdout;
    assert!(compared.contains("SonoweaveCorrections: 1 smoothing | 1 smoothing, 2 gate"), "{compared}");

    // Without the smoothing it is stale. Without both, the bits are those from before.
    let said = place.does(&format!("correct undo {session} 1"));
    assert!(said.contains("1  smoothing    undone") && said.contains("2  gate         stale"), "{said}");
    let run = replay("stale.mha");
    assert!(run.stderr.contains("correction 2 (gate) is stale and not applied"), "{}", run.stderr);
    place.does(&format!("correct undo {session} 2"));
    let run = replay("after.mha");
    assert!(run.stderr.contains("the volume is the same as in the live session, bit by bit"), "{}", run.stderr);
    assert!(volumes("before.mha") == volumes("after.mha") && volumes("before.mha") == volumes("stale.mha"));

    // A result that another version has stored is applied, and said to differ.
    place.does(&format!("correct smoothing {session} --half-width 100"));
    let file = place.path(&session).with_extension("corrections.jsonl");
    let text = std::fs::read_to_string(&file).unwrap();
    let last = text.lines().last().unwrap();
    let mut line: serde_json::Value = serde_json::from_str(last).unwrap();
    line["program"] = "0.0.1".into();
    let x = line["correction"]["result"]["poses"][5][1][3].as_f64().unwrap();
    line["correction"]["result"]["poses"][5][1][3] = (x + 2.0).into();
    std::fs::write(&file, text.replace(last, &line.to_string())).unwrap();
    let run = replay("other.mha");
    let differs =
        ["correction 3 (smoothing) is applied as stored, by version 0.0.1", "up to 2.000 mm elsewhere. Undo it"];
    assert!(run.code == 0 && differs.iter().all(|part| run.stderr.contains(part)), "{}", run.stderr);
    let run = place.run(&format!("replay {session} --as-recorded"));
    assert!(
        run.stderr.contains("same as in the live session") && !run.stderr.contains("corrections"),
        "{}",
        run.stderr
    );
    assert!(std::fs::read(place.path(&session)).unwrap() == recorded, "the session stays as it is");
}

#[test]
fn gate_by_markers_uses_frames_around_a_phase() {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE.replace("frames = 50", "frames = 20").replace("reference_station = 2\n", ""));
    let words = "live --config bedside.toml --keep kept --console 127.0.0.1:0";
    let mut session = Session::at(place, words, &[]);
    let address = session.address();
    until(&session, &address, "slices", |account| account["volume"]["slices"].as_u64() > Some(3));
    let (code, answer) = post_command(&address, &json!({ "do": "mark" }));
    assert!(code == 409 && answer["refused"].as_str().unwrap().contains("record it to mark moments"), "{answer}");
    done(&address, &json!({ "do": "record" }));
    until(&session, &address, "slices", |a| a["desk"]["records"] == true && a["volume"]["slices"].as_u64() > Some(250));
    // A moment each 3 s, the last one now; those before the recording count, too.
    let begun = Instant::now();
    for n in 0..8 {
        let ago_ms = 1e3 * begun.elapsed().as_secs_f64() + 3000.0 * f64::from(n);
        done(&address, &json!({ "do": "mark", "ago_ms": ago_ms }));
    }
    done(&address, &json!({ "do": "stop" }));
    until(&session, &address, "the end", |account| account["desk"]["phase"] == "over");
    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
    let place = &session.place;
    let mut kept = std::fs::read_dir(place.path("kept")).unwrap().map(|entry| entry.unwrap().path());
    std::fs::rename(kept.next().unwrap(), place.path("s.mcap")).unwrap();
    let said = place.does("correct gate s.mcap --share 0.4 --phase 0.25 --json=gate.json");
    assert!(said.contains("markers are 3.0 s apart"), "{said}");
    let report = place.json("gate.json");
    assert_eq!((&report["evidence"]["signal"], &report["evidence"]["periods"]), (&json!("markers"), &json!([7, 0])));
    let [used, all] = ["frames", "frames_before"].map(|name| evidence(place, "gate.json", name));
    // The recording is about 10 s long, so that parts of its periods lie outside of it.
    assert!((0.25..0.5).contains(&(used / all)), "{used} of {all}");
    let run = place.run("replay s.mcap --json=gated.json --quiet");
    assert!(run.stderr.contains("corrections applied: 1 gate"), "{}", run.stderr);
    assert_eq!(place.json("gated.json")["frames"]["used"].as_f64(), Some(used));
    place.refuses_with(
        "correct gate s.mcap --phase 1.5 --dry-run",
        &["the phase must lie between 0 and 1; give another"],
    );
}

#[test]
fn calibration_is_checked_at_a_session_s_end_by_crossings() {
    let place = Place::new();
    let exact = BEDSIDE.replace("0.3", "0").replace("frames = 50", "frames = 200");
    place.put("bedside.toml", &exact);
    let run = place.run("live --config bedside.toml --record kept --duration 9 --headless");
    let holds = "the calibration holds, checked by sweeps that cross: another one would displace the image by 0.";
    assert!(run.code == 0 && run.stderr.contains(holds), "{}", run.stderr);
    place.put("bedside.toml", exact.replace("three-directions", "freehand"));
    let run = place.run("live --config bedside.toml --record kept --duration 3 --headless");
    assert!(run.code == 0 && !run.stderr.contains("sweeps that cross"), "{}", run.stderr);
}

/// Returns the first numbers of a report's evidence that are pairs.
fn pair(place: &Place, report: &str, name: &str) -> [f64; 2] {
    [0, 1].map(|at| place.json(report)["evidence"][name][at].as_f64().unwrap_or_else(|| panic!("{report}: {name}")))
}

#[test]
fn drift_between_sweeps_is_corrected_by_their_crossings() {
    let place = Place::new();
    let exact = BEDSIDE.replace("0.3", "0").replace("frames = 50", "frames = 200");
    let drifting = exact.clone() + "tracker_drift_mm = 2.5\n";
    let session = place.recorded(&drifting, 16);
    let replay = |volume: &str| place.run(&format!("replay {session} -o {volume} --quiet"));
    assert_eq!(replay("before.mha").code, 0);
    let said = place.does(&format!("correct drift {session} --json=drift.json"));
    assert!(said.contains("stored as correction 1"), "{said}");
    let [shift_mm, se_mm] = pair(&place, "drift.json", "shift_mm");
    let [before, after] = pair(&place, "drift.json", "correlation");
    let seen = shift_mm > 0.3 && shift_mm < 1.5 && se_mm < shift_mm;
    assert!(seen && after > before && after > 0.999, "{shift_mm} {se_mm} {before} {after}");
    let run = replay("after.mha");
    assert!(run.stderr.contains("corrections applied: 1 drift"), "{}", run.stderr);
    assert!(place.get("before.mha") != place.get("after.mha"));
    same_for_all_threads(&place, &session, &drifting, "after.mha");
    place.refuses_with(&format!("correct drift {session}"), &["correction 1 is a drift, too"]);
    place.does(&format!("correct undo {session} 1"));
    let run = replay("undone.mha");
    assert!(run.stderr.contains("the volume is the same as in the live session, bit by bit"), "{}", run.stderr);
    // Exact poses need none.
    let place = Place::new();
    let session = place.recorded(&exact, 10);
    place.refuses_with(&format!("correct drift {session}"), &["no correction: "]);
}

#[test]
fn pressure_is_undone_against_the_light_sweep() {
    let place = Place::new();
    let exact = BEDSIDE.replace("0.3", "0").replace("frames = 50", "frames = 150");
    let bedside = exact
        .replace("80x75", "120x120")
        .replace("gap_mm = 0.6", "gap_mm = 0.4")
        .replace("pixel_mm = 0.6", "pixel_mm = 0.35")
        + "pressure_mm = 1.2\n";
    let session = place.recorded(&bedside, 10);
    let replay = |volume: &str| place.run(&format!("replay {session} -o {volume} --quiet"));
    assert_eq!(replay("before.mha").code, 0);
    let said = place.does(&format!("correct pressure {session} --light 1 --json=p.json"));
    assert!(said.contains("the skin was pressed by"), "{said}");
    let skin_mm = evidence(&place, "p.json", "skin_rms_mm");
    assert!((1.0..1.4).contains(&skin_mm), "{skin_mm}");
    let run = replay("after.mha");
    assert!(run.code == 0 && run.stderr.contains("corrections applied: 1 pressure"), "{}", run.stderr);
    assert!(place.get("before.mha") != place.get("after.mha"));
    same_for_all_threads(&place, &session, &bedside, "after.mha");
    place.does(&format!("correct undo {session} 1"));
    let run = replay("undone.mha");
    assert!(run.stderr.contains("the volume is the same as in the live session, bit by bit"), "{}", run.stderr);
    for words in ["", " --light 99"] {
        let sweeps =
            ["no correction: the scan has ", " sweeps: 1 (", " s), 2 (", "; give the number of the one with light"];
        place.refuses_with(&format!("correct pressure {session}{words}"), &sweeps);
    }
}

#[test]
fn jitter_of_poses_is_corrected_by_neighbours() {
    let place = Place::new();
    let bedside = BEDSIDE
        .replace("reference_station = 2\n", "")
        .replace("80x75", "120x120")
        .replace("three-directions", "freehand")
        .replace("gap_mm = 0.6", "gap_mm = 0.3")
        .replace("pixel_mm = 0.6", "pixel_mm = 0.35");
    let session = place.recorded(&bedside, 5);
    let said = place.does(&format!("correct jitter {session} --json=j.json"));
    assert!(said.contains("stored as correction 1"), "{said}");
    let held_out = evidence(&place, "j.json", "held_out");
    assert!(held_out > 0.15, "{held_out}");
    let run = place.run(&format!("replay {session} -o after.mha --quiet"));
    assert!(run.stderr.contains("corrections applied: 1 jitter"), "{}", run.stderr);
    same_for_all_threads(&place, &session, &bedside, "after.mha");
    place.does(&format!("correct undo {session} 1"));
    place.does(&format!("correct smoothing {session}"));
    place.refuses_with(
        &format!("correct jitter {session}"),
        &["the poses are smoothed, which corrects more; keep that"],
    );
}

#[test]
fn what_cannot_be_corrected_is_refused() {
    let place = Place::new();
    // A body at rest: seven seconds are too few to tell.
    let session = place.recorded(&BEDSIDE.replace("reference_station = 2\n", ""), 7);
    let refused = [
        ("gate SESSION --signal reference", "the session has no Reference sensor; give --signal images"),
        ("gate SESSION --share 0.1", "the gate must use a share of 0.15 to 1 of the frames"),
        ("gate SESSION", "no correction: "),
        ("gate SESSION --signal markers", "the session has 0 markers, and 5 are needed; mark the end of breathing out"),
        ("undo SESSION 1", "there is no correction 1 to undo; list them"),
        ("smoothing bedside.toml", "bedside.toml: is not a session; give a recorded session"),
    ];
    for (words, says) in refused {
        place.refuses_with(&format!("correct {}", words.replace("SESSION", &session)), &[says]);
    }
    for half_width in ["0", "5000", "x"] {
        place.refuses_with(&format!("correct smoothing {session} --half-width {half_width}"), &[]);
    }
    assert!(!place.path(&session).with_extension("corrections.jsonl").exists());
    // A damaged file of corrections.
    place.put("bad.corrections.jsonl", "{}\n");
    std::fs::copy(place.path(&session), place.path("bad.mcap")).unwrap();
    place.refuses_with("replay bad.mcap", &["bad.corrections.jsonl: line 1: "]);
}

//! Batches of sweeps: a manifest's rows, each done once, and failures that stay alone.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::place::{Place, Run};
use super::sequence::{Sequence, pose};

/// Settings of sweeps that take no time.
const QUICK: &str = "--clip none --path general";

/// A small sweep; each number has another one.
fn small(number: usize) -> Vec<u8> {
    let lines = format!("{}Number = {number}\n", Sequence::default().lines);
    Sequence { size: [16, 12], frames: 3, lines, ..Sequence::default() }.bytes()
}

/// A sweep that takes minutes, with `--spacing 0.05`.
pub(super) fn long() -> Vec<u8> {
    Sequence { frames: 800, pose: |frame| pose(0.01 * f64::from(frame)), ..Sequence::default() }.bytes()
}

/// A folder with small sweeps g0, g1, … and their manifest m.csv.
pub(super) fn small_sweeps(count: usize) -> Place {
    let place = Place::new();
    let mut table = "id,recording,settings\n".to_owned();
    for number in 0..count {
        place.put(&format!("g{number}.mha"), small(number));
        writeln!(table, "g{number},g{number}.mha,{QUICK}").unwrap();
    }
    place.put("m.csv", table);
    place
}

/// Adds a row with its recording.
fn add(place: &Place, id: &str, recording: Vec<u8>, settings: &str) {
    place.put(&format!("{id}.mha"), recording);
    let mut table = String::from_utf8(place.get("m.csv")).unwrap();
    writeln!(table, "{id},{id}.mha,{QUICK} {settings}").unwrap();
    place.put("m.csv", table);
}

/// Runs a command that ends with this code.
pub(super) fn ends(place: &Place, code: i32, words: &str) -> Run {
    let run = place.run(words);
    assert_eq!(run.code, code, "{words}: {}{}", run.stdout, run.stderr);
    run
}

/// Plans m.csv.
pub(super) fn plan(place: &Place, folder: &str) {
    ends(place, 0, &format!("batch plan m.csv -o {folder}"));
}

/// Begins a command in the background.
pub(super) fn begins(place: &Place, words: &str) -> Child {
    let mut command = crate::program();
    command.args(words.split_whitespace()).current_dir(place.path("."));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Calls a function until it returns something; the harness ends a test that waits for ever.
pub(super) fn awaits<T>(mut look: impl FnMut() -> Option<T>) -> T {
    loop {
        match look() {
            Some(found) => return found,
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    }
}

/// All files of a folder by their path below it.
pub(super) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in std::fs::read_dir(inner).into_iter().flatten().flatten() {
            let path = entry.path();
            let name = path.strip_prefix(folder).unwrap().display().to_string();
            if path.is_dir() {
                folders.push(path);
            } else if let Ok(content) = std::fs::read(&path) {
                files.insert(name, content);
            }
        }
    }
    files
}

/// Results of a batch, without their accounts. Nothing temporary may be among them.
pub(super) fn results(place: &Place, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let all = tree(&place.path(folder));
    assert!(!all.keys().any(|name| name.contains(".part") || name.contains("/.")), "{:?}", all.keys());
    all.into_iter().filter(|(name, _)| name.starts_with("sweeps/") && !name.ends_with("done.json")).collect()
}

/// Accounts of a sweep's tries.
pub(super) fn tries(place: &Place, folder: &str, id: &str) -> Vec<Value> {
    let files = tree(&place.path(&format!("{folder}/attempts/{id}")));
    files.values().filter_map(|text| serde_json::from_slice(text).ok()).collect()
}

/// Number of accounts of all tries.
fn all_tries(place: &Place, folder: &str) -> usize {
    tree(&place.path(&format!("{folder}/attempts"))).len()
}

/// Sends a signal to a process, which may have ended.
pub(super) fn signal(process: u64, signal: Signal) -> Result<(), Errno> {
    kill_process(Pid::from_raw(i32::try_from(process).unwrap()).unwrap(), signal)
}

/// Process of a sweep's try that runs.
pub(super) fn child_of(place: &Place, folder: &str, id: &str, number: u64) -> Option<u64> {
    let tries = tries(place, folder, id);
    tries.iter().find(|attempt| attempt["number"] == number && attempt["state"] == "started")?["child"].as_u64()
}

#[test]
fn poison_sweeps_fail_alone_with_their_codes() {
    let count = 200;
    let place = small_sweeps(count - 4);
    add(&place, "shot", long(), "--spacing 0.05");
    let whole = small(count);
    add(&place, "cut", whole[..whole.len() - 100].to_vec(), "");
    add(&place, "unplaced", Sequence { transform: "ProbeToReference", ..Sequence::default() }.bytes(), "");
    add(&place, "large", small(count + 1), "--max-memory 0.00001");
    plan(&place, "run");
    let mut run = begins(&place, "batch run run --jobs 2");
    for number in [1, 2] {
        signal(awaits(|| child_of(&place, "run", "shot", number)), Signal::KILL).unwrap();
    }
    assert_eq!(run.wait().unwrap().code(), Some(10));

    ends(&place, 0, "batch status run --json=status.json --prometheus status.prom");
    let status = place.json("status.json");
    assert_eq!([&status["done"], &status["failed"], &status["running"]], [count - 4, 4, 0], "{status}");
    let codes: BTreeMap<&str, i64> = status["unfinished"].as_array().unwrap().iter().map(code_of).collect();
    assert_eq!(codes, BTreeMap::from([("cut", 3), ("large", 6), ("shot", 137), ("unplaced", 4)]));
    let metrics = String::from_utf8(place.get("status.prom")).unwrap();
    let number = |name: &str, label: &str| -> f64 {
        let sample = format!("{name}{{batch=\"status\",{label}}} ");
        let found = metrics.lines().find_map(|line| line.strip_prefix(&sample));
        found.unwrap_or_else(|| panic!("{sample} in\n{metrics}")).parse().unwrap()
    };
    let sweeps = ["done", "failed", "running", "waiting"].map(|state| format!("state=\"{state}\""));
    let sweeps = sweeps.map(|state| number("sonoweave_batch_sweeps", &state));
    assert_eq!(sweeps, [(count - 4) as f64, 4.0, 0.0, 0.0]);
    let reasons = ["input", "memory", "signal", "configuration", "timeout"].map(|why| format!("reason=\"{why}\""));
    let reasons = reasons.map(|reason| number("sonoweave_batch_failed_sweeps", &reason));
    assert_eq!(reasons, [1.0, 1.0, 1.0, 1.0, 0.0]);
    let seconds = ["done", "failed"].map(|state| format!("state=\"{state}\""));
    let seconds = seconds.map(|state| number("sonoweave_batch_tries_seconds", &state));
    assert!(seconds.iter().all(|seconds| *seconds > 0.0), "{metrics}");
    assert!(place.names().iter().all(|name| !name.ends_with(".part")), "renamed, and nothing is left");
    for name in ["status.txt", ".prom", "a\"b.prom"] {
        let refused = place.run(&format!("batch status run --prometheus {name}"));
        assert!(refused.code == 2 && refused.stderr.contains("ends in .prom"), "{}", refused.stderr);
    }
    ends(&place, 7, "batch status run --prometheus none/x.prom");
    let began = all_tries(&place, "run");
    assert_eq!(began, count + 2, "twice: the killed one, and the one without memory");
    let shot = &tries(&place, "run", "shot")[0];
    assert!(shot["signal"] == 9 && shot["exit"] == 137, "{shot}");
    let cut = &tries(&place, "run", "cut")[0];
    assert!(cut["peak_bytes"].as_u64() > Some(1 << 20), "{cut}");
    assert!(cut["sentence"].as_str().unwrap().contains("cut.mha"), "the last sentence");

    // A second run starts nothing; a table says why.
    let again = ends(&place, 10, "batch run run");
    assert!(again.stdout.contains("calibration or configuration is unfit: no way from"), "{}", again.stdout);
    assert_eq!(all_tries(&place, "run"), began);
    ends(&place, 0, "batch verify run");
    ends(&place, 10, "batch retry run --only cut --only g0");
    assert_eq!(all_tries(&place, "run"), began + 1, "the failed one alone");

    // The same bytes as by a command of its own.
    place.does(&format!("reconstruct g0.mha -o v.mha {QUICK}"));
    let results = results(&place, "run");
    assert_eq!(results.len(), count - 4);
    let own = results.iter().find(|(name, _)| name.starts_with("sweeps/g0/")).unwrap();
    assert!(*own.1 == place.get("v.mha"));
}

fn code_of(sweep: &Value) -> (&str, i64) {
    (sweep["id"].as_str().unwrap(), sweep["exit"].as_i64().unwrap())
}

#[test]
fn changed_setting_redoes_exactly_its_rows() {
    let place = small_sweeps(5);
    plan(&place, "run");
    ends(&place, 0, "batch run run --jobs 2");
    let first = tree(&place.path("run"));
    plan(&place, "run");
    ends(&place, 0, "batch run run");
    assert!(first == tree(&place.path("run")), "nothing is written anew");

    let table = String::from_utf8(place.get("m.csv")).unwrap();
    // Another form of the same settings for g1, another setting for g3.
    let table =
        table.replace("g1.mha,", "g1.mha,--max-weight 256.0 --threads 2 ").replace("g3.mha,", "g3.mha,--spacing 0.6 ");
    place.put("m.csv", table);
    let said = ends(&place, 0, "batch plan m.csv -o run").stdout;
    assert!(said.contains("5 sweeps") && said.contains("4 of them done"), "{said}");
    ends(&place, 0, "batch run run");
    let tried = ["g0", "g1", "g2", "g3", "g4"].map(|id| tries(&place, "run", id).len());
    assert_eq!(tried, [1, 1, 1, 2, 1]);
    let done = place.json("run/sweeps/g3/done.json");
    assert!(done["settings"].as_array().unwrap().contains(&"--spacing=0.6".into()), "{done}");
    assert_eq!(done["report"]["frames"]["used"], 3);
}

#[test]
fn jobs_and_parts_give_the_same_bytes() {
    let place = small_sweeps(7);
    for folder in ["one", "two", "parts"] {
        ends(&place, 0, &format!("batch plan m.csv -o {folder} --format nii.gz --weights --planes"));
    }
    ends(&place, 0, "batch run one --jobs 1 --fail-fast");
    ends(&place, 0, "batch run two --jobs 2 --timeout 10m --attempts 1");
    for part in 1..=3 {
        ends(&place, 0, &format!("batch run parts --part {part}/3"));
    }
    let one = results(&place, "one");
    assert_eq!(one.len(), 21);
    assert!(one == results(&place, "two") && one == results(&place, "parts"));
}

#[test]
fn unusable_manifest_is_refused_with_its_rows() {
    let place = small_sweeps(2);
    let rows = "g0,g1.mha,\nx,none.mha,\ny,g1.mha,--spacing x\nz,g1.mha,--output v.mha\na/b,g1.mha,\n";
    let table = String::from_utf8(place.get("m.csv")).unwrap();
    place.put("bad.csv", table + rows);
    place.put("only.csv", "id;recording\n");
    place.put("both.jsonl", "{\"id\":\"a\",\"recording\":\"g0.mha\",\"config\":\"m.csv\",\"calibration\":\"m.csv\"}\n");
    let before = place.names();
    let refused = ends(&place, 3, "batch plan bad.csv -o run").stderr;
    let says =
        ["row 4: id g0: stands in row 2", "row 5: recording: ", "row 6: settings: ", "row 7: ", "row 8: id \"a/b\""];
    assert!(says.iter().all(|part| refused.contains(part)), "{refused}");
    for (name, says) in [("only.csv", "commas"), ("both.jsonl", "row 1: calibration and config"), ("none.csv", "none")]
    {
        let refused = ends(&place, 3, &format!("batch plan {name} -o run")).stderr;
        assert!(refused.contains(says), "{refused}");
    }
    ends(&place, 7, "batch plan m.csv -o .");
    ends(&place, 3, "batch run .");
    ends(&place, 3, "batch status none");
    assert_eq!(place.names(), before);
    plan(&place, "run");
    ends(&place, 2, "batch run run --only none");
    ends(&place, 2, "batch run run --part 4/3");
    ends(&place, 2, "batch run run --memory 8");
    // A plan by another version.
    let planned = String::from_utf8(place.get("run/plan.jsonl")).unwrap();
    place.put("run/plan.jsonl", planned.replace("\"program\":\"", "\"program\":\"0.0."));
    let refused = ends(&place, 4, "batch run run").stderr;
    assert!(refused.contains("is by version 0.0."), "{refused}");
}

#[test]
fn changed_or_missing_recording_is_refused_for_its_row() {
    let place = small_sweeps(4);
    plan(&place, "run");
    place.put("g1.mha", small(99));
    std::fs::remove_file(place.path("g2.mha")).unwrap();
    let run = ends(&place, 10, "batch run run --quiet");
    assert!(
        run.stderr.contains("g1: failed with exit code 3: ") && run.stderr.contains("has changed"),
        "{}",
        run.stderr
    );
    assert!(run.stdout.contains("2 of 4 sweeps are done, 2 have failed"), "{}", run.stdout);
    assert_eq!(results(&place, "run").len(), 2);
    // With its planned content, it is tried again on request.
    place.put("g1.mha", small(1));
    ends(&place, 0, "batch retry run --only g1");
}

#[test]
fn damaged_result_is_found_and_made_again() {
    let place = small_sweeps(3);
    plan(&place, "run");
    ends(&place, 0, "batch run run");
    let whole = results(&place, "run");
    let names: Vec<String> = whole.keys().map(|name| format!("run/{name}")).collect();
    let mut flipped = place.get(&names[0]);
    *flipped.last_mut().unwrap() ^= 1;
    place.put(&names[0], flipped);
    std::fs::remove_file(place.path(&names[1])).unwrap();
    place.put("run/sweeps/g2/done.json", "{");
    let said = ends(&place, 10, "batch verify run").stdout;
    for says in ["3 are damaged", "g0: ", "another content", "g1: ", "g2: ", "cannot be read"] {
        assert!(said.contains(says), "{says}: {said}");
    }
    ends(&place, 0, "batch verify run --repair");
    assert!(whole == results(&place, "run"));
    ends(&place, 0, "batch verify run");
}

#[test]
fn limits_and_unwritable_places_have_their_codes() {
    let place = small_sweeps(2);
    add(&place, "long", long(), "--spacing 0.05");
    add(&place, "vast", long(), "--spacing 0.02");
    plan(&place, "run");
    ends(&place, 10, "batch run run --only long --timeout 1s --attempts 1");
    ends(&place, 10, "batch run run --only vast --memory 512MiB --attempts 1");
    // No room: files have a limit, which a disk without room is like.
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" batch run run --only g0 --attempts 1";
    let run = place.output(std::process::Command::new("sh").args(["-c", script]).arg(crate::program().get_program()));
    assert_eq!(run.code, 10, "{}", run.stderr);
    // A place that is no folder.
    place.put("run/sweeps/g1", "");
    ends(&place, 10, "batch run run --only g1 --attempts 1");
    std::fs::remove_file(place.path("run/sweeps/g1")).unwrap();
    let exits = ["long", "vast", "g0", "g1"].map(|id| tries(&place, "run", id)[0]["exit"].as_i64().unwrap());
    assert_eq!(exits, [8, 6, 7, 7]);
    assert!(results(&place, "run").is_empty());
    ends(&place, 0, "batch retry run --only g0 --only g1");
}

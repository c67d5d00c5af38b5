//! Sessions: recorded, replayed to the same bits at any speed, continued, and reconfigured; and
//! the messages if that is impossible.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::place::Place;

/// A small virtual bedside with many disturbances: late and jittering video that loses frames, a
/// tracker that loses bytes and readings.
const BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "96x80"
rate_hz = 30
latency_ms = 40.0
[volume]
spacing_mm = 1.0
[picture]
image_size = "96x96"
transfer = "phantom"
[virtual]
frames = 60
[virtual.line]
jitter_ms = 0.5
drop = 0.0005
dropout = 0.02
[virtual.grabber]
latency_ms = 40.0
jitter_ms = 2.0
dropout = 0.02
"#;

const LEAVES: &str = "-o live.mha --weights live-weights.mha --picture live.png --json=live.json";
const AGAIN: &str = "-o again.mha --weights again-weights.mha --picture again.png --json=again.json";
const SAME: &str = "the volume is the same as in the live session, bit by bit";

fn place() -> Place {
    let place = Place::new();
    place.put("bedside.toml", BEDSIDE);
    place
}

/// Returns the sessions in a folder, the oldest first.
fn sessions(place: &Place, folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(place.path(folder)).unwrap();
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found
}

/// Runs a session for `seconds`; returns its file.
fn recorded(place: &Place, seconds: f64) -> String {
    let run = place.run(&format!("live --config bedside.toml --duration {seconds} --record sessions {LEAVES}"));
    assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
    sessions(place, "sessions")[0].display().to_string()
}

/// Returns the statistics that must be equal live and replayed.
fn outcomes(stats: &Value) -> [Value; 3] {
    let readings = &stats["readings"][0];
    let of_readings = ["total", "used", "refused", "dropped"].map(|key| readings[key].clone());
    let frames = ["total", "used", "refused", "dropped", "waiting"].map(|key| stats["frames"][key].clone());
    [Value::from(frames.to_vec()), Value::from(of_readings.to_vec()), stats["digest"].clone()]
}

/// A daemon that runs in the folder.
struct Daemon(Child);

impl Daemon {
    fn begin(place: &Place, words: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sonoweave"));
        let command = command.args(words.split_whitespace()).current_dir(place.path("."));
        Self(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap())
    }

    /// Uses the shell's own `kill`: a bare machine has no other.
    fn signal(&self, name: &str) {
        let status = Command::new("sh").args(["-c", &format!("kill -{name} {}", self.0.id())]).status().unwrap();
        assert!(status.success());
    }

    fn ends(mut self) -> Option<i32> {
        self.0.wait().unwrap().code()
    }
}

/// Waits for a condition, with patience for a busy machine.
fn until(what: &str, mut is_so: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Waits until a recording in the folder has `bytes` bytes; returns its path.
fn until_recorded(place: &Place, folder: &str, at: usize, bytes: u64) -> PathBuf {
    let file = || -> Option<PathBuf> {
        let path = place.path(folder);
        let mut found: Vec<PathBuf> = std::fs::read_dir(path).ok()?.filter_map(|e| Some(e.ok()?.path())).collect();
        found.sort();
        found.get(at).cloned().filter(|path| path.metadata().is_ok_and(|file| file.len() >= bytes))
    };
    until("a session is recorded", || file().is_some());
    file().unwrap()
}

#[test]
fn session_replays_to_equal_bits_at_any_speed() {
    let place = place();
    let session = recorded(&place, 3.0);
    let live = place.json("live.json");
    assert!(live["frames"]["used"].as_u64().unwrap() > 20, "{live}");
    assert!(live["digest"]["volume_sha256"].is_string() && live["digest"]["picture_sha256"].is_string(), "{live}");
    for speed in ["max", "3", "1.5"] {
        let run = place.run(&format!("replay {session} --speed {speed} {AGAIN}"));
        assert_eq!(run.code, 0, "{speed}: {}", run.stderr);
        assert!(run.stderr.contains(SAME), "{}", run.stderr);
        let again = place.json("again.json");
        assert_eq!(outcomes(&live), outcomes(&again), "{speed}");
        assert_eq!((&again["differences"], &again["first_difference"]), (&0.into(), &Value::Null));
        for name in ["{}.mha", "{}-weights.mha", "{}.png"] {
            let [one, other] = ["live", "again"].map(|which| place.get(&name.replace("{}", which)));
            assert!(one == other, "{name} at {speed}");
        }
    }
}

#[test]
fn replay_is_independent_of_threads_and_original_files() {
    let place = place();
    place
        .put("look.toml", "format = \"sonoweave-transfer\"\nversion = 1\n[opacity]\ncurve = [[20, 0.0], [200, 0.8]]\n");
    let config = BEDSIDE.replace("transfer = \"phantom\"", "transfer = \"look.toml\"");
    place.put("bedside.toml", &config);
    let session = recorded(&place, 2.0);
    // Its configuration is in the session.
    std::fs::remove_file(place.path("look.toml")).unwrap();
    std::fs::remove_file(place.path("bedside.toml")).unwrap();
    let run = place.run(&format!("replay {session} {AGAIN}"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains(SAME), "{}", run.stderr);
    // One thread, with another file that is otherwise equal.
    let one = BEDSIDE.replace("spacing_mm = 1.0", "spacing_mm = 1.0\nthreads = 1");
    place.put("one.toml", &one);
    let run = place.run(&format!("replay {session} --config one.toml {AGAIN}"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(place.get("live.mha") == place.get("again.mha") && !run.stderr.contains(SAME), "{}", run.stderr);
    place.put("coarse.toml", BEDSIDE.replace("spacing_mm = 1.0", "spacing_mm = 2.0"));
    let run = place.run(&format!("replay {session} --config coarse.toml {AGAIN}"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_ne!(place.volume("live.mha").header.size, place.volume("again.mha").header.size);
}

#[test]
fn killed_session_is_resumed_and_both_replay_as_one() {
    let place = place();
    let daemon = Daemon::begin(&place, "live --config bedside.toml --record sessions --quiet");
    let first = until_recorded(&place, "sessions", 0, 200_000);
    daemon.signal("KILL");
    assert_eq!(daemon.ends(), None);
    // Alone.
    let run = place.run(&format!("replay {} {AGAIN}", first.display()));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("broken off") && !run.stderr.contains(SAME), "{}", run.stderr);
    let before = place.json("again.json")["digest"]["slices"].as_u64().unwrap();
    assert!(before > 10, "{before}");
    // Continued.
    let run = place.run(&format!(
        "live --config bedside.toml --duration 2 --record sessions --resume {} {LEAVES}",
        first.display()
    ));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains(&format!(": {before} slices are in the volume")), "{}", run.stderr);
    let live = place.json("live.json");
    let slices = live["digest"]["slices"].as_u64().unwrap();
    assert_eq!(slices, before + live["frames"]["used"].as_u64().unwrap());
    let second = sessions(&place, "sessions")[1].display().to_string();
    let run = place.run(&format!("replay {second} {AGAIN}"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains(SAME), "{}", run.stderr);
    assert!(place.get("live.mha") == place.get("again.mha") && place.get("live.png") == place.get("again.png"));
    // Without the first session the continuation is incomplete.
    std::fs::rename(&first, place.path("elsewhere.mcap")).unwrap();
    place.refuses_with(&format!("replay {second} {AGAIN}"), &["continues ", "put that session into the same folder"]);
    // Settings that would change the slices' positions.
    place.put("coarse.toml", BEDSIDE.replace("spacing_mm = 1.0", "spacing_mm = 2.0"));
    place.refuses_with(
        "live --config coarse.toml --duration 1 --resume elsewhere.mcap",
        &["--resume elsewhere.mcap: was recorded with other settings (volume.spacing_mm: [1.0,1.0,1.0] → [2.0,2.0,2.0])"],
    );
}

#[test]
fn sighup_changes_are_repeated_by_the_replay() {
    let place = place();
    let daemon = Daemon::begin(&place, &format!("live --config bedside.toml --record sessions --quiet {LEAVES}"));
    let session = until_recorded(&place, "sessions", 0, 150_000);
    let newer = BEDSIDE
        .replace("reference_station = 2", "reference_station = 2\nlatency_ms = 3.0")
        .replace("image_size = \"96x96\"", "image_size = \"64x48\"")
        .replace("spacing_mm = 1.0", "spacing_mm = 2.0");
    place.put("bedside.toml", newer);
    daemon.signal("HUP");
    let bytes = session.metadata().unwrap().len();
    until_recorded(&place, "sessions", 0, bytes + 150_000);
    place.put("bedside.toml", "format = ");
    daemon.signal("HUP");
    let bytes = session.metadata().unwrap().len();
    until_recorded(&place, "sessions", 0, bytes + 50_000);
    daemon.signal("TERM");
    assert_eq!(daemon.ends(), Some(0));
    let live = place.json("live.json");
    let notes = live["notes"].to_string();
    for said in [
        "from now on tracker.latency_ms: 0.0 → 3.0",
        "from now on picture.image_size: [96,96] → [64,48]",
        "in the next session volume.spacing_mm: [1.0,1.0,1.0] → [2.0,2.0,2.0]",
        "cannot be used, so that the old one holds",
    ] {
        assert!(notes.contains(said), "{said}: {notes}");
    }
    let run = place.run(&format!("replay {} {AGAIN}", session.display()));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains(SAME), "{}", run.stderr);
    assert_eq!(outcomes(&live), outcomes(&place.json("again.json")));
    assert!(place.get("live.png") == place.get("again.png"));
    assert_eq!(&place.get("live.png")[16..24], [0, 0, 0, 64, 0, 0, 0, 48], "width and height");
}

#[test]
fn flags_unused_by_a_session_are_refused() {
    let place = place();
    let session = recorded(&place, 1.0);
    let refused = place.run(&format!("replay {session} -o x.mha --sigma 1,1,1"));
    assert!(refused.code == 2 && refused.stderr.contains("--sigma: a session is replayed"), "{}", refused.stderr);
    place.refuses_with(&format!("replay {session} -o {session}.mha --speed 0"), &[]);
    let dropped = place.run(&format!("replay {session} --all -o x.mha"));
    assert_eq!(dropped.code, 0, "{}", dropped.stderr);
    assert!(dropped.stderr.contains("are used, of which there are none"), "{}", dropped.stderr);
    // While the scanner's data region is unknown, nothing is recorded.
    let unknown =
        BEDSIDE.replace("[grabber]", "[calibration]\nimage_to_probe = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n[grabber]");
    place.put("unknown.toml", unknown);
    place.refuses_with(
        "live --config unknown.toml --duration 1 --record elsewhere",
        &["cannot record, because the scanner's image is unknown", "clip_px", "full_frame = true"],
    );
    assert!(!place.path("elsewhere").exists());
}

//! The program itself: killed while it records, run twice on one device, configured to record to an
//! unwritable folder.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;
use sonoweave::app::devices;
use tempfile::TempDir;

use config::bedside::Bedside;
use drivers::replay::{SessionReplay, SessionSettings};
use drivers::simulated::{Faults, Pty, fastrak};
use formats::session::Ending;
use sonoweave_core::clock::{Clock as _, Monotonic, SECOND};
use sonoweave_core::reading::Frame;
use sonoweave_core::slice::Pixels;
use sonoweave_core::{Device, NO_DEADLINE, Next, Reading};
use sync::ingest::Ingest;

use crate::disk::read;
use crate::plugs::hand;

/// A small virtual bedside, quickly simulated.
const SMALL: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n[grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n[record]\nkeep_free_mb = 1\n";
/// Anything slower has hung.
const PATIENCE: Duration = Duration::from_secs(120);

fn bedside(folder: &TempDir, text: &str) -> PathBuf {
    let path = folder.path().join("bedside.toml");
    fs::write(&path, text).unwrap();
    path
}

fn program(folder: &TempDir, words: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_sonoweave"))
        .args(words)
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for a program; returns its exit status and its messages.
fn ended(mut child: Child) -> (ExitStatus, String) {
    let log = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
    (child.wait().unwrap(), log)
}

/// Returns a run's JSON output.
fn json(folder: &TempDir, words: &[&str]) -> Value {
    let out = Command::new(env!("CARGO_BIN_EXE_sonoweave")).args(words).current_dir(folder.path()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

fn session(folder: &Path) -> PathBuf {
    fs::read_dir(folder).unwrap().next().unwrap().unwrap().path()
}

#[test]
fn killed_recording_keeps_all_but_the_last_second() {
    let folder = tempfile::tempdir().unwrap();
    bedside(&folder, SMALL);
    let mut child = program(&folder, &["live", "--config", "bedside.toml", "--record", "rec"]);
    // It reports the number of frames periodically.
    let mut log = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let frames = |line: String| {
        let words = line.strip_prefix("sonoweave: ")?.split(" slices of ").nth(1)?.split(' ').next()?.to_owned();
        words.parse::<u64>().ok()
    };
    let mut frames = log.by_ref().filter_map(frames);
    let reported = frames.find(|frames| *frames >= 60).unwrap();
    // By the frames' own clock, 30 a second, the reported ones are then older than a second.
    frames.find(|later| *later >= reported + 45).unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    let file = session(&folder.path().join("rec"));
    let left = read(&fs::read(&file).unwrap());
    assert_eq!(left.ending, Some(Ending::BrokenOff));
    assert!(left.times.is_sorted());
    let kept = left.frame_numbers.len() as u64;
    assert!(kept >= reported && left.missing == 0, "{kept} of {reported}, {} are missing", left.missing);
    assert!(left.poses > 2 * kept, "{} {kept}", left.poses);
    let name = file.to_str().unwrap();
    let report = json(&folder, &["inspect", name, "--json"]);
    assert_eq!(report["finished"], false, "{report}");
    json(&folder, &["repair", name, "-o", "whole.mcap", "--json"]);
    let report = json(&folder, &["inspect", "whole.mcap", "--json"]);
    assert_eq!(report["finished"], true, "{report}");
    let whole = read(&fs::read(folder.path().join("whole.mcap")).unwrap());
    assert_eq!((whole.ending, whole.damaged), (Some(Ending::Finished), false));
    assert_eq!((whole.frame_numbers, whole.poses), (left.frame_numbers, left.poses));
}

#[test]
fn second_process_on_tracker_is_refused_with_the_owner() {
    let folder = tempfile::tempdir().unwrap();
    let twin = Arc::new(Mutex::new(fastrak::Twin::new(hand(), Faults::default())));
    let line = Pty::run(twin).unwrap();
    let port = format!("port = \"{}\"", line.path().display());
    bedside(&folder, &SMALL.replace("port = \"virtual\"\nreference_station = 2", &port));
    let words = |json: &'static str| ["live", "--config", "bedside.toml", json];
    let mut first = program(&folder, &words("--json=first.json"));
    // Once it uses frames, it has the line.
    let mut log = BufReader::new(first.stderr.take().unwrap()).lines().map_while(Result::ok);
    let uses = |line: &String| line.contains(" slices of ") && !line.starts_with("sonoweave: 0 slices");
    log.by_ref().find(uses).unwrap();
    let process = first.id();
    let for_a_while = [&words("--json=second.json")[..], &["--duration", "5"]].concat();
    let (status, second_log) = ended(program(&folder, &for_a_while));
    assert!(status.success(), "{second_log}");
    Command::new("sh").args(["-c", &format!("kill -TERM {process}")]).status().unwrap();
    assert!(log.count() < 1000 && first.wait().unwrap().success());
    let who = format!("another program has it open, sonoweave (process {process}); close that");
    assert!(second_log.contains("tracking is absent") && second_log.contains(&who), "{second_log}");
    let stats = |name| -> Value { serde_json::from_slice(&fs::read(folder.path().join(name)).unwrap()).unwrap() };
    let [first, second] = ["first.json", "second.json"].map(stats);
    assert_eq!((&second["frames"]["used"], &second["readings"][0]["total"]), (&0.into(), &0.into()));
    assert_eq!(second["frames"]["refused"]["pose_missing"], second["frames"]["total"]);
    // The first was set up once, and lost nothing.
    assert_eq!((&first["devices"][0]["set_up"], &first["readings"][0]["lost"]), (&1.into(), &0.into()));
    assert_eq!(first["readings"][0]["used"], first["readings"][0]["total"]);
    assert!(first["frames"]["used"].as_u64().unwrap() > 60, "{}", first["frames"]);
}

#[test]
fn unwritable_folder_is_refused_at_start() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "no folder").unwrap();
    bedside(&folder, SMALL);
    let refused = |config: &str, record: &str| {
        let words = ["live", "--config", config, "--record", record, "--duration", "60", "--json=stats.json"];
        let begun = Instant::now();
        let (status, log) = ended(program(&folder, &words));
        assert_eq!(status.code(), Some(7), "{log}");
        assert!(begun.elapsed() < PATIENCE / 3, "at once, and not after the session");
        assert!(!folder.path().join("stats.json").exists() && !folder.path().join("rec").exists());
        log
    };
    let log = refused("bedside.toml", "file/rec");
    assert!(log.contains("file/rec") && log.contains("making the folder for sessions failed"), "{log}");
    fs::write(folder.path().join("much.toml"), SMALL.replace("keep_free_mb = 1\n", "keep_free_mb = 4000000000\n"))
        .unwrap();
    let log = refused("much.toml", "rec");
    assert!(log.contains("MB are free on this disk") && log.contains("keep_free_mb reserves 4000000000"), "{log}");
}

#[test]
fn recorded_bytes_decode_to_the_recorded_readings() {
    let folder = tempfile::tempdir().unwrap();
    bedside(&folder, SMALL);
    let (status, log) =
        ended(program(&folder, &["live", "--config", "bedside.toml", "--record", "rec", "--duration", "3", "--quiet"]));
    assert!(status.success(), "{log}");
    let poses = |decode: bool| {
        let settings = SessionSettings {
            device: Some("tracking".into()),
            decode,
            ..SessionSettings::new(session(&folder.path().join("rec")))
        };
        let mut replay = SessionReplay::open(&settings).unwrap();
        replay.start().unwrap();
        let mut poses = Vec::new();
        loop {
            match replay.next(NO_DEADLINE).unwrap() {
                Next::Reading(Reading::Pose(pose)) => {
                    poses.push((pose.station, pose.position_cm, pose.quaternion_wxyz))
                }
                Next::Reading(_) | Next::Pending => {}
                Next::End => return poses,
            }
        }
    };
    let (recorded, decoded) = (poses(false), poses(true));
    assert!(recorded.len() > 60, "{}", recorded.len());
    // The last bytes arrived at the end of the session and were not decoded: on a busy machine as
    // many as a terminal holds, 4096, of records of 16 and more.
    assert!(decoded.len() - recorded.len() < 256, "{} {}", decoded.len(), recorded.len());
    assert_eq!(recorded, decoded[..recorded.len()]);
}

#[test]
fn grabber_orientation_gives_the_same_anatomy() {
    let seen = |orientation: &str| {
        let text = SMALL.replace("size = \"96x80\"\n", &format!("size = \"96x80\"\norientation = \"{orientation}\"\n"));
        let bedside =
            Bedside::parse("bedside.toml".as_ref(), &(text + "[virtual]\nnoise_sd = 0.0\nscene = \"ramp\"\n"));
        // The hand rests until it begins to move, long after this.
        let mut devices = devices::open(&bedside.unwrap(), i64::MAX / 2, false).unwrap();
        devices.grabber.start().unwrap();
        // It begins when the tracker delivers.
        devices.tracking.start().unwrap();
        let mut poses = 0;
        while poses < 10 {
            let next = devices.tracking.next(Monotonic.now_ns() + SECOND).unwrap();
            poses += u32::from(matches!(next, Next::Reading(Reading::Pose(_))));
        }
        let Next::Reading(Reading::Frame(frame)) = devices.grabber.next(i64::MAX / 4).unwrap() else { panic!() };
        frame
    };
    let mf = |frame: &Frame| {
        let picture = Ingest::new().picture(frame).unwrap();
        let Pixels::U8(pixels) = picture.image.pixels() else { panic!() };
        ([picture.image.width(), picture.image.height()], pixels.to_vec())
    };
    let usual = seen("MF");
    let (size, pixels) = mf(&usual);
    assert_eq!((size, usual.orientation.as_ref()), ([96, 80], "MF"));
    let levels = pixels.iter().collect::<std::collections::BTreeSet<_>>().len();
    assert!(levels > 8, "there is something to see: {levels}");
    let other = seen("UN");
    assert_eq!((other.size, other.orientation.as_ref()), ([96, 80], "UN"));
    assert!(other.pixels != usual.pixels);
    assert_eq!(mf(&other), (size, pixels));
    // If video is stored by columns, the size is the video's.
    let turned = seen("FM");
    assert_eq!((turned.size, turned.orientation.as_ref(), mf(&turned).0), ([96, 80], "FM", [80, 96]));
}

//! Constant memory of a long session: 64² frames at 30 Hz into a volume that is scanned
//! repeatedly, with recording and rendering.
//!
//! The test takes twelve seconds, two minutes with SONOWEAVE_STRESS=quick, twenty with
//! SONOWEAVE_STRESS=full.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

const BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "64x64"
rate_hz = 30
[volume]
spacing_mm = 1.5
[picture]
image_size = "128x128"
transfer = "phantom"
[virtual]
frames = 60
[virtual.line]
jitter_ms = 0.5
[virtual.grabber]
jitter_ms = 2.0
"#;

/// Permitted fluctuation: a page table, a thread's new arena.
const SLACK_BYTES: u64 = 3 << 20;

fn resident_bytes(pid: u32) -> Option<u64> {
    let statm = std::fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    let pages: u64 = statm.split(' ').nth(1)?.parse().ok()?;
    Some(pages * 4096)
}

#[test]
#[allow(clippy::print_stdout, reason = "the figure is wanted beside the verdict")]
fn long_session_uses_constant_memory() {
    let seconds = match std::env::var("SONOWEAVE_STRESS").as_deref() {
        Ok("full") => 1200,
        Ok("quick") => 120,
        _ => 12,
    };
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("bedside.toml"), BEDSIDE).unwrap();
    let words = format!(
        "live --config bedside.toml --duration {seconds} --record sessions --picture p.png --stats stats.json --quiet"
    );
    let mut daemon = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
        .args(words.split_whitespace())
        .current_dir(place.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let (began, mut held) = (Instant::now(), Vec::new());
    while daemon.try_wait().unwrap().is_none() {
        // Writing the results at the end takes additional memory.
        if began.elapsed() < Duration::from_secs(seconds) {
            held.extend(resident_bytes(daemon.id()).filter(|bytes| *bytes > 0));
        }
        assert!(began.elapsed() < Duration::from_secs(seconds + 120), "it does not end");
        std::thread::sleep(Duration::from_millis(250));
    }
    assert!(daemon.wait().unwrap().success());
    let stats: Value = serde_json::from_slice(&std::fs::read(place.path().join("stats.json")).unwrap()).unwrap();
    let frames = &stats["frames"];
    let count = |key: &str| frames[key].as_u64().unwrap_or(0);
    let refused: u64 = frames["refused"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(count("total"), count("used") + refused, "none waits and none is dropped: {frames}");
    assert!(count("used") > 20 * seconds && refused < 30, "{frames}");
    assert_eq!((count("lost"), &stats["recording"]["lost"]), (0, &0.into()), "{stats}");
    // After four seconds the whole sweep has been seen, there and back.
    let third = held.len() / 3;
    let most = |part: &[u64]| part.iter().copied().max().unwrap_or(0);
    let (middle, last) = (most(&held[third..2 * third]), most(&held[2 * third..]));
    println!("{seconds} s: {middle} bytes at most in the middle third, {last} in the last, {} frames", count("used"));
    assert!(last <= middle + SLACK_BYTES, "{middle} bytes, then {last}");
}

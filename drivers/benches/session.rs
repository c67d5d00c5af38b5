//! Measures writing and reading of a session: `make bench`, or
//! `cargo bench -p sonoweave-drivers --bench session -- [--quick] [--syncs]`.
//!
//! Frames of 640×480, mixed with poses, pass through the writer into a file as in live use, and
//! back through the reader, each on one core. The bench prints frames and plain megabytes per
//! second of the thread's own time, which other processes hardly affect. It also prints the
//! compression ratio, and the share of a core used at 60 frames per second.
//!
//! Then it writes in real time, in alternating rounds with and without syncs; `--syncs` does only
//! this. It prints the time that the writer takes for a frame. The next message waits so long in
//! the recorder's queue, whose room is for 4096: the thread that captures waits for none.
//! `out/bench/session/figures.json` has these times, for the records of `docs/numbers`.
//!
//! Test images: painted speckle in a fan; noise alone, which is incompressible; and recordings
//! if present (`SONOWEAVE_TEST_DATA`, else `../shared/data`). The last file remains as
//! `out/session-bench.mcap`, for `scripts/session_by_others.py`.
#![allow(clippy::print_stdout, reason = "a bench speaks to its user")]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use drivers::replay::{Replay, SequenceSettings, SessionReplay, SessionSettings};
use formats::session::{Crop, SessionWriter, WriterOptions};
use serde_json::json;
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::reading::{Counts, Frame, PixelType, Pose, Raw, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, NO_DEADLINE, Next};

const SIZE: [u32; 2] = [640, 480];
/// Live frame rate, frames per second, and the goal for the used share of a core.
const RATE: f64 = 60.0;
const GOAL: f64 = 0.10;

/// Rounds in real time, with and without syncs, and frames of each.
const ROUNDS: u32 = 5;
const ROUND_FRAMES: u64 = 600;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let [quick, only_syncs] = ["--quick", "--syncs"].map(|flag| std::env::args().any(|argument| argument == flag));
    let frames = if quick { 120 } else { 1200 };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../out");
    std::fs::create_dir_all(&folder)?;
    let mut scenes = vec![("noise", vec![noise(1), noise(2)]), ("painted", (0..8).map(painted).collect())];
    if only_syncs {
        compare_syncs(quick, &scenes, &folder)?;
        return Ok(ExitCode::SUCCESS);
    }
    println!("pictures          written: frames/s   MB/s   core at 60 Hz   smaller by   read: frames/s   MB/s");
    for (name, file) in [
        ("water tank", "latency/WaterTankBottomTranslationVideoBuffer.igs.mha"),
        ("curvilinear", "formats/UltrasonixCurvilinearScanConvertedData.igs.mha"),
        ("spine", "freehand/SpinePhantomFreehand.igs.mha"),
    ] {
        match recording(file) {
            Some(pictures) => scenes.push((name, pictures)),
            None => println!("{name:12}      is not there"),
        }
    }
    let kept = folder.join("session-bench.mcap");
    let mut right = true;
    for (name, pictures) in &scenes {
        right &= measure(name, pictures, frames, &kept)?;
    }
    compare_syncs(quick, &scenes[..2], &folder)?;
    Ok(if right { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Times of frames in real time, ms.
#[derive(Default)]
struct Paced {
    taken_ms: Vec<f64>,
    unsynced_ms: f64,
}

/// Writes each scene with and without syncs in turns, prints the times, and writes the figures.
fn compare_syncs(quick: bool, scenes: &[(&str, Vec<Arc<[u8]>>)], folder: &Path) -> Result<(), Box<dyn Error>> {
    let (rounds, frames) = if quick { (1, 60) } else { (ROUNDS, ROUND_FRAMES) };
    let mut figures = serde_json::Map::new();
    println!("\nin real time, ms          a frame: median   99 %   most   unsynced at most");
    for (scene, pictures) in scenes {
        let mut both = [Paced::default(), Paced::default()];
        for round in 0..2 * rounds {
            // Both begin in turns.
            let syncs = (round / 2 + round) % 2 == 1;
            paced(syncs, pictures, frames, folder, &mut both[usize::from(syncs)])?;
        }
        for (way, Paced { mut taken_ms, unsynced_ms }) in ["not synced", "synced"].into_iter().zip(both) {
            taken_ms.sort_by(f64::total_cmp);
            let at = |share: f64| taken_ms[((taken_ms.len() - 1) as f64 * share) as usize];
            let [median, p99, most] = [0.5, 0.99, 1.0].map(at);
            println!("{scene:10} {way:12}            {median:6.2} {p99:6.2} {most:6.2}   {unsynced_ms:16.0}");
            let spread = json!({ "median": median, "p99": p99, "most": most, "rounds": rounds });
            figures.insert(format!("{scene}/{way}/frame, ms"), spread);
            figures.insert(format!("{scene}/{way}/unsynced at most, ms"), json!(unsynced_ms));
        }
    }
    let folder = folder.join("bench").join(if quick { "quick-session" } else { "session" });
    std::fs::create_dir_all(&folder)?;
    let run = json!({ "quick": quick, "figures": figures });
    Ok(std::fs::write(folder.join("figures.json"), serde_json::to_string_pretty(&run)? + "\n")?)
}

/// Writes frames at their rate, with a thread that syncs them or without.
fn paced(
    syncs: bool,
    pictures: &[Arc<[u8]>],
    frames: u64,
    folder: &Path,
    into: &mut Paced,
) -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir_in(folder)?;
    let mut session = SessionWriter::create(folder.path(), WriterOptions::new("a bench"))?;
    let grabber = session.device("grabber", None, &Description::default(), None)?;
    let syncer = session.syncer();
    let thread = syncs.then(|| std::thread::spawn(move || syncer.run()));
    let (begin_ns, taken_ms, mut unsynced_ns) = (Monotonic.now_ns(), &mut into.taken_ms, 0);
    for item in 0..frames {
        let at_ns = begin_ns + (item as f64 / RATE * 1e9) as i64;
        Monotonic.wait_until(at_ns);
        let begun_ns = Monotonic.now_ns();
        session.write(grabber, &frame(item, at_ns, &pictures[item as usize % pictures.len()]), at_ns)?;
        let now_ns = Monotonic.now_ns();
        taken_ms.push((now_ns - begun_ns) as f64 * 1e-6);
        unsynced_ns = session.account().unsynced_since_ns.map_or(0, |since_ns| now_ns - since_ns).max(unsynced_ns);
    }
    session.finish(Monotonic.now_ns())?;
    thread.map(|thread| thread.join().map_err(|_| "the syncing thread has panicked")).transpose()?;
    into.unsynced_ms = into.unsynced_ms.max(unsynced_ns as f64 * 1e-6);
    Ok(())
}

/// Returns this thread's CPU time, s.
fn own_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    (now.tv_sec * SECOND + now.tv_nsec) as f64 * 1e-9
}

fn measure(name: &str, pictures: &[Arc<[u8]>], frames: u64, kept: &Path) -> Result<bool, Box<dyn Error>> {
    let plain = (frames * u64::from(SIZE[0]) * u64::from(SIZE[1])) as f64 / 1e6;
    let folder = tempfile::tempdir_in(kept.parent().unwrap_or(kept))?;
    let mut session = SessionWriter::create(folder.path(), WriterOptions::new("a bench"))?;
    let path = session.path().to_owned();
    let about = Description { name: "a bench".into(), image_size: Some(SIZE), ..Description::default() };
    let crop = Some(Crop { offset: [0; 2], size: SIZE });
    let grabber = session.device("grabber", None, &about, crop)?;
    let tracker = session.device("tracker", None, &about, None)?;
    let (begin_ns, own) = (Monotonic.now_ns(), own_s());
    for item in 0..frames {
        let at_ns = begin_ns + (item as f64 / RATE * 1e9) as i64;
        session.write(grabber, &frame(item, at_ns, &pictures[item as usize % pictures.len()]), at_ns)?;
        for reading in others(2 * item, at_ns) {
            session.write(tracker, &reading, at_ns)?;
        }
    }
    let account = session.finish(begin_ns)?;
    let own = own_s() - own;
    let share = own / frames as f64 * RATE;
    let again = own_s();
    let mut replay = SessionReplay::open(&SessionSettings::new(&path))?;
    replay.start()?;
    let (mut read, mut right) = (0, true);
    while let Next::Reading(reading) = replay.next(NO_DEADLINE)? {
        if let Reading::Frame(frame) = reading {
            right &= frame.pixels == pictures[read as usize % pictures.len()];
            read += 1;
        }
    }
    let read_s = own_s() - again;
    right &= read == frames && account.lost == 0;
    println!(
        "{name:12}         {:14.0}  {:5.0}          {:5.1} %   {:10.2}   {:14.0}  {:5.0}{}{}",
        frames as f64 / own,
        plain / own,
        share * 100.0,
        plain * 1e6 / account.file_bytes as f64,
        frames as f64 / read_s,
        plain / read_s,
        if share > GOAL { "   more than the goal of 10 %" } else { "" },
        if right { "" } else { "   WRONG: what is read is not what was written" },
    );
    std::fs::rename(&path, kept)?;
    Ok(right)
}

fn frame(item: u64, at_ns: i64, pixels: &Arc<[u8]>) -> Reading {
    Reading::Frame(Frame {
        stamp: Stamp { item, host_ns: Some(at_ns), ticks: Some(item), ..Stamp::default() },
        frame_number: Some(item),
        status: Status::Ok,
        size: SIZE,
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MFA".into(),
        image_type: "BRIGHTNESS".into(),
        pixels: Arc::clone(pixels),
        fields: Vec::new(),
    })
}

/// Returns the other data recorded meanwhile: poses of two stations, bytes, counts.
fn others(item: u64, at_ns: i64) -> [Reading; 4] {
    let stamp = |item| Stamp { item, host_ns: Some(at_ns), ..Stamp::default() };
    let pose = |station: u8| {
        let angle = item as f64 * 1e-3;
        Reading::Pose(Pose {
            stamp: stamp(item + u64::from(station) - 1),
            station,
            position_cm: [10.0 + angle, f64::from(station), -30.25],
            quaternion_wxyz: [angle.cos(), 0.0, angle.sin(), 0.0],
            buttons: 0,
            distortion: None,
            code: None,
            status: Status::Ok,
        })
    };
    let raw = Raw { stamp: stamp(item / 2), line: 0, bytes: [0x30; 64].into() };
    let counts = [item.cast_signed(), -5, 7, 0, 0, 0];
    let counts = Counts { stamp: stamp(item / 2), first: 0, axes: 3, counts, homed: 7, buttons: 0, status: Status::Ok };
    [Reading::Raw(raw), pose(1), pose(2), Reading::Counts(counts)]
}

fn noise(seed: u64) -> Arc<[u8]> {
    let mut random = fastrand::Rng::with_seed(seed);
    (0..SIZE[0] * SIZE[1]).map(|_| random.u8(..)).collect()
}

/// Returns speckle of a few pixels in smooth shades, within a fan on black; different for each
/// `nth`.
fn painted(nth: u64) -> Arc<[u8]> {
    let grain = noise(nth + 10);
    let [width, height] = SIZE;
    let at = |x: u32, y: u32| f64::from(grain[(y.min(height - 1) * width + x.min(width - 1)) as usize]);
    let pixel = |n: u32| {
        let (x, y) = (n % width, n / width);
        let (dx, dy) = (f64::from(x) - 320.0, f64::from(y) + 60.0);
        let inside = dx.abs() < 0.6 * dy && (100.0..520.0).contains(&dx.hypot(dy));
        // Each grain is 3 by 2 pixels, smooth in between.
        let (u, v) = (x / 3, y / 2);
        let share = f64::from(x % 3) / 3.0;
        let speckle = (1.0 - share) * at(u, v) + share * at(u + 1, v);
        let shade = 70.0 + 40.0 * (dx / 50.0).sin() * (dy / 40.0).cos();
        if inside { (shade + 0.3 * speckle) as u8 } else { 0 }
    };
    (0..width * height).map(pixel).collect()
}

/// Returns the middle frames of a recording.
fn recording(file: &str) -> Option<Vec<Arc<[u8]>>> {
    let data = std::env::var_os("SONOWEAVE_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let mut replay = Replay::open(&SequenceSettings::new(data.join(file))).ok()?;
    replay.start().ok()?;
    let mut pictures = Vec::new();
    while let Ok(Next::Reading(reading)) = replay.next(NO_DEADLINE)
        && pictures.len() < 60
    {
        if let Reading::Frame(frame) = reading {
            let [width, height] = frame.size.map(|side| side as usize);
            let [columns, rows] = SIZE.map(|side| side as usize);
            let (left, top) = (width.checked_sub(columns)? / 2, height.checked_sub(rows)? / 2);
            let lines = frame.pixels.chunks(width).skip(top).take(rows);
            pictures.push(lines.flat_map(|line| line[left..left + columns].to_vec()).collect());
        }
    }
    // Black frames at the beginning are not representative.
    pictures.retain(|picture: &Arc<[u8]>| picture.iter().any(|grey| *grey > 20));
    (!pictures.is_empty()).then_some(pictures)
}

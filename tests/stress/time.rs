//! Tests of time stamps: absurd ones, and a day of them.

use std::process::Command;
use std::sync::Arc;

use serde_json::json;

use mask::Mask;
use reconstruct::{Reconstructor, Work};
use sonoweave_core::Reading;
use sonoweave_core::frames::Transform;
use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Stamp, Status};
use sonoweave_core::slice::Slice;
use sync::ingest::{Ingest, Sample};
use sync::{PairingOptions, StampedPairing};

use crate::figures::{Length, Sheet, Test};
use crate::insertion::{Probe, half_mm, noise, state};
use crate::place::Place;
use crate::sequence::Sequence;

/// Frames of a day at 30 a second.
const DAY: u32 = 24 * 3600 * 30;
/// Frames of the short length.
const MINUTES: u32 = 60_000;
/// Environment variable that marks the process that measures its own memory.
const ALONE: &str = "SONOWEAVE_STRESS_DAY_ALONE";

pub(crate) fn tests(length: Length) -> Vec<Test> {
    let long = length.of("33 min", "24 h");
    vec![
        Test::new(
            "22",
            "stamps alike, backwards, at epoch scale, negative, 10⁹ s apart, as slices: the bits of any others",
            slices,
        ),
        Test::new(
            "22",
            "the same in sequences: every frame used, the same volume; not a time: refused and counted",
            sequences,
        ),
        Test::new("38", format!("{long} of stamps at 30 Hz, from 0 and from the epoch: within 1 µs, no drift"), stamps),
        Test::new(
            "38",
            format!("{long} of frames through ingest, pairing and reconstruction: resident memory flat"),
            memory,
        ),
    ]
}

fn slices(sheet: &mut Sheet) {
    let probe = Probe::oblique([30, 24], 0.3);
    let run = |time_ns: &dyn Fn(i64) -> i64| {
        let mut r = Reconstructor::new(half_mm(), probe.mask()).unwrap();
        for i in 0..12 {
            let slice = probe.put(&noise(probe.size, i), 0.3 * f64::from(i));
            r.insert(&Slice { time_ns: time_ns(i64::from(i)), ..slice }).unwrap();
        }
        let work = Work { times_backwards: 0, times_absurd: 0, ..r.work() };
        ((state(r.volume()), work), [r.work().times_backwards, r.work().times_absurd])
    };
    let (usual, _) = run(&|i| i * 33_333_333);
    let epoch = 1_750_000_000_000_000_000;
    // Also lists how many of the twelve go backwards, and how many make an absurd step.
    type Case<'a> = (&'a str, &'a dyn Fn(i64) -> i64, [u64; 2]);
    let cases: [Case<'_>; 6] = [
        ("all alike", &|_| 5_000_000_000, [0, 0]),
        ("backwards", &|i| -i * 33_333_333, [11, 0]),
        ("at epoch scale", &|i| epoch + i * 33_333_333, [0, 0]),
        ("10⁹ s from frame to frame", &|i| i % 2 * 1_000_000_000_000_000_000, [5, 11]),
        ("the least and the largest in turn", &|i| if i % 2 == 0 { i64::MIN } else { i64::MAX }, [5, 11]),
        ("a clock set back in the middle", &|i| if i < 6 { epoch + i } else { i }, [1, 1]),
    ];
    for (name, times, expected) in cases {
        let (found, counted) = run(times);
        sheet.holds(&format!("{name}: bits and work"), found == usual);
        sheet.equal(&format!("{name}: counted as backwards, as absurd"), counted, expected);
    }
}

/// A sequence whose frames have the given times, as text.
fn timed(time: impl Fn(u32) -> String) -> Vec<u8> {
    let sequence = Sequence { size: [24, 20], frames: 8, ..Sequence::default() };
    let mut lines: Vec<String> = Vec::new();
    for line in sequence.header(None).lines() {
        let frame = line.strip_prefix("Seq_Frame").filter(|_| line.contains("_Timestamp"));
        match frame.and_then(|rest| rest[..4].parse().ok()) {
            Some(frame) => lines.push(format!("Seq_Frame{frame:04}_Timestamp = {}", time(frame))),
            None => lines.push(line.to_owned()),
        }
    }
    let mut bytes = (lines.join("\n") + "\n").into_bytes();
    bytes.extend(sequence.pixels());
    bytes
}

fn sequences(sheet: &mut Sheet) {
    let place = Place::new();
    let run = |bytes: Vec<u8>| {
        place.put("s.mha", bytes);
        let run = place.run("reconstruct s.mha --path general --clip none -o v.mha --weights w.mha --json=s.json");
        let volume = (run.code == 0).then(|| (place.volume("v.mha").values, place.volume("w.mha").values));
        (run.code, run.stderr, volume, place.json("s.json")["frames"].clone())
    };
    let (_, _, usual, _) = run(timed(|i| format!("{}", f64::from(i) / 30.0)));
    type Times = fn(u32) -> String;
    let cases: [(&str, Times); 6] = [
        ("all alike", |_| "5".into()),
        ("backwards", |i| format!("{}", 10.0 - f64::from(i) / 30.0)),
        ("at epoch scale", |i| format!("{}", 1.75e9 + f64::from(i) / 30.0)),
        ("10⁹ s from frame to frame", |i| format!("{}e9", i % 2)),
        ("negative", |i| format!("{}", -1e6 - f64::from(i))),
        ("a clock set back in the middle", |i| format!("{}", if i < 4 { 1_750_000_000 + i } else { i })),
    ];
    for (name, time) in cases {
        let (code, words, volume, frames) = run(timed(time));
        sheet.equal(&format!("{name}: exit code and words"), (code, words.as_str()), (0, ""));
        sheet.equal(&format!("{name}: frames used"), (&frames["used"], &frames["total"]), (&json!(8), &json!(8)));
        sheet.holds(&format!("{name}: the volume's bits"), volume == usual);
    }
    // Two of eight frames have a time that does not fit 64 bits of nanoseconds.
    let (code, words, _, frames) = run(timed(|i| if i % 4 == 1 { "1e300".into() } else { format!("{i}") }));
    sheet.equal("1e300 s: exit code", code, 0);
    sheet.equal("1e300 s: refused", &frames["refused"], &json!({ "time_invalid": 2 }));
    sheet.equal("1e300 s: used", &frames["used"], &json!(6));
    sheet.holds("1e300 s: said", words.contains("time_invalid"));
}

fn frame(item: u64, seconds: f64, pixels: &Arc<[u8]>) -> Frame {
    Frame {
        stamp: Stamp { item, source_s: Some(seconds), ..Stamp::default() },
        frame_number: None,
        status: Status::Ok,
        size: [4, 4],
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MF".into(),
        image_type: "BRIGHTNESS".into(),
        pixels: Arc::clone(pixels),
        fields: Vec::new(),
    }
}

fn stamps(sheet: &mut Sheet) {
    let frames = sheet.length.of(MINUTES, DAY);
    let pixels: Arc<[u8]> = Arc::from([7_u8; 16]);
    for (name, begin_s) in [("from 0", 0_i64), ("from the epoch", 1_750_000_000)] {
        let mut ingest = Ingest::new();
        let (mut worst, mut last, mut least_step) = (0.0_f64, 0.0, i64::MAX);
        let mut before = None;
        for i in 0..frames {
            let head = ingest.head(&frame(u64::from(i), begin_s as f64 + f64::from(i) / 30.0, &pixels)).unwrap();
            // In thirtieths of a nanosecond, which are integers.
            let exact = i128::from(begin_s) * 30_000_000_000 + i128::from(i) * 1_000_000_000;
            let error = (i128::from(head.time_ns) * 30 - exact) as f64 / 30.0;
            worst = worst.max(error.abs());
            last = error;
            least_step = least_step.min(before.map_or(i64::MAX, |b| head.time_ns - b));
            before = Some(head.time_ns);
        }
        sheet.at_most(&format!("{name}: largest error of a stamp, µs"), worst * 1e-3, 1.0);
        sheet.at_most(&format!("{name}: error of the last stamp, µs"), last.abs() * 1e-3, 1.0);
        sheet.near(&format!("{name}: least time from frame to frame, ms"), least_step as f64 * 1e-6, 1e3 / 30.0, 1e-3);
    }
}

/// Resident anonymous memory of this process, bytes; 0 if the system does not report it. It is
/// counted page by page. The totals in `status` and `statm` are kept per CPU, and differ from it by
/// hundreds of KiB; and pages of the program, which come in as its code first runs, are no growth.
fn resident() -> u64 {
    let rollup = std::fs::read_to_string("/proc/self/smaps_rollup").unwrap_or_default();
    let line = rollup.lines().find_map(|line| line.strip_prefix("Anonymous:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) * 1024
}

/// Whether this process was started to measure itself.
pub(crate) fn is_day_alone() -> bool {
    std::env::var_os(ALONE).is_some()
}

/// Runs a day of frames through the stages, in a separate process; prints the frames used, and
/// the memory early and at the end.
pub(crate) fn day_alone() {
    let frames: u32 = std::env::var(ALONE).unwrap().parse().unwrap();
    let (mut ingest, mut pairing) = (Ingest::new(), StampedPairing::new(PairingOptions::default()));
    let mut r = Reconstructor::new(half_mm(), Mask::full(4, 4)).unwrap();
    let pictures: [Arc<[u8]>; 2] = [Arc::from([7_u8; 16]), Arc::from([90_u8; 16])];
    let probe = Probe::oblique([4, 4], 0.5);
    let mut early = 0;
    let mut used = 0;
    for i in 0..frames {
        // Back and forth over the same two centimetres.
        let along = (f64::from(i) * 1e-3).sin() * 10.0;
        let reading = frame(u64::from(i), 1.75e9 + f64::from(i) / 30.0, &pictures[i as usize % 2]);
        pairing.transform(NamedTransform {
            stamp: reading.stamp,
            from: "Image".into(),
            to: "Reference".into(),
            matrix: Transform::<sonoweave_core::frames::World, sonoweave_core::frames::Image>::from_affine(
                probe.pose(along),
            )
            .to_rows(),
            status: Status::Ok,
        });
        let Sample::Picture(picture) = ingest.take(Reading::Frame(reading)) else { panic!("a picture") };
        let slice = pairing.frame(picture).unwrap().slice;
        r.insert(&slice).unwrap();
        used += 1;
        if i == frames / 4 {
            early = resident();
        }
    }
    println!("{used} {early} {}", resident());
}

fn memory(sheet: &mut Sheet) {
    let frames = sheet.length.of(MINUTES, DAY);
    let output = Command::new(std::env::current_exe().unwrap()).env(ALONE, frames.to_string()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let numbers: Vec<u64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
    let [used, early, end] = numbers[..] else { panic!("{text} {}", String::from_utf8_lossy(&output.stderr)) };
    sheet.equal("frames used", used, u64::from(frames));
    if early == 0 {
        return sheet.record("resident memory", "this system does not say");
    }
    sheet.record("resident memory after a quarter, MiB", early >> 20);
    sheet.at_most("growth over the other three quarters, KiB", end.saturating_sub(early) as f64 / 1024.0, 128.0);
}

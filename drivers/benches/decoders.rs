//! Measures decoder speed: `make bench`, or
//! `cargo bench -p sonoweave-drivers --bench decoders -- [--quick] [--only NAME]`.
//!
//! The streams hold records with values that vary like a moving probe's. They arrive in pieces
//! of large and small reads, on one core. Before timing a stream, the bench encodes the decoded
//! records again and compares the bytes. While timing, it counts every record. A wrong result
//! fails the run; a missed goal is only printed, because machines differ.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a bench speaks to its user")]

use std::f64::consts::TAU;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use drivers::arm::{ea1, microscribe, qsb};
use drivers::framing::{Decoder, Format};
use drivers::tracker::polhemus::{fastrak, isotrak, liberty, viper};

/// Goal for every decoder, bytes per second.
const GOAL: f64 = 500e6;
/// Length of a stream, bytes.
const STREAM: usize = 4 << 20;
/// Lengths of the pieces, bytes: of a large read, and of a serial port's.
const PIECES: [usize; 2] = [4096, 61];

struct Bench {
    rounds: usize,
    only: Option<String>,
    wrong: bool,
}

impl Bench {
    /// Times a format over a stream of records. `write` appends the record of each number;
    /// `again` encodes a decoded record.
    fn time<F: Format + Clone>(
        &mut self,
        name: &str,
        format: &F,
        mut write: impl FnMut(u32, &mut Vec<u8>),
        mut again: impl FnMut(F::Record<'_>, &mut Vec<u8>),
    ) {
        if self.only.as_ref().is_some_and(|only| !name.contains(only)) {
            return;
        }
        let mut stream = Vec::with_capacity(STREAM + 1024);
        let mut encoded = 0;
        while stream.len() < STREAM {
            write(encoded, &mut stream);
            encoded += 1;
        }
        let mut rewritten = Vec::with_capacity(stream.len());
        Decoder::new(format.clone()).feed(&stream, &mut |record, _| again(record, &mut rewritten));
        if rewritten != stream {
            println!("{name:<28} WRONG: what was read is not what was written");
            self.wrong = true;
            return;
        }
        for piece in PIECES {
            let mut speeds: Vec<f64> = Vec::with_capacity(self.rounds);
            for _ in 0..self.rounds {
                let mut decoder = Decoder::new(format.clone());
                let mut decoded = 0;
                let began = Instant::now();
                for bytes in stream.chunks(piece) {
                    decoder.feed(bytes, &mut |record, range| {
                        black_box((&record, range));
                        decoded += 1;
                    });
                }
                speeds.push(stream.len() as f64 / began.elapsed().as_secs_f64());
                if decoded != encoded || decoder.losses().bytes_skipped != 0 {
                    println!("{name:<28} WRONG: {decoded} of {encoded} records");
                    self.wrong = true;
                    return;
                }
            }
            speeds.sort_by(f64::total_cmp);
            let at = |quantile: f64| speeds[((speeds.len() - 1) as f64 * quantile).round() as usize];
            let length = stream.len() / encoded as usize;
            let goal = match at(0.5) >= GOAL {
                true => "",
                false if piece == PIECES[0] => "  below the goal of 500 MB/s",
                false => "  (below 500 MB/s)",
            };
            println!(
                "{name:<28} {piece:>5} {length:>6} {encoded:>8} {:>8.0} {:>8.0} {:>8.0} {:>8.1}{goal}",
                at(0.5) / 1e6,
                at(0.1) / 1e6,
                at(0.9) / 1e6,
                length as f64 / at(0.5) * 1e9,
            );
        }
    }
}

/// Returns a pose on a path with a long period: position in cm, unit quaternion.
fn pose(number: u32) -> ([f64; 3], [f64; 4]) {
    let phase = f64::from(number) / 997.0;
    let (sin, cos) = (phase * TAU / 13.0).sin_cos();
    let half = 0.5 * (phase * 0.7).sin();
    let axis = [0.48, 0.6, 0.64];
    (
        [30.0 * cos, 22.5 * sin, -14.0 + 9.0 * (3.0 * phase).sin()],
        [half.cos(), half.sin() * axis[0], half.sin() * axis[1], half.sin() * axis[2]],
    )
}

fn counts(number: u32) -> [i32; 3] {
    pose(number).0.map(|cm| (cm * 1500.0) as i32)
}

fn singles<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

fn fastrak_of(bench: &mut Bench, name: &str, mode: fastrak::Mode, codes: &[u8]) {
    let layout = match fastrak::Layout::new(mode, codes) {
        Ok(layout) => layout,
        Err(error) => return println!("{name}: {error}"),
    };
    let written = |number: u32, to: &mut Vec<u8>| {
        let (position, quaternion) = pose(number);
        let euler = position.map(|value| value * 2.0);
        let station = number as u8 % 2 + 1;
        let pose = fastrak::Pose {
            position: Some(position),
            euler_deg: Some(euler),
            quaternion_wxyz: Some(quaternion),
            ..fastrak::Pose::empty(station, b' ')
        };
        pose.write(&layout, to);
    };
    bench.time(name, &fastrak::Fastrak::uniform(2, layout), written, |record, to| {
        if let fastrak::Record::Pose(pose) = record {
            pose.write(&layout, to);
        }
    });
}

fn trackers(bench: &mut Bench) {
    fastrak_of(bench, "FASTRAK text 2,11,1", fastrak::Mode::Ascii, &[2, 11, 1]);
    fastrak_of(bench, "FASTRAK text 2,4,1", fastrak::Mode::Ascii, &[2, 4, 1]);
    fastrak_of(bench, "FASTRAK binary 2,11,0", fastrak::Mode::Binary, &[2, 11, 0]);
    if let Ok(layout) = isotrak::Layout::new(&[2, 11]) {
        let write = |number: u32, to: &mut Vec<u8>| {
            let (position, quaternion) = pose(number);
            let pose = isotrak::Pose {
                position_counts: Some(position.map(|cm| (cm / isotrak::CM_PER_COUNT) as i16)),
                quaternion_wxyz_counts: Some(quaternion.map(|value| (value / isotrak::UNIT_PER_COUNT) as i16)),
                ..isotrak::Pose::empty(1, b' ')
            };
            pose.write(&layout, to);
        };
        bench.time("ISOTRAK binary 2,11", &isotrak::Isotrak::new(1, layout), write, |record, to| {
            if let isotrak::Record::Pose(pose) = record {
                pose.write(&layout, to);
            }
        });
    }
    if let Ok(layout) = liberty::Layout::new(&[8, 9, 2, 7]) {
        let write = |number: u32, to: &mut Vec<u8>| {
            let (position, quaternion) = pose(number);
            let header =
                liberty::Header { tag: liberty::Tag::Liberty, station: number as u8 % 4 + 1, command: b'C', error: 0 };
            let pose = liberty::Pose {
                timestamp_ms: Some(number * 4),
                frame_count: Some(number),
                position: Some(singles(position)),
                quaternion_wxyz: Some(singles(quaternion)),
                ..liberty::Pose::empty(header)
            };
            pose.write(&layout, to);
        };
        bench.time("LIBERTY binary 8,9,2,7", &liberty::Liberty::new(4, layout), write, |record, to| {
            if let liberty::Record::Pose(pose) = record {
                pose.write(&layout, to);
            }
        });
    }
    for sensors in [1, 4] {
        let write = |number: u32, to: &mut Vec<u8>| {
            let measured: Vec<viper::Sensor> = (0..sensors)
                .map(|sensor| {
                    let (position, quaternion) = pose(number + 100 * u32::from(sensor));
                    viper::Sensor {
                        sensor,
                        is_virtual: false,
                        position_unit: viper::PositionUnit::Centimetres,
                        orientation_unit: viper::OrientationUnit::Quaternion,
                        buttons: 0,
                        distortion: 0,
                        auxiliary: 0,
                        position: singles(position),
                        orientation: singles(quaternion),
                        acceleration: None,
                    }
                })
                .collect();
            let frame = viper::write::FrameToWrite {
                unit: 1,
                frame_count: number,
                accelerations: false,
                test: 0,
                sensors: &measured,
            };
            frame.write(to);
        };
        let name = format!("VIPER, {sensors} sensor{}", if sensors == 1 { "" } else { "s" });
        bench.time(&name, &viper::Viper::new(16), write, |record, to| {
            if let viper::Record::Frame(frame) = record {
                frame.write(to);
            }
        });
    }
}

fn arms(bench: &mut Bench) {
    for (name, framing) in [("EA1 lines", ea1::Framing::Lines), ("EA1 blocks", ea1::Framing::Blocks)] {
        let write = |number: u32, to: &mut Vec<u8>| {
            let sample = ea1::Sample {
                seq: number,
                t_us: number.wrapping_mul(2000),
                counts: counts(number),
                flags: 7,
                buttons: 0,
                framing,
            };
            ea1::Record::Sample(sample).write(to);
        };
        bench.time(name, &ea1::Ea1::new(), write, |record, to| record.write(to));
    }
    let write = |number: u32, to: &mut Vec<u8>| {
        let value = counts(number)[0].cast_unsigned();
        let value =
            qsb::Value { cause: qsb::Cause::Streamed, register: qsb::register::COUNT, value, ticks: Some(number) };
        qsb::Record::Value(value).write(to);
    };
    bench.time("QSB", &qsb::Qsb, write, |record, to| record.write(to));
    if let Some(request) = microscribe::Request::new(microscribe::Family::MicroScribe, 6, false) {
        let write = |number: u32, to: &mut Vec<u8>| {
            let [a, b, c] = counts(number).map(|count| (count & 0x3fff) as u16);
            microscribe::Sample::new(0, None, &[a, b, c, b, a, c]).write(request, to);
        };
        let format = microscribe::Samples::new(request);
        bench.time("MicroScribe, 6 encoders", &format, write, |record, to| record.write(request, to));
    }
}

fn main() -> ExitCode {
    let mut bench = Bench { rounds: 41, only: None, wrong: false };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--only" => bench.only = arguments.next(),
            "--quick" => bench.rounds = 3,
            // Cargo passes this to every bench.
            "--bench" => {}
            other => {
                eprintln!("unknown argument {other}; this bench takes --quick and --only NAME");
                return ExitCode::from(2);
            }
        }
    }
    println!("{} rounds over {} MiB each; MB/s on one core, ns a record", bench.rounds, STREAM >> 20);
    println!(
        "{:<28} {:>5} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "format", "piece", "bytes", "records", "median", "10 %", "90 %", "ns"
    );
    trackers(&mut bench);
    arms(&mut bench);
    if bench.wrong { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

//! Compiles and runs the C reference of `docs/ea1.md`, meant for builders of an arm, and
//! decodes its output.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use drivers::arm::ea1::{Ea1, Framing, Identity, Record, Sample, command, error, flag};
use drivers::framing::Decoder;

/// Compiles the reference with all warnings as errors, feeds it lines, and returns its output.
fn run(script: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/ea1");
    let built = tempfile::tempdir().unwrap();
    let program = built.path().join("ea1");
    let compiled = Command::new("cc")
        .args(["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-o"])
        .arg(&program)
        .args([folder.join("ea1.c"), folder.join("host.c")])
        .output()
        .expect("cc, which cargo links with, is there");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let mut arm = Command::new(&program).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let mut stdin = arm.stdin.take().unwrap();
    let script = script.to_owned();
    // Writes on a thread while reading: a full pipe would otherwise block both.
    let writer = std::thread::spawn(move || stdin.write_all(script.as_bytes()));
    let output = arm.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    assert!(output.status.success());
    output.stdout
}

fn text(command: command::Command) -> String {
    String::from_utf8(command.bytes()).unwrap()
}

fn tick(sample: &Sample, faults: u16) -> String {
    let Sample { t_us, counts: [a, b, c], buttons, .. } = sample;
    format!("tick {t_us} {a} {b} {c} {faults} {buttons}\n")
}

#[test]
fn reference_samples_decode_exactly() {
    let extremes = [0, 1, -1, 9, 10, -300, 99_999_999, 100_000_000, i32::MAX, i32::MIN];
    let identity = Identity {
        model: "Bench arm",
        serial: "7",
        counts_per_revolution: [40_000, 20_000, 0],
        tick_hz: 1_000_000,
        rate_hz: 0,
    };
    let mut script = String::new();
    let mut expected = vec![Record::Identity(identity)];
    let mut seq = 0;
    for framing in [Framing::Lines, Framing::Blocks] {
        script += &text(command::Command::Stream(framing, 200));
        for (index, &a) in extremes.iter().enumerate() {
            for &b in &extremes {
                seq += 1;
                // Crosses the wrap of 32 bits.
                let t_us = 0xFFFF_0000_u32.wrapping_add(seq * 997);
                // A line only states whether a button is pressed.
                let buttons = if framing == Framing::Lines { seq as u8 & 1 } else { seq as u8 };
                let flags = if buttons != 0 { flag::BUTTON } else { 0 };
                let sample = Sample { seq, t_us, counts: [a, b, extremes[(index + 3) % 10]], flags, buttons, framing };
                script += &tick(&sample, 0);
                script += "idle\n";
                expected.push(Record::Sample(sample));
            }
        }
    }
    let sent = run(&script);
    let mut read = 0;
    let mut decoder = Decoder::new(Ea1::new());
    decoder.feed(&sent, &mut |record, _| {
        assert_eq!(record, expected[read], "record {read}");
        read += 1;
    });
    assert_eq!((read, decoder.losses().bytes_skipped, decoder.pending()), (201, 0, 0));
    let mut ours = Vec::new();
    expected.iter().for_each(|record| record.write(&mut ours));
    assert_eq!(sent, ours, "our virtual arm and the reference send the same bytes");
}

#[test]
fn flags_errors_and_pings_match_document() {
    let at = |t_us, counts| Sample { seq: 0, t_us, counts, flags: 0, buttons: 0, framing: Framing::Lines };
    let script = [
        text(command::Command::Stream(Framing::Lines, 100)),
        // A joint loses steps, and the main loop is too late for one sample.
        tick(&at(1, [1, 2, 3]), 2) + &tick(&at(2, [1, 2, 3]), 0) + "idle\nidle\n",
        tick(&at(3, [1, 2, 3]), 0) + "idle\n",
        // Homing clears the fault, drops the latched samples, and zeroes the counts.
        tick(&at(4, [5, 6, 7]), 0) + &text(command::Command::Zero(3)) + "idle\n" + &text(command::Command::Poll),
        text(command::Command::Time(77)),
        text(command::Command::Stream(Framing::Lines, 257)) + &text(command::Command::Stream(Framing::Blocks, 397)),
        text(command::Command::Stream(Framing::Blocks, 398)),
        "!X\n\n!Z8\n!R\n!T4294967296\n!P1\nI\n!R0000000000000001\n!I\r\n".to_owned(),
    ]
    .concat();
    let mut seen = Vec::new();
    let mut decoder = Decoder::new(Ea1::new());
    decoder.feed(&run(&script), &mut |record, _| {
        seen.push(match record {
            Record::Sample(Sample { seq, t_us, counts, flags, .. }) => format!("{seq} {t_us} {counts:?} {flags:02x}"),
            Record::Identity(identity) => format!("identity, {} a second", identity.rate_hz),
            Record::Time { token, t_us } => format!("time {token} {t_us}"),
            Record::Error(code) => format!("error {code}"),
            Record::Unreliable(_) => "bare numbers".to_owned(),
        });
    });
    let fault = flag::FAULT[1];
    let homed = flag::HOMED[0] | flag::HOMED[1];
    let expected = [
        "identity, 0 a second".to_owned(),
        format!("1 1 [1, 2, 3] {:02x}", fault | flag::OVERRUN),
        format!("3 3 [1, 2, 3] {fault:02x}"),
        format!("5 4 [0, 0, 7] {homed:02x}"),
        "time 77 4".to_owned(),
        format!("error {}", error::TOO_FAST),
        format!("error {}", error::TOO_FAST),
    ];
    assert_eq!(seen[..7], expected);
    let errors = [1, 1, 2, 2, 2, 1, 1, 1].map(|code| format!("error {code}"));
    assert_eq!(seen[7..15], errors);
    assert_eq!(seen[15..], ["identity, 397 a second"]);
    assert_eq!(decoder.losses().bytes_skipped, 0);
}

#[test]
fn document_examples_decode() {
    let document = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/ea1.md")).unwrap();
    let mut lines = 0;
    for line in document.lines().filter_map(|line| line.strip_prefix("<  ")) {
        let mut read = 0;
        Decoder::new(Ea1::new()).feed(format!("{line}\r\n").as_bytes(), &mut |_, _| read += 1);
        assert_eq!(read, 1, "{line}");
        lines += 1;
    }
    let bytes = |name| -> Vec<u8> {
        let line = document.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim_start().split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    };
    let block = bytes("wire ");
    assert_eq!(cobs::encode_vec(&bytes("plain ")), block[..28]);
    let mut samples = Vec::new();
    Decoder::new(Ea1::new()).feed(&block, &mut |record, _| samples.push(format!("{record:?}")));
    let sample = Sample {
        seq: 42,
        t_us: 1_000_000,
        counts: [1024, -300, 65536],
        flags: flag::HOMED[0],
        buttons: 0,
        framing: Framing::Blocks,
    };
    assert_eq!((lines, samples), (3, vec![format!("{:?}", Record::Sample(sample))]));
}

//! EA1: lines and blocks on one port, identity, time, errors, commands, and bare numbers on
//! request.

use crc::{CRC_16_IBM_3740, Crc};
use proptest::prelude::*;

use drivers::arm::ea1::command::Command;
use drivers::arm::ea1::{Ea1, Framing, Identity, LONGEST_SAMPLE, Record, Sample, error, flag};
use drivers::framing::{Decoder, Format, Parsed, Refusal};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

const LINE: &[u8] = b"$EA,42,1000000,1024,-300,65536,07*1E\r\n";
const BLOCK: [u8; 29] = [
    0x04, 0x01, 0x03, 0x01, 0x02, 0x2A, 0x01, 0x01, 0x04, 0x40, 0x42, 0x0F, 0x01, 0x02, 0x04, 0x01, 0x05, 0xD4, 0xFE,
    0xFF, 0xFF, 0x01, 0x02, 0x01, 0x01, 0x03, 0x20, 0x5A, 0x00,
];

fn sample() -> Sample {
    Sample { seq: 42, t_us: 1_000_000, counts: [1024, -300, 65536], flags: 7, buttons: 0, framing: Framing::Lines }
}

fn written(record: &Record<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    record.write(&mut bytes);
    bytes
}

#[test]
fn lines_and_blocks_match_document() {
    let block = Sample { flags: flag::HOMED[0], framing: Framing::Blocks, ..sample() };
    for (sample, bytes) in [(sample(), LINE), (block, &BLOCK)] {
        let record = Record::Sample(sample);
        assert_eq!(Ea1::new().parse(bytes), Parsed::Record { length: bytes.len(), record });
        assert_eq!(written(&record), bytes);
    }
    assert_eq!(flag::KNOWN, flag::HOMED.iter().chain(&flag::FAULT).sum::<u16>() + flag::BUTTON + flag::OVERRUN);
}

#[test]
fn framings_and_answers_share_port() {
    let identity = Identity {
        model: "Bench arm",
        serial: "7",
        counts_per_revolution: [40_000, 20_000, 0],
        tick_hz: 1_000_000,
        rate_hz: 250,
    };
    let answers =
        [Record::Identity(identity), Record::Time { token: 9, t_us: u32::MAX }, Record::Error(error::TOO_FAST)];
    assert_eq!(written(&answers[0]), b"$EI,1,Bench arm,7,3,40000,20000,0,1000000,250*39\r\n");
    let stream =
        [LINE, &BLOCK, &written(&answers[0]), &BLOCK, &written(&answers[1]), LINE, &written(&answers[2])].concat();
    let (found, losses) = decode_any_cut(&Ea1::new(), &stream, &[10]);
    let expected = [&answers[0], &answers[1], &answers[2]].map(|answer| format!("{answer:?}"));
    assert_eq!(losses.bytes_skipped, 0);
    assert_eq!([&found[2].0, &found[4].0, &found[6].0], [&expected[0], &expected[1], &expected[2]]);
}

#[test]
fn longest_sample_has_stated_length() {
    let sample = Sample { seq: u32::MAX, t_us: u32::MAX, counts: [i32::MIN; 3], flags: 0xff, ..sample() };
    let line = written(&Record::Sample(sample));
    // Two more digits of flags than are written would be accepted.
    assert_eq!(line.len() + 2, LONGEST_SAMPLE);
    let buttons = Sample { buttons: 1, ..sample };
    assert_eq!(Ea1::new().parse(&line), Parsed::Record { length: line.len(), record: Record::Sample(buttons) });
}

#[test]
fn damage_is_counted_by_reason() {
    for (line, why) in [
        (&b"$EA,42,1000000,1024,-300,65536,07*1F\r\n"[..], Refusal::Checksum),
        (b"$EA,42,1000000,1024,-300,65537,07*1E\r\n", Refusal::Checksum),
        (b"$EA,42,1000000,1024,-300,65536,07*1E\n\n", Refusal::Length),
        (b"$EA,42,1000000,10", Refusal::Length),
    ] {
        let (found, losses) = decode_any_cut(&Ea1::new(), &[LINE, line, LINE].concat(), &[3]);
        assert_eq!((found.len(), losses.bytes_skipped, losses.refused(why)), (2, line.len() as u64, 1), "{why:?}");
    }
    let checked = |text: &str| {
        let sum = text.bytes().fold(0, |sum, byte| sum ^ byte);
        format!("${text}*{sum:02X}\r\n").into_bytes()
    };
    for (text, why) in [
        ("EA,42,1000000,1024,-300,65536", Refusal::Field),
        ("EA,42,1000000,1024,-300,65536,07,1", Refusal::Field),
        ("EA,42,1000000,1024,-300,2147483648,07", Refusal::Field),
        ("EA,4294967296,1000000,1024,-300,0,07", Refusal::Field),
        ("EA,42,1000000,1024,,0,07", Refusal::Field),
        ("EA,42,1000000,1024,-300,65536,100", Refusal::Range),
        ("EI,2,a,b,3,1,2,3,4,5", Refusal::Header),
        ("EI,1,a,b,6,1,2,3,4,5", Refusal::Header),
        ("GPGGA,1", Refusal::Header),
    ] {
        let (found, losses) = decode_any_cut(&Ea1::new(), &[LINE, &checked(text), LINE].concat(), &[3]);
        assert_eq!(found.len(), 2);
        assert!(losses.refused(why) >= 1, "{text}: {why:?}");
    }
    let lower = b"$EA,42,1000000,1024,-300,65536,07*1e\r\n";
    assert_eq!(decode_any_cut(&Ea1::new(), lower, &[5]).0.len(), 1, "a checksum of either case");
    for (at, byte, why) in [
        (5, 0x2B, Refusal::Checksum),
        (28, 0x01, Refusal::Length),
        (12, 0x05, Refusal::Length),
        (2, 4, Refusal::Header),
    ] {
        let mut hurt = BLOCK;
        hurt[at] = byte;
        let (found, losses) = decode_any_cut(&Ea1::new(), &[&BLOCK[..], &hurt, &BLOCK].concat(), &[3]);
        assert_eq!((found.len(), losses.bytes_skipped), (2, 29), "byte {at} = {byte}");
        assert!(losses.refused(why) >= 1, "byte {at} = {byte}: {why:?}");
    }
}

#[test]
fn zero_within_cobs_block_is_refused() {
    // The same 27 bytes as a single run, zeros included, between a valid code byte, checksum
    // and end.
    let mut plain = [0; 27];
    assert_eq!(cobs::decode(&BLOCK[..28], &mut plain).unwrap().frame_size(), 27);
    let raw = [&[28], &plain[..], &[0]].concat();
    let (found, losses) = decode_any_cut(&Ea1::new(), &[&BLOCK[..], &raw, &BLOCK].concat(), &[3]);
    assert_eq!((found.len(), losses.bytes_skipped, losses.refused(Refusal::Field)), (2, 29, 1));
}

#[test]
fn bare_numbers_are_read_only_on_request_as_whole_lines() {
    let stream = b"7,2,3\n1,-2,3\r\nx1,2,3\n4,5\n1,2,3,4\n2147483648,0,0\n-2147483648,0,1\n";
    assert_eq!(decode_any_cut(&Ea1::new(), stream, &[2]).0, []);
    let (found, _) = decode_any_cut(&Ea1::or_bare_numbers(), stream, &[2]);
    let expected = [[7, 2, 3], [1, -2, 3], [i32::MIN, 0, 1]].map(|counts| format!("{:?}", Record::Unreliable(counts)));
    assert_eq!(found.into_iter().map(|(record, _)| record).collect::<Vec<_>>(), expected);
    let mut decoder = Decoder::new(Ea1::or_bare_numbers());
    let mut found = 0;
    decoder.interrupt();
    decoder.feed(b"4,5,6\n1,2,3\n", &mut |_, range| {
        found += 1;
        assert_eq!(range, 6..12, "after a break the first line may have lost its beginning");
    });
    assert_eq!(found, 1);
}

#[test]
fn commands_match_bytes() {
    for (command, bytes) in [
        (Command::Identify, &b"!I\n"[..]),
        (Command::Stream(Framing::Lines, 100), b"!R100\n"),
        (Command::Stream(Framing::Blocks, 500), b"!B500\n"),
        (Command::Stream(Framing::Lines, 0), b"!R0\n"),
        (Command::Poll, b"!P\n"),
        (Command::Zero(5), b"!Z5\n"),
        (Command::Time(4_000_000_000), b"!T4000000000\n"),
    ] {
        assert_eq!(command.bytes(), bytes);
        assert_eq!(Command::read(bytes), Some((Ok(command), bytes.len())));
    }
    assert_eq!(Command::read(b"!R100"), None, "the line is not ended");
    for (bytes, code) in [
        (&b"!X\n"[..], error::UNKNOWN_COMMAND),
        (b"\n", error::UNKNOWN_COMMAND),
        (b"!R\n", error::BAD_PARAMETER),
        (b"!Z8\n", error::BAD_PARAMETER),
        (b"!T+1\n", error::BAD_PARAMETER),
    ] {
        assert_eq!(Command::read(bytes), Some((Err(code), bytes.len())));
    }
}

fn samples() -> impl Strategy<Value = Vec<Sample>> {
    let count = prop_oneof![any::<i32>(), -300..300_i32, Just(0)];
    let sample = (
        any::<u32>(),
        prop_oneof![any::<u32>(), 0..1000_u32],
        [count.clone(), count.clone(), count],
        0_u16..256,
        any::<u8>(),
        any::<bool>(),
    )
        .prop_map(|(seq, t_us, counts, flags, buttons, block)| match block {
            true => Sample { seq, t_us, counts, flags, buttons, framing: Framing::Blocks },
            false => {
                let buttons = u8::from(flags & flag::BUTTON != 0);
                Sample { seq, t_us, counts, flags, buttons, framing: Framing::Lines }
            }
        });
    prop::collection::vec(sample, 1..12)
}

proptest! {
    #[test]
    fn samples_roundtrip(samples in samples(), pieces in pieces()) {
        let stream: Vec<u8> = samples.iter().flat_map(|&sample| written(&Record::Sample(sample))).collect();
        for format in [Ea1::new(), Ea1::or_bare_numbers()] {
            let (found, losses) = decode_any_cut(&format, &stream, &pieces);
            let expected: Vec<_> = samples.iter().map(|&sample| format!("{:?}", Record::Sample(sample))).collect();
            prop_assert_eq!(found.into_iter().map(|(record, _)| record).collect::<Vec<_>>(), expected);
            prop_assert_eq!(losses.bytes_skipped, 0);
        }
    }

    #[test]
    fn blocks_match_other_cobs_and_crc(sample in samples()) {
        for sample in sample {
            let block = written(&Record::Sample(Sample { framing: Framing::Blocks, ..sample }));
            let mut plain = [0; 32];
            prop_assert_eq!(cobs::decode(&block[..28], &mut plain).unwrap().frame_size(), 27);
            let sum = Crc::<u16>::new(&CRC_16_IBM_3740).checksum(&plain[..25]);
            prop_assert_eq!(sum.to_le_bytes(), [plain[25], plain[26]]);
            prop_assert_eq!(cobs::encode_vec(&plain[..27]), &block[..28]);
        }
    }

    #[test]
    fn samples_are_found_after_garbage(
        (good, garbage) in samples().prop_flat_map(|samples| {
            let good: Vec<Vec<u8>> = samples.iter().map(|&sample| written(&Record::Sample(sample))).collect();
            (Just(good.clone()), garbage(good))
        }),
        pieces in pieces(),
    ) {
        locks(&Ea1::new(), &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"$EA,*-07\r\n\x00\x01\x03\x04".to_vec())], 0..2000), pieces in pieces()) {
        decode_any_cut(&Ea1::new(), &bytes, &pieces);
        decode_any_cut(&Ea1::or_bare_numbers(), &bytes, &pieces);
    }

    #[test]
    fn plausible_text_never_panics(text in "([$]E[AITE],[0-9,-]{0,40}([*][0-9A-F]{2})?(\r\n)?|[0-9,-]{0,30}\n){0,20}", pieces in pieces()) {
        decode_any_cut(&Ea1::new(), text.as_bytes(), &pieces);
        decode_any_cut(&Ea1::or_bare_numbers(), text.as_bytes(), &pieces);
    }
}

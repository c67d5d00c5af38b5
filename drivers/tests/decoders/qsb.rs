//! US Digital QSB: lines with and without time and blanks, errors, the banner after a reset.

use proptest::prelude::*;

use drivers::arm::qsb::{Cause, Command, Qsb, Record, Value, register};
use drivers::framing::{Format, Parsed, Refusal};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

const LINE: &[u8] = b"s 0E FFFFFED4 00001234 !\r\n";

fn value() -> Value {
    Value { cause: Cause::Streamed, register: register::COUNT, value: 0xFFFF_FED4, ticks: Some(0x1234) }
}

fn written(record: &Record<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    record.write(&mut bytes);
    bytes
}

#[test]
fn lines_match_manual() {
    assert_eq!(Qsb.parse(LINE), Parsed::Record { length: 26, record: Record::Value(value()) });
    assert_eq!(written(&Record::Value(value())), LINE);
    assert_eq!(value().value.cast_signed(), -300);
}

#[test]
fn every_reply_format_is_read() {
    let bare = Value { ticks: None, ..value() };
    for (line, expected) in [
        (&b"s0EFFFFFED4!"[..], bare),
        (b"s0EFFFFFED4!\n", bare),
        (b"s0EFFFFFED4!\r", bare),
        (b"s0EFFFFFED4!\r\n", bare),
        (b"s 0E FFFFFED4 !\r\n", bare),
        (b"s0Efffffed400001234!\r\n", value()),
        (b"r 14 0000AB12 !\r\n", Value { cause: Cause::Read, register: register::VERSION, value: 0xAB12, ticks: None }),
        (b"w150000000F00000001!\n", Value { cause: Cause::Written, register: 0x15, value: 15, ticks: Some(1) }),
    ] {
        let (found, losses) = decode_any_cut(&Qsb, &[line, LINE].concat(), &[4]);
        assert_eq!(found[0].0, format!("{:?}", Record::Value(expected)), "{}", String::from_utf8_lossy(line));
        assert_eq!((found.len(), losses.bytes_skipped), (2, 0));
    }
}

#[test]
fn errors_and_resets_are_reported() {
    let (found, losses) = decode_any_cut(&Qsb, b"e05!\r\nQSB-D  0E!\r\ns 0E FFFFFED4 00001234 !\r\n", &[6]);
    let expected = [Record::Error(b"05"), Record::Banner, Record::Value(value())].map(|record| format!("{record:?}"));
    assert_eq!(found.into_iter().map(|(record, _)| record).collect::<Vec<_>>(), expected);
    assert_eq!(losses.bytes_skipped, 0);
}

#[test]
fn damage_is_counted_by_reason() {
    for (line, why) in [
        (&b"s 0E FFFFFED 00001234 !\r\n"[..], Refusal::Field),
        (b"s 0E FFFF", Refusal::Length),
        (b"s 0E FFFGFED4 00001234 !\r\n", Refusal::Length),
        (b"QXB-D", Refusal::Header),
    ] {
        let (found, losses) = decode_any_cut(&Qsb, &[LINE, line, LINE].concat(), &[3]);
        assert_eq!((found.len(), losses.bytes_skipped, losses.refused(why)), (2, line.len() as u64, 1), "{why:?}");
    }
}

#[test]
fn commands_match_bytes() {
    for (command, bytes) in [
        (Command::FORMAT, &b"W15F\n"[..]),
        (Command::Write(register::MODE, 0), b"W000\n"),
        (Command::Write(register::RESET_TIME, 1), b"W0D1\n"),
        (Command::Write(register::STREAM_INTERVAL, 0x1ff), b"W0C1FF\n"),
        (Command::Read(register::COUNT), b"R0E\n"),
        (Command::Read(register::VERSION), b"R14\n"),
        (Command::Stream(register::COUNT), b"S0E\n"),
    ] {
        assert_eq!(command.bytes(), bytes);
        assert_eq!(Command::read(bytes), Some((Some(command), bytes.len())));
    }
    assert_eq!(Command::read(b"W15"), None, "the line is not ended");
    for bytes in [&b"X00\n"[..], b"R0\n", b"R0E1\n", b"W15\n", b"W15G\n", b"\n"] {
        assert_eq!(Command::read(bytes), Some((None, bytes.len())), "{bytes:?}");
    }
}

fn values() -> impl Strategy<Value = Vec<Value>> {
    let cause = prop::sample::select(vec![Cause::Read, Cause::Written, Cause::Streamed]);
    let value = (cause, any::<u8>(), any::<u32>(), any::<Option<u32>>())
        .prop_map(|(cause, register, value, ticks)| Value { cause, register, value, ticks });
    prop::collection::vec(value, 1..16)
}

proptest! {
    #[test]
    fn lines_roundtrip(values in values(), pieces in pieces()) {
        let stream: Vec<u8> = values.iter().flat_map(|&value| written(&Record::Value(value))).collect();
        let (found, losses) = decode_any_cut(&Qsb, &stream, &pieces);
        let expected: Vec<_> = values.iter().map(|&value| format!("{:?}", Record::Value(value))).collect();
        prop_assert_eq!(found.into_iter().map(|(record, _)| record).collect::<Vec<_>>(), expected);
        prop_assert_eq!(losses.bytes_skipped, 0);
    }

    #[test]
    fn lines_are_found_after_garbage(
        (good, garbage) in values().prop_flat_map(|values| {
            let good: Vec<Vec<u8>> = values.iter().map(|&value| written(&Record::Value(value))).collect();
            (Just(good.clone()), garbage(good))
        }),
        pieces in pieces(),
    ) {
        locks(&Qsb, &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"swreQSB- 0EF!\r\n".to_vec())], 0..2000), pieces in pieces()) {
        decode_any_cut(&Qsb, &bytes, &pieces);
    }
}

//! VIPER: frames, checksums, commands and refusals.

use proptest::prelude::*;

use drivers::framing::{Decoder, Format, Parsed, Refusal};
use drivers::tracker::polhemus::viper::command::{ALL, Action, Command, FilterLevel, Rate, Reply, code};
use drivers::tracker::polhemus::viper::write::FrameToWrite;
use drivers::tracker::polhemus::viper::{OrientationUnit, PositionUnit, Record, Sensor, Viper};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

#[rustfmt::skip]
const SAMPLE: [u8; 60] = [
    0x56, 0x50, 0x52, 0x50, 0x34, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x07, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00,
    0x01, 0x00, 0x00, 0x00, 0x00, 0x0A, 0x00, 0x00, 0x00, 0x00, 0x80, 0x3F, 0x00, 0x00, 0x00, 0xC0, 0x00, 0x00, 0x60, 0x40,
    0x00, 0x00, 0x80, 0x3F, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xA3, 0x69, 0x00, 0x00,
];

fn sensor() -> Sensor {
    Sensor {
        sensor: 0,
        is_virtual: false,
        position_unit: PositionUnit::Centimetres,
        orientation_unit: OrientationUnit::Quaternion,
        buttons: 0,
        distortion: 0,
        auxiliary: 0,
        position: [1.0, -2.0, 3.5],
        orientation: [1.0, 0.0, 0.0, 0.0],
        acceleration: None,
    }
}

fn frame(sensors: &[Sensor]) -> FrameToWrite<'_> {
    FrameToWrite { unit: 1, frame_count: 7, accelerations: false, test: 0, sensors }
}

fn written(frame: &FrameToWrite<'_>) -> Vec<u8> {
    let mut bytes = Vec::new();
    frame.write(&mut bytes);
    bytes
}

#[test]
fn frames_match_manufacturer_header() {
    let mut format = Viper::new(1);
    let Parsed::Record { length: 60, record: Record::Frame(read) } = format.parse(&SAMPLE) else {
        panic!("a good frame was refused");
    };
    assert_eq!((read.unit, read.frame_count, read.accelerations, read.test), (1, 7, false, 0));
    assert_eq!(read.sensors().collect::<Vec<_>>(), [sensor()]);
    assert_eq!(written(&frame(&[sensor()])), SAMPLE);
}

#[test]
fn every_bit_has_a_field() {
    let sensor = Sensor {
        sensor: 0x55,
        is_virtual: true,
        position_unit: PositionUnit::Metres,
        orientation_unit: OrientationUnit::EulerRadians,
        buttons: 2,
        distortion: 0xA5,
        auxiliary: 0x2AA,
        orientation: [0.5, -0.25, 0.125, -1.0],
        acceleration: Some([0.75, 0.0, -0.5, 0.999_969_5]),
        ..sensor()
    };
    let bytes = written(&FrameToWrite { accelerations: true, test: 0xC, ..frame(&[sensor]) });
    let mut format = Viper::new(1);
    let Parsed::Record { record: Record::Frame(read), .. } = format.parse(&bytes) else {
        panic!("a good frame was refused");
    };
    assert!(read.accelerations && read.test == 0xC);
    assert_eq!(read.sensors().collect::<Vec<_>>(), [sensor]);
    // Sensor, virtual, metres, radians, buttons 2, distortion A5, auxiliary 2AA.
    assert_eq!(
        bytes[24..28],
        (0x55_u32 | 1 << 7 | 3 << 8 | 1 << 10 | 2 << 12 | 0xA5 << 14 | 0x2AA << 22).to_le_bytes()
    );
}

#[test]
fn commands_match_bytes() {
    let hex = |text: &str| -> Vec<u8> { text.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect() };
    for (command, bytes) in [
        (
            Command::WhoAmI,
            "56 50 52 43 18 00 00 00 FF FF FF FF 14 00 00 00 01 00 00 00 00 00 00 00 00 00 00 00 89 FC 00 00",
        ),
        (
            Command::Units(PositionUnit::Centimetres, OrientationUnit::Quaternion),
            "56 50 52 43 20 00 00 00 FF FF FF FF 07 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 02 00 00 00 02 00 00 00 7F BF 00 00",
        ),
        (
            Command::Stream { accelerations: false, restart_count: true },
            "56 50 52 43 1C 00 00 00 FF FF FF FF 13 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 94 CB 00 00",
        ),
    ] {
        assert_eq!(command.bytes(), hex(bytes), "{command:?}");
    }
    // For the other commands only the content is checked; the surrounding frame is the same.
    let zenith = [1.0_f32, 0.0, -1.0];
    for (command, number, action, arguments, payload) in [
        (Command::FrameRate(Rate::Hz480), code::FRAME_RATE, Action::Set, [0, 0], vec![4, 0, 0, 0]),
        (
            Command::Hemisphere { sensor: 2, track: true, zenith },
            code::HEMISPHERE,
            Action::Set,
            [2, 0],
            [vec![1, 0, 0, 0], zenith.map(f32::to_le_bytes).concat()].concat(),
        ),
        (Command::Filter { sensor: ALL, level: FilterLevel::None }, code::FILTER, Action::Set, [ALL, 0], vec![0; 20]),
        (Command::AskStationMap, code::STATION_MAP, Action::Get, [0, 0], vec![]),
        (Command::Poll, code::SINGLE_PNO, Action::Get, [0, 0], vec![]),
        (
            Command::Stream { accelerations: true, restart_count: false },
            code::CONTINUOUS_PNO,
            Action::Set,
            [0, 1],
            vec![0xff; 4],
        ),
        (Command::StopStream, code::CONTINUOUS_PNO, Action::Reset, [0, 0], vec![]),
    ] {
        let bytes = command.bytes();
        let expected = Reply { unit: ALL, command: number, action: action as u32, arguments, payload: &payload };
        assert_eq!(
            Viper::new(1).parse(&bytes),
            Parsed::Record { length: bytes.len(), record: Record::Reply(expected) }
        );
        assert_eq!(expected.action(), Some(action));
    }
}

#[test]
fn a_refusal_gives_its_reason() {
    let mut payload = Vec::new();
    Reply::write_nak(2, "no such thing", &mut payload);
    assert_eq!(payload.len(), 144);
    let nak = Reply { unit: 1, command: 7, action: Action::Nak as u32, arguments: [0; 2], payload: &payload };
    let mut bytes = Vec::new();
    nak.write(&mut bytes);
    let mut seen = Vec::new();
    Decoder::new(Viper::new(1)).feed(&bytes, &mut |record, _| {
        let Record::Reply(reply) = record else { panic!("no frame of measurements") };
        let nak = reply.nak().unwrap();
        seen.push((nak.code, String::from_utf8_lossy(nak.text).into_owned()));
    });
    assert_eq!(seen, [(2, "no such thing".to_owned())]);
    assert_eq!(Reply { action: Action::Ack as u32, ..nak }.nak(), None);
    assert_eq!(Reply { action: 9, ..nak }.action(), None);
}

#[test]
fn damage_is_counted_by_reason() {
    for (at, byte, why) in [
        (30, 0x81, Refusal::Checksum),
        (56, 0, Refusal::Checksum),
        (59, 1, Refusal::Checksum),
        (4, 0x35, Refusal::Length),
        (5, 0x10, Refusal::Length),
    ] {
        let mut hurt = SAMPLE;
        hurt[at] = byte;
        let (found, losses) = decode_any_cut(&Viper::new(1), &[&SAMPLE[..], &hurt, &SAMPLE].concat(), &[17]);
        assert_eq!((found.len(), losses.bytes_skipped, losses.refused(why)), (2, 60, 1), "byte {at} = {byte}");
    }
    let (found, losses) = decode_any_cut(&Viper::new(1), &written(&frame(&[sensor(); 2])), &[9]);
    assert_eq!((found.len(), losses.refused(Refusal::Length)), (0, 1), "more sensors than there are");
}

fn frames() -> impl Strategy<Value = Vec<Vec<u8>>> {
    let position_unit = prop::sample::select(vec![
        PositionUnit::Inches,
        PositionUnit::Feet,
        PositionUnit::Centimetres,
        PositionUnit::Metres,
    ]);
    let orientation_unit = prop::sample::select(vec![
        OrientationUnit::EulerDegrees,
        OrientationUnit::EulerRadians,
        OrientationUnit::Quaternion,
        OrientationUnit::Unknown,
    ]);
    let sensor = (
        0_u8..128,
        any::<bool>(),
        position_unit,
        orientation_unit,
        0_u8..4,
        any::<u8>(),
        0_u16..1024,
        any::<[f32; 3]>(),
        any::<[i16; 8]>(),
    )
        .prop_map(
            |(
                sensor,
                is_virtual,
                position_unit,
                orientation_unit,
                buttons,
                distortion,
                auxiliary,
                position,
                halves,
            )| {
                let [a, b, c, d, e, f, g, h] = halves.map(|half| f32::from(half) / 32_768.0);
                Sensor {
                    sensor,
                    is_virtual,
                    position_unit,
                    orientation_unit,
                    buttons,
                    distortion,
                    auxiliary,
                    position,
                    orientation: [a, b, c, d],
                    acceleration: Some([e, f, g, h]),
                }
            },
        );
    let frame = (any::<[u32; 2]>(), any::<bool>(), 0_u8..16, prop::collection::vec(sensor, 0..5)).prop_map(
        |([unit, frame_count], accelerations, test, sensors)| {
            written(&FrameToWrite { unit, frame_count, accelerations, test, sensors: &sensors })
        },
    );
    prop::collection::vec(frame, 1..8)
}

proptest! {
    #[test]
    fn frames_roundtrip(frames in frames(), pieces in pieces()) {
        let stream = frames.concat();
        let (found, losses) = decode_any_cut(&Viper::new(4), &stream, &pieces);
        prop_assert_eq!((found.len(), losses.bytes_skipped), (frames.len(), 0));
        let mut again = Vec::new();
        Decoder::new(Viper::new(4)).feed(&stream, &mut |record, _| match record {
            Record::Frame(frame) => frame.write(&mut again),
            Record::Reply(reply) => panic!("{reply:?}"),
        });
        prop_assert_eq!(again, stream, "written again they are the same bytes: nothing was lost in reading");
    }

    #[test]
    fn frames_are_found_after_garbage((good, garbage) in frames().prop_flat_map(|good| (Just(good.clone()), garbage(good))), pieces in pieces()) {
        locks(&Viper::new(4), &garbage, &good, &pieces);
    }

    #[test]
    fn false_long_reply_delays_frames_within_bound(frames in prop::collection::vec(frames(), 3..6), size in 24_u32..2000, pieces in pieces()) {
        let garbage = [b"VPRC".to_vec(), size.to_le_bytes().to_vec()].concat();
        locks(&Viper::new(4), &garbage, &frames.concat(), &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"VPRC\x00\x34".to_vec())], 0..3000), pieces in pieces()) {
        decode_any_cut(&Viper::new(16), &bytes, &pieces);
    }
}

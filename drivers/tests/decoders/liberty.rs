//! LIBERTY, PATRIOT and Latus: binary frames, commands.

use proptest::prelude::*;

use drivers::framing::{Decoder, Refusal};
use drivers::tracker::polhemus::ListError;
use drivers::tracker::polhemus::liberty::command::{ACTIVE_STATIONS, Command, Counter, Rate, Stations};
use drivers::tracker::polhemus::liberty::{Header, Layout, Liberty, Pose, Record, Reply, Tag};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

const SAMPLE: [u8; 44] = [
    0x4C, 0x59, 0x01, 0x43, 0x00, 0x00, 0x24, 0x00, 0x40, 0xE2, 0x01, 0x00, 0xBD, 0x73, 0x00, 0x00, 0x00, 0x00, 0x20,
    0x41, 0x00, 0x00, 0xB0, 0xC0, 0x00, 0x00, 0xF2, 0x41, 0x00, 0x00, 0x00, 0x3F, 0x00, 0x00, 0x00, 0xBF, 0x00, 0x00,
    0x00, 0x3F, 0x00, 0x00, 0x00, 0xBF,
];

const STREAMED: Header = Header { tag: Tag::Liberty, station: 1, command: b'C', error: 0 };

fn layout() -> Layout {
    Layout::new(&[8, 9, 2, 7]).unwrap()
}

fn sample() -> Pose {
    Pose {
        timestamp_ms: Some(123_456),
        frame_count: Some(29_629),
        position: Some([10.0, -5.5, 30.25]),
        quaternion_wxyz: Some([0.5, -0.5, 0.5, -0.5]),
        ..Pose::empty(STREAMED)
    }
}

fn written(pose: &Pose, layout: &Layout) -> Vec<u8> {
    let mut bytes = Vec::new();
    pose.write(layout, &mut bytes);
    bytes
}

fn poses(format: Liberty, stream: &[u8]) -> Vec<Pose> {
    let mut poses = Vec::new();
    Decoder::new(format).feed(stream, &mut |record, _| match record {
        Record::Pose(pose) => poses.push(pose),
        Record::Reply(reply) => panic!("a reply was made of {:?}", reply.body),
    });
    poses
}

#[test]
fn frames_match_manual() {
    assert_eq!(layout().length(), 44);
    assert_eq!(poses(Liberty::new(1, layout()), &SAMPLE), [sample()], "a frame tells its length, so one is enough");
    assert_eq!(written(&sample(), &layout()), SAMPLE);
    for (tag, bytes) in [(Tag::Patriot, b"PA"), (Tag::Latus, b"LU")] {
        let mut frame = SAMPLE;
        frame[..2].copy_from_slice(bytes);
        let pose = Pose { header: Header { tag, ..STREAMED }, ..sample() };
        assert_eq!(poses(Liberty::new(1, layout()), &frame), [pose]);
    }
}

#[test]
fn frame_length_follows_output_list() {
    let body = |codes: &[u8]| Layout::new(codes).map(|layout| layout.body());
    let all: Vec<u8> = (0..13).collect();
    assert_eq!(body(&all), Ok(1 + 2 + 12 + 12 + 12 + 12 + 36 + 16 + 5 * 4));
    assert_eq!(body(&[]), Ok(0));
    assert_eq!(body(&[13]), Err(ListError::Unknown { code: 13, known: "0 to 12" }));
    assert_eq!(body(&[0; 33]), Err(ListError::TooMany { given: 33, most: 32 }));
    assert_eq!(body(&[6; 28]), Err(ListError::TooLong { bytes: 1008, most: 1000 }));
}

#[test]
fn wrong_length_station_or_orientation_is_refused() {
    let other = written(&sample(), &Layout::new(&[9, 2, 7]).unwrap());
    let second = written(&Pose { header: Header { station: 2, ..STREAMED }, ..sample() }, &layout());
    let turned = written(&Pose { quaternion_wxyz: Some([0.5; 4].map(|each: f32| each * 1.1)), ..sample() }, &layout());
    let far = written(&Pose { position: Some([0.0, f32::NAN, 0.0]), ..sample() }, &layout());
    for (frame, why) in
        [(other, Refusal::Length), (second, Refusal::Header), (turned, Refusal::Range), (far, Refusal::Range)]
    {
        let stream = [&SAMPLE[..], &frame, &SAMPLE].concat();
        let (found, losses) = decode_any_cut(&Liberty::new(1, layout()), &stream, &[13]);
        assert_eq!((found.len(), losses.bytes_skipped, losses.refused(why)), (2, frame.len() as u64, 1), "{why:?}");
    }
}

#[test]
fn sensor_error_is_reported_with_any_values() {
    let lost = Pose {
        header: Header { error: b'u', ..STREAMED },
        quaternion_wxyz: Some([0.0; 4]),
        position: Some([1e6, 0.0, 0.0]),
        ..sample()
    };
    assert!(!lost.header.is_well() && STREAMED.is_well());
    assert_eq!(poses(Liberty::new(1, layout()), &written(&lost, &layout())), [lost]);
}

#[test]
fn replies_give_stations_and_lists() {
    let of = |command, body| {
        let mut bytes = Vec::new();
        Reply { header: Header { command, station: 0, ..STREAMED }, body }.write(&mut bytes);
        bytes
    };
    let list = [2_i32, 7, -1].map(i32::to_le_bytes).concat();
    let stream = [of(ACTIVE_STATIONS, &[3, 0, 1, 0]), of(b'O', &list), SAMPLE.to_vec(), of(b'O', &[1])].concat();
    for format in [Liberty::replies(), Liberty::new(1, layout())] {
        let mut seen = Vec::new();
        Decoder::new(format).feed(&stream, &mut |record, _| {
            seen.push(match record {
                Record::Pose(_) => "pose".to_owned(),
                Record::Reply(reply) => {
                    format!(
                        "{:?} {:?}",
                        reply.station_map(),
                        reply.output_list().map(|codes| codes.collect::<Vec<_>>())
                    )
                }
            });
        });
        seen.retain(|what| what != "pose");
        assert_eq!(seen, ["Some([3, 1]) None", "None Some([2, 7])", "None None"]);
    }
}

#[test]
fn commands_match_bytes() {
    for (command, bytes) in [
        (Command::Poll, &b"P"[..]),
        (Command::Stream, b"C\r"),
        (Command::Binary(true), b"F1\r"),
        (Command::Binary(false), b"F0\r"),
        (Command::Centimetres(true), b"U1\r"),
        (Command::Centimetres(false), b"U0\r"),
        (Command::Rate(Rate::Hz60), b"R2\r"),
        (Command::Rate(Rate::Hz120), b"R3\r"),
        (Command::Rate(Rate::Hz240), b"R4\r"),
        (Command::OutputList(Stations::All, Layout::new(&[8, 9, 11, 2, 7]).unwrap()), b"O*,8,9,11,2,7\r"),
        (Command::OutputList(Stations::One(2), layout()), b"O2,8,9,2,7\r"),
        (Command::AskOutputList(1), b"O1\r"),
        (Command::Zero(Counter::Both), b"Q0\r"),
        (Command::Zero(Counter::FrameCount), b"Q1\r"),
        (Command::Zero(Counter::Timestamp), b"Q2\r"),
        (Command::Hemisphere(Stations::All, [1.0, 0.0, 0.0]), b"H*,1,0,0\r"),
        (Command::ResetAlignment(Stations::One(1)), b"\x121\r"),
        (Command::ResetBoresight(Stations::All), b"\x02*\r"),
        (Command::PositionFilter([0.0, 1.0, 0.0, 0.0]), b"X0,1,0,0\r"),
        (Command::AttitudeFilter([0.2, 0.2, 0.8, 0.95]), b"Y0.2,0.2,0.8,0.95\r"),
        (Command::UsbBuffer(false), b"@B0\r"),
        (Command::AskActiveStations, b"\x150\r"),
        (Command::WhoAreYou, b"\x16\r"),
        (Command::Echo(true), b"\x051\r"),
        (Command::Reset, b"\x19\r"),
        (Command::EndLine, b"\r"),
    ] {
        assert_eq!(command.bytes(), bytes);
        assert_eq!(Command::read(bytes), Some((Some(command), bytes.len())));
        assert_eq!(Command::read(&bytes.to_ascii_lowercase()), Some((Some(command), bytes.len())), "either case");
    }
    assert_eq!(Command::read(b"O*,8"), None, "the line is not ended");
    for bytes in [&b"O*,99\r"[..], b"R9\r", b"H1,1\r", b"Q\r", b"K\r"] {
        assert_eq!(Command::read(bytes), Some((None, bytes.len())), "{bytes:?}");
    }
}

/// Generates lists that end in the quaternion, as [`Layout`] advises.
fn any_layout() -> impl Strategy<Value = Layout> {
    prop::sample::subsequence(vec![0, 1, 2, 4, 6, 8, 9, 10, 11, 12], 0..=10).prop_shuffle().prop_map(|mut codes| {
        codes.push(7);
        Layout::new(&codes).unwrap()
    })
}

fn some_poses() -> impl Strategy<Value = Vec<Pose>> {
    let quaternion = prop_oneof![Just([0.5, -0.5, 0.5, -0.5]), Just([1.0, 0.0, 0.0, 0.0]), Just([0.6, 0.0, -0.8, 0.0])];
    let header = (
        prop_oneof![Just(Tag::Liberty), Just(Tag::Patriot), Just(Tag::Latus)],
        1_u8..=4,
        prop_oneof![Just(b'C'), Just(b'P')],
        prop_oneof![Just(0), Just(b' '), Just(b'c')],
    )
        .prop_map(|(tag, station, command, error)| Header { tag, station, command, error });
    let pose =
        (header, [-500.0_f32..500.0, -500.0..500.0, -500.0..500.0], quaternion, any::<[u32; 2]>(), any::<[i32; 3]>())
            .prop_map(|(header, position, quaternion, [timestamp, count], [stylus, distortion, sync])| Pose {
                position: Some(position),
                euler_deg: Some(position.map(|cm| cm / 3.0)),
                cosines: Some([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]]),
                quaternion_wxyz: Some(quaternion),
                timestamp_ms: Some(timestamp),
                frame_count: Some(count),
                stylus: Some(stylus),
                distortion: Some(distortion),
                external_sync: Some(sync),
                ..Pose::empty(header)
            });
    prop::collection::vec(pose, 1..10)
}

proptest! {
    #[test]
    fn frames_roundtrip(layout in any_layout(), records in some_poses(), pieces in pieces()) {
        let stream: Vec<u8> = records.iter().flat_map(|pose| written(pose, &layout)).collect();
        let (found, losses) = decode_any_cut(&Liberty::new(4, layout), &stream, &pieces);
        prop_assert_eq!((found.len(), losses.bytes_skipped), (records.len(), 0));
        let again: Vec<u8> = poses(Liberty::new(4, layout), &stream).iter().flat_map(|pose| written(pose, &layout)).collect();
        prop_assert_eq!(again, stream, "written again they are the same bytes: nothing was lost in reading");
    }

    #[test]
    fn frames_are_found_after_garbage(
        (layout, good, garbage) in (any_layout(), some_poses()).prop_flat_map(|(layout, poses)| {
            let good: Vec<Vec<u8>> = poses.iter().map(|pose| written(pose, &layout)).collect();
            (Just(layout), Just(good.clone()), garbage(good))
        }),
        pieces in pieces(),
    ) {
        locks(&Liberty::new(4, layout), &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(layout in any_layout(), bytes in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"LYPAUCO\x01\x00".to_vec())], 0..2000), pieces in pieces()) {
        decode_any_cut(&Liberty::new(4, layout), &bytes, &pieces);
        decode_any_cut(&Liberty::replies(), &bytes, &pieces);
    }

    #[test]
    fn command_parser_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..64), text in "[COHRXY@\x02\x12\x15][0-9*B,. -]{0,20}\r") {
        for bytes in [&bytes[..], text.as_bytes()] {
            if let Some((_, used)) = Command::read(bytes) {
                prop_assert!((1..=bytes.len()).contains(&used));
            }
        }
    }
}

//! FASTRAK, text and binary, and the text of ISOTRAK.

use proptest::prelude::*;

use drivers::framing::{Decoder, Refusal};
use drivers::tracker::polhemus::ListError;
use drivers::tracker::polhemus::fastrak::command::{Command, NO_FILTER, NotObeyed};
use drivers::tracker::polhemus::fastrak::reply::STATUS_BYTES;
use drivers::tracker::polhemus::fastrak::{Fastrak, Layout, Mode, Pose, Record, Status, write};

use crate::stream::{decode, decode_any_cut, garbage, locks, pieces};

const SAMPLE_TEXT: &[u8] = b"01   10.00  -5.50  30.25 0.5000-0.5000 0.5000-0.5000\r\n";
const SAMPLE_BINARY: [u8; 32] = [
    0x30, 0x31, 0x20, 0x00, 0x00, 0x20, 0x41, 0x00, 0x00, 0xB0, 0xC0, 0x00, 0x00, 0xF2, 0x41, 0x00, 0x00, 0x00, 0x3F,
    0x00, 0x00, 0x00, 0xBF, 0x00, 0x00, 0x00, 0x3F, 0x00, 0x00, 0x00, 0xBF, 0x20,
];

fn sample() -> Pose {
    Pose { position: Some([10.0, -5.5, 30.25]), quaternion_wxyz: Some([0.5, -0.5, 0.5, -0.5]), ..Pose::empty(1, b' ') }
}

fn poses(format: Fastrak, stream: &[u8]) -> Vec<Pose> {
    let mut poses = Vec::new();
    Decoder::new(format).feed(stream, &mut |record, _| match record {
        Record::Pose(pose) => poses.push(*pose),
        Record::Reply(reply) => panic!("a reply was made of {:?}", String::from_utf8_lossy(reply.text)),
    });
    poses
}

#[test]
fn text_matches_manual() {
    let layout = Layout::new(Mode::Ascii, &[2, 11, 1]).unwrap();
    assert_eq!(layout.length(), 54);
    assert_eq!(poses(Fastrak::uniform(1, layout), &SAMPLE_TEXT.repeat(2)), [sample(); 2]);
    let mut written = Vec::new();
    sample().write(&layout, &mut written);
    assert_eq!(written, SAMPLE_TEXT);
}

#[test]
fn touching_columns_are_separated() {
    let layout = Layout::new(Mode::Ascii, &[2, 11]).unwrap();
    assert_eq!(layout.length(), 52);
    let record = b"01   28.57 -10.28  13.95-0.9713-0.0093 0.1473 0.1855";
    let pose = Pose {
        position: Some([28.57, -10.28, 13.95]),
        quaternion_wxyz: Some([-0.9713, -0.0093, 0.1473, 0.1855]),
        ..Pose::empty(1, b' ')
    };
    assert_eq!(poses(Fastrak::uniform(1, layout), &record.repeat(2)), [pose; 2]);
}

#[test]
fn binary_matches_manual() {
    let layout = Layout::new(Mode::Binary, &[2, 11, 0]).unwrap();
    assert_eq!(layout.length(), 32);
    assert_eq!(poses(Fastrak::uniform(1, layout), &SAMPLE_BINARY.repeat(3)), [sample(); 3]);
    let mut written = Vec::new();
    sample().write(&layout, &mut written);
    assert_eq!(written, SAMPLE_BINARY);
}

#[test]
fn fourteen_bit_values_keep_sign() {
    let layout = Layout::new(Mode::Binary, &[18]).unwrap();
    let record = [0x30, 0x31, 0x20, 0x91, 0x02, 0x69, 0x7E, 0x3A, 0x06];
    let poses = poses(Fastrak::uniform(1, layout), &record.repeat(2));
    let rounded = poses[0].position.unwrap().map(|cm| (cm * 1e4).round() / 1e4);
    assert_eq!((poses.len(), rounded), (2, [9.9976, -5.5298, 30.2490]));
    let mut written = Vec::new();
    poses[0].write(&layout, &mut written);
    assert_eq!(written, record);
}

#[test]
fn record_length_follows_output_list() {
    for (mode, codes, length) in [
        (Mode::Ascii, &[2, 4, 1][..], 47),
        (Mode::Ascii, &[2, 11, 1], 54),
        (Mode::Ascii, &[2, 11, 0], 53),
        (Mode::Ascii, &[52, 61, 66, 1], 3 + 39 + 52 + 2 + 2),
        (Mode::Ascii, &[5, 6, 7, 16, 1], 3 + 63 + 2 + 2),
        (Mode::Binary, &[2, 11], 31),
        (Mode::Binary, &[2, 11, 0], 32),
        (Mode::Binary, &[2, 11, 1], 33),
        (Mode::Binary, &[2, 16], 17),
        (Mode::Binary, &[18, 20], 3 + 6 + 8),
    ] {
        assert_eq!(Layout::new(mode, codes).unwrap().length(), length, "{mode:?} {codes:?}");
    }
    assert!(matches!(Layout::new(Mode::Ascii, &[2, 8]), Err(ListError::Unknown { code: 8, .. })));
    assert!(matches!(Layout::new(Mode::Ascii, &[50]), Err(ListError::Unknown { code: 50, .. })));
    assert!(matches!(Layout::new(Mode::Ascii, &[0; 33]), Err(ListError::TooMany { given: 33, .. })));
    assert!(matches!(Layout::new(Mode::Ascii, &[61; 5]), Err(ListError::TooLong { bytes: 263, .. })));
    assert_eq!(Layout::new(Mode::Binary, &[52]), Err(ListError::ExtendedBinary(52)));
    assert_eq!(Layout::new(Mode::Ascii, &[18]), Err(ListError::PackedText(18)));
}

#[test]
fn error_letter_keeps_pose() {
    let layout = Layout::new(Mode::Ascii, &[2, 11, 1]).unwrap();
    let mut record = SAMPLE_TEXT.to_vec();
    record[2] = b'k';
    let poses = poses(Fastrak::uniform(1, layout), &record.repeat(2));
    assert_eq!(poses, [Pose { error: b'k', ..sample() }; 2]);
}

#[test]
fn stations_have_separate_lists() {
    let text = Layout::new(Mode::Ascii, &[2, 11, 1]).unwrap();
    let short = Layout::new(Mode::Ascii, &[2, 1]).unwrap();
    let format = Fastrak::new([Some(text), None, Some(short), None]);
    let second = Pose { position: Some([1.25, 2.5, -3.75]), ..Pose::empty(3, b' ') };
    let mut stream = Vec::new();
    for _ in 0..3 {
        sample().write(&text, &mut stream);
        second.write(&short, &mut stream);
    }
    assert_eq!(poses(format.clone(), &stream), [sample(), second].repeat(3));
    // A station that is not in use cannot have sent anything.
    stream[1] = b'2';
    let (found, losses) = decode_any_cut(&format, &stream, &[7]);
    assert_eq!((found.len(), losses.bytes_skipped), (5, 54));
    assert!(losses.refused(Refusal::Header) >= 1, "the record, and zeros in it that could have begun one");
}

#[test]
fn replies_among_records_are_extracted() {
    let layout = Layout::new(Mode::Binary, &[2, 11, 0]).unwrap();
    let status = Status {
        station: b'1',
        binary: true,
        centimetres: true,
        compensated: false,
        continuous: true,
        configured: false,
        test: *b"   ",
        model: *b" F3  1",
        version: *b"03.02 ",
        identity: *b"3SPACE FASTRAK                  ",
    };
    let mut stream = SAMPLE_BINARY.repeat(2);
    status.write(&mut stream);
    stream.extend(SAMPLE_BINARY);
    write::write_output_list(1, &layout, &mut stream);
    write::write_stations(1, [true, false, true, false], &mut stream);
    write::write_error(-3, &mut stream);
    stream.extend(SAMPLE_BINARY);
    let mut seen = Vec::new();
    Decoder::new(Fastrak::uniform(1, layout)).feed(&stream, &mut |record, range| match record {
        Record::Pose(pose) => {
            assert_eq!(*pose, sample());
            seen.push("pose".to_owned());
        }
        Record::Reply(reply) => {
            if let Some(read) = reply.status() {
                assert_eq!((read, range.end - range.start), (status, STATUS_BYTES as u64));
                seen.push("status".to_owned());
            }
            if let Some(codes) = reply.output_list() {
                seen.push(format!("list {:?}", codes.collect::<Vec<_>>()));
            }
            if let Some(stations) = reply.stations() {
                seen.push(format!("stations {stations:?}"));
            }
            if let Some(code) = reply.error_code() {
                seen.push(format!("error {code}"));
            }
        }
    });
    let expected = [
        "pose",
        "pose",
        "status",
        "pose",
        "list [2, 11, 0]",
        "stations [true, false, true, false]",
        "error -3",
        "pose",
    ];
    assert_eq!(seen, expected);
}

#[test]
fn reply_is_read_before_layout_is_known() {
    let (found, losses) = decode_any_cut(&Fastrak::replies(), b"\x00\xff21l1010\r\n0121O 211 1\r\n", &[3]);
    assert_eq!(found.iter().map(|(_, range)| range.clone()).collect::<Vec<_>>(), [2..11, 13..24]);
    assert_eq!(losses.bytes_skipped, 4);
    let mut stations = None;
    Decoder::new(Fastrak::replies()).feed(b"2?l10\r\n", &mut |record, _| {
        if let Record::Reply(reply) = record {
            stations = reply.stations();
        }
    });
    assert_eq!(stations, Some([true, false, false, false]), "ISOTRAK II's form");
}

#[test]
fn impossible_measurements_are_refused() {
    let layout = Layout::new(Mode::Binary, &[2, 11, 0]).unwrap();
    let poses = [
        Pose { position: Some([500.5, 0.0, 0.0]), ..sample() },
        Pose { position: Some([0.0, f64::NAN, 0.0]), ..sample() },
        Pose { position: Some([0.0, 0.0, f64::NEG_INFINITY]), ..sample() },
        Pose { quaternion_wxyz: Some([0.9, 0.0, 0.0, 0.0]), ..sample() },
        Pose { quaternion_wxyz: Some([1.03, 0.0, 0.0, 0.0]), ..sample() },
    ];
    for pose in poses {
        let mut stream = SAMPLE_BINARY.repeat(2);
        pose.write(&layout, &mut stream);
        stream.extend(SAMPLE_BINARY.repeat(2));
        let (found, losses) = decode_any_cut(&Fastrak::uniform(1, layout), &stream, &[5]);
        assert_eq!((found.len(), losses.bytes_skipped, losses.refused(Refusal::Range)), (4, 32, 1), "{pose:?}");
    }
}

#[test]
fn commands_match_bytes() {
    let text = Layout::new(Mode::Ascii, &[2, 11, 1]).unwrap();
    for (command, bytes) in [
        (Command::Poll, &b"P"[..]),
        (Command::Stream, b"C"),
        (Command::StopStream, b"c"),
        (Command::Mode(Mode::Ascii), b"F"),
        (Command::Mode(Mode::Binary), b"f"),
        (Command::Centimetres, b"u"),
        (Command::Inches, b"U"),
        (Command::Status, b"S"),
        (Command::OutputList(Some(2), text), b"O2,2,11,1\r"),
        (Command::AskOutputList(1), b"O1\r"),
        (Command::Station(3, true), b"l3,1\r"),
        (Command::Station(4, false), b"l4,0\r"),
        (Command::AskStations(Some(1)), b"l1\r"),
        (Command::AskStations(None), b"l\r"),
        (Command::Hemisphere(1, [1.0, 0.0, 0.0]), b"H1,1,0,0\r"),
        (Command::Hemisphere(2, [0.0, -0.5, 0.25]), b"H2,0,-0.5,0.25\r"),
        (Command::ResetAlignment(1), b"R1\r"),
        (Command::ResetBoresight(1), b"b1\r"),
        (Command::Increment(1, 0.0), b"I1,0\r"),
        (Command::PositionFilter(NO_FILTER), b"x0,1,0,0\r"),
        (Command::AttitudeFilter([0.2, 0.2, 0.8, 0.8]), b"v0.2,0.2,0.8,0.8\r"),
        (Command::Resume, b"\x11"),
        (Command::Suspend, b"\x13"),
        (Command::Reset, b"\x19"),
        (Command::EndLine, b"\r"),
    ] {
        assert_eq!(command.bytes(), bytes);
        assert_eq!(Command::read(bytes), Some((Ok(command), bytes.len())));
    }
    assert_eq!(Command::OutputList(None, text).bytes(), b"O2,11,1\r", "ISOTRAK's form has no station");
    assert_eq!(Command::read(b"O1,2"), None, "the line is not ended");
    for (bytes, why) in [
        (&b"O5,2\r"[..], NotObeyed::OutOfRange),
        (b"O1,99\r", NotObeyed::OutOfRange),
        (b"Hx\r", NotObeyed::NotNumeric),
        (b"H1,1\r", NotObeyed::MissingField),
        (b"Z1\r", NotObeyed::Unknown),
        (b"W", NotObeyed::Unknown),
    ] {
        assert_eq!(Command::read(bytes), Some((Err(why), bytes.len())), "{bytes:?}");
    }
}

/// Generates a layout of any items, with and without a line end.
fn layout() -> impl Strategy<Value = Layout> {
    let text = prop::sample::subsequence(vec![0, 2, 3, 4, 5, 6, 7, 11, 16, 52, 61], 1..=6).prop_shuffle();
    let binary = prop::sample::subsequence(vec![0, 2, 3, 4, 5, 6, 7, 11, 16], 1..=6).prop_shuffle();
    prop_oneof![(Just(Mode::Ascii), text), (Just(Mode::Binary), binary)].prop_map(|(mode, mut codes)| {
        // A binary record of positions alone has no reliable mark of its beginning; a line end
        // provides one.
        codes.push(1);
        Layout::new(mode, &codes).unwrap()
    })
}

/// Generates numbers that text and single precision hold exactly, so that decoding must be
/// exact to the last bit.
fn pose(station: u8) -> impl Strategy<Value = Pose> {
    let length = -1_600_i32..1_600;
    let position =
        [length.clone(), length.clone(), length].prop_map(|quarters| quarters.map(|each| f64::from(each) / 4.0));
    let angle = [-180_i32..180, -90..90, -180..180].prop_map(|degrees| degrees.map(f64::from));
    // Unit quaternions and rows whose numbers end within four decimals.
    let quaternion = prop_oneof![
        Just([0.5, -0.5, 0.5, -0.5]),
        Just([1.0, 0.0, 0.0, 0.0]),
        Just([-0.5, 0.5, 0.5, 0.5]),
        Just([0.0, 0.0, -1.0, 0.0])
    ];
    let row = prop_oneof![Just([1.0, 0.0, 0.0]), Just([0.0, -1.0, 0.0]), Just([0.0, 0.0, 1.0])];
    let stylus = prop_oneof![Just(*b" 0"), Just(*b" 1")];
    let error = prop_oneof![4 => Just(b' '), 1 => 0x21_u8..0x7f];
    (position.clone(), position, angle, quaternion, [row.clone(), row.clone(), row], stylus, error).prop_map(
        move |(position, relative, euler, quaternion, rows, stylus, error)| Pose {
            position: Some(position),
            relative_position: Some(relative),
            euler_deg: Some(euler),
            cosines: rows.map(Some),
            quaternion_wxyz: Some(quaternion),
            stylus: Some(stylus),
            ..Pose::empty(station, error)
        },
    )
}

/// Returns the parts of a pose that the layout contains.
fn requested(pose: &Pose, layout: &Layout) -> Pose {
    use drivers::tracker::polhemus::fastrak::Item;
    let has = |item| layout.entries().iter().any(|entry| entry.item == item);
    Pose {
        position: pose.position.filter(|_| has(Item::Position)),
        relative_position: pose.relative_position.filter(|_| has(Item::RelativePosition)),
        euler_deg: pose.euler_deg.filter(|_| has(Item::Euler)),
        cosines: [0, 1, 2].map(|row| pose.cosines[usize::from(row)].filter(|_| has(Item::Cosines(row)))),
        quaternion_wxyz: pose.quaternion_wxyz.filter(|_| has(Item::Quaternion)),
        stylus: pose.stylus.filter(|_| has(Item::Stylus)),
        ..*pose
    }
}

fn some_poses() -> impl Strategy<Value = Vec<Pose>> {
    prop::collection::vec((1_u8..=2).prop_flat_map(pose), 2..12)
}

proptest! {
    #[test]
    fn poses_roundtrip(layout in layout(), records in some_poses(), pieces in pieces()) {
        let format = Fastrak::uniform(2, layout);
        let mut stream = Vec::new();
        records.iter().for_each(|pose| pose.write(&layout, &mut stream));
        let (found, losses) = decode_any_cut(&format, &stream, &pieces);
        let expected: Vec<_> = records.iter().map(|pose| format!("{:?}", Record::Pose(&requested(pose, &layout)))).collect();
        prop_assert_eq!(found.into_iter().map(|(record, _)| record).collect::<Vec<_>>(), expected);
        prop_assert_eq!(losses.bytes_skipped, 0);
    }

    #[test]
    fn records_are_found_after_garbage(
        (layout, good, garbage) in (layout(), some_poses()).prop_flat_map(|(layout, poses)| {
            let good: Vec<Vec<u8>> = poses.iter().map(|pose| {
                let mut bytes = Vec::new();
                pose.write(&layout, &mut bytes);
                bytes
            }).collect();
            (Just(layout), Just(good.clone()), garbage(good))
        }),
        pieces in pieces(),
    ) {
        locks(&Fastrak::uniform(2, layout), &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(layout in layout(), bytes in prop::collection::vec(any::<u8>(), 0..2000), pieces in pieces()) {
        decode_any_cut(&Fastrak::uniform(4, layout), &bytes, &pieces);
        decode_any_cut(&Fastrak::replies(), &bytes, &pieces);
    }

    #[test]
    fn plausible_bytes_never_panic(layout in layout(), bytes in "[0-4 .EOSl\r\n-]{0,600}", pieces in pieces()) {
        decode_any_cut(&Fastrak::uniform(4, layout), bytes.as_bytes(), &pieces);
    }

    #[test]
    fn command_parser_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..64), text in "[OlHRbIxv][0-9,. -]{0,20}\r") {
        for bytes in [&bytes[..], text.as_bytes()] {
            if let Some((_, used)) = Command::read(bytes) {
                prop_assert!((1..=bytes.len()).contains(&used));
            }
        }
    }
}

#[test]
fn extended_precision_roundtrips() {
    let layout = Layout::new(Mode::Ascii, &[52, 61, 1]).unwrap();
    let pose = Pose {
        position: Some([12.345, -0.00012345, 0.0]),
        quaternion_wxyz: Some([0.70712, -0.70712, 0.0, 1e-9]),
        ..Pose::empty(1, b' ')
    };
    let mut record = Vec::new();
    pose.write(&layout, &mut record);
    assert_eq!(
        String::from_utf8_lossy(&record),
        "01  1.23450E+01 -1.23450E-04  0.00000E+00  7.07120E-01 -7.07120E-01  0.00000E+00  1.00000E-09 \r\n"
    );
    assert_eq!(poses(Fastrak::uniform(1, layout), &record.repeat(2)), [pose; 2]);
}

#[test]
fn single_record_waits_until_stream_is_interrupted() {
    let layout = Layout::new(Mode::Binary, &[2, 11, 0]).unwrap();
    let mut decoder = Decoder::new(Fastrak::uniform(1, layout));
    let mut found = 0;
    decoder.feed(&SAMPLE_BINARY, &mut |_, _| found += 1);
    assert_eq!((found, decoder.pending()), (0, 32));
    decoder.feed(&SAMPLE_BINARY, &mut |_, _| found += 1);
    assert_eq!((found, decoder.pending()), (2, 0));
    decoder.feed(&SAMPLE_BINARY, &mut |_, _| found += 1);
    decoder.feed(&SAMPLE_BINARY[..10], &mut |_, _| found += 1);
    assert_eq!((found, decoder.pending()), (3, 10), "once found, a record is given with its last byte");
    decoder.interrupt();
    assert_eq!((decoder.position(), decoder.pending(), decoder.losses().bytes_skipped), (106, 0, 10));
    decoder.feed(&SAMPLE_BINARY, &mut |_, _| found += 1);
    assert_eq!(found, 3, "after a break it looks for the beginning again");
    let (all, _) = decode(Fastrak::uniform(1, layout), &SAMPLE_BINARY.repeat(4), &[9]);
    assert_eq!(all[3].1, 96..128);
}

#[test]
fn isolated_record_is_refused() {
    let layout = Layout::new(Mode::Binary, &[2, 11, 0]).unwrap();
    // A single record before, between and after noise may itself be noise.
    let stream = [&SAMPLE_BINARY[..], b"x", &SAMPLE_BINARY, &SAMPLE_BINARY, b"0", &SAMPLE_BINARY, b"z"].concat();
    let (found, losses) = decode_any_cut(&Fastrak::uniform(1, layout), &stream, &[10]);
    assert_eq!(found.iter().map(|(_, range)| range.start).collect::<Vec<_>>(), [33, 65]);
    assert_eq!(losses.refused(Refusal::Unconfirmed), 2);
}

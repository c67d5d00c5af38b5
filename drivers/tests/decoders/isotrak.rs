//! ISOTRAK's packed binary, and its text.

use proptest::prelude::*;

use drivers::framing::{Decoder, Format, Parsed, Refusal};
use drivers::tracker::polhemus::ListError;
use drivers::tracker::polhemus::fastrak::{self, Fastrak, Mode};
use drivers::tracker::polhemus::isotrak::{CM_PER_COUNT, Isotrak, Layout, PRESSED, Pose, Record};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

const SAMPLE: [u8; 20] = [
    0xB0, 0x31, 0x20, 0x3D, 0x13, 0x4E, 0x78, 0x40, 0x7B, 0x26, 0x00, 0x40, 0x00, 0x40, 0x00, 0x20, 0x40, 0x00, 0x40,
    0x04,
];

fn layout() -> Layout {
    Layout::new(&[2, 11]).unwrap()
}

fn sample() -> Pose {
    Pose {
        position_counts: Some([0x133D, -1970, 0x267B]),
        quaternion_wxyz_counts: Some([16384, -16384, 16384, -16384]),
        ..Pose::empty(1, b' ')
    }
}

#[test]
fn seven_bit_packing_roundtrips() {
    assert_eq!(layout().length(), 20);
    let mut format = Isotrak::new(1, layout());
    assert_eq!(format.parse(&SAMPLE), Parsed::Record { length: 20, record: Record::Pose(&sample()) });
    let metres = sample().position_counts.unwrap().map(|counts| f64::from(counts) * CM_PER_COUNT / 100.0);
    for (metres, expected) in metres.into_iter().zip([0.25, -0.10, 0.50]) {
        assert!((metres - expected).abs() < 0.5 * CM_PER_COUNT / 100.0, "{metres} is not {expected} to the count");
    }
    let mut written = Vec::new();
    sample().write(&layout(), &mut written);
    assert_eq!(written, SAMPLE);
}

#[test]
fn cut_record_ends_at_next_mark() {
    let stream = [&SAMPLE[..], &SAMPLE[..13], &SAMPLE, &SAMPLE[..1], &SAMPLE].concat();
    let (found, losses) = decode_any_cut(&Isotrak::new(1, layout()), &stream, &[3]);
    assert_eq!(found.iter().map(|(_, range)| range.start).collect::<Vec<_>>(), [0, 33, 54]);
    assert_eq!((losses.bytes_skipped, losses.refused(Refusal::Length)), (14, 2));
}

#[test]
fn replies_and_switches_are_read() {
    let mut pressed = Vec::new();
    Pose { error: PRESSED, ..sample() }.write(&layout(), &mut pressed);
    let stream = [&pressed[..], b"2?l10\r\n", &SAMPLE].concat();
    let mut seen = Vec::new();
    Decoder::new(Isotrak::new(1, layout())).feed(&stream, &mut |record, _| {
        seen.push(match record {
            Record::Pose(pose) => pose.error,
            Record::Reply(reply) => reply.letter,
        });
    });
    assert_eq!(seen, [PRESSED, b'l', b' ']);
}

#[test]
fn stations_not_in_use_and_impossible_orientations_are_refused() {
    for (pose, why) in [
        (Pose { station: 2, ..sample() }, Refusal::Header),
        (Pose { quaternion_wxyz_counts: Some([30_000, 0, 0, 0]), ..sample() }, Refusal::Range),
        (Pose { quaternion_wxyz_counts: Some([32_767, 8_500, 0, 0]), ..sample() }, Refusal::Range),
    ] {
        let mut stream = SAMPLE.to_vec();
        pose.write(&layout(), &mut stream);
        stream.extend(SAMPLE);
        let (found, losses) = decode_any_cut(&Isotrak::new(1, layout()), &stream, &[11]);
        assert_eq!((found.len(), losses.bytes_skipped), (2, 20));
        assert!(losses.refused(why) >= 1, "{why:?}, and a 2 that could have begun a reply");
    }
    assert!(matches!(Layout::new(&[2, 16]), Err(ListError::Unknown { code: 16, .. })));
    assert_eq!(Layout::new(&[1; 9]), Err(ListError::TooMany { given: 9, most: 8 }));
}

#[test]
fn isotrak_text_matches_fastrak() {
    let layout = fastrak::Layout::new(Mode::Ascii, &[2, 4, 1]).unwrap();
    let record = b"01   10.00  -5.50  30.25  90.00 -45.00   0.50\r\n";
    let (found, losses) = decode_any_cut(&Fastrak::uniform(2, layout), &record.repeat(3), &[8]);
    assert_eq!((found.len(), losses.bytes_skipped), (3, 0));
    assert_eq!(fastrak::Command::OutputList(None, layout).bytes(), b"O2,4,1\r");
}

fn any_layout() -> impl Strategy<Value = Layout> {
    prop::sample::subsequence(vec![0, 1, 2, 4, 5, 6, 7, 11], 0..=8)
        .prop_shuffle()
        .prop_map(|codes| Layout::new(&codes).unwrap())
}

fn poses() -> impl Strategy<Value = Vec<Pose>> {
    let quaternion =
        prop_oneof![Just([16384, -16384, 16384, -16384]), Just([32767, 0, 0, 0]), Just([0, -128, -32767, 255])];
    let row = prop_oneof![Just([32767, 0, 0]), Just([0, -32768, 0]), Just([-255, 0, 32767])];
    let pose =
        (1_u8..=2, 0x20_u8..0x7f, any::<[i16; 3]>(), any::<[i16; 3]>(), [row.clone(), row.clone(), row], quaternion)
            .prop_map(|(station, error, position, euler, rows, quaternion)| Pose {
                position_counts: Some(position),
                euler_counts: Some(euler),
                cosine_counts: rows.map(Some),
                quaternion_wxyz_counts: Some(quaternion),
                ..Pose::empty(station, error)
            });
    prop::collection::vec(pose, 1..10)
}

fn written(pose: &Pose, layout: &Layout) -> Vec<u8> {
    let mut bytes = Vec::new();
    pose.write(layout, &mut bytes);
    bytes
}

proptest! {
    #[test]
    fn poses_roundtrip_with_one_mark_each(layout in any_layout(), records in poses(), pieces in pieces()) {
        let stream: Vec<u8> = records.iter().flat_map(|pose| written(pose, &layout)).collect();
        let marks: Vec<usize> = (0..stream.len()).filter(|&at| stream[at] >= 0x80).collect();
        prop_assert_eq!(marks, (0..records.len()).map(|record| record * layout.length()).collect::<Vec<_>>());
        let (found, losses) = decode_any_cut(&Isotrak::new(2, layout), &stream, &pieces);
        prop_assert_eq!((found.len(), losses.bytes_skipped), (records.len(), 0));
        // Writing them again gives the same bytes: nothing was lost in reading.
        let mut again = Vec::new();
        Decoder::new(Isotrak::new(2, layout)).feed(&stream, &mut |record, _| if let Record::Pose(pose) = record {
            pose.write(&layout, &mut again);
        });
        prop_assert_eq!(again, stream);
    }

    #[test]
    fn records_are_found_after_garbage(
        (layout, good, garbage) in (any_layout(), poses()).prop_flat_map(|(layout, poses)| {
            let good: Vec<Vec<u8>> = poses.iter().map(|pose| written(pose, &layout)).collect();
            (Just(layout), Just(good.clone()), garbage(good))
        }),
        pieces in pieces(),
    ) {
        locks(&Isotrak::new(2, layout), &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(layout in any_layout(), bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(0xB0), 0x30..0x34_u8], 0..2000), pieces in pieces()) {
        decode_any_cut(&Isotrak::new(2, layout), &bytes, &pieces);
    }
}

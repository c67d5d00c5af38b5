//! MicroScribe: samples, and the answers during session set-up.

use proptest::prelude::*;

use drivers::arm::microscribe::{
    Answers, Awaited, BEGIN, Command, Family, Links, Question, Request, SIGNATURE, Sample, Samples, WAKE,
};
use drivers::framing::{Decoder, Format, Parsed, Refusal};

use crate::stream::{decode_any_cut, garbage, locks, pieces};

fn six() -> Request {
    Request::new(Family::MicroScribe, 6, false).unwrap()
}

#[test]
fn samples_are_read_and_written() {
    assert_eq!((six().byte(), six().length()), (0x03, 14));
    let bytes = [0x83, 0x02, 0x00, 0x01, 0x01, 0x00, 0x7F, 0x7F, 0x40, 0x00, 0x00, 0x00, 0x12, 0x34];
    let sample = Sample::new(2, None, &[1, 128, 16_383, 8192, 0, 0x12 << 7 | 0x34]);
    assert_eq!(Samples::new(six()).parse(&bytes), Parsed::Record { length: 14, record: sample });
    let mut written = Vec::new();
    sample.write(six(), &mut written);
    assert_eq!(written, bytes);
    assert_eq!(sample.encoders().len(), 6);
}

#[test]
fn requests_match_bytes() {
    for (family, encoders, timer, byte, length) in [
        (Family::MicroScribe, 5, false, 0x01, 12),
        (Family::MicroScribe, 7, false, 0x02, 16),
        (Family::MicroScribe, 6, true, 0x23, 16),
        (Family::Box, 2, false, 0x01, 6),
        (Family::Box, 4, true, 0x22, 12),
        (Family::Box, 6, false, 0x03, 14),
    ] {
        let request = Request::new(family, encoders, timer).unwrap();
        assert_eq!((request.byte(), request.length()), (byte, length));
    }
    assert_eq!(Request::new(Family::MicroScribe, 4, false), None);
    assert_eq!((WAKE, SIGNATURE, BEGIN), (0xC5, b"IMMC", b"BEGIN"));
    assert_eq!(Command::Home.bytes(), [0xC2]);
    assert_eq!(Command::Baud(0x11).bytes(), [0xC4, 0x11]);
    assert_eq!(Command::End.bytes(), [0xC5]);
}

#[test]
fn cut_sample_ends_at_next_mark() {
    let mut good = Vec::new();
    Sample::new(0, None, &[1, 2, 3, 4, 5, 6]).write(six(), &mut good);
    let stream = [&good[..], &good[..5], &good, &[0x84], &good].concat();
    let (found, losses) = decode_any_cut(&Samples::new(six()), &stream, &[3]);
    assert_eq!(found.iter().map(|(_, range)| range.start).collect::<Vec<_>>(), [0, 19, 34]);
    assert_eq!((losses.bytes_skipped, losses.refused(Refusal::Length), losses.refused(Refusal::Header)), (6, 1, 1));
}

#[test]
fn set_up_answers_are_read() {
    let answered = |awaited, stream: &[u8]| {
        let mut found = Vec::new();
        Decoder::new(Answers::to(awaited)).feed(stream, &mut |answer, _| found.push(answer.to_vec()));
        found
    };
    assert_eq!(answered(Awaited::Signature, b"\xc5\xffIMIMMC"), [b"IMMC"]);
    assert_eq!(answered(Awaited::ProductName, b"\x00MSCR\x00"), [b"MSCR"]);
    assert_eq!(answered(Awaited::Answer(Question::Model), b"\xcaMicroScribe-3DX\x00"), [b"MicroScribe-3DX"]);
    assert_eq!(answered(Awaited::Answer(Question::HomeReference), b"xx\xc1abcdefghijkl"), [b"abcdefghijkl"]);
    assert_eq!(answered(Awaited::Answer(Question::Parameters), b"\xc0\x03\x01\xff\x03"), [b"\x01\xff\x03"]);
    assert_eq!(answered(Awaited::Answer(Question::Maxima), &[[0xC6].as_slice(), &[7; 24]].concat()), [[7; 24]]);
    assert_eq!(answered(Awaited::Echo(Command::Home), b"\xc2"), [b""]);
    let questions = [
        (Question::Parameters, 0xC0),
        (Question::HomeReference, 0xC1),
        (Question::Maxima, 0xC6),
        (Question::Product, 0xC8),
        (Question::Identity, 0xC9),
        (Question::Model, 0xCA),
        (Question::Serial, 0xCB),
        (Question::Comment, 0xCC),
        (Question::ParameterFormat, 0xCD),
        (Question::Version, 0xCE),
    ];
    assert!(questions.iter().all(|(question, byte)| question.byte() == *byte));
}

#[test]
fn links_are_high_byte_first() {
    let answer: Vec<u8> = (0..18_i16).flat_map(|value| (value * 1000 - 9000).to_be_bytes()).collect();
    let links = Links::read(&answer).unwrap();
    assert_eq!((links.alpha_counts[0], links.a_mils[0], links.d_mils[5]), (-9000, -3000, 8000));
    assert_eq!(Links::read(&answer[..34]), None);
    assert_eq!(Links::read(&[&answer[..], &[0]].concat()), None);
}

fn streams() -> impl Strategy<Value = (Request, Vec<Vec<u8>>)> {
    let request = (
        prop::sample::select(vec![
            (Family::MicroScribe, 5),
            (Family::MicroScribe, 6),
            (Family::MicroScribe, 7),
            (Family::Box, 2),
            (Family::Box, 4),
        ]),
        any::<bool>(),
    )
        .prop_map(|((family, encoders), timer)| Request::new(family, encoders, timer).unwrap());
    let sample = (0_u8..128, 0_u16..16_384, prop::array::uniform7(0_u16..16_384));
    (request, prop::collection::vec(sample, 1..12)).prop_map(|(request, samples)| {
        let good = samples.iter().map(|(buttons, timer, encoders)| {
            let mut bytes = Vec::new();
            Sample::new(*buttons, Some(*timer), encoders).write(request, &mut bytes);
            bytes
        });
        (request, good.collect())
    })
}

proptest! {
    #[test]
    fn samples_roundtrip((request, good) in streams(), pieces in pieces()) {
        let stream = good.concat();
        let (found, losses) = decode_any_cut(&Samples::new(request), &stream, &pieces);
        prop_assert_eq!((found.len(), losses.bytes_skipped), (good.len(), 0));
        let mut again = Vec::new();
        Decoder::new(Samples::new(request)).feed(&stream, &mut |sample, _| sample.write(request, &mut again));
        prop_assert_eq!(again, stream, "written again they are the same bytes: nothing was lost in reading");
    }

    #[test]
    fn samples_are_found_after_garbage(
        (request, good, garbage) in streams().prop_flat_map(|(request, good)| (Just(request), Just(good.clone()), garbage(good))),
        pieces in pieces(),
    ) {
        locks(&Samples::new(request), &garbage, &good, &pieces);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(prop_oneof![any::<u8>(), 0..128_u8, Just(0x83)], 0..2000), pieces in pieces()) {
        decode_any_cut(&Samples::new(six()), &bytes, &pieces);
        let questions = [Question::Parameters, Question::HomeReference, Question::Model].map(Awaited::Answer);
        for awaited in questions.into_iter().chain([Awaited::Signature, Awaited::ProductName, Awaited::Echo(Command::End)]) {
            decode_any_cut(&Answers::to(awaited), &bytes, &pieces);
        }
    }
}

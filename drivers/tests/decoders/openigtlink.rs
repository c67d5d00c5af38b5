//! OpenIGTLink: the reference library's bytes, every kind of message in both directions, and
//! cut, damaged or foreign streams.

use proptest::prelude::*;

use drivers::openigtlink::{
    Command, Content, Coordinates, Datum, Decoder, Event, Fault, Fixed, Image, Limits, Matrix, Message, Pace, Position,
    Refused, Status, Subject, Text, TimeStamp, Tool, ToolKind, Unwritable, Version,
};
use sonoweave_core::reading::PixelType;

use crate::openigtlink_vectors as vectors;
use crate::openigtlink_vectors::bytes;

fn fixed<const N: usize>(name: &str) -> Fixed<N> {
    Fixed::new(name).unwrap()
}

/// Decodes a stream in pieces of that length.
fn events(stream: &[u8], piece: usize, limits: Limits) -> (Vec<Event>, Option<Refused>, [u64; 2]) {
    let mut decoder = Decoder::new(limits);
    let mut found = Vec::new();
    let mut broken = None;
    for bytes in stream.chunks(piece.max(1)) {
        broken = decoder.feed(bytes, &mut |event| found.push(event)).err();
    }
    (found, broken, [decoder.refused(), decoder.skipped()])
}

/// Returns the only message of the stream, which it fills completely.
fn message(stream: &[u8]) -> Message {
    let (mut found, broken, counts) = events(stream, stream.len(), Limits::default());
    assert_eq!((found.len(), broken, counts), (1, None, [0, 0]), "{found:?}");
    match found.remove(0) {
        Event::Message(message, range) => {
            assert_eq!(range, 0..stream.len() as u64);
            *message
        }
        Event::Refused(refused) => panic!("{refused}"),
    }
}

/// Returns the error of a stream's first message.
fn refused(stream: &[u8]) -> Refused {
    let (found, broken, _) = events(stream, stream.len(), Limits::default());
    match (found.into_iter().next(), broken) {
        (Some(Event::Refused(refused)), None) | (None, Some(refused)) => refused,
        other => panic!("{other:?}"),
    }
}

#[test]
fn messages_match_reference_library_bytes() {
    for digits in [
        vectors::TRANSFORM,
        vectors::TRANSFORM_3,
        vectors::POSITION,
        vectors::STATUS,
        vectors::STRING,
        vectors::CAPABILITY,
        vectors::TDATA,
        vectors::TDATA_3,
        vectors::COMMAND_3,
        vectors::IMAGE,
        vectors::IMAGE_PART,
        vectors::STATUS_NEGATIVE,
        vectors::STT_TDATA,
        vectors::STP_TDATA,
        vectors::RTS_TDATA,
        vectors::GET_IMAGE,
        vectors::GET_CAPABILITY,
        vectors::GET_TRANSFORM,
        vectors::TOOLS,
    ] {
        let wire = bytes(digits);
        let message = message(&wire);
        assert!(!matches!(message.content, Content::Other(..)), "{message:?}");
        assert_eq!(message.bytes().unwrap(), wire, "{message:?}");
    }
}

#[test]
fn reference_library_messages_are_decoded() {
    let image = message(&bytes(vectors::IMAGE));
    assert_eq!((image.version, image.device), (Version::One, fixed("Image_Reference")));
    assert_eq!(image.time.unix_ns(), Some(1_234_567_890_500_000_000));
    let Content::Image(image) = image.content else { panic!("{image:?}") };
    assert_eq!(
        (image.size, image.pixel, image.channels, image.coordinates),
        ([4, 3, 2], PixelType::U16, 1, Coordinates::Ras)
    );
    // The library was given a rotation about z, spacings 0.5, 0.75 and 2, and the centre at 10,
    // 20.5, -30.
    let place = image.place();
    assert_eq!([place[0], place[4], place[8]], [0.0, 0.5, 0.0]);
    assert_eq!([place[1], place[5], place[9]], [-0.75, 0.0, 0.0]);
    assert_eq!([place[3], place[7], place[11]], [10.75, 19.75, -31.0]);
    assert_eq!(image.pixels.len(), 48);

    let Content::Image(part) = message(&bytes(vectors::IMAGE_PART)).content else { panic!() };
    assert_eq!((part.size, part.first, part.part), ([6, 5, 4], [1, 2, 3], [2, 3, 1]));
    assert_eq!((part.coordinates, part.is_whole(), &*part.pixels), (Coordinates::Lps, false, &[1, 2, 3, 4, 5, 6][..]));

    let tools = message(&bytes(vectors::TDATA_3));
    assert_eq!((tools.version, tools.id), (Version::Two, 1));
    assert_eq!(tools.metadatum("First patient age").as_deref(), Some("22"));
    assert_eq!(tools.metadatum("Second patient age").as_deref(), Some("25"));
    let Content::Tools(tools) = tools.content else { panic!() };
    assert_eq!(tools.iter().map(|tool| tool.name.as_str()).collect::<Vec<_>>(), ["Tracker0", "Tracker1", "Tracker2"]);
    let Content::Tools(tools) = message(&bytes(vectors::TOOLS)).content else { panic!() };
    assert_eq!((tools[0].kind, tools[1].kind), (ToolKind::Six, ToolKind::Three));
    assert_eq!(tools[1].matrix.rows()[3], 11.0);

    let Content::Status(status) = message(&bytes(vectors::STATUS_NEGATIVE)).content else { panic!() };
    assert_eq!((status.code, status.subcode, status.message.as_str()), (Status::NOT_READY, -7, "no tracker yet"));
    let Content::Command(command) = message(&bytes(vectors::COMMAND_3)).content else { panic!() };
    assert_eq!((command.id, command.name.as_str()), (5, "This is a test command"));
    assert_eq!(command.text.as_text(), "Start the tracking machine");
    for (digits, last) in [(vectors::POSITION_24, 0.5), (vectors::POSITION_12, 1.0)] {
        let Content::Position(position) = message(&bytes(digits)).content else { panic!() };
        assert_eq!((position.position, position.quaternion_xyzw[3]), ([1.0, 2.0, 3.0], last));
    }
    let Content::Start(of, Some(pace)) = message(&bytes(vectors::STT_TDATA)).content else { panic!() };
    assert!(of.is("TDATA") && pace.interval_ms == 50 && pace.frame == *"Reference");
    assert_eq!(message(&bytes(vectors::GET_TRANSFORM)).content, Content::Get(Subject::of("TRANSFORM")));
    assert_eq!(message(&bytes(vectors::RTS_TDATA)).content, Content::Receipt(Subject::of("TDATA"), 0));
}

#[test]
fn empty_message_decodes_as_nothing() {
    let none = Content::Nothing(fixed("IMAGE"));
    let nothing = Message::new(fixed("volume"), TimeStamp::default(), none.clone());
    assert_eq!(message(&nothing.bytes().unwrap()).content, none);
    let three = Message { version: Version::Two, ..nothing };
    assert_eq!(message(&three.bytes().unwrap()), three);
    // A message of unsupported type is passed on unchanged.
    let other = Message::new(fixed("eye"), TimeStamp(5), Content::Other(fixed("POINT"), vec![1, 2, 3]));
    assert_eq!(message(&other.bytes().unwrap()), other);
}

#[test]
fn oversized_content_is_not_written() {
    let refused = |content| Message::new(fixed("a"), TimeStamp(0), content).bytes().unwrap_err();
    let long = Text { encoding: 3, bytes: vec![b'a'; 65_536] };
    assert!(matches!(refused(Content::Text(long)), Unwritable::TooMuch { what: "bytes of a STRING", size: 65_536 }));
    let mut image = Image::whole([2, 2, 1], (PixelType::U8, 1), vec![0; 4].into(), &[0.0; 16], Coordinates::Ras);
    image.part = [2, 1, 1];
    assert!(matches!(refused(Content::Image(image.clone())), Unwritable::Part { bytes: 4, part: [2, 1, 1], .. }));
    image.part = [3, 2, 1];
    assert!(matches!(refused(Content::Image(image.clone())), Unwritable::Part { part: [3, 2, 1], .. }));
    (image.part, image.pixel) = ([2, 2, 1], PixelType::I64);
    assert_eq!(refused(Content::Image(image)), Unwritable::PixelType(PixelType::I64));
    let metadata = vec![Datum::new("k", "v"); 8192];
    let many = Message { version: Version::Two, metadata, ..message(&bytes(vectors::STRING)) };
    assert!(matches!(many.bytes(), Err(Unwritable::TooMuch { size: 8192, .. })));
}

/// Returns a vector with some bytes replaced, and a corrected checksum.
fn with(digits: &str, at: usize, other: &[u8]) -> Vec<u8> {
    let mut wire = bytes(digits);
    wire[at..at + other.len()].copy_from_slice(other);
    let sum = drivers::openigtlink::header::checksum(&wire[58..]);
    wire[50..58].copy_from_slice(&sum.to_be_bytes());
    wire
}

#[test]
fn invalid_field_is_refused_with_byte() {
    for (wire, fault, offset, problem) in [
        (with(vectors::IMAGE, 59, &[2]), Fault::Field, 58, "image's version is 2"),
        (with(vectors::IMAGE, 60, &[0]), Fault::Field, 60, "at least one channel"),
        (with(vectors::IMAGE, 61, &[8]), Fault::Field, 61, "scalar type is 8"),
        (with(vectors::IMAGE, 62, &[3]), Fault::Field, 62, "byte order is 3"),
        (with(vectors::IMAGE, 63, &[0]), Fault::Field, 63, "coordinates are 0"),
        (with(vectors::IMAGE, 118, &[0, 1]), Fault::Field, 118, "not within [4, 3, 2]"),
        (with(vectors::IMAGE, 129, &[1]), Fault::Length, 130, "[4, 3, 1] voxels take 24 bytes, but there are 48"),
        (with(vectors::IMAGE, 60, &[255, 11]), Fault::Length, 130, "take 48960 bytes"),
        (with(vectors::TDATA, 78, &[9]), Fault::Field, 78, "kind of a tool is 9"),
        (with(vectors::TDATA, 58, &[1]), Fault::Field, 58, "name is not text"),
        (with(vectors::STRING, 60, &[0xff]), Fault::Length, 62, "needs 65302 bytes, but 22 are left"),
        (with(vectors::STRING, 61, &[1]), Fault::Length, 63, "21 bytes follow the text"),
        (with(vectors::COMMAND_3, 204, &[1]), Fault::Length, 208, "the command needs"),
        (with(vectors::TDATA_3, 58, &[0, 11]), Fault::Field, 58, "extended header's size is 11"),
        (with(vectors::TDATA_3, 58, &[1, 24]), Fault::Field, 58, "not 12 to 279"),
        (with(vectors::TDATA_3, 62, &[1]), Fault::Length, 60, "metadata take 16777273 bytes"),
        (with(vectors::TDATA_3, 281, &[3]), Fault::Length, 282, "3 metadata take 24 bytes"),
        (with(vectors::TDATA_3, 283, &[0x12]), Fault::Length, 336, "needs 2 bytes, but 1 are left"),
        (with(vectors::TDATA_3, 298, &[0xff]), Fault::Field, 298, "not UTF-8"),
    ] {
        let why = refused(&wire);
        assert_eq!((why.at, why.fault, why.offset), (0, fault, offset), "{why}");
        assert!(why.to_string().contains(problem), "{why}");
    }
    let mut wire = bytes(vectors::POSITION);
    wire[57] ^= 1;
    let why = refused(&wire);
    assert_eq!((why.fault, why.offset), (Fault::Checksum, 50));
    assert!(why.problem.ends_with("send it again"), "{why}");
    assert!(why.to_string().starts_with("POSITION of \"DeviceName\" at byte 0 of the stream, byte 50"), "{why}");
}

#[test]
fn invalid_header_breaks_stream() {
    for (at, byte, problem) in [
        (0, 1, "version is 257"),
        (1, 3, "version is 3"),
        (1, 0, "version is 0"),
        (2, 0, "not a name in ASCII"),
        (4, 7, "not a name in ASCII"),
        (13, 65, "not a name in ASCII"),
        (14, 0xff, "device's name is not text"),
        (42, 1, "the body's size is 720575940379279"),
    ] {
        let mut wire = bytes(vectors::TRANSFORM);
        wire[at] = byte;
        let stream = [bytes(vectors::STATUS), wire, bytes(vectors::STRING)].concat();
        for piece in [1, 7, stream.len()] {
            let (found, broken, [refused, skipped]) = events(&stream, piece, Limits::default());
            let broken = broken.unwrap();
            assert!(broken.fault == Fault::Header && broken.to_string().contains(problem), "{broken}");
            assert_eq!((found.len(), broken.at, refused), (1, 112, 1));
            assert_eq!(skipped, stream.len() as u64 - 112);
        }
    }
    let (_, broken, _) =
        events(b"GET / HTTP/1.1\r\nHost: localhost:18944\r\nUser-Agent: curl/8.0.1\r\n\r\n", 9, Limits::default());
    assert!(broken.unwrap().to_string().contains("check that the sender speaks OpenIGTLink"));
}

#[test]
fn oversized_body_is_skipped_without_buffering() {
    let limits = Limits { body: 100, passed: 1 << 20 };
    let large = Message::new(fixed("a"), TimeStamp(1), Content::Other(fixed("POINT"), vec![7; 100_000]));
    let stream = [bytes(vectors::STRING), large.bytes().unwrap(), bytes(vectors::TRANSFORM)].concat();
    let mut decoder = Decoder::new(limits);
    let mut found = Vec::new();
    for bytes in stream.chunks(1000) {
        decoder.feed(bytes, &mut |event| found.push(event)).unwrap();
        assert!(decoder.pending() <= 158, "{}", decoder.pending());
    }
    let [Event::Message(..), Event::Refused(why), Event::Message(..)] = &found[..] else { panic!("{found:?}") };
    assert!(why.fault == Fault::TooLarge && why.to_string().contains("100000, more than the limit of 100"), "{why}");
    assert_eq!((decoder.refused(), decoder.skipped()), (1, 100_058));
}

fn name<const N: usize>() -> impl Strategy<Value = Fixed<N>> {
    "[A-Za-z0-9_ ]{0,20}".prop_map(|text| Fixed::new(&text[..text.len().min(N)]).unwrap())
}

fn matrix() -> impl Strategy<Value = Matrix> {
    proptest::array::uniform12(-1e6_f32..1e6).prop_map(Matrix)
}

fn text() -> impl Strategy<Value = Text> {
    ".{0,40}".prop_map(|text| Text::new(&text))
}

fn image() -> impl Strategy<Value = Image> {
    let types = [PixelType::U8, PixelType::I16, PixelType::U32, PixelType::F64];
    (prop::sample::select(types.to_vec()), 1_u8..4, any::<[bool; 2]>(), [1_u16..9, 1_u16..9, 1_u16..9], matrix())
        .prop_flat_map(|(pixel, channels, [little_endian, lps], size, matrix)| {
            let part = size.map(|n| (0..n, 0..n).prop_map(move |(a, b)| (a.min(b), a.max(b) - a.min(b) + 1)));
            part.prop_flat_map(move |part| {
                let (first, part) = (part.map(|(first, _)| first), part.map(|(_, n)| n));
                let bytes =
                    part.iter().map(|n| usize::from(*n)).product::<usize>() * usize::from(channels) * pixel.bytes();
                let coordinates = if lps { Coordinates::Lps } else { Coordinates::Ras };
                prop::collection::vec(any::<u8>(), bytes).prop_map(move |pixels| Image {
                    channels,
                    pixel,
                    little_endian,
                    coordinates,
                    size,
                    matrix,
                    first,
                    part,
                    pixels: pixels.into(),
                })
            })
        })
}

fn content() -> impl Strategy<Value = Content> {
    let kinds = [ToolKind::Tracker, ToolKind::Six, ToolKind::Three, ToolKind::Five];
    let tool = (name(), prop::sample::select(kinds.to_vec()), matrix()).prop_map(|(name, kind, matrix)| Tool {
        name,
        kind,
        matrix,
    });
    let command = || {
        (any::<u32>(), "[a-z ]{0,128}", text()).prop_map(|(id, name, text)| Command {
            id,
            name: Fixed::new(&name).unwrap(),
            text,
        })
    };
    let subjects = ["IMAGE", "TRANSFORM", "TDATA", "STATUS", "CAPABILITY", "POINT"].map(Subject::of);
    let subject = move || prop::sample::select(subjects.to_vec());
    prop_oneof![
        image().prop_map(Content::Image),
        matrix().prop_map(Content::Transform),
        (any::<[i16; 3]>(), any::<[i16; 4]>()).prop_map(|(position, quaternion)| Content::Position(Position {
            position: position.map(f32::from),
            quaternion_xyzw: quaternion.map(f32::from),
        })),
        prop::collection::vec(tool, 0..4).prop_map(Content::Tools),
        (any::<u16>(), any::<i64>(), name(), "[^\0]{0,30}")
            .prop_map(|(code, subcode, name, message)| Content::Status(Status { code, subcode, name, message })),
        text().prop_map(Content::Text),
        prop::collection::vec(name(), 0..4).prop_map(Content::Capability),
        command().prop_map(Content::Command),
        command().prop_map(Content::Answer),
        subject().prop_map(Content::Get),
        subject().prop_map(|of| Content::Start(of, None)),
        (any::<u32>(), name())
            .prop_map(|(interval_ms, frame)| Content::Start(Subject::of("TDATA"), Some(Pace { interval_ms, frame }))),
        subject().prop_map(Content::Stop),
        (subject(), any::<u8>()).prop_map(|(of, outcome)| Content::Receipt(of, outcome)),
    ]
}

prop_compose! {
    fn any_message()(
        device in name(),
        time in any::<u64>(),
        content in content(),
        three in any::<bool>(),
        id in any::<u32>(),
        metadata in prop::collection::vec(("[a-z]{0,9}", ".{0,9}"), 0..4),
    ) -> Message {
        let message = Message::new(device, TimeStamp(time), content);
        if !three {
            return message;
        }
        let metadata = metadata.iter().map(|(key, value)| Datum::new(key, value)).collect();
        Message { version: Version::Two, id, metadata, ..message }
    }
}

proptest! {
    #[test]
    fn messages_roundtrip(sent in any_message()) {
        prop_assert_eq!(message(&sent.bytes().unwrap()), sent);
    }

    #[test]
    fn stream_division_does_not_change_events(
        sent in prop::collection::vec(any_message(), 1..5),
        piece in 1_usize..200,
        damage in prop::option::of((any::<prop::sample::Index>(), 1_u8..)),
        small in any::<bool>(),
    ) {
        let mut stream: Vec<u8> = sent.iter().flat_map(|message| message.bytes().unwrap()).collect();
        if let Some((at, by)) = damage {
            let at = at.index(stream.len());
            stream[at] ^= by;
        }
        let limits = if small { Limits { body: 64, passed: 1000 } } else { Limits::default() };
        let whole = events(&stream, stream.len(), limits);
        prop_assert_eq!(events(&stream, piece, limits), whole.clone());
        if damage.is_none() && !small {
            prop_assert_eq!(whole.0.len(), sent.len());
        }
    }

    #[test]
    fn damaged_body_is_refused(
        sent in any_message(),
        at in any::<prop::sample::Index>(),
        by in 1_u8..,
    ) {
        let mut wire = sent.bytes().unwrap();
        prop_assume!(wire.len() > 58);
        let at = 58 + at.index(wire.len() - 58);
        wire[at] ^= by;
        let why = refused(&wire);
        prop_assert_eq!(why.fault, Fault::Checksum);
    }

    #[test]
    fn shortened_body_is_refused_with_byte(sent in any_message(), cut in any::<prop::sample::Index>()) {
        let mut wire = sent.bytes().unwrap();
        prop_assume!(wire.len() > 58);
        wire.truncate(58 + cut.index(wire.len() - 58));
        let size = wire.len() as u64 - 58;
        wire[42..50].copy_from_slice(&size.to_be_bytes());
        let sum = drivers::openigtlink::header::checksum(&wire[58..]);
        wire[50..58].copy_from_slice(&sum.to_be_bytes());
        // Some are valid messages: lists of fewer things, queries, texts that extend to the
        // end.
        for event in events(&wire, wire.len(), Limits::default()).0 {
            if let Event::Refused(why) = event {
                prop_assert!((58..=wire.len()).contains(&why.offset), "{}", why);
            }
        }
    }
}

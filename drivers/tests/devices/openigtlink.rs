//! An OpenIGTLink server as a device: scripted on a line within the process, and over sockets
//! of this machine.

use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use drivers::OpenSettings;
use drivers::openigtlink::{
    Client, Content, Coordinates, Datum, Decoder, Event, Fixed, Image, Limits, Matrix, Message, Pace, Position,
    RemotePictures, RemoteSettings, RemoteTransforms, Subject, TimeStamp, Tool, ToolKind, Version,
};
use drivers::transport::{LineError, Peer};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{PixelType, Reading, Status};
use sonoweave_core::{Device, Next, Ticks};

use crate::bench::{BEGIN, Rig};

/// A server that sends scripted bytes at their times, and stores received bytes.
#[derive(Default)]
struct Server {
    /// Times and bytes; an empty entry hangs up.
    script: VecDeque<(i64, Vec<u8>)>,
    arrived: Vec<u8>,
    opened: u32,
}

impl Peer for Server {
    fn open(&mut self, _now_ns: i64) -> Result<(), LineError> {
        self.opened += 1;
        Ok(())
    }

    fn written(&mut self, bytes: &[u8], _baud: u32, _now_ns: i64) {
        self.arrived.extend_from_slice(bytes);
    }

    fn next(&mut self, _baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
        if self.script.front().is_none_or(|(at_ns, _)| *at_ns > until_ns) {
            return Ok(None);
        }
        match self.script.pop_front() {
            Some((_, bytes)) if bytes.is_empty() => Err(LineError::Gone("hung up".into())),
            Some((at_ns, bytes)) => Ok(Some((at_ns.max(now_ns), bytes))),
            None => Ok(None),
        }
    }

    fn due(&mut self, _now_ns: i64) -> Option<i64> {
        self.script.front().map(|(at_ns, _)| *at_ns)
    }
}

/// 2026-11-22 09:30, independent of the host's clock.
const THEN: u64 = 1_795_339_800_000_000_000;

fn name<const N: usize>(text: &str) -> Fixed<N> {
    Fixed::new(text).unwrap()
}

fn all() -> RemoteSettings {
    RemoteSettings {
        address: "plus:18944".into(),
        pictures: Some(RemotePictures { device: None, orientation: "MF" }),
        transforms: Some(RemoteTransforms { names: Vec::new(), interval_ms: 8 }),
    }
}

fn rig(settings: RemoteSettings, script: impl IntoIterator<Item = (i64, Vec<u8>)>) -> Rig<Server, Client> {
    let script = script.into_iter().map(|(ms, bytes)| (BEGIN + ms * MS, bytes)).collect();
    let mut rig = Rig::new(Server { script, ..Server::default() }, Client::new(settings).unwrap(), false);
    rig.device.start().unwrap();
    rig
}

fn stated(device: &str, ms: u64, content: Content) -> Message {
    Message::new(name(device), TimeStamp::of_unix_ns(THEN + ms * 1_000_000), content)
}

fn matrix(x: f64) -> Matrix {
    Matrix::of(&[0.0, -1.0, 0.0, x, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0])
}

fn slice(device: &str, number: Option<u64>) -> Message {
    let pixels = (0..12).collect::<Vec<u8>>().into();
    let image = Image::whole([4, 3, 1], (PixelType::U8, 1), pixels, &[0.0; 16], Coordinates::Ras);
    let message = stated(device, 0, Content::Image(image));
    match number {
        None => message,
        Some(number) => {
            let metadata = vec![Datum::new("FrameNumber", &number.to_string()), Datum::new("Depth", "40 mm")];
            Message { version: Version::Two, id: 7, metadata, ..message }
        }
    }
}

fn bytes(message: &Message) -> Vec<u8> {
    message.bytes().unwrap()
}

#[test]
fn server_messages_become_frames_and_transforms() {
    let tool = |of: &str, x| Tool { name: name(of), kind: ToolKind::Six, matrix: matrix(x) };
    let invalid = Message {
        version: Version::Two,
        metadata: vec![Datum::new("Status", "INVALID")],
        ..stated("StylusToTracker", 3, Content::Transform(matrix(9.0)))
    };
    let position = Position { position: [1.0, 2.0, 3.0], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] };
    let stream: Vec<u8> = [
        stated("ProbeToTracker", 1, Content::Transform(matrix(5.0))),
        slice("Image_Reference", Some(41)),
        stated("Tracker", 2, Content::Tools(vec![tool("ToolToTracker", 6.0), tool("Stylus", 7.0)])),
        invalid,
        stated("TipToStylus", 4, Content::Position(position)),
    ]
    .iter()
    .flat_map(bytes)
    .collect();
    let mut rig = rig(all(), [(20, stream[..300].to_vec()), (30, stream[300..].to_vec())]);
    let readings = rig.readings(50 * MS);
    let [Reading::NamedTransform(probe), Reading::Frame(frame), Reading::NamedTransform(tool), rest @ ..] =
        &readings[..]
    else {
        panic!("{readings:?}")
    };
    assert_eq!((probe.from.as_str(), probe.to.as_str(), probe.matrix[3]), ("Probe", "Tracker", 5.0));
    assert_eq!(probe.stamp.ticks, Some(THEN / 1000 + 1000));
    assert_eq!((probe.stamp.host_ns, probe.stamp.item), (Some(BEGIN + 20 * MS), 0));
    assert!((probe.stamp.source_s.unwrap() - (THEN as f64 * 1e-9 + 0.001)).abs() < 1e-6);
    assert_eq!((frame.size, frame.channels, frame.pixel, &*frame.orientation), ([4, 3], 1, PixelType::U8, "MF"));
    assert_eq!(*frame.pixels, *(0..12).collect::<Vec<u8>>());
    assert_eq!((frame.frame_number, &frame.status), (Some(41), &Status::Ok));
    assert!(frame.fields.contains(&("Depth".into(), "40 mm".into())));
    assert_eq!((tool.name().as_str(), tool.stamp.host_ns), ("ToolToTracker", Some(BEGIN + 30 * MS)));
    let [Reading::NamedTransform(stylus), Reading::NamedTransform(doubtful), Reading::NamedTransform(tip)] = rest
    else {
        panic!("{rest:?}")
    };
    assert_eq!((stylus.from.as_str(), stylus.to.as_str()), ("Stylus", ""));
    assert_eq!(doubtful.status, Status::Other("INVALID".into()));
    assert_eq!([tip.matrix[3], tip.matrix[7], tip.matrix[11]], [1.0, 2.0, 3.0]);
    assert_eq!(tip.stamp.item, 5);
    let timing = rig.device.describe().timing;
    assert_eq!((timing.ticks, timing.tick_hz), (Ticks::Time, Some(1e6)));
    assert_eq!(rig.device.describe().image_size, Some([4, 3]));
    // The driver requested TDATA, and now requests the server to stop.
    rig.device.stop().unwrap();
    let mut requested = Vec::new();
    let arrived = std::mem::take(&mut rig.twin.lock().unwrap().arrived);
    Decoder::new(Limits::SMALL).feed(&arrived, &mut |event| requested.push(event)).unwrap();
    let requested: Vec<Content> = requested
        .into_iter()
        .map(|event| match event {
            Event::Message(message, _) => message.content,
            Event::Refused(why) => panic!("{why}"),
        })
        .collect();
    let of = Subject::of("TDATA");
    assert_eq!(requested, [Content::Start(of, Some(Pace { interval_ms: 8, frame: name("") })), Content::Stop(of)]);
}

#[test]
fn only_requested_messages_are_taken() {
    let stream: Vec<u8> = [
        slice("Volume_Reference", None),
        slice("Image_Reference", None),
        stated("ProbeToTracker", 0, Content::Transform(matrix(1.0))),
        stated("StylusToTracker", 0, Content::Transform(matrix(2.0))),
    ]
    .iter()
    .flat_map(bytes)
    .collect();
    let pictures = Some(RemotePictures { device: Some("Image_Reference".into()), orientation: "UN" });
    let mut named =
        rig(RemoteSettings { pictures: pictures.clone(), transforms: None, ..all() }, [(5, stream.clone())]);
    let [Reading::Frame(frame)] = &named.readings(20 * MS)[..] else { panic!() };
    assert_eq!(frame.orientation, "UN");
    assert!(named.twin.lock().unwrap().arrived.is_empty(), "nothing was asked for");
    let names = vec!["StylusToTracker".to_owned()];
    let transforms = Some(RemoteTransforms { names, interval_ms: 0 });
    let mut stylus = rig(RemoteSettings { pictures: None, transforms, ..all() }, [(5, stream.clone())]);
    let [Reading::NamedTransform(transform)] = &stylus.readings(20 * MS)[..] else { panic!() };
    assert_eq!(transform.from, "Stylus");
    // Without a name, the first image that is a slice is used.
    let mut first = rig(RemoteSettings { transforms: None, ..all() }, [(5, stream)]);
    assert_eq!(first.readings(20 * MS).len(), 1);
}

#[test]
fn volume_is_refused_as_frame_with_reason() {
    let pixels = vec![1; 24].into();
    let volume = Image::whole([4, 3, 2], (PixelType::U8, 1), pixels, &[0.0; 16], Coordinates::Ras);
    let stream =
        [stated("Vol", 0, Content::Image(volume)), stated("ProbeToTracker", 0, Content::Transform(matrix(1.0)))];
    let pictures = Some(RemotePictures { device: Some("Vol".into()), orientation: "" });
    let mut rig = rig(RemoteSettings { pictures, ..all() }, [(5, stream.iter().flat_map(bytes).collect())]);
    assert_eq!(rig.readings(20 * MS).len(), 1, "the transform");
    let health = rig.device.health();
    assert!(health.state == State::Running && health.why.contains("not a whole slice"), "{health:?}");
}

#[test]
fn missing_frame_numbers_count_as_lost() {
    let numbers = [5, 6, 9, 10, 2, 3, 2_000_000];
    let script = (1..).zip(numbers).map(|(ms, number)| (ms, bytes(&slice("Image", Some(number)))));
    let mut rig = rig(all(), script);
    assert_eq!(rig.readings(20 * MS).len(), 7);
    assert_eq!(rig.device.health().received.lost, 2);
}

#[test]
fn damaged_message_is_counted_and_next_is_read() {
    let mut damaged = bytes(&slice("Image", None));
    damaged[100] ^= 4;
    let good = bytes(&slice("Image", None));
    let mut rig = rig(all(), [(1, [damaged.clone(), good].concat())]);
    assert_eq!(rig.readings(10 * MS).len(), 1);
    let received = rig.device.health().received;
    assert_eq!((received.refused, received.skipped, received.opened), (1, damaged.len() as u64, 1));
}

#[test]
fn faulty_or_silent_server_is_reconnected() {
    let good = bytes(&stated("ProbeToTracker", 0, Content::Transform(matrix(1.0))));
    let script = [
        (10, good.clone()),
        (20, b"HTTP/1.1 400 Bad Request\r\nConnection: close\r\nContent-Type: text/plain\r\n\r\n".to_vec()),
        (400, good.clone()),
        (500, Vec::new()),
        (800, good.clone()),
        // Nothing follows until much later.
        (12_000, good),
    ];
    let mut rig = rig(all(), script);
    assert_eq!(rig.readings(15 * MS).len(), 1);
    rig.until(State::Absent, 20 * MS);
    assert!(rig.device.health().why.contains("does not send OpenIGTLink"), "{:?}", rig.device.health());
    let before = rig.device.health().received.skipped;
    assert!(before > 0);
    rig.until(State::Running, SECOND);
    rig.until(State::Absent, SECOND);
    assert!(rig.device.health().why.contains("hung up"), "{:?}", rig.device.health());
    rig.until(State::Running, SECOND);
    let silent = rig.until(State::Absent, 6 * SECOND);
    assert!((4 * SECOND..5 * SECOND + 100 * MS).contains(&silent), "{silent}");
    assert!(rig.device.health().why.contains("sent nothing for 5000 ms; it is reconnected"));
    rig.until(State::Running, 12 * SECOND);
    assert_eq!(rig.device.health().received.skipped, before, "what was lost is not lost again");
    assert!(rig.twin.lock().unwrap().opened >= 4);
}

/// Reads over sockets until `enough` or for at most `most`; returns all readings.
fn readings(
    device: &mut dyn Device,
    most: Duration,
    mut enough: impl FnMut(&dyn Device, &[Reading]) -> bool,
) -> Vec<Reading> {
    let begun = Instant::now();
    let mut readings = Vec::new();
    while !enough(device, &readings) {
        assert!(begun.elapsed() < most, "{:?} after {readings:?}", device.health());
        let requested = Monotonic.now_ns();
        if let Next::Reading(reading) = device.next(requested + 20 * MS).unwrap() {
            readings.push(reading);
        }
        assert!(Monotonic.now_ns() - requested < SECOND, "a call overstayed its deadline");
    }
    readings
}

fn open(listener: &TcpListener) -> Box<dyn Device> {
    let address = listener.local_addr().unwrap().to_string();
    let mut device = drivers::open(&OpenSettings::Remote(RemoteSettings { address, ..all() })).unwrap();
    device.start().unwrap();
    device
}

#[test]
fn local_server_reconnects() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let mut device = open(&listener);
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        let mut requested = [0; 94];
        stream.read_exact(&mut requested).unwrap();
        // Larger than any buffer in between.
        let pixels = vec![9; 1 << 20].into();
        let image = Image::whole([1024, 1024, 1], (PixelType::U8, 1), pixels, &[0.0; 16], Coordinates::Ras);
        stream.write_all(&bytes(&stated("Image_Reference", 0, Content::Image(image)))).unwrap();
        stream.shutdown(Shutdown::Both).unwrap();
        requested
    });
    let wait = Duration::from_secs(20);
    let read = readings(&mut *device, wait, |_, readings| !readings.is_empty());
    let Reading::Frame(frame) = &read[0] else { panic!() };
    assert!(frame.size == [1024, 1024] && frame.pixels.iter().all(|pixel| *pixel == 9));
    assert!(server.join().unwrap()[2..].starts_with(b"STT_TDATA"));
    readings(&mut *device, wait, |device, _| {
        device.health().state == State::Absent && device.health().why.contains("check that the server runs there")
    });
    let listener = TcpListener::bind(address).unwrap();
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(&bytes(&stated("ProbeToTracker", 0, Content::Transform(matrix(1.0))))).unwrap();
        stream
    });
    let read = readings(&mut *device, wait, |_, readings| !readings.is_empty());
    assert!(matches!(read[0], Reading::NamedTransform(_)));
    assert_eq!((device.health().state, device.health().received.opened), (State::Running, 2));
    device.stop().unwrap();
    let mut stream: TcpStream = server.join().unwrap();
    let mut arrived = Vec::new();
    stream.read_to_end(&mut arrived).unwrap();
    assert!(arrived.windows(9).any(|window| window == b"STP_TDATA"), "told to stop, and closed");
}

#[test]
fn server_sending_single_bytes_delivers_message() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let mut device = open(&listener);
    let server = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_nodelay(true).unwrap();
        for byte in bytes(&stated("ProbeToTracker", 0, Content::Transform(matrix(1.0)))) {
            stream.write_all(&[byte]).unwrap();
            std::thread::sleep(Duration::from_millis(5));
        }
        stream
    });
    let read = readings(&mut *device, Duration::from_secs(20), |_, readings| !readings.is_empty());
    assert!(matches!(&read[0], Reading::NamedTransform(transform) if transform.matrix[3] == 1.0));
    assert_eq!(device.health().received.skipped, 0);
    drop(server.join().unwrap());
}

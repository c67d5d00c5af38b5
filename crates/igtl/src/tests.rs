use std::cell::RefCell;
use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use ipnet::IpNet;

use drivers::openigtlink::{
    Command, Content, Coordinates, Decoder, Event, Fixed, Image, Limits, Matrix, Message, Pace, Status, Subject, Text,
    TimeStamp, Version,
};
use export::volume::{DenseBox, Scalar};
use pipeline::Observer as _;
use pipeline::session::{Reader as _, Snapshot, VolumeRequest};
use sonoweave_core::clock::{Clock as _, Monotonic};
use sonoweave_core::frames::Transform;
use sonoweave_core::reading::PixelType;
use sonoweave_core::slice::{Pixels, Slice};
use sync::clock::TimeFlags;
use sync::history::{PoseSample, Rigid};
use volume::Grid;

use super::*;

mod bad;
mod others;

/// Time after which a test that waits has hung. It is no time that anything takes.
const HANGS: Duration = Duration::from_secs(120);

/// A simulated session, as far as a server sees it.
struct Bench {
    hub: Arc<Hub>,
    ends: Arc<AtomicBool>,
    server: Server,
    folder: tempfile::TempDir,
}

fn bench() -> Bench {
    bench_at("127.0.0.1:0", &[])
}

fn bench_at(address: &str, allowed: &[&str]) -> Bench {
    let allowed = networks(allowed);
    let (hub, ends) = (Arc::new(Hub::new()), Arc::new(AtomicBool::new(false)));
    let folder = tempfile::tempdir().unwrap();
    let commands = Commands::new(Arc::clone(&ends), Some(folder.path().join("saved")), true);
    let server = Server::new(address.parse().unwrap(), allowed, Arc::clone(&hub), Arc::new(commands)).unwrap();
    Bench { hub, ends, server, folder }
}

fn networks(texts: &[&str]) -> Vec<IpNet> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

/// A client that stores received messages.
struct Peer {
    stream: TcpStream,
    decoder: Decoder,
    received: Vec<Message>,
}

fn fixed<const N: usize>(name: &str) -> Fixed<N> {
    Fixed::new(name).unwrap()
}

impl Peer {
    fn at(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
        Self { stream, decoder: Decoder::new(Limits::default()), received: Vec::new() }
    }

    fn send_content(&mut self, device: &str, version: Version, content: Content) {
        let message = Message { version, ..Message::new(fixed(device), TimeStamp::default(), content) };
        self.stream.write_all(&message.bytes().unwrap()).unwrap();
    }

    fn get(&mut self, kind: &str, device: &str) {
        self.send_content(device, Version::One, Content::Get(Subject::of(kind)));
    }

    /// Reads until a message fulfils the condition; forgets earlier ones.
    fn until(&mut self, what: &str, is: impl Fn(&Message) -> bool) -> Message {
        self.until_by(what, is, || ())
    }

    /// Does the same, and publishes before each read: the server omits poses above its rate.
    fn until_by(&mut self, what: &str, is: impl Fn(&Message) -> bool, publish: impl Fn()) -> Message {
        let begun = Instant::now();
        let mut buffer = vec![0; 1 << 16];
        loop {
            publish();
            if let Some(at) = self.received.iter().position(&is) {
                let mut until = self.received.drain(..=at);
                return until.next_back().unwrap();
            }
            assert!(begun.elapsed() < HANGS, "{what} was not heard");
            let Ok(read) = self.stream.read(&mut buffer) else { continue };
            assert!(read > 0, "cut off before {what}");
            let received = &mut self.received;
            self.decoder
                .feed(&buffer[..read], &mut |event| match event {
                    Event::Message(message, _) => received.push(*message),
                    Event::Refused(why) => panic!("{why}"),
                })
                .unwrap();
        }
    }

    fn named(&mut self, kind: &str, device: &str) -> Message {
        self.until(kind, |message| message.content.kind() == *kind && message.device == *device)
    }

    fn image(&mut self, device: &str) -> Image {
        match self.named("IMAGE", device).content {
            Content::Image(image) => image,
            other => panic!("{other:?}"),
        }
    }

    /// Whether the server disconnects within a time; ignores received data.
    fn is_cut_off(&mut self, within: Duration) -> bool {
        let begun = Instant::now();
        let mut buffer = vec![0; 1 << 16];
        while begun.elapsed() < within {
            match self.stream.read(&mut buffer) {
                Ok(0) => return true,
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return true,
                _ => {}
            }
        }
        false
    }
}

/// A rotated slice with pixels of 0.2 by 0.1 mm.
fn slice(grey: u8) -> Slice {
    let turned = DQuat::from_rotation_z(0.5) * DQuat::from_rotation_x(0.3);
    let mut affine = DAffine3::from_rotation_translation(turned, DVec3::new(10.0, -20.0, 30.0));
    affine.matrix3 *= DMat3::from_diagonal(DVec3::new(0.2, 0.1, 5.0));
    let image = sonoweave_core::slice::Image::new(8, 6, Pixels::U8(vec![grey; 48].into()));
    Slice { image, time_ns: Monotonic.now_ns(), world_from_image: Transform::from_affine(affine) }
}

fn sample(x: f64) -> PoseSample {
    PoseSample {
        time_ns: Monotonic.now_ns(),
        bound_ns: 0,
        flags: TimeFlags::NONE,
        pose: Rigid { rotation: DQuat::from_rotation_y(0.25), position_mm: DVec3::new(x, 2.0, 3.0) },
        invalid: None,
    }
}

fn snapshot(size: [u64; 3], slices: u64) -> Snapshot {
    let direction = DMat3::from_quat(DQuat::from_rotation_x(0.1));
    let grid = Grid { origin: DVec3::new(-5.0, 6.0, 7.0), spacing: DVec3::new(0.5, 0.75, 1.0), direction, size };
    let bytes: Vec<u8> = (0..size.iter().product::<u64>()).map(|n| n as u8).collect();
    Snapshot {
        space: DenseBox { first: [0; 3], grid },
        scalar: Scalar::U8,
        bytes: bytes.into(),
        weights: None,
        slices,
        grey_levels: [0.0, 255.0],
    }
}

/// Checks the world position of an image index.
fn assert_at(image: &Image, index: [f64; 3], expected: DVec3) {
    let p = image.place();
    let at =
        |row: usize| p[4 * row] * index[0] + p[4 * row + 1] * index[1] + p[4 * row + 2] * index[2] + p[4 * row + 3];
    let found = DVec3::new(at(0), at(1), at(2));
    assert!((found - expected).length() < 1e-4, "{found} for {expected}");
}

#[test]
fn slices_and_sensors_are_sent_with_pose_and_time() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    let status = peer.named("STATUS", "Sonoweave");
    assert!(matches!(status.content, Content::Status(Status { code: Status::NOT_READY, .. })));
    let own = slice(7);
    bench.hub.slice("Reference", 41, &own);
    bench.hub.pose(["Probe", "Tracker"], &sample(1.0));
    let message = peer.named("IMAGE", "Image_Reference");
    let before = Monotonic.now_ns() - own.time_ns;
    let age = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos() as i64
        - i64::try_from(message.time.unix_ns().unwrap()).unwrap();
    let after = Monotonic.now_ns() - own.time_ns;
    assert!((before - 50_000_000..after + 50_000_000).contains(&age), "{before} {age} {after}");
    let Content::Image(image) = message.content else { panic!() };
    assert_eq!((image.size, image.coordinates, image.pixel), ([8, 6, 1], Coordinates::Ras, PixelType::U8));
    assert!(image.pixels.iter().all(|grey| *grey == 7));
    for index in [[0.0; 3], [7.0, 0.0, 0.0], [7.0, 5.0, 0.0]] {
        assert_at(&image, index, own.world_from_image.point(DVec3::from_array(index)));
    }
    // The third axis is the normal, one millimetre long.
    let rows = image.place();
    let normal = DVec3::new(rows[2], rows[6], rows[10]);
    assert!((normal.length() - 1.0).abs() < 1e-5);
    assert!((normal - own.world_from_image.vector(DVec3::Z).normalize()).length() < 1e-5);
    let Content::Transform(matrix) = peer.named("TRANSFORM", "ImageToReference").content else { panic!() };
    assert_eq!(matrix, Matrix::of(&own.world_from_image.to_rows()));
    // A later client receives the existing data; a client with version 2 headers also receives
    // metadata.
    let mut late = Peer::at(bench.server.address());
    let Content::Transform(matrix) = late.named("TRANSFORM", "ProbeToTracker").content else { panic!() };
    assert_eq!(matrix.rows()[3], 1.0);
    late.send_content("", Version::Two, Content::Get(Subject::of("STATUS")));
    late.named("STATUS", "");
    bench.hub.slice("Reference", 42, &slice(8));
    let reported = late.named("IMAGE", "Image_Reference");
    assert_eq!(reported.metadatum("FrameNumber").as_deref(), Some("42"));
    assert_eq!(reported.metadatum("Frame").as_deref(), Some("Reference (mm, not anatomical)"));
    let doubtful = PoseSample { invalid: Some("INVALID".into()), ..sample(5.0) };
    let is_invalid = |m: &Message| m.metadatum("Status").as_deref() == Some("INVALID");
    let publish = || bench.hub.pose(["Probe", "Tracker"], &doubtful);
    let reported = late.until_by("a doubtful pose", is_invalid, publish);
    assert_eq!(reported.device, fixed("ProbeToTracker"));
}

#[test]
fn requests_are_answered_under_requested_name() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    peer.get("CAPABILITY", "who");
    let Content::Capability(types) = peer.named("CAPABILITY", "who").content else { panic!() };
    let types: BTreeSet<&str> = types.iter().map(Fixed::as_str).collect();
    assert!(types.contains("STT_TDATA") && types.contains("GET_IMAGE"), "{types:?}");
    // No data exist yet.
    peer.get("TRANSFORM", "ProbeToTracker");
    assert!(matches!(peer.named("TRANSFORM", "ProbeToTracker").content, Content::Nothing(_)));
    peer.get("IMAGE", "Image_Reference");
    assert!(matches!(peer.named("IMAGE", "Image_Reference").content, Content::Nothing(_)));
    bench.hub.set_status(true, "12 slices of 13 frames");
    bench.hub.slice("Reference", 0, &slice(1));
    peer.image("Image_Reference");
    peer.get("IMAGE", "Image_Reference");
    assert_eq!(peer.image("Image_Reference").pixels[0], 1);
    peer.get("STRING", "note");
    let Content::Text(text) = peer.named("STRING", "note").content else { panic!() };
    assert_eq!(text.as_text(), "12 slices of 13 frames");
    // TDATA at the requested rate.
    let of = Subject::of("TDATA");
    peer.send_content("T", Version::One, Content::Start(of, Some(Pace { interval_ms: 100, frame: fixed("") })));
    assert_eq!(peer.named("RTS_TDATA", "T").content, Content::Receipt(of, 0));
    let has_both = |message: &Message| matches!(&message.content, Content::Tools(tools) if tools.len() == 2);
    peer.until_by("both tools", has_both, || {
        bench.hub.pose(["Probe", "Tracker"], &sample(1.0));
        bench.hub.pose(["Reference", "Tracker"], &sample(2.0));
    });
    peer.send_content("T", Version::One, Content::Stop(of));
    peer.until("the receipt", |message| {
        message.content.kind() == *"TDATA" || message.content == Content::Receipt(of, 0)
    });
    peer.get("TDATA", "T");
    let Content::Tools(tools) = peer.named("TDATA", "T").content else { panic!() };
    assert_eq!(
        tools.iter().map(|tool| tool.name.as_str()).collect::<Vec<_>>(),
        ["ProbeToTracker", "ReferenceToTracker"]
    );
    peer.send_content("P", Version::One, Content::Start(Subject::of("POSITION"), None));
    peer.named("RTS_POSITION", "P");
    // The pose before may come first.
    let is_new = |message: &Message| matches!(&message.content, Content::Position(of) if of.position[0] == 4.0);
    let publish = || bench.hub.pose(["Probe", "Tracker"], &sample(4.0));
    let Content::Position(position) = peer.until_by("the new position", is_new, publish).content else { panic!() };
    assert_eq!(position.position, [4.0, 2.0, 3.0]);
    assert!((position.quaternion_xyzw[1] - 0.125_f32.sin()).abs() < 1e-6, "{position:?}");
    peer.get("POSITION", "StylusToTracker");
    assert!(matches!(peer.named("POSITION", "StylusToTracker").content, Content::Nothing(_)));
    // No images after STP_IMAGE; unknown types are reported.
    peer.send_content("", Version::One, Content::Stop(Subject::of("IMAGE")));
    assert_eq!(peer.named("RTS_IMAGE", "").content, Content::Receipt(Subject::of("IMAGE"), 0));
    peer.send_content("", Version::One, Content::Start(Subject::of("POINT"), None));
    assert_eq!(peer.named("RTS_POINT", "").content, Content::Receipt(Subject::of("POINT"), 1));
    peer.get("POINT", "");
    let complaint = peer
        .until("a complaint", |m| matches!(&m.content, Content::Status(s) if s.code == Status::UNKNOWN_INSTRUCTION));
    assert!(matches!(complaint.content, Content::Status(status) if status.message.contains("GET_POINT")));
    // The server sends a slice to all clients at once: when one has it, the others have theirs.
    let mut watcher = Peer::at(bench.server.address());
    watcher.named("STATUS", "Sonoweave");
    bench.hub.slice("Reference", 1, &slice(2));
    watcher.until("the slice", |m| matches!(&m.content, Content::Image(image) if image.pixels[0] == 2));
    peer.get("STATUS", "last");
    peer.until("the last", |message| {
        assert!(!matches!(message.content, Content::Image(_)), "an image though they were stopped");
        message.device == *"last"
    });
}

#[test]
fn tdata_rate_stays_below_requested() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    let pace = Pace { interval_ms: 100, frame: fixed("") };
    peer.send_content("", Version::One, Content::Start(Subject::of("TDATA"), Some(pace)));
    peer.named("RTS_TDATA", "");
    let begun = Instant::now();
    let mut times = Vec::new();
    while times.len() < 5 {
        bench.hub.pose(["Probe", "Tracker"], &sample(begun.elapsed().as_secs_f64()));
        let mut buffer = [0; 4096];
        let Ok(read) = peer.stream.read(&mut buffer) else { continue };
        peer.decoder
            .feed(&buffer[..read], &mut |event| match event {
                Event::Message(message, _) if matches!(message.content, Content::Tools(_)) => {
                    times.push(begun.elapsed())
                }
                _ => {}
            })
            .unwrap();
        assert!(begun.elapsed() < HANGS);
    }
    // From the first pose on: a late read brings receipts together, never forward.
    assert!(*times.last().unwrap() >= Duration::from_millis(350), "{times:?}");
}

/// Starts a thread that makes volumes in place of the session, until it is told to end. It lists
/// the request for each.
fn making(hub: &Arc<Hub>, size: [u64; 3]) -> (Arc<AtomicBool>, Arc<Mutex<Vec<VolumeRequest>>>, JoinHandle<()>) {
    let (ends, made) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Vec::new())));
    let (hub, reported, list) = (Arc::clone(hub), Arc::clone(&ends), Arc::clone(&made));
    let thread = std::thread::spawn(move || {
        while !reported.load(Ordering::Relaxed) {
            // The volume counts as changed each time.
            let request = hub.request();
            if request != VolumeRequest::None {
                let mut made = list.lock().unwrap();
                made.push(request);
                hub.volume(Ok(snapshot(size, made.len() as u64)));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    });
    (ends, made, thread)
}

#[test]
fn volume_is_sent_on_request_and_pushed_at_limited_rate() {
    let bench = bench();
    assert_eq!(bench.hub.request(), VolumeRequest::None, "nobody looks, and nothing is to be made");
    let (ends, made, thread) = making(&bench.hub, [5, 4, 3]);
    bench.hub.slice("Reference", 0, &slice(1));
    let begun = Instant::now();
    let mut peer = Peer::at(bench.server.address());
    let image = peer.image("Volume_Reference");
    let expected = snapshot([5, 4, 3], 1);
    assert_eq!((image.size, &*image.pixels), ([5, 4, 3], &*expected.bytes));
    let grid = expected.space.grid;
    for index in [[0.0; 3], [4.0, 0.0, 0.0], [4.0, 3.0, 2.0]] {
        assert_at(&image, index, grid.origin + grid.direction * (grid.spacing * DVec3::from_array(index)));
    }
    peer.image("Volume_Reference");
    assert!(begun.elapsed() >= VOLUME_EVERY, "{:?}", begun.elapsed());
    assert!(!made.lock().unwrap().contains(&VolumeRequest::Now));
    // A requested volume is made for the request, and not with the next change.
    peer.get("IMAGE", "Volume_Reference");
    while !made.lock().unwrap().contains(&VolumeRequest::Now) {
        peer.image("Volume_Reference");
    }
    ends.store(true, Ordering::Relaxed);
    thread.join().unwrap();
    // A missing volume is reported.
    bench.hub.volume(Err(pipeline::session::NoVolume::Unseen));
    peer.get("IMAGE", "Volume_Reference");
    let begun = Instant::now();
    while bench.hub.request() != VolumeRequest::Now {
        assert!(begun.elapsed() < HANGS, "the request did not come");
        std::thread::sleep(Duration::from_millis(2));
    }
    bench.hub.volume(Err(pipeline::session::NoVolume::Unseen));
    assert!(matches!(peer.named("IMAGE", "Volume_Reference").content, Content::Nothing(_)));
}

#[test]
fn commands_start_and_stop_session_and_save_volume() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    let mut send = |name: &str, version, id| {
        let command = Command { id, name: fixed(name), text: Text::new("") };
        peer.send_content("me", version, Content::Command(command));
        let answer = peer.until("an answer", |message| matches!(message.content, Content::Answer(_)));
        let result = answer.metadatum("Result").map(|text| text.into_owned());
        let Content::Answer(Command { id: of, name, text }) = answer.content else { panic!() };
        assert_eq!(of, id);
        (name.as_str().to_owned(), text.as_text().into_owned(), result)
    };
    let (name, text, result) = send("start", Version::Two, 1);
    assert_eq!((name.as_str(), result.as_deref()), ("start", Some("true")));
    assert!(text.contains("<Result>true</Result>"), "{text}");
    let (name, text, result) = send("start", Version::Two, 2);
    assert_eq!(result.as_deref(), Some("false"));
    assert!(name.contains("runs already") && text.contains("<Result>false</Result>"), "{name}: {text}");
    let (name, _, result) = send("format", Version::One, 3);
    assert!(name.contains("give start, stop, save") && result.is_none(), "{name}");
    bench.hub.slice("Reference", 0, &slice(1));
    let (ends, made, thread) = making(&bench.hub, [4, 3, 2]);
    for number in ["001", "002"] {
        let (_, text, _) = send("save", Version::Two, 4);
        assert!(text.contains("is written"), "{text}");
        let file = std::fs::read(bench.folder.path().join(format!("saved/volume-{number}.mha"))).unwrap();
        assert!(file.ends_with(&(0..24).collect::<Vec<u8>>()), "its voxels");
    }
    assert!(made.lock().unwrap().len() >= 2);
    ends.store(true, Ordering::Relaxed);
    thread.join().unwrap();
    // Commands in the form of PLUS clients of earlier versions.
    let text = Text::new("<Command Name=\"stop\" />");
    peer.send_content("CMD_77", Version::One, Content::Text(text));
    let Content::Text(text) = peer.named("STRING", "ACK_77").content else { panic!() };
    assert!(text.as_text().contains("Status=\"SUCCESS\""), "{text:?}");
    assert!(bench.ends.load(Ordering::Relaxed));
}

#[test]
fn commands_of_remote_clients_are_refused() {
    let ends = Arc::new(AtomicBool::new(false));
    let state = Rc::new(state::ServerState {
        hub: Arc::new(Hub::new()),
        commands: Arc::new(Commands::new(Arc::clone(&ends), None, false)),
        counts: Arc::default(),
        allowed: tokio::sync::watch::channel(networks(&["192.0.2.0/24"])).1,
        clients: RefCell::default(),
        published: RefCell::default(),
    });
    for (address, ended, expected) in
        [("192.0.2.1", false, "only clients on this machine"), ("127.0.0.1", true, "the session ends")]
    {
        let client = Rc::new(client::Client::new(address.parse().unwrap()));
        let command = Command { id: 9, name: fixed("stop"), text: Text::new("") };
        state.handle(&client, Message::new(fixed("x"), TimeStamp(0), Content::Command(command)));
        let wire = client.next().unwrap();
        assert!(String::from_utf8_lossy(&wire).contains(expected), "{wire:?}");
        assert_eq!(ends.load(Ordering::Relaxed), ended);
    }
}

fn served_at(address: SocketAddr, allowed: &[&str]) -> Result<Server, IgtlError> {
    let commands = Commands::new(Arc::default(), None, false);
    Server::new(address, networks(allowed), Arc::new(Hub::new()), Arc::new(commands))
}

#[test]
fn taken_address_is_named_in_error() {
    let bench = bench();
    let again = served_at(bench.server.address(), &[]);
    assert!(matches!(again, Err(IgtlError::Taken { address, .. }) if address == bench.server.address()));
}

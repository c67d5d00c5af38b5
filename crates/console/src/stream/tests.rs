//! Pages that view, control, respond slowly and flood, over a socket.

use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec3};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

use sonoweave_core::frames::Transform;

mod bad;
mod bricks;
mod packed;

use super::*;
use crate::Basis;
use crate::viewer_slots::PATIENCE;
use crate::{About, Console, ConsoleSession, FrameBroadcaster, Latest};
use guidance::spacing::Spacing;
use guidance::{GuidanceSettings, ScanGuidance};
use mask::{Clip, MaskSettings};
use pipeline::session::{Drawn, SessionStatus, Spread, Unwritten, Written};
use pipeline::{CapturedFrame, Observer as _};
use render::classify::transfer::Transfer;
use render::{RenderRegion, RenderSettings, Renderer};
use sonoweave_core::slice::{Image, Pixels, Slice};

mod places;
mod planes;
mod view;

/// Time after which a test that waits has hung. It is no time that anything takes.
const HANGS: Duration = Duration::from_secs(120);

struct Session {
    console: Console,
    broadcaster: Arc<FrameBroadcaster>,
    latest: Arc<Latest>,
}

impl Session {
    fn new() -> Self {
        Self::patient_for(PATIENCE)
    }

    /// Pages inactive for this long can be replaced.
    fn patient_for(patience: Duration) -> Self {
        let about = About { name: "b.toml".into(), kind: "live", size: Some([2, 1]), pixel_mm: Some([0.2, 0.3]) };
        let latest = Arc::new(Latest::new(Basis { about, ..Basis::default() }));
        let broadcaster = Arc::new(FrameBroadcaster::default());
        latest.publish(&SessionStatus::default(), &[]);
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0)).into();
        let parts = ConsoleSession {
            latest: Arc::clone(&latest),
            broadcaster: Arc::clone(&broadcaster),
            ..ConsoleSession::default()
        };
        let console = Console::serve(&address, parts, patience).unwrap();
        Self { console, broadcaster, latest }
    }

    fn address(&self) -> SocketAddr {
        self.console.address()
    }

    fn page(&self) -> Client {
        let (mut client, about) = Client::enter(self.address());
        assert_eq!(about["about"]["name"], "b.toml");
        assert_eq!(about["about"]["pixel_mm"], json!([0.2, 0.3]));
        let control = client.word("control");
        client.steers = control.as_bool().unwrap();
        client
    }

    /// Simulates a new frame.
    fn shows(&self, item: u64) {
        let image = Image::new(2, 1, Pixels::U8(vec![item as u8, 7].into()));
        self.broadcaster.captured(&CapturedFrame { item, captured_ns: 0, image: &image });
    }
}

/// A page simulated by a program.
struct Client {
    socket: WebSocket<TcpStream>,
    steers: bool,
    pictures: Vec<Vec<u8>>,
}

impl Client {
    fn enter(address: SocketAddr) -> (Self, Value) {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(HANGS)).unwrap();
        let request = format!("ws://{address}/v1/stream").into_client_request().unwrap();
        let (socket, _) = tungstenite::client(request, stream).unwrap();
        let mut client = Self { socket, steers: false, pictures: Vec::new() };
        let about = client.next_word();
        (client, about)
    }

    fn say(&mut self, message: &Value) {
        self.socket.send(Message::Text(message.to_string().into())).unwrap();
    }

    fn next_word(&mut self) -> Value {
        loop {
            match self.socket.read().unwrap() {
                Message::Text(text) => return serde_json::from_str(&text).unwrap(),
                Message::Binary(bytes) => self.pictures.push(bytes.to_vec()),
                Message::Ping(_) => {}
                other => panic!("{other:?}"),
            }
        }
    }

    /// Returns the next message of a kind; skips other ones.
    fn word(&mut self, key: &str) -> Value {
        let begun = Instant::now();
        while begun.elapsed() < HANGS {
            if let Some(value) = self.next_word().get(key) {
                return value.clone();
            }
        }
        panic!("nothing was said of {key}");
    }

    fn picture(&mut self) -> Vec<u8> {
        let begun = Instant::now();
        // A static picture is repeated after some seconds.
        while begun.elapsed() < HANGS {
            if !self.pictures.is_empty() {
                return self.pictures.remove(0);
            }
            match self.socket.read().unwrap() {
                Message::Binary(bytes) => return bytes.to_vec(),
                Message::Text(_) | Message::Ping(_) => {}
                other => panic!("{other:?}"),
            }
        }
        panic!("no picture came");
    }

    /// Waits until the server has acted on everything that was said: it answers in turn.
    fn is_understood(&mut self) {
        self.say(&json!({ "do": "shown", "kind": 9, "sequence": 1 }));
        self.word("refused");
    }

    /// Returns the pictures received until two more status messages: half a second for a page
    /// with a subscription.
    fn for_a_while(&mut self) -> usize {
        self.word("account");
        self.word("account");
        self.word("account");
        self.pictures.len()
    }
}

fn item(picture: &[u8]) -> u64 {
    u64::from_le_bytes(picture[32..40].try_into().unwrap())
}

fn sequence(picture: &[u8]) -> u32 {
    u32::from_le_bytes(picture[12..16].try_into().unwrap())
}

fn until(what: &str, mut is: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is() {
        assert!(begun.elapsed() < HANGS, "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn pictures_are_made_and_sent_for_subscribers_only() {
    let session = Session::new();
    session.shows(1);
    assert_eq!(session.broadcaster.made(Kind::Slice), 0, "nobody is there");
    let mut page = session.page();
    session.shows(2);
    assert_eq!((session.broadcaster.made(Kind::Slice), page.for_a_while()), (0, 0), "nobody looks");
    page.say(&json!({ "do": "show", "slice": true, "view": false }));
    until("somebody looks", || {
        session.shows(3);
        session.broadcaster.made(Kind::Slice) > 0
    });
    assert!(!session.broadcaster.is_watched(), "at the volume nobody does");
    let picture = page.picture();
    assert_eq!(picture.len(), 42);
    assert_eq!((picture[0], picture[1], item(&picture), sequence(&picture)), (1, 0, 3, 1));
    assert_eq!(&picture[4..12], [2, 0, 0, 0, 1, 0, 0, 0]);
    assert_eq!(&picture[40..], [3, 7]);
    let time = |at: usize| f64::from_le_bytes(picture[at..at + 8].try_into().unwrap());
    // The machine's clock began at 0 ns.
    assert!(time(24) - time(16) > 0.0 && (time(24) - unix_ms(Monotonic.now_ns())).abs() < 60_000.0);
    page.say(&json!({ "do": "show", "slice": false, "view": true }));
    until("the volume is looked at", || session.broadcaster.is_watched());
    let made = session.broadcaster.made(Kind::Slice);
    session.shows(4);
    assert_eq!(session.broadcaster.made(Kind::Slice), made);
    drop(page);
    until("nobody looks any more", || !session.broadcaster.is_watched());
}

#[test]
fn silent_page_gets_two_pictures_then_the_newest() {
    let session = Session::new();
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": true, "view": true }));
    until("somebody looks", || session.broadcaster.is_watched());
    session.shows(1);
    let first = page.picture();
    session.shows(2);
    let second = page.picture();
    assert_eq!([item(&first), item(&second)], [1, 2]);
    (3..=200).for_each(|item| session.shows(item));
    assert_eq!(page.for_a_while(), 0, "two are on their way");
    page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&first) }));
    let third = page.picture();
    assert_eq!((item(&third), sequence(&third)), (200, 200), "the newest, and none of those between");
    // A page that never answers is still served later.
    session.shows(201);
    assert_eq!(item(&page.picture()), 201);
}

#[test]
fn page_without_subscription_gets_fewer_status_messages() {
    let session = Session::new();
    let three = |page: &mut Client| (0..3).for_each(|_| drop(page.word("account")));
    // From before the first one is sent until the last one has come, however late it comes.
    let begun = Instant::now();
    let mut page = session.page();
    three(&mut page);
    assert!(begun.elapsed() >= Duration::from_millis(2500), "{:?}", begun.elapsed());
    page.say(&json!({ "do": "show", "slice": true, "view": false }));
    // A loaded machine delays some of them.
    until("three come in less time than they take a hidden page", || {
        let begun = Instant::now();
        three(&mut page);
        begun.elapsed() < Duration::from_millis(2000)
    });
    page.say(&json!({ "do": "show", "slice": false, "view": false }));
    let begun = Instant::now();
    page.is_understood();
    three(&mut page);
    assert!(begun.elapsed() >= Duration::from_millis(2000), "{:?}", begun.elapsed());
}

#[test]
fn first_page_has_control_until_takeover_or_leaving() {
    let session = Session::new();
    let home = render::camera::View::default();
    let mut first = session.page();
    let mut second = session.page();
    assert!(first.steers && !second.steers);
    second.say(&json!({ "do": "zoom", "by": 1.0 }));
    let refused = second.word("refused");
    assert!(refused.as_str().unwrap().contains("take over control"), "{refused}");
    assert_eq!(session.broadcaster.view(home), home);
    first.say(&json!({ "do": "zoom", "by": 1.0 }));
    until("the first one steers", || session.broadcaster.view(home).zoom == 1.0);
    second.say(&json!({ "do": "control" }));
    assert_eq!(second.word("control"), json!(true));
    assert_eq!(first.word("control"), json!(false));
    second.say(&json!({ "do": "turn", "right": 10.0, "up": 0.0, "clockwise": 0.0 }));
    until("the second one steers", || session.broadcaster.view(home).azimuth != 0.0);
    second.say(&json!({ "do": "look", "from": "home" }));
    until("home", || session.broadcaster.view(home) == home);
    drop(second);
    assert_eq!(first.word("control"), json!(true));
}

#[test]
fn invalid_commands_refused_and_flooding_page_disconnected() {
    let session = Session::new();
    let mut page = session.page();
    for (message, part) in [
        (json!({ "do": "dance" }), "unknown variant `dance`"),
        (json!({ "do": "zoom" }), "missing field `by`"),
        (json!({ "do": "zoom", "by": 1.0, "also": 2 }), "unknown field `also`"),
        (json!([1]), "not a valid command"),
        (json!({ "do": "centre", "at": [0.5, 0.5] }), "no picture yet"),
        (json!({ "do": "shown", "kind": 9, "sequence": 1 }), "no pictures of kind 9"),
    ] {
        page.say(&message);
        let refused = page.word("refused");
        assert!(refused.as_str().unwrap().contains(part), "{message}: {refused}");
    }
    page.socket.send(Message::Binary(vec![1].into())).unwrap();
    assert!(page.word("refused").as_str().unwrap().contains("text"));
    let mut others: Vec<Client> = (0..7).map(|_| session.page()).collect();
    let stream = TcpStream::connect(session.address()).unwrap();
    let request = format!("ws://{}/v1/stream", session.address()).into_client_request().unwrap();
    let refused = tungstenite::client(request, stream).unwrap_err().to_string();
    assert!(refused.contains("503"), "{refused}");
    // A message that is too long, and a thousand short ones.
    let long = json!({ "do": "x".repeat(5000) });
    others[0].say(&long);
    assert!(ends(&mut others[0]), "too long a message");
    for _ in 0..1000 {
        if others[1].socket.send(Message::Text("{}".into())).is_err() {
            break;
        }
    }
    assert!(ends(&mut others[1]), "too many messages");
    page.say(&json!({ "do": "zoom", "by": 0.5 }));
    until("the first page is served on", || session.broadcaster.view(Default::default()).zoom == 0.5);
}

fn ends(client: &mut Client) -> bool {
    for _ in 0..5000 {
        if client.socket.read().is_err() {
            return true;
        }
    }
    false
}

#[test]
fn foreign_origin_is_refused() {
    let session = Session::new();
    let own = format!("http://{}", session.address());
    let elsewhere = ["http://example.org", "null", "http://localhost.example.org", "http://127.0.0.1:1"];
    for origin in elsewhere.into_iter().chain([own.as_str()]) {
        let stream = TcpStream::connect(session.address()).unwrap();
        let mut request = format!("ws://{}/v1/stream", session.address()).into_client_request().unwrap();
        request.headers_mut().insert("origin", origin.parse().unwrap());
        let entered = tungstenite::client(request, stream);
        match origin == own {
            true => drop(entered.unwrap()),
            false => assert!(entered.unwrap_err().to_string().contains("403"), "{origin}"),
        }
    }
}

#[test]
fn status_reports_rates_frame_outcomes_and_end() {
    let session = Session::new();
    let mut page = session.page();
    let mut account = SessionStatus::default();
    page.word("account");
    for _ in 0..30 {
        account.ledger.arrived();
        account.ledger.used();
    }
    session.latest.publish(&account, &[]);
    let begun = Instant::now();
    let reported = loop {
        let reported = page.word("account");
        if reported["slices"] == 30 {
            break reported;
        }
        assert!(begun.elapsed() < HANGS, "{reported}");
    };
    assert!(reported["rates"]["frames"].as_f64().unwrap() > 0.0, "{reported}");
    assert_eq!((&reported["frames"], &reported["dropped"], &reported["refused"]), (&json!(30), &json!(0), &json!({})));
    assert_eq!(reported["ended"], false);
    // The recording is reported as soon as there is one.
    account.recording = Some(Written {
        path: "late.mcap".into(),
        messages: 0,
        stored: 0,
        lost: 0,
        lost_before_writer: Unwritten::default(),
        after_end: Unwritten::default(),
        bytes: 0,
        synced_bytes: 0,
        unsynced_s: 0.5,
        unsynced_most_s: 0.75,
        slow_disk: false,
        free_bytes: None,
        minutes_left: None,
        trouble: String::new(),
    });
    session.latest.publish(&account, &[]);
    assert_eq!(page.word("about")["recording"], "late.mcap");
    // The end is reported, and is not taken for a lost connection.
    session.latest.end();
    let Session { console, .. } = session;
    drop(console);
    let mut last = Value::Null;
    loop {
        match page.socket.read().unwrap() {
            Message::Text(text) => last = serde_json::from_str(&text).unwrap(),
            Message::Close(Some(close)) => break assert_eq!(u16::from(close.code), 1001),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(last["account"]["ended"], true);
}

/// A picture of a volume, a box of 60 mm.
fn drawn(item: u64) -> Drawn {
    let stage = RenderRegion::new(Transform::from_affine(DAffine3::IDENTITY), [-30; 3], [60; 3]).unwrap();
    let settings = RenderSettings::new([80, 60], Transfer::preset("tissue", [0.0, 255.0]).unwrap());
    Drawn {
        renderer: Renderer::new(&settings, stage).unwrap(),
        slices: 0,
        item,
        time_ns: 0,
        captured_ns: None,
        refining: false,
        pictures: 0,
        by_slab: 0,
        in_parts: 0,
        skipped: 0,
        renderers: 1,
        widened: 0,
        capture_to_picture: Spread::default(),
        draw: Spread::default(),
        held: Spread::default(),
    }
}

#[test]
fn missed_regions_marked_once_for_viewers_only() {
    let session = Session::new();
    let spacing = Spacing { gapless_mm: 4.0, even_mm: 2.0 };
    let mask = MaskSettings { clip: Clip::None, ..MaskSettings::default() };
    let guidance = Arc::new(ScanGuidance::new(GuidanceSettings { spacing, mask, calibration: None }));
    session.broadcaster.follow(&guidance);
    // The present slice stays present for as long as the test lasts.
    let mut now_ns = Monotonic.now_ns() + 3_600_000_000_000;
    let mut slice = |z: f64| {
        now_ns += 40_000_000;
        let image = Image::new(11, 11, Pixels::U8(vec![0; 121].into()));
        let world_from_image = Transform::from_affine(DAffine3::from_translation(DVec3::new(0.0, 0.0, z)));
        guidance.slice("Tracker", 0, &Slice { image, time_ns: now_ns, world_from_image });
    };
    [0.0, 1.0, 9.0, 10.0].into_iter().for_each(&mut slice);
    let mut page = session.page();
    page.for_a_while();
    assert_eq!(session.broadcaster.marked(), 0, "nobody looks");
    page.say(&json!({ "do": "show", "slice": false, "view": true }));
    until("somebody looks", || session.broadcaster.is_watched());
    let picture = drawn(1);
    session.broadcaster.drawn(&picture, [0.0; 3]);
    let marks = page.word("marks");
    assert_eq!((&marks["sequence"], &marks["size"]), (&json!(1), &json!([80, 60])));
    let is_at = |found: &Value, at: DVec3| {
        let expected = picture.renderer.camera().project_world(at).unwrap().map(|place| place + 0.5);
        let found = [0, 1].map(|axis| found[axis].as_f64().unwrap());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 0.051), "{found:?} {expected:?}");
    };
    is_at(&marks["present"][2], DVec3::new(10.0, 10.0, 10.0));
    is_at(&marks["holes"][0][1], DVec3::new(10.0, 0.0, 5.0));
    assert_eq!(marks["holes"].as_array().unwrap().len(), 1);
    // Unchanged marks are not sent again; a slice elsewhere is.
    let counts = |page: &mut Client| {
        let (mut marks, mut accounts) = (0, 0);
        while accounts < 4 {
            let word = page.next_word();
            marks += u32::from(word.get("marks").is_some());
            accounts += u32::from(word.get("account").is_some());
        }
        marks
    };
    let before = session.broadcaster.marked();
    session.broadcaster.drawn(&drawn(2), [0.0; 3]);
    assert_eq!(counts(&mut page), 0);
    assert!(session.broadcaster.marked() > before, "it was looked at");
    slice(11.0);
    is_at(&page.word("marks")["present"][0], DVec3::new(0.0, 0.0, 11.0));
    page.say(&json!({ "do": "show", "slice": false, "view": false }));
    until("nobody looks", || !session.broadcaster.is_watched());
    let before = session.broadcaster.marked();
    slice(12.0);
    assert_eq!((counts(&mut page), session.broadcaster.marked()), (0, before));
}

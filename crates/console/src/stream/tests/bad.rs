//! Misbehaving clients: they cost the session nothing, and good pages little.

use std::io::{Read as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use super::*;
use crate::Counts;

/// A session with a frame every 20 ms. Its thread returns the longest time that publishing a
/// frame took.
struct Moving {
    session: Session,
    ends: Arc<AtomicBool>,
    scanner: JoinHandle<Duration>,
}

impl Moving {
    fn new(size: [u32; 2]) -> Self {
        let session = Session::new();
        let ends = Arc::new(AtomicBool::new(false));
        let (broadcaster, reported) = (Arc::clone(&session.broadcaster), Arc::clone(&ends));
        let pixels: Arc<[u8]> = vec![7; (size[0] * size[1]) as usize].into();
        let scanner = std::thread::spawn(move || {
            let image = Image::new(size[0], size[1], Pixels::U8(pixels));
            let mut longest = Duration::ZERO;
            for item in 0.. {
                if reported.load(Ordering::Relaxed) {
                    break;
                }
                let begun = Instant::now();
                broadcaster.captured(&CapturedFrame { item, captured_ns: 0, image: &image });
                longest = longest.max(begun.elapsed());
                std::thread::sleep(Duration::from_millis(20));
            }
            longest
        });
        Self { session, ends, scanner }
    }

    fn counts(&self) -> &Counts {
        self.session.console.counts()
    }

    /// Opens a page that views the B-mode image.
    fn views(&self) -> Client {
        let mut page = self.session.page();
        page.say(&json!({ "do": "show", "slice": true, "view": false }));
        sees(&mut page, 1);
        page
    }

    /// Opens a WebSocket connection whose raw end this test holds.
    fn upgraded(&self) -> TcpStream {
        let mut stream = TcpStream::connect(self.session.address()).unwrap();
        let head = "GET /v1/stream HTTP/1.1\r\nhost: localhost\r\nconnection: upgrade\r\nupgrade: websocket\r\nsec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";
        stream.write_all(head.as_bytes()).unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(&answer, b"HTTP/1.1 101");
        stream
    }

    /// Checks that the stage was never delayed by a client: one that reads nothing would hold it up
    /// for [`SENDING`].
    fn was_not_held_up(self) {
        self.ends.store(true, Ordering::Relaxed);
        let longest = self.scanner.join().unwrap();
        assert!(longest < SENDING, "{longest:?}");
    }
}

/// Receives this many pictures, each newer than the last.
fn sees(page: &mut Client, count: u32) {
    let mut last = 0;
    for _ in 0..count {
        let picture = page.picture();
        assert!(sequence(&picture) > last);
        last = sequence(&picture);
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": last }));
    }
}

#[test]
fn idle_and_slow_connections_do_not_block_pages() {
    let moving = Moving::new([64, 48]);
    let mut page = moving.views();
    // Three times as many as there are slots; a third of them send a letter of a request from
    // time to time.
    let mut many: Vec<TcpStream> = (0..400).map(|_| TcpStream::connect(moving.session.address()).unwrap()).collect();
    let sentence = Arc::new(AtomicBool::new(false));
    let slow = std::thread::spawn({
        let ends = Arc::clone(&sentence);
        let mut slow = many.split_off(270);
        move || {
            for letter in "GET /status HTTP/1.1\r\nx: ".bytes().chain(std::iter::repeat(b'y')) {
                if ends.load(Ordering::Relaxed) {
                    return;
                }
                // Writing fails on connections that were closed.
                slow.iter_mut().for_each(|stream| drop(stream.write_all(&[letter])));
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    });
    // They are served while the others stay connected.
    sees(&mut page, 50);
    let mut late = moving.views();
    sees(&mut late, 10);
    until("those beyond the places gave way", || Counts::of(&moving.counts().evictions) >= 200);
    // When no other client comes, none of them stays for good.
    sentence.store(true, Ordering::Relaxed);
    slow.join().unwrap();
    for stream in &mut many {
        stream.set_read_timeout(Some(HANGS)).unwrap();
        let ended = stream.read(&mut [0; 256]);
        assert!(!matches!(&ended, Err(error) if error.kind() == std::io::ErrorKind::WouldBlock), "{ended:?}");
    }
    sees(&mut page, 10);
    moving.was_not_held_up();
}

#[test]
fn invalid_data_and_floods_end_and_good_pages_continue() {
    let moving = Moving::new([64, 48]);
    let mut page = moving.views();
    let address = moving.session.address();
    let long = format!("GET / HTTP/1.1\r\nhost: localhost\r\nx: {}\r\n\r\n", "y".repeat(64 << 10));
    let garbage: [&[u8]; 5] = [
        &[0xff; 5000],
        &[0; 5000],
        b"\r\n\r\n\r\n",
        long.as_bytes(),
        b"GET / HTTP/1.1\r\nhost: a\r\nhost: b\r\ncontent-length: -1\r\n\r\n",
    ];
    for bytes in garbage {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(HANGS)).unwrap();
        // The server may disconnect before everything is sent.
        let _ = stream.write_all(bytes);
        let mut sentence = Vec::new();
        let ended = stream.read_to_end(&mut sentence);
        assert!(!matches!(&ended, Err(error) if error.kind() == std::io::ErrorKind::WouldBlock), "{ended:?}");
        assert!(!String::from_utf8_lossy(&sentence).contains("200 OK"), "{sentence:?}");
    }
    // A client that sends requests without end and never reads, and pages that send more than a
    // user can.
    let mut asker = TcpStream::connect(address).unwrap();
    asker.set_write_timeout(Some(Duration::from_millis(500))).unwrap();
    let asks = "GET /metrics HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(100);
    while asker.write_all(asks.as_bytes()).is_ok() {}
    let mut babblers: Vec<Client> = (0..4).map(|_| Client::enter(address).0).collect();
    for babbler in &mut babblers {
        for _ in 0..2000 {
            if babbler.socket.send(Message::Text("{\"do\":\"zoom\",\"by\":0.0}".into())).is_err() {
                break;
            }
        }
        assert!(ends(babbler));
    }
    until("the babblers are counted", || Counts::of(&moving.counts().pages_cut_off) == 4);
    // Invalid frames: without a mask, and with a length beyond all bounds.
    for frame in [&[0x81, 2, b'{', b'}'][..], &[0x81, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 2, 3, 4]]
    {
        let mut stream = moving.upgraded();
        stream.write_all(frame).unwrap();
        stream.set_read_timeout(Some(HANGS)).unwrap();
        let mut sentence = Vec::new();
        let ended = stream.read_to_end(&mut sentence);
        assert!(!matches!(&ended, Err(error) if error.kind() == std::io::ErrorKind::WouldBlock), "{ended:?}");
    }
    sees(&mut page, 20);
    moving.was_not_held_up();
}

#[test]
fn stuck_pages_are_disconnected_and_free_their_slots() {
    let moving = Moving::new([1600, 1200]);
    let mut page = moving.views();
    // One reads a byte per second, one reads nothing, and one has no subscription and answers
    // no pings. Each sends its command in a frame masked with zeros.
    let show = |stream: &mut TcpStream, text: &str| {
        let mut frame = vec![0x81, 0x80 | text.len() as u8, 0, 0, 0, 0];
        frame.extend(text.bytes());
        stream.write_all(&frame).unwrap();
    };
    let message = r#"{"do":"show","slice":true,"view":false}"#;
    let [mut slow, mut stuck, mute] = std::array::from_fn(|_| moving.upgraded());
    show(&mut slow, message);
    show(&mut stuck, message);
    let begun = Instant::now();
    let reader = std::thread::spawn(move || {
        let mut byte = [0];
        // Reads until it is disconnected and the received data are used up, or until the time
        // is over.
        while begun.elapsed() < Duration::from_secs(12) && matches!(slow.read(&mut byte), Ok(1)) {
            std::thread::sleep(Duration::from_secs(1));
        }
    });
    while Counts::of(&moving.counts().pages_cut_off) < 2 {
        assert!(begun.elapsed() < HANGS, "{:?}", moving.counts());
        sees(&mut page, 5);
    }
    while Counts::of(&moving.counts().pages_cut_off) < 3 {
        assert!(begun.elapsed() < SILENT + HANGS, "{:?}", moving.counts());
        // This page sends nothing either, except its answers to pictures.
        sees(&mut page, 5);
    }
    assert!(begun.elapsed() >= SILENT, "it had the time to say something");
    reader.join().unwrap();
    // Seven more pages find a slot.
    let more: Vec<Client> = (0..7).map(|_| moving.session.page()).collect();
    drop((more, stuck, mute));
    moving.was_not_held_up();
}

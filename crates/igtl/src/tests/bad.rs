//! Misbehaving clients: they cost the session nothing, and other clients little.

use super::*;

/// Longest time of a publication that waits for no client: far less than these clients would take,
/// and enough for a machine with other work.
const AT_ONCE: Duration = Duration::from_secs(5);

/// Returns the longest time that a stage spent on publishing.
fn longest(hub: &Hub, how_often: u32) -> Duration {
    let published = slice(3);
    let kept = (0..how_often).map(|n| {
        let begun = Instant::now();
        hub.slice("Reference", n.into(), &published);
        hub.pose(["Probe", "Tracker"], &sample(f64::from(n)));
        begun.elapsed()
    });
    kept.max().unwrap()
}

#[test]
fn foreign_protocol_is_disconnected_and_damage_is_reported() {
    let bench = bench();
    for garbage in [
        &b"GET / HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\nUser-Agent: something\r\n\r\n"[..],
        &[0xff; 4000],
        &[0; 58],
    ] {
        let mut peer = Peer::at(bench.server.address());
        peer.stream.write_all(garbage).unwrap();
        assert!(peer.is_cut_off(Duration::from_secs(10)));
    }
    assert_eq!(bench.server.counts().nonsense.load(Ordering::Relaxed), 3);
    let mut peer = Peer::at(bench.server.address());
    let get = Message::new(fixed(""), TimeStamp::default(), Content::Text(Text::new("hello"))).bytes().unwrap();
    let mut damaged = get.clone();
    damaged[60] ^= 1;
    peer.stream.write_all(&damaged).unwrap();
    let reported =
        peer.until("that it was damaged", |m| matches!(&m.content, Content::Status(s) if s.code == Status::CHECKSUM));
    assert!(matches!(reported.content, Content::Status(status) if status.message.contains("the checksum is")));
    // A body of 1 MB is skipped and never stored.
    let large = Message::new(fixed("a"), TimeStamp(1), Content::Other(fixed("POINT"), vec![7; 1 << 20]));
    peer.stream.write_all(&large.bytes().unwrap()).unwrap();
    peer.until("that it was too large", |m| matches!(&m.content, Content::Status(s) if s.code == Status::OVERFLOW));
    // Repeated damage leads to disconnection.
    for _ in 0..20 {
        if peer.stream.write_all(&damaged).is_err() {
            break;
        }
    }
    assert!(peer.is_cut_off(Duration::from_secs(10)));
}

#[test]
fn thousand_silent_connections_do_not_delay_session() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    let idle: Vec<TcpStream> = (0..1000).filter_map(|_| TcpStream::connect(bench.server.address()).ok()).collect();
    assert!(idle.len() > 900, "{}", idle.len());
    let kept = longest(&bench.hub, 500);
    assert!(kept < AT_ONCE, "{kept:?}");
    peer.image("Image_Reference");
    let begun = Instant::now();
    let counts = bench.server.counts();
    while counts.served.load(Ordering::Relaxed) + counts.turned_away.load(Ordering::Relaxed) < idle.len() as u64 {
        assert!(begun.elapsed() < Duration::from_secs(20), "{counts:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(
        counts.served.load(Ordering::Relaxed) <= 8 && counts.turned_away.load(Ordering::Relaxed) > 900,
        "{counts:?}"
    );
    drop(idle);
    // Slots are free again.
    let begun = Instant::now();
    loop {
        let mut next = Peer::at(bench.server.address());
        if !next.is_cut_off(Duration::from_millis(200)) {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(20));
    }
}

#[test]
fn slow_reader_is_disconnected_without_delaying_others() {
    let bench = bench();
    // A volume larger than all socket buffers.
    let (ends, _, thread) = making(&bench.hub, [256, 256, 128]);
    let slow = std::thread::spawn({
        let address = bench.server.address();
        move || {
            let mut stream = TcpStream::connect(address).unwrap();
            let begun = Instant::now();
            let mut byte = [0];
            while begun.elapsed() < Duration::from_secs(40) {
                match stream.read(&mut byte) {
                    Ok(1) => std::thread::sleep(Duration::from_secs(1)),
                    _ => return begun.elapsed(),
                }
                // Only sending reveals that the other end is gone.
                if begun.elapsed() > Duration::from_secs(11) && stream.write_all(&[0]).is_err() {
                    return begun.elapsed();
                }
            }
            begun.elapsed()
        }
    });
    let mut peer = Peer::at(bench.server.address());
    let begun = Instant::now();
    while bench.server.counts().cut_off.load(Ordering::Relaxed) == 0 {
        assert!(begun.elapsed() < Duration::from_secs(35), "{:?}", bench.server.counts());
        let kept = longest(&bench.hub, 20);
        assert!(kept < AT_ONCE, "{kept:?}");
        peer.image("Image_Reference");
    }
    assert!(begun.elapsed() > Duration::from_secs(8), "{:?}", begun.elapsed());
    assert!(slow.join().unwrap() < Duration::from_secs(40));
    assert!(bench.server.counts().replaced.load(Ordering::Relaxed) > 0, "what it did not take was replaced");
    ends.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

#[test]
fn endless_volume_requests_are_rate_limited() {
    let bench = bench();
    let (ends, made, thread) = making(&bench.hub, [5, 4, 3]);
    let mut peer = Peer::at(bench.server.address());
    // Requests that wait are one. As many are sent as a client may send in a second.
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(1) || made.lock().unwrap().len() < 2 {
        if begun.elapsed() < Duration::from_secs(1) {
            (0..6).for_each(|_| peer.get("IMAGE", "Volume_Reference"));
        }
        std::thread::sleep(Duration::from_millis(20));
        assert!(begun.elapsed() < Duration::from_secs(60));
    }
    let made = made.lock().unwrap().len() as u32;
    let most = 2 + begun.elapsed().div_duration_f64(hub::REQUESTED_EVERY) as u32;
    assert!(made <= most, "{made} of at most {most}");
    ends.store(true, Ordering::Relaxed);
    thread.join().unwrap();
}

//! Clients at other addresses. Those of the loopback network stand for other machines.

use super::*;

/// A client that connects from this address.
fn peer_from(own: &str, to: SocketAddr) -> Peer {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
    let stream = runtime.block_on(async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.bind(SocketAddr::new(own.parse().unwrap(), 0)).unwrap();
        socket.connect(to).await.unwrap().into_std().unwrap()
    });
    stream.set_nonblocking(false).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
    Peer { stream, decoder: Decoder::new(Limits::default()), received: Vec::new() }
}

impl Peer {
    /// Waits for a status message, with which the server greets its clients.
    fn status(&mut self) {
        self.until("the status", |message| message.content.kind() == *"STATUS");
    }
}

fn is_closed(peer: &mut Peer) -> bool {
    peer.is_cut_off(HANGS)
}

fn at(bench: &Bench) -> SocketAddr {
    (std::net::Ipv4Addr::LOCALHOST, bench.server.address().port()).into()
}

#[test]
fn address_of_other_machines_needs_a_network() {
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:0", "[::ffff:192.0.2.1]:0"] {
        let address: SocketAddr = address.parse().unwrap();
        let refused = served_at(address, &[]);
        assert!(matches!(refused, Err(IgtlError::NoNetwork { address: named }) if named == address), "{refused:?}");
    }
    for address in ["127.0.0.1:0", "127.0.0.2:0", "[::ffff:127.0.0.1]:0"] {
        served_at(address.parse().unwrap(), &[]).unwrap();
    }
    served_at("0.0.0.0:0".parse().unwrap(), &["192.0.2.0/24"]).unwrap();
}

#[test]
fn connections_outside_networks_are_closed_and_counted() {
    for address in ["0.0.0.0:0", "[::]:0"] {
        let bench = bench_at(address, &["127.0.1.0/24"]);
        let mut local = Peer::at(at(&bench));
        local.status();
        let mut allowed = peer_from("127.0.1.7", at(&bench));
        allowed.status();
        assert!(is_closed(&mut peer_from("127.0.2.7", at(&bench))), "{address}");
        let numbers = bench.server.counts().numbers();
        assert_eq!((numbers.served, numbers.not_allowed, numbers.turned_away), (2, 1, 0), "{address}");
        let sentence = bench.server.counts().sentence().unwrap();
        assert!(sentence.starts_with("OpenIGTLink: 2 clients, 1 refused as not allowed"), "{sentence}");
    }
}

#[test]
fn ipv6_address_of_this_machine_is_served() {
    let server = served_at("[::1]:0".parse().unwrap(), &["192.0.2.0/24"]);
    let server = server.unwrap_or_else(|error| panic!("this test needs IPv6 at the loopback interface: {error}"));
    Peer::at(server.address()).status();
    assert_eq!(server.counts().numbers().served, 1);
}

#[test]
fn newly_forbidden_client_is_disconnected() {
    let bench = bench_at("0.0.0.0:0", &["127.0.1.0/24", "127.0.2.0/24"]);
    let mut peers = ["127.0.1.7", "127.0.2.7"].map(|own| peer_from(own, at(&bench)));
    peers.iter_mut().for_each(|peer| peer.status());
    bench.server.allow(&networks(&["127.0.2.0/24", "127.0.3.0/24"]));
    assert!(is_closed(&mut peers[0]));
    peers[1].get("STATUS", "");
    peers[1].status();
    peer_from("127.0.3.7", at(&bench)).status();
    assert!(is_closed(&mut peer_from("127.0.1.7", at(&bench))), "nor is it admitted again");
    assert_eq!(bench.server.counts().numbers().not_allowed, 2);
}

#[test]
fn one_address_takes_a_part_of_slots() {
    let bench = bench_at("0.0.0.0:0", &["127.0.1.0/24"]);
    let mut flood: Vec<Peer> = (0..8).map(|_| peer_from("127.0.1.7", at(&bench))).collect();
    flood.iter_mut().for_each(|peer| peer.status());
    assert!(is_closed(&mut peer_from("127.0.1.7", at(&bench))));
    peer_from("127.0.1.8", at(&bench)).status();
    let numbers = bench.server.counts().numbers();
    assert_eq!((numbers.served, numbers.turned_away), (9, 1));
}

#[test]
fn too_many_messages_end_the_connection() {
    let bench = bench();
    let mut peer = Peer::at(bench.server.address());
    let text = Message::new(fixed(""), TimeStamp::default(), Content::Text(Text::new("hello"))).bytes().unwrap();
    // More than two seconds permit, wherever the seconds begin.
    let all = text.repeat(1000);
    let _ = peer.stream.write_all(&all);
    assert!(is_closed(&mut peer));
    let numbers = bench.server.counts().numbers();
    assert_eq!((numbers.too_many, numbers.cut_off), (1, 0), "{numbers:?}");
}

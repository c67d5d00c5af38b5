//! `--igtl`: a session as an OpenIGTLink server, and another session that uses it as its
//! devices.

use std::io::Read as _;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::daemon::{SMALL, Session, ask};
use super::place::Place;

/// A small virtual bedside, quickly simulated.
const SHOWN: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n[grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n[volume]\nspacing_mm = 1.0\n";
/// Longest wait for a message; longer than anything takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A session that serves data; killed if the test fails.
struct ReceivedImage {
    child: Child,
    port: String,
}

impl Drop for ReceivedImage {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl ReceivedImage {
    fn begin(place: &Place) -> Self {
        place.put("shown.toml", SHOWN);
        let child = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
            .args(["live", "--config", "shown.toml", "--headless", "--duration", "100", "--igtl=127.0.0.1:0"])
            .current_dir(place.path(""))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(std::fs::File::create(place.path("shown")).unwrap())
            .spawn()
            .unwrap();
        let mut shown = Self { child, port: String::new() };
        let begun = Instant::now();
        while shown.port.is_empty() {
            let said = String::from_utf8(place.get("shown")).unwrap();
            assert!(begun.elapsed() < PATIENCE, "{said}");
            if let Some((_, rest)) = said.split_once("OpenIGTLink at 127.0.0.1:")
                && let Some((port, _)) = rest.split_once('\n')
            {
                shown.port = port.to_owned();
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        shown
    }
}

#[test]
fn session_can_use_another_session_as_devices() {
    let place = Place::new();
    let shown = ReceivedImage::begin(&place);
    let port = &shown.port;
    place.put(
        "b.toml",
        format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[calibration]\nimage_to_probe = [0.2, 0, 0, 0, 0, 0.2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nclip_px = \"none\"\n\
             [remote]\naddress = \"127.0.0.1:{port}\"\nreference = \"ReferenceToTracker\"\n[grabber]\ndevice = \"openigtlink:127.0.0.1:{port}\"\ninput = \"Image_Reference\"\n[volume]\nspacing_mm = 1.0\n"
        ),
    );
    let check = place.run("live --config b.toml --check --json");
    let report: Value = serde_json::from_str(&check.stdout).unwrap_or_else(|e| panic!("{e}: {}", check.stderr));
    let checks = report["checks"].as_array().unwrap();
    let of = |what: &str| {
        let found = checks.iter().find(|checked| checked["what"] == what).unwrap();
        found["says"].to_string()
    };
    assert_eq!(check.code, 0, "{report}");
    let server = of("server");
    assert!(
        server.contains("probe      ProbeToTracker at") && server.contains("reference  ReferenceToTracker at"),
        "{server}"
    );
    assert!(of("grabber").contains("96×80 pixels, grey"), "{report}");
    place.does("live --config b.toml --quiet --duration 4 --record r -o v.mha --json=s.json");
    let statistics: Value = serde_json::from_slice(&place.get("s.json")).unwrap();
    let frames = &statistics["frames"];
    let used = frames["used"].as_u64().unwrap();
    // 30 per second; the first ones have no pose yet.
    assert!(used > 30, "{frames}");
    // Network data are recorded, and the replay gives the same result.
    let recorded = std::fs::read_dir(place.path("r")).unwrap().next().unwrap().unwrap().file_name();
    let again = place.run(&format!("replay r/{} -o again.mha", recorded.to_str().unwrap()));
    assert!(again.code == 0 && again.stderr.contains("bit by bit"), "{}", again.stderr);
    assert!(place.get("again.mha") == place.get("v.mha"), "another volume");
    drop(shown);
    let gone = place.run("live --config b.toml --check");
    assert!(gone.code == 1 && gone.stdout.contains("check that the server runs there"), "{}", gone.stdout);
}

#[test]
fn occupied_address_and_incomplete_flags_are_refused() {
    let place = Place::new();
    place.put("b.toml", SHOWN);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let run = place.run(&format!("live --config b.toml --headless --duration 1 --igtl={address} --record r"));
    assert!(run.code == 1 && run.stderr.contains(&format!("--igtl: cannot listen at {address}")), "{}", run.stderr);
    assert!(!place.path("r").exists(), "and nothing was begun");
    let run = place.run("live --config b.toml --igtl-save x");
    assert!(run.code == 2 && run.stderr.contains("--igtl"), "{}", run.stderr);
}

#[test]
fn address_of_other_machines_needs_allowed_network() {
    let place = Place::new();
    place.put("b.toml", SHOWN);
    let refusal = ["--igtl: cannot listen at 0.0.0.0:0", "under allow in [igtl]", "--igtl-allow lists them, too"];
    place.refuses("live --config b.toml --headless --duration 1 --igtl=0.0.0.0:0 --record r", &refusal);
    assert!(!place.path("r").exists(), "and nothing was begun");
    let run = place.run("demo --headless --duration 1 --igtl=[::]:0");
    assert!(run.code == 1 && run.stderr.contains("cannot listen at [::]:0"), "{}", run.stderr);
    for (flag, expected) in [
        ("0.0.0.0/0", "holds all addresses"),
        ("10.0.0.1/8", "give \"10.0.0.0/8\" for the network"),
        ("ward", "\"ward\" is not a network"),
    ] {
        let run = place.run(&format!("live --config b.toml --igtl=0.0.0.0:0 --igtl-allow {flag}"));
        assert!(run.code == 2 && run.stderr.contains(expected), "{}", run.stderr);
    }
    let run = place.run("live --config b.toml --igtl-allow 10.0.0.0/8");
    assert!(run.code == 2 && run.stderr.contains("--igtl"), "{}", run.stderr);
}

/// A connection from this address; the address itself is of the loopback network.
fn connected(own: &str, port: u16) -> std::net::TcpStream {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build().unwrap();
    let stream = runtime.block_on(async {
        let socket = tokio::net::TcpSocket::new_v4().unwrap();
        socket.bind((own.parse::<std::net::Ipv4Addr>().unwrap(), 0).into()).unwrap();
        socket.connect((std::net::Ipv4Addr::LOCALHOST, port).into()).await.unwrap().into_std().unwrap()
    });
    stream.set_nonblocking(false).unwrap();
    stream
}

/// Whether the server closes this connection, which has sent nothing.
fn is_closed(stream: &mut std::net::TcpStream) -> bool {
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    // A served client is greeted with the status.
    !matches!(stream.read(&mut [0]), Ok(1))
}

#[test]
fn only_allowed_networks_are_served_as_reloaded() {
    let place = Place::new();
    place.put("b.toml", format!("{SMALL}[igtl]\nallow = [\"127.0.1.0/24\"]\n"));
    let words = "live --config b.toml --headless --igtl=0.0.0.0:0 --igtl-allow 127.0.5.5,127.0.6.0/24";
    let mut session = Session::at(place, words, &[]);
    let port: u16 = session.waits_for("an address", || {
        let log = session.log();
        log.split_once("OpenIGTLink at 0.0.0.0:")?.1.split_once('\n')?.0.parse().ok()
    });
    let greeting = "clients in 127.0.1.0/24, 127.0.5.5/32, 127.0.6.0/24 see slices and volume";
    session.waits_for("the networks", || session.log().contains(greeting).then_some(()));
    for (own, is_served) in
        [("127.0.0.1", true), ("127.0.1.9", true), ("127.0.5.5", true), ("127.0.5.6", false), ("127.0.2.9", false)]
    {
        assert_eq!(is_closed(&mut connected(own, port)), !is_served, "{own}");
    }
    session.waits_for("a word in the log", || {
        session.log().contains("OpenIGTLink connections were closed, the last one of 127.0.5.6").then_some(())
    });
    let address = session.address();
    let counted = |key: &str| {
        let status: Value = serde_json::from_str(&ask(&address, "localhost", "/status").1).unwrap();
        status["igtl"][key].as_u64()
    };
    session.waits_for("its count in the status", || (counted("not_allowed") == Some(2)).then_some(()));
    assert_eq!(counted("served"), Some(3));
    let metrics = ask(&address, "localhost", "/metrics").1;
    assert!(metrics.contains("sonoweave_igtl_refused_connections_total{reason=\"not_allowed\"} 2\n"), "{metrics}");
    // A reload replaces the configuration's networks, and keeps the flag's.
    let text = format!("{SMALL}[igtl]\nallow = [\"127.0.2.0/24\"]\n");
    session.place.put("b.toml", text);
    session.signal("-HUP");
    session.waits_for("the reload", || session.log().contains("from now on igtl.allow").then_some(()));
    session.waits_for("the new networks", || (!is_closed(&mut connected("127.0.2.9", port))).then_some(()));
    assert!(is_closed(&mut connected("127.0.1.9", port)) && !is_closed(&mut connected("127.0.6.1", port)));
    // An unusable list changes nothing.
    session.place.put("b.toml", format!("{SMALL}[igtl]\nallow = [\"0.0.0.0/0\"]\n"));
    session.signal("-HUP");
    session.waits_for("the refusal", || session.log().contains("so that the old one holds").then_some(()));
    assert!(!is_closed(&mut connected("127.0.2.9", port)) && is_closed(&mut connected("127.0.3.9", port)));
    assert_eq!(session.ends("-INT"), 0, "{}", session.log());
    assert!(session.log().contains("refused as not allowed"), "{}", session.log());
}

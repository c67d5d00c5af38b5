//! A session as a daemon: what it tells while it runs, over HTTP and to its service manager, and how it ends.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::place::Place;

/// A small virtual bedside, quickly painted, that tells how it is; port 0 is any that is free.
const SMALL: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n\
     [grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n[volume]\nspacing_mm = 1.0\n[picture]\nimage_size = \"64x64\"\n[status]\nlisten = \"127.0.0.1:0\"\n";
/// Longer than anything takes on a machine that has other things to do.
const PATIENCE: Duration = Duration::from_secs(120);

/// A session that runs; killed if the test fails.
struct Session {
    child: Child,
    place: Place,
    socket: UnixDatagram,
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Session {
    fn begin(words: &str, variables: &[(&str, &str)]) -> Self {
        let place = Place::new();
        place.put("b.toml", SMALL);
        let socket = UnixDatagram::bind(place.path("notify")).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let said = std::fs::File::create(place.path("stderr")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
            .args("live --config b.toml --stats s.json".split(' ').chain(words.split_whitespace()))
            .current_dir(place.path(""))
            .env("NOTIFY_SOCKET", place.path("notify"))
            .envs(variables.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said)
            .spawn()
            .unwrap();
        Self { child, place, socket }
    }

    fn said(&self) -> String {
        String::from_utf8(self.place.get("stderr")).unwrap()
    }

    /// Where it says that the status is to be had.
    fn address(&self) -> String {
        self.waits_for("an address", || {
            let said = self.said();
            let rest = said.split_once("status at http://")?.1;
            rest.split_once("/status\n").map(|(address, _)| address.to_owned())
        })
    }

    fn waits_for<T>(&self, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
        let begin = Instant::now();
        loop {
            if let Some(found) = look() {
                return found;
            }
            assert!(begin.elapsed() < PATIENCE, "no {what}: {}", self.said());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// What the service manager is told next.
    fn told(&self) -> String {
        let mut bytes = [0; 4096];
        let length = self.socket.recv(&mut bytes).unwrap_or_else(|e| panic!("{e}: {}", self.said()));
        String::from_utf8(bytes[..length].to_vec()).unwrap()
    }

    fn told_until(&self, what: &str) -> Vec<String> {
        let mut all = Vec::new();
        while all.last().is_none_or(|told: &String| !told.starts_with(what)) {
            all.push(self.told());
        }
        all
    }

    fn ends(&mut self, signal: &str) -> i32 {
        let killed = Command::new("kill").args([signal, &self.child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        self.child.wait().unwrap().code().unwrap_or(-1)
    }
}

fn ask(address: &str, host: &str, path: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let code = answer.split(' ').nth(1).unwrap().parse().unwrap();
    (code, answer.split_once("\r\n\r\n").unwrap().1.to_owned())
}

fn json(address: &str) -> Value {
    let (code, body) = ask(address, address, "/status");
    assert_eq!(code, 200, "{body}");
    serde_json::from_str(&body).unwrap_or_else(|e| panic!("{e}: {body}"))
}

fn sum(counts: &Value) -> u64 {
    counts.as_object().map_or(0, |counts| counts.values().map(|count| count.as_u64().unwrap()).sum())
}

/// Every frame and reading is accounted for exactly once; how many frames there are.
fn adds_up(numbers: &Value) -> u64 {
    let of = |value: &Value, key: &str| value[key].as_u64().unwrap_or(0);
    let frames = &numbers["frames"];
    let decided = of(frames, "used") + of(frames, "waiting") + sum(&frames["refused"]) + sum(&frames["dropped"]);
    assert_eq!(of(frames, "total"), decided, "{frames}");
    for readings in numbers["readings"].as_array().unwrap() {
        let decided = of(readings, "used") + of(readings, "dropped") + sum(&readings["refused"]);
        assert!(decided <= of(readings, "total"), "{readings}");
    }
    of(frames, "total")
}

#[test]
fn a_session_tells_how_it_is_and_ends_when_it_is_told_to() {
    let mut session = Session::begin("--record rec --picture p.png", &[("WATCHDOG_USEC", "6000000")]);
    let address = session.address();
    // It is ready once the devices run, and says how it goes; the watchdog hears of it as long as it moves.
    let told = session.told_until("READY=1");
    assert!(
        told.iter().all(|told| told.starts_with("STATUS=") || told == "READY=1" || told == "WATCHDOG=1"),
        "{told:?}"
    );
    session.told_until("WATCHDOG=1");

    let used = |numbers: &Value| numbers["frames"]["used"].as_u64().unwrap();
    let first = session.waits_for("frame in the volume", || Some(json(&address)).filter(|numbers| used(numbers) > 5));
    adds_up(&first);
    // Somebody who asks and never listens.
    let mut stuck = TcpStream::connect(&address).unwrap();
    stuck.write_all(b"GET /status HTTP/1.1\r\nHost: localhost\r\n").unwrap();
    let later = session.waits_for("progress", || Some(json(&address)).filter(|n| used(n) > used(&first) + 30));
    assert!(adds_up(&later) >= used(&later));
    for device in later["devices"].as_array().unwrap() {
        assert_eq!((&device["state"], &device["why"]), (&"running".into(), &"".into()), "{device}");
        assert!(device["bytes"].as_u64().unwrap() > 0 && device["last_reading_s_ago"].as_f64().is_some(), "{device}");
        assert!(!device["clocks"].as_array().unwrap().is_empty(), "{device}");
    }
    let latencies = &later["capture_to_volume"];
    assert!(latencies["count"].as_u64().unwrap() > 0 && latencies["median_ms"].as_f64().unwrap() > 0.0, "{latencies}");
    let recorded =
        session.waits_for("recording", || Some(json(&address)).filter(|n| n["recording"]["stored"].as_u64() > Some(0)));
    assert_eq!((&recorded["recording"]["lost"], &recorded["recording"]["trouble"]), (&0.into(), &"".into()));
    session.waits_for("picture", || Some(json(&address)).filter(|n| n["pictures"].as_u64() > Some(0)));

    let (code, metrics) = ask(&address, "localhost", "/metrics");
    let sample = |name: &str| -> f64 {
        let line = metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.unwrap_or_else(|| panic!("{name} in\n{metrics}")).parse().unwrap()
    };
    assert_eq!(code, 200);
    assert!(sample("sonoweave_frames_total{fate=\"used\",reason=\"\"}") >= used(&later) as f64);
    assert_eq!(sample("sonoweave_device_up{device=\"tracking\"}"), 1.0);
    assert_eq!(sample("sonoweave_device_up{device=\"grabber\"}"), 1.0);
    assert!(sample("sonoweave_recording_written_bytes_total") > 0.0 && sample("process_cpu_seconds_total") > 0.0);
    assert_eq!(ask(&address, "localhost", "/healthz"), (200, "moves\n".into()));
    assert_eq!(ask(&address, "example.org", "/status").0, 403);

    assert_eq!(session.ends("-TERM"), 0, "{}", session.said());
    let told = session.told_until("STOPPING=1");
    let line = told.iter().rev().find(|told| told.starts_with("STATUS=")).unwrap();
    assert!(line.contains(" slices of ") && line.contains(" frames"), "{line}");
    assert!(TcpStream::connect(&address).is_err(), "nobody listens any more");
    let stats = session.place.json("s.json");
    assert!(adds_up(&stats) >= adds_up(&later) && used(&stats) >= used(&later), "{stats}");
    assert_eq!(stats["frames"]["waiting"], 0);
    let recording = &stats["recording"];
    assert_eq!((&recording["messages"], &recording["lost"]), (&recording["stored"], &0.into()), "{recording}");
    // The same words for the same things.
    let keys = |numbers: &Value| numbers.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&stats), keys(&later));
    assert!(!session.said().contains("ERROR"), "{}", session.said());
}

#[test]
fn a_port_that_is_taken_is_said_before_anything_begins() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let place = Place::new();
    place.put("b.toml", SMALL.replace("127.0.0.1:0", &taken.local_addr().unwrap().to_string()));
    place.refuses(
        "live --quiet --config b.toml --record rec --stats s.json",
        &["status.listen: 127.0.0.1:", "cannot be listened at", "another session, or another program, has this port"],
    );
}

#[test]
fn what_threads_have_a_right_to_is_said_and_wanted_or_not() {
    let place = Place::new();
    let run = |realtime: &str| {
        place.put("b.toml", format!("{SMALL}[process]\nrealtime = \"{realtime}\"\n"));
        place.run("live --config b.toml --duration 0.5 --stats s.json")
    };
    let never = run("never");
    assert_eq!(never.code, 0, "{}", never.stderr);
    let scheduling = place.json("s.json")["scheduling"].clone();
    assert_eq!(scheduling, serde_json::json!({ "realtime": false, "memory_locked": false, "why": [] }));
    let permitted = run("if-permitted");
    assert_eq!(permitted.code, 0, "{}", permitted.stderr);
    let scheduling = place.json("s.json")["scheduling"].clone();
    let missing = ["realtime", "memory_locked"].iter().filter(|what| scheduling[**what] == false).count();
    assert_eq!(scheduling["why"].as_array().unwrap().len(), missing, "{scheduling}");
    for why in scheduling["why"].as_array().unwrap() {
        assert!(permitted.stderr.contains(why.as_str().unwrap()), "{}", permitted.stderr);
    }
    let required = run("required");
    assert_eq!(required.code, i32::from(missing > 0), "{}", required.stderr);
    assert_eq!(required.stderr.contains("process.realtime = \"required\": "), missing > 0, "{}", required.stderr);
}

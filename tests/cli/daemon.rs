//! A session as a daemon: its reports while it runs, over HTTP and to the service manager, and
//! its end.

use std::collections::BTreeSet;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::place::Place;

/// A small virtual bedside, quickly simulated, with a status server; port 0 is any free port.
pub(super) const SMALL: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\nreference_station = 2\n\
     [grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n[volume]\nspacing_mm = 1.0\n[picture]\nimage_size = \"64x64\"\n[record]\nfull_frame = true\n[virtual]\nscene = \"ramp\"\n[status]\nlisten = \"127.0.0.1:0\"\n";
/// Longer than anything takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A running session; killed if the test fails.
pub(super) struct Session {
    child: Child,
    pub(super) place: Place,
    socket: UnixDatagram,
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Session {
    pub(super) fn begin(words: &str, variables: &[(&str, &str)]) -> Self {
        Self::of(SMALL, words, variables)
    }

    fn of(bedside: &str, words: &str, variables: &[(&str, &str)]) -> Self {
        let place = Place::new();
        place.put("b.toml", bedside);
        Self::at(place, &format!("live --config b.toml --json=s.json {words}"), variables)
    }

    /// Starts a command that runs until a signal ends it.
    pub(super) fn at(place: Place, words: &str, variables: &[(&str, &str)]) -> Self {
        let socket = UnixDatagram::bind(place.path("notify")).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let log = std::fs::File::create(place.path("stderr")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
            .args(words.split_whitespace())
            .current_dir(place.path(""))
            .env("NOTIFY_SOCKET", place.path("notify"))
            .envs(variables.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap();
        Self { child, place, socket }
    }

    pub(super) fn log(&self) -> String {
        String::from_utf8(self.place.get("stderr")).unwrap()
    }

    /// Returns the address that the session prints.
    pub(super) fn address(&self) -> String {
        self.waits_for("an address", || {
            let log = self.log();
            let rest = log.split_once("console: http://")?.1;
            rest.split_once("/\n").map(|(address, _)| address.to_owned())
        })
    }

    pub(super) fn waits_for<T>(&self, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
        let begin = Instant::now();
        loop {
            if let Some(found) = look() {
                return found;
            }
            assert!(begin.elapsed() < PATIENCE, "no {what}: {}", self.log());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Returns the next notification to the service manager.
    fn notification(&self) -> String {
        let mut bytes = [0; 4096];
        let length = self.socket.recv(&mut bytes).unwrap_or_else(|e| panic!("{e}: {}", self.log()));
        String::from_utf8(bytes[..length].to_vec()).unwrap().trim_end().to_owned()
    }

    fn notified_until(&self, what: &str) -> Vec<String> {
        let mut all = Vec::new();
        while all.last().is_none_or(|sent: &String| !sent.starts_with(what)) {
            all.push(self.notification());
        }
        all
    }

    /// Uses the shell's own `kill`: a bare machine has no other.
    pub(super) fn signal(&self, signal: &str) {
        let killed = Command::new("sh").args(["-c", &format!("kill {signal} {}", self.child.id())]).status().unwrap();
        assert!(killed.success());
    }

    pub(super) fn ends(&mut self, signal: &str) -> i32 {
        self.signal(signal);
        self.child.wait().unwrap().code().unwrap_or(-1)
    }
}

pub(super) fn ask(address: &str, host: &str, path: &str) -> (u16, String) {
    request(address, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"))
}

/// Returns the answer to a request.
pub(super) fn request(address: &str, request: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
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

/// Checks that every frame and reading is counted exactly once; returns the number of frames.
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
fn session_reports_status_and_ends_on_request() {
    let mut session = Session::begin("--record rec --picture p.png", &[("WATCHDOG_USEC", "6000000")]);
    let address = session.address();
    // It reports that it is ready once the devices run, and its status. The watchdog is notified
    // while it progresses.
    let notified = session.notified_until("READY=1");
    assert!(
        notified.iter().all(|sent| sent.starts_with("STATUS=") || sent == "READY=1" || sent == "WATCHDOG=1"),
        "{notified:?}"
    );
    session.notified_until("WATCHDOG=1");

    let used = |numbers: &Value| numbers["frames"]["used"].as_u64().unwrap();
    let first = session.waits_for("frame in the volume", || Some(json(&address)).filter(|numbers| used(numbers) > 5));
    adds_up(&first);
    // A client that sends a request and never reads.
    let mut stuck = TcpStream::connect(&address).unwrap();
    stuck.write_all(b"GET /status HTTP/1.1\r\nHost: localhost\r\n").unwrap();
    let later = session.waits_for("progress", || Some(json(&address)).filter(|n| used(n) > used(&first) + 30));
    assert!(adds_up(&later) >= used(&later));
    let is_well = |device: &Value| {
        let has_come = device["bytes"].as_u64() > Some(0) && device["last_reading_s_ago"].is_number();
        device["state"] == "running" && device["why"] == "" && has_come && device["clocks"][0]["state"] == "locked"
    };
    let devices = |numbers: &Value| numbers["devices"].as_array().unwrap().iter().all(is_well);
    session.waits_for("device that is well", || Some(json(&address)).filter(devices));
    let latencies = &later["capture_to_volume"];
    assert!(latencies["count"].as_u64().unwrap() > 0 && latencies["median_ms"].as_f64().unwrap() > 0.0, "{latencies}");
    let recorded =
        session.waits_for("recording", || Some(json(&address)).filter(|n| n["recording"]["stored"].as_u64() > Some(0)));
    assert_eq!((&recorded["recording"]["lost"], &recorded["recording"]["trouble"]), (&0.into(), &"".into()));
    assert_eq!(json(&address)["pictures"], 0, "no page looks");

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

    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
    let notified = session.notified_until("STOPPING=1");
    let line = notified.iter().rev().find(|sent| sent.starts_with("STATUS=")).unwrap();
    assert!(line.contains(" slices of ") && line.contains(" frames"), "{line}");
    assert!(TcpStream::connect(&address).is_err(), "nobody listens any more");
    let stats = session.place.json("s.json");
    assert!(adds_up(&stats) >= adds_up(&later) && used(&stats) >= used(&later), "{stats}");
    assert_eq!(stats["frames"]["waiting"], 0);
    assert_eq!(stats["pictures"], 1, "the one that was wanted in the end");
    let recording = &stats["recording"];
    assert_eq!((&recording["messages"], &recording["lost"]), (&recording["stored"], &0.into()), "{recording}");
    // The same keys are used for the same values.
    let keys = |numbers: &Value| numbers.as_object().unwrap().keys().cloned().collect::<BTreeSet<_>>();
    // The scan guidance concerns the present only.
    let mut kinds = keys(&later);
    assert!(kinds.remove("coach"), "{kinds:?}");
    assert!(kinds.is_subset(&keys(&stats)), "{kinds:?} {:?}", keys(&stats));
    // Losses are reported as errors; on a machine with enough time there are none.
    let lost = |list: &Value| list.as_array().unwrap().iter().map(|of| of["lost"].as_u64().unwrap()).sum::<u64>();
    let dropped = stats["readings"][0]["dropped"].as_u64().unwrap() + sum(&stats["frames"]["dropped"]);
    let lost = lost(&stats["devices"]) + dropped;
    assert_eq!(session.log().contains("lost: "), lost > 0, "{lost}: {}", session.log());
}

#[test]
fn trace_is_complete_after_sigint() {
    let mut session = Session::begin("--record rec --picture p.png --trace t.json", &[]);
    let address = session.address();
    session.waits_for("frames", || Some(json(&address)).filter(|n| n["frames"]["used"].as_u64() > Some(20)));
    assert_eq!(session.ends("-INT"), 0, "{}", session.log());
    let events = session.place.json("t.json");
    let events = events.as_array().unwrap();
    let frames = |name: &str, phase: &str| -> BTreeSet<u64> {
        let of = events.iter().filter(|event| event["name"] == name && event["ph"] == phase);
        of.map(|event| event["args"]["frame"].as_u64().unwrap()).collect()
    };
    let inserted = frames("insert", "X");
    let stats = session.place.json("s.json");
    let used = stats["frames"]["used"].as_u64().unwrap();
    assert!(used > 20 && inserted.len() as u64 >= used, "{used} used, {} inserted", inserted.len());
    for (stage, phase) in [("capture", "X"), ("pair", "X"), ("wait for pose", "b"), ("record", "X")] {
        let missing: Vec<_> = inserted.difference(&frames(stage, phase)).copied().collect();
        assert!(missing.is_empty(), "{stage} lacks {missing:?}");
    }
    // A picture shows several slices; the last one shows all.
    let slices = events.iter().filter(|event| event["name"] == "draw").map(|event| event["args"]["slices"].as_u64());
    assert_eq!(slices.max(), Some(Some(used)));
    let waits = |phase: &str| events.iter().filter(|event| event["ph"] == phase).count();
    assert_eq!(waits("b"), waits("e"));
    let names: BTreeSet<&str> = events
        .iter()
        .filter(|event| event["name"] == "thread_name")
        .filter_map(|event| event["args"]["name"].as_str())
        .collect();
    for thread in ["capture-grabber", "pairing", "insertion", "picture", "recorder"] {
        assert!(names.contains(thread), "{names:?}");
    }
    let left_out = events.iter().find(|event| event["name"] == "left_out").unwrap();
    assert_eq!(left_out["args"]["events"], 0);
}

#[test]
fn second_signal_ends_at_once_with_usable_recording() {
    let mut session = Session::begin("--record r -o v.mha --quiet", &[]);
    session.notified_until("READY=1");
    let recorded = session.waits_for("recording", || {
        let mut files = std::fs::read_dir(session.place.path("r")).ok()?;
        let path = files.next()?.ok()?.path();
        (path.metadata().ok()?.len() > 100_000).then_some(path)
    });
    let process = session.child.id();
    let both = format!("kill -INT {process}; kill -TERM {process}");
    assert!(Command::new("sh").args(["-c", &both]).status().unwrap().success());
    assert_eq!(session.child.wait().unwrap().code(), Some(1), "{}", session.log());
    assert!(!session.place.path("v.mha").exists(), "nothing more is written");
    let repaired = session.place.path("repaired.mcap");
    let inspected = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
        .arg("repair")
        .arg(&recorded)
        .arg("-o")
        .arg(&repaired)
        .output()
        .unwrap();
    assert!(inspected.status.success(), "{}", String::from_utf8_lossy(&inspected.stderr));
    assert!(repaired.metadata().unwrap().len() > 50_000);
}

#[test]
fn reconstruct_writes_trace() {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 150x136 --pixel 0.2 --frames 12 --gap 0.4");
    place.does("reconstruct s.mha -o v.mha --clip none --trace t.json");
    let events = place.json("t.json");
    let inserted = events.as_array().unwrap().iter().filter(|event| event["name"] == "insert").count();
    assert_eq!(inserted, 12, "{events}");
}

#[test]
fn sighup_reloads_settings_and_notifies_manager() {
    let mut session = Session::begin("", &[]);
    let address = session.address();
    session.notified_until("READY=1");
    session.place.put("b.toml", SMALL.replace("[volume]", "[scanner]\nfrozen_s = 0.75\n[volume]"));
    session.signal("-HUP");
    let notified = session.notified_until("RELOADING=1");
    let at: u64 = notified.last().unwrap().split_once("MONOTONIC_USEC=").unwrap().1.parse().unwrap();
    assert!(at > 0);
    session.notified_until("READY=1");
    session.waits_for("new setting", || Some(json(&address)).filter(|n| n["config"]["scanner.frozen_s"] == 0.75));
    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
}

#[test]
fn occupied_port_is_refused_at_start() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let place = Place::new();
    place.put("b.toml", SMALL.replace("127.0.0.1:0", &taken.local_addr().unwrap().to_string()));
    place.refuses(
        "live --quiet --config b.toml --record rec --json=s.json",
        &["status.listen: ", "cannot listen at", "another session or program uses this port"],
    );
}

#[test]
fn public_address_without_tls_and_token_is_refused() {
    let place = Place::new();
    place.put("b.toml", SMALL.replace("127.0.0.1:0", "0.0.0.0:0"));
    let says = [
        "status.listen: other machines can reach 0.0.0.0:0",
        "[status] has no certificate, no key and no token_file: give them",
    ];
    place.refuses("live --quiet --config b.toml --record rec --json=s.json", &says);
    place.put("b.toml", SMALL);
    place.refuses("live --quiet --config b.toml --record rec --console 0.0.0.0:0", &says);
    let checked = place.run("live --config b.toml --check");
    assert_eq!(checked.code, 0, "{}", checked.stderr);
    // The key file belongs to another certificate.
    place.put("b.toml", SMALL.replace("[status]\n", "[status]\ncertificate = \"c.crt\"\nkey = \"c.crt\"\n"));
    place.put("c.crt", include_str!("../../crates/console/src/tests/bedside-3.crt"));
    let checked = place.run("live --config b.toml --check");
    assert!(checked.code == 1 && checked.stdout.contains("status.key: "), "{} {}", checked.stdout, checked.stderr);
    place.refuses("live --quiet --config b.toml --record rec", &["status.key: ", "c.crt: "]);
    let demo = place.run("demo --console 0.0.0.0:0");
    assert!(
        demo.code == 2
            && demo.stderr.contains("0.0.0.0 can be reached from other machines, and a demo has no password")
    );
}

#[test]
fn realtime_setting_controls_scheduling_request() {
    let place = Place::new();
    let run = |realtime: &str| {
        let volume = "[volume]\nmax_memory_gib = 0.1\n";
        place.put("b.toml", format!("{}[process]\nrealtime = \"{realtime}\"\n", SMALL.replace("[volume]\n", volume)));
        place.run("live --config b.toml --duration 0.5 --json=s.json")
    };
    for other in ["never", "if-permitted"] {
        let ran = run(other);
        assert_eq!(ran.code, 0, "{}", ran.stderr);
        let none = serde_json::json!({ "realtime": false, "memory_locked": false, "why": [] });
        assert_eq!(place.json("s.json")["scheduling"], none, "a virtual bedside asks for nothing");
    }
    let required = run("required");
    if required.code == 0 {
        let scheduling = &place.json("s.json")["scheduling"];
        assert_eq!(
            (&scheduling["realtime"], &scheduling["memory_locked"]),
            (&true.into(), &true.into()),
            "{scheduling}"
        );
    } else {
        let refused = required.stderr.strip_prefix("sonoweave: process.realtime = \"required\": ").unwrap();
        assert!(
            refused.contains("give the process RLIMIT_") || refused.contains("memory may be paged out"),
            "{refused}"
        );
    }
}

#[test]
fn fast_sweep_is_reported_with_holes_and_slow_is_good() {
    // 30 frames per second, 8 mm apart; the kernel closes gaps of 5.2 mm.
    let fast = SMALL.replace("scene = \"ramp\"", "scene = \"ramp\"\ngap_mm = 8.0\nframes = 300");
    let session = Session::of(&fast, "", &[]);
    let address = session.address();
    let coach = session.waits_for("word of the speed", || {
        let coach = json(&address)["coach"].clone();
        let keys: Vec<_> = coach["advice"].as_array()?.iter().map(|advice| advice["key"].clone()).collect();
        (keys.contains(&"too-fast".into()) && keys.contains(&"holes".into())).then_some(coach)
    });
    assert_eq!(coach["speed"]["verdict"], "too-fast", "{coach}");
    let says = coach["speed"]["says"].as_str().unwrap();
    assert!(says.starts_with("too fast: ") && says.ends_with(" mm/s leaves no gaps"), "{says}");
    let number = |key: &str| coach["speed"][key].as_f64().unwrap();
    // Fewer slices arrive on a busy machine, at times that are less even.
    assert!((number("edge_mm_per_s") / 240.0 - 1.0).abs() < 0.25, "{coach}");
    assert!((number("gapless_mm_per_s") / (number("slices_per_s") * 5.1517) - 1.0).abs() < 0.001, "{coach}");
    assert!(coach["holes"]["open"].as_u64() > Some(0) && coach["holes"]["points"].as_u64() > Some(0), "{coach}");
    drop(session);
    let session =
        Session::of(&SMALL.replace("scene = \"ramp\"", "scene = \"ramp\"\ngap_mm = 0.6\nframes = 300"), "", &[]);
    let address = session.address();
    let good = session.waits_for("a good speed", || {
        let coach = json(&address)["coach"].clone();
        (coach["slices"].as_u64() > Some(60) && coach["speed"]["verdict"] == "good").then_some(coach)
    });
    // A busy machine may drop frames, but that is not the user's fault.
    assert!(good["advice"].as_array().unwrap().iter().all(|advice| advice["key"] != "too-fast"), "{good}");
    // 18 mm/s on average, by a hand that trembles.
    assert!((9.0..36.0).contains(&good["speed"]["mm_per_s"].as_f64().unwrap()), "{good}");
}

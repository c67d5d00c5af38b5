//! `--igtl`: a session as an OpenIGTLink server, and another session that uses it as its
//! devices.

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

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
    place.does("live --config b.toml --quiet --duration 4 --record r --volume v.mha --stats s.json");
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

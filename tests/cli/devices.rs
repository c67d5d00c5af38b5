//! `devices`: lists the devices of this machine.

use std::io::{BufRead as _, BufReader};
use std::process::Stdio;
use std::time::Duration;

use super::place::Place;

#[test]
fn devices_are_listed_as_text_and_json_with_udev_rules() {
    let place = Place::new();
    let said = place.does("devices");
    assert!(said.contains("found") || said.contains("plugged in"), "{said}");
    let found: serde_json::Value = serde_json::from_str(&place.does("devices --json")).unwrap();
    for device in found.as_array().unwrap() {
        assert!(device["id"].is_string() && !device["drivers"].as_array().unwrap().is_empty(), "{device}");
        assert!(device["unavailable"].is_null() || device["unavailable"].is_string(), "{device}");
        assert!(said.contains(device["id"].as_str().unwrap()), "{said}");
    }
    let rules = place.does("devices --udev");
    assert!(rules.contains("ATTR{idVendor}==\"0f44\"") && rules.contains("ATTR{latency_timer}=\"1\""), "{rules}");
    assert_eq!(place.run("devices --udev --json").code, 2);
}

#[test]
fn watch_prints_the_list_and_keeps_running() {
    let mut watching = crate::program().args(["devices", "--watch"]).stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let mut list = BufReader::new(watching.stdout.take().unwrap());
    list.read_line(&mut line).unwrap();
    // Time to end in, which a correct program never does.
    std::thread::sleep(Duration::from_millis(300));
    let ended = watching.try_wait().unwrap();
    watching.kill().unwrap();
    watching.wait().unwrap();
    assert!(!line.trim().is_empty() && ended.is_none(), "{line:?} {ended:?}");
}

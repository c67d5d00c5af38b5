//! `devices`: lists the devices of this machine.

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

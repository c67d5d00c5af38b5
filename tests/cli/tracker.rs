//! `calibrate tracker`: the noise of a still sensor, and a map of a room with metal in it.

use glam::{DAffine3, DQuat, DVec3};

use super::calibrate::tracked;
use super::place::Place;

/// Numbers that look like noise, between −1 and 1, the same each time.
fn scatter(index: usize, which: usize) -> f64 {
    let x = ((index * 7919 + which * 104_729) as f64 * 0.618_033_988_75).fract();
    (2.0 * x - 1.0) * 1.7
}

fn lying(drift_mm: f64) -> String {
    let reading = |index: usize| {
        let noise = DVec3::new(scatter(index, 1), scatter(index, 2), scatter(index, 3)) * 0.05;
        let turn = DQuat::from_scaled_axis(DVec3::new(scatter(index, 4), scatter(index, 5), scatter(index, 6)) * 5e-4);
        let at = DVec3::new(200.0 + drift_mm * index as f64 / 300.0, -40.0, 90.0) + noise;
        let status = if index == 7 { "INVALID" } else { "OK" };
        (index as f64 / 60.0, vec![("Probe", DAffine3::from_rotation_translation(turn, at), status)])
    };
    tracked(&(0..300).map(reading).collect::<Vec<_>>())
}

/// Two sensors on a piece of 100 mm, carried along x; beyond x = 350 metal pulls the second one away.
fn carried() -> String {
    let reading = |index: usize| {
        let t = index as f64 / 600.0;
        let one = DAffine3::from_rotation_translation(
            DQuat::from_rotation_z(4.0 * t),
            DVec3::new(100.0 + 400.0 * t, 20.0 * (9.0 * t).sin(), 150.0),
        );
        let mut other = one * DAffine3::from_translation(DVec3::new(0.0, 0.0, 100.0));
        if one.translation.x > 350.0 {
            other.translation.x += 4.0;
        }
        (index as f64 / 60.0, vec![("Probe", one, "OK"), ("Reference", other, "OK")])
    };
    tracked(&(0..600).map(reading).collect::<Vec<_>>())
}

#[test]
fn the_noise_of_a_still_sensor_is_told_and_one_that_moves_is_refused() {
    let place = Place::new();
    place.put("lying.igs.mha", lying(0.0));
    let said = place.does("calibrate tracker --sequence lying.igs.mha --report noise.json");
    let report = place.json("noise.json");
    let rms = report["position_rms_mm"].as_f64().unwrap();
    // Evenly spread over ±1.7·0.05 mm along three axes.
    assert!((rms / 0.085 - 1.0).abs() < 0.1, "{rms}");
    assert_eq!((&report["poses"]["usable"], &report["poses"]["read"]), (&299.into(), &300.into()));
    assert!(said.contains("refused: 1 pose_invalid") && said.contains("report: noise.json"), "{said}");
    place.put("moved.igs.mha", lying(30.0));
    place.refuses(
        "calibrate tracker --sequence moved.igs.mha --report moved.json",
        &["moved.igs.mha: the sensor has moved", "lay it down"],
    );
    place.refuses("calibrate tracker --sequence lying.igs.mha --sensor Stylus", &["nothing is called Stylus"]);
}

#[test]
fn a_map_of_the_room_names_the_places_where_metal_is() {
    let place = Place::new();
    place.put("carried.igs.mha", carried());
    let said = place.does("calibrate tracker --sequence carried.igs.mha --other Reference --report room.json");
    let report = place.json("room.json");
    assert!((report["distance_mm"].as_f64().unwrap() - 100.0).abs() < 0.01, "{report}");
    let cells = report["cells"].as_array().unwrap();
    assert!(cells.iter().any(|cell| cell["warned_of"] == true) && cells.iter().any(|cell| cell["warned_of"] == false));
    for cell in cells {
        let x = cell["low_mm"][0].as_f64().unwrap();
        assert_eq!(cell["warned_of"], x >= 350.0, "{cell}");
    }
    assert!(said.contains("metal bends the field there"), "{said}");
    let said = place.does("calibrate tracker --sequence carried.igs.mha --other Reference --limit 5");
    assert!(said.contains("are within 5 mm"), "{said}");
}

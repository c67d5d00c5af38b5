//! Phantoms that no single image determines: one N, N's in one plane, N's turned to each other.

use super::*;
use crate::error::ProbeError;
use crate::phantom::geometry::tests::three_ns;
use crate::tests::wire_scans::{Hand, places};

/// An operator's motion that brings the dots to all parts of the image.
const WIDE: Hand = Hand { turn: [0.35, 0.3, 0.3], shift: [9.0, 8.0, 12.0] };

fn phantom(wires: &[&[Wire]]) -> Geometry {
    Geometry::new("flat", wires.iter().map(|wires| wires.to_vec()).collect(), Vec::new()).unwrap()
}

/// Returns the wires of one layer, shifted sideways.
fn beside(wires: &[Wire], shift_mm: f64) -> Vec<Wire> {
    let wire = |wire: &Wire| Wire {
        name: format!("{}'", wire.name),
        ends_mm: wire.ends_mm.map(|end| end + DVec3::X * shift_mm),
    };
    wires.iter().map(wire).collect()
}

/// Returns the wires of one layer, turned by 40° about the middle of the phantom.
fn turned(wires: &[Wire]) -> Vec<Wire> {
    let middle = DVec3::new(35.0, 20.0, 0.0);
    let turn = |at: DVec3| middle + glam::DQuat::from_rotation_z(0.7) * (at - middle);
    wires.iter().map(|wire| Wire { ends_mm: wire.ends_mm.map(turn), ..wire.clone() }).collect()
}

/// Adds dots of no wire: an echo of all of them below, and some at random places, all fainter.
fn cluttered(observations: &mut [Observation], layout: &Layout, noise: &mut Noise) {
    let mut matcher = Matcher::new();
    for observation in observations {
        let echo = |dot: &Dot| Dot { at_px: dot.at_px + DVec2::new(0.0, 130.0), contrast: 30.0, ..*dot };
        let echoes: Vec<Dot> = observation.seen.dots.iter().map(echo).collect();
        observation.seen.dots.extend(echoes);
        for _ in 0..4 {
            let at_px = DVec2::new(noise.between(0.0, 819.0), noise.between(0.0, 615.0));
            observation.seen.dots.push(Dot { at_px, contrast: noise.between(10.0, 50.0) as f32, area_px: 30 });
        }
        observation.seen.dots.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
        observation.seen.reading = matcher.read(&observation.seen.dots, SIZE_PX, layout);
    }
}

/// Returns the largest error at the image's corners and centre, mm, and the largest predicted
/// standard deviation.
fn off(found: &Calibration, scan: &Scan) -> [f64; 2] {
    let off =
        |px: DVec2| [found.refined.plane.point(px).distance(scan.plane.point(px)), found.refined.predicted_mm(px)];
    places().map(off).into_iter().reduce(|a, b| [a[0].max(b[0]), a[1].max(b[1])]).unwrap()
}

#[test]
fn one_n_determines_plane() {
    let wires = three_ns().wires().to_vec();
    let mut noise = Noise::new(70);
    let scan = Scan::of(phantom(&[&wires[..3]]), WIDE, 150, Imperfect::default(), &mut noise);
    let observations = observed(&scan, &scan.layout);
    let found = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    assert!(found.used() >= 140 && off(&found, &scan)[0] < 1e-6, "{} {:?}", found.used(), off(&found, &scan));

    let scan = Scan::of(phantom(&[&wires[..3]]), WIDE, 150, GOOD, &mut noise);
    let mut observations = observed(&scan, &scan.layout);
    cluttered(&mut observations, &scan.layout, &mut noise);
    let found = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    let [mm, predicted] = off(&found, &scan);
    assert!(found.used() >= 135 && mm < 3.0 * predicted && predicted < 0.5, "{} {mm} {predicted}", found.used());
    assert!(found.validation.unwrap()[0].mean < 0.5);
}

#[test]
fn ns_side_by_side_determine_plane() {
    let wires = three_ns().wires().to_vec();
    let mut noise = Noise::new(71);
    let scan = Scan::of(phantom(&[&wires[..3], &beside(&wires[..3], -28.0)]), WIDE, 120, GOOD, &mut noise);
    let mut observations = observed(&scan, &scan.layout);
    cluttered(&mut observations, &scan.layout, &mut noise);
    let found = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    let [mm, predicted] = off(&found, &scan);
    assert!(found.used() >= 60 && mm < 3.0 * predicted && predicted < 0.5, "{} {mm} {predicted}", found.used());
}

#[test]
fn layers_turned_to_each_other_are_all_used() {
    let wires = three_ns().wires().to_vec();
    let mut noise = Noise::new(72);
    let crossed = phantom(&[&wires[..3], &turned(&wires[3..6])]);
    let scan = Scan::of(crossed, WIDE, 150, GOOD, &mut noise);
    let mut observations = observed(&scan, &scan.layout);
    cluttered(&mut observations, &scan.layout, &mut noise);
    let found = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap();
    let [mm, predicted] = off(&found, &scan);
    assert!(found.used() >= 130 && mm < 3.0 * predicted && predicted < 0.5, "{} {mm} {predicted}", found.used());
    let of_second = |picture: &Picture| picture.dots.iter().any(|dot| dot.wire >= 3 && dot.used);
    let count = found.pictures.iter().filter(|picture| of_second(picture)).count();
    let seen = scan.sightings.iter().filter(|sighting| sighting.marks.iter().any(|mark| mark.wire >= 3)).count();
    assert!(seen >= 100 && 10 * count >= 9 * seen, "{count} of {seen} pictures use a wire of the second layer");
}

#[test]
fn mirrored_row_of_dots_is_found_by_poses() {
    let wires = three_ns().wires().to_vec();
    let scan = Scan::of(phantom(&[&wires[..3]]), WIDE, 80, GOOD, &mut Noise::new(73));
    let mut observations = observed(&scan, &scan.layout);
    for dot in observations.iter_mut().flat_map(|observation| &mut observation.seen.dots) {
        dot.at_px.x = 819.0 - dot.at_px.x;
    }
    read_again(&mut observations, &scan.layout);
    let refused = calibrate(&scan.layout, &registration(&scan), recording(&observations), None).unwrap_err();
    assert!(
        matches!(refused, CalibrationError::Probe(ProbeError::Mirrored { pictures }) if pictures > 60),
        "{refused}"
    );
}

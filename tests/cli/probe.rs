//! `calibrate probe`: a scan of N-wires at a virtual bedside gives a calibration, and with it a
//! volume that shows the wires at their true positions.

use glam::{DVec2, DVec3};
use toml::Value;

use calibration::file::CalibrationFile;
use calibration::file::record::Record;

use super::place::{Place, Volume, matrix, numbers};

/// A tracker with noise, and a grabber with latency; the configuration contains neither.
const BEDSIDE: &str = r#"format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "320x240"
[volume]
spacing_mm = 0.3
[virtual]
scene = "n-wire"
frames = 240
tracker_noise_mm = 0.05
tracker_noise_deg = 0.05
[virtual.line]
jitter_ms = 0.5
[virtual.grabber]
latency_ms = 40.0
jitter_ms = 2.0
"#;

/// The same phantom, and the transducer's true calibration.
fn truth(place: &Place) {
    place.does(
        "phantom -o scan.mha --scene n-wire --frames 2 --image-size 320x240 --phantom phantom.toml --calibration truth.toml",
    );
}

/// Returns the phantom's wires in the world: their names and ends.
fn wires(place: &Place) -> Vec<(String, [DVec3; 2])> {
    let phantom = place.toml("phantom.toml");
    let held = matrix(&phantom["phantom_to_reference"]["matrix"]);
    let patterns = phantom["pattern"].as_array().unwrap().iter();
    let wire = |wire: &Value| {
        let end = |key: &str| held.transform_point3(DVec3::from_slice(&numbers(&wire[key])));
        (wire["name"].as_str().unwrap().to_owned(), ["from_mm", "to_mm"].map(end))
    };
    patterns.flat_map(|pattern| pattern["wire"].as_array().unwrap().iter().map(wire)).collect()
}

/// Interpolates between voxels, in the world; 0 outside.
fn grey(volume: &Volume, world: DVec3) -> f64 {
    let at = (world - DVec3::from_array(volume.header.origin)) / DVec3::from_array(volume.header.spacing);
    let (low, part) = (at.floor(), at - at.floor());
    let corner = |k: usize| {
        let up = DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2) as f64);
        let weight = (DVec3::ONE - part) * (DVec3::ONE - up) + part * up;
        let voxel = (low + up).to_array().map(|x| x as i64);
        f64::from(volume.at(voxel).unwrap_or(0.0)) * weight.x * weight.y * weight.z
    };
    (0..8).map(corner).sum()
}

/// Returns the centre of a wire's image at a position on its axis, as an offset across the wire,
/// mm. The image is the region brighter than half of the maximum. `None` if it is unseen.
fn middle(volume: &Volume, at: DVec3, direction: DVec3) -> Option<DVec2> {
    const STEP: f64 = 0.15;
    let (x, y) = direction.any_orthonormal_pair();
    let places = (-12..=12).flat_map(|i| (-12..=12).map(move |j| DVec2::new(f64::from(i), f64::from(j)) * STEP));
    let seen: Vec<(DVec2, f64)> = places.map(|p| (p, grey(volume, at + x * p.x + y * p.y))).collect();
    let brightest = seen.iter().map(|(_, grey)| *grey).fold(0.0, f64::max);
    let own = seen.iter().map(|(p, grey)| (*p, (grey - 0.5 * brightest).max(0.0)));
    let (sum, first) = own.fold((0.0, DVec2::ZERO), |(sum, first), (p, w)| (sum + w, first + p * w));
    (brightest > 80.0).then_some(first / sum)
}

/// Returns the errors of a volume's wires, mm, in their order. The first list is for every
/// second millimetre of the middle 28 mm of each wire. The second is for the line fitted through
/// a wire's centres, at both ends of these.
fn distances(place: &Place, volume: &str) -> [Vec<f64>; 2] {
    let volume = place.volume(volume);
    let (mut of_places, mut of_lines) = (Vec::new(), Vec::new());
    for (name, [from, to]) in wires(place) {
        let (direction, centre) = ((to - from).normalize(), from.midpoint(to));
        let own = (-7..=7).map(|n| 2.0 * f64::from(n));
        let own: Vec<(f64, DVec2)> =
            own.filter_map(|mm| Some((mm, middle(&volume, centre + direction * mm, direction)?))).collect();
        assert!(own.len() >= 13, "{name} is seen at {} of 15 places", own.len());
        of_places.extend(own.iter().map(|(_, off)| off.length()));
        // Least-squares line.
        let count = own.len() as f64;
        let (mm, off) = own.iter().fold((0.0, DVec2::ZERO), |(mm, off), own| (mm + own.0 / count, off + own.1 / count));
        let square: f64 = own.iter().map(|own| (own.0 - mm).powi(2)).sum();
        let slope = own.iter().map(|own| own.1 * (own.0 - mm)).sum::<DVec2>() / square;
        of_lines.extend([-14.0, 14.0].map(|end| (off + slope * (end - mm)).length()));
    }
    [of_places, of_lines].map(|mut all| {
        all.sort_by(f64::total_cmp);
        all
    })
}

#[test]
#[ignore = "takes 16 s of processor time: make stress"]
fn calibrated_session_shows_wires_at_true_positions() {
    let place = Place::new();
    let session = place.recorded(BEDSIDE, 9);
    truth(&place);
    // The data region of the frames is known; the image's pose and the latencies are not.
    let clip = place.toml("truth.toml")["image"]["clip_px"].to_string();
    place.put("probe.toml", format!("format = \"sonoweave-calibration\"\nversion = 1\n[image]\nclip_px = {clip}\n"));
    let said = place.does(&format!("calibrate probe --phantom phantom.toml --session {session} -o probe.toml"));
    assert!(said.contains("(the last third, with a calibration from the others)"), "{said}");
    assert!(said.contains("latency: video 0.0 ms, tracker -"), "{said}");
    let found = place.toml("probe.toml");
    let lag = found["latency"]["tracker_ms"].as_float().unwrap();
    assert!((lag + 40.0).abs() < 3.0, "{said}");
    let [centre, corner] = place.pixels_apart(["probe.toml", "truth.toml"], [320, 240]);
    let file = CalibrationFile::read(&place.path("probe.toml")).unwrap();
    place.is_recorded(&file.record, &[&session, "phantom.toml"]);
    place.knows_origin(&file.origins["latency"], &[&session, "phantom.toml"]);
    // The same as a preset, in another file.
    place.does(&format!("calibrate probe --phantom phantom.toml --session {session} --preset near -o presets.toml"));
    let presets = CalibrationFile::read(&place.path("presets.toml")).unwrap();
    assert_eq!((&presets.presets[0].record, presets.presets[0].name.as_str()), (&file.record, "near"));
    assert_eq!((presets.record, presets.probe_from_image), (Record::default(), None));
    let checked = place.does("inspect probe.toml");
    assert!(checked.contains("frames, 0.") && checked.contains("at the worst corner, made 20"), "{checked}");

    place.put("found.toml", BEDSIDE.replace("[tracker]", "[calibration]\nfile = \"probe.toml\"\n[tracker]"));
    let run = place.run(&format!("replay {session} --config found.toml -o volume.mha"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    let [places, lines] = distances(&place, "volume.mha");
    let ends = |all: &[f64]| [all[all.len() / 2], all[all.len() - 1]];
    let figures = format!(
        "median and most: places {:.3?}, lines {:.3?}; pixels {centre:.3} {corner:.3}; {said}",
        ends(&places),
        ends(&lines)
    );
    let ([median, most], [_, most_of_line]) = (ends(&places), ends(&lines));
    // The delays of a session differ from run to run. The limits are twice the largest of ten
    // runs: 0.11, 0.38, 0.19, 0.19 and 0.30 mm. A place is read between voxels of 0.3 mm, a line is
    // fitted to many.
    assert!(median < 0.22 && most < 0.76 && most_of_line < 0.38 && centre < 0.38 && corner < 0.6, "{figures}");

    // Poses of a sequence may have another latency; here they have none.
    place.does("phantom -o second.igs.mha --scene n-wire --frames 60 --image-size 320x240 --calibration second.toml");
    let run =
        place.run(&format!("calibrate probe --phantom phantom.toml --session {session} --validate second.igs.mha"));
    assert!(run.stderr.contains("note: one recording is a sequence and the other a session"), "{}", run.stderr);
}

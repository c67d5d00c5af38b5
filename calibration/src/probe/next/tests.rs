use super::*;
use crate::phantom::file::Registration;
use crate::probe::linear::start;
use crate::probe::refine::{OptionalUnknowns, refine};
use crate::probe::sighting::Sighting;
use crate::tests::noise::Noise;
use crate::tests::wire_scans::{Hand, Imperfect, SIZE_PX, Scan, places};

const GOOD: Imperfect = Imperfect { position_mm: 0.2, turn_deg: 0.1, dot_px: 1.0, lag_s: 0.0 };

const ALL: OptionalUnknowns = OptionalUnknowns { skew: false, registration: true, lag: true };

fn found(scan: &Scan, optional: OptionalUnknowns) -> Refined {
    let registration = Registration::new(scan.reference_from_phantom, Some(0.4)).unwrap();
    let map = |s: &Sighting| s.probe_from_phantom(&scan.track, 0.0, &registration.reference_from_phantom);
    let initial = start(&scan.layout, &scan.sightings, map, SIZE_PX).unwrap();
    refine(&scan.layout, &scan.sightings, &scan.track, &registration, &initial, optional).unwrap()
}

fn seen(scan: &Scan, refined: &Refined) -> Vec<Seen> {
    let of = |(sighting, used): (&Sighting, &Vec<bool>)| {
        let poses = scan.track.at(sighting.time_s + refined.lag_s)?;
        let dots_px = sighting.marks.iter().zip(used).filter_map(|(mark, used)| used.then_some(mark.at_px)).collect();
        Some(Seen { poses, dots_px })
    };
    scan.sightings.iter().zip(&refined.used).filter_map(of).collect()
}

fn ranked(scan: &Scan, refined: &Refined, pictures: usize) -> NextView {
    next_view(&scan.layout, refined, &seen(scan, refined), SIZE_PX, pictures).unwrap()
}

/// Returns the scan followed by images of a view.
fn with(scan: &Scan, candidate: &Candidate, pictures: usize, noise: &mut Noise) -> Scan {
    let mut scan = scan.clone();
    let picture = scan.plane.seen_by(&candidate.phantom_from_probe.affine());
    scan.hold(&picture, pictures, GOOD, noise);
    scan
}

/// A turn about v or a tilt about u is missing, with the other rotations present.
#[test]
fn missing_rotation_is_recommended() {
    for (turn, way) in [([0.3, 0.2, 0.0], Way::Turn), ([0.0, 0.2, 0.5], Way::Tilt)] {
        for seed in [7, 8, 9] {
            let scan = Scan::by(Hand { turn, ..Hand::FREE }, 60, GOOD, &mut Noise::new(seed));
            let next = ranked(&scan, &found(&scan, ALL), PICTURES);
            let best = next.best().unwrap();
            assert!(best.way == way && best.after_mm < 0.9 * next.now_mm, "{turn:?} {seed}: {next}");
            let held = next.ranked.iter().find(|candidate| candidate.way == Way::Held).unwrap();
            assert!(best.after_mm < 0.95 * held.after_mm, "{next:?}");
            assert!(
                next.to_string().contains(if way == Way::Turn { "about its long axis" } else { "u axis by" }),
                "{next}"
            );
        }
    }
}

/// Takes the recommended views and calibrates with them.
#[test]
fn predicted_error_is_reached() {
    let mut sums = [[0.0; 2]; 3];
    let seeds = 6;
    for seed in 0..seeds {
        let mut noise = Noise::new(50 + seed);
        let scan = Scan::by(Hand { turn: [0.3, 0.2, 0.0], ..Hand::FREE }, 40, GOOD, &mut noise);
        let next = ranked(&scan, &found(&scan, ALL), PICTURES);
        let held = next.ranked.iter().position(|candidate| candidate.way == Way::Held).unwrap();
        for (sum, place) in sums.iter_mut().zip([0, held / 2, held]) {
            let candidate = next.ranked[place];
            let with = found(&with(&scan, &candidate, PICTURES, &mut noise), ALL).largest_mm(SIZE_PX);
            sum[0] += candidate.after_mm / next.now_mm;
            sum[1] += with / next.now_mm;
        }
    }
    let [best, between, held] = sums.map(|[foreseen, found]| {
        assert!((found / foreseen - 1.0).abs() < 0.1, "{foreseen} {found} of {seeds}");
        found / seeds as f64
    });
    assert!(best < 0.93 * between && between < 0.98 * held && held < 1.0, "{best} {between} {held}");
}

/// The largest of the true errors, over many scans.
#[test]
fn true_error_shrinks_as_predicted() {
    let only = OptionalUnknowns { registration: false, lag: false, ..ALL };
    let (mut before, mut after, mut foreseen) = ([0.0; 5], [0.0; 5], 0.0);
    let seeds = 60;
    for seed in 0..seeds {
        let mut noise = Noise::new(300 + seed);
        let scan = Scan::by(Hand { turn: [0.1, 0.1, 0.0], ..Hand::FREE }, 16, GOOD, &mut noise);
        let refined = found(&scan, only);
        let best = *ranked(&scan, &refined, PICTURES).best().unwrap();
        let again = found(&with(&scan, &best, PICTURES, &mut noise), only);
        for (sums, refined) in [(&mut before, &refined), (&mut after, &again)] {
            for (sum, px) in sums.iter_mut().zip(places()) {
                *sum += refined.plane.point(px).distance_squared(scan.plane.point(px)) / seeds as f64;
            }
        }
        foreseen += best.after_mm * best.after_mm / seeds as f64;
    }
    let [before, after] = [before, after].map(|squares| squares.into_iter().fold(0.0, f64::max).sqrt());
    assert!((after / foreseen.sqrt() - 1.0).abs() < 0.25 && after < 0.85 * before, "{before} {after} {foreseen}");
}

#[test]
fn no_helpful_view_is_reported() {
    let scan = Scan::new(400, GOOD, &mut Noise::new(3));
    let next = ranked(&scan, &found(&scan, ALL), 1);
    assert_eq!(next.best(), None);
    assert!(next.to_string().starts_with("no view helps much: 1 more frames of the best one"), "{next}");
    let refined = found(&scan, ALL);
    assert_eq!(next_view(&scan.layout, &refined, &[], SIZE_PX, PICTURES), None);
}

#[test]
fn views_without_visible_wires_are_excluded() {
    let scan = Scan::new(40, GOOD, &mut Noise::new(4));
    let refined = found(&scan, ALL);
    let next = ranked(&scan, &refined, PICTURES);
    assert!(next.ranked.len() > 10 && next.ranked.windows(2).all(|two| two[0].after_mm <= two[1].after_mm));
    let region = Region::of(&seen(&scan, &refined), SIZE_PX).unwrap();
    for candidate in &next.ranked {
        let picture = refined.plane.seen_by(&candidate.phantom_from_probe.affine());
        assert!(marks(&scan.layout, &picture, region).unwrap().len() >= scan.layout.least_dots());
    }
    // The wires are 40 mm long, and the image was about their middle.
    let far = |candidate: &&Candidate| candidate.way == Way::Across && candidate.by.abs() > 15.0;
    assert!(next.ranked.iter().filter(far).count() <= 1, "{:?}", next.ranked);
}

/// u points to the right, v down, and the normal away from the viewer.
#[test]
fn motions_match_their_descriptions() {
    let picture = ImagePlane { u: DVec3::X * 0.1, v: DVec3::NEG_Z * 0.1, origin: DVec3::ZERO };
    let away = DVec3::Y;
    let about = DVec3::new(5.0, 0.0, -5.0);
    let top = DVec3::new(5.0, 0.0, 5.0);
    let right = DVec3::new(15.0, 0.0, -5.0);
    let goes = |way: Way, point: DVec3| way.motion(15.0, &picture, about).transform_point3(point) - point;
    assert!(goes(Way::Tilt, top).dot(away) < -2.0 && goes(Way::Tilt, right).length() < 1e-12);
    assert!(goes(Way::Turn, right).dot(away) < -2.0 && goes(Way::Turn, top).length() < 1e-12);
    assert!(goes(Way::Rock, top).x > 2.0 && goes(Way::Rock, right).z < -2.0);
    assert!(goes(Way::AlongU, top).distance(DVec3::X * 15.0) < 1e-12);
    assert!(goes(Way::AlongV, top).distance(DVec3::NEG_Z * 15.0) < 1e-12);
    assert!(goes(Way::Across, top).distance(DVec3::Y * 15.0) < 1e-12);
    assert_eq!(Way::Held.motion(0.0, &picture, about), DAffine3::IDENTITY);
    let text = |way, by| {
        Candidate { way, by, after_mm: 0.0, phantom_from_probe: Transform::from_affine(DAffine3::IDENTITY) }.to_string()
    };
    assert_eq!(text(Way::Tilt, 15.0), "tilt the probe about the image's u axis by +15° (its top towards you)");
    assert_eq!(text(Way::AlongV, -10.0), "shift the probe by -10 mm along the image's v (away from the phantom)");
}

use glam::{DAffine3, DMat3, DQuat, DVec2};

use super::*;
use crate::least_squares::tests::jacobian::check_jacobian;
use crate::probe::linear::start;
use crate::probe::plane::ImagePlane;
use crate::tests::coverage::Coverage;
use crate::tests::draws::draws;
use crate::tests::noise::{self, mahalanobis};
use crate::tests::wire_scans::{Imperfect, SIZE_PX, Scan, places};

const PLANE: OptionalUnknowns = OptionalUnknowns { skew: false, registration: false, lag: false };

fn registration(scan: &Scan, error_mm: f64) -> Registration {
    Registration::new(scan.reference_from_phantom, Some(error_mm)).unwrap()
}

fn found(scan: &Scan, registration: &Registration, optional: OptionalUnknowns) -> Refined {
    let map = |s: &Sighting| s.probe_from_phantom(&scan.track, 0.0, &registration.reference_from_phantom);
    let initial = start(&scan.layout, &scan.sightings, map, SIZE_PX).unwrap();
    refine(&scan.layout, &scan.sightings, &scan.track, registration, &initial, optional).unwrap()
}

/// Returns the largest distance at the corners and the centre, mm, and the angle between the
/// planes, degrees.
fn apart(a: &ImagePlane, b: &ImagePlane) -> (f64, f64) {
    let far = places().map(|px| a.point(px).distance(b.point(px))).into_iter().fold(0.0, f64::max);
    let axes = |p: &ImagePlane| DMat3::from_cols(p.u.normalize(), p.v.normalize(), p.u.cross(p.v).normalize());
    let turn = DQuat::from_mat3(&(axes(a) * axes(b).transpose())).to_scaled_axis().length();
    (far, turn.to_degrees())
}

#[test]
fn derivatives_match_finite_differences() {
    let scan = Scan::new(
        5,
        Imperfect { dot_px: 3.0, position_mm: 1.0, turn_deg: 1.0, lag_s: 0.05 },
        &mut noise::Noise::new(3),
    );
    let all = OptionalUnknowns { skew: true, registration: true, lag: true };
    let (problem, parameters) =
        Problem::new(&scan.layout, &scan.sightings, &scan.track, &registration(&scan, 0.4), &scan.plane, all);
    let used: Vec<Vec<bool>> = scan.sightings.iter().map(|s| vec![true; s.marks.len()]).collect();
    let start = parameters.start();
    let pictures = problem.pictures(&start, &used);
    assert_eq!(pictures.len(), 5);
    let whitenings: Vec<_> = pictures
        .iter()
        .map(|picture| problem.scattered(&start, picture).whitening(Scatter::USUAL.variances()))
        .collect();
    let prior = problem.prior();
    let mut noise = noise::Noise::new(4);
    for _ in 0..5 {
        let step: Vec<f64> = (0..parameters.steps()).map(|_| 0.02 * noise.normal()).collect();
        let check = check_jacobian(&parameters, &parameters.moved(&start, &step), |state, blocks| {
            problem.put(state, &pictures, &whitenings, blocks);
            problem.put_priors(state, Some(&prior), true, blocks);
        });
        assert!(check.largest < 1e-6, "{check:?}");
    }
}

#[test]
fn exact_dots_give_exact_plane() {
    let scan = Scan::new(40, Imperfect::default(), &mut noise::Noise::new(1));
    for optional in [PLANE, OptionalUnknowns { registration: true, lag: true, skew: true }] {
        let refined = found(&scan, &registration(&scan, 0.4), optional);
        let (far, turn) = apart(&refined.plane, &scan.plane);
        assert!(far < 1e-6 && turn.to_radians() < 1e-6, "{far} {turn} {optional:?}");
        assert!(refined.used.iter().flatten().all(|used| *used));
    }
}

#[test]
fn good_tracker_and_dots_give_fiftieth_of_mm() {
    let imperfect = Imperfect { position_mm: 0.05, turn_deg: 0.0, dot_px: 0.2, lag_s: 0.0 };
    let (mut way, mut turned, seeds) = (0.0, 0.0, 8);
    for seed in 0..seeds {
        let scan = Scan::new(300, imperfect, &mut noise::Noise::new(20 + seed));
        let refined = found(&scan, &registration(&scan, 0.4), PLANE);
        let (_, turn) = apart(&refined.plane, &scan.plane);
        let centre = places()[4];
        let at_centre = refined.plane.point(centre).distance(scan.plane.point(centre));
        way += at_centre * at_centre;
        turned += turn * turn;
        let Scatter { position_mm, turn_rad, dot_px } = refined.scatter;
        assert!((position_mm / 0.05 - 1.0).abs() < 0.1, "{:?}", refined.scatter);
        assert!(turn_rad.to_degrees() < 0.01, "{:?}", refined.scatter);
        assert!(dot_px.iter().all(|px| (px / 0.2 - 1.0).abs() < 0.1), "{:?}", refined.scatter);
    }
    let [way, turned] = [way, turned].map(|sum: f64| (sum / seeds as f64).sqrt());
    assert!(way < 0.02 && turned < 0.02, "{way} {turned}");
}

#[test]
fn predicted_error_matches_error() {
    let imperfect = Imperfect { position_mm: 0.3, turn_deg: 0.2, dot_px: 1.0, lag_s: 0.0 };
    let seeds = draws(400);
    let mut sums = [0.0; 5];
    let mut coverage = Coverage::new();
    for seed in 0..seeds {
        let scan = Scan::new(40, imperfect, &mut noise::Noise::new(1000 + seed));
        let refined = found(&scan, &registration(&scan, 0.4), PLANE);
        for (sum, px) in sums.iter_mut().zip(places()) {
            let error = refined.plane.point(px) - scan.plane.point(px);
            *sum += mahalanobis(error.to_array(), &refined.covariance_mm2(px));
        }
        coverage.add(&refined.plane, &refined.covariance().unwrap(), &scan.plane);
    }
    let means = sums.map(|sum| sum / seeds as f64);
    assert!(means.iter().all(|mean| (mean - 3.0).abs() < 3.0 * (6.0 / seeds as f64).sqrt()), "{means:?}");
    coverage.check("N-wires");
}

#[test]
fn lag_and_registration_error_are_fitted() {
    let imperfect = Imperfect { position_mm: 0.05, turn_deg: 0.03, dot_px: 0.5, lag_s: 0.3 };
    let scan = Scan::new(200, imperfect, &mut noise::Noise::new(5));
    let off = DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.01), DVec3::new(0.1, -0.2, 0.15));
    let given = Registration::new(scan.reference_from_phantom * Transform::from_affine(off), Some(0.5)).unwrap();
    let refined = found(&scan, &given, OptionalUnknowns { registration: true, lag: true, skew: false });
    assert!((refined.lag_s - 0.3).abs() < 0.003 && refined.lag_sd_s < 0.002, "{} {}", refined.lag_s, refined.lag_sd_s);
    let (far, _) = apart(&refined.plane, &scan.plane);
    let without = found(&scan, &given, PLANE);
    let (farther, _) = apart(&without.plane, &scan.plane);
    assert!(far < 0.3 && farther > 2.0 * far, "{far} {farther}");
    // The predicted error must hold.
    let worst = places().map(|px| refined.plane.point(px).distance(scan.plane.point(px)) / refined.predicted_mm(px));
    assert!(worst.into_iter().all(|sigmas| sigmas < 3.0), "{worst:?}");
}

#[test]
fn wrong_dots_and_images_are_left_out() {
    let imperfect = Imperfect { position_mm: 0.1, turn_deg: 0.05, dot_px: 0.5, lag_s: 0.0 };
    let mut scan = Scan::new(60, imperfect, &mut noise::Noise::new(6));
    let truth = scan.plane;
    for frame in (0..60).step_by(7) {
        scan.sightings[frame].marks[4].at_px += DVec2::new(25.0, -10.0);
    }
    scan.sightings[3].marks.iter_mut().for_each(|mark| mark.at_px += DVec2::new(70.0, 30.0));
    let refined = found(&scan, &registration(&scan, 0.4), PLANE);
    let (far, turn) = apart(&refined.plane, &truth);
    assert!(far < 0.2 && turn < 0.15, "{far} {turn}");
    assert!(refined.used[3].iter().all(|used| !used), "{:?}", refined.used[3]);
    for frame in (0..60).step_by(7) {
        assert!(!refined.used[frame][4]);
    }
    let left_out = refined.used.iter().flatten().filter(|used| !**used).count();
    assert!(left_out <= 9 + 9 + 1, "{left_out}");
}

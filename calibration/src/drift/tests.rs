//! Drift and slips of simulated sweeps that cross, and scans that show none.

use std::f64::consts::TAU;
use std::time::Instant;

use glam::{DAffine3, DQuat, DVec3};

use super::crossed::Crossed;
use super::*;
use crate::crossings::LEAST_LINES;
use crate::crossings::line::Lines;
use crate::crossings::state::{Change, State, rigid};
use crate::error::{DriftError, Motion};
use crate::tests::crossing_scans::{SIZE, probe_from_image};
use crate::tests::crossing_sweeps::{EACH_S, SWEEP_S, Sweeps, directions};
use crate::tests::noise::Noise as Random;

/// Errors of smoothed poses: 0.12 mm, 0.08°.
const SMOOTHED: [f64; 2] = [0.12, 0.08];

/// A motion of this size in any direction.
fn any(mm: f64, degrees: f64, random: &mut Random) -> [f64; 6] {
    let [t, r] = [mm, degrees.to_radians()].map(|size| random.vector(1.0).normalize() * size);
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// A quarter of a period within a sweep, about its greatest slope, and about its greatest value.
const DRIFTS: [fn(f64) -> f64; 3] =
    [|_| 0.0, |t| (TAU / 4.0 * t / SWEEP_S).sin(), |t| (TAU / 4.0 * t / SWEEP_S + TAU / 8.0).sin()];

/// Sweeps in three directions, of which the first does not drift.
fn drifting(mm: f64, degrees: f64, seed: u64) -> Sweeps {
    let mut random = Random::new(seed);
    let drift = DRIFTS.map(|shape| (any(mm, degrees, &mut random), shape)).to_vec();
    Sweeps { drift, ..Sweeps::of(&directions()) }
}

/// Returns the root mean square of the image's displacement from its true place, mm.
fn error_mm(sweeps: &Sweeps, slices: &Slices, correction: impl Fn(f64) -> DAffine3) -> f64 {
    let end = f64::from(SIZE - 1);
    let points: [DVec3; 9] = std::array::from_fn(|k| {
        DVec3::new(0.5 * end * f64::from((k % 3) as u8), 0.5 * end * f64::from((k / 3) as u8), 0.0)
    });
    let square = |(time_s, _): &(f64, Vec<u16>)| {
        let sweep = (time_s / EACH_S) as usize;
        let truth = sweeps.pose(sweep, time_s - EACH_S * sweep as f64) * probe_from_image();
        let found = slices.poses.at(*time_s).unwrap() * correction(*time_s) * probe_from_image();
        points.iter().map(|p| found.transform_point3(*p).distance_squared(truth.transform_point3(*p))).sum::<f64>()
            / 9.0
    };
    (slices.pixels.iter().map(square).sum::<f64>() / slices.pixels.len() as f64).sqrt()
}

/// Returns the errors before and after, mm, with the drift found, whether it is used or not.
fn found(sweeps: &Sweeps, seed: u64) -> ([f64; 2], Drift) {
    let slices = sweeps.scanned(&mut Random::new(2000 + seed));
    let begin = Instant::now();
    let drift = Drift::of(&slices, &Fitted::new(&slices, knots::PER_SWEEP).unwrap());
    let seconds = begin.elapsed().as_secs_f64();
    let errors = [
        error_mm(sweeps, &slices, |_| DAffine3::IDENTITY),
        error_mm(sweeps, &slices, |time_s| drift.at(time_s).unwrap()),
    ];
    println!(
        "{seed}: {:.3} to {:.3} mm (shift {:.3} ± {:.3}, largest {:.2} mm {:.2}°), {} lines, r {:.4} to {:.4}, {:?}, {seconds:.2} s",
        errors[0],
        errors[1],
        drift.shift_mm,
        drift.shift_se_mm,
        drift.largest_mm,
        drift.largest_deg,
        drift.lines,
        drift.correlations[0],
        drift.correlations[1],
        drift.unfit(),
    );
    (errors, drift)
}

/// Directions of four sweeps.
fn four() -> Vec<DQuat> {
    let last = DQuat::from_rotation_y(TAU / 8.0) * DQuat::from_rotation_x(-TAU / 12.0);
    directions().into_iter().chain([last]).collect()
}

/// Sweeps with smoothed poses, of a sensor that slipped before the third by some mm.
fn slipping(directions: &[DQuat], mm: f64, seed: u64) -> Sweeps {
    let by = any(mm, 0.0, &mut Random::new(seed));
    let shape = |sweep: usize| -> fn(f64) -> f64 { if sweep < 2 { |_| 0.0 } else { |_| 1.0 } };
    let drift = (0..directions.len()).map(|sweep| (by, shape(sweep))).collect();
    Sweeps { drift, wander: SMOOTHED, ..Sweeps::of(directions) }
}

fn scanned(sweeps: &Sweeps, seed: u64) -> Slices {
    sweeps.scanned(&mut Random::new(3000 + seed))
}

/// Returns the variant of a refusal.
fn refused<T: std::fmt::Debug>(result: Result<T, CalibrationError>) -> DriftError {
    match result {
        Err(CalibrationError::Drift(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn drift_is_found_with_exact_poses() {
    for seed in 0..2 {
        let sweeps = drifting(1.0, 1.0, seed);
        let ([before, after], drift) = found(&sweeps, seed);
        assert!(before > 0.6 && after < 0.05, "{seed}: {before} to {after}");
        assert!(drift.unfit().is_none() && drift.shift_se_mm < 0.25, "{seed}: {:?}", drift.unfit());
    }
}

#[test]
fn drift_is_found_with_errors_of_poses() {
    for seed in 0..3 {
        let sweeps = Sweeps { wander: SMOOTHED, ..drifting(1.0, 1.0, seed) };
        let ([before, after], drift) = found(&sweeps, seed);
        assert!(before > 0.6 && after < 0.3, "{seed}: {before} to {after}");
        assert!(drift.unfit().is_none(), "{seed}: {:?}", drift.unfit());
    }
}

/// A correction would harm them: only chance would be corrected.
#[test]
fn sweeps_without_drift_are_left_as_they_are() {
    for seed in 0..2 {
        for wander in [[0.0; 2], SMOOTHED] {
            let sweeps = Sweeps { wander, ..Sweeps::of(&directions()) };
            let (_, drift) = found(&sweeps, seed);
            assert!(matches!(drift.unfit(), Some(DriftError::Nothing { .. })), "{seed}: {:?}", drift.unfit());
        }
    }
    let slices = scanned(&Sweeps::of(&directions()), 0);
    assert!(matches!(refused(slices.drift()), DriftError::Nothing { shift_mm, .. } if shift_mm < 0.1));
}

#[test]
#[ignore = "minutes: many scans (make stress)"]
fn many_sweeps_without_drift_are_left_as_they_are() {
    let (mut most_mm, mut most_errors, mut squares) = (0.0_f64, 0.0_f64, [0.0; 2]);
    for seed in 0..40 {
        let (errors, drift) = found(&Sweeps { wander: SMOOTHED, ..Sweeps::of(&directions()) }, 100 + seed);
        most_mm = most_mm.max(drift.shift_mm);
        most_errors = most_errors.max(drift.shift_mm / drift.shift_se_mm);
        squares = [0, 1].map(|k| squares[k] + errors[k] * errors[k] / 40.0);
        assert!(matches!(drift.unfit(), Some(DriftError::Nothing { .. })), "{seed}: {:?}", drift.unfit());
    }
    println!("largest {most_mm:.3} mm, {most_errors:.2} standard errors; {:.3?} mm", squares.map(f64::sqrt));
}

#[test]
fn correction_holds_within_sweeps_alone() {
    let sweeps = drifting(1.0, 1.0, 4);
    let slices = scanned(&sweeps, 4);
    let drift = slices.drift().unwrap();
    assert_eq!(drift.sweeps.len(), 3);
    assert_eq!(drift.sweeps[0].knots, [[0.0; 6]; 3]);
    let within = |sweep: usize, time_s: f64| drift.at(EACH_S * sweep as f64 + time_s);
    assert!(within(0, 3.0).unwrap().abs_diff_eq(DAffine3::IDENTITY, 1e-12), "the first sweep is held");
    for time_s in [f64::NAN, -0.2, SWEEP_S + 0.2, EACH_S - 0.2, 30.0] {
        assert_eq!(drift.at(time_s), None, "{time_s}");
    }
    // Frames just beyond the slices that were compared belong to their sweep.
    let beyond = within(1, SWEEP_S + 0.1).unwrap();
    assert!(beyond.abs_diff_eq(within(1, SWEEP_S).unwrap(), 1e-12));
    // The correction undoes the drift, and the image's side is the right one.
    let of_pose = |sweep: usize, time_s: f64| sweeps.pose(sweep, time_s) * sweeps.drifted(sweep, time_s);
    for (sweep, time_s) in [(1, 0.5), (1, 3.1), (2, 1.7), (2, 5.0)] {
        let (truth, recorded) = (sweeps.pose(sweep, time_s) * probe_from_image(), of_pose(sweep, time_s));
        let at_s = EACH_S * sweep as f64 + time_s;
        let found = drift.corrected(at_s, recorded * probe_from_image(), probe_from_image()).unwrap();
        let middle = DVec3::new(47.5, 47.5, 0.0);
        let error = |world: DAffine3| world.transform_point3(middle).distance(truth.transform_point3(middle));
        assert!(error(found) < 0.1 && error(recorded * probe_from_image()) > 0.12, "{sweep} {time_s}");
    }
}

#[test]
fn order_of_pushes_does_not_matter() {
    let mut slices = scanned(&drifting(1.0, 1.0, 5), 5);
    let drift = slices.drift().unwrap();
    let n = slices.pixels.len();
    slices.pixels = (0..n).map(|k| slices.pixels[(k * 49 + 7) % n].clone()).collect();
    assert_eq!(slices.drift().unwrap(), drift);
}

#[test]
fn derivatives_by_one_slice_match_differences() {
    let slices = scanned(&Sweeps { noise: 0.0, ..drifting(1.0, 1.0, 6) }, 6);
    let start = State::of(&slices);
    let crossed = Crossed::of(&slices, &start).unwrap();
    let mut lines = Lines::new(&slices, &crossed.pairs[..60], 1.6);
    lines.smooth = lines.images.clone();
    let placing = start.placing(&slices);
    for (side, number) in (0..2).flat_map(|side| (0..knots::NUMBERS).map(move |number| (side, number))) {
        // So small that no point crosses into another pixel, where the slope has a kink.
        let step = if number < 3 { 1e-7 } else { 1e-8 };
        let (mut off, mut size) = (0.0, 0.0);
        for pair in lines.pairs {
            let along = |sign: f64| {
                let mut by = [0.0; knots::NUMBERS];
                by[number] = sign * step;
                let mut moved = placing.clone();
                let placed = moved.slices[pair[side]].as_mut().unwrap();
                placed.world_from_picture *= rigid(&by);
                lines.differences_moved(*pair, &placing, &moved)
            };
            let [low, at, high] = [along(-1.0), along(0.0), along(1.0)];
            for (((low, _), (_, by)), (high, _)) in low.iter().zip(&at).zip(&high) {
                let by = by[side][number];
                off += (by - (high - low) / (2.0 * step)).powi(2);
                size += by.powi(2);
            }
        }
        let ratio = (off / size).sqrt();
        println!("side {side}, number {number}: {ratio:.2e}");
        assert!(size > 0.0 && ratio < 1e-4, "side {side}, number {number}: {ratio}");
    }
}

#[test]
fn sweeps_that_show_no_drift_are_refused_by_name() {
    let [upright, turned, tilted] = directions();
    let of = |sweeps: &Sweeps| refused(scanned(sweeps, 5).drift());
    // Two sweeps in one direction cross by the hand's tilts alone.
    let few = of(&Sweeps::of(&[upright, upright]));
    assert!(
        matches!(few, DriftError::FewLines { least: LEAST_LINES, directions: 1, motion: Motion::Turn, .. }),
        "{few}"
    );
    assert!(few.to_string().ends_with("sweep the same place once more, with the probe turned by 90° about its axis"));
    // One sweep whose slices cross each other.
    let one = of(&Sweeps { tilts: 2.6, ..Sweeps::of(&[upright]) });
    assert!(matches!(one, DriftError::FewSweeps { sweeps: 1, motion: Motion::Turn }), "{one}");
    let body = vec![DVec3::ZERO, DVec3::ZERO, DVec3::new(1.5, 3.0, 2.0)];
    let moved = of(&Sweeps { body, ..Sweeps::of(&[upright, turned, tilted]) });
    assert!(matches!(moved, DriftError::Large { unit: "mm", .. }), "{moved}");
    // Images of other places.
    let mut slices = scanned(&Sweeps::of(&directions()), 5);
    let n = slices.pixels.len();
    let images: Vec<Vec<u16>> = slices.pixels.iter().map(|(_, pixels)| pixels.clone()).collect();
    slices.pixels.iter_mut().enumerate().for_each(|(slice, own)| own.1 = images[(slice * 49) % n].clone());
    assert!(matches!(refused(slices.drift()), DriftError::Unrelated { .. }));
    assert!(matches!(refused(slices.slipped()), DriftError::Unrelated { .. }));
    slices.pixels.iter_mut().for_each(|(_, pixels)| pixels.fill(25_600));
    assert!(matches!(refused(slices.drift()), DriftError::Unrelated { .. }), "there is nothing to see");
}

/// Planes without a normal, and times that are no numbers, cross nothing.
#[test]
fn degenerate_slices_are_refused() {
    let slices = scanned(&Sweeps::of(&directions()), 5);
    for axis in [DVec3::NAN, DVec3::ZERO, slices.probe_from_pixel.matrix3.x_axis * 2.0] {
        let mut of = slices.clone();
        of.probe_from_pixel.matrix3.y_axis = axis;
        assert!(matches!(refused(of.drift()), DriftError::FewLines { lines: 0, .. }), "{axis}");
        assert!(matches!(refused(of.slipped()), DriftError::FewLines { lines: 0, .. }), "{axis}");
    }
    let mut of = slices;
    of.pixels.iter_mut().for_each(|slice| slice.0 = f64::NAN);
    assert!(matches!(refused(of.drift()), DriftError::FewLines { lines: 0, .. }));
    of.pixels.clear();
    assert!(matches!(refused(of.drift()), DriftError::FewLines { lines: 0, .. }));
}

/// Limits of a correction, at either side of each.
#[test]
fn corrections_beyond_a_limit_are_refused() {
    let drift = Drift {
        sweeps: Vec::new(),
        probe_from_picture: DAffine3::IDENTITY,
        lines: 500,
        correlations: [0.8, 0.9],
        shift_mm: 0.5,
        shift_se_mm: 0.4,
        largest_mm: 2.9,
        largest_deg: 2.9,
    };
    assert_eq!(drift.unfit(), None);
    let of = |change: fn(&mut Drift)| {
        let mut changed = drift.clone();
        change(&mut changed);
        changed.unfit()
    };
    let nothing = |error| matches!(error, Some(DriftError::Nothing { .. }));
    assert!(nothing(of(|drift| drift.shift_se_mm = 0.6)) && nothing(of(|drift| drift.shift_se_mm = f64::NAN)));
    assert!(nothing(of(|drift| (drift.shift_mm, drift.shift_se_mm) = (0.29, 0.01))));
    assert!(matches!(of(|drift| drift.largest_mm = 3.1), Some(DriftError::Large { unit: "mm", .. })));
    assert!(matches!(of(|drift| drift.largest_deg = 3.1), Some(DriftError::Large { unit: "degrees", .. })));
    assert!(matches!(of(|drift| drift.largest_mm = f64::NAN), Some(DriftError::Large { .. })));
    assert!(matches!(of(|drift| drift.correlations[1] = 0.8), Some(DriftError::NoBetter { .. })));
}

/// Returns the correlations by the slip, and by one calibration of all sweeps.
fn compared(slices: &Slices, slip: &Slip) -> (bool, [f64; 2]) {
    let checked = slices.checked().unwrap();
    (slip.is_likelier_than(&checked), [slip.correlations[1], checked.correlations[1]])
}

#[test]
fn slip_is_named_with_its_sweep() {
    for (seed, directions) in [(0, four()), (1, directions().to_vec())] {
        let slices = scanned(&slipping(&directions, 1.0, seed), seed);
        let slip = slices.slipped().unwrap().unwrap();
        let (is_likelier, correlations) = compared(&slices, &slip);
        println!("{slip}; correlations {correlations:.4?}");
        assert!(is_likelier, "{correlations:?}");
        assert_eq!(slip.sweep, 2);
        assert!((slip.shift_mm - 1.0).abs() < 3.0 * slip.shift_se_mm && slip.shift_se_mm < 0.2, "{slip}");
        assert!(slip.between_s[0] < 2.0 * EACH_S && slip.between_s[1] >= 2.0 * EACH_S, "{slip:?}");
        let sentence = "the sensor slipped or the body moved before sweep 3: the image is displaced by ";
        assert!(slip.to_string().starts_with(sentence), "{slip}");
    }
}

/// Crossings see the body against the sensor: they do not tell which of them moved.
#[test]
fn body_that_moved_looks_like_a_slip() {
    let body = [0.0, 0.0, 1.0, 1.0].map(|mm| DVec3::new(0.6, 0.6, 0.53) * mm).to_vec();
    let slip = scanned(&Sweeps { body, ..Sweeps::of(&four()) }, 2).slipped().unwrap().unwrap();
    println!("{slip}");
    assert_eq!(slip.sweep, 2);
}

/// A latency that is off displaces a sweep that goes back against the others, as a slip does.
#[test]
fn wrong_latency_is_no_slip_though_a_sweep_goes_back() {
    let goes_back = |lag_s: f64, mm: f64, seed: u64| {
        let off = Change::from_fn(|k, _| if k == 8 { lag_s } else { 0.0 });
        scanned(&Sweeps { off, goes_back: true, ..slipping(&directions(), mm, seed) }, seed)
    };
    for (seed, lag_s) in [(0, 0.1), (1, -0.1)] {
        let slices = goes_back(lag_s, 0.0, seed);
        let slip = slices.slipped().ok().flatten().filter(|slip| compared(&slices, slip).0);
        assert_eq!(slip, None, "{lag_s}");
    }
    let slices = goes_back(0.0, 1.0, 3);
    let (slip, checked) = (slices.slipped().unwrap().unwrap(), slices.checked().unwrap());
    assert!(slip.is_likelier_than(&checked), "{slip}");
    // As of sweeps that one calibration explains.
    let mut alike = checked;
    alike.correlations[1] = slip.correlations[1];
    assert!(!slip.is_likelier_than(&alike), "{slip}");
}

#[test]
fn calibration_off_in_all_sweeps_is_no_slip() {
    for seed in 0..2 {
        let by = any(1.0, 1.0, &mut Random::new(7 + seed));
        let off = Change::from_fn(|k, _| by.get(k).copied().unwrap_or(0.0));
        let sweeps = Sweeps { off, wander: SMOOTHED, ..Sweeps::of(&directions()) };
        let error = refused(scanned(&sweeps, seed).slipped());
        assert!(matches!(error, DriftError::Calibration { .. }), "{seed}: {error}");
    }
}

#[test]
fn large_slips_are_not_passed_over() {
    for (seed, mm) in [(0, 4.0), (1, 8.0), (2, 16.0)] {
        let result = scanned(&slipping(&four(), mm, seed), seed).slipped();
        println!("{mm} mm: {result:?}");
        let is_told = match result {
            Ok(slip) => slip.is_some_and(|slip| slip.sweep == 2),
            Err(error) => matches!(error, CalibrationError::Drift(DriftError::Unrelated { .. })),
        };
        assert!(is_told, "{mm} mm");
    }
}

#[test]
fn sensor_that_holds_raises_no_alarm() {
    for (seed, directions) in [(0, four()), (1, directions().to_vec())] {
        assert_eq!(scanned(&slipping(&directions, 0.0, seed), seed).slipped().unwrap(), None);
    }
    let noisy = Sweeps { wander: [0.8, 0.8], ..Sweeps::of(&directions()) };
    let error = refused(scanned(&noisy, 3).slipped());
    assert!(matches!(error, DriftError::Uncertain { motion: Motion::Tilt, .. }), "{error}");
}

#[test]
#[ignore = "minutes: many scans (make stress)"]
fn sensors_that_hold_raise_no_alarm_in_many_scans() {
    let (mut alarms, mut worst) = (0, [0.0_f64; 2]);
    for seed in 0..100 {
        let directions = if seed % 2 == 0 { four() } else { directions().to_vec() };
        let slices = scanned(&slipping(&directions, 0.0, 200 + seed), 200 + seed);
        let fitted = Fitted::new(&slices, 1).unwrap();
        alarms += usize::from(!matches!(Slip::of(&slices, &fitted), Ok(None)));
        let step = slip::Step::best(&slip::Step::all(&slices, &fitted)).unwrap();
        worst = [worst[0].max(step.shift_mm), worst[1].max(step.shift_mm / step.shift_se_mm)];
    }
    println!("{alarms} alarms; at most {:.3} mm, {:.2} standard errors", worst[0], worst[1]);
    assert_eq!(alarms, 0);
}

#[test]
#[ignore = "minutes: many scans (make stress)"]
fn half_a_millimetre_is_found_in_most_scans() {
    let (mut found, mut right) = (0, 0);
    for seed in 0..20 {
        let directions = if seed % 2 == 0 { four() } else { directions().to_vec() };
        let slices = scanned(&slipping(&directions, 0.5, 400 + seed), 400 + seed);
        let slip = slices.slipped().unwrap().filter(|slip| compared(&slices, slip).0);
        found += usize::from(slip.is_some());
        right += usize::from(slip.is_some_and(|slip| slip.sweep == 2));
    }
    println!("{found} of 20 found, {right} with their sweep");
    assert!(right >= 15, "{right}");
}

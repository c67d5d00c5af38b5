//! Calibrations of simulated sweeps that cross, and scans that determine none.

use std::f64::consts::TAU;

use glam::{DAffine3, DQuat, DVec3};

use super::line::Lines;
use super::state::{Change, State};
use super::*;
use crate::error::Motion;
use crate::tests::crossing_scans::{SIZE, probe_from_image};
use crate::tests::crossing_sweeps::{Sweeps, directions};
use crate::tests::noise::Noise as Random;

/// Returns the root mean square of the image's displacement by a calibration, mm.
fn error_mm(found: DAffine3) -> f64 {
    let end = f64::from(SIZE - 1);
    let points = (0..9).map(|k| DVec3::new(0.5 * end * f64::from(k % 3), 0.5 * end * f64::from(k / 3), 0.0));
    let squares = points.map(|p| found.transform_point3(p).distance_squared(probe_from_image().transform_point3(p)));
    (squares.sum::<f64>() / 9.0).sqrt()
}

/// 1 mm, 1°, 2 % and 10 ms.
fn off(random: &mut Random) -> Change {
    let mut vector = |size: f64| {
        let v = DVec3::new(random.normal(), random.normal(), random.normal());
        (v.normalize() * size).to_array()
    };
    let ([t, r], sign) = ([vector(1.0), vector(TAU / 360.0)], if random.uniform() < 0.5 { -1.0 } else { 1.0 });
    Change::from([t[0], t[1], t[2], r[0], r[1], r[2], 0.02 * sign, -0.02 * sign, 0.01 * sign])
}

/// Checks a scan, and returns the errors before and after, mm, with the result.
fn checked(sweeps: &Sweeps, seed: u64) -> ([f64; 2], Checked) {
    let slices = sweeps.scanned(&mut Random::new(1000 + seed));
    let used = sweeps.used(probe_from_image());
    let found = slices.checked().unwrap();
    let errors = [error_mm(used), error_mm(found.corrected(used))];
    println!(
        "{seed}: {:.3} to {:.4} mm (shift {:.3} ± {:.4}, worst {:.4}), lag off {:.2} ± {:.2} ms, {} lines, r {:.3} to {:.3}, {:?}",
        errors[0],
        errors[1],
        found.shift_mm,
        found.shift_se_mm,
        found.worst_se_mm,
        1e3 * (found.lag_s[0] - sweeps.off[8]),
        1e3 * found.lag_s[1],
        found.lines,
        found.correlations[0],
        found.correlations[1],
        found.unfit(),
    );
    (errors, found)
}

#[test]
fn calibration_is_found_with_exact_poses() {
    for seed in 0..2 {
        let sweeps = Sweeps { off: off(&mut Random::new(seed)), ..Sweeps::of(&directions()) };
        let ([_, after], found) = checked(&sweeps, seed);
        assert!(after < 0.05 && (found.lag_s[0] - sweeps.off[8]).abs() < 2e-3, "{seed}: {after}");
        assert!(found.has_slipped() && found.unfit().is_none(), "{seed}: {:?}", found.unfit());
        let [before, _] = found.correlations;
        let mut no_better = found.clone();
        no_better.correlations = [before; 2];
        assert!(!no_better.has_slipped(), "slices that agree no better show no slip");
    }
}

#[test]
fn standard_errors_hold_with_errors_of_poses() {
    let (mut squares, mut all) = (0.0, 0.0);
    for seed in 0..5 {
        let sweeps = Sweeps { off: off(&mut Random::new(seed)), wander: [0.12, 0.08], ..Sweeps::of(&directions()) };
        let ([_, after], found) = checked(&sweeps, seed);
        assert!(after < 0.4 && found.has_slipped() && found.unfit().is_none(), "{seed}: {:?}", found.unfit());
        squares += (after / found.shift_se_mm).powi(2);
        all += 1.0;
    }
    println!("mean square of errors by standard errors: {:.2}", squares / all);
    assert!((0.3..2.5).contains(&(squares / all)), "{}", squares / all);
}

#[test]
fn right_calibration_holds() {
    for seed in 0..2 {
        let sweeps = Sweeps { wander: [0.08, 0.05], ..Sweeps::of(&directions()) };
        let (_, found) = checked(&sweeps, seed);
        assert!(!found.has_slipped(), "{seed}");
        assert!(matches!(found.unfit(), Some(CrossingsError::Holds { .. })), "{seed}: {:?}", found.unfit());
    }
}

/// Poses in another frame of the room change neither the lines nor the result.
#[test]
fn frame_of_the_room_does_not_matter() {
    let sweeps = Sweeps { off: off(&mut Random::new(3)), ..Sweeps::of(&directions()) };
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.7, -2.0, 1.1);
    let room = DAffine3::from_rotation_translation(turn, DVec3::new(300.0, -500.0, 90.0));
    let [here, there] = [DAffine3::IDENTITY, room].map(|room| {
        let slices = Sweeps { room, ..sweeps.clone() }.scanned(&mut Random::new(9));
        slices.checked().unwrap()
    });
    let off = |found: &Checked| error_mm(found.corrected(sweeps.used(probe_from_image())));
    assert!((off(&here) - off(&there)).abs() < 1e-4 && (here.shift_se_mm - there.shift_se_mm).abs() < 1e-4);
    assert_eq!((here.lines, here.directions), (there.lines, there.directions));
}

#[test]
fn what_determines_no_calibration_is_refused_by_name() {
    let refused = |sweeps: &Sweeps| match sweeps.scanned(&mut Random::new(5)).checked() {
        Ok(found) => found.unfit().map(Into::into),
        Err(error) => Some(error),
    };
    let named = |sweeps: Sweeps| match refused(&sweeps) {
        Some(CalibrationError::Crossings(error)) => error,
        other => panic!("{other:?}"),
    };
    let [upright, turned, tilted] = directions();
    let all = Sweeps::of(&directions());
    // Two sweeps in one direction cross by the hand's tilts alone.
    let few = named(Sweeps::of(&[upright, upright]));
    assert!(matches!(few, CrossingsError::FewLines { least: LEAST_LINES, directions: 1, .. }), "{few}");
    let two = named(Sweeps::of(&[upright, turned]));
    assert!(matches!(two, CrossingsError::Directions { count: 2, motion: Motion::Tilt, .. }), "{two}");
    for depth in [0.5, 1.1, 2.0] {
        let scale = named(Sweeps { depth, ..all.clone() });
        assert!(matches!(scale, CrossingsError::Scale { factor } if (factor * depth - 1.0).abs() < 0.02), "{scale}");
    }
    let body = vec![DVec3::ZERO, DVec3::ZERO, DVec3::new(1.0, 1.0, 2.0)];
    let moved = Sweeps { body, ..all.clone() }.scanned(&mut Random::new(5)).checked().unwrap();
    assert!(matches!(moved.undecided(), Some(CrossingsError::Moved { sides: [_, 2], .. })), "{:?}", moved.undecided());
    assert!(moved.shift_mm > 0.3 && !moved.has_slipped(), "a body that moved is no slipped sensor");
    let far = named(Sweeps { off: Change::from([3.5, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ..all.clone() });
    assert!(matches!(far, CrossingsError::Large { unit: "mm", .. }), "{far}");
    let noisy = named(Sweeps { wander: [0.8, 0.8], ..all.clone() });
    assert!(matches!(noisy, CrossingsError::Uncertain { .. }), "{noisy}");
    // Images of other places.
    let mut slices = all.scanned(&mut Random::new(5));
    let images: Vec<Vec<u16>> = slices.pixels.iter().map(|(_, pixels)| pixels.clone()).collect();
    let n = images.len();
    slices.pixels.iter_mut().enumerate().for_each(|(slice, own)| own.1 = images[(slice * 49) % n].clone());
    let other = slices.checked().unwrap_err();
    assert!(matches!(other, CalibrationError::Crossings(CrossingsError::Unrelated { .. })), "{other}");
    let flat = Sweeps { noise: 0.0, directions: vec![upright, turned, tilted], ..all };
    let mut slices = flat.scanned(&mut Random::new(5));
    slices.pixels.iter_mut().for_each(|(_, pixels)| pixels.fill(25_600));
    assert!(slices.checked().is_err(), "there is nothing to see");
}

#[test]
fn derivatives_match_differences() {
    let mut random = Random::new(3);
    let sweeps = Sweeps { off: off(&mut random), noise: 0.0, ..Sweeps::of(&directions()) };
    let slices = sweeps.scanned(&mut random);
    let start = State::of(&slices);
    let pairs = pairs::chosen(&slices, &start);
    let mut lines = Lines::new(&slices, &pairs[..60], 1.6);
    lines.smooth = lines.images.clone();
    for number in 0..state::COUNT {
        let step = fit::BEFORE[number] * 1e-6;
        let (mut off, mut size) = (0.0_f64, 0.0_f64);
        for pair in lines.pairs {
            let along = |sign: f64| {
                let mut change = Change::zeros();
                change[number] = sign * step;
                let [before, after] = [start, start.changed(&change)].map(|state| state.placing(&slices));
                lines.differences_moved(*pair, &before, &after)
            };
            let [low, at, high] = [along(-1.0), along(0.0), along(1.0)];
            for (((low, _), (_, by)), (high, _)) in low.iter().zip(&at).zip(&high) {
                // The derivative by the calibration is the sum of those by each slice.
                let by = by[0][number] + by[1][number];
                off += (by - (high - low) / (2.0 * step)).powi(2);
                size += by.powi(2);
            }
        }
        let ratio = (off / size).sqrt();
        println!("{number}: {ratio:.2e}");
        // Where a point crosses into another pixel within the step, the slope has a kink.
        assert!(size > 0.0 && ratio < 2e-3, "number {number}: {ratio}");
    }
}

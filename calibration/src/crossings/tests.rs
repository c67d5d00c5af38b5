//! Calibrations of simulated sweeps that cross, and scans that determine none.

use std::f64::consts::TAU;

use glam::{DAffine3, DQuat, DVec3};

use super::line::Lines;
use super::state::{Change, State};
use super::*;
use crate::error::Motion;
use crate::tests::crossing_scans::{Body, PIXEL_MM, SIZE, probe_from_image};
use crate::tests::noise::Noise as Random;
use crate::trajectory::PoseSample;
use crate::trajectory::pose_spline::PoseSpline;

/// Upright, turned by 90° about v, and tilted by 30° about u.
fn directions() -> [DQuat; 3] {
    [DQuat::IDENTITY, DQuat::from_rotation_y(TAU / 4.0), DQuat::from_rotation_x(TAU / 12.0)]
}

/// Sweeps of 6 s, 7 s after each other, with a hand's tilts.
#[derive(Clone)]
struct Sweeps {
    directions: Vec<DQuat>,
    /// Displaces the body before each sweep.
    body: Vec<DVec3>,
    /// The calibration that is used less the true one.
    off: Change,
    /// Standard deviation of the images' noise, grey levels.
    noise: f64,
    /// Image scale in use by the true one.
    depth: f64,
    /// Errors of poses that change slowly: along and about each axis, standard deviations, mm and
    /// degrees.
    wander: [f64; 2],
    /// From the tracker's frame to the one of the recorded poses.
    room: DAffine3,
}

/// Errors of poses at every 0.4 s.
struct Wander(Vec<[DVec3; 2]>);

impl Wander {
    fn new([mm, degrees]: [f64; 2], random: &mut Random) -> Self {
        // Between independent values, linear interpolation has two thirds of their variance.
        let mut vector = |sd: f64| DVec3::new(random.normal(), random.normal(), random.normal()) * sd * 1.5_f64.sqrt();
        Self((0..20).map(|_| [vector(mm), vector(degrees.to_radians())]).collect())
    }

    fn at(&self, time_s: f64) -> DAffine3 {
        let at = (time_s + 0.4) / 0.4;
        let [shift, turn] = [0, 1].map(|k| self.0[at as usize][k].lerp(self.0[at as usize + 1][k], at.fract()));
        DAffine3::from_rotation_translation(DQuat::from_scaled_axis(turn), shift)
    }
}

impl Sweeps {
    fn of(directions: &[DQuat]) -> Self {
        let body = vec![DVec3::ZERO; directions.len()];
        Self {
            directions: directions.to_vec(),
            body,
            off: Change::zeros(),
            noise: 3.0,
            depth: 1.0,
            wander: [0.0; 2],
            room: DAffine3::IDENTITY,
        }
    }

    fn pose(&self, sweep: usize, time_s: f64) -> DAffine3 {
        let seed = sweep as f64;
        let wave = |rate: f64, phase: f64| (TAU * rate * time_s + phase + 2.1 * seed).sin();
        let tilt = DQuat::from_euler(
            glam::EulerRot::XYZ,
            0.06 * wave(0.31, 0.3),
            0.08 * wave(0.23, 1.0),
            0.05 * wave(0.4, 2.0),
        );
        let along =
            DVec3::new(1.5 * wave(0.37, 0.0), 1.2 * wave(0.29, 1.4), 6.0 * (time_s - 3.0) + 0.8 * wave(0.5, 0.7));
        let turn = self.directions[sweep];
        DAffine3::from_rotation_translation(turn * tilt, turn * along)
    }

    fn scanned(&self, random: &mut Random) -> Slices {
        let body = Body::new(random);
        let (mut samples, mut images) = (Vec::new(), Vec::new());
        let truth = probe_from_image();
        for sweep in 0..self.directions.len() {
            let begin_s = 7.0 * sweep as f64;
            let wander = Wander::new(self.wander, random);
            for i in -30..750 {
                let time_s = f64::from(i) / 120.0;
                // The tracker's stamps are late by the lag.
                let pose = self.room * self.pose(sweep, time_s - self.off[8]) * wander.at(time_s);
                let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
                samples.push(PoseSample { time_s: begin_s + time_s, rotation, position_mm: pose.translation });
            }
            for i in 0..40 {
                let time_s = 0.15 * f64::from(i);
                let world = DAffine3::from_translation(-self.body[sweep]) * self.pose(sweep, time_s) * truth;
                let body = body.met_by(&world);
                let pixel = |at: u32| {
                    let p = DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0);
                    (body.grey(world.transform_point3(p)) + self.noise * random.normal()).round().clamp(0.0, 255.0)
                        as u8
                };
                images.push((begin_s + time_s, (0..SIZE * SIZE).map(pixel).collect::<Vec<u8>>()));
            }
        }
        let used = self.used(truth);
        let poses = PoseSpline::new(&samples).unwrap();
        let mut slices = Slices::new(SIZE, SIZE, &vec![true; (SIZE * SIZE) as usize], used, poses);
        images.iter().for_each(|(time_s, pixels)| slices.push(*time_s, pixels, SIZE, SIZE));
        slices
    }

    /// Returns the calibration in use: off by `off` in mm of the image about its middle.
    fn used(&self, truth: DAffine3) -> DAffine3 {
        let half = 0.5 * f64::from(SIZE - 1);
        let middle = DAffine3::from_translation(DVec3::new(half, half, 0.0));
        let unscaled = DAffine3::from_scale(DVec3::splat(PIXEL_MM));
        let picture = truth * middle * unscaled.inverse();
        let [r, t] = [3, 0].map(|k| DVec3::new(self.off[k], self.off[k + 1], self.off[k + 2]));
        let rigid = DAffine3::from_rotation_translation(DQuat::from_scaled_axis(r), t);
        let scale = DVec3::new(1.0 + self.off[6], 1.0 + self.off[7], 1.0) * DVec3::new(self.depth, self.depth, 1.0);
        picture * rigid * DAffine3::from_scale(scale) * unscaled * middle.inverse()
    }
}

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
                lines.differences_moved(*pair, &start, &start.changed(&change))
            };
            let [low, at, high] = [along(-1.0), along(0.0), along(1.0)];
            for (((low, _), (_, by)), (high, _)) in low.iter().zip(&at).zip(&high) {
                off += (by[number] - (high - low) / (2.0 * step)).powi(2);
                size += by[number].powi(2);
            }
        }
        let ratio = (off / size).sqrt();
        println!("{number}: {ratio:.2e}");
        // Where a point crosses into another pixel within the step, the slope has a kink.
        assert!(size > 0.0 && ratio < 2e-3, "number {number}: {ratio}");
    }
}

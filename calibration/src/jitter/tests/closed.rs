//! Cases with known results.

use glam::{DQuat, DVec2, DVec3};

use super::super::points::FIT;
use super::super::{fit, prediction, sequence};
use super::sweep::{probe_from_image, slices};
use super::*;
use crate::trajectory::PoseSample;

/// Mean gap of the slices, mm.
const GAP_MM: f64 = 0.35;

/// Slices that are parallel at even gaps.
fn straight(count: usize) -> Vec<PoseSample> {
    let at = |slice: usize| {
        let position_mm = DVec3::new(0.0, 0.0, GAP_MM * slice as f64);
        PoseSample { time_s: slice as f64 / 30.0, rotation: DQuat::IDENTITY, position_mm }
    };
    (0..count).map(at).collect()
}

/// Returns the place of a pixel of a straight sweep's slice.
fn place(slice: usize, pixel: DVec3) -> DVec3 {
    probe_from_image().transform_point3(pixel) + DVec3::Z * GAP_MM * slice as f64
}

#[test]
fn displaced_slice_is_found_alone() {
    let smooth = |at: DVec3| {
        let [a, b] = [at.x - 0.3 * at.z, at.y - 110.0 + 0.2 * at.z];
        128.0 + 40.0 * (a / 3.0).sin() + 40.0 * (b / 4.0).sin() + 20.0 * ((a + b) / 5.0).cos()
    };
    for off in [DVec3::new(0.3, 0.0, 0.0), DVec3::new(0.0, -0.3, 0.0), DVec3::new(0.2, 0.2, 0.0)] {
        let shown = slices(&straight(60), |slice, pixel| {
            smooth(place(slice, pixel) + if slice == 30 { off } else { DVec3::ZERO })
        });
        let found = shown.found_jitter(noise(0.3)).unwrap();
        let at = |slice: usize| {
            let numbers = found.numbers(slice).unwrap();
            DVec3::new(numbers[0], numbers[1], numbers[2])
        };
        let others = (10..50).filter(|slice| *slice != 30).map(|slice| at(slice).length()).fold(0.0, f64::max);
        println!("{off}: found {}, others {others:.4} mm", at(30));
        // Neighbours take over a part that they share, which they do not show.
        let shared = [28, 29, 31, 32].map(at).iter().sum::<DVec3>() / 4.0;
        assert!((at(30) - shared - off).length() < 0.02, "{off}: {} {shared}", at(30));
        assert!((at(30) - off).length() < 0.04 && others < 0.03, "{off}: {}, {others}", at(30));
    }
}

/// A pattern that moves by the same distance from slice to slice is the anatomy's slope.
#[test]
fn sloped_pattern_stays_sloped() {
    let pattern = |at: DVec3| {
        let [a, b] = [at.x - 0.6 * at.z, at.y - 0.4 * at.z];
        128.0 + 40.0 * (a / 2.5).sin() * (b / 3.0).cos()
    };
    let shown = slices(&straight(60), |slice, pixel| pattern(place(slice, pixel)));
    for given in [0.1, 0.3] {
        let found = shown.found_jitter(noise(given)).unwrap();
        let shift = |slice: usize| found.numbers(slice).map_or(0.0, |numbers| numbers[0].hypot(numbers[1]));
        let inner = (8..52).map(shift).fold(0.0, f64::max);
        println!("slope: largest {:.4} mm, inner {inner:.4}, rms {:.4} mm", found.largest_mm, found.rms_mm);
        assert!(inner < 0.01 && found.rms_mm < 0.01, "{inner}");
        assert!(matches!(found.unfit(), Some(JitterError::NoBetter { .. })));
    }
}

/// The slope of images, 4 grey levels a pixel along u, 3 along v and 2 a gap, in which rounding
/// errs nowhere.
fn ramp() -> Slices {
    slices(&straight(40), |slice, pixel| {
        let at = place(slice, pixel);
        let corner = place(0, DVec3::ZERO);
        0.25 * (8.0 * (at.x - corner.x) + 6.0 * (at.y - corner.y)) + 2.0 * slice as f64
    })
}

#[test]
fn derivatives_match_differences() {
    let shown = ramp();
    let state = State::of(&shown);
    let scan = Scan::new(&shown, &state, sequence::members(&shown, &state, 0.2));
    let poses: Vec<DAffine3> = scan.members.iter().map(|member| member.world_from_picture).collect();
    let member = 20;
    let at = |[x, y, turn]: [f64; 3]| {
        let within = fit::Within { shift_mm: DVec2::new(x, y), turn };
        scan.prediction(member, &(poses[member] * within.rigid()), &poses, FIT)
    };
    for number in 0..3 {
        const STEP: f64 = 1e-4;
        let [low, high] = [-STEP, STEP].map(|step| at(std::array::from_fn(|k| if k == number { step } else { 0.0 })));
        let (mut count, mut worst, mut largest) = (0, 0.0_f64, 0.0_f64);
        for (k, point) in scan.points[FIT].iter().enumerate() {
            let [Some(low), Some(high)] = [low[k], high[k]] else { continue };
            let by = fit::derivatives(*point, &scan.own[FIT][member][k])[number];
            worst = worst.max((by - (high - low) / (2.0 * STEP)).abs());
            largest = largest.max(by.abs());
            count += 1;
        }
        println!("{number}: {worst:.2e} of {largest:.2}");
        assert!(count > 100 && largest > 1.0 && worst < 1e-4 * largest, "number {number}: {worst} of {largest}");
    }
}

/// A line through values at uneven distances is exact for a linear body.
#[test]
fn prediction_is_exact_for_a_ramp_at_uneven_gaps() {
    let mut sums = prediction::Sums::default();
    for (q, weight) in [(-0.7, 0.2), (-0.1, 0.9), (0.5, 0.4), (0.6, 0.3)] {
        sums.add(q, weight, 20.0 + 3.0 * q);
    }
    let found = sums.predicted(0.4).unwrap();
    assert!((found - 20.0).abs() < 1e-12, "{found}");
    // One side only, and one place only.
    let of = |all: [f64; 2]| {
        let mut sums = prediction::Sums::default();
        all.iter().for_each(|q| sums.add(*q, 1.0, 7.0));
        sums.predicted(0.4)
    };
    assert_eq!((of([0.1, 0.5]), of([-0.01, 0.01])), (None, None));
    assert!((of([-0.4, 0.4]).unwrap() - 7.0).abs() < 1e-12);
}

#[test]
fn normal_meets_a_tilted_plane() {
    let tilt = DAffine3::from_rotation_translation(DQuat::from_rotation_y(0.2), DVec3::new(1.0, 2.0, 0.5));
    let pixel_from_picture = DAffine3::from_scale(DVec3::new(2.0, 4.0, 1.0));
    let across = prediction::Across::of([&DAffine3::IDENTITY, &tilt], &pixel_from_picture);
    let point = DVec2::new(3.0, -1.0);
    let met = point.extend(across.distance_mm(point));
    let there = tilt.inverse().transform_point3(met);
    assert!(there.z.abs() < 1e-12, "{there}");
    assert!((across.pixel(point) - DVec2::new(2.0 * there.x, 4.0 * there.y)).length() < 1e-12);
    assert!((met.z - (0.5 - 2.0 * 0.2_f64.tan())).abs() < 1e-12, "{met}");
}

/// Sweeps are separated by pauses and by directions, and no slice has a neighbour in another one.
#[test]
fn neighbours_are_of_one_sweep() {
    let mut samples = straight(40);
    samples[25..].iter_mut().for_each(|sample| sample.time_s += 2.0);
    let shown = slices(&samples, |_, _| 0.0);
    let members = sequence::members(&shown, &State::of(&shown), 0.0);
    assert_eq!(members.len(), 40);
    for (at, member) in members.iter().enumerate() {
        let [first, end] = if at < 25 { [0, 25] } else { [25, 40] };
        assert_eq!(member.neighbours, at.saturating_sub(6).max(first)..(at + 7).min(end), "{at}");
        assert!(member.slice == at && (member.width_mm - GAP_MM).abs() < 1e-9);
    }
}

/// Full-size pixels are corrected as those of the reduced images.
#[test]
fn correction_holds_for_images_before_reduction() {
    let shown = ramp();
    let mut wide = Slices { image_from_pixel: DAffine3::from_scale(DVec3::new(3.0, 3.0, 1.0)), ..shown.clone() };
    // Turns one slice by its image, so that there is something to correct.
    let turned = |slices: &mut Slices| {
        slices.pixels[20].1.iter_mut().enumerate().for_each(|(at, grey)| *grey += 8 * (at / 96) as u16);
        slices.found_jitter(noise(0.3)).unwrap()
    };
    let [small, large] = [turned(&mut shown.clone()), turned(&mut wide)];
    assert_eq!(small.numbers(20), large.numbers(20));
    let state = State::of(&shown);
    let [_, _, _, _, _, turn] = small.numbers(20).unwrap();
    assert!(turn.abs() > 1e-4, "{turn}");
    let pixel = DVec3::new(20.0, 70.0, 0.0);
    let world = shown.placed(20, 0.0).unwrap();
    let expected = {
        let [x, y, ..] = small.numbers(20).unwrap();
        let rigid = DAffine3::from_rotation_translation(DQuat::from_rotation_z(turn), DVec3::new(x, y, 0.0));
        let of = state.picture_from_pixel;
        state.world_from_picture(&shown, 20).unwrap().transform_point3((rigid * of).transform_point3(pixel))
    };
    assert!((small.corrected(20, world).transform_point3(pixel) - expected).length() < 1e-9);
    let world_from_full = world * wide.image_from_pixel.inverse();
    let full = wide.image_from_pixel.transform_point3(pixel);
    assert!((large.corrected(20, world_from_full).transform_point3(full) - expected).length() < 1e-9);
    // The first slice has no neighbours before it.
    assert_eq!((small.numbers(0), small.numbers(999)), (None, None));
    assert_eq!(small.corrected(0, world), world);
}

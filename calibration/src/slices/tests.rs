//! Grey values, and lines of crossing slices.

use glam::DQuat;

use super::*;
use crate::tests::crossing_scans::{both_ways, scan};
use crate::tests::noise::Noise as Random;
use crate::trajectory::PoseSample;

#[test]
fn grey_is_interpolated_within_data_only() {
    let poses = PoseSpline::new(&[0.0, 1.0].map(|time_s| PoseSample {
        time_s,
        rotation: DQuat::IDENTITY,
        position_mm: DVec3::ZERO,
    }));
    let slices = Slices::new(8, 8, &[true; 64], DAffine3::IDENTITY, poses.unwrap());
    let pixels: Vec<u16> = (0..64).map(|at| 256 * (at % 8 + 10 * (at / 8))).collect();
    assert_eq!(slices.grey(&pixels, DVec2::new(2.5, 3.25)), Some(35.0));
    for outside in [-1.0, 1.5, 6.0, 7.0, 1e300, f64::INFINITY, f64::NEG_INFINITY, f64::NAN] {
        assert_eq!(slices.grey(&pixels, DVec2::new(outside, 3.25)), None, "{outside}");
        assert_eq!(slices.grey(&pixels, DVec2::new(3.25, outside)), None, "{outside}");
    }
}

#[test]
fn intersection_lies_in_both_planes_and_bounds() {
    let slices = scan(both_ways, 0.0, 1.0, &mut Random::new(1));
    let [a, b] = [20, 120].map(|slice| slices.placed(slice, 0.0).unwrap());
    let ends = slices.line([&a, &b]).expect("these cross");
    for end in ends {
        for pose in [a, b] {
            let at = pose.inverse().transform_point3(end);
            assert!(at.z.abs() < 1e-9, "{at}");
            assert!(
                (0..2).all(|axis| at[axis] > slices.bounds[axis][0] - 1e-9 && at[axis] < slices.bounds[axis][1] + 1e-9)
            );
        }
    }
    assert!(slices.line([&a, &a]).is_none());
}

#[test]
fn reduced_pixel_is_centred_on_its_pixels() {
    let (width, height) = (600, 400);
    let by = reduction(width, height);
    assert_eq!(by, 4);
    let poses = PoseSpline::new(&[]).unwrap();
    let mut slices = Slices::new(width, height, &vec![true; 240_000], DAffine3::IDENTITY, poses);
    let at = slices.probe_from_pixel.transform_point3(DVec3::new(1.0, 2.0, 0.0));
    assert_eq!(at, DVec3::new(5.5, 9.5, 0.0));
    // The first row lies above the middle of the first reduced one.
    assert_eq!(slices.top, -0.375);
    // A ramp keeps its values.
    let ramp: Vec<u8> = (0..240_000_u32).map(|i| (i % 600 / 3) as u8).collect();
    slices.push(0.0, &ramp, width, height);
    let grey = slices.grey(&slices.pixels[0].1, DVec2::new(50.0, 20.0)).unwrap();
    assert!((grey - (50.0 * 4.0 + 1.5) / 3.0).abs() < 1.0, "{grey}");
    assert!(slices.grey(&slices.pixels[0].1, DVec2::new(-0.5, 3.0)).is_none());
}

//! Lags of simulated scans of an analytic body, and scans that determine no lag.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat};

use super::super::motion::PoseSample;
use super::*;
use crate::error::LatencyError;
use crate::tests::noise::Noise as Random;

const SIZE: u32 = 96;
const PIXEL_MM: f64 = 0.5;

/// A body of Gaussian blobs, some bright and some dark.
struct Body {
    blobs: Vec<(DVec3, f64, f64)>,
}

impl Body {
    fn new(random: &mut Random) -> Self {
        let blob = |_| {
            let place = DVec3::from_array(std::array::from_fn(|_| 60.0 * (random.uniform() - 0.5)));
            (place, 2.0 + 3.0 * random.uniform(), if random.uniform() < 0.5 { -60.0 } else { 70.0 })
        };
        Self { blobs: (0..80).map(blob).collect() }
    }

    fn grey(&self, at: DVec3) -> f64 {
        let of = |(place, width, height): &(DVec3, f64, f64)| {
            let square = (at - place).length_squared() / (width * width);
            if square < 20.0 { height * (-0.5 * square).exp() } else { 0.0 }
        };
        100.0 + self.blobs.iter().map(of).sum::<f64>()
    }

    /// Returns the blobs that an image plane meets. The others add nothing to its pixels.
    fn met_by(&self, world_from_pixel: &DAffine3) -> Self {
        let normal = world_from_pixel.matrix3.z_axis.normalize();
        let meets = |(place, width, _): &&(DVec3, f64, f64)| {
            (*place - world_from_pixel.translation).dot(normal).powi(2) < 20.1 * width * width
        };
        Self { blobs: self.blobs.iter().filter(meets).copied().collect() }
    }
}

/// The path of a probe.
type Way = fn(f64) -> (DQuat, DVec3);

/// Moves back and forth along one direction, then along another, turning meanwhile.
fn both_ways(time: f64) -> (DQuat, DVec3) {
    let along = 15.0 * (TAU * 0.35 * time).sin() + 3.0 * (TAU * 0.13 * time).cos();
    // Changes direction within a second, smoothly, because the tracker's samples do not resolve
    // jerks.
    let share = (time - 6.0).clamp(0.0, 1.0);
    let heading = 1.4 * share * share * (3.0 - 2.0 * share);
    let turn = DQuat::from_rotation_y(heading + 0.1 * (TAU * 0.2 * time).sin());
    (turn, turn * DVec3::new(2.0 * (TAU * 0.31 * time).sin(), 1.0, along))
}

fn one_way(time: f64) -> (DQuat, DVec3) {
    (DQuat::IDENTITY, DVec3::new(0.0, 0.0, 3.0 * time - 18.0))
}

/// The sensor lies 50 mm above the image centre.
fn probe_from_image() -> DAffine3 {
    let half = 0.5 * f64::from(SIZE - 1) * PIXEL_MM;
    DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(PIXEL_MM, PIXEL_MM, PIXEL_MM)),
        translation: DVec3::new(-half, -half, 0.0),
    }
}

fn scan(way: Way, lag_s: f64, noise: f64, random: &mut Random) -> Slices {
    let body = Body::new(random);
    let samples: Vec<PoseSample> = (-30..630)
        .map(|i| {
            let time_s = 0.02 * f64::from(i);
            let (rotation, position_mm) = way(time_s - lag_s);
            let tremble = DVec3::from_array(std::array::from_fn(|_| 0.02 * noise * random.normal()));
            PoseSample { time_s, rotation, position_mm: position_mm + tremble }
        })
        .collect();
    let poses = PoseSpline::new(&samples).unwrap();
    let is_data: Vec<bool> = (0..SIZE * SIZE).map(|at| at % SIZE >= 8 && at / SIZE < SIZE - 8).collect();
    let mut slices = Slices::new(SIZE, SIZE, &is_data, probe_from_image(), poses);
    for i in 0..150 {
        let time = 0.08 * f64::from(i);
        let (rotation, place) = way(time);
        let world = DAffine3::from_rotation_translation(rotation, place) * probe_from_image();
        let body = body.met_by(&world);
        let pixel = |at: u32| {
            let grey = body.grey(world.transform_point3(DVec3::new(f64::from(at % SIZE), f64::from(at / SIZE), 0.0)));
            (grey + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        };
        let pixels: Vec<u8> = (0..SIZE * SIZE).map(pixel).collect();
        slices.push(time, &pixels, SIZE, SIZE);
    }
    slices
}

#[test]
fn lag_of_crossing_scan_is_found_within_standard_error() {
    let seeds: u32 = 16;
    let (mut squares, mut sum) = (0.0, 0.0);
    for seed in 0..seeds {
        let mut random = Random::new(u64::from(seed));
        let lag = 0.12 * (random.uniform() - 0.5);
        let found = scan(both_ways, lag, 6.0, &mut random).lag(0.25).unwrap();
        let off = found.lag_s - lag;
        println!(
            "{seed}: {:.2} ms off, se {:.2} ms, {} crossings, r {:.3} from {:.3}",
            1e3 * off,
            1e3 * found.se_s,
            found.crossings,
            found.correlation,
            found.correlation_at_zero
        );
        assert!(off.abs() < 4e-3 && found.se_s < 3e-3, "{seed}: {off} {}", found.se_s);
        assert!(found.correlation >= found.correlation_at_zero - 0.01);
        squares += (off / found.se_s).powi(2);
        sum += off / found.se_s;
    }
    let n = f64::from(seeds);
    println!("mean {:.2}, mean square {:.2}", sum / n, squares / n);
    // The mean square of so few normal numbers is 1 ± 0.35.
    assert!((sum / n).abs() < 0.7 && (0.3..2.0).contains(&(squares / n)), "{} {}", sum / n, squares / n);
}

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
fn undetermined_lag_is_refused_by_name() {
    let mut random = Random::new(77);
    let none = scan(one_way, 0.05, 3.0, &mut random).lag(0.25).unwrap_err();
    let few = LatencyError::FewCrossings { slices: 150, crossings: 0, least: super::LEAST_CROSSINGS };
    assert_eq!(none, few.into());
    // Too slow for the lag to show.
    let slow: Way = |time| {
        let (turn, place) = both_ways(6.0 + time / 12.0);
        (turn * DQuat::from_rotation_y(0.1 * time), 0.02 * place)
    };
    let slow = scan(slow, 0.05, 3.0, &mut random).lag(0.25);
    assert!(slow.is_err(), "{slow:?}");
    let edge = scan(both_ways, 0.2, 3.0, &mut random).lag(0.1);
    assert!(matches!(edge, Err(CalibrationError::Latency(LatencyError::AtEdge { .. }))), "{edge:?}");
    // Images of another scan.
    let mut other = scan(both_ways, 0.0, 3.0, &mut random);
    let mut pictures: Vec<Vec<u16>> = other.pixels.iter().map(|(_, pixels)| pixels.clone()).collect();
    for i in (1..pictures.len()).rev() {
        pictures.swap(i, (random.uniform() * (i + 1) as f64) as usize);
    }
    other.pixels.iter_mut().zip(pictures).for_each(|(own, picture)| own.1 = picture);
    let other = other.lag(0.25);
    assert!(other.is_err(), "{other:?}");
}

#[test]
fn intersection_lies_in_both_planes_and_bounds() {
    let slices = scan(both_ways, 0.0, 1.0, &mut Random::new(1));
    let [a, b] = slices.crossings(0.1).unwrap()[0].map(|slice| slices.placed(slice, 0.0).unwrap());
    let ends = slices.line([&a, &b]).unwrap();
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
    // A ramp keeps its values.
    let ramp: Vec<u8> = (0..240_000_u32).map(|i| (i % 600 / 3) as u8).collect();
    slices.push(0.0, &ramp, width, height);
    let grey = slices.grey(&slices.pixels[0].1, DVec2::new(50.0, 20.0)).unwrap();
    assert!((grey - (50.0 * 4.0 + 1.5) / 3.0).abs() < 1.0, "{grey}");
    assert!(slices.grey(&slices.pixels[0].1, DVec2::new(-0.5, 3.0)).is_none());
}

#[test]
fn vertex_finds_minimum_or_lower_end() {
    let places = [-2.0, -1.0, 0.0, 1.0, 2.0];
    assert!((vertex(&places, &places.map(|x: f64| 3.0 * (x - 0.7).powi(2) + 5.0)) - 0.7).abs() < 1e-12);
    assert_eq!(vertex(&places, &places.map(|x: f64| -x)), 2.0);
    assert_eq!(vertex(&places, &places.map(|x: f64| 9.0 * x)), -2.0);
}

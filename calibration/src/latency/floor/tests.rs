//! From lines and poses to the lag, with the geometry of a real probe above a floor, and with
//! all kinds of faulty input.

use std::f64::consts::TAU;

use glam::EulerRot;

use super::*;
use crate::error::LatencyError;
use crate::tests::noise::Noise as Random;

/// A probe above a floor, with frames every 80 ms and tracked at 50 Hz; `lag` is the tracker's.
/// Pixels are 0.1 mm; the image origin is 80 mm off the sensor and turned against it.
struct Bench {
    random: Random,
    lag: f64,
    /// Amplitude of the probe's motion, mm.
    height: f64,
    /// Unit of the tracker's positions, mm.
    unit: f64,
}

impl Bench {
    fn new(seed: u64, lag: f64) -> Self {
        Self { random: Random::new(seed), lag, height: 12.0, unit: 1.0 }
    }

    fn pose(&self, time: f64) -> (DQuat, DVec3) {
        let wave = |hz: f64, phase: f64| (TAU * hz * time + phase).sin();
        let turning = TAU * 0.95 * time + 1.2 * wave(0.11, 0.4);
        let tilt =
            DQuat::from_euler(EulerRot::XYZ, 0.12 * (turning + 0.5).sin(), 0.03 * wave(0.4, 1.0), 0.1 * wave(0.7, 2.0));
        let up = (self.height + 0.15 * self.height * wave(0.17, 0.0)) * turning.sin();
        (tilt, DVec3::new(200.0 + 2.0 * wave(0.6, 1.0), -30.0 + 1.0 * wave(0.9, 0.3), 90.0 + up))
    }

    /// The floor is z = 0 in the tracker's frame; the image's v points down.
    fn line(&self, time: f64) -> Line {
        let (tilt, place) = self.pose(time);
        let (u, v) = (DVec3::new(0.1, 0.0, 0.02), DVec3::new(0.01, 0.02, -0.1));
        let origin = DVec3::new(-20.0, 15.0, -40.0);
        let height = |at: DVec3| (tilt * at + place).z;
        let (least, along, down) = (height(origin), (tilt * u).z, (tilt * v).z);
        let row = |column: f64| -(least + along * column) / down;
        Line {
            point_px: DVec2::new(200.0, row(200.0)),
            direction: DVec2::new(1.0, row(201.0) - row(200.0)).normalize(),
            columns: [0.0, 400.0],
            scatter_px: 1.0,
        }
    }

    fn frames(&mut self, count: u32) -> Vec<FloorFrame> {
        let mut frames = Vec::new();
        for i in 0..count {
            let time = 0.08 * f64::from(i);
            let mut line = self.line(time);
            line.point_px.y += self.random.normal();
            let number = Some(u64::from(i));
            frames.push(FloorFrame { stamps: Stamps { given_s: 10.0 + time, raw_s: None, number }, line: Ok(line) });
        }
        frames
    }

    fn poses(&mut self, duration: f64) -> Vec<FloorPose> {
        let mut poses = Vec::new();
        let mut time = -1.0;
        while time < duration + 1.0 {
            let (rotation, place) = self.pose(time - self.lag);
            let noise = DVec3::from_array(std::array::from_fn(|_| 0.05 * self.random.normal()));
            let stamps = Stamps { given_s: 10.0 + time, ..Stamps::default() };
            poses.push(FloorPose { stamps, rotation, position_mm: (place + noise) / self.unit });
            time += 0.018 + 0.004 * self.random.uniform();
        }
        poses
    }
}

const PLAIN: FloorOptions = FloorOptions { align: AlignOptions { range_s: 0.5 }, pixel_mm: None };

#[test]
fn tilt_and_sway_leave_no_bias() {
    let (mut sum, mut squares) = (0.0, 0.0);
    let seeds = 100;
    for seed in 0..seeds {
        let mut bench = Bench::new(seed, 0.1 - 0.002 * seed as f64);
        let (frames, poses) = (bench.frames(200), bench.poses(16.0));
        let found = floor_lag(&frames, &poses, &PLAIN).unwrap();
        let score = (found.alignment.lag_s - bench.lag) / found.alignment.se_s;
        assert!((found.alignment.lag_s - bench.lag).abs() < 3e-3, "{seed}: {found:?}");
        assert!((0.08..0.12).contains(&found.mm_per_px), "{}", found.mm_per_px);
        (sum, squares) = (sum + score, squares + score * score);
    }
    let [mean, square] = [sum, squares].map(|x| x / seeds as f64);
    println!("mean {mean:.3}, mean square {square:.3}");
    // The model omits the tilt's cosines; they must be small against the noise.
    assert!(mean.abs() < 0.5 && (0.6..1.5).contains(&square), "{mean} {square}");
}

#[test]
fn filtered_stamps_lose_to_better_counts() {
    let mut bench = Bench::new(7, -0.06);
    let (mut frames, poses) = (bench.frames(200), bench.poses(16.0));
    // Simulates a filter of 20 frames with a grabber that stalls now and then.
    for (i, frame) in frames.iter_mut().enumerate() {
        let since = (i % 60) as f64;
        frame.stamps.given_s += 0.04 * ((-since / 15.0).exp() - 0.25);
    }
    let found = floor_lag(&frames, &poses, &PLAIN).unwrap();
    assert_eq!(found.readings, [Reading::Counted, Reading::Given]);
    assert!(found.wander_s[0] > 5e-3 && found.wander_s[1] == 0.0, "{:?}", found.wander_s);
    let by_given = found.tried.iter().find(|tried| tried.video == Reading::Given).and_then(|tried| tried.found);
    assert!(by_given.is_none_or(|[_, _, residual]| residual > 3.0 * found.alignment.residual), "{by_given:?}");
    // The lag refers to the mean of the given stamps.
    let mean = (0..200).map(|i| 0.04 * ((-f64::from(i % 60) / 15.0).exp() - 0.25)).sum::<f64>() / 200.0;
    assert!((found.alignment.lag_s - (-0.06 - mean)).abs() < 2e-3, "{} {mean}", found.alignment.lag_s);
}

fn refused(frames: &[FloorFrame], poses: &[FloorPose], options: &FloorOptions) -> LatencyError {
    match floor_lag(frames, poses, options) {
        Err(CalibrationError::Latency(error)) => error,
        other => panic!("{other:?}"),
    }
}

#[test]
fn invalid_recording_is_refused_by_name() {
    let mut bench = Bench::new(3, 0.02);
    let (frames, poses) = (bench.frames(200), bench.poses(16.0));
    let refusal = |frames: &[FloorFrame], poses: &[FloorPose], options: &FloorOptions| refused(frames, poses, options);
    let lineless: Vec<FloorFrame> = frames.iter().map(|f| FloorFrame { line: Err(NoLine::Scattered), ..*f }).collect();
    let none = refusal(&lineless, &poses, &PLAIN);
    assert!(matches!(none, LatencyError::NoFloor { frames: 200, lines: 0, scattered: 200, .. }), "{none}");
    assert!(matches!(refusal(&frames[..20], &poses, &PLAIN), LatencyError::NoFloor { least: 30, .. }));
    let ms: Vec<FloorFrame> = frames
        .iter()
        .map(|f| FloorFrame { stamps: Stamps { given_s: 1e3 * f.stamps.given_s, ..f.stamps }, ..*f })
        .collect();
    assert!(matches!(refusal(&ms, &poses, &PLAIN), LatencyError::Seconds { .. }));
    let still: Vec<FloorFrame> = frames.iter().map(|f| FloorFrame { line: frames[0].line, ..*f }).collect();
    assert!(matches!(refusal(&still, &poses, &PLAIN), LatencyError::PictureStill { extent_px: 0.0, .. }));
    assert!(matches!(refusal(&frames, &[], &PLAIN), LatencyError::NoPoses { poses: 0, .. }));
    let later: Vec<FloorPose> = poses
        .iter()
        .map(|p| FloorPose { stamps: Stamps { given_s: 500.0 + p.stamps.given_s, ..p.stamps }, ..*p })
        .collect();
    let late = refusal(&frames, &later, &PLAIN);
    assert!(matches!(late, LatencyError::NoPoses { .. } | LatencyError::NoOverlap { .. }), "{late}");
    let resting: Vec<FloorPose> = poses
        .iter()
        .enumerate()
        .map(|(i, p)| FloorPose { position_mm: DVec3::new(0.0, 0.0, 0.1 * (i as f64 * 1.9).sin()), ..*p })
        .collect();
    let rests = refusal(&frames, &resting, &PLAIN);
    assert!(matches!(rests, LatencyError::TrackerStill { extent_mm: 0.15..0.25, .. }), "{rests}");
    let one_way: Vec<FloorPose> =
        poses.iter().map(|p| FloorPose { position_mm: DVec3::new(0.0, 0.0, p.stamps.given_s), ..*p }).collect();
    assert!(matches!(refusal(&frames, &one_way, &PLAIN), LatencyError::OneWay { turns: 0, .. }));
    let mut wrong = poses.clone();
    wrong[5].position_mm.x = f64::NAN;
    assert_eq!(refusal(&frames, &wrong, &PLAIN), LatencyError::NotFinite { index: 5 });
}

#[test]
fn other_units_are_named() {
    for (unit, hint) in [(10.0, "not in cm"), (25.4, "not in inches"), (1000.0, "not in m")] {
        let mut bench = Bench { unit, ..Bench::new(5, 0.02) };
        let (frames, poses) = (bench.frames(200), bench.poses(16.0));
        let known = FloorOptions { pixel_mm: Some(0.1), ..PLAIN };
        let message = refused(&frames, &poses, &known).to_string();
        assert!(message.contains(hint) && message.contains("the calibration has 0.1000 mm"), "{message}");
        // Without a calibration the range of possible pixel sizes decides.
        if unit > 11.0 {
            assert!(matches!(refused(&frames, &poses, &PLAIN), LatencyError::Units { .. }), "{unit}");
        }
    }
}

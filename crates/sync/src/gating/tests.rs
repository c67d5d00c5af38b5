//! Gates of bodies that breathe and of bodies at rest, by sensors and by images.

use std::f64::consts::PI;

use glam::DVec3;

use super::*;
use crate::clock::simulation::Draws;

/// Poses of the Reference sensor a second.
const RATE: f64 = 120.0;
/// Frames a second.
const FRAMES: f64 = 30.0;
/// Share of the frames that are accepted.
const SHARE: f64 = 0.35;

/// A body whose surface moves by `mm` as it breathes, with uneven breaths, and wanders.
struct Body {
    /// Begins of breaths, s, and their sizes, mm.
    breaths: Vec<(f64, f64)>,
    /// Knots of the wander, one a second, mm.
    wander: Vec<f64>,
}

impl Body {
    fn new(draws: &mut Draws, seconds: f64, (mm, period_s): (f64, f64), wander_mm: f64) -> Self {
        let (mut begin, mut breaths) = (-draws.unit() * period_s, Vec::new());
        while begin < seconds + 2.0 * period_s {
            breaths.push((begin, mm * (1.0 + 0.1 * draws.normal())));
            begin += period_s * (1.0 + 0.08 * draws.normal()).max(0.5);
        }
        // Each knot remembers the one before.
        let mut level = wander_mm * draws.normal();
        let wander = (0..seconds as usize + 3).map(|_| {
            level = 0.6 * level + 0.8 * wander_mm * draws.normal();
            level
        });
        let wander = wander.collect();
        Self { breaths, wander }
    }

    /// Its displacement by breathing, mm: it rests at the end of breathing out.
    fn breath_mm(&self, time_s: f64) -> f64 {
        let next = self.breaths.partition_point(|(begin, _)| *begin <= time_s);
        let ((begin, mm), (end, _)) = (self.breaths[next - 1], self.breaths[next]);
        mm * libm::pow(libm::sin(PI * (time_s - begin) / (end - begin)), 4.0)
    }

    /// Its wander, mm.
    fn wander_mm(&self, time_s: f64) -> f64 {
        let (left, share) = (time_s.floor(), time_s.fract());
        let eased = 0.5 - 0.5 * libm::cos(PI * share);
        let [a, b] = [0, 1].map(|step| self.wander[left as usize + step]);
        a + (b - a) * eased
    }

    /// The positions of a sensor on it, with noise of 0.3 mm along each axis.
    fn sensed(&self, draws: &mut Draws, seconds: f64) -> Signal {
        let axis = DVec3::new(0.36, 0.48, 0.8);
        let sample = |at: usize| {
            let time_s = at as f64 / RATE;
            let noise = DVec3::from_array([0; 3].map(|_| 0.3 * draws.normal()));
            (time_s, axis * (self.breath_mm(time_s) + self.wander_mm(time_s)) + noise)
        };
        Signal::of_positions(&(0..(seconds * RATE) as usize).map(sample).collect::<Vec<_>>())
    }
}

fn frames(seconds: f64) -> Vec<f64> {
    (1..(seconds * FRAMES) as usize - 1).map(|at| at as f64 / FRAMES).collect()
}

/// The motion by breathing that is left in the accepted frames, mm: a standard deviation.
fn left_mm(body: &Body, gate: &Gate, frames_s: &[f64]) -> f64 {
    let of = |time_s: &f64| body.breath_mm(*time_s);
    let left: Vec<f64> =
        frames_s.iter().zip(&gate.accepted).filter(|(_, is)| **is).map(|(time_s, _)| of(time_s)).collect();
    deviation(left.iter())
}

#[test]
fn breathing_of_6_mm_leaves_0_2_mm_in_35_percent_of_frames() {
    let seconds = 40.0;
    let frames_s = frames(seconds);
    let mut worst = 0.0_f64;
    for seed in 0..20 {
        let mut draws = Draws::new(seed);
        let period_s = 3.0 + 2.0 * draws.unit();
        let body = Body::new(&mut draws, seconds, (6.0, period_s), 0.0);
        let signal = body.sensed(&mut draws, seconds);
        let gate = Gate::new(&signal, &frames_s, SHARE).unwrap();
        let accepted = gate.accepted.iter().filter(|is| **is).count() as f64;
        assert!((accepted - SHARE * frames_s.len() as f64).abs() < 1.0, "the share is exact: {accepted}");
        assert!((gate.breathing.period_s / period_s - 1.0).abs() < 0.1, "{:?} {period_s}", gate.breathing);
        assert!(gate.motion_mm[0] > 1.5 && gate.motion_mm[1] < 0.3, "{:?}", gate.motion_mm);
        assert!(gate.missing_s[1] < 1.3 * period_s && gate.speed_mm_s(1.0) > 0.1, "{:?}", gate.missing_s);
        worst = worst.max(left_mm(&body, &gate, &frames_s));
    }
    assert!(worst < 0.2, "{worst}");
}

#[test]
fn frames_outside_the_signal_are_left_out() {
    let seconds = 40.0;
    let frames_s: Vec<f64> = (-30..(seconds * FRAMES) as i32 + 30).map(|at| f64::from(at) / FRAMES).collect();
    // The body rests at the one or at the other end of the axis.
    for mm in [6.0, -6.0] {
        let mut draws = Draws::new(7);
        let body = Body::new(&mut draws, seconds, (mm, 4.0), 0.0);
        let gate = Gate::new(&body.sensed(&mut draws, seconds), &frames_s, SHARE).unwrap();
        let (before, after) = (&gate.accepted[..30], &gate.accepted[gate.accepted.len() - 30..]);
        assert!(!before.iter().chain(after).any(|is| *is), "{mm}");
        assert!(gate.motion_mm[1] < 0.3 && gate.most_mm < 1.0, "{gate:?}");
    }
}

#[test]
fn body_at_rest_is_not_gated() {
    for (seconds, bodies) in [(20.0, 100), (40.0, 300)] {
        let frames_s = frames(seconds);
        let gated = (0..bodies).filter(|seed| {
            let mut draws = Draws::new(1000 + seed);
            // Sensors that rest, and bodies that wander by up to a millimetre.
            let wander_mm = 0.5 * (seed % 3) as f64;
            let body = Body::new(&mut draws, seconds, (0.0, 4.0), wander_mm);
            Gate::new(&body.sensed(&mut draws, seconds), &frames_s, SHARE).is_ok()
        });
        let gated = gated.count();
        assert!(100 * gated <= bodies as usize, "{gated} of {bodies} in {seconds} s");
    }
}

#[test]
fn breathing_is_found_beside_wander() {
    let seconds = 40.0;
    let frames_s = frames(seconds);
    let found = |mm: f64, wander_mm: f64| {
        let found = (0..50).filter(|seed| {
            let mut draws = Draws::new(5000 + seed);
            let body = Body::new(&mut draws, seconds, (mm, 4.2), wander_mm);
            Gate::new(&body.sensed(&mut draws, seconds), &frames_s, SHARE).is_ok()
        });
        found.count()
    };
    let counts = [(6.0, 0.5), (4.0, 0.5)].map(|(mm, wander_mm)| found(mm, wander_mm));
    assert!(counts[0] >= 47 && counts[1] >= 40, "{counts:?}");
}

#[test]
fn wander_of_a_body_at_rest_correlates_less_than_breathing() {
    for seconds in [10.0, 20.0, 30.0, 40.0, 60.0] {
        let mut correlations: Vec<f64> = (0..100)
            .map(|seed| {
                let mut draws = Draws::new(9000 + seed);
                let body = Body::new(&mut draws, seconds, (0.0, 4.0), 0.5 * (seed % 3) as f64);
                let grid = body.sensed(&mut draws, seconds).grid();
                periodic::period(&grid.band(), grid.step_s()).1
            })
            .collect();
        correlations.sort_unstable_by(f64::total_cmp);
        let reached = correlations[98];
        let least = periodic::by_chance(seconds);
        assert!(reached < least, "{seconds} s: {reached} of {least}");
    }
}

#[test]
fn what_shows_no_breathing_is_refused_by_name() {
    let mut draws = Draws::new(7);
    let gated = |signal: &Signal, seconds: f64| Gate::new(signal, &frames(seconds), SHARE).unwrap_err();
    let body = Body::new(&mut draws, 40.0, (6.0, 4.0), 0.0);
    let short = gated(&body.sensed(&mut draws, 5.0), 5.0);
    assert!(matches!(short, NotGated::Short { .. }) && short.to_string().contains("record 30 s or more"), "{short}");
    let small = Body::new(&mut draws, 40.0, (0.7, 4.0), 0.0);
    let small = gated(&small.sensed(&mut draws, 40.0), 40.0);
    assert!(matches!(small, NotGated::Small { size_mm } if size_mm < 1.0), "{small}");
    let rest = Body::new(&mut draws, 40.0, (0.0, 4.0), 0.5);
    let rest = gated(&rest.sensed(&mut draws, 40.0), 40.0);
    assert!(matches!(rest, NotGated::NotPeriodic { .. }), "{rest}");
    let mut hurried = Body::new(&mut draws, 40.0, (6.0, 5.0), 0.0);
    let late = Body::new(&mut draws, 60.0, (6.0, 2.5), 0.0);
    hurried.breaths.retain(|(begin, _)| *begin < 20.0);
    hurried.breaths.extend(late.breaths.into_iter().filter(|(begin, _)| *begin > 22.0));
    let hurried = gated(&hurried.sensed(&mut draws, 40.0), 40.0);
    assert!(matches!(hurried, NotGated::Irregular { .. } | NotGated::NotPeriodic { .. }), "{hurried}");
    assert!(matches!(gated(&Signal::of_positions(&[]), 5.0), NotGated::Short { seconds: 0.0 }));
}

#[test]
fn gap_of_a_signal_is_not_interpolated() {
    let mut draws = Draws::new(3);
    let body = Body::new(&mut draws, 60.0, (6.0, 4.0), 0.0);
    let all: Vec<(f64, DVec3)> =
        (0..7200).map(|at| f64::from(at) / RATE).map(|t| (t, DVec3::X * body.breath_mm(t))).collect();
    let with_gap: Vec<_> = all.into_iter().filter(|(time_s, _)| !(20.0..23.0).contains(time_s)).collect();
    let gate = Gate::new(&Signal::of_positions(&with_gap), &frames(60.0), SHARE).unwrap();
    let early = frames(60.0).iter().zip(&gate.accepted).filter(|(time_s, is)| **time_s < 23.0 && **is).count();
    assert_eq!(early, 0, "nothing is known before the gap");
}

#[test]
fn depth_shift_of_images_is_found() {
    // Layers that move in depth by 0.4 mm an image, of 0.5 mm pixels.
    let (width, height) = (120, 160);
    let image = |shift_mm: f64| -> Vec<u8> {
        let grey = |v: usize| {
            let depth_mm = 0.5 * v as f64 - shift_mm;
            (128.0 + 60.0 * libm::sin(0.35 * depth_mm) + 40.0 * libm::sin(0.13 * depth_mm)).round() as u8
        };
        (0..height).flat_map(|v| std::iter::repeat_n(grey(v), width)).collect()
    };
    let mut shifts = DepthShift::new([0.5, 0.5]);
    assert_eq!(shifts.add(&image(0.0), width), 0.0);
    for step in 1..10 {
        let found = shifts.add(&image(0.4 * f64::from(step)), width);
        assert!((found - 0.4).abs() < 0.03, "{found}");
    }
    assert_eq!(shifts.add(&vec![7; 40 * 40], 40), 0.0, "an image of another size begins anew");
    assert_eq!(shifts.add(&vec![9; 40 * 40], 40), 0.0, "constant images tell no shift");
}

#[test]
fn shifts_of_a_body_seen_in_depth_are_gated() {
    let (seconds, mut draws) = (40.0, Draws::new(21));
    let body = Body::new(&mut draws, seconds, (6.0, 4.0), 0.0);
    let frames_s = frames(seconds);
    let shifts: Vec<(f64, f64)> = frames_s
        .iter()
        .map(|time_s| {
            (*time_s, body.breath_mm(*time_s) - body.breath_mm(time_s - 1.0 / FRAMES) + 0.02 * draws.normal())
        })
        .collect();
    let gate = Gate::new(&Signal::of_shifts(&shifts), &frames_s, SHARE).unwrap();
    let left = left_mm(&body, &gate, &frames_s);
    assert!(left < 0.5, "{left}");
}

//! Freehand and arm sweeps: smooth random walks about a straight sweep.

use std::f64::consts::TAU;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::elementary::{exp, sin_cos};
use crate::random::{Draws, Purpose};

/// Correlation length of the deviation along the sweep, mm (σ of the smoothing).
const HAND_MEMORY_MM: f64 = 4.2;
/// Standard deviation of the sideways wobble along world x and y, mm.
const HAND_WOBBLE_MM: f64 = 0.8;
/// Standard deviation of the tilt about each world axis, rad (3°).
pub(super) const HAND_TILT: f64 = 0.052;
/// An arm turns by this multiple of the freehand tilt: 6°, as in slight fanning during a sweep.
const ARM_TURN: f64 = 2.0;
/// Relative standard deviation of the speed.
const HAND_SPEED: f64 = 0.35;

/// Parts of an unsteady hand's motion: wavelengths along the sweep, mm; standard deviations along
/// (mm) and about (rad) each axis.
struct Unsteady {
    wavelengths_mm: [f64; 2],
    position_mm: f64,
    tilt: f64,
}

/// Waves of a part.
const WAVES: usize = 8;
/// Corrections, and tremor of 0.04 mm and 0.05° over all axes. At 10.5 mm/s, corrections are from
/// 0.4 to 2 Hz and tremor from 7 to 11 Hz (Riviere, Rader & Khosla, IEEE EMBS 1997: below 2 Hz lies
/// nearly all voluntary motion of a hand, and a tremor of tens of micrometres above).
const UNSTEADY: [Unsteady; 2] = [
    Unsteady { wavelengths_mm: [5.25, 26.25], position_mm: 0.05, tilt: 1.75e-3 },
    Unsteady { wavelengths_mm: [0.955, 1.5], position_mm: 0.023, tilt: 5.0e-4 },
];

/// Returns a freehand sweep along z with corrections and tremor of the hand, as smooth functions of
/// the distance swept. The same seed gives the same motion for any gap.
pub(super) fn unsteady(frames: u32, gap_mm: f64, seed: u64) -> Vec<DAffine3> {
    let mut draws = Draws::new(seed, Purpose::Tremor, 0);
    // Each has a reciprocal wavelength, a phase and a direction, for shift and tilt.
    let waves: Vec<_> = UNSTEADY
        .iter()
        .flat_map(|part| {
            let [short, long] = part.wavelengths_mm;
            let size = (6.0 / WAVES as f64).sqrt();
            let kinds = [part.position_mm, part.tilt].map(|sd| size * sd);
            std::iter::repeat_n((short, long, kinds), WAVES)
        })
        .map(|(short, long, kinds)| {
            kinds.map(|size| {
                let per_mm = draws.uniform(1.0 / long, 1.0 / short);
                let phase = draws.uniform(0.0, 1.0);
                let direction = DVec3::new(draws.normal(), draws.normal(), draws.normal()).normalize();
                (per_mm, phase, direction * size)
            })
        })
        .collect();
    let steady = freehand(frames, gap_mm, seed);
    let from_middle = |frame: usize| (frame as f64 - 0.5 * f64::from(frames - 1)) * gap_mm;
    let moved = steady.into_iter().enumerate().map(|(frame, pose)| {
        let mut moved = [DVec3::ZERO; 2];
        for wave in &waves {
            for ((per_mm, phase, size), moved) in wave.iter().zip(&mut moved) {
                *moved += *size * sin_cos((from_middle(frame) * per_mm + phase).rem_euclid(1.0) * TAU).0;
            }
        }
        let [shift, tilt] = moved;
        DAffine3 { matrix3: small_turn(tilt * 0.5) * pose.matrix3, translation: pose.translation + shift }
    });
    moved.collect()
}

/// Returns a freehand sweep along z. Its mean speed is exact; wobble, tilt and speed vary
/// smoothly about their means.
pub(super) fn freehand(frames: u32, gap_mm: f64, seed: u64) -> Vec<DAffine3> {
    let [x, y, pitch, yaw, roll, speed] = wander(frames, gap_mm, seed);
    walk(frames, gap_mm, &speed, |i| Deviation { aside: [x[i], y[i]], tilt: DVec3::new(pitch[i], yaw[i], roll[i]) })
}

/// Returns a sweep along z by an arm whose joints all turn about x. It wanders along y and
/// turns about x as in a freehand sweep, without other deviations.
pub(super) fn arm(frames: u32, gap_mm: f64, seed: u64) -> Vec<DAffine3> {
    let [y, pitch, speed] = wander(frames, gap_mm, seed);
    walk(frames, gap_mm, &speed, |i| Deviation { aside: [0.0, y[i]], tilt: DVec3::new(ARM_TURN * pitch[i], 0.0, 0.0) })
}

/// Returns independent smooth walks of variance 1, one for each way to deviate.
fn wander<const N: usize>(frames: u32, gap_mm: f64, seed: u64) -> [Vec<f64>; N] {
    let mut draws = Draws::new(seed, Purpose::Trajectory, 0);
    std::array::from_fn(|_| smooth_noise(&mut draws, frames as usize, HAND_MEMORY_MM / gap_mm))
}

/// A pose's deviation from the straight sweep, in standard deviations of each.
struct Deviation {
    /// Along world x and y.
    aside: [f64; 2],
    /// About world x, y and z.
    tilt: DVec3,
}

fn walk(frames: u32, gap_mm: f64, speed: &[f64], deviation: impl Fn(usize) -> Deviation) -> Vec<DAffine3> {
    let count = frames as usize;
    // The probe never stops or turns back: other trajectories do that.
    let steps: Vec<f64> = speed.iter().skip(1).map(|s| (1.0 + HAND_SPEED * s).max(0.2)).collect();
    let length = gap_mm * f64::from(frames - 1);
    let scale = if steps.is_empty() { 0.0 } else { length / steps.iter().sum::<f64>() };
    let mut travelled = 0.0;
    (0..count)
        .map(|i| {
            if i > 0 {
                travelled += steps[i - 1] * scale;
            }
            let Deviation { aside: [x, y], tilt } = deviation(i);
            DAffine3 {
                matrix3: small_turn(tilt * (0.5 * HAND_TILT)),
                translation: DVec3::new(HAND_WOBBLE_MM * x, HAND_WOBBLE_MM * y, travelled - 0.5 * length),
            }
        })
        .collect()
}

/// White noise smoothed by a Gaussian of `memory` samples, of variance 1 at every sample.
fn smooth_noise(draws: &mut Draws, count: usize, memory: f64) -> Vec<f64> {
    // Very fine sweeps would smooth over thousands of samples without visible effect.
    let memory = memory.clamp(0.25, 400.0);
    let reach = (4.0 * memory).ceil() as usize;
    let weights: Vec<f64> = (0..=2 * reach)
        .map(|k| {
            let distance = (k as f64 - reach as f64) / memory;
            exp(-0.5 * distance * distance)
        })
        .collect();
    let norm = weights.iter().map(|w| w * w).sum::<f64>().sqrt();
    let white: Vec<f64> = (0..count + 2 * reach).map(|_| draws.normal()).collect();
    white
        .windows(weights.len())
        .map(|window| window.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() / norm)
        .collect()
}

/// Returns the rotation by 2 atan(|half|) about `half`: the quaternion (1, half), normalised.
/// It uses only square roots, for the same bits everywhere.
pub(crate) fn small_turn(half: DVec3) -> DMat3 {
    let norm = (1.0 + half.length_squared()).sqrt();
    DMat3::from_quat(DQuat::from_xyzw(half.x / norm, half.y / norm, half.z / norm, 1.0 / norm))
}

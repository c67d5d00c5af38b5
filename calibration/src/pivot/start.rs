//! The algebraic start: the tip and the pivot that most poses agree with.

use glam::{DMat3, DVec3};

use crate::least_squares::loss::spread;

/// Poses per sample: three determine tip and pivot; a fourth adds stability.
const SAMPLE: usize = 4;
/// Number of samples. If half of the poses are wrong, one sample in 16 has no wrong pose. The
/// probability that all 300 contain one is below 10⁻⁸.
const SAMPLES: usize = 300;
/// Maximum number of poses that judge a sample, evenly taken.
const JUDGES: usize = 600;
/// Poses within this many standard deviations agree: 99 % for three Gaussian components.
const NEAR: f64 = 3.368;

/// Finds tip and pivot. Chooses the sample whose residuals have the least median (Rousseeuw, J.
/// Am. Stat. Assoc. 79, 1984), then solves for all poses that agree with it.
pub(super) fn find(poses: &[(DMat3, DVec3)]) -> [DVec3; 2] {
    let step = poses.len().div_ceil(JUDGES);
    let judges: Vec<_> = poses.iter().step_by(step).copied().collect();
    let median =
        |solved: &[DVec3; 2]| spread(&judges.iter().map(|pose| (3, distance(pose, solved))).collect::<Vec<_>>());
    let mut best = (f64::INFINITY, [DVec3::ZERO; 2]);
    for number in 0..SAMPLES {
        let sample: Vec<_> = (0..SAMPLE).map(|k| poses[place(number * SAMPLE + k, poses.len())]).collect();
        let Some(solved) = algebraic(&sample) else { continue };
        let spread = median(&solved);
        if spread < best.0 {
            best = (spread, solved);
        }
    }
    let (spread, solved) = best;
    let near: Vec<_> = poses.iter().filter(|pose| distance(pose, &solved) <= NEAR * spread).copied().collect();
    algebraic(&near).unwrap_or(solved)
}

/// Returns the `number`th index of a sequence that is spread evenly but unordered: multiples of
/// the golden ratio.
fn place(number: usize, places: usize) -> usize {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let share = ((number + 1) as f64 * GOLDEN).fract();
    // Scattered once more, so that neighbours in the sequence are unrelated.
    let scattered = (share * 1e4).fract();
    ((scattered * places as f64) as usize).min(places - 1)
}

fn distance((turn, at): &(DMat3, DVec3), [tip, pivot]: &[DVec3; 2]) -> f64 {
    (*turn * *tip + *at - *pivot).length()
}

/// Solves R·tip − pivot = −t by least squares. The pivot is the mean of the tip's positions,
/// which leaves three equations for the tip. `None` if they have no unique solution.
pub(super) fn algebraic(poses: &[(DMat3, DVec3)]) -> Option<[DVec3; 2]> {
    let count = poses.len() as f64;
    let (mut turn, mut at) = (DMat3::ZERO, DVec3::ZERO);
    for (r, t) in poses {
        turn += *r;
        at += *t;
    }
    let (turn, at) = (turn * (1.0 / count), at / count);
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for (r, t) in poses {
        let by_turn = (*r - turn).transpose();
        normal += by_turn * (*r - turn);
        right -= by_turn * (*t - at);
    }
    let size = normal.x_axis.x + normal.y_axis.y + normal.z_axis.z;
    // For rotations about one axis the determinant is a rounding error.
    (normal.determinant() > 1e-9 * size.powi(3)).then(|| {
        let tip = normal.inverse() * right;
        [tip, turn * tip + at]
    })
}

//! The algebraic start: the tip and the pivot that most poses agree with.

use glam::{DMat3, DVec3};

use crate::least_squares::loss::spread;

/// Poses of a sample: three determine tip and pivot, a fourth makes that steadier.
const SAMPLE: usize = 4;
/// So many samples: of poses half of which are wrong, one in 16 has none of these; that 300 have one each is less likely than 10⁻⁸.
const SAMPLES: usize = 300;
/// Samples are judged by so many poses at most, evenly taken.
const JUDGES: usize = 600;
/// Poses within this many standard deviations are taken: 99 % of three Gaussian components.
const NEAR: f64 = 3.368;

/// Tip and pivot: of samples of poses the one whose residuals have the least median (Rousseeuw, J. Am. Stat. Assoc. 79, 1984), then from all poses that agree with it.
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

/// The `number`th of a sequence of places that is spread evenly and in no order: multiples of the golden ratio.
fn place(number: usize, places: usize) -> usize {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let share = ((number + 1) as f64 * GOLDEN).fract();
    // Scattered once more, so that neighbours in the sequence have nothing to do with each other.
    let scattered = (share * 1e4).fract();
    ((scattered * places as f64) as usize).min(places - 1)
}

fn distance((turn, at): &(DMat3, DVec3), [tip, pivot]: &[DVec3; 2]) -> f64 {
    (*turn * *tip + *at - *pivot).length()
}

/// Least squares over R·tip − pivot = −t. The pivot is the mean of where poses put the tip, which leaves three equations for the tip. `None` where they have no one solution.
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
    // Rotations about one axis: the determinant is rounding's.
    (normal.determinant() > 1e-9 * size.powi(3)).then(|| {
        let tip = normal.inverse() * right;
        [tip, turn * tip + at]
    })
}

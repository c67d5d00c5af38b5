//! Axes and variances of a covariance.

use glam::{DMat3, DVec3};

/// Returns the eigenvalues of a symmetric matrix, with their unit eigenvectors as columns. Uses
/// Jacobi rotations, computed with square roots only.
pub(super) fn eigen(matrix: &DMat3) -> ([f64; 3], DMat3) {
    let mut a = matrix.to_cols_array_2d();
    let mut axes = DMat3::IDENTITY.to_cols_array_2d();
    // Convergence is quadratic: five rounds reach rounding, the others are safety.
    for _ in 0..12 {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let on = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if off <= 1e-17 * on {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cos = 1.0 / (t * t + 1.0).sqrt();
            let sin = t * cos;
            let turn = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
            for row in &mut a {
                (row[p], row[q]) = turn(row[p], row[q]);
            }
            (a[p], a[q]) = {
                let mut pair = (a[p], a[q]);
                for k in 0..3 {
                    (pair.0[k], pair.1[k]) = turn(pair.0[k], pair.1[k]);
                }
                pair
            };
            // The rows of the array `axes` are the columns of the resulting matrix.
            let mut pair = (axes[p], axes[q]);
            for k in 0..3 {
                (pair.0[k], pair.1[k]) = turn(pair.0[k], pair.1[k]);
            }
            (axes[p], axes[q]) = pair;
        }
    }
    let [x, y, z] = axes.map(DVec3::from_array);
    ([a[0][0], a[1][1], a[2][2]], DMat3::from_cols(x, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn axes_and_variances_recompose_matrix() {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.5, -0.3, 0.8));
        for variances in [DVec3::new(0.1, 0.5, 2.0), DVec3::new(0.13, 0.13, 0.7), DVec3::ONE, DVec3::new(0.0, 0.0, 3.0)]
        {
            for turn in [turn, DMat3::IDENTITY, turn * turn] {
                let matrix = turn * DMat3::from_diagonal(variances) * turn.transpose();
                let (values, axes) = eigen(&matrix);
                let again = axes * DMat3::from_diagonal(DVec3::from_array(values)) * axes.transpose();
                let close = |a: DMat3, b: DMat3| (a - b).to_cols_array().iter().all(|x| x.abs() < 1e-14);
                assert!(close(again, matrix) && close(axes.transpose() * axes, DMat3::IDENTITY), "{variances}");
            }
        }
    }
}

//! Extent of a stylus's rotation, and its axes.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

use crate::error::PivotError;

/// Spread of a stylus's directions. The poses determine the tip along a direction of the
/// sensor's frame only as far as this direction turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    /// Three orthogonal directions in the sensor's frame, the one that turned least first.
    pub axes: [DVec3; 3],
    /// Rotation of each, degrees (root mean square).
    pub deg: [f64; 3],
}

impl Turning {
    /// Computes the rotation of poses. A direction v turned by asin √(1 − |R̄·v|²), where R̄ is
    /// the mean of the rotations.
    pub(crate) fn of(poses: &[(DMat3, DVec3)]) -> Self {
        let mut sum = DMat3::ZERO;
        for (turn, _) in poses {
            sum += *turn;
        }
        let mean = sum * (1.0 / poses.len().max(1) as f64);
        let spread = DMat3::IDENTITY - mean.transpose() * mean;
        let eigen = SymmetricEigen::new(Matrix3::from_column_slice(&spread.to_cols_array()));
        let mut found: Vec<(f64, DVec3)> = (0..3)
            .map(|k| {
                let axis = DVec3::from_array([0, 1, 2].map(|i| eigen.eigenvectors[(i, k)]));
                // Takes the sense of an axis that makes its largest coordinate positive.
                let sign = if axis.dot(axis.abs()) < 0.0 { -1.0 } else { 1.0 };
                (eigen.eigenvalues[k].clamp(0.0, 1.0).sqrt().asin().to_degrees(), axis * sign)
            })
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { axes: [0, 1, 2].map(|k| found[k].1), deg: [0, 1, 2].map(|k| found[k].0) }
    }

    /// Checks that the rotation is sufficient.
    pub(super) fn check(&self, poses: &[(DMat3, DVec3)], least: f64) -> Result<(), PivotError> {
        if poses.windows(2).all(|two| two[0] == two[1]) {
            return Err(PivotError::OnePose { poses: poses.len() });
        }
        // For a fixed axis the two directions perpendicular to it turn alike: the second gives
        // the amount.
        let [of_axis, about_it, _] = self.deg;
        if about_it < least {
            return Err(PivotError::HardlyTurned { deg: self.deg[2], least });
        }
        if of_axis < least {
            return Err(PivotError::OneAxis { axis: self.axes[0], deg: of_axis, least });
        }
        Ok(())
    }
}

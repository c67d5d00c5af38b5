//! Derivatives of an arm's pose by its joint values and parameters, and the effect of count
//! errors on a point of the image.

use glam::{DMat3, DVec2, DVec3};

use sonoweave_core::rotation::direction;

use super::{Arm, JOINTS, Kind, Values};

/// Derivatives of the pose (x in mm, y in mm, heading in rad) by the numbers of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// Derivative by its value, rad or mm.
    pub value: DVec3,
    /// Derivative by its count.
    pub count: DVec3,
    /// Derivative by its link's length, mm.
    pub length: DVec3,
    /// Derivative by the count at its zero.
    pub zero_counts: DVec3,
    /// Derivative by its counts per turn or per mm.
    pub counts_per_unit: DVec3,
    /// Derivative by the direction of a prismatic joint, degrees; 0 for a revolute joint.
    pub direction: DVec3,
}

/// Possible distance of a point from the position computed from the counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Displacement {
    /// Upper bound, mm.
    pub most_mm: f64,
    /// Root mean square, if all errors are uniformly distributed and independent, mm.
    pub rms_mm: f64,
}

impl Arm {
    /// Returns the derivatives of the pose by each joint's value and parameters, at these
    /// values.
    pub fn derivatives(&self, values: &Values) -> [Derivatives; JOINTS] {
        let (links, _) = self.links(values);
        let end = links[JOINTS - 1].end;
        std::array::from_fn(|i| {
            let (joint, link) = (&self.joints()[i], &links[i]);
            let turn = (end - link.joint).perp().extend(1.0);
            let along = link.along.extend(0.0);
            let (value, direction) = match joint.kind {
                Kind::Revolute => (turn, DVec3::ZERO),
                Kind::Prismatic { .. } => (along, turn * 1_f64.to_radians()),
            };
            let count = value * joint.value_per_count();
            let counts_per_unit = -value * (values[i] / joint.counts_per_unit);
            Derivatives { value, count, length: along, zero_counts: -count, counts_per_unit, direction }
        })
    }

    /// Returns the Jacobian of (x mm, y mm, heading rad) by the joint values, one column per
    /// joint.
    pub fn jacobian(&self, values: &Values) -> DMat3 {
        let [a, b, c] = self.derivatives(values).map(|by| by.value);
        DMat3::from_cols(a, b, c)
    }

    /// Returns the condition number of the pose by the counts, |J|·|J⁻¹|/3 in the Frobenius
    /// norm. The heading is weighted by its effect at `lever_mm` from the probe's origin. The
    /// result is 1 if the counts move the pose by equal amounts in orthogonal directions, and ∞
    /// if the arm is singular.
    pub fn condition(&self, values: &Values, lever_mm: f64) -> f64 {
        let [a, b, c] = self.derivatives(values).map(|by| by.count * DVec3::new(1.0, 1.0, lever_mm));
        let jacobian = DMat3::from_cols(a, b, c);
        let norm = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        let size = norm(jacobian);
        // A determinant of rounding size counts as zero.
        if jacobian.determinant().abs() <= 1e-14 * size.powi(3) {
            return f64::INFINITY;
        }
        size * norm(jacobian.inverse()) / 3.0
    }

    /// Returns the covariance of the pose (x mm, y mm, heading rad) to first order, for
    /// independent counts with these standard deviations.
    pub fn covariance(&self, values: &Values, sd_counts: &[f64; JOINTS]) -> DMat3 {
        let columns = self.derivatives(values);
        let mut sum = DMat3::ZERO;
        for (by, sd) in columns.iter().zip(sd_counts) {
            let column = by.count * *sd;
            sum += DMat3::from_cols(column * column.x, column * column.y, column * column.z);
        }
        sum
    }

    /// Returns the possible displacement of a point of the probe's x-y plane (mm) at these
    /// values. Each count is off by at most `counts`: 0.5 for an encoder that shows the nearest
    /// count.
    ///
    /// The bound holds for any such errors, not to first order only: joints moved one by one,
    /// the last first, displace the point by an arc each.
    pub fn displacement(&self, values: &Values, point_mm: DVec2, counts: f64) -> Displacement {
        let (links, heading) = self.links(values);
        let point = links[JOINTS - 1].end + direction(heading).rotate(point_mm);
        let (mut most_mm, mut squares) = (0.0, 0.0);
        for (joint, link) in self.joints().iter().zip(&links).rev() {
            let off = counts * joint.value_per_count().abs();
            let lever = match joint.kind {
                Kind::Revolute => (point - link.joint).length(),
                Kind::Prismatic { .. } => 1.0,
            };
            squares += (lever * off).powi(2) / 3.0;
            most_mm += match joint.kind {
                Kind::Revolute => (lever + most_mm) * off,
                Kind::Prismatic { .. } => off,
            };
        }
        Displacement { most_mm, rms_mm: squares.sqrt() }
    }
}

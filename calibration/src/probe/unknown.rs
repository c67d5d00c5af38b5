//! The image plane as least squares parameters: its rotation and position in the probe's frame,
//! the pixel size along u and v, and optionally their skew.

use glam::{DQuat, DVec2, DVec3};

use super::plane::{ImagePlane, NUMBERS};
use crate::least_squares::{Parameters, Residual, Rotation, Scale, Side, State, Vector};

/// Places of the plane's numbers among the parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnknownPlane {
    turn: Rotation,
    place: Vector<3>,
    size: Scale<2>,
    skew: Vector<1>,
    pivot_px: DVec2,
    lever_mm: f64,
}

impl UnknownPlane {
    /// Starts at a plane and rotates about the centre of the observed pixels. Their extent
    /// gives the typical sizes of rotations and scales.
    pub(super) fn new(parameters: &mut Parameters, start: &ImagePlane, seen_px: &[DVec2], skew: bool) -> Self {
        let pivot_px = seen_px.iter().sum::<DVec2>() / seen_px.len().max(1) as f64;
        let reach = seen_px.iter().map(|px| px.distance(pivot_px)).fold(1.0, f64::max);
        let [size_u, size_v] = start.pixel_mm();
        let lever_mm = reach * size_u.max(size_v);
        let axes = start.axes();
        let (x, y) = (axes.x_axis, axes.y_axis);
        let turn = DQuat::from_mat3(&axes);
        let skewed = if skew { start.v.dot(x) / start.v.dot(y) } else { 0.0 };
        let unknown = Self {
            turn: parameters.rotation("the picture's turn", Side::Right, 1.0 / lever_mm, turn),
            place: parameters.point("the picture's place", 1.0, start.point(pivot_px)),
            size: parameters.scale("pixel size", ["along u", "along v"], 1.0 / lever_mm, [size_u, start.v.dot(y)]),
            skew: parameters.vector("skew", [""], "", 1.0 / lever_mm, [skewed]),
            pivot_px,
            lever_mm,
        };
        if !skew {
            parameters.hold(unknown.skew);
        }
        unknown
    }

    /// Returns the pixel at which the plane's position is defined.
    pub(super) fn pivot_px(&self) -> DVec2 {
        self.pivot_px
    }

    /// Returns the distance from there to the farthest observed pixel, mm, at the start.
    pub(super) fn lever_mm(&self) -> f64 {
        self.lever_mm
    }

    /// Returns the plane at a state.
    pub(super) fn plane(&self, state: &State) -> ImagePlane {
        let turn = state.rotation(self.turn);
        let ([size_u, size_v], [skew]) = (state.scale(self.size), state.vector(self.skew));
        let (u, v) = (turn * (DVec3::X * size_u), turn * (DVec3::new(skew, 1.0, 0.0) * size_v));
        let origin = state.point(self.place) - u * self.pivot_px.x - v * self.pivot_px.y;
        ImagePlane { u, v, origin }
    }

    /// Returns the derivatives of a pixel's position in the probe's frame by each of the
    /// plane's numbers.
    pub(super) fn changes(&self, state: &State, px: DVec2) -> [DVec3; NUMBERS] {
        self.plane(state).changes(self.pivot_px, px)
    }

    /// Adds derivatives by the plane's numbers to those of a residual.
    pub(super) fn add_to<'b, 'a, const N: usize>(
        &self,
        residual: Residual<'b, 'a, N>,
        derivatives: [[f64; NUMBERS]; N],
    ) -> Residual<'b, 'a, N> {
        residual
            .by(self.turn, derivatives.map(|row| [row[0], row[1], row[2]]))
            .by(self.place, derivatives.map(|row| [row[3], row[4], row[5]]))
            .by(self.size, derivatives.map(|row| [row[6], row[7]]))
            .by(self.skew, derivatives.map(|row| [row[8]]))
    }

    /// Returns the derivatives of a pixel's position as the first of N numbers; the others do
    /// not depend on the plane.
    pub(super) fn first_of<const N: usize>(&self, state: &State, px: DVec2) -> [[f64; NUMBERS]; N] {
        let changes = self.changes(state, px);
        std::array::from_fn(|row| if row < 3 { changes.map(|change| change[row]) } else { [0.0; NUMBERS] })
    }
}

/// Returns the derivatives of the plane's numbers as the first of N numbers; the others do not
/// depend on the plane.
pub(super) fn own_numbers<const N: usize>() -> [[f64; NUMBERS]; N] {
    std::array::from_fn(|row| std::array::from_fn(|column| f64::from(u8::from(row == column))))
}

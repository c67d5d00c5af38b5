//! A flat lattice of points.

use glam::DVec3;

/// A flat lattice of points: point (i, j) lies at `origin + i·step_u + j·step_v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// World mm of point (0, 0).
    pub origin: DVec3,
    /// Step between points along u, mm.
    pub step_u: DVec3,
    /// Step between points along v, mm.
    pub step_v: DVec3,
    /// Points along u.
    pub width: usize,
    /// Points along v.
    pub height: usize,
}

impl Sheet {
    /// Returns a point's world mm, computed from the origin and not from its neighbour: errors
    /// must not add up along a row.
    pub fn point(&self, i: usize, j: usize) -> DVec3 {
        self.origin + self.step_u * i as f64 + self.step_v * j as f64
    }

    /// Whether the axes are perpendicular, as the product of two Gaussians requires.
    pub(super) fn is_rectangular(&self) -> bool {
        self.step_u.dot(self.step_v).abs() <= 1e-12 * self.step_u.length() * self.step_v.length()
    }
}

pub(super) fn rows<'a>(sheet: &Sheet, grey: &'a mut [f64]) -> impl Iterator<Item = (usize, &'a mut [f64])> + use<'a> {
    grey.chunks_exact_mut(sheet.width.max(1)).enumerate()
}

/// Returns the indices of points within `reach` of `middle`, on an axis of `count` points
/// `pitch` apart; `None` if there are none.
pub(super) fn indices_within(middle: f64, reach: f64, pitch: f64, count: usize) -> Option<std::ops::Range<usize>> {
    let first = ((middle - reach) / pitch).ceil().max(0.0);
    let end = (((middle + reach) / pitch).floor() + 1.0).min(count as f64);
    (first < end).then_some(first as usize..end as usize)
}

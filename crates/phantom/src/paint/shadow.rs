//! Blobs: on two perpendicular axes an isotropic Gaussian is the product of one Gaussian along
//! each.

use super::sheet::{Sheet, indices_within};
use crate::elementary::exp;
use crate::scene::Blob;

/// Blobs end this many σ from their centres, where they are below 1e-9 of their amplitude.
const BLOB_REACH: f64 = 6.5;

/// Footprint of a blob on a sheet: the product of a Gaussian along u and one along v.
pub(super) struct Shadow {
    first_u: usize,
    along_u: Vec<f64>,
    first_v: usize,
    /// Includes the amplitude and the attenuation by the blob's distance from the plane.
    along_v: Vec<f64>,
}

impl Shadow {
    /// Returns the footprint; `None` if the blob is too far from the sheet.
    pub(super) fn cast(blob: &Blob, sheet: &Sheet) -> Option<Self> {
        let reach = BLOB_REACH * blob.sigma;
        let offset = blob.centre - sheet.origin;
        let (pitch_u, pitch_v) = (sheet.step_u.length(), sheet.step_v.length());
        let (u, v) = (offset.dot(sheet.step_u) / pitch_u, offset.dot(sheet.step_v) / pitch_v);
        let normal = sheet.step_u.cross(sheet.step_v) / (pitch_u * pitch_v);
        let distance = offset.dot(normal);
        let left = reach * reach - distance * distance;
        if left <= 0.0 {
            return None;
        }
        let in_plane = left.sqrt();
        let span_u = indices_within(u, in_plane, pitch_u, sheet.width)?;
        let span_v = indices_within(v, in_plane, pitch_v, sheet.height)?;
        let falloff = |mm: f64| exp(-mm * mm / (2.0 * blob.sigma * blob.sigma));
        let height = blob.amplitude * falloff(distance);
        Some(Self {
            first_u: span_u.start,
            along_u: span_u.map(|i| falloff(i as f64 * pitch_u - u)).collect(),
            first_v: span_v.start,
            along_v: span_v.map(|j| height * falloff(j as f64 * pitch_v - v)).collect(),
        })
    }

    pub(super) fn add_to(&self, j: usize, row: &mut [f64]) {
        let Some(scale) = j.checked_sub(self.first_v).and_then(|j| self.along_v.get(j)) else { return };
        for (value, u) in row[self.first_u..].iter_mut().zip(&self.along_u) {
            *value += scale * u;
        }
    }
}

//! Weights of slices by the gaps beside them.
//!
//! Slices lie unevenly: a hand slows down, and many slices come from one place. The mean counts
//! each of them, and so lies nearer to that place than the voxel does. A slice is therefore
//! weighted by half the distance from the slice before to the slice after, as in a sum over
//! intervals. Its weight is known when the next one comes.
//!
//! Distances are means over five points of the image, its middle and corners, across the plane of
//! the earlier slice. They are taken in units of the kernel's σ across the plane, so that the
//! weights of a voxel add up to much the same wherever slices are dense. A slice farther away than
//! 2.6 σ is no neighbour: another sweep begins there.

use glam::DVec3;

use sonoweave_core::frames::{Image, Transform, World};

/// Distance from which slices are no neighbours, σ: the kernel's usual end.
const FAR: f64 = 2.6;
/// Least weight. Slices of a probe at rest keep some, so that they are seen.
const LEAST: f64 = 0.01;

/// Weighs the slices of a sweep, in their order.
#[derive(Debug, Clone)]
pub struct GapWeights {
    sigma_mm: f64,
    last: Option<Last>,
}

/// The slice that waits for its weight.
#[derive(Debug, Clone)]
struct Last {
    pose: Transform<World, Image>,
    /// Distance of the slice before, σ; `None` if it is no neighbour.
    before: Option<f64>,
}

impl GapWeights {
    /// Begins, for a kernel of this σ across the plane.
    pub fn new(sigma_mm: f64) -> Self {
        Self { sigma_mm, last: None }
    }

    /// Takes the pose of the next slice, of `size` pixels, and returns the weight of the slice
    /// before it; `None` for the first.
    pub fn next(&mut self, pose: Transform<World, Image>, size: [u32; 2]) -> Option<f32> {
        let Some(Last { pose: earlier, before }) = self.last.take() else {
            self.last = Some(Last { pose, before: None });
            return None;
        };
        // The comparison is false for NaN.
        let gap = Some(distance_mm(earlier, pose, size) / self.sigma_mm).filter(|gap| *gap < FAR);
        self.last = Some(Last { pose, before: gap });
        Some(weight(before, gap))
    }

    /// Returns the weights of all slices of a sweep, whose poses are known.
    pub fn of_sweep(mut self, poses: impl IntoIterator<Item = Transform<World, Image>>, size: [u32; 2]) -> Vec<f32> {
        let mut weights: Vec<f32> = poses.into_iter().filter_map(|pose| self.next(pose, size)).collect();
        weights.extend(self.end());
        weights
    }

    /// Returns the weight of the last slice; later ones belong to another sweep. `None` if none
    /// waits.
    pub fn end(&mut self) -> Option<f32> {
        self.last.take().map(|last| weight(last.before, None))
    }
}

/// Returns the weight of a slice with neighbours at these distances, σ.
fn weight(before: Option<f64>, after: Option<f64>) -> f32 {
    let gap = match (before, after) {
        (Some(before), Some(after)) => 0.5 * (before + after),
        (Some(gap), None) | (None, Some(gap)) => gap,
        (None, None) => 1.0,
    };
    gap.max(LEAST) as f32
}

/// Returns the mean distance of a slice's middle and corners from the plane of an earlier one.
fn distance_mm(earlier: Transform<World, Image>, later: Transform<World, Image>, size: [u32; 2]) -> f64 {
    let normal = earlier.vector(DVec3::X).cross(earlier.vector(DVec3::Y)).normalize_or_zero();
    let [right, bottom] = size.map(|n| f64::from(n) - 1.0);
    let points = [[0.5 * right, 0.5 * bottom], [0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
    let distances = points.map(|[u, v]| {
        let point = DVec3::new(u, v, 0.0);
        normal.dot(later.point(point) - earlier.point(point)).abs()
    });
    distances.iter().sum::<f64>() / 5.0
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;

    use super::*;

    const SIZE: [u32; 2] = [11, 11];

    fn at(z_mm: f64) -> Transform<World, Image> {
        Transform::from_affine(DAffine3::from_translation(DVec3::new(0.1 * z_mm, 0.0, z_mm)))
    }

    fn weights(places_mm: &[f64]) -> Vec<f32> {
        let weights = GapWeights::new(0.5).of_sweep(places_mm.iter().map(|z| at(*z)), SIZE);
        assert_eq!(weights.len(), places_mm.len(), "each slice has one weight");
        weights
    }

    #[test]
    fn slice_counts_for_half_the_gaps_beside_it() {
        assert_eq!(weights(&[0.0, 0.2, 0.3, 0.7]), [0.4, 0.3, 0.5, 0.8]);
        assert_eq!(weights(&[7.0]), [1.0]);
        assert!(weights(&[]).is_empty());
        // There and back.
        assert_eq!(weights(&[0.0, 0.25, 0.0]), [0.5; 3]);
    }

    #[test]
    fn far_slices_begin_another_sweep() {
        let both = weights(&[0.0, 0.1, 0.2, 50.0, 50.3]);
        assert_eq!(both[..3], weights(&[0.0, 0.1, 0.2])[..]);
        assert!((both[3] - 0.6).abs() < 1e-6 && (both[4] - 0.6).abs() < 1e-6, "{both:?}");
        assert_eq!(weights(&[0.0, 5.0, 10.0]), [1.0; 3]);
    }

    #[test]
    fn probe_at_rest_keeps_the_least_weight() {
        assert_eq!(weights(&[1.0; 4]), [0.01; 4]);
    }

    #[test]
    fn turned_slices_are_apart_at_their_edges() {
        let mut weights = GapWeights::new(0.5);
        let turned = |angle: f64| {
            let middle = DVec3::new(5.0, 5.0, 0.0);
            let turn = glam::DMat3::from_rotation_x(angle);
            Transform::from_affine(DAffine3 { matrix3: turn, translation: middle - turn * middle })
        };
        assert!(weights.next(turned(0.0), SIZE).is_none());
        // Four corners are 5·sin(0.1) mm from the plane, the middle is in it.
        let expected = 0.8 * 5.0 * 0.1_f64.sin() / 0.5;
        assert!((f64::from(weights.next(turned(0.1), SIZE).unwrap()) - expected).abs() < 1e-6);
    }
}

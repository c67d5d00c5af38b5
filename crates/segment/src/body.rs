//! The body between contours, as signed distances in space.
//!
//! A point between two planes has the distances d₁, d₂ from their contours, in the planes. Its own
//! is between them, by its distances q₁, q₂ from the planes:
//! d = (|q₂|·d₁ + |q₁|·d₂) / (|q₁| + |q₂|) (Treece, Prager, Gee & Berman 1999). With planes before
//! and behind them, it is the cubic through the distances from all four: between ten contours of a
//! ball, straight lines lose more than 1 % of it.
//!
//! Where the largest discs of two contours are farther apart than half a radius, straight
//! interpolation would break the body. Both contours are then moved along the line between the
//! discs' centres (Treece, Prager, Gee & Berman 2000). The body ends flat at the first plane and at
//! the last one.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;

use sonoweave_core::frames::{Transform, Volume, World};

use crate::contour::Contour;
use crate::contours::Contours;
use crate::cubic::weights;
use crate::error::SegmentError;
use crate::field::{Field, VoxelBox};

/// Voxels of the box around the contours, so that the surface lies within.
const MARGIN: f64 = 2.0;
/// Voxels along the longest edge of the contours' box, if no spacing is given.
const VOXELS: f64 = 100.0;
/// Most voxels along an edge of the box, so that their indices are far from their limits.
const MOST_VOXELS: f64 = 1e5;

/// The body between contours.
#[derive(Debug)]
pub struct Body<'a> {
    contours: &'a Contours,
    /// Whether the contours of each pair are moved along the line between their discs.
    moved: Vec<bool>,
}

/// Lattice of a body's voxels, along the axes of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Edge of a voxel, mm.
    pub spacing_mm: f64,
    /// Centre of the first voxel, world mm.
    pub origin: DVec3,
    /// Voxels along each axis.
    pub size: [usize; 3],
}

impl Lattice {
    /// Returns the lattice around contours; `None` for a hundredth of the longest edge of their
    /// box.
    ///
    /// # Errors
    /// [`SegmentError::Setting`] for an impossible spacing, [`SegmentError::Wide`] for too many
    /// voxels.
    pub fn around(contours: &Contours, spacing_mm: Option<f64>) -> Result<Self, SegmentError> {
        let [low, high] = contours.bounds();
        let longest = (high - low).max_element();
        let spacing_mm = spacing_mm.unwrap_or(longest / VOXELS);
        if !(spacing_mm > 0.0 && spacing_mm.is_finite()) {
            return Err(SegmentError::Setting { setting: "the spacing", value: spacing_mm, needs: "above 0 mm" });
        }
        if longest / spacing_mm > MOST_VOXELS {
            let (setting, voxels) = ("a body", (longest / spacing_mm) as u64);
            return Err(SegmentError::Wide { setting, mm: longest, voxels, most: MOST_VOXELS as u64 });
        }
        let size = ((high - low) / spacing_mm).ceil() + DVec3::splat(2.0 * MARGIN + 1.0);
        let origin = low - DVec3::splat(MARGIN * spacing_mm);
        Ok(Self { spacing_mm, origin, size: size.to_array().map(|voxels| voxels as usize) })
    }

    /// Maps voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        let affine = DAffine3::from_scale(DVec3::splat(self.spacing_mm));
        Transform::from_affine(DAffine3 { translation: self.origin, ..affine })
    }

    /// Bytes of a field on it.
    pub fn bytes(&self) -> u64 {
        self.size.iter().fold(size_of::<f32>() as u64, |bytes, size| bytes.saturating_mul(*size as u64))
    }
}

impl<'a> Body<'a> {
    /// Returns the body between contours.
    pub fn new(contours: &'a Contours) -> Self {
        let is_moved = |pair: &[Contour]| {
            let [(from, first), (to, second)] = [pair[0].disc(), pair[1].disc()];
            let normal = (pair[0].normal() + pair[1].normal()).normalize_or_zero();
            (to - from).reject_from_normalized(normal).length() > 0.5 * first.min(second)
        };
        Self { contours, moved: contours.list().windows(2).map(is_moved).collect() }
    }

    /// Number of pairs of contours that are moved along the line between their discs.
    pub fn moved(&self) -> usize {
        self.moved.iter().filter(|moved| **moved).count()
    }

    /// Returns the signed distances on a lattice, mm, positive inside. They are approximate away
    /// from the body's surface.
    ///
    /// # Errors
    /// [`SegmentError::Memory`] if the field takes more than `limit_bytes`.
    pub fn field(&self, lattice: &Lattice, limit_bytes: u64) -> Result<Field, SegmentError> {
        if lattice.bytes() > limit_bytes {
            return Err(SegmentError::Memory { needed_bytes: lattice.bytes(), limit_bytes });
        }
        let space = VoxelBox { low: [0; 3], size: lattice.size };
        let world_from_lattice = lattice.world_from_lattice();
        let value = |place: usize| {
            let voxel = DVec3::from_array(space.voxel(place).map(|at| at as f64));
            self.distance(world_from_lattice.point(voxel)) as f32
        };
        Ok(Field::new(space, (0..space.voxels()).into_par_iter().map(value).collect()))
    }

    /// Returns the signed distance at a point, mm, positive inside.
    pub fn distance(&self, p: DVec3) -> f64 {
        let list = self.contours.list();
        let (first, last) = (&list[0], &list[list.len() - 1]);
        let ends = [first.height(p), -last.height(p)];
        // Behind a line where planes cross, a point is not between them.
        let pairs = (0..list.len() - 1).filter(|at| list[*at].height(p) >= 0.0 && list[at + 1].height(p) < 0.0);
        let between = pairs.map(|at| self.between(at, p));
        let at_ends = [first, last].into_iter().zip(ends).filter(|(_, end)| *end <= 0.0).map(|(c, _)| c.distance(p));
        between.chain(at_ends).fold(f64::NEG_INFINITY, f64::max).min(ends[0]).min(ends[1])
    }

    /// Returns the distance at a point between a contour's plane and the next one.
    fn between(&self, at: usize, p: DVec3) -> f64 {
        let list = self.contours.list();
        let heights = [list[at].height(p), -list[at + 1].height(p)];
        let step = heights[0] + heights[1];
        let t = heights[0] / step;
        // Planes that cross before the point are of no use there.
        let before = at.checked_sub(1).map(|before| list[before].height(p) - heights[0]).filter(|mm| *mm > 0.0);
        let after = list.get(at + 2).map(|after| -after.height(p) - heights[1]).filter(|mm| *mm > 0.0);
        let [weights, _] = weights(before, step, after, t);
        let path = self.moved[at].then(|| list[at].disc().0.lerp(list[at + 1].disc().0, t));
        let distance = |n: usize| {
            let contour = &list[at + n - 1];
            contour.distance(path.map_or(p, |path| p - path + contour.disc().0))
        };
        let used = [before.is_some(), true, true, after.is_some()];
        (0..4).filter(|n| used[*n]).map(|n| weights[n] * distance(n)).sum()
    }
}

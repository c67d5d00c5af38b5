//! A volume without its hidden voxels.

use glam::{DAffine3, DVec3};

use volume::Values;
use volume::brick::{BrickIndex, EDGE, VOXELS};

use super::Operation;
use super::shape::Shape;

/// The shapes of a crop on a lattice.
pub struct LatticeCrop {
    shapes: Vec<Shape>,
    world_from_lattice: DAffine3,
    /// Distance of a brick's farthest voxel from its middle, mm.
    radius: f64,
}

impl LatticeCrop {
    /// Returns the shapes of operations on a lattice; the map gives world mm.
    pub fn new(operations: &[Operation], world_from_lattice: DAffine3) -> Self {
        let axes = world_from_lattice.matrix3;
        // Rounding must not put a voxel outside.
        let radius = 0.5
            * (EDGE - 1) as f64
            * [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length).iter().sum::<f64>()
            * 1.0001;
        Self { shapes: operations.iter().filter_map(Shape::new).collect(), world_from_lattice, radius }
    }

    /// Returns the shapes that may hide some voxels of a brick only; `None` if one hides all.
    fn at(&self, brick: BrickIndex) -> Option<Vec<&Shape>> {
        let middle = DVec3::from(brick.map(|b| f64::from(b) * EDGE as f64 + 0.5 * (EDGE - 1) as f64));
        let middle = self.world_from_lattice.transform_point3(middle);
        let mut some = Vec::new();
        for shape in &self.shapes {
            match shape.hides_ball(middle, self.radius) {
                Some(true) => return None,
                Some(false) => {}
                None => some.push(shape),
            }
        }
        Some(some)
    }

    /// Returns whether it may hide voxels of a brick.
    pub fn reaches(&self, brick: BrickIndex) -> bool {
        self.at(brick).is_none_or(|some| !some.is_empty())
    }

    fn place(&self, voxel: [i64; 3]) -> DVec3 {
        self.world_from_lattice.transform_point3(DVec3::from(voxel.map(|x| x as f64)))
    }
}

/// A volume of which hidden voxels are unseen.
pub struct Cropped<'a, V: ?Sized> {
    volume: &'a V,
    crop: &'a LatticeCrop,
}

impl<'a, V: Values + ?Sized> Cropped<'a, V> {
    /// Returns the volume without the voxels that a crop of its lattice hides.
    pub fn new(volume: &'a V, crop: &'a LatticeCrop) -> Self {
        Self { volume, crop }
    }
}

impl<V: Values + ?Sized> Values for Cropped<'_, V> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.volume.values(start, value, weight);
        for (x, (value, weight)) in (0..).zip(value.iter_mut().zip(weight)) {
            let at = self.crop.place([start[0] + x, start[1], start[2]]);
            if self.crop.shapes.iter().any(|shape| shape.hides(at)) {
                (*value, *weight) = (0.0, 0.0);
            }
        }
    }

    fn brick(&self, block: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        if self.crop.shapes.is_empty() {
            return self.volume.brick(block, value, weight);
        }
        let Some(shapes) = self.crop.at(block) else {
            (*value, *weight) = ([0.0; VOXELS], [0.0; VOXELS]);
            return;
        };
        self.volume.brick(block, value, weight);
        if shapes.is_empty() {
            return;
        }
        let start = block.map(|b| i64::from(b) * EDGE as i64);
        for place in 0..VOXELS {
            let inside = [place % EDGE, place / EDGE % EDGE, place / (EDGE * EDGE)];
            let at = self.crop.place(std::array::from_fn(|a| start[a] + inside[a] as i64));
            if weight[place] > 0.0 && shapes.iter().any(|shape| shape.hides(at)) {
                (value[place], weight[place]) = (0.0, 0.0);
            }
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.volume.bricks()
    }
}

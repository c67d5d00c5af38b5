//! Who sees the volume while it is woven.

use std::time::Duration;

use glam::DVec3;

use super::PixelKind;
use crate::mask::Mask;
use crate::reconstruct::Weaver;
use crate::slice::Slice;
use crate::volume::Prism;
use crate::volume::brick::BrickIndex;

/// A slice that has just been woven.
pub struct Woven<'a> {
    /// Its frame's number in the recording.
    pub item: u64,
    /// The slice itself.
    pub slice: &'a Slice,
    /// Which of its pixels are data.
    pub mask: &'a Mask,
    /// The volume, its lattice and its kernels.
    pub weaver: &'a Weaver,
    /// Bricks that the slice changed.
    pub touched: &'a [BrickIndex],
    /// Where in them, if that is known: voxels by lattice index.
    pub slab: Option<Prism>,
    /// Whether the general path has taken over with this slice: any brick may have changed.
    pub upgraded: bool,
    /// What weaving took.
    pub insert: Duration,
    /// First and last voxel, by lattice index, that this and all later slices reach.
    pub reached: Option<[[i64; 3]; 2]>,
    /// Mean directions of u and v of all slices in the world, where there are such.
    pub slice_axes: Option<[DVec3; 2]>,
    /// Scalar type of its picture.
    pub pixels: PixelKind,
}

/// Is called after each slice that entered the volume, before the next one is read.
pub trait Onlooker {
    /// Looks.
    ///
    /// # Errors
    /// Any; the run ends with it.
    fn woven(&mut self, woven: &Woven) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

/// Nobody looks: nothing is done.
impl Onlooker for () {
    fn woven(&mut self, _: &Woven) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(())
    }
}

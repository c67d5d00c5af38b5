//! Observers of the volume during a reconstruction.

use std::time::Duration;

use glam::DVec3;

use mask::Mask;
use reconstruct::PathReconstructor;
use sonoweave_core::slice::Slice;
use volume::Prism;
use volume::brick::BrickIndex;

use super::PixelKind;

/// A slice that has just been inserted.
pub struct InsertedSlice<'a> {
    /// Its frame's number in the recording.
    pub item: u64,
    /// The slice itself.
    pub slice: &'a Slice,
    /// Its data pixels.
    pub mask: &'a Mask,
    /// The volume, its lattice and its kernels.
    pub weaver: &'a PathReconstructor,
    /// Bricks that the slice changed.
    pub touched: &'a [BrickIndex],
    /// The changed region within them, if known: voxels by lattice index.
    pub slab: Option<Prism>,
    /// Whether the general path has taken over with this slice: any brick may have changed.
    pub upgraded: bool,
    /// Insertion time.
    pub insert: Duration,
    /// First and last voxel, by lattice index, that this and all later slices reach.
    pub reached: Option<[[i64; 3]; 2]>,
    /// Mean directions of u and v of all slices in the world, if they exist.
    pub slice_axes: Option<[DVec3; 2]>,
    /// Scalar type of its frame.
    pub pixels: PixelKind,
}

/// Called after each inserted slice, before the next one is read.
pub trait SliceObserver {
    /// Receives the inserted slice.
    ///
    /// # Errors
    /// Any; it ends the run.
    fn woven(&mut self, woven: &InsertedSlice) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}

/// Observer that does nothing.
impl SliceObserver for () {
    fn woven(&mut self, _: &InsertedSlice) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(())
    }
}

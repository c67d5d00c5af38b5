//! The observer of a session or of a reconstruction: it receives frames on arrival, sensor poses,
//! slices once their pose is known, and the volume after each slice.

use std::time::Duration;

use glam::DVec3;

use mask::Mask;
use reconstruct::PathReconstructor;
use sonoweave_core::slice::{Image, Slice};
use sync::history::PoseSample;
use volume::Prism;
use volume::brick::BrickIndex;

use super::PixelKind;

/// A frame that has just arrived.
#[derive(Debug, Clone, Copy)]
pub struct CapturedFrame<'a> {
    /// Its number.
    pub item: u64,
    /// Its capture time, host ns; in a recorded sequence its own time.
    pub captured_ns: i64,
    /// The whole image, in MF orientation.
    pub image: &'a Image,
}

/// A slice that has just been inserted.
pub struct InsertedSlice<'a> {
    /// Its frame's number in the recording.
    pub item: u64,
    /// The slice itself.
    pub slice: &'a Slice,
    /// Its data pixels.
    pub mask: &'a Mask,
    /// The volume, its lattice and its kernels.
    pub reconstructor: &'a PathReconstructor,
    /// Reason for its insertion path, as the end of a sentence.
    pub path_reason: &'a str,
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

/// An observer. The stages' own threads call it, so that it delays the following work: during a
/// live session it should only take notes.
pub trait Observer: Send + Sync {
    /// Receives a frame, before its pose is known.
    fn captured(&self, _frame: &CapturedFrame<'_>) {}

    /// Receives a sensor's pose, with the names of the frames that it maps from and to.
    fn pose(&self, _frames: [&str; 2], _sample: &PoseSample) {}

    /// Receives a posed slice, in a world of that name, before its insertion.
    fn slice(&self, _world: &str, _item: u64, _slice: &Slice) {}

    /// Receives the number of a frame that does not reach the volume, and the name of the reason.
    fn lost(&self, _item: u64, _reason: &'static str) {}

    /// Receives a slice after its insertion, with the volume; the next one is not yet inserted.
    ///
    /// # Errors
    /// Any; it ends the insertion.
    fn inserted(&self, _inserted: &InsertedSlice<'_>) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(())
    }

    /// Memory that the observer keeps for the session, bytes.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// The volume was cleared: it no longer contains earlier slices.
    fn cleared(&self) {}
}

/// Observer that does nothing.
impl Observer for () {}

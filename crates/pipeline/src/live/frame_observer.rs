//! Observers of a running session: they receive frames on arrival, slices once their pose is
//! known, and sensor poses. The stages do not wait for them.

use sonoweave_core::slice::{Image, Slice};
use sync::history::PoseSample;

/// A frame that has just arrived.
#[derive(Debug, Clone, Copy)]
pub struct CapturedFrame<'a> {
    /// Its number.
    pub item: u64,
    /// Its capture time, host ns.
    pub captured_ns: i64,
    /// The whole image, in MF orientation.
    pub image: &'a Image,
}

/// An observer. The stages' own threads call it, so that it delays the following work: it should
/// only take notes.
pub trait FrameObserver: Send + Sync {
    /// Receives a frame, before its pose is known.
    fn glimpsed(&self, _glimpsed: &CapturedFrame<'_>) {}

    /// Receives a posed slice, in a world of that name.
    fn slice(&self, _world: &str, _item: u64, _slice: &Slice) {}

    /// The volume was cleared: it no longer contains earlier slices.
    fn cleared(&self) {}

    /// Receives a sensor's pose, with the names of the frames that it maps from and to.
    fn pose(&self, _frames: [&str; 2], _sample: &PoseSample) {}
}

//! Who looks on while a session runs: at pictures as they come in, at slices once it is known where they lie, and at the sensors. Nobody is waited for.

use crate::slice::{Image, Slice};
use crate::sync::history::PoseSample;

/// A picture that has just come in.
#[derive(Debug, Clone, Copy)]
pub struct Glimpsed<'a> {
    /// Its frame's number.
    pub item: u64,
    /// When it was captured, host ns.
    pub captured_ns: i64,
    /// The picture, in MF orientation, whole.
    pub image: &'a Image,
}

/// Looks on. What it is told is told by the stages' own threads, and delays whatever comes next: it had better do no more than take note.
pub trait Witness: Send + Sync {
    /// A picture came in, before it is known where it lies.
    fn glimpsed(&self, _glimpsed: &Glimpsed<'_>) {}

    /// A frame was posed, in a world of that name.
    fn slice(&self, _world: &str, _item: u64, _slice: &Slice) {}

    /// The volume begins anew: slices until now are no longer in it.
    fn cleared(&self) {}

    /// A sensor's pose, from and to frames of these names.
    fn pose(&self, _frames: [&str; 2], _sample: &PoseSample) {}
}

//! Who sees the scanner's pictures as they come in, before it is known where they lie.

use crate::slice::Image;

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

/// Is shown each picture. What it does with one delays all others, so that it had better do no more than take note of it.
pub trait Glance: Send + Sync {
    /// A picture came in.
    fn glimpsed(&self, glimpsed: &Glimpsed<'_>);
}

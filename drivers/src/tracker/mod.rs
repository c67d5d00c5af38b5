//! Electromagnetic trackers, by maker.

pub mod polhemus;

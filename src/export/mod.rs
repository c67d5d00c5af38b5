//! Volumes and pictures to files.
//!
//! - [`volume`]: values and weights to MetaImage.
//! - [`planes`]: a volume's three middle planes side by side, for a first look.
//! - [`picture`]: pictures to PNG.
//! - [`whole`]: files that are whole or not there.
//! - `legend`: what a picture's colours and lengths mean.
//! - `lettering`: the few letters that pictures need.

mod legend;
mod lettering;
pub mod picture;
pub mod planes;
pub mod volume;
pub mod whole;

//! Volumes and pictures to files.
//!
//! - [`planes`]: a volume's three middle planes side by side, for a first look.
//! - `legend`: what a picture's colours and lengths mean.
//! - `lettering`: the few letters that pictures need.

mod legend;
mod lettering;
pub mod planes;

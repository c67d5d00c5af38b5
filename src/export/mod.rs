//! Volumes and pictures to files.
//!
//! - [`volume`]: values and weights to MetaImage.
//! - [`fill`]: holes between slices, filled and marked.
//! - [`dicom`]: volumes and sweeps to DICOM.
//! - [`planes`]: a volume's three middle planes side by side, for a first look.
//! - [`sections`]: planes of a volume or of slices, in a picture of a given size.
//! - [`picture`]: pictures to PNG.
//! - [`drawing`]: how a phantom of wires is built, at 1:1 on paper.
//! - [`page`]: text, tables and drawings in one file for a browser.
//! - [`whole`]: files that are whole or not there.
//! - `legend`: what a picture's colours and lengths mean.
//! - `shades`: which colours values have.
//! - `panel`: a plane in a picture, with its title and axes.
//! - `lettering`: the letters that pictures need.

pub mod dicom;
pub mod drawing;
pub mod fill;
pub(crate) mod legend;
pub(crate) mod lettering;
pub mod page;
pub(crate) mod panel;
pub mod picture;
pub mod planes;
pub mod sections;
mod shades;
pub mod volume;
pub mod whole;

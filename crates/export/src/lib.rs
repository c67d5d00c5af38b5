//! Export of volumes and pictures to files.
//!
//! - [`volume`]: values and weights to MetaImage.
//! - [`fill`]: holes between slices, filled and marked.
//! - [`dicom`]: volumes and sweeps to DICOM.
//! - [`planes`]: a volume's three middle planes side by side, as an overview.
//! - [`sections`]: planes of a volume or of slices, in a picture of a given size.
//! - [`picture`]: pictures to PNG. [`movie`]: many of them to animated PNG, GIF and AVI.
//! - [`drawing`]: construction drawing of a wire phantom, at 1:1 on paper.
//! - [`page`]: text, tables and drawings in one file for a browser.
//! - `legend`: legends of pictures.
//! - `shades`: colour schemes of values.
//! - `style`: colours and sizes of pictures.
//! - `panel`: a plane in a picture, with its title and axes.
//! - `lettering`: the bitmap font of pictures.

pub mod annotation;
pub mod dicom;
pub mod drawing;
mod error;
pub mod fill;
pub(crate) mod legend;
pub(crate) mod lettering;
pub mod movie;
pub mod page;
pub mod panel;
pub mod picture;
pub mod planes;
pub mod sections;
mod shades;
mod style;
pub mod volume;

pub use error::ExportError;

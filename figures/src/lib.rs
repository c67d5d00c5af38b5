//! Pictures of numbers: curves, points and bars over linear and logarithmic axes, as SVG, as PNG of the same picture, and as CSV of what was drawn.
//!
//! - [`figure`]: what a picture shows: panels, axes, series, caption.
//! - [`raster`]: pictures of pixels, which a panel shows in the place of axes.
//! - [`scale`]: from numbers to places along an axis, and where its ticks are.
//! - [`lettering`]: how wide a text is, and where it wraps.
//! - [`drawing`]: the picture as SVG.
//! - [`files`]: the three files of a figure, and the page that shows several.
//! - [`findings`]: the pictures of a run, and what it checked.
//!
//! A crate of its own, because what draws letters takes as long to build as everything else here, and nothing else needs it.
//!
//! The letters are of a font that is compiled in, so that a picture needs none of the machine's and looks the same on every one; an SVG's text
//! remains text. Colours are Okabe and Ito's, which remain distinct for every kind of colour vision; series differ in dash or shape besides.

pub mod drawing;
pub mod figure;
pub mod files;
pub mod findings;
pub mod lettering;
pub mod raster;
pub mod scale;

pub use figure::{Axis, Figure, Ink, Look, Panel, Series};
pub use findings::Findings;
pub use raster::Raster;
pub use scale::order;

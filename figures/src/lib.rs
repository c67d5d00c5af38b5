//! Plots: curves, points and bars over linear and logarithmic axes, as SVG, as PNG of the same
//! figure, and as CSV of the plotted data.
//!
//! - [`figure`]: content of a figure: panels, axes, series, caption.
//! - [`raster`]: raster images, which a panel shows in place of axes.
//! - [`scale`]: map from numbers to positions along an axis, and its ticks.
//! - [`lettering`]: text widths and wrapping.
//! - [`drawing`]: the figure as SVG.
//! - [`files`]: the three files of a figure, and the page that shows several.
//! - [`findings`]: the figures and checks of a run.
//! - [`gaps`]: gaps between the slices of a sweep.
//!
//! This is a separate crate, because the text renderer takes as long to build as everything else
//! here, and nothing else needs it.
//!
//! The font is compiled in, so that a figure is independent of the machine's fonts; an SVG's
//! text remains text. The colours, by Okabe and Ito, remain distinct for every kind of colour
//! vision; series also differ in dash or shape.

pub mod drawing;
pub mod figure;
pub mod files;
pub mod findings;
pub mod gaps;
pub mod lettering;
pub mod raster;
pub mod scale;

pub use figure::{Axis, Figure, Ink, Panel, Series, SeriesStyle};
pub use findings::Findings;
pub use raster::Raster;
pub use scale::order;

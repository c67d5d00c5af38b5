//! Description of a figure: panels, axes and series.

use crate::raster::Raster;
use crate::scale::Scale;

/// A colour of the palette of Okabe and Ito (2008), darkened if it would be faint on white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// For truths and references.
    Black,
    /// For side information.
    Grey,
    /// First choice for ours.
    Blue,
    /// First choice for theirs.
    Vermilion,
    /// Third.
    Green,
    /// Fourth.
    Purple,
    /// Fifth.
    Orange,
    /// Sixth.
    Sky,
}

impl Ink {
    /// Returns the colour in SVG notation.
    pub fn hex(self) -> &'static str {
        match self {
            Self::Black => "#1a1a1a",
            Self::Grey => "#8a8a8a",
            Self::Blue => "#0072b2",
            Self::Vermilion => "#d55e00",
            Self::Green => "#009e73",
            Self::Purple => "#b5579a",
            Self::Orange => "#d18f00",
            Self::Sky => "#3fa4dc",
        }
    }
}

/// Style of a series' points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeriesStyle {
    /// Joined; a missing number breaks the line.
    Line,
    /// Joined by dashes.
    Dashed,
    /// Joined by dots.
    Dotted,
    /// Discs.
    Discs,
    /// Squares.
    Squares,
    /// Triangles.
    Triangles,
    /// Upright crosses.
    Crosses,
    /// Bars from the axis' low end; bars of several series are side by side.
    Bars,
}

/// Named points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend; series of one name in several panels share an entry.
    pub name: String,
    /// Style.
    pub style: SeriesStyle,
    /// Colour.
    pub ink: Ink,
    /// x and y. Values that are not finite, or not positive on a logarithmic axis, are left out.
    pub points: Vec<[f64; 2]>,
    /// Whether the legend names it; the CSV always has the name.
    pub listed: bool,
}

impl Series {
    /// Returns a series of points.
    pub fn new(name: impl Into<String>, style: SeriesStyle, ink: Ink, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), style, ink, points, listed: true }
    }

    /// Removes its entry from the legend.
    pub fn unlisted(self) -> Self {
        Self { listed: false, ..self }
    }

    /// Returns one bar for each category, from the first on.
    pub fn bars(name: impl Into<String>, ink: Ink, heights: &[f64]) -> Self {
        Self::new(name, SeriesStyle::Bars, ink, heights.iter().zip(0..).map(|(y, i)| [f64::from(i), *y]).collect())
    }
}

/// An axis of a panel.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Linear or logarithmic.
    pub scale: Scale,
    /// Ends of the axis; `None` derives them from the series.
    pub range: Option<[f64; 2]>,
    /// Names of the positions 0, 1, 2 …, in place of numbers.
    pub categories: Vec<String>,
}

impl Axis {
    /// Returns a linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear, range: None, categories: Vec::new() }
    }

    /// Returns a logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label) }
    }

    /// Returns an axis of names.
    pub fn categories<S: Into<String>>(label: impl Into<String>, names: impl IntoIterator<Item = S>) -> Self {
        let categories: Vec<String> = names.into_iter().map(Into::into).collect();
        Self { range: Some([-0.5, categories.len() as f64 - 0.5]), categories, ..Self::linear(label) }
    }

    /// Sets the ends of the axis.
    pub fn from_to(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }
}

/// A coordinate system with series in it.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Text above it.
    pub title: String,
    /// Axis below it.
    pub x: Axis,
    /// Axis left of it.
    pub y: Axis,
    /// Its series, the last on top.
    pub series: Vec<Series>,
    /// Image shown in place of axes and series.
    pub raster: Option<Raster>,
}

impl Panel {
    /// Returns a panel of these parts.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self { title: title.into(), x, y, series, raster: None }
    }

    /// Returns a panel with an image, as large as fits.
    pub fn picture(title: impl Into<String>, raster: Raster) -> Self {
        Self { raster: Some(raster), ..Self::new(title, Axis::linear(""), Axis::linear(""), Vec::new()) }
    }
}

/// A figure.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Name of its files.
    pub id: &'static str,
    /// Text above it.
    pub title: String,
    /// Text below it: content and conclusion.
    pub caption: String,
    /// Panels per row.
    pub columns: usize,
    /// Height of a panel's coordinate system, pixels.
    pub height: f64,
    /// Panels, row by row.
    pub panels: Vec<Panel>,
}

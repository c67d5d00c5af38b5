//! What a picture shows.

use crate::raster::Raster;
use crate::scale::Scale;

/// A colour of the palette of Okabe and Ito (2008), darkened where it would be faint on white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ink {
    /// For truths and references.
    Black,
    /// For what is beside the point.
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
    /// As SVG names it.
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

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Joined; where a number is missing the line breaks.
    Line,
    /// Joined by dashes.
    Dashed,
    /// Joined by dots.
    Dotted,
    /// A disc each.
    Discs,
    /// A square each.
    Squares,
    /// A triangle each.
    Triangles,
    /// An upright cross each.
    Crosses,
    /// A bar each, from the axis' low end; bars of several series stand side by side.
    Bars,
}

/// Points of one name.
#[derive(Debug, Clone)]
pub struct Series {
    /// In the legend; series of one name in several panels share an entry.
    pub name: String,
    /// How.
    pub look: Look,
    /// In which colour.
    pub ink: Ink,
    /// x and y; what is not finite, or not positive on a logarithmic axis, is left out.
    pub points: Vec<[f64; 2]>,
    /// Whether the legend names it; its numbers have their name in any case.
    pub listed: bool,
}

impl Series {
    /// Of points.
    pub fn new(name: impl Into<String>, look: Look, ink: Ink, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), look, ink, points, listed: true }
    }

    /// Without an entry in the legend.
    pub fn unlisted(self) -> Self {
        Self { listed: false, ..self }
    }

    /// A bar for each category, from the first on.
    pub fn bars(name: impl Into<String>, ink: Ink, heights: &[f64]) -> Self {
        Self::new(name, Look::Bars, ink, heights.iter().zip(0..).map(|(y, i)| [f64::from(i), *y]).collect())
    }
}

/// One side of a panel.
#[derive(Debug, Clone)]
pub struct Axis {
    /// What, and in which unit.
    pub label: String,
    /// Lines or powers.
    pub scale: Scale,
    /// From where to where; `None` for what the series need.
    pub range: Option<[f64; 2]>,
    /// Names of the places 0, 1, 2 …, in the place of numbers.
    pub categories: Vec<String>,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear, range: None, categories: Vec::new() }
    }

    /// A logarithmic axis.
    pub fn log(label: impl Into<String>) -> Self {
        Self { scale: Scale::Log, ..Self::linear(label) }
    }

    /// An axis of names.
    pub fn categories<S: Into<String>>(label: impl Into<String>, names: impl IntoIterator<Item = S>) -> Self {
        let categories: Vec<String> = names.into_iter().map(Into::into).collect();
        Self { range: Some([-0.5, categories.len() as f64 - 0.5]), categories, ..Self::linear(label) }
    }

    /// From where to where.
    pub fn from_to(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }
}

/// A coordinate system with series in it.
#[derive(Debug, Clone)]
pub struct Panel {
    /// Above it.
    pub title: String,
    /// Below it.
    pub x: Axis,
    /// Left of it.
    pub y: Axis,
    /// In it, the last on top.
    pub series: Vec<Series>,
    /// What it shows in the place of axes and series.
    pub raster: Option<Raster>,
}

impl Panel {
    /// Of its parts.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Self { title: title.into(), x, y, series, raster: None }
    }

    /// A picture of pixels, as large as fits.
    pub fn picture(title: impl Into<String>, raster: Raster) -> Self {
        Self { raster: Some(raster), ..Self::new(title, Axis::linear(""), Axis::linear(""), Vec::new()) }
    }
}

/// A picture.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Name of its files.
    pub id: &'static str,
    /// Above it.
    pub title: String,
    /// Below it: what is seen, and what follows.
    pub caption: String,
    /// Panels of a row.
    pub columns: usize,
    /// Height of a panel's coordinate system, pixels.
    pub height: f64,
    /// Row by row.
    pub panels: Vec<Panel>,
}

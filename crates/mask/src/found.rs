//! The outcome of a mask: the shape, how certain it is, and the reasons for doubt.

use std::fmt;
use std::sync::Arc;

use serde::{Serialize, Serializer};

use sonoweave_core::region::{ClipRect, Fan};

use super::Mask;

/// Shape of a mask.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskShape {
    /// The whole frame.
    Whole,
    /// A rectangle of whole pixels.
    Rectangle(ClipRect),
    /// A fan.
    Fan(Fan),
    /// Neither: the convex outline of the pixels that were not zero, or a fan and a rectangle.
    Outline,
}

/// Level and noise of the border around the picture, in levels of 8-bit frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Border {
    /// The level.
    pub level: f32,
    /// Standard deviation of a pixel.
    pub noise: f32,
}

/// The automatic mask: what was found and how certain it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaskFound {
    /// The pixels that are data.
    #[serde(skip)]
    pub mask: Arc<Mask>,
    /// Shape of the picture. Where the border is exactly zero, the mask is the outline of the
    /// pixels, and the shape describes it.
    pub shape: MaskShape,
    /// Whether a whole picture was recognised; otherwise the whole frame counts, less sides of
    /// exact zeros that end in a plain edge.
    #[serde(rename = "sure")]
    pub recognised: bool,
    /// Share of the outline with a plain edge, times the share of everything visible that lies
    /// inside, 0 to 1. Where the border is exactly zero, the share alone.
    pub confidence: f64,
    /// The border; `None` without an even one.
    pub border: Option<Border>,
    /// Reasons why nothing, or not everything, was recognised.
    pub reasons: Vec<UnsureReason>,
}

impl MaskFound {
    /// Returns a mask that was not found but given, with its shape.
    pub fn certain(mask: Mask, shape: MaskShape) -> Self {
        Self { mask: Arc::new(mask), shape, recognised: true, confidence: 1.0, border: None, reasons: Vec::new() }
    }

    /// Returns the reasons as sentences that say what follows.
    pub fn notes(&self) -> Vec<String> {
        self.reasons.iter().map(UnsureReason::to_string).collect()
    }
}

impl fmt::Display for MaskFound {
    /// Writes a sentence: the shape, how certain it is, and the border.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.shape)?;
        if self.recognised {
            write!(f, ", {:.0} % sure", 100.0 * self.confidence)?;
        } else {
            write!(f, ", not sure")?;
        }
        if let Some(Border { level, noise }) = self.border {
            write!(f, "; border level {level:.1}, noise {noise:.1}")?;
        }
        self.reasons.iter().try_for_each(|reason| write!(f, "; {reason}"))
    }
}

impl fmt::Display for MaskShape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => write!(f, "the whole frame"),
            Self::Rectangle(ClipRect { x, y, width, height }) => {
                write!(f, "a rectangle of {width}×{height} pixels at {x},{y}")
            }
            Self::Fan(fan) => {
                let ([u, v], [r0, r1], [a0, a1]) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
                write!(f, "a fan about {u:.1},{v:.1}, radii {r0:.1} to {r1:.1} pixels, angles {a0:.1}° to {a1:.1}°")
            }
            Self::Outline => write!(f, "the outline of the picture"),
        }
    }
}

/// Reason why a picture was not recognised, or only in part.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum UnsureReason {
    /// No pixel was ever different from zero.
    #[error("the first frames are all black: the whole frame counts as data; set a clip otherwise")]
    Black,
    /// Some sides of the pixels that differ from zero are not plain.
    #[error("no picture edge found on the {}: the frame's edge counts; set a clip, or none, otherwise", .0.join(", "))]
    OpenSides(Vec<&'static str>),
    /// The rim of the frame has no even level.
    #[error("the frame has no even border: the most frequent level holds {:.0} % of its rim; set a clip", 100.0 * .share)]
    NoBorder {
        /// Share of the rim with the most frequent level, 0 to 1.
        share: f64,
    },
    /// Nothing differs from the border.
    #[error("nothing stands out from the border: the whole frame counts as data; set a clip otherwise")]
    Nothing,
    /// The picture is small.
    #[error(
        "the largest thing in the frame covers {:.0} % of it, too little for a picture: the whole frame counts as data; set a clip otherwise",
        100.0 * .share
    )]
    Small {
        /// Its share of the frame, 0 to 1.
        share: f64,
    },
    /// The outline is that of no known shape.
    #[error(
        "the picture is neither a rectangle nor a fan with its apex on top: the whole frame counts as data; set a clip otherwise"
    )]
    NoShape,
    /// Much of the activity lies outside of the shape.
    #[error(
        "{:.0} % of what stands out lies outside {shape}: the whole frame counts as data; set a clip otherwise",
        100.0 * .share
    )]
    Outside {
        /// The shape.
        shape: MaskShape,
        /// The share, 0 to 1.
        share: f64,
    },
    /// An edge is not seen.
    #[error("the {edge} edge of {shape} is not plain: the whole frame counts as data; set a clip otherwise")]
    Edge {
        /// The shape.
        shape: MaskShape,
        /// The edge's name.
        edge: &'static str,
    },
    /// Little of the outline is seen.
    #[error(
        "only {:.0} % of the outline of {shape} is plain: the whole frame counts as data; set a clip otherwise",
        100.0 * .seen
    )]
    Edges {
        /// The shape.
        shape: MaskShape,
        /// The share of the outline that is seen, 0 to 1.
        seen: f64,
    },
    /// Most of the inside looks like the border.
    #[error(
        "only {:.0} % of {shape} stands out from the border: the whole frame counts as data; set a clip otherwise",
        100.0 * .share
    )]
    Dark {
        /// The shape.
        shape: MaskShape,
        /// The share, 0 to 1.
        share: f64,
    },
}

/// As a sentence.
impl Serialize for UnsureReason {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

//! The certainty mask: the pixels of a frame that are data.
//!
//! Pixels outside the scanner's image (beyond the clip rectangle or the fan, in the dead border
//! of the frame) are not data. They must not reach the volume as black. Inside, black is a
//! value.
//!
//! - [`Mask`]: the pixels, as spans of each row.
//! - [`MaskSettings`]: the user's or the configuration's settings, and the mask that follows
//!   from them, at once or after some frames.
//! - [`MaskChange`]: a mask that an operator orders while a session runs.
//! - [`auto`]: detection of the picture in the frames themselves; [`found`]: its outcome.

pub mod auto;
mod border;
mod change;
mod exact;
pub mod found;
mod shape;
mod spans;

use std::str::FromStr;

use serde::Serialize;

use sonoweave_core::keys::{BadNumbers, numbers};
use sonoweave_core::region::{BadRegion, ClipRect, Fan};

pub use auto::AutoMask;
pub use change::MaskChange;
pub use found::{Border, MaskFound, MaskShape, UnsureReason};
pub use spans::{Mask, Span};

/// Region that clips the frame, besides a fan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clip {
    /// The image is detected in the first frames; if a fan is given, the fan alone applies.
    #[default]
    Auto,
    /// Nothing; a fan, where given, still applies.
    None,
    /// A rectangle.
    Rect(ClipRect),
    /// A rectangle of a PLUS configuration. PLUS requires a clip rectangle, so one that covers
    /// the whole frame means that none was chosen: it counts as [`Clip::Auto`].
    RectOrAuto(ClipRect),
}

/// Borders of the image, as far as they are known before the first frame.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MaskSettings {
    /// Rectangle, none, or automatic.
    pub clip: Clip,
    /// The sector that is data; it applies in addition to a rectangle.
    pub fan: Option<Fan>,
    /// Width and height of the frames to which these settings apply; `None` if not known. Other
    /// sizes are refused.
    pub picture_px: Option<[u32; 2]>,
}

/// Source of the mask.
#[derive(Debug)]
pub enum MaskPlan {
    /// It is known.
    Fixed(Mask),
    /// It is detected in the first frames.
    Auto(AutoMask),
}

impl MaskSettings {
    /// Returns the smallest rectangle that holds all data of `width`×`height` frames, as far as
    /// known before the first frame; else the whole frame.
    pub fn bounds(&self, [width, height]: [u32; 2]) -> ClipRect {
        let whole = ClipRect { x: 0, y: 0, width, height };
        match self.plan(width, height) {
            Ok(MaskPlan::Fixed(mask)) => mask.bounds().unwrap_or(whole),
            _ => whole,
        }
    }

    /// Returns a mask that follows from these settings, with its shape.
    pub fn known(&self, mask: Mask) -> MaskFound {
        let shape = match (self.clip, self.fan) {
            (Clip::Auto | Clip::None, Some(fan)) => MaskShape::Fan(fan),
            (_, Some(_)) => MaskShape::Outline,
            (_, None) => match mask.bounds() {
                Some(rect) if !mask.is_full() => MaskShape::Rectangle(rect),
                _ => MaskShape::Whole,
            },
        };
        MaskFound::certain(mask, shape)
    }

    /// Whether the mask is known before the first frame.
    pub fn is_known(&self) -> bool {
        self.fan.is_some() || !matches!(self.clip, Clip::Auto | Clip::RectOrAuto(_))
    }

    /// Returns the mask of `width`×`height` frames, or the detector for it.
    ///
    /// # Errors
    /// [`MaskError::OtherSize`] and [`MaskError::Empty`].
    pub fn plan(&self, width: u32, height: u32) -> Result<MaskPlan, MaskError> {
        if let Some([w, h]) = self.picture_px.filter(|size| *size != [width, height]) {
            return Err(MaskError::OtherSize { calibrated: [w, h], found: [width, height] });
        }
        let rect = match self.clip {
            Clip::Auto => None,
            Clip::RectOrAuto(rect) if rect.covers(width, height) => None,
            Clip::None => Some(Mask::full(width, height)),
            Clip::Rect(rect) | Clip::RectOrAuto(rect) => Some(Mask::rect(width, height, rect)),
        };
        let mask = match (rect, self.fan) {
            (None, None) => return Ok(MaskPlan::Auto(AutoMask::new(width, height))),
            (Some(rect), None) => rect,
            (None, Some(fan)) => Mask::fan(width, height, &fan),
            (Some(rect), Some(fan)) => rect.intersect(&Mask::fan(width, height, &fan)),
        };
        if mask.area() == 0 {
            let rectangle = match self.clip {
                Clip::Rect(r) | Clip::RectOrAuto(r) => {
                    format!("rectangle {},{} of {}×{} pixels", r.x, r.y, r.width, r.height)
                }
                Clip::Auto | Clip::None => "no rectangle".into(),
            };
            let fan = self.fan.map_or(String::new(), |fan| {
                let (origin, radii, angles) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
                format!(", fan about {origin:?}, radii {radii:?} px, angles {angles:?}°")
            });
            return Err(MaskError::Empty { size: [width, height], region: rectangle + &fan });
        }
        Ok(MaskPlan::Fixed(mask))
    }
}

/// `auto`, `none`, or `X,Y,W,H` in pixels.
impl FromStr for Clip {
    type Err = MaskError;

    fn from_str(text: &str) -> Result<Self, MaskError> {
        match text.trim() {
            "auto" => return Ok(Self::Auto),
            "none" => return Ok(Self::None),
            _ => {}
        }
        let parts: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        let parts = parts.map_err(|_| MaskError::NotClip(text.to_owned()))?;
        let [x, y, width, height] = parts[..] else { return Err(MaskError::Count(parts.len())) };
        Ok(Self::Rect(ClipRect::new(x, y, width, height)?))
    }
}

/// Parses a fan from `X,Y,R0,R1,A0,A1`: apex (px), radii (px), angles (degrees from down,
/// positive to the right).
///
/// # Errors
/// [`MaskError::Numbers`] and [`MaskError::Region`].
pub fn parse_fan(text: &str) -> Result<Fan, MaskError> {
    let [x, y, r0, r1, a0, a1] = numbers::<6>(text)?;
    Ok(Fan::new([x, y], [r0, r1], [a0, a1])?)
}

/// Reason why settings give no mask.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MaskError {
    /// The rectangle or the fan is invalid.
    #[error(transparent)]
    Region(#[from] BadRegion),
    /// The text of a fan does not hold six numbers.
    #[error("X,Y,R0,R1,A0,A1: {0}")]
    Numbers(#[from] BadNumbers),
    /// The text is not a clip region.
    #[error("\"{0}\" must be auto, none, or four whole numbers of pixels X,Y,W,H")]
    NotClip(String),
    /// The text of a rectangle does not hold four numbers.
    #[error("X,Y,W,H must be 4 numbers, not {0}")]
    Count(usize),
    /// The calibration is for frames of another size.
    #[error(
        "the calibration is of pictures of {}×{} pixels, and these have {}×{}: set scanner and grabber as they were when it was made, or choose another preset",
        .calibrated[0], .calibrated[1], .found[0], .found[1]
    )]
    OtherSize {
        /// Width and height that the calibration is for.
        calibrated: [u32; 2],
        /// Width and height of the frames.
        found: [u32; 2],
    },
    /// A rectangle leaves the frame.
    #[error(
        "the rectangle {},{} of {}×{} pixels leaves the {}×{} picture; choose one inside of it",
        .rect.x, .rect.y, .rect.width, .rect.height, .size[0], .size[1]
    )]
    Leaves {
        /// The rectangle.
        rect: ClipRect,
        /// Width and height of the frames.
        size: [u32; 2],
    },
    /// Rectangle and fan leave no pixel.
    #[error("the clip region leaves nothing of the {}×{} picture: {region}", .size[0], .size[1])]
    Empty {
        /// Width and height of the frames.
        size: [u32; 2],
        /// Rectangle and fan.
        region: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fixed(settings: MaskSettings) -> Mask {
        match settings.plan(820, 616).unwrap() {
            MaskPlan::Fixed(mask) => mask,
            MaskPlan::Auto(_) => panic!("no search was due"),
        }
    }

    #[test]
    fn plus_whole_frame_rect_keeps_auto_mask() {
        let whole = ClipRect::new(0, 0, 820, 616).unwrap();
        let part = ClipRect::new(192, 16, 420, 580).unwrap();
        let plan = |clip| MaskSettings { clip, ..MaskSettings::default() }.plan(820, 616).unwrap();
        assert!(matches!(plan(Clip::RectOrAuto(whole)), MaskPlan::Auto(_)));
        assert!(matches!(plan(Clip::Auto), MaskPlan::Auto(_)));
        assert!(matches!(plan(Clip::Rect(whole)), MaskPlan::Fixed(m) if m.is_full()));
        assert!(matches!(plan(Clip::None), MaskPlan::Fixed(m) if m.is_full()));
        assert!(matches!(plan(Clip::RectOrAuto(part)), MaskPlan::Fixed(m) if m.area() == 420 * 580));
    }

    #[test]
    fn rectangle_and_fan_apply_both() {
        let fan = Fan::new([380.0, 20.0], [120.0, 360.0], [-45.0, 45.0]).unwrap();
        let clip = Clip::Rect(ClipRect::new(192, 16, 420, 580).unwrap());
        let both = fixed(MaskSettings { clip, fan: Some(fan), ..MaskSettings::default() });
        let alone = fixed(MaskSettings { fan: Some(fan), ..MaskSettings::default() });
        assert!(both.area() < alone.area());
        assert!(!both.contains(191, 240) && alone.contains(191, 240), "left of the rectangle, inside the fan");
        assert!(both.contains(380, 380) && !both.contains(380, 381), "the far radius");
        // A quarter of a ring, within the error made at its border pixels.
        let ring = std::f64::consts::PI / 4.0 * (360.0_f64.powi(2) - 120.0_f64.powi(2));
        let area = alone.area() as f64;
        assert!((area - ring).abs() < 0.005 * ring, "{area} {ring}");
    }

    #[test]
    fn empty_region_refused_with_numbers() {
        let clip = Clip::Rect(ClipRect::new(900, 0, 10, 10).unwrap());
        let error = MaskSettings { clip, ..MaskSettings::default() }.plan(820, 616).unwrap_err().to_string();
        assert!(error.contains("nothing of the 820×616 picture") && error.contains("900,0 of 10×10"), "{error}");
    }

    #[test]
    fn options_parsed_and_mistakes_named() {
        assert_eq!("auto".parse::<Clip>().unwrap(), Clip::Auto);
        assert_eq!("none".parse::<Clip>().unwrap(), Clip::None);
        assert_eq!("1, 2,3,4".parse::<Clip>().unwrap(), Clip::Rect(ClipRect::new(1, 2, 3, 4).unwrap()));
        assert_eq!("1,2,3".parse::<Clip>(), Err(MaskError::Count(3)));
        assert_eq!("some".parse::<Clip>(), Err(MaskError::NotClip("some".into())));
        assert!(matches!("1,2,0,4".parse::<Clip>(), Err(MaskError::Region(_))));
        assert_eq!(parse_fan("380,20,120,360,-45,45").unwrap().radii_px(), [120.0, 360.0]);
        let five = parse_fan("380,20,120,360,-45");
        assert_eq!(five, Err(MaskError::Numbers(BadNumbers::Count { expected: 6, found: 5 })));
    }
}

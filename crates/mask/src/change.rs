//! Changes of the mask by an operator.

use std::fmt;

use serde::{Deserialize, Serialize};

use sonoweave_core::region::{ClipRect, Fan};

use super::found::MaskShape;
use super::{Mask, MaskError};

/// A mask as an operator orders it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskChange {
    /// The present mask is right.
    Keep,
    /// The whole frame is data.
    Whole,
    /// A rectangle is.
    Rectangle(ClipRect),
    /// A fan is, as far as it lies in the frame.
    Fan(Fan),
}

impl MaskChange {
    /// Returns the shape; `None` for the present one.
    pub fn shape(&self) -> Option<MaskShape> {
        match *self {
            Self::Keep => None,
            Self::Whole => Some(MaskShape::Whole),
            Self::Rectangle(rect) => Some(MaskShape::Rectangle(rect)),
            Self::Fan(fan) => Some(MaskShape::Fan(fan)),
        }
    }

    /// Returns the mask of frames of `size` pixels; `None` for the present one.
    ///
    /// # Errors
    /// [`MaskError::Region`] for numbers that describe no region, [`MaskError::Leaves`] for a
    /// rectangle that leaves the frame, and [`MaskError::Empty`] for a fan outside of it.
    pub fn mask(&self, size: [u32; 2]) -> Result<Option<Mask>, MaskError> {
        let [width, height] = size;
        match *self {
            Self::Keep => Ok(None),
            Self::Whole => Ok(Some(Mask::full(width, height))),
            Self::Rectangle(ClipRect { x, y, width: columns, height: rows }) => {
                let rect = ClipRect::new(x, y, columns, rows)?;
                let end = [x.saturating_add(columns), y.saturating_add(rows)];
                if end[0] > width || end[1] > height {
                    return Err(MaskError::Leaves { rect, size });
                }
                Ok(Some(Mask::rect(width, height, rect)))
            }
            Self::Fan(fan) => {
                let fan = Fan::new(fan.origin_px(), fan.radii_px(), fan.angles_deg())?;
                let mask = Mask::fan(width, height, &fan);
                if mask.area() == 0 {
                    return Err(MaskError::Empty { size, region: MaskShape::Fan(fan).to_string() });
                }
                Ok(Some(mask))
            }
        }
    }
}

impl MaskShape {
    /// Returns the configuration keys of the section `[calibration]` that give this mask, as
    /// TOML; `None` for an outline, which has no key.
    pub fn config(&self) -> Option<String> {
        match self {
            Self::Whole => Some("clip_px = \"none\"".into()),
            Self::Rectangle(ClipRect { x, y, width, height }) => {
                Some(format!("clip_px = [{x}, {y}, {width}, {height}]"))
            }
            Self::Fan(fan) => {
                let (origin, radii, angles) = (fan.origin_px(), fan.radii_px(), fan.angles_deg());
                let keys = format!("origin_px = {origin:?}, radii_px = {radii:?}, angles_deg = {angles:?}");
                Some(format!("clip_px = \"none\"\nfan = {{ {keys} }}"))
            }
            Self::Outline => None,
        }
    }
}

impl fmt::Display for MaskChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.shape() {
            Some(shape) => shape.fmt(f),
            None => write!(f, "the present mask"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::region::BadRegion;

    const SIZE: [u32; 2] = [640, 480];

    fn rectangle(x: u32, y: u32, width: u32, height: u32) -> Result<Option<Mask>, MaskError> {
        MaskChange::Rectangle(ClipRect { x, y, width, height }).mask(SIZE)
    }

    #[test]
    fn rectangle_must_lie_in_frame_and_hold_pixels() {
        assert_eq!(rectangle(600, 400, 40, 80).unwrap().unwrap().area(), 3200);
        for (x, y, width, height) in [(600, 400, 41, 80), (0, 0, 640, 481), (u32::MAX, 0, 2, 2), (0, 700, 1, 1)] {
            assert!(matches!(rectangle(x, y, width, height), Err(MaskError::Leaves { size: SIZE, .. })));
        }
        assert!(matches!(rectangle(0, 0, 0, 9), Err(MaskError::Region(BadRegion::Empty { width: 0, height: 9 }))));
    }

    #[test]
    fn fan_is_checked_and_may_leave_frame() {
        let fan = Fan::new([320.0, -40.0], [60.0, 900.0], [-40.0, 40.0]).unwrap();
        assert!(MaskChange::Fan(fan).mask(SIZE).unwrap().unwrap().area() > 0);
        let beyond = Fan::new([320.0, 4000.0], [60.0, 900.0], [-40.0, 40.0]).unwrap();
        assert!(matches!(MaskChange::Fan(beyond).mask(SIZE), Err(MaskError::Empty { size: SIZE, .. })));
        // JSON does not pass through the checks of `Fan::new`.
        let text = r#"{"fan":{"origin_px":[320,0],"radii_px":[90,10],"angles_deg":[-30,30]}}"#;
        let change: MaskChange = serde_json::from_str(text).unwrap();
        assert!(matches!(change.mask(SIZE), Err(MaskError::Region(BadRegion::Radii(_)))));
        assert!(serde_json::from_str::<MaskChange>(&text.replace("90", "1e999")).is_err());
    }

    #[test]
    fn present_mask_and_whole_frame() {
        assert_eq!(MaskChange::Keep.mask(SIZE), Ok(None));
        assert!(MaskChange::Whole.mask(SIZE).unwrap().unwrap().is_full());
        assert_eq!(serde_json::from_str::<MaskChange>("\"keep\"").unwrap(), MaskChange::Keep);
        assert_eq!((MaskShape::Outline.config(), MaskChange::Keep.shape()), (None, None));
    }
}

//! Planes through a volume in a picture, and annotations over pictures.

use glam::DVec3;
use serde::Serialize;

use config::view_settings::Draw;
use export::sections::{Sheet, Wash};
use render::section::{Box3, Plane, Sampled};

use crate::failure::Failure;

/// Planes through a volume, and annotations over pictures.
#[derive(Debug, Clone)]
pub(crate) struct Planes {
    /// Intersection of the three planes, world mm; `None` for the centre of the seen voxels.
    pub(crate) at: Option<DVec3>,
    /// One free plane instead of three.
    pub(crate) plane: Option<Plane>,
    /// Colour over the planes.
    pub(crate) wash: Wash,
    /// Annotations over the picture; `None` for the usual ones.
    pub(crate) draw: Option<Vec<Draw>>,
}

/// Numbers of drawn planes, for statistics.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct SheetNumbers {
    /// Pixels to the right and down.
    image_size: [u32; 2],
    /// Edge of a plane's pixel, mm.
    mm_per_px: f64,
    overlay: Option<&'static str>,
    /// The annotations around the planes.
    drawn: &'static [&'static str],
    planes: Vec<PlaneNumbers>,
}

#[derive(Debug, Clone, Serialize)]
struct PlaneNumbers {
    title: String,
    /// The plane's first pixel in the picture, and its pixels.
    corner_px: [u32; 2],
    size_px: [u32; 2],
    /// Centre of its first pixel, and from one pixel to the next to the right and down; world
    /// mm.
    first_mm: [f64; 3],
    right_mm: [f64; 3],
    down_mm: [f64; 3],
    /// Pixels that show a grey value.
    pixels_seen: u64,
}

impl std::fmt::Display for SheetNumbers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.image_size;
        let titles: Vec<&str> = self.planes.iter().map(|plane| plane.title.as_str()).collect();
        write!(f, "{width}×{height} pixels, {}, {:.3} mm a pixel", titles.join("; "), self.mm_per_px)
    }
}

impl Planes {
    /// Returns the annotations to draw, `usual` by default; sorted, each once.
    pub(crate) fn drawn(&self, usual: &[Draw]) -> Vec<Draw> {
        drawn(self.draw.as_deref(), usual)
    }

    /// Returns the layout of the planes of a volume's box in a picture.
    ///
    /// # Errors
    /// [`Failure`] when they miss it, or the picture is too small.
    pub(crate) fn sheet(&self, place: &Box3, size: [u32; 2]) -> Result<Sheet, Failure> {
        let lettered = self.drawn(&[Draw::Scale]).contains(&Draw::Scale);
        match &self.plane {
            Some(plane) => Sheet::free(place, plane, size, lettered).map_err(|e| Failure::new(format!("--plane: {e}"))),
            None => Sheet::three(place, self.at, size, lettered).map_err(|e| match self.at {
                Some(_) => Failure::new(format!("--at: {e}")),
                None => e.into(),
            }),
        }
    }

    /// Returns the numbers of a picture of planes.
    pub(crate) fn numbers(&self, sheet: &Sheet, sampled: &[Vec<Sampled>]) -> SheetNumbers {
        let planes = sheet.panels.iter().zip(sampled).map(|(panel, sampled)| PlaneNumbers {
            title: panel.title.clone(),
            corner_px: panel.corner,
            size_px: panel.section.size,
            first_mm: panel.section.first.to_array(),
            right_mm: panel.section.right.to_array(),
            down_mm: panel.section.down.to_array(),
            pixels_seen: sampled.iter().filter(|s| s.is_seen()).count() as u64,
        });
        SheetNumbers {
            image_size: sheet.size,
            mm_per_px: sheet.mm_per_px(),
            overlay: match self.wash {
                Wash::Clear => None,
                Wash::Weight => Some("weight"),
                Wash::Coverage => Some("coverage"),
            },
            drawn: if sheet.lettered { &["scale"] } else { &[] },
            planes: planes.collect(),
        }
    }
}

/// Returns the annotations to draw, `usual` by default; sorted, each once.
pub(crate) fn drawn(draw: Option<&[Draw]>, usual: &[Draw]) -> Vec<Draw> {
    let mut draw = draw.unwrap_or(usual).to_vec();
    draw.retain(|what| *what != Draw::None);
    draw.sort_unstable();
    draw.dedup();
    draw
}

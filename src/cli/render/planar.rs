//! The flags of planes, and of annotations over pictures.

mod check;

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde::Serialize;

use crate::cli::{Failure, values};
pub(in crate::cli) use config::view_settings::Draw;
use export::sections::{Sheet, Wash};
use render::section::{Box3, Plane, Sampled};
use sonoweave_core::keys::numbers;

/// Planes through a volume.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Planes (--mode slice) and what is drawn over pictures")]
pub(in crate::cli) struct PlanarFlags {
    /// Intersection of the three planes, world mm [default: the centre of the seen voxels]
    #[arg(long, value_name = "X,Y,Z", value_parser = values::point, allow_hyphen_values = true)]
    at: Option<DVec3>,
    /// Draw one free plane instead of three: a point of it and its normal, world mm; upwards in
    /// the picture [default: the world's +z, or +y if the normal lies along z]
    #[arg(long, value_name = "PX,PY,PZ,NX,NY,NZ[,UX,UY,UZ]", value_parser = free_plane, allow_hyphen_values = true)]
    plane: Option<FreePlane>,
    /// Overlay planes with colour: the voxels' weight, or the unseen voxels
    #[arg(long, value_enum, value_name = "WASH")]
    overlay: Option<Overlay>,
    /// Annotations over the picture, separated by commas; slice and probe are the last ones of a
    /// replay [default: nothing; in intermediate pictures slice,probe; around planes titles,
    /// axes and a legend, which are `scale`]
    #[arg(long, value_enum, value_name = "WHAT", value_delimiter = ',')]
    draw: Option<Vec<Draw>>,
}

/// A point, a normal, and the upward direction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FreePlane {
    point: DVec3,
    normal: DVec3,
    up: Option<DVec3>,
}

fn free_plane(text: &str) -> Result<FreePlane, String> {
    let three = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
    match text.split(',').count() {
        9 => {
            let n = numbers::<9>(text)?;
            Ok(FreePlane { point: three(&n), normal: three(&n[3..]), up: Some(three(&n[6..])) })
        }
        _ => numbers::<6>(text)
            .map(|n| FreePlane { point: three(&n), normal: three(&n[3..]), up: None })
            .map_err(|e| format!("{e}; give a point, a normal and, if needed, an upward direction")),
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Overlay {
    /// The voxels' weight
    Weight,
    /// The unseen voxels
    Coverage,
}

/// Numbers of drawn planes, for statistics.
#[derive(Debug, Clone, Serialize)]
pub(in crate::cli) struct SheetNumbers {
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

impl PlanarFlags {
    /// Whether an overlay needs the volume's weights.
    pub(in crate::cli) fn wants_weights(&self) -> bool {
        self.overlay == Some(Overlay::Weight)
    }

    /// Returns the annotations to draw, `usual` by default; sorted, each once.
    pub(in crate::cli) fn drawn(&self, usual: &[Draw]) -> Vec<Draw> {
        let mut draw = self.draw.clone().unwrap_or_else(|| usual.to_vec());
        draw.retain(|what| *what != Draw::None);
        draw.sort_unstable();
        draw.dedup();
        draw
    }

    fn free(&self) -> Result<Option<Plane>, Failure> {
        let plane = self.plane.map(|p| Plane::new(p.point, p.normal, p.up));
        plane.transpose().map_err(|e| Failure(format!("--plane: {e}")))
    }

    /// Returns the layout of the planes of a volume's box in a picture.
    ///
    /// # Errors
    /// [`Failure`] when they miss it, or the picture is too small.
    pub(in crate::cli) fn sheet(&self, place: &Box3, size: [u32; 2]) -> Result<Sheet, Failure> {
        let lettered = self.drawn(&[Draw::Scale]).contains(&Draw::Scale);
        match self.free()? {
            Some(plane) => Sheet::free(place, &plane, size, lettered).map_err(|e| Failure(format!("--plane: {e}"))),
            None => Sheet::three(place, self.at, size, lettered).map_err(|e| match self.at {
                Some(_) => Failure(format!("--at: {e}")),
                None => e.into(),
            }),
        }
    }

    pub(in crate::cli) fn wash(&self) -> Wash {
        match self.overlay {
            None => Wash::Clear,
            Some(Overlay::Weight) => Wash::Weight,
            Some(Overlay::Coverage) => Wash::Coverage,
        }
    }

    /// Returns the numbers of a picture of planes.
    pub(in crate::cli) fn numbers(&self, sheet: &Sheet, sampled: &[Vec<Sampled>]) -> SheetNumbers {
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
            overlay: self.overlay.map(|overlay| match overlay {
                Overlay::Weight => "weight",
                Overlay::Coverage => "coverage",
            }),
            drawn: if sheet.lettered { &["scale"] } else { &[] },
            planes: planes.collect(),
        }
    }
}

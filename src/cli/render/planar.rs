//! The flags of planes, and of annotations over pictures.

mod check;

use clap::{Args, ValueEnum};
use glam::DVec3;

use config::view_settings::Draw;
use export::sections::Wash;
use render::section::Plane;
use sonoweave_core::keys::numbers;

use crate::app::render::planar::{Planes, drawn};
use crate::cli::{Failure, values};

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

impl PlanarFlags {
    /// Whether an overlay needs the volume's weights.
    pub(in crate::cli) fn wants_weights(&self) -> bool {
        self.overlay == Some(Overlay::Weight)
    }

    /// Returns the annotations that were requested; sorted, each once.
    pub(super) fn drawn(&self) -> Vec<Draw> {
        drawn(self.draw.as_deref(), &[])
    }

    fn free(&self) -> Result<Option<Plane>, Failure> {
        let plane = self.plane.map(|p| Plane::new(p.point, p.normal, p.up));
        plane.transpose().map_err(|e| Failure::usage(format!("--plane: {e}")))
    }

    /// Returns the planes and annotations.
    ///
    /// # Errors
    /// [`Failure`] for a plane without a direction.
    pub(super) fn planes(&self) -> Result<Planes, Failure> {
        let wash = match self.overlay {
            None => Wash::Clear,
            Some(Overlay::Weight) => Wash::Weight,
            Some(Overlay::Coverage) => Wash::Coverage,
        };
        Ok(Planes { at: self.at, plane: self.free()?, wash, draw: self.draw.clone() })
    }
}

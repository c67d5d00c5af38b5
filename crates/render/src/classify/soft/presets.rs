//! Soft lights by name, with the opacities that go with them.

use glam::DVec3;

use crate::camera::Axes;
use crate::classify::transfer::{Colour, Curve, Opacity, Transfer, TransferError};
use crate::error::RenderError;

use super::names::PRESETS;

/// Soft light, and how tissue returns it. Colours are red, green and blue from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct SoftLight {
    /// Light from all sides, less in hollows.
    pub ambient: f64,
    /// Light scattered by surfaces.
    pub diffuse: f64,
    /// Highlight.
    pub specular: f64,
    /// The highlight's exponent.
    pub shininess: u32,
    /// Light that reaches beyond the edge of shade, as a share of the diffuse light.
    pub wrap: f64,
    /// Extinction of each colour, as a share of what opacity says: less goes deeper.
    pub extinction: [f64; 3],
    /// Darkness of hollows, 0 for none.
    pub occlusion: f64,
    /// Colours from dark to fully lit, in equal steps; `None` for those of the transfer function.
    pub ramp: Option<[[f64; 3]; 4]>,
    /// Standard deviation of the smoothing, voxels.
    pub smoothing: f64,
    /// Direction towards the light: to the right, up, and towards the viewer.
    pub towards: [f64; 3],
}

/// Direction towards the light by default: from the upper left.
const UPPER_LEFT: [f64; 3] = [-0.45, 0.6, 0.66];

/// Ramp of skin.
const SKIN: [[u8; 3]; 4] = [[45, 18, 10], [130, 70, 48], [214, 150, 116], [255, 232, 208]];
/// Ramp of bone.
const BONE: [[u8; 3]; 4] = [[28, 22, 18], [120, 104, 84], [214, 200, 172], [255, 252, 240]];
/// Ramp of blood.
const BLOOD: [[u8; 3]; 4] = [[30, 4, 8], [120, 20, 24], [206, 62, 54], [255, 206, 190]];
/// Ramp of glass.
const GLASS: [[u8; 3]; 4] = [[10, 22, 34], [62, 104, 132], [150, 196, 216], [244, 252, 255]];

impl SoftLight {
    /// Name and purpose of every preset; the first is the default.
    pub const PRESETS: [(&'static str, &'static str); 4] = PRESETS;

    /// Returns a preset's light, and its transfer function for intensities from `range[0]` (black)
    /// to `range[1]` (white).
    ///
    /// # Errors
    /// [`RenderError::SoftName`] for a name that is not in [`Self::PRESETS`],
    /// [`RenderError::SoftRange`] for a range that is empty or not finite.
    pub fn preset(name: &str, range: [f64; 2]) -> Result<(Self, Transfer), RenderError> {
        let skin = Self {
            ambient: 0.38,
            diffuse: 0.72,
            specular: 0.12,
            shininess: 12,
            wrap: 0.4,
            extinction: [0.35, 0.65, 1.0],
            occlusion: 0.9,
            ramp: Some(colours(SKIN)),
            smoothing: 1.0,
            towards: UPPER_LEFT,
        };
        let light = match name {
            "portrait" => skin,
            "bone" => Self { specular: 0.25, shininess: 24, ramp: Some(colours(BONE)), ..skin },
            "vessel" => Self { specular: 0.35, shininess: 32, ramp: Some(colours(BLOOD)), ..skin },
            "glass" => Self { occlusion: 0.0, specular: 0.5, shininess: 24, ramp: Some(colours(GLASS)), ..skin },
            _ => return Err(RenderError::SoftName { name: name.to_owned() }),
        };
        let transfer = opacities(name, range).map_err(|_| RenderError::SoftRange { range })?;
        Ok((light, transfer))
    }

    /// Returns the unit vector towards the light, world frame.
    pub(crate) fn towards(&self, axes: &Axes) -> DVec3 {
        let [right, up, towards] = self.towards;
        (right * axes.right + up * axes.up - towards * axes.forward).normalize_or(-axes.forward)
    }
}

fn colours(ramp: [[u8; 3]; 4]) -> [[f64; 3]; 4] {
    ramp.map(|colour| colour.map(|channel| f64::from(channel) / 255.0))
}

/// Returns a preset's transfer function. Levels are shares of the range.
fn opacities(name: &str, range: [f64; 2]) -> Result<Transfer, TransferError> {
    let [low, high] = range;
    let level = |share: f64| low + share * (high - low);
    let curve = |points: &[(f64, f64)]| {
        Curve::new(&points.iter().map(|&(share, opacity)| (level(share), opacity)).collect::<Vec<_>>())
    };
    // Over 1 mm.
    let of = |points: &[(f64, f64)]| Transfer::new(Opacity::Curve(curve(points)?), 1.0, Colour::grey(range)?);
    match name {
        "bone" => of(&[(0.5, 0.0), (0.62, 0.5), (0.78, 0.98)]),
        "vessel" => of(&[(0.015, 0.0), (0.04, 0.9), (0.09, 0.9), (0.16, 0.0)]),
        "glass" => of(&[(0.2, 0.0), (0.3, 0.25), (1.0, 0.25)])?
            .with_gradient(Curve::new(&[(0.02 * (high - low), 0.02), (0.12 * (high - low), 1.0)])?),
        _ => of(&[(0.2, 0.0), (0.3, 0.3), (0.42, 0.97)]),
    }
}

//! Scenes: grey levels at points in mm, and their values after a Gaussian blur, in closed form
//! if there is one.
//!
//! Values are grey levels, meant for 0…255 but not clipped: a clipped truth has no closed form.
//! The standard scenes stay far enough inside that 8 bits do not clip noise of up to 6 grey
//! levels either (see [`Blobs::draw`]). Only speckle has an unbounded tail.

use std::sync::Arc;

use glam::{DMat3, DVec3};

use super::body::Body;

mod blobs;
mod marschner_lobb;
mod plane;
mod pulsating;
mod ramp;
mod speckle;
mod sphere;
mod thin_sheet;
mod waves;
mod wires;
mod zone_plate;

#[cfg(test)]
mod tests;

pub use blobs::{Blob, Blobs};
pub use marschner_lobb::MarschnerLobb;
pub use plane::Plane;
pub use pulsating::Pulsating;
pub use ramp::Ramp;
pub use speckle::Speckle;
pub use sphere::Sphere;
pub use thin_sheet::ThinSheet;
pub use waves::{Wave, Waves};
pub use wires::{Wire, Wires};
pub use zone_plate::ZonePlate;

/// A phantom's content.
#[derive(Debug, Clone, PartialEq)]
pub enum Scene {
    /// The same grey level everywhere.
    Constant(f64),
    /// Linear in world position.
    Ramp(Ramp),
    /// Gaussian blobs and possibly a sphere on a background.
    Blobs(Blobs),
    /// One sphere.
    Sphere(Sphere),
    /// Two half spaces.
    Plane(Plane),
    /// Shells that become finer with the distance from a centre.
    ZonePlate(ZonePlate),
    /// Plane waves.
    Waves(Waves),
    /// Thin straight wires.
    Wires(Wires),
    /// A thin sheet.
    ThinSheet(ThinSheet),
    /// The test function of Marschner and Lobb.
    MarschnerLobb(MarschnerLobb),
    /// Fully developed speckle.
    Speckle(Speckle),
    /// A sphere whose radius changes with time.
    Pulsating(Pulsating),
    /// An object for a simulated scanner: see [`super::bmode`]. Its grey levels are the mean
    /// echoes of its materials.
    Body(Arc<Body>),
}

impl Scene {
    /// Returns a ramp that stays between 40 and 216 within 25 mm of the origin along each axis,
    /// with a different slope along each.
    pub fn standard_ramp() -> Self {
        Self::Ramp(Ramp { at_origin: 128.0, gradient: DVec3::new(1.1, 0.7, -1.7) })
    }

    /// Returns a hard sphere of radius 10 mm at the origin: 180 in 60.
    pub fn standard_sphere() -> Self {
        Self::Sphere(Sphere { centre: DVec3::ZERO, radius: 10.0, inside: 180.0, outside: 60.0, edge_sigma: 0.0 })
    }

    /// Returns a body's landmarks, world mm.
    pub fn landmarks(&self) -> Vec<DVec3> {
        let Self::Body(body) = self else { return Vec::new() };
        body.landmarks.iter().map(|landmark| body.world_from_body.transform_point3(landmark.point)).collect()
    }

    /// Whether it changes with time.
    pub fn moves(&self) -> bool {
        matches!(self, Self::Pulsating(_))
    }

    /// Returns the scene at a time (ns after the first frame's epoch), as a static scene.
    /// Static scenes are returned unchanged.
    ///
    /// All other methods use a moving scene at time 0.
    pub fn at_time(&self, time_ns: i64) -> Self {
        match self {
            Self::Pulsating(pulsating) => Self::Sphere(pulsating.at_time(time_ns)),
            _ => self.clone(),
        }
    }

    /// Returns the grey level at a point of the world (mm).
    pub fn value(&self, world: DVec3) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Ramp(ramp) => ramp.value(world),
            Self::Blobs(blobs) => blobs.value(world),
            Self::Sphere(sphere) => sphere.value(world),
            Self::Plane(plane) => plane.blurred(world, &DMat3::ZERO),
            Self::ZonePlate(plate) => plate.blurred(world, &DMat3::ZERO),
            Self::Waves(waves) => waves.blurred(world, &DMat3::ZERO),
            Self::Wires(wires) => wires.blurred(world, &DMat3::ZERO),
            Self::ThinSheet(sheet) => sheet.blurred(world, &DMat3::ZERO),
            Self::MarschnerLobb(function) => function.value(world),
            Self::Speckle(speckle) => speckle.value(world),
            Self::Pulsating(pulsating) => pulsating.at_time(0).value(world),
            Self::Body(body) => body.grey(world),
        }
    }

    /// Returns the grey level at a point of the scene convolved with a Gaussian of the given
    /// covariance (mm², world axes).
    ///
    /// `None` if there is no closed form: for a sphere under an anisotropic blur, for Marschner
    /// and Lobb's function, for speckle and for bodies. [`super::blur`] integrates those.
    pub fn blurred(&self, world: DVec3, covariance: &DMat3) -> Option<f64> {
        match self {
            Self::Constant(value) => Some(*value),
            // A symmetric kernel averages a linear function to its value in the middle.
            Self::Ramp(ramp) => Some(ramp.value(world)),
            Self::Blobs(blobs) => {
                let sphere = match &blobs.sphere {
                    Some(sphere) => sphere.softened(isotropic_variance(covariance)?).value(world),
                    None => 0.0,
                };
                Some(blobs.blurred_bumps(world, covariance) + sphere)
            }
            Self::Sphere(sphere) => Some(sphere.softened(isotropic_variance(covariance)?).value(world)),
            Self::Plane(plane) => Some(plane.blurred(world, covariance)),
            Self::ZonePlate(plate) => Some(plate.blurred(world, covariance)),
            Self::Waves(waves) => Some(waves.blurred(world, covariance)),
            Self::Wires(wires) => Some(wires.blurred(world, covariance)),
            Self::ThinSheet(sheet) => Some(sheet.blurred(world, covariance)),
            Self::MarschnerLobb(_) | Self::Speckle(_) | Self::Body(_) => None,
            Self::Pulsating(_) => self.at_time(0).blurred(world, covariance),
        }
    }

    /// Returns the scene convolved with an isotropic Gaussian of the given σ (mm). `None` if
    /// that has no closed form: for Marschner and Lobb's function, for speckle and for bodies.
    pub fn softened(&self, sigma: f64) -> Option<Self> {
        let variance = sigma * sigma;
        Some(match self {
            Self::Constant(_) | Self::Ramp(_) => self.clone(),
            Self::Blobs(blobs) => Self::Blobs(blobs.softened(variance)),
            Self::Sphere(sphere) => Self::Sphere(sphere.softened(variance)),
            Self::Plane(plane) => Self::Plane(plane.softened(variance)),
            Self::ZonePlate(plate) => Self::ZonePlate(plate.softened(variance)),
            Self::Waves(waves) => Self::Waves(waves.softened(variance)),
            Self::Wires(wires) => Self::Wires(wires.softened(variance)),
            Self::ThinSheet(sheet) => Self::ThinSheet(sheet.softened(variance)),
            Self::MarschnerLobb(_) | Self::Speckle(_) | Self::Body(_) => return None,
            Self::Pulsating(_) => return self.at_time(0).softened(sigma),
        })
    }
}

/// Returns the variance of an isotropic covariance; `None` if it is anisotropic.
pub(super) fn isotropic_variance(covariance: &DMat3) -> Option<f64> {
    let variance = (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z) / 3.0;
    let rest = *covariance - DMat3::from_diagonal(DVec3::splat(variance));
    rest.to_cols_array().iter().all(|x| x.abs() <= 1e-9 * variance).then_some(variance)
}

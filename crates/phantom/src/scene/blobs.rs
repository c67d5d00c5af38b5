//! Gaussian blobs: the convolution of Gaussians is a Gaussian, so their truth under any kernel
//! is exact.

use glam::{DMat3, DVec3};

use super::sphere::Sphere;
use crate::elementary::exp;
use crate::random::{Draws, Purpose};

/// An isotropic Gaussian bump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blob {
    /// World mm.
    pub centre: DVec3,
    /// Standard deviation, mm.
    pub sigma: f64,
    /// Grey levels at the centre.
    pub amplitude: f64,
}

/// The sum of a background, Gaussian blobs and at most one sphere.
#[derive(Debug, Clone, PartialEq)]
pub struct Blobs {
    /// Grey level far from everything.
    pub background: f64,
    /// The bumps.
    pub blobs: Vec<Blob>,
    /// Added to the others; its `outside` is usually 0.
    pub sphere: Option<Sphere>,
}

impl Blob {
    fn value(&self, world: DVec3) -> f64 {
        self.amplitude * exp(-world.distance_squared(self.centre) / (2.0 * self.sigma * self.sigma))
    }

    /// A √(|S|/|S+Σ|) exp(−xᵀ(S+Σ)⁻¹x/2) with S = σ²I: the convolution of two Gaussians.
    fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let variance = self.sigma * self.sigma;
        let sum = DMat3::from_diagonal(DVec3::splat(variance)) + *covariance;
        let x = world - self.centre;
        let quadratic = x.dot(sum.inverse() * x);
        self.amplitude * (variance * variance * variance / sum.determinant()).sqrt() * exp(-0.5 * quadratic)
    }

    fn softened(&self, variance: f64) -> Self {
        let sigma = (self.sigma * self.sigma + variance).sqrt();
        let ratio = self.sigma / sigma;
        Self { centre: self.centre, sigma, amplitude: self.amplitude * ratio * ratio * ratio }
    }
}

impl Blobs {
    /// Draws 60 blobs of σ 1.2–5 mm and amplitudes from −70 to 110 on a background of 60, and a
    /// sphere. The sphere has a radius of 6–9 mm and an edge softened by σ = 0.6 mm. All
    /// centres are within ±25 mm (the sphere whole).
    ///
    /// An amplitude is drawn again if it takes the scene out of 25…220 at its own or any
    /// earlier blob's centre. Scanners clip, but truths must not: a truth beyond 8 bits would
    /// count as an error of the reconstruction.
    pub fn draw(seed: u64) -> Self {
        const RANGE: std::ops::RangeInclusive<f64> = 25.0..=220.0;
        let mut draws = Draws::new(seed, Purpose::Scene, 0);
        let radius = draws.uniform(6.0, 9.0);
        // A margin of 2 mm keeps the soft edge inside too.
        let centre = draw_point(&mut draws, 25.0 - radius - 2.0);
        let sphere = Sphere { centre, radius, inside: draws.uniform(40.0, 70.0), outside: 0.0, edge_sigma: 0.6 };
        let mut scene = Self { background: 60.0, blobs: Vec::with_capacity(60), sphere: Some(sphere) };
        while scene.blobs.len() < 60 {
            let centre = draw_point(&mut draws, 25.0);
            let sigma = draws.uniform(1.2, 5.0);
            // Between bright and dark neighbours no amplitude may fit; then another centre is
            // drawn.
            for _ in 0..16 {
                let blob = Blob { centre, sigma, amplitude: draws.uniform(-70.0, 110.0) };
                scene.blobs.push(blob);
                if scene.blobs.iter().all(|b| RANGE.contains(&scene.value(b.centre))) {
                    break;
                }
                scene.blobs.pop();
            }
        }
        scene
    }

    /// Returns the blurred scene without the sphere.
    pub(crate) fn blurred_bumps(&self, world: DVec3, covariance: &DMat3) -> f64 {
        self.background + self.blobs.iter().map(|b| b.blurred(world, covariance)).sum::<f64>()
    }

    pub(super) fn softened(&self, variance: f64) -> Self {
        Self {
            background: self.background,
            blobs: self.blobs.iter().map(|b| b.softened(variance)).collect(),
            sphere: self.sphere.map(|s| s.softened(variance)),
        }
    }

    pub(super) fn value(&self, world: DVec3) -> f64 {
        let bumps: f64 = self.blobs.iter().map(|b| b.value(world)).sum();
        self.background + bumps + self.sphere.map_or(0.0, |s| s.value(world))
    }
}

fn draw_point(draws: &mut Draws, half_width: f64) -> DVec3 {
    let [x, y, z] = std::array::from_fn(|_| draws.uniform(-half_width, half_width));
    DVec3::new(x, y, z)
}

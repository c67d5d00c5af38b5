//! Gaussian blobs: Gaussians convolve to Gaussians, so their truth under any kernel is exact.

use glam::{DMat3, DVec3};

use super::sphere::Sphere;
use crate::phantom::elementary::exp;
use crate::phantom::random::{Draws, Purpose};

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

    /// A √(|S|/|S+Σ|) exp(−xᵀ(S+Σ)⁻¹x/2) with S = σ²I: Gaussians convolve to Gaussians.
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
    /// 60 blobs of σ 1.2–5 mm and amplitudes from −70 to 110 on a background of 60, and a sphere of radius 6–9 mm whose edge is softened by
    /// σ = 0.6 mm, all with their centres within ±25 mm (the sphere whole).
    ///
    /// An amplitude that would take the scene out of 25…220 at its own or any earlier blob's centre is drawn again: scanners clip, truths must not, and
    /// a truth that 8 bits cannot hold would be charged to the reconstruction.
    pub fn draw(seed: u64) -> Self {
        const RANGE: std::ops::RangeInclusive<f64> = 25.0..=220.0;
        let mut draws = Draws::new(seed, Purpose::Scene, 0);
        let radius = draws.uniform(6.0, 9.0);
        // 2 mm more than the radius keep the soft edge inside too.
        let centre = draw_point(&mut draws, 25.0 - radius - 2.0);
        let sphere = Sphere { centre, radius, inside: draws.uniform(40.0, 70.0), outside: 0.0, edge_sigma: 0.6 };
        let mut scene = Self { background: 60.0, blobs: Vec::with_capacity(60), sphere: Some(sphere) };
        while scene.blobs.len() < 60 {
            let centre = draw_point(&mut draws, 25.0);
            let sigma = draws.uniform(1.2, 5.0);
            // A place where nothing fits, between bright and dark neighbours, is given up for another.
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

    /// Without the sphere.
    pub(in crate::phantom) fn blurred_bumps(&self, world: DVec3, covariance: &DMat3) -> f64 {
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

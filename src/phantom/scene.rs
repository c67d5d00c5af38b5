//! Scenes: what lies in the world, as grey levels at points in mm, and what is left of it after a Gaussian blur, in closed form.
//!
//! Values are grey levels, meant for 0…255 but not clipped to it: a clipped truth has no closed form. The standard scenes stay far enough inside
//! that noise of up to 6 grey levels is not clipped by 8 bits either (see [`Blobs::draw`]).

use std::f64::consts::{FRAC_2_PI, SQRT_2};

use glam::{DMat3, DVec3};

use super::elementary::{erf, exp, normal_cdf};
use super::random::{Draws, Purpose};

/// Beyond this many σ an error function is 0 or 1 to 16 digits.
pub(super) const EDGE_REACH: f64 = 8.3;

/// What the phantom is made of.
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
}

/// A grey level that is linear in world position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    /// Grey level at the world's origin.
    pub at_origin: f64,
    /// Grey levels per mm along world x, y, z.
    pub gradient: DVec3,
}

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

/// A ball whose edge is a step convolved with an isotropic 3D Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// World mm.
    pub centre: DVec3,
    /// mm.
    pub radius: f64,
    /// Grey level deep inside.
    pub inside: f64,
    /// Grey level far outside.
    pub outside: f64,
    /// σ of the Gaussian that softens the edge, mm; 0 is a hard edge (10–90 % rise: 2.563 σ).
    pub edge_sigma: f64,
}

/// Two half spaces that meet in a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit vector from the `below` side to the `above` side, world.
    pub normal: DVec3,
    /// Signed distance of the plane from the world's origin along `normal`, mm.
    pub offset: f64,
    /// Grey level on the side the normal leaves.
    pub below: f64,
    /// Grey level on the side the normal points to.
    pub above: f64,
    /// σ of the Gaussian that softens the edge, mm; 0 is a hard edge.
    pub edge_sigma: f64,
}

impl Scene {
    /// A ramp that stays between 40 and 216 within 25 mm of the origin along each axis, with a different slope along each.
    pub fn standard_ramp() -> Self {
        Self::Ramp(Ramp { at_origin: 128.0, gradient: DVec3::new(1.1, 0.7, -1.7) })
    }

    /// A hard sphere of radius 10 mm at the origin: 180 in 60.
    pub fn standard_sphere() -> Self {
        Self::Sphere(Sphere { centre: DVec3::ZERO, radius: 10.0, inside: 180.0, outside: 60.0, edge_sigma: 0.0 })
    }

    /// Grey level at a point of the world (mm).
    pub fn value(&self, world: DVec3) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Ramp(ramp) => ramp.value(world),
            Self::Blobs(blobs) => blobs.value(world),
            Self::Sphere(sphere) => sphere.value(world),
            Self::Plane(plane) => plane.blurred(world, &DMat3::ZERO),
        }
    }

    /// Grey level at a point of the scene convolved with a Gaussian of the given covariance (mm², world axes).
    ///
    /// `None` where no closed form exists: a sphere under a blur that is not the same in all directions.
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
                let bumps: f64 = blobs.blobs.iter().map(|b| b.blurred(world, covariance)).sum();
                Some(blobs.background + bumps + sphere)
            }
            Self::Sphere(sphere) => Some(sphere.softened(isotropic_variance(covariance)?).value(world)),
            Self::Plane(plane) => Some(plane.blurred(world, covariance)),
        }
    }

    /// The scene convolved with an isotropic Gaussian of the given σ (mm): again a scene, of the same kind.
    pub fn softened(&self, sigma: f64) -> Self {
        let variance = sigma * sigma;
        match self {
            Self::Constant(_) | Self::Ramp(_) => self.clone(),
            Self::Blobs(blobs) => Self::Blobs(Blobs {
                background: blobs.background,
                blobs: blobs.blobs.iter().map(|b| b.softened(variance)).collect(),
                sphere: blobs.sphere.map(|s| s.softened(variance)),
            }),
            Self::Sphere(sphere) => Self::Sphere(sphere.softened(variance)),
            Self::Plane(plane) => {
                Self::Plane(Plane { edge_sigma: (plane.edge_sigma * plane.edge_sigma + variance).sqrt(), ..*plane })
            }
        }
    }
}

impl Ramp {
    fn value(&self, world: DVec3) -> f64 {
        self.at_origin + self.gradient.dot(world)
    }
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

    fn value(&self, world: DVec3) -> f64 {
        let bumps: f64 = self.blobs.iter().map(|b| b.value(world)).sum();
        self.background + bumps + self.sphere.map_or(0.0, |s| s.value(world))
    }
}

fn draw_point(draws: &mut Draws, half_width: f64) -> DVec3 {
    let [x, y, z] = std::array::from_fn(|_| draws.uniform(-half_width, half_width));
    DVec3::new(x, y, z)
}

impl Sphere {
    fn value(&self, world: DVec3) -> f64 {
        self.at_distance(world.distance(self.centre))
    }

    /// Grey level at a distance r (mm) from the centre.
    ///
    /// With R the radius and σ the edge's: [erf((R+r)/√2σ) + erf((R−r)/√2σ)]/2 − σ/(√2π r) [e^{−(R−r)²/2σ²} − e^{−(R+r)²/2σ²}]. The level halfway between
    /// inside and outside lies at R − σ²/R: a blurred sphere looks smaller.
    pub(super) fn at_distance(&self, r: f64) -> f64 {
        self.outside + (self.inside - self.outside) * self.part_inside(r)
    }

    fn part_inside(&self, r: f64) -> f64 {
        let (radius, sigma) = (self.radius, self.edge_sigma);
        if r - radius > EDGE_REACH * sigma {
            return 0.0;
        }
        if radius - r >= EDGE_REACH * sigma {
            return 1.0;
        }
        let variance = sigma * sigma;
        let inner = 0.5 * (erf((radius + r) / (SQRT_2 * sigma)) + erf((radius - r) / (SQRT_2 * sigma)));
        let y = radius * r / variance;
        // The bracket over r, which cancels near the centre: there 2 sinh(y)/y by its series instead.
        let shell = if y < 0.5 {
            let sinh_over_y = 1.0 + y * y / 6.0 * (1.0 + y * y / 20.0 * (1.0 + y * y / 42.0 * (1.0 + y * y / 72.0)));
            2.0 * radius / variance * exp(-(radius * radius + r * r) / (2.0 * variance)) * sinh_over_y
        } else {
            let at = |x: f64| exp(-x * x / (2.0 * variance));
            (at(radius - r) - at(radius + r)) / r
        };
        // 1/√2π = ½ √(2/π).
        inner - 0.5 * FRAC_2_PI.sqrt() * sigma * shell
    }

    fn softened(&self, variance: f64) -> Self {
        Self { edge_sigma: (self.edge_sigma * self.edge_sigma + variance).sqrt(), ..*self }
    }
}

impl Plane {
    /// Φ(distance / σ) with σ² the edge's plus the blur's along the normal: no shift, a 10–90 % rise of 2.563 σ.
    fn blurred(&self, world: DVec3, covariance: &DMat3) -> f64 {
        let distance = self.normal.dot(world) - self.offset;
        let sigma = (self.edge_sigma * self.edge_sigma + self.normal.dot(*covariance * self.normal)).sqrt();
        let part = if distance.abs() >= EDGE_REACH * sigma {
            if distance >= 0.0 { 1.0 } else { 0.0 }
        } else {
            normal_cdf(distance / sigma)
        };
        self.below + (self.above - self.below) * part
    }
}

/// The variance of a covariance that is the same in all directions; `None` when it is not.
pub(super) fn isotropic_variance(covariance: &DMat3) -> Option<f64> {
    let variance = (covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z) / 3.0;
    let rest = *covariance - DMat3::from_diagonal(DVec3::splat(variance));
    rest.to_cols_array().iter().all(|x| x.abs() <= 1e-9 * variance).then_some(variance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// The scene convolved with a Gaussian by the midpoint rule over ±5.5 σ along the covariance's axes.
    fn brute(scene: &Scene, world: DVec3, axes: DMat3, sigma: DVec3, steps: i32) -> f64 {
        let nodes: Vec<(f64, f64)> = (0..steps)
            .map(|k| {
                let t = (f64::from(k) + 0.5) / f64::from(steps) * 11.0 - 5.5;
                (t, (-0.5 * t * t).exp())
            })
            .collect();
        let (mut sum, mut weights) = (0.0, 0.0);
        for (x, wx) in &nodes {
            for (y, wy) in &nodes {
                for (z, wz) in &nodes {
                    let weight = wx * wy * wz;
                    sum += weight * scene.value(world + axes * (DVec3::new(*x, *y, *z) * sigma));
                    weights += weight;
                }
            }
        }
        sum / weights
    }

    fn covariance(axes: DMat3, sigma: DVec3) -> DMat3 {
        axes * DMat3::from_diagonal(sigma * sigma) * axes.transpose()
    }

    fn turned() -> DMat3 {
        DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.5, -0.3, 0.8))
    }

    const PLACES: [DVec3; 4] =
        [DVec3::ZERO, DVec3::new(2.0, 1.0, -1.0), DVec3::new(-7.0, 6.0, 3.0), DVec3::new(0.5, -9.5, 2.0)];

    #[test]
    fn smooth_scenes_under_an_oblong_turned_blur_match_brute_force() {
        let blobs = Blobs {
            background: 60.0,
            sphere: None,
            blobs: vec![
                Blob { centre: DVec3::new(1.0, 0.5, -0.5), sigma: 1.2, amplitude: 110.0 },
                Blob { centre: DVec3::new(-6.0, 6.0, 2.0), sigma: 3.0, amplitude: -70.0 },
            ],
        };
        let soft_plane = Plane { normal: turned().y_axis, offset: 1.0, below: 30.0, above: 200.0, edge_sigma: 0.5 };
        let sigma = DVec3::new(0.4, 0.9, 1.6);
        for scene in [Scene::Blobs(blobs), Scene::standard_ramp(), Scene::Constant(42.0), Scene::Plane(soft_plane)] {
            for place in PLACES {
                let closed = scene.blurred(place, &covariance(turned(), sigma)).unwrap();
                let brute = brute(&scene, place, turned(), sigma, 40);
                assert!((closed - brute).abs() < 1e-4, "{scene:?} at {place}: {closed} {brute}");
            }
        }
    }

    #[test]
    fn spheres_under_an_equal_blur_match_brute_force() {
        let soft =
            Sphere { centre: DVec3::new(0.5, -0.5, 1.0), radius: 8.0, inside: 180.0, outside: 60.0, edge_sigma: 0.9 };
        for scene in [Scene::Sphere(soft), Scene::Blobs(Blobs::draw(3))] {
            for place in PLACES {
                let closed = scene.blurred(place, &covariance(turned(), DVec3::splat(1.1))).unwrap();
                let brute = brute(&scene, place, turned(), DVec3::splat(1.1), 40);
                assert!((closed - brute).abs() < 1e-4, "{place}: {closed} {brute}");
                let softened = scene.softened(1.1).value(place);
                assert!((closed - softened).abs() < 1e-9, "{closed} {softened}");
            }
        }
        // The hard edge makes the midpoint rule coarse: 120³ jumps of the integrand.
        let hard = Scene::standard_sphere();
        for place in [DVec3::new(9.0, 1.0, 0.0), DVec3::new(0.0, 10.5, 0.0)] {
            let closed = hard.blurred(place, &covariance(turned(), DVec3::splat(2.0))).unwrap();
            let brute = brute(&hard, place, turned(), DVec3::splat(2.0), 120);
            assert!((closed - brute).abs() < 0.05, "{place}: {closed} {brute}");
        }
        assert_eq!(hard.blurred(DVec3::ZERO, &DMat3::from_diagonal(DVec3::new(1.0, 1.0, 2.0))), None);
    }

    #[test]
    fn a_spheres_profile_is_smooth_through_its_centre_and_halves_where_theory_says() {
        let sphere = Sphere { centre: DVec3::ZERO, radius: 10.0, inside: 1.0, outside: 0.0, edge_sigma: 1.0 };
        // Half level at R − σ²/R, to next order.
        assert!((sphere.at_distance(10.0 - 0.1) - 0.5).abs() < 1e-3);
        // Wide blur: series and difference of exponentials meet at y = R r/σ² = 0.5.
        let wide = Sphere { edge_sigma: 12.0, ..sphere };
        let meet = 0.5 * 144.0 / 10.0;
        assert!((wide.at_distance(meet - 1e-9) - wide.at_distance(meet)).abs() < 1e-9);
        let brute = brute(
            &Scene::Sphere(Sphere { edge_sigma: 1.0, ..wide }),
            DVec3::ZERO,
            DMat3::IDENTITY,
            DVec3::splat(143_f64.sqrt()),
            120,
        );
        assert!((wide.at_distance(0.0) - brute).abs() < 1e-5, "{} {brute}", wide.at_distance(0.0));
    }

    #[test]
    fn edges_without_softness_are_steps() {
        let hard = Scene::standard_sphere();
        assert_eq!(hard.value(DVec3::new(9.999, 0.0, 0.0)), 180.0);
        assert_eq!(hard.value(DVec3::new(0.0, 10.001, 0.0)), 60.0);
        let plane = Plane { normal: DVec3::Z, offset: 2.0, below: 10.0, above: 20.0, edge_sigma: 0.0 };
        assert_eq!(Scene::Plane(plane).value(DVec3::new(5.0, 5.0, 1.999)), 10.0);
        assert_eq!(Scene::Plane(plane).value(DVec3::new(5.0, 5.0, 2.001)), 20.0);
        // 10–90 % rise of 2.563 σ, no shift.
        let blurred = |z| Scene::Plane(plane).blurred(DVec3::new(0.0, 0.0, 2.0 + z), &DMat3::IDENTITY).unwrap();
        assert!((blurred(-1.2816) - 11.0).abs() < 1e-3 && (blurred(1.2816) - 19.0).abs() < 1e-3);
        assert!((blurred(0.0) - 15.0).abs() < 1e-12);
    }

    #[test]
    fn drawn_blobs_are_as_described_and_leave_room_for_noise() {
        for seed in 0..8 {
            let blobs = Blobs::draw(seed);
            assert_eq!(blobs.blobs.len(), 60);
            for blob in &blobs.blobs {
                assert!(blob.centre.abs().max_element() <= 25.0);
                assert!((1.2..5.0).contains(&blob.sigma) && (-70.0..110.0).contains(&blob.amplitude));
            }
            let sphere = blobs.sphere.unwrap();
            assert!(sphere.centre.abs().max_element() + sphere.radius <= 25.0);
            let scene = Scene::Blobs(blobs);
            for k in 0..40 * 40 * 40 {
                let at = |n: i32| f64::from(n % 40) * 1.5 - 29.25;
                let value = scene.value(DVec3::new(at(k), at(k / 40), at(k / 1600)));
                assert!((10.0..=245.0).contains(&value), "seed {seed}: {value}");
            }
        }
    }
}

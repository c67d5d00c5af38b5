//! Volumes given by formulas, and pictures of them.

use glam::{DAffine3, DMat3, DVec3};

use render::classify::light::Light;
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::{Picture, RenderRegion, RenderSettings, Renderer};
use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

/// A volume given by a formula: the value, or `None` for unseen voxels.
pub(crate) struct Field<F> {
    pub(crate) low: [i64; 3],
    pub(crate) high: [i64; 3],
    pub(crate) value: F,
}

impl<F: Fn([i64; 3]) -> Option<f32> + Sync> Values for Field<F> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in (0_i64..).zip(value.iter_mut().zip(weight)) {
            let at = [start[0] + x, start[1], start[2]];
            let inside = (0..3).all(|a| (self.low[a]..=self.high[a]).contains(&at[a]));
            (*value, *weight) = inside.then(|| (self.value)(at)).flatten().map_or((0.0, 0.0), |v| (v, 1.0));
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let edge = EDGE as i64;
        let span = move |a: usize| self.low[a].div_euclid(edge) as i32..=self.high[a].div_euclid(edge) as i32;
        Box::new(span(2).flat_map(move |z| span(1).flat_map(move |y| span(0).map(move |x| [x, y, z]))))
    }
}

impl<F> Field<F> {
    /// Returns a render region equal to the field's box.
    pub(crate) fn region(&self, world_from_lattice: Transform<World, Volume>) -> RenderRegion {
        RenderRegion::new(world_from_lattice, self.low, self.high).unwrap()
    }
}

pub(crate) fn lattice(direction: DMat3, spacing: DVec3, origin: DVec3) -> Transform<World, Volume> {
    Transform::from_affine(DAffine3 { matrix3: direction * DMat3::from_diagonal(spacing), translation: origin })
}

/// Voxels of 1 mm on the world's axes.
pub(crate) fn millimetres() -> Transform<World, Volume> {
    lattice(DMat3::IDENTITY, DVec3::ONE, DVec3::ZERO)
}

/// Light under which everything has its own colour, facing in any direction.
pub(crate) fn flat() -> Light {
    Light::default().with_parts(1.0, 0.0, 0.0, 1).unwrap()
}

/// White of one opacity per mm, for any intensity above 0.
pub(crate) fn fog(alpha: f64) -> Transfer {
    let curve = Curve::new(&[(0.0, alpha), (255.0, alpha)]).unwrap();
    Transfer::new(Opacity::Curve(curve), 1.0, Colour::grey([-1.0, 0.0]).unwrap()).unwrap()
}

/// White of an opacity per mm that rises with the intensity.
pub(crate) fn rising(points: &[(f64, f64)]) -> Transfer {
    Transfer::new(Opacity::Curve(Curve::new(points).unwrap()), 1.0, Colour::grey([-1.0, 0.0]).unwrap()).unwrap()
}

/// Settings for all samples of a picture of this size in flat light: no ray ends early.
pub(crate) fn whole(size: [u32; 2], transfer: Transfer) -> RenderSettings {
    RenderSettings { light: flat(), stop: 0.0, ..RenderSettings::new(size, transfer) }
}

/// Renders a finished volume.
pub(crate) fn drawn(settings: &RenderSettings, region: RenderRegion, volume: &(impl Values + ?Sized)) -> Picture {
    let mut renderer = Renderer::new(settings, region).unwrap();
    renderer.update_all(volume);
    renderer.picture()
}

/// Number of pixels in which two pictures differ by a bit.
pub(crate) fn other_bits(a: &Picture, b: &Picture) -> usize {
    assert_eq!(a.size, b.size, "pictures of one size are compared");
    a.pixels.iter().zip(&b.pixels).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

/// Whether all of a picture is finite, and within the range of light and transmittance up to a
/// rounding of `hair`.
pub(crate) fn sane(picture: &Picture, hair: f32) -> bool {
    picture.pixels.iter().flatten().all(|x| (0.0..=1.0 + hair).contains(x))
}

/// Uniform in [0, 1), by number; the same on every machine.
pub(crate) fn random(seed: u32, number: u32) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9) ^ number.wrapping_mul(0x85EB_CA6B);
    for _ in 0..3 {
        x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
        x ^= x >> 12;
    }
    f64::from(x) / 2.0_f64.powi(32)
}

/// Uniform in [0, 1), by voxel.
pub(crate) fn random_at(seed: u32, at: [i64; 3]) -> f64 {
    let [x, y, z] = at.map(|i| i.rem_euclid(1024) as u32);
    random(seed, (z << 20) | (y << 10) | x)
}

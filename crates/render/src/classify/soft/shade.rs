//! The colour of a voxel in soft light.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use super::field::LightField;
use super::presets::SoftLight;
use crate::classify::gradient::FLAT_PER_MM;
use crate::real::{Number, dot};

/// Cells towards the light at which the light of a voxel is looked up, so that a surface does not
/// shade itself.
const BESIDE: f64 = 1.5;

/// Soft light of one view of a volume.
#[derive(Clone)]
pub struct SoftShade {
    light: SoftLight,
    /// Unit vector, world frame.
    to_light: DVec3,
    field: Arc<LightField>,
}

impl SoftShade {
    pub(crate) fn new(light: &SoftLight, to_light: DVec3, field: Arc<LightField>) -> Self {
        Self { light: light.clone(), to_light, field }
    }

    /// Returns the unit vector towards the light, world frame.
    pub(crate) fn to_light(&self) -> DVec3 {
        self.to_light
    }

    /// Returns the colour of a voxel, not multiplied by its opacity. `gradient` is per mm along
    /// the lattice's axes, as are the unit vectors towards the light and halfway to the eye.
    /// `towards_mm` are voxels along each axis per mm.
    #[inline(always)]
    pub(crate) fn colour<T: Number>(
        &self,
        colour: [T; 3],
        gradient: [T; 3],
        [to_light, halfway]: [[T::Scalar; 3]; 2],
        at: [T; 3],
        pitch_mm: [T::Scalar; 3],
    ) -> [T; 3] {
        let light = &self.light;
        let (none, one) = (T::zero(), T::one());
        let length = dot(gradient, gradient).sqrt();
        let inverse = one / length;
        let is_steep = T::both(T::from_f64(FLAT_PER_MM).le(length), none.lt(inverse));
        let cosine = |to: [T::Scalar; 3]| -dot(gradient, to.map(T::splat)) * inverse;
        let facing = (cosine(to_light) + T::from_f64(light.wrap)) * T::from_f64(1.0 / (1.0 + light.wrap));
        // A place without a direction is lit as if the light grazed it.
        let facing = T::select(is_steep, facing.unit(), T::from_f64(light.wrap / (1.0 + light.wrap)));
        let highlight = T::select(is_steep, cosine(halfway).unit().power(light.shininess), none);
        let edge = pitch_mm[0].min(pitch_mm[1]).min(pitch_mm[2]);
        let beside = T::Scalar::from_f64(2.0 * BESIDE) * edge;
        let place: [T; 3] = std::array::from_fn(|a| at[a] + T::splat(to_light[a] * beside / pitch_mm[a]));
        let [red, green, blue, open] = T::light_at(place, &*self.field);
        let direct = [red, green, blue];
        let highlight = T::from_f64(light.specular) * highlight * green;
        std::array::from_fn(|c| {
            let lit = T::from_f64(light.ambient) * open + T::from_f64(light.diffuse) * facing * direct[c];
            let body = match &light.ramp {
                Some(ramp) => on_ramp(ramp.map(|colour| colour[c]), lit.unit()),
                None => colour[c] * lit,
            };
            (body + highlight).unit()
        })
    }
}

/// Returns the level at a place of a ramp from 0 to 1.
#[inline(always)]
fn on_ramp<T: Number>(levels: [f64; 4], at: T) -> T {
    let place = at * T::from_f64(3.0);
    let mut level = T::from_f64(levels[0]);
    for step in 0..3 {
        let part = (place - T::from_f64(step as f64)).unit();
        level = part.mul_add(T::from_f64(levels[step + 1] - levels[step]), level);
    }
    level
}

impl fmt::Debug for SoftShade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SoftShade({:?}, {} bytes)", self.light, self.field.bytes())
    }
}

//! A voxel's colour and opacity, from its value and those of its six neighbours.

use glam::DVec3;

use super::camera::Camera;
use super::gradient::gradient;
use super::light::Light;
use super::real::{Number, Real, dot};
use super::settings::RenderSettings;
use super::stage::Stage;
use super::transfer::Transfer;

/// Premultiplied colour and opacity of a step through a voxel's surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lit<T, const C: usize> {
    pub(super) colour: [T; C],
    pub(super) alpha: T,
}

/// Classifies and lights voxels for one view. The light is as far away as the sun: a headlight shines along the view's axis, in perspective too, so that a
/// voxel looks the same in all its pixels.
#[derive(Debug, Clone)]
pub(super) struct Shader<S> {
    transfer: Transfer,
    light: Light,
    step_mm: S,
    /// Values outside of which everything is transparent.
    visible: [S; 2],
    pitch_mm: [S; 3],
    /// Along the lattice's axes, which are perpendicular.
    to_light: [S; 3],
    halfway: [S; 3],
    /// Depth of stage coordinate 0 and what a voxel along each axis adds.
    depth: [S; 4],
}

impl<S: Real> Shader<S> {
    pub(super) fn new(settings: &RenderSettings, camera: &Camera, stage: &Stage) -> Self {
        let spacing = stage.spacing_mm();
        let matrix = stage.world_from_stage().matrix3;
        let axes = [matrix.x_axis / spacing.x, matrix.y_axis / spacing.y, matrix.z_axis / spacing.z];
        let along = |v: DVec3| axes.map(|axis| S::from_f64(axis.dot(v)));
        let to_eye = -camera.axes().forward;
        let (to_light, halfway) = settings.light.directions(to_eye);
        let depth = |at: DVec3| camera.depth(at, stage);
        let from = depth(DVec3::ZERO);
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| depth(axis) - from);
        Self {
            transfer: settings.transfer.clone(),
            light: settings.light,
            // An empty interval where nothing is visible. Beyond f64's own rounding, lest single precision leave out a voxel.
            visible: settings.transfer.visible().unwrap_or([f64::INFINITY, f64::NEG_INFINITY]).map(S::from_f64),
            step_mm: S::from_f64(camera.step_mm()),
            pitch_mm: spacing.to_array().map(S::from_f64),
            to_light: along(to_light),
            halfway: along(halfway),
            depth: [from, x, y, z].map(S::from_f64),
        }
    }

    pub(super) fn is_grey(&self) -> bool {
        self.transfer.is_grey()
    }

    /// Whether a value and its weight can be anything but transparent: most voxels are not, whatever their slope.
    #[inline(always)]
    pub(super) fn may_show<T: Number<Scalar = S>>(&self, (value, weight): (T, T)) -> T::Mask {
        let [low, high] = self.visible;
        T::both(T::zero().lt(weight), T::both(T::splat(low).le(value), value.le(T::splat(high))))
    }

    /// The voxel at a stage place, from its own value and weight and those of its neighbours below and above along each axis.
    #[inline(always)]
    pub(super) fn shade<const C: usize>(&self, centre: (S, S), around: [[(S, S); 2]; 3], at: [i64; 3]) -> Lit<S, C> {
        self.shade_all(centre, around, at.map(|x| S::from_f64(x as f64)))
    }

    /// As [`Self::shade`], in all lanes, from places along each axis.
    #[inline(always)]
    pub(super) fn shade_all<T: Number<Scalar = S>, const C: usize>(
        &self,
        centre: (T, T),
        around: [[(T, T); 2]; 3],
        at: [T; 3],
    ) -> Lit<T, C> {
        let mut lit = Lit { colour: [T::zero(); C], alpha: T::zero() };
        let visible = self.may_show(centre);
        if !T::any(visible) {
            return lit;
        }
        let (value, _) = centre;
        let [px, py, pz] = self.pitch_mm;
        let slope = [gradient(centre, around[0], px), gradient(centre, around[1], py), gradient(centre, around[2], pz)];
        let alpha = T::select(visible, self.transfer.alpha(value, dot(slope, slope).sqrt()), T::zero());
        if !T::any(T::zero().lt(alpha)) {
            return lit;
        }
        lit.alpha = self.transfer.step_corrected(alpha, self.step_mm);
        let shade = self.light.shade(slope, self.to_light, self.halfway);
        let strength = match self.light.depth_cue() {
            Some(cue) => {
                let [from, x, y, z] = self.depth;
                let depth = at[0].mul_add(T::splat(x), T::splat(from));
                let depth = at[2].mul_add(T::splat(z), at[1].mul_add(T::splat(y), depth));
                cue.factor(depth) * lit.alpha
            }
            None => lit.alpha,
        };
        if C == 1 {
            lit.colour[0] = shade.lit(self.transfer.intensity(value)) * strength;
        } else {
            let rgb = self.transfer.colour(value);
            for (colour, channel) in lit.colour.iter_mut().zip(rgb) {
                *colour = shade.lit(channel) * strength;
            }
        }
        lit
    }
}

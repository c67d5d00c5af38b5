//! A voxel's colour and opacity, from its value and those of its six neighbours.

use glam::DVec3;

use super::camera::Camera;
use super::gradient::gradient;
use super::light::Light;
use super::real::Real;
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
pub(super) struct Shader<T> {
    transfer: Transfer,
    light: Light,
    step_mm: T,
    /// Values outside of which everything is transparent.
    visible: [T; 2],
    pitch_mm: [T; 3],
    /// Along the lattice's axes, which are perpendicular.
    to_light: [T; 3],
    halfway: [T; 3],
    /// Depth of stage coordinate 0 and what a voxel along each axis adds.
    depth: [T; 4],
}

impl<T: Real> Shader<T> {
    pub(super) fn new(settings: &RenderSettings, camera: &Camera, stage: &Stage) -> Self {
        let spacing = stage.spacing_mm();
        let matrix = stage.world_from_stage().matrix3;
        let axes = [matrix.x_axis / spacing.x, matrix.y_axis / spacing.y, matrix.z_axis / spacing.z];
        let along = |v: DVec3| axes.map(|axis| T::from_f64(axis.dot(v)));
        let to_eye = -camera.axes().forward;
        let (to_light, halfway) = settings.light.directions(to_eye);
        let depth = |at: DVec3| camera.depth(at, stage);
        let from = depth(DVec3::ZERO);
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| depth(axis) - from);
        Self {
            transfer: settings.transfer.clone(),
            light: settings.light,
            // An empty interval where nothing is visible. Beyond f64's own rounding, lest single precision leave out a voxel.
            visible: settings.transfer.visible().unwrap_or([f64::INFINITY, f64::NEG_INFINITY]).map(T::from_f64),
            step_mm: T::from_f64(camera.step_mm()),
            pitch_mm: spacing.to_array().map(T::from_f64),
            to_light: along(to_light),
            halfway: along(halfway),
            depth: [from, x, y, z].map(T::from_f64),
        }
    }

    pub(super) fn is_grey(&self) -> bool {
        self.transfer.is_grey()
    }

    /// Whether a value and its weight can be anything but transparent: most voxels are not, whatever their slope.
    #[inline(always)]
    pub(super) fn may_show(&self, (value, weight): (T, T)) -> bool {
        weight > T::ZERO && value >= self.visible[0] && value <= self.visible[1]
    }

    /// The voxel at a stage place, from its own value and weight and those of its neighbours below and above along each axis.
    #[inline(always)]
    pub(super) fn shade<const C: usize>(&self, centre: (T, T), around: [[(T, T); 2]; 3], at: [i64; 3]) -> Lit<T, C> {
        let nothing = Lit { colour: [T::ZERO; C], alpha: T::ZERO };
        if !self.may_show(centre) {
            return nothing;
        }
        let (value, _) = centre;
        let [px, py, pz] = self.pitch_mm;
        let [x, y, z] =
            [gradient(centre, around[0], px), gradient(centre, around[1], py), gradient(centre, around[2], pz)];
        let steep = z.mul_add(z, y.mul_add(y, x * x)).sqrt();
        let alpha = self.transfer.alpha(value, steep);
        if alpha <= T::ZERO {
            return nothing;
        }
        let alpha = self.transfer.step_corrected(alpha, self.step_mm);
        let shade = self.light.shade([x, y, z], self.to_light, self.halfway);
        let [d, dx, dy, dz] = self.depth;
        let [i, j, k] = at.map(|x| T::from_f64(x as f64));
        let cue = match self.light.depth_cue() {
            Some(cue) => cue.factor(dz.mul_add(k, dy.mul_add(j, dx.mul_add(i, d)))),
            None => T::ONE,
        };
        let lit = |colour: T| shade.lit(colour) * cue * alpha;
        let colour = match C {
            1 => [lit(self.transfer.intensity(value)); C],
            _ => {
                let rgb = self.transfer.colour(value);
                std::array::from_fn(|c| lit(rgb[c]))
            }
        };
        Lit { colour, alpha }
    }
}

//! A voxel's colour and opacity, from its value and those of its six neighbours.

use glam::DVec3;

use crate::camera::Camera;
use crate::classify::gradient::gradient;
use crate::classify::light::{Light, Source};
use crate::classify::soft::SoftShade;
use crate::classify::transfer::Transfer;
use crate::mode::VoxelData;
use crate::real::{Number, Real, dot};
use crate::region::RenderRegion;
use crate::settings::RenderSettings;

/// Data of a voxel or a sample: premultiplied colour and opacity of a step, or the mode's data
/// in their place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lit<T, const C: usize> {
    pub(crate) colour: [T; C],
    pub(crate) alpha: T,
}

/// Classifies and lights voxels for one view. The light is at infinity: a headlight shines along
/// the view's axis, in perspective too, so that a voxel looks the same in all its pixels.
#[derive(Debug, Clone)]
pub(crate) struct Shader<S> {
    transfer: Transfer,
    light: Light,
    soft: Option<SoftShade>,
    keeps: VoxelData,
    /// Whether lighting applies; otherwise tissue is evenly white.
    is_lit: bool,
    isovalue: Option<S>,
    is_grey: bool,
    step_mm: S,
    /// Values outside of which everything is transparent.
    visible: [S; 2],
    /// Whether fewer values are visible where the intensity is flat.
    hides_flat: bool,
    pitch_mm: [S; 3],
    /// Along the lattice's axes, which are perpendicular.
    to_light: [S; 3],
    halfway: [S; 3],
    /// Depth of region coordinate 0 and its increase per voxel along each axis.
    depth: [S; 4],
}

/// An interval that holds no value.
const NOTHING: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// Returns the first few of some numbers; if there are fewer, the first in place of the others.
#[inline(always)]
fn first<T: Copy, const N: usize, const C: usize>(of: [T; N]) -> [T; C] {
    let mut first = [of[0]; C];
    for (first, of) in first.iter_mut().zip(of) {
        *first = of;
    }
    first
}

impl<S: Real> Shader<S> {
    pub(crate) fn new(settings: &RenderSettings, camera: &Camera, region: &RenderRegion) -> Self {
        let spacing = region.spacing_mm();
        let matrix = region.world_from_region().matrix3;
        let axes = [matrix.x_axis / spacing.x, matrix.y_axis / spacing.y, matrix.z_axis / spacing.z];
        let along = |v: DVec3| axes.map(|axis| S::from_f64(axis.dot(v)));
        let to_eye = -camera.axes().forward;
        let light = match &settings.soft {
            Some(soft) => settings.light.with_source(Source::Fixed(soft.to_light())).unwrap_or(settings.light),
            None => settings.light,
        };
        let (to_light, halfway) = light.directions(to_eye);
        let depth = |at: DVec3| camera.depth(at, region);
        let from = depth(DVec3::ZERO);
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| depth(axis) - from);
        let keeps = settings.mode.voxel_data();
        let transfer = &settings.transfer;
        let visible = match keeps {
            // An empty interval if nothing is visible. Wider than f64 rounding, so that single
            // precision does not miss a voxel.
            VoxelData::Lit => transfer.visible().unwrap_or(NOTHING),
            // No intensity lies beyond, and products of such values would overflow.
            VoxelData::Intensity | VoxelData::SampleClassifier => [-1e30, 1e30],
        };
        Self {
            transfer: settings.transfer.clone(),
            light,
            soft: settings.soft.clone(),
            keeps,
            is_lit: settings.mode.is_lit(),
            isovalue: settings.mode.isovalue().map(S::from_f64),
            is_grey: settings.soft.is_none() && settings.mode.is_grey(&settings.transfer),
            visible: visible.map(S::from_f64),
            hides_flat: keeps == VoxelData::Lit && transfer.visible_below(0.0) != transfer.visible(),
            step_mm: S::from_f64(camera.step_mm()),
            pitch_mm: spacing.to_array().map(S::from_f64),
            to_light: along(to_light),
            halfway: along(halfway),
            depth: [from, x, y, z].map(S::from_f64),
        }
    }

    /// Returns whether one channel is enough for the colour of a sample.
    pub(crate) fn is_grey(&self) -> bool {
        self.is_grey
    }

    /// Returns the isovalue, in isosurface mode.
    #[inline(always)]
    pub(crate) fn isovalue(&self) -> Option<S> {
        self.isovalue
    }

    /// Returns the values outside of which everything is transparent.
    pub(crate) fn visible(&self) -> [S; 2] {
        self.visible
    }

    /// Returns whether fewer values are visible where the intensity is flat.
    pub(crate) fn hides_flat(&self) -> bool {
        self.hides_flat
    }

    /// Returns the values outside of which everything is transparent if no gradient exceeds
    /// `gradient_per_mm`.
    pub(crate) fn visible_below(&self, gradient_per_mm: f64) -> [S; 2] {
        self.transfer.visible_below(gradient_per_mm).unwrap_or(NOTHING).map(S::from_f64)
    }

    /// Returns the voxel spacing.
    pub(crate) fn pitch_mm(&self) -> [S; 3] {
        self.pitch_mm
    }

    /// Returns whether a value and its weight can be anything but transparent. Most voxels
    /// cannot, whatever their slope.
    #[inline(always)]
    pub(crate) fn may_show<T: Number<Scalar = S>>(&self, voxel: (T, T)) -> T::Mask {
        Self::may_show_between(self.visible, voxel)
    }

    /// Tests like [`Self::may_show`], with the given visible values.
    #[inline(always)]
    pub(crate) fn may_show_between<T: Number<Scalar = S>>([low, high]: [S; 2], (value, weight): (T, T)) -> T::Mask {
        T::both(T::zero().lt(weight), T::both(T::splat(low).le(value), value.le(T::splat(high))))
    }

    /// Shades the voxel at a region position, from its own value and weight and those of its
    /// neighbours below and above along each axis.
    #[inline(always)]
    pub(crate) fn shade<const C: usize>(&self, centre: (S, S), around: [[(S, S); 2]; 3], at: [i64; 3]) -> Lit<S, C> {
        self.shade_all(centre, around, at.map(|x| S::from_f64(x as f64)))
    }

    /// Shades like [`Self::shade`], in all lanes, from positions along each axis.
    #[inline(always)]
    pub(crate) fn shade_all<T: Number<Scalar = S>, const C: usize>(
        &self,
        centre: (T, T),
        around: [[(T, T); 2]; 3],
        at: [T; 3],
    ) -> Lit<T, C> {
        let visible = self.may_show(centre);
        if !T::any(visible) {
            return Lit { colour: [T::zero(); C], alpha: T::zero() };
        }
        let (value, _) = centre;
        let slope = self.slope(centre, around);
        let kept = match self.keeps {
            VoxelData::Lit => return self.light(visible, value, slope, at),
            VoxelData::Intensity => [value; C],
            VoxelData::SampleClassifier => first([value, slope[0], slope[1], slope[2]]),
        };
        let mut lit = Lit { colour: kept, alpha: T::select(visible, T::one(), T::zero()) };
        for colour in &mut lit.colour {
            *colour = T::select(visible, *colour, T::zero());
        }
        lit
    }

    /// Returns the gradient of voxels.
    #[inline(always)]
    fn slope<T: Number<Scalar = S>>(&self, centre: (T, T), around: [[(T, T); 2]; 3]) -> [T; 3] {
        let [px, py, pz] = self.pitch_mm;
        [gradient(centre, around[0], px), gradient(centre, around[1], py), gradient(centre, around[2], pz)]
    }

    /// Lights voxels again that were lit for another view, given the opacity that they have. The
    /// result is that of [`Self::shade_all`].
    #[inline(always)]
    pub(crate) fn relight<T: Number<Scalar = S>, const C: usize>(
        &self,
        alpha: T,
        centre: (T, T),
        around: [[(T, T); 2]; 3],
        at: [T; 3],
    ) -> Lit<T, C> {
        self.coloured(alpha, centre.0, self.slope(centre, around), at)
    }

    /// Classifies and lights intensities and their gradients at region positions; invisible ones
    /// are transparent.
    #[inline(always)]
    pub(crate) fn light<T: Number<Scalar = S>, const C: usize>(
        &self,
        visible: T::Mask,
        value: T,
        slope: [T; 3],
        at: [T; 3],
    ) -> Lit<T, C> {
        let mut lit = Lit { colour: [T::zero(); C], alpha: T::zero() };
        let alpha = T::select(visible, self.transfer.alpha(value, dot(slope, slope).sqrt()), T::zero());
        if !T::any(T::zero().lt(alpha)) {
            return lit;
        }
        lit.alpha = self.transfer.step_corrected(alpha, self.step_mm);
        if !self.is_lit {
            lit.colour = [lit.alpha; C];
            return lit;
        }
        self.coloured(lit.alpha, value, slope, at)
    }

    /// Lights intensities of a known opacity of a step.
    #[inline(always)]
    fn coloured<T: Number<Scalar = S>, const C: usize>(
        &self,
        alpha: T,
        value: T,
        slope: [T; 3],
        at: [T; 3],
    ) -> Lit<T, C> {
        let colour = match C {
            1 => [self.transfer.intensity(value); C],
            _ => {
                let [r, g, b] = self.transfer.colour(value);
                first([r, g, b, T::zero()])
            }
        };
        self.seen(Lit { colour, alpha }, slope, at)
    }

    /// Lights a point of an isosurface, opaque.
    #[inline(always)]
    pub(crate) fn surface<const C: usize>(&self, isovalue: S, slope: [S; 3], at: [S; 3]) -> Lit<S, C> {
        let colour = match C {
            1 => [S::ONE; C],
            _ => {
                let [r, g, b] = self.transfer.colour(isovalue);
                first([r, g, b, S::ZERO])
            }
        };
        self.seen(Lit { colour, alpha: S::ONE }, slope, at)
    }

    /// Applies the light and the depth cue to colours, and premultiplies them by their opacity.
    #[inline(always)]
    fn seen<T: Number<Scalar = S>, const C: usize>(&self, mut lit: Lit<T, C>, slope: [T; 3], at: [T; 3]) -> Lit<T, C> {
        if let Some(soft) = &self.soft {
            let colour = soft.colour(first(lit.colour), slope, [self.to_light, self.halfway], at, self.pitch_mm);
            for c in 0..C {
                lit.colour[c] = colour[c.min(2)] * lit.alpha;
            }
            return lit;
        }
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
        for c in 0..C {
            lit.colour[c] = shade.lit(lit.colour[c]) * strength;
        }
        lit
    }
}

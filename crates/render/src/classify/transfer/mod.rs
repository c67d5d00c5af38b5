//! Transfer functions: from intensity and gradient to opacity and colour.
//!
//! - [`curve`]: piecewise linear functions.
//! - [`colour`]: grey, a perceptually uniform map, or a list.
//! - [`file`](mod@file): transfer functions as TOML.
//! - [`presets`]: transfer functions by name.
//!
//! All functions here depend only on a voxel's intensity (grey levels) and the magnitude of its
//! gradient (grey levels per mm). The opacity classifications are those of Levoy, "Display of
//! surfaces from volume data" (1988), but lengths are in mm instead of voxels. The same volume
//! on a finer lattice therefore gives the same picture.

pub mod colour;
pub mod curve;
mod error;
pub mod file;
pub(crate) mod knots;
mod preset_names;
pub mod presets;

pub use colour::Colour;
pub use curve::{Curve, CurveError, Piecewise};
pub use error::TransferError;

use crate::classify::gradient::FLAT_PER_MM;
use crate::real::Number;

/// Opacity over a unit length.
#[derive(Debug, Clone, PartialEq)]
pub enum Opacity {
    /// Opacity by intensity alone.
    Curve(Curve),
    /// The surface where the intensity f has a `value` v, of even thickness however steep the
    /// intensity is there:
    ///
    /// α = opacity · max(0, 1 − |v − f| / (thickness · |∇f|)); where it is flat, `opacity` at f
    /// = v and 0 elsewhere.
    Isovalue {
        /// v, grey levels.
        value: f64,
        /// Distance from the surface at which the opacity reaches 0, mm.
        thickness_mm: f64,
        /// Opacity on the surface.
        opacity: f64,
    },
    /// The borders between regions of different intensity:
    ///
    /// α = min(1, unit · |∇f| / (f_last − f_first) · curve(f)); 0 where it is flat.
    ///
    /// The gradient per mm times the unit length is the rise over that length; the division
    /// makes it a share of the curve's whole span. The lattice's pitch therefore has no
    /// influence. A border across the whole span that is one unit length thick has the curve's
    /// own opacities. Levoy uses 0 beyond the first and the last point; here the curve keeps its
    /// end values, and ends of 0 give the same.
    Region(Curve),
}

/// The transfer function: opacity and colour of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    opacity: Opacity,
    /// A factor on the opacity over the gradient's magnitude.
    gradient: Option<Curve>,
    unit_mm: f64,
    colour: Colour,
    /// Factor of [`Opacity::Region`]: per grey level per mm; otherwise unused.
    region_scale_mm: f64,
}

impl Transfer {
    /// Creates a transfer function from the opacity over `unit_mm`, and the colour.
    ///
    /// # Errors
    /// [`TransferError`]: a unit length, isovalue, thickness or opacity out of range, a region
    /// curve of one point.
    pub fn new(opacity: Opacity, unit_mm: f64, colour: Colour) -> Result<Self, TransferError> {
        if !(unit_mm > 0.0 && unit_mm.is_finite()) {
            return Err(TransferError::Unit(unit_mm));
        }
        let mut region_scale_mm = 0.0;
        match &opacity {
            Opacity::Curve(_) => {}
            &Opacity::Isovalue { value, thickness_mm, opacity } => {
                if !value.is_finite() {
                    return Err(TransferError::Isovalue(value));
                }
                if !(thickness_mm > 0.0 && thickness_mm.is_finite()) {
                    return Err(TransferError::Thickness(thickness_mm));
                }
                if !(0.0..=1.0).contains(&opacity) {
                    return Err(TransferError::Opacity(opacity));
                }
            }
            Opacity::Region(curve) => {
                let [first, last] = curve.span();
                if first == last {
                    return Err(TransferError::Region);
                }
                region_scale_mm = unit_mm / (last - first);
            }
        }
        Ok(Self { opacity, gradient: None, unit_mm, colour, region_scale_mm })
    }

    /// Returns the same function, its opacity multiplied by a curve over the gradient's
    /// magnitude in grey levels per mm.
    ///
    /// # Errors
    /// [`TransferError::Gradient`]: the curve begins below 0.
    pub fn with_gradient(mut self, curve: Curve) -> Result<Self, TransferError> {
        let [first, _] = curve.span();
        if first < 0.0 {
            return Err(TransferError::Gradient(first));
        }
        self.gradient = Some(curve);
        Ok(self)
    }

    /// Returns the unit length of the opacity, mm.
    pub fn unit_mm(&self) -> f64 {
        self.unit_mm
    }

    /// Returns the opacity classification.
    pub fn opacity(&self) -> &Opacity {
        &self.opacity
    }

    /// Returns the factor over the gradient's magnitude, if any.
    pub fn gradient(&self) -> Option<&Curve> {
        self.gradient.as_ref()
    }

    /// Returns the opacity over the unit length, 0 to 1, from an intensity and its gradient's
    /// magnitude in grey levels per mm. An intensity of NaN is transparent.
    #[inline(always)]
    pub fn alpha<T: Number>(&self, value: T, gradient_per_mm: T) -> T {
        let none = T::zero();
        let alpha = match &self.opacity {
            Opacity::Curve(curve) => curve.value(value),
            &Opacity::Isovalue { value: surface, thickness_mm, opacity } => {
                let off = (T::from_f64(surface) - value).abs();
                let nearness = (T::one() - off / (T::from_f64(thickness_mm) * gradient_per_mm)).max(none);
                let hit = T::select(off.le(none), T::one(), none);
                let steep = T::from_f64(FLAT_PER_MM).le(gradient_per_mm);
                T::from_f64(opacity) * T::select(steep, nearness, hit)
            }
            Opacity::Region(curve) => {
                let steep = T::from_f64(FLAT_PER_MM).le(gradient_per_mm);
                let share = gradient_per_mm * T::from_f64(self.region_scale_mm) * curve.value(value);
                T::select(steep, share.unit(), none)
            }
        };
        let alpha = match &self.gradient {
            Some(factor) => alpha * factor.value(gradient_per_mm),
            None => alpha,
        };
        // NaN is not equal to itself.
        T::select(value.le(value), alpha, none)
    }

    /// Converts an opacity over the unit length to one over a step: 1 − (1 − α)^(step / unit).
    /// The result is exactly α if the step is the unit; opaque stays opaque.
    #[inline(always)]
    pub fn step_corrected<T: Number>(&self, alpha: T, step_mm: T::Scalar) -> T {
        let unit = T::Scalar::from_f64(self.unit_mm);
        if step_mm == unit {
            return alpha;
        }
        // Uses logarithm and exponential of the differences from 1; otherwise small opacities
        // would vanish in the rounding of 1 − α.
        let corrected = -(T::splat(step_mm / unit) * (-alpha).log2_1p()).exp2_m1();
        T::select(T::both(T::zero().lt(alpha), alpha.lt(T::one())), corrected, alpha)
    }

    /// Returns red, green and blue of an intensity, 0 to 1, not multiplied by opacity.
    #[inline(always)]
    pub fn colour<T: Number>(&self, value: T) -> [T; 3] {
        self.colour.at(value)
    }

    /// Returns the brightness of an intensity, 0 to 1; it is the whole colour if
    /// [`Self::is_grey`].
    #[inline(always)]
    pub fn intensity<T: Number>(&self, value: T) -> T {
        self.colour.intensity(value)
    }

    /// Returns the colours.
    pub fn colours(&self) -> &Colour {
        &self.colour
    }

    /// Returns whether every colour is a grey.
    pub fn is_grey(&self) -> bool {
        self.colour.is_grey()
    }

    /// Returns whether the opacity depends on the gradient.
    pub fn uses_gradient(&self) -> bool {
        self.gradient.is_some() || !matches!(self.opacity, Opacity::Curve(_))
    }

    /// Returns the smallest interval of intensities outside of which the opacity is 0, whatever
    /// the gradient; `None` if nothing is visible.
    pub fn visible(&self) -> Option<[f64; 2]> {
        self.visible_below(f64::INFINITY)
    }

    /// Returns the visible interval if no gradient exceeds `gradient_per_mm`: an isosurface is
    /// visible far from its value only where the intensity is steep. Its interval is 1e-6 wider
    /// than the formula's, for the rounding of single precision.
    pub fn visible_below(&self, gradient_per_mm: f64) -> Option<[f64; 2]> {
        let mut steepest = gradient_per_mm;
        if let Some(factor) = &self.gradient {
            let [low, high] = factor.support()?;
            if low >= gradient_per_mm {
                return None;
            }
            steepest = steepest.min(high);
        }
        match &self.opacity {
            Opacity::Curve(curve) => curve.support(),
            &Opacity::Isovalue { value, thickness_mm, opacity } => {
                let reach = if steepest < FLAT_PER_MM { 0.0 } else { thickness_mm * steepest };
                let reach = reach + 1e-6 * (value.abs() + reach);
                (opacity > 0.0).then_some([value - reach, value + reach])
            }
            Opacity::Region(curve) => curve.support().filter(|_| steepest >= FLAT_PER_MM),
        }
    }
}

#[cfg(test)]
mod tests;

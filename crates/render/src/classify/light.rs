//! The light that a shaded voxel returns.
//!
//! Phong's model: the parts are ambient light, evenly scattered light (N·L), and light reflected
//! towards the eye (N·H to a power). This is Blinn's form with H halfway between light and eye.
//! A surface faces the direction of falling intensity, N = −∇f/|∇f|, because bodies are brighter
//! than their surroundings. Flat intensity has no surface, and returns only ambient light.

use glam::DVec3;
use serde::Serialize;

use crate::classify::gradient::FLAT_PER_MM;
use crate::real::{Number, dot};

/// Position of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Source {
    /// At the viewer's eye.
    Headlight,
    /// Infinitely far away in this direction, world frame.
    Fixed(DVec3),
}

/// Decrease of brightness with depth: 1 / (k₁ + k₂ depth), like light in mist.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DepthCue {
    near: f64,
    far: f64,
}

/// The light, and how tissue returns it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    ambient: f64,
    diffuse: f64,
    specular: f64,
    shininess: u32,
    two_sided: bool,
    source: Source,
    depth_cue: Option<DepthCue>,
}

/// The parts in which light is returned, 0 to 1 each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parts {
    /// From all sides.
    pub ambient: f64,
    /// Scattered evenly.
    pub diffuse: f64,
    /// Reflected as a highlight.
    pub specular: f64,
    /// The highlight's exponent.
    pub shininess: u32,
}

/// Reason why light settings are invalid. The message gives the valid range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LightError {
    /// A part of the light.
    #[error("the {part} part of the light must lie between 0 and 1, not {value}")]
    Part {
        /// Name of the part.
        part: &'static str,
        /// Its value.
        value: f64,
    },
    /// The highlight's exponent.
    #[error("the highlight's exponent must be 1 or more, not 0")]
    Shininess,
    /// The light's direction.
    #[error("the direction towards the light must be finite and not zero, not {0}")]
    Direction(DVec3),
    /// The depth cue.
    #[error("brightness must fall from at most 1 near to more than 0 far, not from {near} to {far}")]
    DepthCue {
        /// Brightness at the nearest point.
        near: f64,
        /// Brightness at the farthest.
        far: f64,
    },
}

/// Light sent from a point to the eye: body · its colour + highlight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shade<T> {
    /// Ambient and diffuse light, a factor on the colour.
    pub body: T,
    /// Highlight in the light's own colour, white.
    pub highlight: T,
}

impl<T: Number> Shade<T> {
    /// Returns one channel of the lit colour, at most 1.
    #[inline(always)]
    pub fn lit(self, channel: T) -> T {
        (self.body * channel + self.highlight).unit()
    }
}

impl DepthCue {
    /// Creates a depth cue from the brightness at depth 0 and at depth 1.
    ///
    /// # Errors
    /// [`LightError::DepthCue`] unless 1 ≥ near ≥ far > 0.
    pub fn new(near: f64, far: f64) -> Result<Self, LightError> {
        if 1.0 >= near && near >= far && far > 0.0 {
            Ok(Self { near, far })
        } else {
            Err(LightError::DepthCue { near, far })
        }
    }

    /// Returns the factor on the brightness at `depth`, which is clamped to 0 to 1.
    #[inline(always)]
    pub fn factor<T: Number>(&self, depth: T) -> T {
        let (near, far) = (T::Scalar::from_f64(self.near), T::Scalar::from_f64(self.far));
        // 1 / (1/near + depth (1/far − 1/near)), with one division.
        T::splat(near * far) / (T::splat(far) + depth.unit() * T::splat(near - far))
    }
}

impl Default for Light {
    /// Returns a headlight, mostly scattered, that lights both sides and does not fade.
    fn default() -> Self {
        Self {
            ambient: 0.3,
            diffuse: 0.7,
            specular: 0.2,
            shininess: 16,
            // Fluid in tissue is a dark body: a view from inside it shows the backs of its
            // surfaces.
            two_sided: true,
            source: Source::Headlight,
            depth_cue: None,
        }
    }
}

impl Light {
    /// Returns the same light with these parts, 0 to 1 each; a larger `shininess` makes a
    /// narrower highlight.
    ///
    /// # Errors
    /// [`LightError::Part`], [`LightError::Shininess`].
    pub fn with_parts(self, ambient: f64, diffuse: f64, specular: f64, shininess: u32) -> Result<Self, LightError> {
        for (part, value) in [("ambient", ambient), ("diffuse", diffuse), ("specular", specular)] {
            if !(0.0..=1.0).contains(&value) {
                return Err(LightError::Part { part, value });
            }
        }
        if shininess == 0 {
            return Err(LightError::Shininess);
        }
        Ok(Self { ambient, diffuse, specular, shininess, ..self })
    }

    /// Returns the same light from another position; a direction may have any length.
    ///
    /// # Errors
    /// [`LightError::Direction`].
    pub fn with_source(self, source: Source) -> Result<Self, LightError> {
        let source = match source {
            Source::Headlight => Source::Headlight,
            Source::Fixed(towards) => Source::Fixed(towards.try_normalize().ok_or(LightError::Direction(towards))?),
        };
        Ok(Self { source, ..self })
    }

    /// Returns the same light for both sides of a surface, or only for its front.
    #[must_use]
    pub fn with_two_sided(self, two_sided: bool) -> Self {
        Self { two_sided, ..self }
    }

    /// Returns the same light, with or without fading over depth.
    #[must_use]
    pub fn with_depth_cue(self, depth_cue: Option<DepthCue>) -> Self {
        Self { depth_cue, ..self }
    }

    /// Returns the parts of the light.
    pub fn parts(&self) -> Parts {
        Parts { ambient: self.ambient, diffuse: self.diffuse, specular: self.specular, shininess: self.shininess }
    }

    /// Returns whether light reaches the backs of surfaces.
    pub fn is_two_sided(&self) -> bool {
        self.two_sided
    }

    /// Returns the position of the light; a fixed direction has length 1.
    pub fn source(&self) -> Source {
        self.source
    }

    /// Returns the decrease of brightness with depth.
    pub fn depth_cue(&self) -> Option<DepthCue> {
        self.depth_cue
    }

    /// Returns whether the light sent from a point depends on the eye's position.
    pub fn depends_on_view(&self) -> bool {
        self.specular > 0.0 || self.depth_cue.is_some() || self.diffuse > 0.0 && self.source == Source::Headlight
    }

    /// Returns the unit vectors that [`Self::shade`] needs, world frame: towards the light, and
    /// halfway between it and the unit vector `to_eye`. A light directly behind the point has no
    /// halfway vector; the result is zero, which gives no highlight.
    pub fn directions(&self, to_eye: DVec3) -> (DVec3, DVec3) {
        match self.source {
            Source::Headlight => (to_eye, to_eye),
            Source::Fixed(to_light) => (to_light, (to_light + to_eye).normalize_or_zero()),
        }
    }

    /// Returns the light from a point, given its gradient (grey levels per mm along orthonormal
    /// axes). The unit vectors towards the light and [halfway](Self::directions) to the eye use
    /// the same axes.
    ///
    /// The result is never NaN. A gradient below [`FLAT_PER_MM`], or one whose length overflows,
    /// has no direction and returns only ambient light.
    #[inline(always)]
    pub fn shade<T: Number>(&self, gradient: [T; 3], to_light: [T::Scalar; 3], halfway: [T::Scalar; 3]) -> Shade<T> {
        let (ambient, none) = (T::from_f64(self.ambient), T::zero());
        let length = dot(gradient, gradient).sqrt();
        let inverse = T::one() / length;
        let facing = self.cosine(gradient, inverse, to_light);
        // The inverse of an infinite or NaN length is not above 0.
        let lit = T::both(T::both(T::from_f64(FLAT_PER_MM).le(length), none.lt(inverse)), none.lt(facing));
        let highlight = self.cosine(gradient, inverse, halfway).power(self.shininess);
        Shade {
            body: T::select(lit, ambient + T::from_f64(self.diffuse) * facing, ambient),
            highlight: T::select(lit, T::from_f64(self.specular) * highlight, none),
        }
    }

    /// Returns the cosine of the angle between a direction and the surface's normal, at least 0.
    #[inline(always)]
    fn cosine<T: Number>(&self, gradient: [T; 3], inverse_length: T, direction: [T::Scalar; 3]) -> T {
        let [x, y, z] = direction;
        let cosine = -dot(gradient, [T::splat(x), T::splat(y), T::splat(z)]) * inverse_length;
        // Rounding can leave more than 1, and the power would amplify the excess.
        (if self.two_sided { cosine.abs() } else { cosine }).unit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: [f64; 3] = [1.0, 0.0, 0.0];
    const Y: [f64; 3] = [0.0, 1.0, 0.0];
    const DARK: Shade<f64> = Shade { body: 0.3, highlight: 0.0 };

    fn light() -> Light {
        Light::default().with_parts(0.3, 0.5, 0.2, 3).unwrap()
    }

    #[test]
    fn tilted_surface_follows_phong_model() {
        // The surface faces +x; the light is at 60° to it, the halfway vector at 30°.
        let (to_light, halfway) = ([0.5, 0.75_f64.sqrt(), 0.0], [0.75_f64.sqrt(), 0.5, 0.0]);
        let shade = light().shade([-7.0, 0.0, 0.0], to_light, halfway);
        assert!((shade.body - (0.3 + 0.5 * 0.5)).abs() < 1e-15);
        assert!((shade.highlight - 0.2 * 0.75_f64.powf(1.5)).abs() < 1e-15);
        assert!((shade.lit(0.5) - (0.55 * 0.5 + shade.highlight)).abs() < 1e-15);
        assert_eq!(Shade { body: 0.9, highlight: 0.3 }.lit(1.0), 1.0);
    }

    #[test]
    fn only_two_sided_light_reaches_the_back() {
        let (front, back) = ([-3.0, 0.0, 0.0], [3.0, 0.0, 0.0]);
        let one = light().with_two_sided(false);
        let two = light().with_two_sided(true);
        let full = Shade { body: 0.8, highlight: 0.2 };
        assert_eq!(one.shade(front, X, X), full);
        assert_eq!(one.shade(back, X, X), DARK);
        assert_eq!(two.shade(front, X, X), full);
        assert_eq!(two.shade(back, X, X), full);
        assert_eq!(two.shade(front, Y, X), DARK, "no highlight where no light falls");
    }

    #[test]
    fn gradient_without_direction_gives_ambient_light() {
        let tiny = 0.5 * FLAT_PER_MM;
        for gradient in [[0.0; 3], [tiny, 0.0, 0.0], [f64::NAN, 0.0, 0.0], [f64::INFINITY, 1.0, 0.0], [1e200, 0.0, 0.0]]
        {
            assert_eq!(light().shade(gradient, X, X), DARK, "{gradient:?}");
        }
        assert_eq!(light().shade([1e30_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).body, 0.3);
        assert!(light().shade([1e15_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).body > 0.79);
        // No halfway vector: diffuse light, but no highlight.
        assert_eq!(light().shade([-1.0, 0.0, 0.0], X, [0.0; 3]).highlight, 0.0);
    }

    #[test]
    fn single_precision_light_stays_within_bound() {
        let light = Light::default();
        let mut worst = 0.0_f64;
        for i in 0..2000_u16 {
            let wave = |k: f64| libm::sin(f64::from(i) * k);
            let unit = |v: DVec3| v.normalize().to_array();
            let gradient = DVec3::new(wave(0.37), wave(1.13), wave(2.71)) * 40.0;
            let to_light = unit(DVec3::new(wave(0.11), wave(0.53), 1.1));
            let halfway = unit(DVec3::new(wave(0.29), 1.2, wave(0.71)));
            let gradient = gradient.to_array();
            let reference = light.shade(gradient, to_light, halfway);
            let single = |v: [f64; 3]| v.map(|x| x as f32);
            let shade = light.shade(single(gradient), single(to_light), single(halfway));
            assert!((0.3..=1.0).contains(&reference.body) && (0.0..=0.2).contains(&reference.highlight));
            worst = worst.max((f64::from(shade.body) - reference.body).abs());
            worst = worst.max((f64::from(shade.highlight) - reference.highlight).abs());
        }
        assert!(worst < 2e-6, "{worst}");
    }

    #[test]
    fn headlight_follows_eye_and_fixed_light_stays() {
        let eye = DVec3::new(0.0, 0.6, 0.8);
        assert_eq!(Light::default().directions(eye), (eye, eye));
        let fixed = Light::default().with_source(Source::Fixed(DVec3::new(0.0, 0.0, 5.0))).unwrap();
        let (to_light, halfway) = fixed.directions(DVec3::Y);
        assert_eq!(to_light, DVec3::Z);
        assert!((halfway - DVec3::new(0.0, 0.5, 0.5).normalize()).length() < 1e-15);
        assert_eq!(fixed.directions(-DVec3::Z).1, DVec3::ZERO);
    }

    #[test]
    fn depth_cue_falls_from_near_to_far() {
        let cue = DepthCue::new(0.9, 0.3).unwrap();
        assert!((cue.factor(0.0_f64) - 0.9).abs() < 1e-15);
        assert!((cue.factor(1.0_f64) - 0.3).abs() < 1e-15);
        assert!((cue.factor(0.25_f64) - 1.0 / (1.0 / 0.9 + 0.25 * (1.0 / 0.3 - 1.0 / 0.9))).abs() < 1e-15);
        assert_eq!(cue.factor(-3.0_f32), cue.factor(0.0_f32));
        assert_eq!(cue.factor(7.0_f32), cue.factor(1.0_f32));
        assert_eq!(DepthCue::new(1.0, 1.0).unwrap().factor(0.37_f64), 1.0);
    }

    #[test]
    fn invalid_light_is_refused() {
        let refusal = |made: Result<Light, LightError>| made.unwrap_err().to_string();
        assert_eq!(
            refusal(Light::default().with_parts(0.1, 1.5, 0.0, 1)),
            "the diffuse part of the light must lie between 0 and 1, not 1.5"
        );
        assert!(refusal(Light::default().with_parts(f64::NAN, 0.5, 0.0, 1)).contains("ambient"));
        assert!(refusal(Light::default().with_parts(0.1, 0.5, 0.0, 0)).contains("1 or more"));
        for direction in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert!(refusal(Light::default().with_source(Source::Fixed(direction))).contains("not zero"));
        }
        for (near, far) in [(0.5, 0.6), (1.1, 0.5), (1.0, 0.0), (f64::NAN, 0.5), (1.0, f64::NAN)] {
            assert!(DepthCue::new(near, far).unwrap_err().to_string().starts_with("brightness must fall"));
        }
    }
}

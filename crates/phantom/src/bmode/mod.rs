//! B-mode: simulates the image that an ultrasound scanner shows of a [`Body`](super::Body).
//!
//! Echoes are summed in the scanner's own raster, beams by ranges, and converted to an image
//! last, as in a scanner:
//!
//! 1. Each cell of a lattice fixed in the body holds one scatterer. Its position in the cell
//!    and its complex amplitude come from a hash of the cell's number. Scatterers within the
//!    slice's thickness are added to the raster, weighted by their distance from the slice's
//!    plane: see [`scatter`].
//! 2. Each beam is followed through the body, exactly, as its solids are convex. Losses in
//!    materials and at surfaces attenuate everything behind. Surfaces and wires return echoes
//!    that depend on the angle. Strong echoes reverberate between surface and transducer: see
//!    [`beam`] and [`echo`].
//! 3. The raster is blurred across the beams by their width at each depth, and along them by
//!    the pulse: see [`spread`].
//! 4. The amplitude is amplified with depth, receives the receiver's noise, is compressed to
//!    decibels and converted to the image's pixels: see [`display`].
//!
//! Sound travels along straight lines at one speed, and phases belong to the scatterers: a
//! moved slice shows the same speckle moved. Speckle at a distance δ across the slice is
//! correlated by exp(−δ²/4σ²) in amplitude, σ the beam's own across the slice. There is no
//! refraction and there are no side lobes.
//!
//! One seed determines every bit: cells are summed in a fixed order, elementary functions are
//! this module's own, and no operations are fused.

use super::PhantomError;

pub mod beam;
pub mod display;
pub mod echo;
mod hash;
pub mod layout;
pub mod painter;
mod raster;
mod real;
pub mod scatter;
pub mod spread;
#[cfg(test)]
mod tests;
mod transducer;

pub use layout::Layout;
pub use painter::{BMode, Workspace};
use transducer::MARGIN;
pub use transducer::Transducer;

/// Speed of sound that scanners assume, mm/µs.
pub const SPEED_OF_SOUND: f64 = 1.54;

/// Mean echo of the reference tissue below that of a perfect mirror, dB.
pub(super) const REFERENCE_DB: f64 = 50.0;

/// A beam's width over depth: a Gaussian whose σ is that of its focus times √(1 + ((depth −
/// focus)/length)²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Depth of the focus, mm.
    pub focus_mm: f64,
    /// Aperture, mm: at the focus the full width at half maximum is 1.2 λ·focus/aperture.
    pub aperture_mm: f64,
    /// Distance from the focus at which the beam is √2 as wide, mm.
    pub length_mm: f64,
}

impl Beam {
    /// Returns σ of the amplitude at a depth, mm, for a wavelength in mm.
    pub fn sigma_mm(&self, depth_mm: f64, wavelength_mm: f64) -> f64 {
        let off = (depth_mm - self.focus_mm) / self.length_mm;
        self.focal_sigma_mm(wavelength_mm) * (1.0 + off * off).sqrt()
    }

    /// Returns σ of the amplitude at the focus, mm.
    pub fn focal_sigma_mm(&self, wavelength_mm: f64) -> f64 {
        1.2 * wavelength_mm * self.focus_mm / self.aperture_mm / FWHM_PER_SIGMA
    }
}

/// √(8 ln 2).
pub(super) const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949_3;

/// The simulated effects. All are on by default; each can be switched off to view or test the
/// others alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effects {
    /// Echoes of scatterers: speckle.
    pub speckle: bool,
    /// Echoes of surfaces.
    pub surfaces: bool,
    /// Echoes of wires.
    pub wires: bool,
    /// Attenuation in materials. Without it and `losses` there is no shadow.
    pub attenuation: bool,
    /// Losses at surfaces by reflection.
    pub losses: bool,
    /// Reverberation between transducer and surface, and behind wires.
    pub reverberation: bool,
    /// The transducer's own ringing at its face.
    pub ringing: bool,
    /// Widening of the beams off their focus; without it their width is that of the focus
    /// everywhere.
    pub focusing: bool,
    /// Amplification with depth.
    pub tgc: bool,
    /// The receiver's noise.
    pub noise: bool,
}

impl Effects {
    /// All effects.
    pub const ALL: Self = Self::each(true);
    /// No effects.
    pub const NONE: Self = Self::each(false);

    const fn each(on: bool) -> Self {
        Self {
            speckle: on,
            surfaces: on,
            wires: on,
            attenuation: on,
            losses: on,
            reverberation: on,
            ringing: on,
            focusing: on,
            tgc: on,
            noise: on,
        }
    }
}

/// A scanner and its settings. Levels are in dB of amplitude above the mean echo of the
/// reference tissue at the transducer's face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scanner {
    /// The transducer's shape.
    pub transducer: Transducer,
    /// Depth of the image, mm.
    pub depth_mm: f64,
    /// Number of beams.
    pub beams: u32,
    /// Centre frequency, MHz.
    pub frequency_mhz: f64,
    /// Length of the pulse, periods. The echo's width along the beam, at half maximum, is half
    /// of that in wavelengths.
    pub cycles: f64,
    /// The beam within the slice.
    pub lateral: Beam,
    /// The beam across the slice: its thickness.
    pub elevation: Beam,
    /// Distance of scatterers, mm. Speckle is fully developed with some ten in each resolution
    /// cell. With eight, its ratio of mean to standard deviation is within a twentieth of
    /// Rayleigh's 1.91.
    pub scatterer_pitch_mm: f64,
    /// Round-trip amplification with depth, dB/cm. It is partial by intent: deep tissue is
    /// darker.
    pub tgc_db_per_cm: f64,
    /// Upper limit of the amplification, dB.
    pub tgc_most_db: f64,
    /// The receiver's noise before amplification, dB.
    pub noise_db: f64,
    /// Part of an echo's amplitude that the transducer's face reflects back into the body.
    pub face_reflection: f64,
    /// Number of reverberations of an echo.
    pub reverberations: u32,
    /// The transducer's ringing at its face, dB.
    pub ringing_db: f64,
    /// Decay of the ringing, dB/mm.
    pub ringing_db_per_mm: f64,
    /// The echo, after amplification, that is displayed white, dB.
    pub white_db: f64,
    /// Range from white to black, dB.
    pub dynamic_range_db: f64,
    /// The simulated effects.
    pub effects: Effects,
    /// Seed of the scatterers, of the surfaces' unevenness and of the noise.
    pub seed: u64,
}

impl Scanner {
    /// Returns an abdominal scanner: a curvilinear transducer of 60 mm radius and 60° at 3.5
    /// MHz.
    pub fn abdominal(depth_mm: f64) -> Self {
        Self {
            transducer: Transducer::Curvilinear { radius_mm: 60.0, opening_deg: 60.0 },
            depth_mm,
            beams: 256,
            frequency_mhz: 3.5,
            cycles: 3.0,
            lateral: Beam { focus_mm: 0.5 * depth_mm, aperture_mm: 20.0, length_mm: 40.0 },
            elevation: Beam { focus_mm: 60.0, aperture_mm: 14.0, length_mm: 55.0 },
            scatterer_pitch_mm: 0.7,
            tgc_db_per_cm: 3.2,
            tgc_most_db: 45.0,
            noise_db: -62.0,
            face_reflection: 0.25,
            reverberations: 3,
            ringing_db: 34.0,
            ringing_db_per_mm: 12.0,
            white_db: DEFAULT_WHITE_DB,
            dynamic_range_db: DEFAULT_DYNAMIC_RANGE_DB,
            effects: Effects::ALL,
            seed: 1,
        }
    }

    /// Returns a small-parts scanner: a linear transducer of 38 mm at 7.5 MHz.
    pub fn small_parts(depth_mm: f64) -> Self {
        Self {
            transducer: Transducer::Linear { width_mm: 38.0 },
            depth_mm,
            beams: 192,
            frequency_mhz: 7.5,
            lateral: Beam { focus_mm: 0.5 * depth_mm, aperture_mm: 0.25 * depth_mm, length_mm: 0.35 * depth_mm },
            elevation: Beam { focus_mm: 0.5 * depth_mm, aperture_mm: 0.1 * depth_mm, length_mm: 0.5 * depth_mm },
            scatterer_pitch_mm: 0.28,
            tgc_db_per_cm: 6.5,
            ringing_db_per_mm: 22.0,
            ..Self::abdominal(depth_mm)
        }
    }

    /// Sets the scanner for a tank: hardly any amplification, as water hardly attenuates.
    pub fn in_water(self) -> Self {
        Self { tgc_db_per_cm: 0.8, ..self }
    }

    /// Returns the wavelength, mm.
    pub fn wavelength_mm(&self) -> f64 {
        SPEED_OF_SOUND / self.frequency_mhz
    }

    /// Returns σ of an echo's amplitude along the beam, mm.
    pub fn axial_sigma_mm(&self) -> f64 {
        0.5 * self.cycles * self.wavelength_mm() / FWHM_PER_SIGMA
    }

    /// Returns σ of an echo's amplitude across the beam within the slice, mm.
    pub fn lateral_sigma_mm(&self, depth_mm: f64) -> f64 {
        self.sigma(&self.lateral, depth_mm)
    }

    /// Returns σ of the slice's thickness, in amplitude, mm.
    pub fn elevation_sigma_mm(&self, depth_mm: f64) -> f64 {
        self.sigma(&self.elevation, depth_mm)
    }

    fn sigma(&self, beam: &Beam, depth_mm: f64) -> f64 {
        let depth_mm = if self.effects.focusing { depth_mm } else { beam.focus_mm };
        beam.sigma_mm(depth_mm, self.wavelength_mm())
    }

    /// Returns the amplification at a depth, dB.
    pub fn tgc_db(&self, depth_mm: f64) -> f64 {
        if self.effects.tgc { (0.1 * depth_mm * self.tgc_db_per_cm).clamp(0.0, self.tgc_most_db) } else { 0.0 }
    }

    /// Returns the grey level of an echo, dB after amplification, neither rounded nor clipped.
    pub fn grey(&self, db: f64) -> f64 {
        255.0 * (1.0 + (db - self.white_db) / self.dynamic_range_db)
    }

    /// Returns the pixel spacing at which the whole field fits an image, mm.
    pub fn pixel_mm(&self, image_size: [u32; 2]) -> f64 {
        let [width, height] = image_size.map(f64::from);
        let [wide, high] = self.transducer.extent_mm(self.depth_mm);
        // Rounded up to whole micrometres: a number that is easy to write.
        let pixel = (wide / (0.98 * width)).max(high / ((1.0 - 2.0 * MARGIN) * height));
        (pixel * 1e3).ceil() * 1e-3
    }

    /// Checks the scanner's numbers.
    ///
    /// # Errors
    /// [`PhantomError::Scanner`] names the number.
    pub fn check(&self) -> Result<(), PhantomError> {
        let refuse = |what, value, low, high| Err(PhantomError::Scanner { what, value, low, high });
        let (face, angle) = match self.transducer {
            Transducer::Curvilinear { radius_mm, opening_deg } => (radius_mm, opening_deg),
            Transducer::Linear { width_mm } => (width_mm, 60.0),
        };
        for (what, value, low, high) in [
            ("the transducer's radius or width, mm,", face, 1.0, 500.0),
            ("the transducer's opening, degrees,", angle, 1.0, 90.0),
            ("the depth, mm,", self.depth_mm, 1.0, 400.0),
            ("the frequency, MHz,", self.frequency_mhz, 0.5, 30.0),
            ("the pulse's length, periods,", self.cycles, 0.5, 20.0),
            ("the number of beams", f64::from(self.beams), 2.0, 2048.0),
            ("the focus' depth, mm,", self.lateral.focus_mm, 0.1, 1e3),
            ("the aperture, mm,", self.lateral.aperture_mm, 0.1, 1e3),
            ("the focus' length, mm,", self.lateral.length_mm, 0.1, 1e6),
            ("the depth of the focus across the slice, mm,", self.elevation.focus_mm, 0.1, 1e3),
            ("the aperture across the slice, mm,", self.elevation.aperture_mm, 0.1, 1e3),
            ("the length of the focus across the slice, mm,", self.elevation.length_mm, 0.1, 1e6),
            ("the scatterers' distance, mm,", self.scatterer_pitch_mm, 0.05, 10.0),
            ("the amplification with depth, dB/cm,", self.tgc_db_per_cm, 0.0, 100.0),
            ("the most amplification, dB,", self.tgc_most_db, 0.0, 120.0),
            ("the noise, dB,", self.noise_db, -300.0, 60.0),
            ("the part that the transducer's face sends back", self.face_reflection, 0.0, 1.0),
            ("the number of reverberations", f64::from(self.reverberations), 0.0, 20.0),
            ("the ringing, dB,", self.ringing_db, -300.0, 120.0),
            ("the ringing's decay, dB/mm,", self.ringing_db_per_mm, 0.1, 1e3),
            ("the white level, dB,", self.white_db, -100.0, 150.0),
            ("the dynamic range, dB,", self.dynamic_range_db, 1.0, 200.0),
        ] {
            // NaN is in no range.
            if !(low..=high).contains(&value) {
                return refuse(what, value, low, high);
            }
        }
        Ok(())
    }
}

/// White level of these scanners, dB.
const DEFAULT_WHITE_DB: f64 = 26.0;
/// Dynamic range of these scanners, dB.
const DEFAULT_DYNAMIC_RANGE_DB: f64 = 60.0;

/// Returns the grey level of an echo, dB, under the default display.
pub(super) fn default_grey(db: f64) -> f64 {
    (255.0 * (1.0 + (db - DEFAULT_WHITE_DB) / DEFAULT_DYNAMIC_RANGE_DB)).clamp(0.0, 255.0)
}

//! Acoustic properties of materials.
//!
//! Attenuations and impedances are those of the textbooks' tables for body temperature (Szabo,
//! "Diagnostic ultrasound imaging", appendix B; Duck, "Physical properties of tissues"),
//! rounded; echo levels are relative to muscle.

use glam::DVec3;

/// Tissue fibres that scatter more than the tissue between them, in layers across one
/// direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fibres {
    /// Unit vector across the layers, in the body.
    pub across: DVec3,
    /// Mean distance of layers, mm.
    pub spacing_mm: f64,
    /// Excess scattering of the layers over the mean, amplitude; 0 for none.
    pub contrast: f64,
}

/// A material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Its name.
    pub name: &'static str,
    /// Mean echo power of its scatterers, dB above that of the reference tissue; `None` without
    /// scatterers.
    pub backscatter_db: Option<f64>,
    /// Attenuation, one way, dB per cm and MHz.
    pub attenuation: f64,
    /// Acoustic impedance, MRayl: density times speed of sound.
    pub impedance: f64,
    /// Standard deviation of the slopes of its surface, degrees: the angular width of its
    /// reflection.
    pub lobe_deg: f64,
    /// Amplitude reflected at any angle, as part of that reflected at the normal.
    pub diffuse: f64,
    /// Unevenness of the surface's echo: 0 like a mirror's, 1 like speckle.
    pub roughness: f64,
    /// Its texture.
    pub fibres: Option<Fibres>,
}

impl Material {
    /// Water: no echo, hardly any attenuation.
    pub fn water(name: &'static str) -> Self {
        Self {
            name,
            backscatter_db: None,
            attenuation: 0.002,
            impedance: 1.48,
            lobe_deg: 12.0,
            diffuse: 0.05,
            roughness: 0.3,
            fibres: None,
        }
    }

    /// Muscle with fibres in layers across a direction.
    pub fn muscle(name: &'static str, across: DVec3) -> Self {
        let fibres = Fibres { across: across.normalize_or_zero(), spacing_mm: 2.8, contrast: 2.2 };
        Self {
            backscatter_db: Some(-6.0),
            attenuation: 0.6,
            impedance: 1.70,
            lobe_deg: 18.0,
            roughness: 0.8,
            fibres: Some(fibres),
            ..Self::water(name)
        }
    }

    /// Fat under the skin.
    pub fn fat(name: &'static str) -> Self {
        let fibres = Fibres { across: DVec3::Y, spacing_mm: 3.4, contrast: 1.5 };
        Self {
            backscatter_db: Some(-9.0),
            attenuation: 0.5,
            impedance: 1.38,
            lobe_deg: 20.0,
            roughness: 0.75,
            fibres: Some(fibres),
            ..Self::water(name)
        }
    }

    /// Skin, vessel walls, tendon: dense and bright.
    pub fn dense(name: &'static str, backscatter_db: f64) -> Self {
        Self {
            backscatter_db: Some(backscatter_db),
            attenuation: 0.9,
            impedance: 1.75,
            lobe_deg: 22.0,
            diffuse: 0.1,
            roughness: 0.7,
            ..Self::water(name)
        }
    }

    /// Blood: hardly any echo.
    pub fn blood(name: &'static str) -> Self {
        Self { backscatter_db: Some(-32.0), attenuation: 0.15, impedance: 1.66, ..Self::water(name) }
    }

    /// Compact bone: a bright surface with a complete shadow.
    pub fn bone(name: &'static str) -> Self {
        Self {
            backscatter_db: Some(-2.0),
            attenuation: 10.0,
            impedance: 6.0,
            lobe_deg: 25.0,
            diffuse: 0.04,
            roughness: 0.45,
            ..Self::water(name)
        }
    }

    /// Soft rubber or vinyl: scatters a little, attenuates strongly.
    pub fn rubber(name: &'static str) -> Self {
        Self {
            backscatter_db: Some(1.0),
            attenuation: 2.0,
            impedance: 1.9,
            lobe_deg: 24.0,
            diffuse: 0.12,
            roughness: 0.5,
            ..Self::water(name)
        }
    }

    /// Acrylic: a tank's floor, clear inside.
    pub fn acrylic(name: &'static str) -> Self {
        Self {
            backscatter_db: None,
            attenuation: 1.2,
            impedance: 3.2,
            lobe_deg: 10.0,
            diffuse: 0.02,
            roughness: 0.35,
            ..Self::water(name)
        }
    }

    /// Steel: reflects nearly everything.
    pub fn steel(name: &'static str) -> Self {
        Self {
            backscatter_db: None,
            attenuation: 20.0,
            impedance: 45.0,
            diffuse: 0.05,
            roughness: 0.2,
            ..Self::water(name)
        }
    }

    /// Returns the amplitude reflected by a surface between this and another material at the
    /// normal: −1 to 1.
    pub fn reflection(&self, behind: &Self) -> f64 {
        (behind.impedance - self.impedance) / (behind.impedance + self.impedance)
    }
}

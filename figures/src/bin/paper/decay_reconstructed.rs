//! The slices of [`decay`](crate::decay), inserted by the reconstructor: upright on a line along
//! z, with σ = 1 mm and one grey level per frame.

use std::error::Error;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use reconstruct::kernel::Method;
use reconstruct::{Compounding, Decay, Reconstructor, Settings};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};

use crate::decay::{Rule, Sample, mean_shift, ramp};
use crate::reconstructed_volumes::value;

/// Pixels along u and v, and their spacing: the kernel around the middle lies on data.
const PIXELS: u32 = 16;
const PIXEL_MM: f64 = 0.25;

/// Returns the reconstructor's setting for a rule.
pub(crate) fn compounding(rule: Rule) -> Compounding {
    match rule {
        Rule::None => Compounding::Mean,
        Rule::Exponential { rate } => Compounding::Decay(Decay::Exponential { rate_per_s: rate }),
        Rule::DeadTime { rate, wait } => Compounding::Decay(Decay::DeadTime { rate_per_s: rate, wait_s: wait }),
        Rule::Printed { rate, wait } => Compounding::Decay(Decay::PaperLiteral { rate_per_s: rate, wait_s: wait }),
    }
}

/// The reconstructor's voxels on the line through the frames' middles.
pub(crate) struct ReconstructedLine {
    reconstructor: Reconstructor,
    count: usize,
    inserted: u32,
}

impl ReconstructedLine {
    /// Returns a line of at least two voxels at equal distances.
    pub(crate) fn new(at: &[f64], rule: Rule) -> Result<Self, Box<dyn Error>> {
        let [first, second, ..] = at else { return Err("a line has two voxels and more".into()) };
        let settings = Settings {
            method: Method::GaussianTruncated,
            compounding: compounding(rule),
            sigma_mm: [None, None, Some(1.0)],
            lattice_origin_mm: DVec3::new(0.0, 0.0, *first),
            ..Settings::new(DVec3::new(0.5, 0.5, second - first))
        };
        let reconstructor = Reconstructor::new(settings, Mask::full(PIXELS, PIXELS))?;
        Ok(Self { reconstructor, count: at.len(), inserted: 0 })
    }

    pub(crate) fn insert(&mut self, sample: Sample) -> Result<(), Box<dyn Error>> {
        // A tiny shift, since the reconstructor accepts only one of two identical slices.
        let hair = 1e-12 * f64::from(self.inserted);
        self.inserted += 1;
        let corner = -0.5 * PIXEL_MM * f64::from(PIXELS - 1);
        let grey = vec![sample.value as f32; (PIXELS * PIXELS) as usize];
        self.reconstructor.insert(&Slice {
            image: Image::new(PIXELS, PIXELS, Pixels::F32(Arc::from(grey))),
            time_ns: (sample.time * 1e9).round() as i64,
            world_from_image: Transform::from_affine(DAffine3 {
                matrix3: DMat3::from_diagonal(DVec3::new(PIXEL_MM, PIXEL_MM, 1.0)),
                translation: DVec3::new(corner, corner, sample.at + hair),
            }),
        })?;
        Ok(())
    }

    /// Returns the weighted mean at each voxel; `None` without weight.
    pub(crate) fn values(&self) -> Vec<Option<f64>> {
        (0..self.count as i64).map(|z| value(self.reconstructor.volume(), [0, 0, z])).collect()
    }
}

/// Returns [`crate::decay::shift`] of the reconstructor.
pub(crate) fn shift(rule: Rule) -> Result<f64, Box<dyn Error>> {
    let (voxels, samples) = ramp();
    let mut line = ReconstructedLine::new(&voxels, rule)?;
    for sample in samples {
        line.insert(sample)?;
    }
    Ok(mean_shift(&voxels, &line.values()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decay::{self, kernel, long_wait};

    #[test]
    fn reconstructor_shifts_match_the_equations() {
        let kernel = kernel().unwrap();
        let wait = long_wait(&kernel);
        for rule in [
            Rule::None,
            Rule::Exponential { rate: 3.0 },
            Rule::DeadTime { rate: 30.0, wait },
            Rule::Printed { rate: 3.0, wait: 0.0 },
            Rule::Printed { rate: 3.0, wait },
        ] {
            let (reconstructed, model) = (shift(rule).unwrap(), decay::shift(rule, kernel));
            assert!((reconstructed - model).abs() < 0.01, "{rule:?}: {reconstructed} where the equations have {model}");
        }
    }
}

//! Standard errors of a volume's voxels, as a file of the volume's grid.

use std::path::Path;

use calibration::tracker::noise::TrackerNoise;
use config::Settings as Config;
use config::bedside::probe_from_image;
use export::volume::{DenseBox, Encoding, Scalar, write_values};
use pipeline::{Outcome, PoseNoise};
use reconstruct::standard_error::Summary;
use reconstruct::{Compounding, Settings, StandardErrors};
use statistics::ErrorNumbers;
use volume::dense::RANGE_FIELD;

use super::filling::advised;
use crate::failure::Failure;

/// Refuses, before the work, standard errors of anything but a mean.
///
/// # Errors
/// [`Failure`] with the flag to change.
pub(crate) fn check(is_asked: bool, settings: &Settings) -> Result<(), Failure> {
    let compounding = settings.compounding;
    if is_asked && compounding != Compounding::Mean {
        fail_usage!(
            "--error: a standard error is that of a mean; leave it out, or choose the compounding mean instead of {}",
            compounding.name()
        );
    }
    Ok(())
}

/// Returns the noise of the tracker's poses for a calibration, if both are known.
pub(crate) fn pose_noise(noise: Option<TrackerNoise>, calibration: &Config) -> Option<PoseNoise> {
    let TrackerNoise { position_mm, rotation_deg } = noise?;
    Some(PoseNoise { position_mm, rotation_deg, probe_from_image: probe_from_image(calibration)? })
}

/// Standard errors that are to be written to a file.
pub(crate) struct ErrorFile<'a> {
    path: &'a Path,
    errors: StandardErrors<'a>,
    numbers: ErrorNumbers,
}

impl<'a> ErrorFile<'a> {
    /// Prepares the file, before anything is written.
    ///
    /// # Errors
    /// [`Failure`] if the volume keeps no sums for it, or no voxel was reached by two slices.
    pub(crate) fn new(path: &'a Path, outcome: &'a Outcome) -> Result<Self, Failure> {
        if outcome.reconstructor.keeping_errors().is_none() {
            fail_usage!(
                "{}: the volume keeps no sums for standard errors; ask for them when it is reconstructed",
                path.display()
            );
        }
        let pose_mm = outcome.pose_error_mm;
        let errors = outcome.reconstructor.standard_errors(pose_mm.unwrap_or(0.0));
        let found = errors.and_then(|errors| errors.summary().map(|summary| (errors, summary)));
        let Some((errors, Summary { median, p95, slices })) = found else {
            fail!(
                "{}: no voxel was reached by two slices, whose spread would tell the noise; give a wider kernel \
                 (--sigma), or leave --error out",
                path.display()
            );
        };
        let numbers = ErrorNumbers { noise: errors.noise(), pose_mm, median, p95, slices };
        Ok(Self { path, errors, numbers })
    }

    /// Returns the encoding of the values.
    pub(crate) fn encoding() -> Encoding {
        Encoding { scalar: Scalar::F32, window: None, unseen: -1.0 }
    }

    /// Writes the standard errors of a box of voxels, and returns their numbers. `fields` are those
    /// of a file with that encoding.
    ///
    /// # Errors
    /// [`Failure`] if the file cannot be written.
    pub(crate) fn write(self, space: &DenseBox, mut fields: Vec<(String, String)>) -> Result<ErrorNumbers, Failure> {
        let Self { path, errors, numbers } = self;
        let poses =
            numbers.pose_mm.map_or_else(|| "of poses not known".to_owned(), |mm| format!("of poses {mm:.3} mm"));
        let text = format!("of sampling and noise: a slice {:.4}; {poses}", numbers.noise);
        fields.push(("SonoweaveStandardError".into(), text));
        // A picture of the file shows its usual values between black and white.
        if let Some((_, range)) = fields.iter_mut().find(|(key, _)| key == RANGE_FIELD) {
            *range = format!("0 {}", 1.5 * numbers.p95);
        }
        write_values(&errors, space, path, &Self::encoding(), &fields).map_err(advised)?;
        Ok(numbers)
    }
}

/// Describes the standard errors, in a line.
pub(crate) fn sentence(path: &Path, errors: &ErrorNumbers) -> String {
    let ErrorNumbers { noise, pose_mm, median, p95, slices } = errors;
    let poses = pose_mm.map_or_else(|| "that of poses is not known".to_owned(), |mm| format!("of poses {mm:.2} mm"));
    format!(
        "standard errors: {}, {median:.2} grey levels (median; p95 {p95:.2}) from {slices:.1} slices a voxel, each with \
         noise of {noise:.2}; {poses}",
        path.display()
    )
}

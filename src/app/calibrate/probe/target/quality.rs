//! Quality of a calibration by a point, a stylus or a plane.

use glam::DVec2;

use calibration::file::preset::Quality;
use calibration::probe::target::Calibration;

use super::super::quality;

/// Returns the predicted error at the image's centre, and at its worst corner: one standard
/// deviation, mm.
pub(crate) fn ends(found: &Calibration) -> [f64; 2] {
    quality::ends(found.size_px, |px: DVec2| found.refined.predicted_mm(px))
}

/// Returns the quality numbers that a preset keeps.
pub(crate) fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = ends(found);
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: [found.errors.mean, found.errors.sd],
        validation_error_mm: found.validation.as_ref().map(|errors| [errors.mean, errors.sd]),
        centre_mm,
        corner_mm,
    }
}

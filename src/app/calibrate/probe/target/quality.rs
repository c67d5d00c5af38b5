//! Quality of a calibration by a point, a stylus or a plane.

use glam::DVec2;

use calibration::file::record::Quality;
use calibration::probe::target::Calibration;
use calibration::probe::target::refine::Scatter;
use calibration::tracker::noise::TrackerNoise;

use super::super::quality;

/// Returns the predicted error at the image's centre, and at its worst corner: one standard
/// deviation, mm.
pub(crate) fn ends(found: &Calibration) -> [f64; 2] {
    quality::ends(found.size_px, |px: DVec2| found.refined.predicted_mm(px))
}

/// Returns the quality numbers that the file keeps.
pub(crate) fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = ends(found);
    let (position_mm, turn_rad) = match found.refined.scatter {
        // The scatter along u and v contains that of the dot: the sensors have the smaller at most.
        Scatter::Point { turn_rad, along_mm: [u, v, _] } => (u.min(v), turn_rad),
        Scatter::Plane { turn_rad, position_mm, .. } => (position_mm, turn_rad),
    };
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: [found.errors.mean, found.errors.sd],
        validation_error_mm: found.validation.as_ref().map(|errors| [errors.mean, errors.sd]),
        centre_mm,
        corner_mm,
        sensors: Some(TrackerNoise { position_mm, rotation_deg: turn_rad.to_degrees() }),
    }
}

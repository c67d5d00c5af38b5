//! Quality of a calibration by an N-wire phantom.

use glam::DVec2;

use calibration::file::record::Quality;
use calibration::probe::Calibration;
use calibration::probe::errors::Errors;
use calibration::tracker::noise::TrackerNoise;

/// Returns the predicted error at the image's centre, and at its worst corner: one standard
/// deviation, mm.
pub(crate) fn predicted_ends(found: &Calibration) -> [f64; 2] {
    ends(found.size_px, |px| found.refined.predicted_mm(px))
}

/// Returns a function's value at the image's centre, and its largest at the corners.
pub(crate) fn ends(size_px: [u32; 2], of: impl Fn(DVec2) -> f64) -> [f64; 2] {
    let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
    let corners = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(|px| of(DVec2::from_array(px)));
    [of(DVec2::new(0.5 * u, 0.5 * v)), corners.into_iter().fold(0.0, f64::max)]
}

/// Returns the quality numbers that the file keeps.
pub(crate) fn quality(found: &Calibration) -> Quality {
    let [centre_mm, corner_mm] = predicted_ends(found);
    let both = |errors: &Errors| [errors.mean, errors.sd];
    let scatter = found.refined.scatter;
    Quality {
        frames: u32::try_from(found.used()).unwrap_or(u32::MAX),
        error_mm: both(&found.errors[0]),
        validation_error_mm: found.validation.as_ref().map(|[middle, _]| both(middle)),
        centre_mm,
        corner_mm,
        sensors: Some(TrackerNoise { position_mm: scatter.position_mm, rotation_deg: scatter.turn_rad.to_degrees() }),
    }
}

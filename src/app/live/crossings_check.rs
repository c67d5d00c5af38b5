//! Check of the calibration at the end of a recorded session, by its sweeps that cross.

use std::path::Path;

use calibration::crossings::{Directions, LEAST_DIRECTIONS};
use glam::DVec3;

use pipeline::session::RecordedDecisions;

use crate::app::calibrate::crossings::Options;
use crate::failure::Failure;

/// Checks the calibration that a session was recorded with, if its sweeps have enough directions.
/// Returns a sentence for the user: an error if the calibration no longer holds, or if the sweeps
/// do not tell.
pub(super) fn check(session: &Path) -> Option<Result<String, String>> {
    let why = |Failure(why): Failure| format!("calibration by crossing sweeps: {}", why.sentence);
    match has_directions(session) {
        Ok(false) => return None,
        Ok(true) => {}
        Err(failure) => return Some(Err(why(failure))),
    }
    Some(Options::of_session(session).find().and_then(|found| match found.alarm() {
        Some(alarm) => Err(alarm),
        None => Ok(format!(
            "the calibration holds, checked by sweeps that cross: another one would displace the image by {:.2} mm, \
             with a standard error of {:.2} mm",
            found.checked.shift_mm, found.checked.shift_se_mm
        )),
    })
    .map_err(why))
}

/// Returns whether the session's planes have the directions that determine a calibration.
fn has_directions(session: &Path) -> Result<bool, Failure> {
    let decisions = RecordedDecisions::read(session)?;
    let (poses, times_ns) = (decisions.placed_poses(), decisions.placed_times_ns());
    let plane = |(frame, rows): (&u64, &[f64; 12])| {
        let [u, v] = [0, 1].map(|column| DVec3::new(rows[column], rows[4 + column], rows[8 + column]));
        Some((*times_ns.get(frame)? as f64 * 1e-9, u.cross(v).try_normalize()))
    };
    Ok(Directions::of_planes(&poses.iter().filter_map(plane).collect::<Vec<_>>()).count >= LEAST_DIRECTIONS)
}

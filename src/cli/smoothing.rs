//! The report on smoothed poses.

use pipeline::{SensorNoise, SmoothingStatus};

/// Returns sentences on the poses that were smoothed, and on those that were not.
pub(super) fn sentences(status: &SmoothingStatus) -> String {
    let SmoothingStatus { smoothed, not_smoothed, moved_rms_mm, moved_most_mm, error_rms_mm, sensors, .. } = status;
    let mut text = format!(
        "poses of {smoothed} frames were smoothed: their corners moved by {moved_rms_mm:.2} mm (rms; at most \
         {moved_most_mm:.2}); their error is {error_rms_mm:.2} mm (rms) if the noise is white"
    );
    for (why, frames) in not_smoothed {
        text += &format!("; left as they are: {frames} ({why})");
    }
    for SensorNoise { sensor: [from, to], position_mm, rotation_deg, lag_1, is_white } in sensors {
        text += &format!("\n{from} in {to}: noise {position_mm:.3} mm and {rotation_deg:.3}° along and about an axis");
        if !is_white {
            let lag_1 = lag_1.map(|lag_1| format!("{lag_1:.2}")).join(" and ");
            text += &format!(
                ", NOT WHITE: its third differences correlate by {lag_1}, and those of white noise by −0.75. Smoothing \
                 gains less than it states"
            );
        }
    }
    text
}

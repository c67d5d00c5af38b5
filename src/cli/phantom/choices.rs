//! Values of the flags of `phantom`.

use clap::ValueEnum;
use glam::DVec3;

use phantom::TrackerNoise;
use sonoweave_core::keys::numbers;

use crate::cli::values;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum ScalarName {
    /// 8 bit unsigned
    #[default]
    U8,
    /// Single precision
    F32,
}

/// Parses a direction, of length 1.
pub(super) fn direction(text: &str) -> Result<DVec3, String> {
    values::point(text).map_err(|e| e.to_string())?.try_normalize().ok_or_else(|| "must not be zero".into())
}

/// Parses cycles per mm along three axes.
pub(super) fn frequency(text: &str) -> Result<DVec3, String> {
    let frequency = values::point(text).map_err(|e| e.to_string())?;
    // This limit is finer than any pixel, and low enough for exact phases.
    if frequency.abs().max_element() <= 100.0 { Ok(frequency) } else { Err("must be at most 100 cycles per mm".into()) }
}

/// Parses MM,DEG.
pub(in crate::cli) fn tracker_noise(text: &str) -> Result<TrackerNoise, String> {
    let [position_mm, rotation_degrees] = numbers::<2>(text)?;
    Ok(TrackerNoise { position_mm, rotation_degrees })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parsers_accept_valid_refuse_meaningless() {
        assert_eq!(direction("0,0,-2"), Ok(DVec3::NEG_Z));
        assert_eq!(frequency("0.1,-0.2,0"), Ok(DVec3::new(0.1, -0.2, 0.0)));
        let noise = TrackerNoise { position_mm: 0.5, rotation_degrees: 0.1 };
        assert_eq!(tracker_noise("0.5,0.1"), Ok(noise));
        assert!(direction("0,0,0").is_err() && frequency("101,0,0").is_err() && tracker_noise("0.5").is_err());
    }
}

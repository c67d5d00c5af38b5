//! What the flags of `phantom` can be.

use clap::ValueEnum;
use glam::DVec3;

use crate::cli::values;
use crate::config::numbers;
use crate::phantom::{Motion, TrackerNoise};

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum SceneName {
    /// The same grey level everywhere
    Constant,
    /// Linear along every axis
    Ramp,
    /// 60 Gaussian blobs and a soft sphere
    #[default]
    Blobs,
    /// A hard sphere of 10 mm radius in the middle
    Sphere,
    /// A hard edge through the middle, across --normal
    Plane,
    /// Shells that become finer from the middle outwards
    ZonePlate,
    /// Plane waves: see --frequency
    Sinusoid,
    /// Seven wires of 0.5 mm in seven directions
    Wires,
    /// A sheet of 0.5 mm through the middle, across --normal
    Sheet,
    /// The test function of Marschner and Lobb, 20 mm for its unit
    MarschnerLobb,
    /// Fully developed speckle: see --grain
    Speckle,
    /// A sphere whose radius swings between 8 and 12 mm once a second
    Pulsating,
    /// A doll in a water tank, as a scanner shows its echoes
    Doll,
    /// A thigh with femur, artery and vein, as a scanner shows its echoes
    Thigh,
    /// Three N-shaped layers of wires in water
    NWire,
    /// Two wires in water that cross at one point
    CrossWire,
    /// The sloping floor of a water tank
    TankFloor,
    /// A pointed steel rod in water
    Stylus,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum TrajectoryName {
    /// Equal steps along the plane's normal
    Parallel,
    /// Uneven steps along the plane's normal, from 2/3 to 4/3 of the gap
    Jittered,
    /// Equal tilts about an axis above the picture
    Fan,
    /// Equal turns about the picture's own middle line along u
    Rotation,
    /// By an arm: wandering in a plane and turning about u, nothing else
    Arm,
    /// By hand: wandering, tilting, at uneven speed
    #[default]
    Freehand,
    /// Two parallel sweeps that cross at a right angle, half of the pictures each
    Crossing,
    /// A parallel sweep that stands still in its middle: see --dwell
    Dwell,
    /// A parallel sweep and the same way back
    OutAndBack,
}

/// Default of `--axis-distance`, mm.
pub(in crate::cli) const AXIS_DISTANCE_MM: f64 = 60.0;
/// Default of `--radius`, mm.
pub(in crate::cli) const RADIUS_MM: f64 = 24.0;
/// Default of `--dwell`, pictures.
pub(in crate::cli) const DWELL: u32 = 30;

impl TrajectoryName {
    /// The motion, with the numbers that some of them need.
    pub(in crate::cli) fn motion(self, axis_distance_mm: f64, radius_mm: f64, dwell: u32) -> Motion {
        match self {
            Self::Parallel => Motion::Parallel,
            Self::Fan => Motion::Fan { axis_distance_mm },
            Self::Freehand => Motion::Freehand,
            Self::Jittered => Motion::Jittered,
            Self::Rotation => Motion::Rotation { radius_mm },
            Self::Arm => Motion::Arm,
            Self::Crossing => Motion::Crossing,
            Self::Dwell => Motion::Dwell { frames: dwell },
            Self::OutAndBack => Motion::OutAndBack,
        }
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum ScalarName {
    /// 8 bit unsigned
    #[default]
    U8,
    /// Single precision
    F32,
}

/// A direction, of length 1.
pub(super) fn direction(text: &str) -> Result<DVec3, String> {
    values::point(text)?.try_normalize().ok_or_else(|| "must not be zero".into())
}

/// Cycles per mm along three axes.
pub(super) fn frequency(text: &str) -> Result<DVec3, String> {
    let frequency = values::point(text)?;
    // Finer than any pixel, and little enough for phases to be exact.
    if frequency.abs().max_element() <= 100.0 { Ok(frequency) } else { Err("must be at most 100 cycles per mm".into()) }
}

/// MM,DEG.
pub(in crate::cli) fn tracker_noise(text: &str) -> Result<TrackerNoise, String> {
    let [position_mm, rotation_degrees] = numbers::<2>(text)?;
    Ok(TrackerNoise { position_mm, rotation_degrees })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_and_those_without_meaning_refused() {
        assert_eq!(direction("0,0,-2"), Ok(DVec3::NEG_Z));
        assert_eq!(frequency("0.1,-0.2,0"), Ok(DVec3::new(0.1, -0.2, 0.0)));
        let noise = TrackerNoise { position_mm: 0.5, rotation_degrees: 0.1 };
        assert_eq!(tracker_noise("0.5,0.1"), Ok(noise));
        assert!(direction("0,0,0").is_err() && frequency("101,0,0").is_err() && tracker_noise("0.5").is_err());
    }
}

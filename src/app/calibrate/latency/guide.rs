//! Advice while a recording for the lag is made: whether the probe moves far enough, and turns
//! round often enough.
//!
//! The video frames are searched for a floor later.

use std::path::{Path, PathBuf};

use calibration::latency::motion::Motion;
use calibration::trajectory::PoseSample;
use config::Settings;
use config::bedside::Bedside;
use config::bedside::devices::PROBE_FRAME;
use sync::ingest::live::Live;

use super::super::guide::{Advice, Advisor, Gathering, Guide, lead};
use super::super::recorded::{Tracks, without_latency};
use crate::failure::Failure;

/// Motion that determines a lag well: distance, mm, number of turning points, and duration, s.
const FAR_MM: f64 = 20.0;
const TURNS: f64 = 8.0;
const LONG_S: f64 = 12.0;

/// Records the configured devices until the motion determines a lag. `check` gets the configured
/// calibration before.
///
/// # Errors
/// [`Failure`] when they cannot be recorded, and that of `check`.
pub(super) fn gathered(
    bedside: &Path,
    gathering: &Gathering,
    advisor: &mut dyn Advisor,
    check: impl FnOnce(&Settings) -> Result<(), Failure>,
) -> Result<PathBuf, Failure> {
    let begin = |bedside: &Bedside| {
        check(&bedside.calibration)?;
        let roles = without_latency(bedside)?;
        Ok((UpAndDown { tracks: Tracks::of_roles(&roles, bedside) }, roles))
    };
    Ok(lead(bedside, gathering, advisor, begin)?.session)
}

struct UpAndDown {
    tracks: Tracks,
}

impl Guide for UpAndDown {
    fn add(&mut self, device: usize, live: Live) {
        self.tracks.add(device, live);
    }

    fn advise(&mut self) -> Advice {
        let samples = self.tracks.of(PROBE_FRAME).unwrap_or_default();
        let valid = samples.iter().filter(|sample| sample.invalid.is_none());
        let poses: Vec<PoseSample> = valid
            .map(|sample| PoseSample {
                time_s: sample.time_ns as f64 * 1e-9,
                rotation: sample.pose.rotation,
                position_mm: sample.pose.position_mm,
            })
            .collect();
        let (Some(first), Some(last)) = (poses.first(), poses.last()) else {
            return Advice::missing("waiting for poses of the probe");
        };
        let (seconds, range) = (last.time_s - first.time_s, [first.time_s, last.time_s]);
        match Motion::new(&poses, range) {
            Err(error) => Advice::missing(error.to_string()),
            Ok(None) => Advice::missing("waiting for poses of the probe"),
            Ok(Some(motion)) => of(&motion, seconds),
        }
    }
}

fn of(motion: &Motion, seconds: f64) -> Advice {
    let shares = [motion.extent_mm / FAR_MM, motion.turns as f64 / TURNS, seconds / LONG_S];
    let message = format!(
        "moved by {:.0} of {FAR_MM:.0} mm, reversed {} of {TURNS:.0} times, for {seconds:.0} of {LONG_S:.0} s; move up and down, unevenly",
        motion.extent_mm, motion.turns
    );
    Advice::at(shares.into_iter().fold(1.0, f64::min), message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn advice_reports_least_fulfilled_condition() {
        let swing = |mm: f64, hz: f64, until: f64| {
            let pose = |i: u32| {
                let time_s = 0.01 * f64::from(i);
                let z = 0.5 * mm * (std::f64::consts::TAU * hz * time_s).sin();
                PoseSample { time_s, rotation: DQuat::IDENTITY, position_mm: DVec3::new(0.0, 0.0, z) }
            };
            let poses: Vec<PoseSample> = (0..(100.0 * until) as u32).map(pose).collect();
            of(&Motion::new(&poses, [0.0, until]).unwrap().unwrap(), until)
        };
        assert!(swing(30.0, 0.5, 13.0).share >= 1.0);
        let [small, seldom, short] = [swing(5.0, 0.5, 13.0), swing(30.0, 0.2, 13.0), swing(30.0, 1.0, 6.0)];
        assert!((small.share - 0.25).abs() < 0.01, "{small:?}");
        assert!((seldom.share - 5.0 / 8.0).abs() < 1e-9, "{seldom:?}");
        assert!((short.share - 0.5).abs() < 1e-9, "{short:?}");
    }
}

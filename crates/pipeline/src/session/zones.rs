//! Frames taken where metal distorts the tracker's field: they are used, counted, and reported
//! as warnings.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;
use serde::Serialize;

use calibration::tracker::zones::Zones;

/// Shortest time between two warnings.
const PAUSE: Duration = Duration::from_secs(10);

/// The sensor and the zones to monitor.
#[derive(Debug, Clone)]
pub struct Watch {
    /// The moving coordinate frame, such as `Probe`; its position in the tracker's frame is
    /// checked.
    pub sensor: String,
    /// The zones of distortion.
    pub zones: Arc<Zones>,
}

/// A sensor's relation to the zones.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct InZones {
    /// Number of zones.
    pub zones: usize,
    /// Frames whose pose was measured in one of them.
    pub frames: u64,
    /// Times that the sensor has entered a zone from outside of all.
    pub entered: u64,
    /// Error (root mean square, mm) of its present zone; `None` outside.
    pub rms_mm: Option<f64>,
}

/// Check of each frame's pose.
pub(super) struct Guard {
    /// The sensor's index among the pose sources.
    pub(super) source: usize,
    zones: Arc<Zones>,
    found: InZones,
}

impl Guard {
    pub(super) fn new(source: usize, zones: &Arc<Zones>) -> Self {
        let found = InZones { zones: zones.count(), ..InZones::default() };
        Self { source, zones: Arc::clone(zones), found }
    }

    /// Returns the sensor's present relation to the zones.
    pub(super) fn found(&self) -> InZones {
        self.found
    }

    /// Counts a frame at this sensor position, mm in the tracker's frame. Returns the sensor's new
    /// relation to the zones, if it has changed.
    pub(super) fn check(&mut self, place_mm: DVec3) -> Option<InZones> {
        let zone = self.zones.at(place_mm);
        let was_inside = self.found.rms_mm.is_some();
        self.found.rms_mm = zone.map(|zone| zone.rms_mm);
        if zone.is_some() {
            self.found.frames += 1;
            self.found.entered += u64::from(!was_inside);
        } else if !was_inside {
            return None;
        }
        Some(self.found)
    }
}

/// State of the warnings.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    entered: u64,
    warned: Option<Instant>,
}

impl Warnings {
    /// Warns if the sensor has entered a zone since the last warning, with a minimum interval.
    /// Returns the sentence.
    pub(super) fn log(&mut self, distortion: Option<InZones>, now: Instant) -> Option<String> {
        let InZones { entered, rms_mm, frames, .. } = distortion?;
        let due = self.warned.is_none_or(|warned| now.duration_since(warned) >= PAUSE);
        if entered <= self.entered || !due {
            return None;
        }
        let times = entered - self.entered;
        (self.entered, self.warned) = (entered, Some(now));
        let err = rms_mm.map_or(String::new(), |mm| format!(", by {mm:.1} mm"));
        let often = if times > 1 { format!(" {times} times") } else { String::new() };
        let sentence = format!(
            "the probe's sensor has come{often} to where metal bends the tracker's field{err}: {frames} frames were taken there so far; they are inserted, and may lie off"
        );
        tracing::warn!("{sentence}");
        Some(sentence)
    }
}

#[cfg(test)]
mod tests {
    use calibration::tracker::zones::Zone;

    use super::*;

    #[test]
    fn zone_frames_counted_and_entries_warned_with_pause() {
        let zones = [0.0, 20.0].map(|x| Zone { low_mm: DVec3::new(x, 0.0, 0.0), rms_mm: 2.5 + x });
        let mut guard = Guard::new(1, &Arc::new(Zones::new(10.0, 1.0, None, zones.to_vec())));
        let (mut warnings, begin) = (Warnings::default(), Instant::now());
        let reported = std::cell::Cell::new(guard.found());
        let mut say = |after_s| warnings.log(Some(reported.get()), begin + Duration::from_secs(after_s));
        let mut at = |x: f64| guard.check(DVec3::new(x, 5.0, 5.0)).iter().for_each(|found| reported.set(*found));
        at(-1.0);
        let nothing = InZones { zones: 2, ..InZones::default() };
        assert_eq!((reported.get(), say(0)), (nothing, None), "outside there is no warning");
        at(1.0);
        at(2.0);
        assert_eq!(reported.get(), InZones { zones: 2, frames: 2, entered: 1, rms_mm: Some(2.5) });
        assert!(say(1).unwrap().contains("has come to where metal bends the tracker's field, by 2.5 mm: 2 frames"));
        assert_eq!(say(60), None, "once for each time that it comes");
        for x in [12.0, 21.0, 35.0, 22.0] {
            at(x);
        }
        assert_eq!(reported.get(), InZones { zones: 2, frames: 4, entered: 3, rms_mm: Some(22.5) });
        assert!(say(61).unwrap().contains("has come 2 times"));
        at(35.0);
        assert_eq!(reported.get().rms_mm, None);
        at(22.0);
        assert_eq!(say(65), None, "not so soon");
        assert!(say(71).is_some());
    }
}

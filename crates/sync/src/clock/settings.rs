//! A clock's knowledge of its device.

use sonoweave_core::{Ticks, Timing};

use super::envelope::FREE_PPB;

/// Largest drift of a device's clock if its rate is known, ppm. Crystals keep within 100 ppm,
/// their makers' figures within a few hundred.
pub(super) const KNOWN_PPM: f64 = 500.0;
/// The same if the device has no counter and the rate is its maker's figure.
const NOMINAL_PPM: f64 = 2_000.0;
/// The same for video, whose rate is that of its source.
const VIDEO_PPM: f64 = 20_000.0;
/// The same if only the first records give the rate.
pub(super) const UNKNOWN_PPM: f64 = FREE_PPB as f64 / 1e3;
/// Longest time between ticks, ns. At the steepest slope its rate is still an i64 in 2⁻³² ns.
pub(super) const LONGEST_NS: f64 = 1.6e9;
const _: () = assert!(LONGEST_NS * (1.0 + UNKNOWN_PPM * 1e-6) * 4_294_967_296.0 < i64::MAX as f64);

/// Settings of a clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockSettings {
    /// The quantity that the device counts.
    pub ticks: Ticks,
    /// Ticks per second; for a device without ticks, measurements per second.
    pub tick_hz: Option<f64>,
    /// Value at which ticks wrap to 0.
    pub wraps_at: Option<u64>,
    /// Known delay between the measurement and the host's stamp, ns; may be negative.
    pub delay_ns: i64,
    /// Largest rate error either way, ppm.
    pub slope_ppm: f64,
}

impl ClockSettings {
    /// Settings from the device's own timing. `latency_ns` is the configured or calibrated
    /// latency beyond it.
    pub fn new(timing: &Timing, latency_ns: i64) -> Self {
        let usable = |hz: &f64| (1e9 / LONGEST_NS..=1e9).contains(hz);
        let (tick_hz, slope_ppm) = match (timing.ticks, timing.tick_hz.filter(usable), timing.rate_hz.filter(usable)) {
            (Ticks::None, _, Some(hz)) => (Some(hz), NOMINAL_PPM),
            (Ticks::Time | Ticks::Measurements, Some(hz), _) => (Some(hz), KNOWN_PPM),
            _ => (None, UNKNOWN_PPM),
        };
        Self {
            ticks: timing.ticks,
            tick_hz,
            // A counter that wraps this early counts nothing.
            wraps_at: timing.wraps_at.filter(|at| *at >= 256),
            delay_ns: timing.wire_ns.saturating_add(timing.sampling_ns).saturating_add(latency_ns),
            slope_ppm,
        }
    }

    /// Settings for a frame grabber. Its frame rate is that of the video source; the driver's
    /// figure may be the mode's name (30 for 29.97).
    pub fn video(timing: &Timing, latency_ns: i64) -> Self {
        let settings = Self::new(timing, latency_ns);
        Self { slope_ppm: settings.slope_ppm.max(VIDEO_PPM), ..settings }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_add_up_and_rate_error_depends_on_source() {
        let timing = Timing {
            ticks: Ticks::Measurements,
            tick_hz: Some(240.0),
            wraps_at: Some(1 << 32),
            rate_hz: Some(240.0),
            sampling_ns: 3_500_000,
            wire_ns: 1_000_000,
        };
        let settings = ClockSettings::new(&timing, -200_000);
        assert_eq!((settings.delay_ns, settings.tick_hz, settings.slope_ppm), (4_300_000, Some(240.0), KNOWN_PPM));
        assert_eq!(ClockSettings::video(&timing, 0).slope_ppm, VIDEO_PPM);
        let without = Timing { ticks: Ticks::None, ..timing };
        assert_eq!(ClockSettings::new(&without, 0).slope_ppm, NOMINAL_PPM);
        let unknown = Timing { tick_hz: None, rate_hz: None, wraps_at: Some(1), ..timing };
        let settings = ClockSettings::new(&unknown, 0);
        assert_eq!((settings.tick_hz, settings.wraps_at, settings.slope_ppm), (None, None, UNKNOWN_PPM));
    }
}

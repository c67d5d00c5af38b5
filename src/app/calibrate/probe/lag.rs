//! The tracker's latency, and whether it goes into the calibration file.

use serde::Serialize;

use calibration::file::Latency;

use super::super::outputs::Outputs;
use super::super::recorded::Recorded;
use crate::failure::Failure;

/// Largest standard error of a useful lag, ms. A probe at 50 mm/s moves by a quarter of a
/// millimetre in this time.
const MOST_SE_MS: f64 = 5.0;
/// Largest plausible latency of a device, ms.
const MOST_MS: f64 = 1000.0;

/// The resulting latencies.
#[derive(Debug, Serialize)]
pub(crate) struct Lag {
    #[serde(flatten)]
    latency: Latency,
    /// Sentence with the reason why they stay out of the calibration file; `None` if they go
    /// into it.
    kept_out: Option<String>,
}

impl Lag {
    /// Computes latencies from a lag and its standard deviation, s. The lag is positive if poses
    /// come later than images. The video's latency is given; `known` is the file's current
    /// value.
    pub(crate) fn new([lag_s, sd_s]: [f64; 2], video_ms: f64, known: Option<&Latency>) -> Self {
        let (tracker_ms, se_ms) = (video_ms + 1e3 * lag_s, 1e3 * sd_s);
        let kept_out = if se_ms > MOST_SE_MS {
            Some(format!(
                "its error of {se_ms:.1} ms is more than {MOST_SE_MS:.0} ms; move the probe faster, or use `calibrate latency`"
            ))
        } else if tracker_ms.abs() > MOST_MS {
            Some(format!("a latency of {tracker_ms:.0} ms is implausible; check that all time stamps are of one clock"))
        } else {
            known.and_then(|known| match known.lag_se_ms {
                Some(ms) if ms >= se_ms => None,
                Some(ms) => Some(format!("the file has one with an error of {ms:.1} ms")),
                None => Some("the file has one without an error; remove its [latency] to replace it".into()),
            })
        };
        Self { latency: Latency { video_ms, tracker_ms, lag_se_ms: Some(se_ms) }, kept_out }
    }

    /// Returns the latencies for a lag and its standard deviation, s, in a recording; `None` if no
    /// lag was sought (deviation 0).
    ///
    /// # Errors
    /// [`Failure`] when the calibration file cannot be read.
    pub(crate) fn of(outputs: &Outputs, recorded: &Recorded, [lag_s, sd_s]: [f64; 2]) -> Result<Option<Self>, Failure> {
        let video_ms = recorded.bedside().map_or(0.0, |bedside| bedside.grabber.latency_ns as f64 * 1e-6);
        let known = || outputs.before();
        (sd_s > 0.0).then(|| Ok(Lag::new([lag_s, sd_s], video_ms, known()?.latency.as_ref()))).transpose()
    }

    /// Returns the latency for the calibration file, unless it stays out of it.
    pub(crate) fn latency(&self) -> Option<Latency> {
        self.kept_out.is_none().then_some(self.latency)
    }

    /// Formats the latencies for people, if there is a file.
    pub(crate) fn text(&self) -> String {
        let Latency { video_ms, tracker_ms, .. } = self.latency;
        match &self.kept_out {
            None => format!("latency: video {video_ms:.1} ms, tracker {tracker_ms:.1} ms, into the calibration file\n"),
            Some(why) => format!("latency: not into the calibration file: {why}\n"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lag_written_if_precise_and_no_better_known() {
        let known = |lag_se_ms| Latency { video_ms: 0.0, tracker_ms: 7.0, lag_se_ms };
        let lag = |sd_s, known: Option<Latency>| Lag::new([-0.0302, sd_s], 50.0, known.as_ref());
        let written = lag(0.002, None).latency().unwrap();
        assert_eq!((written.video_ms, written.lag_se_ms), (50.0, Some(2.0)));
        // The lag is negative: the poses come earlier than the images.
        assert!((written.tracker_ms - 19.8).abs() < 1e-9, "{}", written.tracker_ms);
        assert!(lag(0.002, Some(known(Some(2.0)))).latency().is_some(), "the same once more");
        for (unfit, expected) in [
            (lag(0.0051, None), "its error of 5.1 ms"),
            (lag(0.002, Some(known(Some(1.9)))), "an error of 1.9 ms"),
            (lag(0.002, Some(known(None))), "without an error"),
            (Lag::new([1.2, 0.001], 0.0, None), "a latency of 1200 ms"),
        ] {
            assert!(unfit.latency().is_none() && unfit.text().contains(expected), "{}", unfit.text());
        }
    }
}

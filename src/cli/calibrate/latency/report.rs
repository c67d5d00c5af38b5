//! Reports on a lag: as text, as JSON, and in the calibration file.

use std::fmt::Write as _;

use serde::Serialize;

use calibration::file::Latency;
use calibration::latency::crossings::Agreement;
use calibration::latency::floor::{FloorLag, Tried};
use calibration::latency::stamps::Reading;

use crate::app::calibrate::latency::{Found, Searched};
use crate::app::calibrate::outputs::{Input, Outputs};
use crate::cli::Failure;

/// Difference between the found lag and a recording's pairing lag at which a note is printed,
/// standard errors.
const OTHER: f64 = 3.0;

/// The report; its fields are the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// `line` or `crossings`.
    method: &'static str,
    /// Positive if the tracker lags the video.
    lag_s: f64,
    /// Its standard error.
    lag_se_s: f64,
    /// Resulting latencies, ms.
    video_ms: f64,
    tracker_ms: f64,
    /// Difference of the latencies that the session was paired by, ms.
    #[serde(skip_serializing_if = "Option::is_none")]
    paired_by_ms: Option<f64>,
    inputs: Vec<Input>,
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<Line>,
    #[serde(skip_serializing_if = "Option::is_none")]
    crossings: Option<Crossings>,
    /// Sentences for the user.
    notes: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Line {
    frames: Frames,
    /// Time stamps used for video frames and for poses.
    stamps: [Reading; 2],
    tried: Vec<Tried>,
    /// Jitter of the given time stamps about these, s.
    wander_s: [f64; 2],
    extent_px: f64,
    extent_mm: f64,
    noise_mm: f64,
    turns: usize,
    axis: [f64; 3],
    mm_per_px: f64,
    residual_px: f64,
    /// Time, s, distance of the line, px, and its residual.
    values: Vec<(f64, f64, Option<f64>)>,
}

#[derive(Debug, Serialize)]
struct Frames {
    used: usize,
    outliers: usize,
    without_motion: usize,
    without_line: usize,
}

#[derive(Debug, Serialize)]
struct Crossings {
    crossings: usize,
    slices: usize,
    correlation: f64,
    correlation_without_lag: f64,
    /// Lag, s, and the mismatch at it.
    curve: Vec<(f64, f64)>,
}

impl Report {
    pub(super) fn new(searched: Searched) -> Result<Self, Failure> {
        let Searched { source, found, video_ms, mut notes } = searched;
        let (method, lag_s, lag_se_s) = match &found {
            Found::Line(found) => ("line", found.alignment.lag_s, found.alignment.se_s),
            Found::Crossings(found) => ("crossings", found.lag_s, found.se_s),
        };
        let inputs = source.paths().into_iter().map(Input::of);
        let paired_by_ms = source.paired_ms();
        if let Some(paired_ms) = paired_by_ms
            && (1e3 * lag_s - paired_ms).abs() > OTHER * 1e3 * lag_se_s
        {
            notes.push(format!(
                "the session was reconstructed with a lag of {paired_ms:.1} ms, which is {:.1} ms off",
                (1e3 * lag_s - paired_ms).abs()
            ));
        }
        let (line, crossings) = match found {
            Found::Line(found) => {
                notes.extend(wandering(&found));
                (Some(Line::new(*found)), None)
            }
            Found::Crossings(found) => {
                let Agreement { crossings, slices, correlation, correlation_at_zero, curve, .. } = *found;
                let correlation_without_lag = correlation_at_zero;
                (None, Some(Crossings { crossings, slices, correlation, correlation_without_lag, curve }))
            }
        };
        Ok(Self {
            method,
            lag_s,
            lag_se_s,
            video_ms,
            tracker_ms: video_ms + 1e3 * lag_s,
            paired_by_ms,
            inputs: inputs.collect::<Result<_, _>>()?,
            line,
            crossings,
            notes,
        })
    }

    /// Returns the latencies for the calibration file.
    pub(super) fn latency(&self) -> Latency {
        Latency { video_ms: self.video_ms, tracker_ms: self.tracker_ms, lag_se_ms: Some(1e3 * self.lag_se_s) }
    }

    /// Returns the recordings.
    pub(super) fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// Returns the result's provenance, in one line.
    pub(super) fn provenance(&self) -> String {
        let names: Vec<String> = self.inputs.iter().map(Input::name).collect();
        format!(
            "by {} in {}",
            if self.line.is_some() { "a tank's floor" } else { "crossing slices" },
            names.join(" and ")
        )
    }

    /// Formats the report for people.
    pub(super) fn text(&self, outputs: &Outputs) -> String {
        let mut text = String::new();
        let mut say = |label: &str, value: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{label:<16}{value}");
        };
        let side = if self.lag_s > 0.0 { "the tracker lags the video" } else { "the video lags the tracker" };
        say("lag", format!("{:.2} ± {:.2} ms: {side}", 1e3 * self.lag_s, 1e3 * self.lag_se_s));
        say("latency", format!("video {:.2} ms, tracker {:.2} ms", self.video_ms, self.tracker_ms));
        if let Some(line) = &self.line {
            let Frames { used, outliers, without_motion, without_line } = line.frames;
            say(
                "frames",
                format!(
                    "{used} with a floor, {outliers} of them outliers; {without_motion} without motion, {without_line} without a line"
                ),
            );
            say(
                "motion",
                format!(
                    "{:.1} px for {:.1} mm, {} turns; {:.4} mm a pixel; residual {:.2} px",
                    line.extent_px, line.extent_mm, line.turns, line.mm_per_px, line.residual_px
                ),
            );
            let [video, tracker] = line.stamps.map(Reading::words);
            say("times", format!("frames by {video}, poses by {tracker}"));
        }
        if let Some(found) = &self.crossings {
            say(
                "crossings",
                format!(
                    "{} of {} slices; correlation {:.3}, without a lag {:.3}",
                    found.crossings, found.slices, found.correlation, found.correlation_without_lag
                ),
            );
        }
        self.notes.iter().for_each(|note| say("note", note.clone()));
        outputs.written().for_each(|(what, path)| say(what, path.display().to_string()));
        text
    }
}

/// Jitter of time stamps that is noticeable at a hand speed of 50 mm/s, s.
const WANDERS_S: f64 = 2e-3;

fn wandering(found: &FloorLag) -> Vec<String> {
    let of = ["frames", "poses"];
    let each = of.into_iter().zip(found.wander_s).filter(|(_, wander)| *wander > WANDERS_S);
    each.map(|(what, wander)| {
        format!(
            "the time stamps of the {what} wander by {:.1} ms (standard deviation): the lag is that of their mean, and single {what} deviate by as much",
            1e3 * wander
        )
    })
    .collect()
}

impl Line {
    fn new(found: FloorLag) -> Self {
        let FloorLag { alignment, readings, tried, wander_s, without, extent_px, motion, mm_per_px, values, .. } =
            found;
        let [without_motion, without_line] = without;
        Self {
            frames: Frames { used: alignment.frames, outliers: alignment.outliers, without_motion, without_line },
            stamps: readings,
            tried,
            wander_s,
            extent_px,
            extent_mm: motion.extent_mm,
            noise_mm: motion.noise_mm,
            turns: motion.turns,
            axis: motion.axis.to_array(),
            mm_per_px,
            residual_px: alignment.residual,
            values: values
                .into_iter()
                .zip(alignment.residuals)
                .map(|((time, value), left)| (time, value, left))
                .collect(),
        }
    }
}

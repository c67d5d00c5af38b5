//! Contents of every report of a probe's calibration, whatever the method, and its outputs.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use calibration::file::origin::Origin;
use calibration::probe::calibrate::Outcome;
use calibration::probe::errors::Errors;
use calibration::probe::plane::ImagePlane;

use super::super::super::Failure;
use super::super::done::Done;
use crate::app::calibrate::outputs::{Input, Outputs, rows};
use crate::app::calibrate::probe::{Lag, Made, Options, Reproducibility};

/// Points along each axis of the grid of predicted errors.
pub(super) const LATTICE: usize = 9;

/// Input files.
#[derive(Debug, Serialize)]
pub(super) struct Inputs {
    pub(super) input: Input,
    pub(super) phantom: Option<Input>,
    pub(super) registration: Option<Input>,
    pub(super) stylus_tip: Option<Input>,
    pub(super) validation: Option<Input>,
}

impl Inputs {
    /// Reads the input files, of which `recorded` may have been made now.
    pub(super) fn of(options: &Options, recorded: &Path) -> Result<Self, Failure> {
        let read = |path: Option<&Path>| path.map(Input::of).transpose();
        Ok(Self {
            input: Input::of(recorded)?,
            phantom: read(options.phantom.as_deref())?,
            registration: read(options.registration.as_deref())?,
            stylus_tip: read(options.target.stylus_tip.as_deref())?,
            validation: read(options.validate.as_deref())?,
        })
    }

    /// Returns the present inputs.
    pub(super) fn all(&self) -> impl Iterator<Item = &Input> {
        let Self { input, phantom, registration, stylus_tip, validation } = self;
        let others = [phantom, registration, stylus_tip, validation].into_iter().flatten();
        std::iter::once(input).chain(others)
    }

    /// Returns the files' day and hashes, for the calibration file.
    pub(super) fn origin(&self, outputs: &Outputs) -> Origin {
        outputs.origin(self.all())
    }
}

/// Numbers of a result. The names contain the units.
#[derive(Debug, Serialize)]
pub(super) struct Shared {
    pub(super) kind: &'static str,
    pub(super) method: &'static str,
    /// Name of the target, for people.
    #[serde(skip)]
    title: &'static str,
    /// Row major: pixels of the image in MF orientation to mm.
    pub(super) image_to_probe: [f64; 16],
    pub(super) image_size_px: [u32; 2],
    pub(super) pixel_mm: [f64; 2],
    /// Error of each image: of middle wires, by PLUS's definition, with the lag and the
    /// registration that were found; or the distance of detections from the target.
    pub(super) error_mm: ProbeReport,
    /// The same of images that had no part in the calibration.
    pub(super) validation_error_mm: Option<ProbeReport>,
    /// Whether these are the last third of the recording, compared with a calibration from the
    /// others.
    pub(super) validation_is_split: bool,
    pub(super) limit_mm: f64,
    pub(super) frames: Frames,
    pub(super) condition: f64,
    /// Positive if poses come later than images.
    pub(super) lag_s: f64,
    /// Correlation length of the scatter, images.
    pub(super) scatter_lasts_pictures: f64,
    /// Predicted error of pixel positions, one standard deviation, by the covariance: rows of
    /// numbers over the image, from its first pixels to its last.
    pub(super) predicted_error_mm: Vec<Vec<f64>>,
    /// The same at the image's centre, and at its worst corner.
    pub(super) predicted_ends_mm: [f64; 2],
    /// Change of the result when parts of the recording are left out.
    pub(super) reproducibility_mm: Option<Reproducibility>,
    #[serde(rename = "looked_s")]
    pub(super) searched_s: f64,
    pub(super) solved_s: f64,
}

/// Parts of a calibration that the methods find differently.
pub(super) struct Numbers<'a> {
    pub(super) plane: &'a ImagePlane,
    pub(super) size_px: [u32; 2],
    pub(super) errors: &'a Errors,
    pub(super) validation: Option<&'a Errors>,
    pub(super) is_split: bool,
    pub(super) frames: Frames,
    pub(super) condition: f64,
    pub(super) lag_s: f64,
    pub(super) lasting: f64,
    pub(super) predicted_mm: Vec<Vec<f64>>,
    pub(super) ends_mm: [f64; 2],
    pub(super) reproducibility: Option<Reproducibility>,
    pub(super) times_s: [f64; 2],
}

impl Shared {
    pub(super) fn new(options: &Options, numbers: Numbers<'_>) -> Self {
        Self {
            kind: "probe",
            method: options.method.name(),
            title: options.method.title(),
            image_to_probe: rows(numbers.plane.affine()),
            image_size_px: numbers.size_px,
            pixel_mm: numbers.plane.pixel_mm(),
            error_mm: numbers.errors.into(),
            validation_error_mm: numbers.validation.map(ProbeReport::from),
            validation_is_split: numbers.is_split,
            limit_mm: options.limit,
            frames: numbers.frames,
            condition: numbers.condition,
            lag_s: numbers.lag_s,
            scatter_lasts_pictures: numbers.lasting,
            predicted_error_mm: numbers.predicted_mm,
            predicted_ends_mm: numbers.ends_mm,
            reproducibility_mm: numbers.reproducibility,
            searched_s: numbers.times_s[0],
            solved_s: numbers.times_s[1],
        }
    }

    /// Returns the title of the report's page.
    pub(super) fn heading(&self, inputs: &Inputs) -> String {
        format!("Calibration of a probe by {}: {}", self.title, inputs.input.name())
    }

    /// Returns the sentence with the result's origin, for the calibration file.
    pub(super) fn provenance(&self, inputs: &Inputs) -> String {
        let (title, input) = (self.title, inputs.input.name());
        format!("{title}, {} frames of {input}, {:.2} mm", self.frames.used, self.error_mm.mean)
    }
}

/// Writes a result to the requested files.
///
/// # Errors
/// [`Failure`] for a result that is too uncertain, and when a file cannot be written.
pub(super) fn write(
    options: &Options,
    outputs: &Outputs,
    made: Made,
    lag: Option<&Lag>,
    report: &impl Serialize,
    page: impl FnOnce() -> Result<String, Failure>,
    text: String,
) -> Result<Done, Failure> {
    let made = Made { latency: lag.and_then(Lag::latency), ..made };
    let report = outputs.write_probe(None, options.result(made)?, report, page)?;
    let of_lag = lag.filter(|_| outputs.wants_file()).map_or(String::new(), Lag::text);
    Ok(Done::new(text + &of_lag + &outputs.summary(), report))
}

#[derive(Debug, Serialize)]
pub(super) struct ProbeReport {
    pub(super) mean: f64,
    pub(super) sd: f64,
    pub(super) rms: f64,
    pub(super) max: f64,
    /// Mean of the smallest 95 %, as PLUS prints it.
    pub(super) mean_of_95: f64,
    pub(super) count: usize,
    /// Mean of each image.
    pub(super) per_frame: Vec<f64>,
    /// Number of each image.
    pub(super) frame: Vec<usize>,
}

impl From<&Errors> for ProbeReport {
    fn from(errors: &Errors) -> Self {
        let Errors { mean, sd, rms, max, mean_of_95, count, per_frame } = errors;
        let (frame, per_frame) = per_frame.iter().copied().unzip();
        Self { mean: *mean, sd: *sd, rms: *rms, max: *max, mean_of_95: *mean_of_95, count: *count, per_frame, frame }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct Frames {
    pub(super) total: usize,
    pub(super) used: usize,
    pub(super) failed: usize,
    /// Failed images, by reason.
    pub(super) reasons: BTreeMap<&'static str, usize>,
}

/// Returns an image's outcome in a few words.
pub(super) fn word(outcome: Outcome, unseen: &'static str) -> &'static str {
    match outcome {
        Outcome::Used => "used",
        Outcome::NoPose => "no valid pose",
        Outcome::Unseen => unseen,
        Outcome::NoPoseAtLag => "no pose after the lag",
        Outcome::Contradicted => "contradicted by the others",
    }
}

impl Frames {
    /// Counts the images by outcome. `unseen` names the outcome of an image in which nothing is
    /// seen.
    pub(super) fn of(outcomes: impl Iterator<Item = Outcome>, unseen: &'static str) -> Self {
        let mut frames = Self { total: 0, used: 0, failed: 0, reasons: BTreeMap::new() };
        for outcome in outcomes {
            frames.total += 1;
            if outcome == Outcome::Used {
                frames.used += 1;
            } else {
                frames.failed += 1;
                *frames.reasons.entry(word(outcome, unseen)).or_default() += 1;
            }
        }
        frames
    }

    /// Formats the counts for people: `80 of 100 frames used (20 no valid pose)`.
    pub(super) fn text(&self, of: &str) -> String {
        let reasons: Vec<String> = self.reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        let reasons = if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join(", ")) };
        format!("{} of {} frames{of} used{reasons}", self.used, self.total)
    }
}

/// Formats a lag with its standard deviation, s; empty if none was sought.
pub(super) fn lag_line(lag_s: f64, sd_s: f64) -> String {
    if sd_s <= 0.0 {
        return String::new();
    }
    let (lag_ms, sd_ms) = (1e3 * lag_s, 1e3 * sd_s);
    let side = if lag_ms > 0.0 { "later" } else { "earlier" };
    format!(
        "poses come {:.1} ± {sd_ms:.1} ms {side} than frames: the tracker's latency_ms must be {lag_ms:.1} more than the video's\n",
        lag_ms.abs()
    )
}

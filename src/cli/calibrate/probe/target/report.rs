//! Report of a probe's calibration by a point, a stylus or a plane.

use std::fmt::Write as _;

use glam::DVec2;
use serde::Serialize;

use calibration::probe::calibrate::Outcome;
use calibration::probe::errors::Errors;
use calibration::probe::target::refine::Scatter;
use calibration::probe::target::{Calibration, Place};

use super::super::report::{Frames, LATTICE, ProbeReport, lag_line, word};
use crate::app::calibrate::outputs::{Input, place, rows};
use crate::app::calibrate::probe::target::quality::ends;
use crate::app::calibrate::probe::{Method, Reproducibility};

/// Name of the outcome of an image without a detection.
const UNSEEN: &str = "nothing seen";

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) kind: &'static str,
    pub(super) method: &'static str,
    #[serde(flatten)]
    pub(super) inputs: Inputs,
    /// Row major: pixels of the image in MF orientation to mm.
    pub(super) image_to_probe: [f64; 16],
    pub(super) image_size_px: [u32; 2],
    pub(super) pixel_mm: [f64; 2],
    /// Distances of the detections from the target.
    pub(super) error_mm: ProbeReport,
    /// The same of images that had no part in the calibration.
    pub(super) validation_error_mm: Option<ProbeReport>,
    /// Whether these are the last third of the recording, compared with a calibration from the
    /// others.
    pub(super) validation_is_split: bool,
    pub(super) limit_mm: f64,
    pub(super) frames: Frames,
    pub(super) condition: f64,
    /// The least known combinations of parameters with their errors, in typical sizes.
    pub(super) least_known: Vec<(String, f64)>,
    /// Positive if poses come later than images.
    pub(super) lag_s: f64,
    pub(super) lag_se_s: f64,
    /// Correlation length of the scatter, images.
    pub(super) scatter_lasts_pictures: f64,
    pub(super) scatter: Scattered,
    /// The frame in which the target rests.
    pub(super) frame: String,
    pub(super) target: Rests,
    /// Predicted error of pixel positions, one standard deviation, by the covariance: rows of
    /// numbers over the image, from its first pixels to its last.
    pub(super) predicted_error_mm: Vec<Vec<f64>>,
    /// The same at the image's centre, and at its worst corner.
    pub(super) predicted_ends_mm: [f64; 2],
    /// Part of the image in which to show the target next.
    pub(super) next_view: String,
    /// Change of the result when parts of the recording are left out.
    pub(super) reproducibility_mm: Option<Reproducibility>,
    pub(super) pictures: Vec<PictureReport>,
    #[serde(rename = "looked_s")]
    pub(super) searched_s: f64,
    pub(super) solved_s: f64,
}

/// Input files.
#[derive(Debug, Serialize)]
pub(super) struct Inputs {
    pub(super) input: Input,
    pub(super) stylus_tip: Option<Input>,
    pub(super) validation: Option<Input>,
}

impl Inputs {
    /// Returns the present inputs.
    pub(super) fn all(&self) -> impl Iterator<Item = &Input> {
        [Some(&self.input), self.stylus_tip.as_ref(), self.validation.as_ref()].into_iter().flatten()
    }
}

/// Standard deviations.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Scattered {
    Point { turn_deg: f64, along_u_v_and_normal_mm: [f64; 3] },
    Plane { turn_deg: f64, position_mm: f64, line_px: f64 },
}

/// Position of the target.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Rests {
    PointMm([f64; 3]),
    Plane { normal: [f64; 3], distance_mm: f64 },
}

impl Scattered {
    fn of(scatter: &Scatter) -> Self {
        match *scatter {
            Scatter::Point { turn_rad, along_mm } => {
                Self::Point { turn_deg: turn_rad.to_degrees(), along_u_v_and_normal_mm: along_mm }
            }
            Scatter::Plane { turn_rad, position_mm, line_px } => {
                Self::Plane { turn_deg: turn_rad.to_degrees(), position_mm, line_px }
            }
        }
    }

    /// Formats the scatter for people.
    pub(super) fn words(&self) -> String {
        match self {
            Self::Point { along_u_v_and_normal_mm: [u, v, normal], turn_deg } => format!(
                "{u:.3} and {v:.3} mm along u and v, {normal:.3} across the image, sensors' turns {turn_deg:.3}°"
            ),
            Self::Plane { position_mm, turn_deg, line_px } => {
                format!("sensors {position_mm:.3} mm and {turn_deg:.3}°, the line {line_px:.2} px")
            }
        }
    }
}

impl Rests {
    fn of(place: Place) -> Self {
        match place {
            Place::Point(at) => Self::PointMm(at.to_array()),
            Place::Plane { normal, distance_mm } => Self::Plane { normal: normal.to_array(), distance_mm },
        }
    }

    /// Formats the position for people.
    pub(super) fn words(&self, frame: &str) -> String {
        match self {
            Self::PointMm(at) => format!("the target rests at {} mm in {frame}", place((*at).into())),
            Self::Plane { normal, distance_mm } => {
                format!(
                    "the target rests {distance_mm:.3} mm from the origin of {frame}, across {}",
                    place((*normal).into())
                )
            }
        }
    }
}

#[derive(Debug, Serialize)]
pub(super) struct PictureReport {
    pub(super) frame: usize,
    pub(super) outcome: &'static str,
    pub(super) seen_px: Vec<[f64; 2]>,
    pub(super) expected_px: Vec<[f64; 2]>,
    pub(super) off_mm: Vec<f64>,
    #[serde(skip)]
    pub(super) used: bool,
}

impl Report {
    pub(super) fn new(found: &Calibration, inputs: Inputs, method: Method, frame: String, limit_mm: f64) -> Self {
        let refined = &found.refined;
        let pictures = found.pictures.iter().map(|picture| PictureReport {
            frame: picture.frame,
            outcome: word(picture.outcome, UNSEEN),
            seen_px: picture.seen_px.iter().map(|px| px.to_array()).collect(),
            expected_px: picture.expected_px.iter().map(|px| px.to_array()).collect(),
            off_mm: picture.off_mm.clone(),
            used: picture.outcome == Outcome::Used,
        });
        let directions = refined.solution().directions();
        Self {
            kind: "probe",
            method: method.name(),
            inputs,
            image_to_probe: rows(refined.plane.affine()),
            image_size_px: found.size_px,
            pixel_mm: refined.plane.pixel_mm(),
            error_mm: (&found.errors).into(),
            validation_error_mm: found.validation.as_ref().map(ProbeReport::from),
            validation_is_split: found.split,
            limit_mm,
            frames: frames(found),
            condition: refined.condition(),
            least_known: directions.iter().take(3).map(|one| (one.to_string(), one.sd)).collect(),
            lag_s: refined.lag_s,
            lag_se_s: refined.lag_se_s,
            scatter_lasts_pictures: refined.lasting,
            scatter: Scattered::of(&refined.scatter),
            frame,
            target: Rests::of(found.place()),
            predicted_error_mm: found.predicted_mm(LATTICE),
            predicted_ends_mm: ends(found),
            next_view: next(found),
            reproducibility_mm: None,
            pictures: pictures.collect(),
            searched_s: 0.0,
            solved_s: 0.0,
        }
    }

    pub(super) fn with_reproducibility(self, reproducibility_mm: Option<Reproducibility>) -> Self {
        Self { reproducibility_mm, ..self }
    }

    pub(super) fn with_times(self, searched_s: f64, solved_s: f64) -> Self {
        Self { searched_s, solved_s, ..self }
    }
}

fn frames(found: &Calibration) -> Frames {
    Frames::of(found.pictures.iter().map(|picture| picture.outcome), UNSEEN)
}

/// Returns the most helpful next view: the target at the least known corner.
fn next(found: &Calibration) -> String {
    let [u, v] = found.size_px.map(|n| f64::from(n) - 1.0);
    let corners =
        [("upper left", [0.0, 0.0]), ("upper right", [u, 0.0]), ("lower left", [0.0, v]), ("lower right", [u, v])];
    let known = corners.map(|(name, px)| (name, found.refined.predicted_mm(DVec2::from_array(px))));
    let (name, mm) = known.into_iter().fold(("", 0.0), |worst, one| if one.1 > worst.1 { one } else { worst });
    format!("bring the target to the image's {name} corner, which is known least ({mm:.2} mm)")
}

/// Formats the result for people.
pub(super) fn text(found: &Calibration, method: Method, frame: &str) -> String {
    let mut text = String::new();
    let refined = &found.refined;
    let [size_u, size_v] = refined.plane.pixel_mm();
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "{}; a pixel is {size_u:.5} × {size_v:.5} mm",
        frames(found).text(&format!(" of {}", method.title()))
    );
    let mut line = |what: &str, Errors { mean, sd, rms, max, .. }: &Errors| {
        let _ = writeln!(text, "  {what:44} {mean:.3} ± {sd:.3} mm (rms {rms:.3}, at most {max:.3})");
    };
    line("distance from the target", &found.errors);
    if let Some(errors) = &found.validation {
        let of = if found.split { "the last third" } else { "the second recording" };
        line(&format!("the same on validation frames ({of})"), errors);
    }
    let [centre, corner] = ends(found);
    let _ = writeln!(
        text,
        "predicted error (one standard deviation): {centre:.3} mm at the image's centre, {corner:.3} at its worst corner; condition {:.1}",
        refined.condition()
    );
    text += &lag_line(refined.lag_s, refined.lag_se_s);
    let _ =
        writeln!(text, "noise: {}\n{}", Scattered::of(&refined.scatter).words(), Rests::of(found.place()).words(frame));
    let _ = writeln!(text, "next view: {}", next(found));
    text
}

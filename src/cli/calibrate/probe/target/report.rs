//! Report of a probe's calibration by a point, a stylus or a plane.

use std::fmt::Write as _;

use glam::DVec2;
use serde::Serialize;

use calibration::probe::calibrate::Outcome;
use calibration::probe::errors::Errors;
use calibration::probe::target::refine::Scatter;
use calibration::probe::target::{Calibration, Place};

use super::super::shared::{Frames, Inputs, LATTICE, Numbers, Shared, lag_line, word};
use crate::app::calibrate::outputs::place;
use crate::app::calibrate::probe::target::Found;
use crate::app::calibrate::probe::target::quality::ends;
use crate::app::calibrate::probe::{Method, Options, Reproducibility};

/// Name of the outcome of an image without a detection.
const UNSEEN: &str = "nothing seen";

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    #[serde(flatten)]
    pub(super) inputs: Inputs,
    #[serde(flatten)]
    pub(super) shared: Shared,
    /// The least known combinations of parameters with their errors, in typical sizes.
    pub(super) least_known: Vec<(String, f64)>,
    pub(super) lag_se_s: f64,
    pub(super) scatter: Scattered,
    /// The frame in which the target rests.
    pub(super) frame: String,
    pub(super) target: Rests,
    /// Part of the image in which to show the target next.
    pub(super) next_view: String,
    pub(super) pictures: Vec<PictureReport>,
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
    pub(super) fn new(
        options: &Options,
        inputs: Inputs,
        done: &Found,
        reproducibility: Option<Reproducibility>,
    ) -> Self {
        let Found { found, reference, times_s, .. } = done;
        let refined = &found.refined;
        let pictures = found.pictures.iter().map(|picture| PictureReport {
            frame: picture.frame,
            outcome: word(picture.outcome, UNSEEN),
            seen_px: picture.seen_px.iter().map(|px| px.to_array()).collect(),
            expected_px: picture.expected_px.iter().map(|px| px.to_array()).collect(),
            off_mm: picture.off_mm.clone(),
            used: picture.outcome == Outcome::Used,
        });
        let numbers = Numbers {
            plane: &refined.plane,
            size_px: found.size_px,
            errors: &found.errors,
            validation: found.validation.as_ref(),
            is_split: found.split,
            frames: frames(found),
            condition: refined.condition(),
            lag_s: refined.lag_s,
            lasting: refined.lasting,
            predicted_mm: found.predicted_mm(LATTICE),
            ends_mm: ends(found),
            reproducibility,
            times_s: *times_s,
        };
        let directions = refined.solution().directions();
        Self {
            inputs,
            shared: Shared::new(options, numbers),
            least_known: directions.iter().take(3).map(|one| (one.to_string(), one.sd)).collect(),
            lag_se_s: refined.lag_se_s,
            scatter: Scattered::of(&refined.scatter),
            frame: reference.clone(),
            target: Rests::of(found.place()),
            next_view: next(found),
            pictures: pictures.collect(),
        }
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

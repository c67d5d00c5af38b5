//! What is said of a probe's calibration by a point, a stylus or a plane.

use std::fmt::Write as _;

use calibration::probe::errors::Errors;
use calibration::probe::target::refine::Scatter;
use calibration::probe::target::{Calibration, Place};
use serde::Serialize;

use super::super::super::outputs::{Input, place, rows};
use super::super::Method;
use super::super::report::{Frames, LATTICE, Told, lag_line, word};
use super::ends;

/// What a picture in which nothing is seen is called.
const UNSEEN: &str = "nothing seen";

/// What is said of a result. The names say the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    method: &'static str,
    input: Option<Input>,
    stylus_tip: Option<Input>,
    validation: Option<Input>,
    /// Row major: pixels of the picture in MF orientation to mm.
    image_to_probe: [f64; 16],
    image_size_px: [u32; 2],
    pixel_mm: [f64; 2],
    /// Distances of what is seen from where the target is.
    error_mm: Told,
    /// The same of pictures that had no part in the calibration.
    validation_error_mm: Option<Told>,
    /// Whether these are the last third of the recording, held against a calibration from the others.
    validation_is_split: bool,
    limit_mm: f64,
    frames: Frames,
    condition: f64,
    /// Combinations of parameters that are known least, and how well, in typical sizes.
    least_known: Vec<(String, f64)>,
    /// Above 0: poses come later than pictures.
    lag_s: f64,
    lag_se_s: f64,
    /// For how many pictures what scatters them lasts.
    scatter_lasts_pictures: f64,
    scatter: Scattered,
    /// The frame in which the target rests.
    frame: String,
    target: Rests,
    /// One standard deviation of where a pixel lies, by the covariance: rows of numbers over the picture, from its first pixels to its last.
    predicted_error_mm: Vec<Vec<f64>>,
    /// The same in the middle of the picture, and in its worst corner.
    predicted_ends_mm: [f64; 2],
    pictures: Vec<ToldPicture>,
    looked_s: f64,
    solved_s: f64,
}

/// Standard deviations.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Scattered {
    Point { turn_deg: f64, along_u_v_and_normal_mm: [f64; 3] },
    Plane { turn_deg: f64, position_mm: f64, line_px: f64 },
}

/// Where the target is.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Rests {
    PointMm([f64; 3]),
    Plane { normal: [f64; 3], distance_mm: f64 },
}

#[derive(Debug, Serialize)]
struct ToldPicture {
    frame: usize,
    outcome: &'static str,
    seen_px: Vec<[f64; 2]>,
    off_mm: Vec<f64>,
}

impl Report {
    pub(super) fn new(found: &Calibration, method: Method, frame: String, limit_mm: f64) -> Self {
        let refined = &found.refined;
        let scatter = match refined.scatter {
            Scatter::Point { turn_rad, along_mm } => {
                Scattered::Point { turn_deg: turn_rad.to_degrees(), along_u_v_and_normal_mm: along_mm }
            }
            Scatter::Plane { turn_rad, position_mm, line_px } => {
                Scattered::Plane { turn_deg: turn_rad.to_degrees(), position_mm, line_px }
            }
        };
        let target = match found.place() {
            Place::Point(at) => Rests::PointMm(at.to_array()),
            Place::Plane { normal, distance_mm } => Rests::Plane { normal: normal.to_array(), distance_mm },
        };
        let pictures = found.pictures.iter().map(|picture| ToldPicture {
            frame: picture.frame,
            outcome: word(picture.outcome, UNSEEN),
            seen_px: picture.seen_px.iter().map(|px| px.to_array()).collect(),
            off_mm: picture.off_mm.clone(),
        });
        let directions = refined.solution().directions();
        Self {
            kind: "probe",
            method: method.name(),
            input: None,
            stylus_tip: None,
            validation: None,
            image_to_probe: rows(refined.plane.affine()),
            image_size_px: found.size_px,
            pixel_mm: refined.plane.pixel_mm(),
            error_mm: (&found.errors).into(),
            validation_error_mm: found.validation.as_ref().map(Told::from),
            validation_is_split: found.split,
            limit_mm,
            frames: frames(found),
            condition: refined.condition(),
            least_known: directions.iter().take(3).map(|one| (one.to_string(), one.sd)).collect(),
            lag_s: refined.lag_s,
            lag_se_s: refined.lag_se_s,
            scatter_lasts_pictures: refined.lasting,
            scatter,
            frame,
            target,
            predicted_error_mm: found.predicted_mm(LATTICE),
            predicted_ends_mm: ends(found),
            pictures: pictures.collect(),
            looked_s: 0.0,
            solved_s: 0.0,
        }
    }

    pub(super) fn from(self, input: Input, stylus_tip: Option<Input>, validation: Option<Input>) -> Self {
        Self { input: Some(input), stylus_tip, validation, ..self }
    }

    pub(super) fn took(self, looked_s: f64, solved_s: f64) -> Self {
        Self { looked_s, solved_s, ..self }
    }
}

fn frames(found: &Calibration) -> Frames {
    Frames::of(found.pictures.iter().map(|picture| picture.outcome), UNSEEN)
}

/// For people.
pub(super) fn text(found: &Calibration, method: Method, frame: &str) -> String {
    let mut text = String::new();
    let refined = &found.refined;
    let [size_u, size_v] = refined.plane.pixel_mm();
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "{}; a pixel is {size_u:.5} × {size_v:.5} mm",
        frames(found).told(&format!(" of {}", method.title()))
    );
    let mut line = |what: &str, Errors { mean, sd, rms, max, .. }: &Errors| {
        let _ = writeln!(text, "  {what:44} {mean:.3} ± {sd:.3} mm (rms {rms:.3}, at most {max:.3})");
    };
    line("from where it rests", &found.errors);
    if let Some(errors) = &found.validation {
        let of = if found.split { "the last third, by the others" } else { "the second recording" };
        line(&format!("pictures that had no part ({of})"), errors);
    }
    let [centre, corner] = ends(found);
    let _ = writeln!(
        text,
        "predicted error (one standard deviation): {centre:.3} mm in the middle of the picture, {corner:.3} in its worst corner; condition {:.1}",
        refined.condition()
    );
    text += &lag_line(refined.lag_s, refined.lag_se_s);
    let _ = match refined.scatter {
        Scatter::Point { along_mm: [u, v, normal], turn_rad } => writeln!(
            text,
            "noise: {u:.3} and {v:.3} mm along u and v, {normal:.3} across the picture, sensors' turns {:.3}°",
            turn_rad.to_degrees()
        ),
        Scatter::Plane { position_mm, turn_rad, line_px } => writeln!(
            text,
            "noise: sensors {position_mm:.3} mm and {:.3}°, the line {line_px:.2} px",
            turn_rad.to_degrees()
        ),
    };
    let _ = match found.place() {
        Place::Point(at) => writeln!(text, "it rests at {} mm in {frame}", place(at)),
        Place::Plane { normal, distance_mm } => {
            writeln!(text, "it rests {distance_mm:.3} mm from the origin of {frame}, across {}", place(normal))
        }
    };
    text
}

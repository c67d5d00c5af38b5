//! What is said of a probe's calibration.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use calibration::phantom::file::Registration;
use calibration::probe::calibrate::Outcome;
use calibration::probe::errors::Errors;
use calibration::probe::{Calibration, Layout};
use glam::DVec2;
use serde::Serialize;

use super::super::outputs::{Input, rows};

/// Numbers along each axis of the lattice on which errors are predicted.
const LATTICE: usize = 5;

/// What is said of a result. The names say the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    kind: &'static str,
    method: &'static str,
    input: Input,
    phantom: Input,
    validation: Option<Input>,
    /// Row major: pixels of the picture in MF orientation to mm.
    image_to_probe: [f64; 16],
    image_size_px: [u32; 2],
    pixel_mm: [f64; 2],
    /// Of middle wires, PLUS's definition, at the lag and with the registration that were found.
    error_mm: Told,
    /// Of all wires: distance of dots' places from their wires.
    wire_error_mm: Told,
    /// Of pictures that had no part in the calibration.
    validation_error_mm: Option<Told>,
    validation_wire_error_mm: Option<Told>,
    /// Of the same pictures, as if the tracker had no lag and the registration were as given.
    validation_error_as_given_mm: Option<Told>,
    /// Whether the validation's pictures are the last third of the recording, held against a calibration from the others.
    validation_is_split: bool,
    frames: Frames,
    condition: f64,
    /// Above 0: poses come later than pictures.
    lag_s: f64,
    lag_sd_s: f64,
    /// For how many pictures what scatters them lasts.
    scatter_lasts_pictures: f64,
    /// Standard deviations of what scatters dots about their wires.
    scatter: Scattered,
    /// Row major, as it fits best.
    phantom_to_reference: [f64; 16],
    registration_change_deg: f64,
    registration_change_mm: f64,
    registration_error_mm: Option<f64>,
    /// One standard deviation of where a pixel lies, by the covariance: rows of numbers over the picture, from its first pixels to its last.
    predicted_error_mm: Vec<Vec<f64>>,
    pictures: Vec<ToldPicture>,
    looked_s: f64,
    solved_s: f64,
}

#[derive(Debug, Serialize)]
struct Told {
    mean: f64,
    sd: f64,
    rms: f64,
    max: f64,
    /// Mean of the least 95 %: what PLUS prints.
    mean_of_95: f64,
    count: usize,
    /// Each picture's mean …
    per_frame: Vec<f64>,
    /// … and its number.
    frame: Vec<usize>,
}

impl From<&Errors> for Told {
    fn from(errors: &Errors) -> Self {
        let Errors { mean, sd, rms, max, mean_of_95, count, per_frame } = errors;
        let (frame, per_frame) = per_frame.iter().copied().unzip();
        Self { mean: *mean, sd: *sd, rms: *rms, max: *max, mean_of_95: *mean_of_95, count: *count, per_frame, frame }
    }
}

#[derive(Debug, Serialize)]
struct Frames {
    total: usize,
    used: usize,
    failed: usize,
    /// Those that failed, by reason.
    reasons: BTreeMap<&'static str, usize>,
}

#[derive(Debug, Serialize)]
struct Scattered {
    position_mm: f64,
    turn_deg: f64,
    dot_px: [f64; 2],
}

#[derive(Debug, Serialize)]
struct ToldPicture {
    frame: usize,
    outcome: &'static str,
    dots: Vec<ToldDot>,
}

#[derive(Debug, Serialize)]
struct ToldDot {
    wire: String,
    seen_px: [f64; 2],
    expected_px: [f64; 2],
    off_mm: f64,
    used: bool,
}

/// What became of a picture, in a word or two.
fn word(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Used => "used",
        Outcome::NoPose => "no valid pose",
        Outcome::NoWires => "wires not recognised",
        Outcome::NoPoseAtLag => "no pose after the lag",
        Outcome::Contradicted => "contradicted by the others",
    }
}

fn frames(found: &Calibration) -> Frames {
    let mut reasons = BTreeMap::new();
    for picture in found.pictures.iter().filter(|picture| picture.outcome != Outcome::Used) {
        *reasons.entry(word(picture.outcome)).or_default() += 1;
    }
    let (total, used) = (found.pictures.len(), found.used());
    Frames { total, used, failed: total - used, reasons }
}

impl Report {
    pub(super) fn new(
        found: &Calibration,
        layout: &Layout,
        input: Input,
        phantom: Input,
        validation: Option<Input>,
        given: &Registration,
    ) -> Self {
        let refined = &found.refined;
        let wires = layout.geometry().wires();
        let [middle, all] = &found.errors;
        let held = found.validation.as_ref();
        let (registration_change_deg, registration_change_mm) = refined.registration_change();
        let pictures = found.pictures.iter().map(|picture| ToldPicture {
            frame: picture.frame,
            outcome: word(picture.outcome),
            dots: (picture.dots.iter())
                .map(|dot| ToldDot {
                    wire: wires[dot.wire].name.clone(),
                    seen_px: dot.seen_px.to_array(),
                    expected_px: dot.expected_px.to_array(),
                    off_mm: dot.off_mm,
                    used: dot.used,
                })
                .collect(),
        });
        Self {
            kind: "probe",
            method: "nwire",
            input,
            phantom,
            validation,
            image_to_probe: rows(refined.plane.affine()),
            image_size_px: found.size_px,
            pixel_mm: refined.plane.pixel_mm(),
            error_mm: middle.into(),
            wire_error_mm: all.into(),
            validation_error_mm: held.map(|[middle, _]| middle.into()),
            validation_wire_error_mm: held.map(|[_, all]| all.into()),
            validation_error_as_given_mm: found.validation_as_given.as_ref().map(Told::from),
            validation_is_split: found.split,
            frames: frames(found),
            condition: refined.condition(),
            lag_s: refined.lag_s,
            lag_sd_s: refined.lag_sd_s,
            scatter_lasts_pictures: refined.lasting,
            scatter: Scattered {
                position_mm: refined.scatter.position_mm,
                turn_deg: refined.scatter.turn_rad.to_degrees(),
                dot_px: refined.scatter.dot_px,
            },
            phantom_to_reference: rows(refined.registration.reference_from_phantom.affine()),
            registration_change_deg,
            registration_change_mm,
            registration_error_mm: given.error_mm,
            predicted_error_mm: found.predicted_mm(LATTICE),
            pictures: pictures.collect(),
            looked_s: 0.0,
            solved_s: 0.0,
        }
    }

    pub(super) fn took(self, looked_s: f64, solved_s: f64) -> Self {
        Self { looked_s, solved_s, ..self }
    }
}

/// For people.
pub(super) fn text(found: &Calibration, layout: &Layout) -> String {
    let mut text = String::new();
    let refined = &found.refined;
    let frames = frames(found);
    let [size_u, size_v] = refined.plane.pixel_mm();
    let reasons: Vec<String> = frames.reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
    let reasons = if reasons.is_empty() { String::new() } else { format!(" ({})", reasons.join(", ")) };
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "{} of {} pictures of the phantom {} used{reasons}; a pixel is {size_u:.5} × {size_v:.5} mm",
        frames.used,
        frames.total,
        layout.geometry().name()
    );
    let line = |text: &mut String, what: &str, errors: &Errors| {
        let Errors { mean, sd, rms, max, mean_of_95, .. } = errors;
        let _ = writeln!(
            text,
            "  {what:44} {mean:.3} ± {sd:.3} mm (rms {rms:.3}, at most {max:.3}; best 95 %: {mean_of_95:.3})"
        );
    };
    let _ = writeln!(text, "errors:");
    line(&mut text, "middle wires (PLUS's definition)", &found.errors[0]);
    line(&mut text, "all wires", &found.errors[1]);
    if let Some([middle, all]) = &found.validation {
        let _ = writeln!(
            text,
            "errors on pictures that had no part{}:",
            if found.split { " (the last third, by a calibration from the others)" } else { "" }
        );
        line(&mut text, "middle wires (PLUS's definition)", middle);
        line(&mut text, "all wires", all);
    }
    if let Some(errors) = &found.validation_as_given {
        line(&mut text, "middle wires, lag 0, registration as given", errors);
    }
    let [u, v] = found.size_px.map(|n| f64::from(n) - 1.0);
    let corners = [[0.0, 0.0], [u, 0.0], [0.0, v], [u, v]].map(|px| refined.predicted_mm(DVec2::from_array(px)));
    let _ = writeln!(
        text,
        "predicted error (one standard deviation): {:.3} mm in the middle of the picture, {:.3} in its worst corner; condition {:.1}",
        refined.predicted_mm(DVec2::new(0.5 * u, 0.5 * v)),
        corners.into_iter().fold(0.0, f64::max),
        refined.condition()
    );
    let (lag_ms, sd_ms) = (1e3 * refined.lag_s, 1e3 * refined.lag_sd_s);
    if refined.lag_sd_s > 0.0 {
        let side = if lag_ms > 0.0 { "later" } else { "earlier" };
        let _ = writeln!(
            text,
            "poses come {:.1} ± {sd_ms:.1} ms {side} than pictures: the tracker's latency_ms has to be {lag_ms:.1} more than the video's",
            lag_ms.abs()
        );
    }
    let (turn, shift) = refined.registration_change();
    let _ = writeln!(
        text,
        "noise: sensors {:.3} mm and {:.3}°, dots {:.2} and {:.2} px along u and v; the phantom fits best {shift:.2} mm and {turn:.2}° from where it was registered",
        refined.scatter.position_mm,
        refined.scatter.turn_rad.to_degrees(),
        refined.scatter.dot_px[0],
        refined.scatter.dot_px[1]
    );
    text
}

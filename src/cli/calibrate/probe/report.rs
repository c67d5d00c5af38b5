//! Report of a probe's calibration by an N-wire phantom.

use std::fmt::Write as _;

use glam::DVec2;
use serde::Serialize;

use calibration::probe::errors::Errors;
use calibration::probe::next::{Candidate, NextView};
use calibration::probe::{Calibration, Layout};

use super::shared::{Frames, Inputs, LATTICE, Numbers, ProbeReport, Shared, lag_line, word};
use crate::app::calibrate::outputs::rows;
use crate::app::calibrate::probe::quality::predicted_ends;
use crate::app::calibrate::probe::{Found, Lag, Options, Reproducibility};

/// Explains the viewing direction that left and right refer to.
pub(super) const YOU: &str = "seen with the probe's marked side at the right and its face below";

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    #[serde(flatten)]
    pub(super) inputs: Inputs,
    #[serde(flatten)]
    pub(super) shared: Shared,
    /// Error of all wires: distance of the dots' positions from their wires.
    pub(super) wire_error_mm: ProbeReport,
    pub(super) validation_wire_error_mm: Option<ProbeReport>,
    /// Error of the validation's middle wires, with zero lag and the registration as given.
    pub(super) validation_error_as_given_mm: Option<ProbeReport>,
    pub(super) lag_sd_s: f64,
    /// Resulting latencies, if a lag was sought.
    pub(super) latency: Option<Lag>,
    /// Standard deviations of the dots' scatter about their wires.
    pub(super) scatter: Scattered,
    /// Row major, after the fit.
    pub(super) phantom_to_reference: [f64; 16],
    pub(super) registration_change_deg: f64,
    pub(super) registration_change_mm: f64,
    pub(super) registration_error_mm: Option<f64>,
    /// View to take next.
    pub(super) next_view: Option<Next>,
    /// Used dots of each wire, relative to the wire's expected position.
    pub(super) wires: Vec<WireReport>,
    pub(super) pictures: Vec<PictureReport>,
}

#[derive(Debug, Serialize)]
pub(super) struct Scattered {
    pub(super) position_mm: f64,
    pub(super) turn_deg: f64,
    pub(super) dot_px: [f64; 2],
}

/// The view that reduces the largest predicted error most.
#[derive(Debug, Serialize)]
pub(super) struct Next {
    /// Present largest predicted error over the image's corners and centre.
    pub(super) error_mm: f64,
    /// Assumed number of further images of a view.
    pub(super) pictures: usize,
    /// Instruction in words, or the statement that no view helps.
    pub(super) words: String,
    /// Whether the first view gains a relevant amount.
    pub(super) helps: bool,
    /// The best first.
    pub(super) views: Vec<View>,
}

/// A view and its effect.
#[derive(Debug, Serialize)]
pub(super) struct View {
    /// Movement of the probe from its mean pose over all images.
    #[serde(rename = "move")]
    pub(super) way: &'static str,
    /// Its amount, with the sign of the words.
    pub(super) by: f64,
    /// Its unit.
    pub(super) unit: &'static str,
    pub(super) words: String,
    /// The largest predicted error then.
    pub(super) error_mm: f64,
    /// Row major: pose of the probe's sensor in the phantom's frame then.
    pub(super) probe_to_phantom: [f64; 16],
}

impl From<&NextView> for Next {
    fn from(next: &NextView) -> Self {
        let view = |candidate: &Candidate| {
            let (way, unit) = candidate.way.name();
            let Candidate { by, after_mm, phantom_from_probe, .. } = candidate;
            let probe_to_phantom = phantom_from_probe.to_rows();
            View { way, by: *by, unit, words: candidate.to_string(), error_mm: *after_mm, probe_to_phantom }
        };
        Self {
            error_mm: next.now_mm,
            pictures: next.pictures,
            words: next.to_string(),
            helps: next.best().is_some(),
            views: next.ranked.iter().map(view).collect(),
        }
    }
}

/// Formats the view to take next, for people.
pub(super) fn next_line(next: &NextView) -> String {
    let seen = if next.best().is_some() { format!(" ({YOU})") } else { String::new() };
    format!("next view: {next}{seen}\n")
}

#[derive(Debug, Serialize)]
pub(super) struct WireReport {
    pub(super) wire: String,
    pub(super) dots: usize,
    pub(super) mean_mm: f64,
    pub(super) rms_mm: f64,
    pub(super) max_mm: f64,
    /// Mean of seen minus expected position.
    pub(super) bias_px: [f64; 2],
}

#[derive(Debug, Serialize)]
pub(super) struct PictureReport {
    pub(super) frame: usize,
    pub(super) outcome: &'static str,
    pub(super) dots: Vec<DotReport>,
}

#[derive(Debug, Serialize)]
pub(super) struct DotReport {
    pub(super) wire: String,
    pub(super) seen_px: [f64; 2],
    pub(super) expected_px: [f64; 2],
    pub(super) off_mm: f64,
    pub(super) used: bool,
}

/// Returns a wire's dots; `None` if none was used.
fn of_wire(found: &Calibration, wire: usize, name: &str) -> Option<WireReport> {
    let dots: Vec<_> =
        found.pictures.iter().flat_map(|picture| &picture.dots).filter(|dot| dot.used && dot.wire == wire).collect();
    let count = dots.len() as f64;
    let bias = dots.iter().map(|dot| dot.seen_px - dot.expected_px).sum::<DVec2>() / count;
    (!dots.is_empty()).then(|| WireReport {
        wire: name.to_owned(),
        dots: dots.len(),
        mean_mm: dots.iter().map(|dot| dot.off_mm).sum::<f64>() / count,
        rms_mm: (dots.iter().map(|dot| dot.off_mm * dot.off_mm).sum::<f64>() / count).sqrt(),
        max_mm: dots.iter().map(|dot| dot.off_mm).fold(0.0, f64::max),
        bias_px: bias.to_array(),
    })
}

/// Name of the outcome of an image without recognised wires.
const UNSEEN: &str = "wires not recognised";

fn frames(found: &Calibration) -> Frames {
    Frames::of(found.pictures.iter().map(|picture| picture.outcome), UNSEEN)
}

impl Report {
    /// Returns the report of a result; `next` is the view to take next, if any.
    pub(super) fn new(
        options: &Options,
        inputs: Inputs,
        done: &Found,
        reproducibility: Option<Reproducibility>,
        next: Option<&NextView>,
    ) -> Self {
        let Found { layout, held, found, times_s, .. } = done;
        let refined = &found.refined;
        let wires = layout.geometry().wires();
        let held_out = found.validation.as_ref();
        let (registration_change_deg, registration_change_mm) = refined.registration_change();
        let pictures = found.pictures.iter().map(|picture| PictureReport {
            frame: picture.frame,
            outcome: word(picture.outcome, UNSEEN),
            dots: (picture.dots.iter())
                .map(|dot| DotReport {
                    wire: wires[dot.wire].name.clone(),
                    seen_px: dot.seen_px.to_array(),
                    expected_px: dot.expected_px.to_array(),
                    off_mm: dot.off_mm,
                    used: dot.used,
                })
                .collect(),
        });
        let numbers = Numbers {
            plane: &refined.plane,
            size_px: found.size_px,
            errors: &found.errors[0],
            validation: held_out.map(|[middle, _]| middle),
            is_split: found.split,
            frames: frames(found),
            condition: refined.condition(),
            lag_s: refined.lag_s,
            lasting: refined.lasting,
            predicted_mm: found.predicted_mm(LATTICE),
            ends_mm: predicted_ends(found),
            reproducibility,
            times_s: *times_s,
        };
        Self {
            inputs,
            shared: Shared::new(options, numbers),
            wire_error_mm: (&found.errors[1]).into(),
            validation_wire_error_mm: held_out.map(|[_, all]| all.into()),
            validation_error_as_given_mm: found.validation_as_given.as_ref().map(ProbeReport::from),
            lag_sd_s: refined.lag_sd_s,
            latency: None,
            scatter: Scattered {
                position_mm: refined.scatter.position_mm,
                turn_deg: refined.scatter.turn_rad.to_degrees(),
                dot_px: refined.scatter.dot_px,
            },
            phantom_to_reference: rows(refined.registration.reference_from_phantom.affine()),
            registration_change_deg,
            registration_change_mm,
            registration_error_mm: held.error_mm,
            next_view: next.map(Next::from),
            wires: wires.iter().enumerate().filter_map(|(wire, about)| of_wire(found, wire, &about.name)).collect(),
            pictures: pictures.collect(),
        }
    }
}

/// Formats the result for people.
pub(super) fn text(found: &Calibration, layout: &Layout) -> String {
    let mut text = String::new();
    let refined = &found.refined;
    let frames = frames(found);
    let [size_u, size_v] = refined.plane.pixel_mm();
    // Writing to a string does not fail.
    let counts = frames.text(&format!(" of the phantom {}", layout.geometry().name()));
    let _ = writeln!(text, "{counts}; a pixel is {size_u:.5} × {size_v:.5} mm");
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
            "errors on validation frames{}:",
            if found.split { " (the last third, with a calibration from the others)" } else { "" }
        );
        line(&mut text, "middle wires (PLUS's definition)", middle);
        line(&mut text, "all wires", all);
    }
    if let Some(errors) = &found.validation_as_given {
        line(&mut text, "middle wires, lag 0, registration as given", errors);
    }
    let [centre, corner] = predicted_ends(found);
    let _ = writeln!(
        text,
        "predicted error (one standard deviation): {:.3} mm at the image's centre, {:.3} at its worst corner; condition {:.1}",
        centre,
        corner,
        refined.condition()
    );
    text += &lag_line(refined.lag_s, refined.lag_sd_s);
    let (turn, shift) = refined.registration_change();
    let _ = writeln!(
        text,
        "noise: sensors {:.3} mm and {:.3}°, dots {:.2} and {:.2} px along u and v; the phantom fits best {shift:.2} mm and {turn:.2}° off its registration",
        refined.scatter.position_mm,
        refined.scatter.turn_rad.to_degrees(),
        refined.scatter.dot_px[0],
        refined.scatter.dot_px[1]
    );
    text
}

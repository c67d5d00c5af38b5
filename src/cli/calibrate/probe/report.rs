//! Report of a probe's calibration.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::DVec2;
use serde::Serialize;

use calibration::phantom::file::Registration;
use calibration::probe::calibrate::Outcome;
use calibration::probe::errors::Errors;
use calibration::probe::next::{Candidate, NextView};
use calibration::probe::{Calibration, Layout};

use crate::app::calibrate::outputs::{Input, rows};
use crate::app::calibrate::probe::quality::predicted_ends;
use crate::app::calibrate::probe::{Lag, Reproducibility};

/// Explains the viewing direction that left and right refer to.
pub(super) const YOU: &str = "seen with the probe's marked side at the right and its face below";
/// Points along each axis of the grid of predicted errors.
pub(super) const LATTICE: usize = 9;

/// Report of a result. The names contain the units.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) kind: &'static str,
    pub(super) method: &'static str,
    pub(super) input: Input,
    pub(super) phantom: Input,
    pub(super) validation: Option<Input>,
    /// Row major: pixels of the image in MF orientation to mm.
    pub(super) image_to_probe: [f64; 16],
    pub(super) image_size_px: [u32; 2],
    pub(super) pixel_mm: [f64; 2],
    /// Error of middle wires, by PLUS's definition, with the lag and the registration that were
    /// found.
    pub(super) error_mm: ProbeReport,
    /// Error of all wires: distance of the dots' positions from their wires.
    pub(super) wire_error_mm: ProbeReport,
    /// Error of images that had no part in the calibration.
    pub(super) validation_error_mm: Option<ProbeReport>,
    pub(super) validation_wire_error_mm: Option<ProbeReport>,
    /// Error of the same images, with zero lag and the registration as given.
    pub(super) validation_error_as_given_mm: Option<ProbeReport>,
    /// Whether the validation's images are the last third of the recording, compared with a
    /// calibration from the others.
    pub(super) validation_is_split: bool,
    pub(super) frames: Frames,
    pub(super) condition: f64,
    /// Positive if poses come later than images.
    pub(super) lag_s: f64,
    pub(super) lag_sd_s: f64,
    /// Resulting latencies, if a lag was sought.
    pub(super) latency: Option<Lag>,
    /// Correlation length of the scatter, images.
    pub(super) scatter_lasts_pictures: f64,
    /// Standard deviations of the dots' scatter about their wires.
    pub(super) scatter: Scattered,
    /// Row major, after the fit.
    pub(super) phantom_to_reference: [f64; 16],
    pub(super) registration_change_deg: f64,
    pub(super) registration_change_mm: f64,
    pub(super) registration_error_mm: Option<f64>,
    /// Predicted error of pixel positions, one standard deviation, by the covariance: rows of
    /// numbers over the image, from its first pixels to its last.
    pub(super) predicted_error_mm: Vec<Vec<f64>>,
    /// The same at the image's centre, and at its worst corner.
    pub(super) predicted_ends_mm: [f64; 2],
    /// Change of the result when parts of the recording are left out.
    pub(super) reproducibility_mm: Option<Reproducibility>,
    /// View to take next.
    pub(super) next_view: Option<Next>,
    /// Used dots of each wire, relative to the wire's expected position.
    pub(super) wires: Vec<WireReport>,
    pub(super) pictures: Vec<PictureReport>,
    #[serde(rename = "looked_s")]
    pub(super) searched_s: f64,
    pub(super) solved_s: f64,
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

fn frames(found: &Calibration) -> Frames {
    Frames::of(found.pictures.iter().map(|picture| picture.outcome), UNSEEN)
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
            validation_error_as_given_mm: found.validation_as_given.as_ref().map(ProbeReport::from),
            validation_is_split: found.split,
            frames: frames(found),
            condition: refined.condition(),
            lag_s: refined.lag_s,
            lag_sd_s: refined.lag_sd_s,
            latency: None,
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
            predicted_ends_mm: predicted_ends(found),
            reproducibility_mm: None,
            next_view: None,
            wires: wires.iter().enumerate().filter_map(|(wire, about)| of_wire(found, wire, &about.name)).collect(),
            pictures: pictures.collect(),
            searched_s: 0.0,
            solved_s: 0.0,
        }
    }

    pub(super) fn with_times(self, searched_s: f64, solved_s: f64) -> Self {
        Self { searched_s, solved_s, ..self }
    }

    pub(super) fn with_lag(self, latency: Option<Lag>) -> Self {
        Self { latency, ..self }
    }

    pub(super) fn with_reproducibility(self, reproducibility_mm: Option<Reproducibility>) -> Self {
        Self { reproducibility_mm, ..self }
    }

    pub(super) fn with_next(self, next: Option<&NextView>) -> Self {
        Self { next_view: next.map(Next::from), ..self }
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

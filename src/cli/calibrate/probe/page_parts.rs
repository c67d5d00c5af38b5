//! Common parts of the report pages of probe calibrations.

use glam::DVec2;

use export::page::Page;
use export::page::chart::Bars;
use export::page::plate::{Ink, Plate};

use super::shared::{Frames, Inputs, ProbeReport, Shared};

/// Magnification of residuals in the drawing.
const LONGER: f64 = 10.0;

/// Returns the images to show: the one with the median error, and the worst.
pub(super) fn listed_frames(errors: &ProbeReport) -> Vec<usize> {
    let mut by_error: Vec<(f64, usize)> = errors.per_frame.iter().copied().zip(errors.frame.iter().copied()).collect();
    by_error.sort_by(|a, b| a.0.total_cmp(&b.0));
    let places = [by_error.len() / 2, by_error.len().saturating_sub(1)];
    let mut frames: Vec<usize> = places.into_iter().filter_map(|at| Some(by_error.get(at)?.1)).collect();
    frames.dedup();
    frames
}

/// Begins a page: title, verdict, number of images, lag if it was sought, reproducibility. `what`
/// names the error of validation images; the lag's deviation is in s.
pub(super) fn begun(inputs: &Inputs, shared: &Shared, what: &str, lag_sd_s: f64) -> Page {
    let mut page = Page::new(&shared.heading(inputs));
    let held = shared.validation_error_mm.as_ref();
    let limit_mm = shared.limit_mm;
    let good = held.is_some_and(|errors| errors.mean <= limit_mm);
    let of = if shared.validation_is_split {
        "the last third, with a calibration from the others"
    } else {
        "a second recording"
    };
    let held = held.map_or_else(
        || "no frames were left for validation".to_owned(),
        |errors| format!("{:.2} mm {what} on validation frames ({of}; limit {limit_mm} mm)", errors.mean),
    );
    let word = if good { "Accepted" } else { "Not proven" };
    let [centre, corner] = shared.predicted_ends_mm;
    page.verdict(good, &format!("{word}: {held}. A point is known to {centre:.2} mm at the image's centre and {corner:.2} mm at its worst corner (one standard deviation)."));
    let Frames { used, total, reasons, .. } = &shared.frames;
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
    let reasons = if reasons.is_empty() { String::new() } else { format!("; not used: {}", reasons.join(", ")) };
    let [u, v] = shared.pixel_mm;
    page.paragraph(&format!("{used} of {total} frames were used{reasons}. A pixel is {u:.5} × {v:.5} mm."));
    if lag_sd_s > 0.0 {
        let side = if shared.lag_s > 0.0 { "later" } else { "earlier" };
        page.paragraph(&format!(
            "The tracker's poses come {:.1} ± {:.1} ms {side} than the frames.",
            1e3 * shared.lag_s.abs(),
            1e3 * lag_sd_s
        ));
    }
    if let Some(reproducibility) = &shared.reproducibility_mm {
        page.paragraph(&reproducibility.words());
    }
    page
}

/// Writes the errors as a table.
pub(super) fn errors(page: &mut Page, rows: &[(&str, Option<&ProbeReport>)]) {
    page.part("Errors, mm");
    let row = |(what, errors): &(&str, Option<&ProbeReport>)| {
        let errors = (*errors)?;
        let numbers = [errors.mean, errors.sd, errors.rms, errors.max, errors.mean_of_95].map(|x| format!("{x:.3}"));
        let ends = [(*what).to_owned(), errors.count.to_string()];
        let [what, count] = ends;
        Some([what].into_iter().chain(numbers).chain([count]).collect::<Vec<_>>())
    };
    let rows: Vec<Vec<String>> = rows.iter().filter_map(row).collect();
    page.table(&["", "mean", "sd", "rms", "largest", "best 95 %", "of"], &rows);
}

/// Draws the residuals over the image, from seen to expected position, and the predicted errors.
pub(super) fn over_the_picture(
    page: &mut Page,
    Shared { image_size_px: size_px, predicted_error_mm: predicted_mm, .. }: &Shared,
    (dots, what): (&[[DVec2; 2]], &str),
) {
    page.part(&format!("Residuals: distances of {what} from their calculated positions"));
    let [u, v] = size_px.map(|n| f64::from(n) - 1.0);
    let mut vectors = Plate::new(*size_px);
    vectors.outline(&[DVec2::ZERO, DVec2::new(u, 0.0), DVec2::new(u, v), DVec2::new(0.0, v)]);
    let (down, across) = (predicted_mm.len(), predicted_mm.first().map_or(0, Vec::len));
    let mut map = Plate::new(*size_px);
    map.map([across, down], &predicted_mm.concat(), "mm");
    for [seen, expected] in dots {
        vectors.vector(*expected, (*seen - *expected) * LONGER, Ink::Used);
        map.speck(*seen);
    }
    page.figures(&[
        (
            vectors.svg(&format!("residuals of all {what} over the image plane")),
            format!("Residuals of all used {what}, drawn {LONGER:.0} times as long. Neighbouring vectors of one direction are errors of the calibration; random directions are noise."),
        ),
        (
            map.svg(&format!("predicted error over the image plane, and positions of {what}")),
            format!("Predicted error of a point's position, one standard deviation, by the fit's covariance: small near {what}, larger away from them."),
        ),
    ]);
}

/// Draws each image's error, and those of a second recording.
pub(super) fn frame_by_frame(page: &mut Page, shared: &Shared, caption: &str) {
    page.part("Frame by frame");
    let mut bars = |errors: &ProbeReport, about: &str, caption: &str| {
        let limit = (errors.max * 4.0 > shared.limit_mm).then_some((shared.limit_mm, "limit of the mean"));
        let bars = Bars { values: &errors.per_frame, unit: "mm", along: "frames", limit };
        page.figure(&bars.svg(about), caption);
    };
    bars(&shared.error_mm, "error of each frame", caption);
    if let Some(held) = shared.validation_error_mm.as_ref().filter(|_| !shared.validation_is_split) {
        let caption = "The same for the second recording, which the calibration did not use.";
        bars(held, "error of each validation frame", caption);
    }
}

/// Writes a transform, row by row.
pub(super) fn matrix(page: &mut Page, what: &str, rows: &[f64; 16]) {
    page.paragraph(what);
    let rows = rows.chunks_exact(4).map(|row| row.iter().map(|x| format!("{x:.6}")).collect());
    page.table(&["", "", "", ""], &rows.collect::<Vec<_>>());
}

/// Writes the inputs and the program's version.
pub(super) fn made_from(page: &mut Page, inputs: &Inputs) {
    page.table(&["made from"], &inputs.all().map(|input| vec![input.name()]).collect::<Vec<_>>());
    page.note(concat!("sonoweave ", env!("CARGO_PKG_VERSION")));
}

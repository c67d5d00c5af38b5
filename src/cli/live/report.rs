//! Runs a session for a command, and reports its result.

use std::path::PathBuf;
use std::sync::Arc;

use config::bedside::Bedside;
use pipeline::session::Finished;

use super::terminal::Terminal;
use crate::app::input::name_of;
use crate::app::live::ended::Ended;
use crate::app::live::options::{Operator, SessionOptions};
use crate::app::live::outputs::Outputs;
use crate::app::live::session::{check_duration, session};
use crate::app::live::viewers::Display;
use crate::app::render::drawing::Over;
use crate::app::reporter::Reporter;
use crate::cli::Failure;
use crate::cli::progress::{Lines, say};
use crate::cli::smoothing::sentences;

/// Runs a session to its outputs, with the volume in the terminal unless it runs `headless` or
/// quietly. Returns the path of the last recording, if any.
///
/// # Errors
/// [`Failure`] when it cannot begin, or its outputs cannot be written.
pub(in crate::cli) fn run(
    bedside: &Bedside,
    options: &SessionOptions,
    headless: bool,
    outputs: &Outputs,
) -> Result<Option<PathBuf>, Failure> {
    check_duration(options.duration)?;
    outputs.check(bedside)?;
    bedside.calibrated().map_err(Failure::configuration)?;
    let terminal = if options.quiet || headless { None } else { Terminal::of(&bedside.picture) };
    let lines = Lines::new(options.quiet);
    let reporter = terminal.as_deref().map_or(&lines as &dyn Reporter, |terminal| terminal);
    let display = terminal.clone().map(|terminal| terminal as Arc<dyn Display>);
    let operator = Operator { reporter, display, keeps_picture: outputs.picture.is_some() };
    session(bedside, options, &operator, &|ended| {
        if let Some(terminal) = &terminal {
            terminal.leave();
        }
        leave(outputs, ended)
    })
}

/// Writes the requested files, and prints a report. For a replayed recording, the
/// statistics include the differences from it.
///
/// # Errors
/// [`Failure`]: the file that failed does not exist.
pub(in crate::cli) fn leave(outputs: &Outputs, ended: &Ended<'_>) -> Result<(), Failure> {
    let Ended { bedside, finished, replayed, .. } = ended;
    let Finished { outcome, drawn, status, recording, .. } = finished;
    print_line!("{}", status.ledger);
    if let Some(found) = status.distortion.filter(|found| found.frames > 0) {
        print_line!("metal distorted the tracker's field during {} frames; their positions may be wrong", found.frames);
    }
    if let Some(smoothing) = &status.smoothing {
        print_line!("{}", sentences(smoothing));
    }
    if let (Some(outcome), Some(quantiles)) = (outcome, status.capture_to_volume.quantiles()) {
        print_line!(
            "{:.1} ms from capture to volume (median; p99 {:.1}, maximum {:.1}), {} voxels updated",
            quantiles.median_ms,
            quantiles.p99_ms,
            quantiles.most_ms,
            outcome.voxels_updated
        );
    }
    if let Some(outcome) = outcome {
        let input = match (replayed, recording) {
            (Some(session), _) => name_of(session),
            (None, Some(recording)) => name_of(&recording.path),
            (None, None) => "devices, not recorded".into(),
        };
        outputs.write_volumes(outcome, input, &|line| print_line!("{line}"), &say)?;
    } else if outputs.volume.is_some() || outputs.weights.is_some() || outputs.picture.is_some() {
        say("no slice was inserted: there is no volume and no picture");
    }
    if let (Some(path), Some(drawn)) = (&outputs.picture, drawn) {
        let over = Over::of(&drawn.renderer, bedside.picture.background, None);
        over.write(&bedside.picture.draw, path)?;
        print_line!("picture: {} ({} on the way)", path.display(), drawn.pictures);
    }
    if let Some(recording) = recording {
        let lost = recording.status.lost + recording.lost.total() + recording.after_end.total();
        print_line!(
            "session: {} ({:.1} MB, {} messages{})",
            recording.path.display(),
            recording.status.file_bytes as f64 / 1e6,
            recording.status.stored,
            if lost > 0 { format!(", {lost} LOST") } else { String::new() }
        );
    }
    for note in &status.notes {
        say(&format!("note: {note}"));
    }
    outputs.write_report(ended)
}

//! Outputs of a session: the volume, its weights, a picture, numbers, and the printed report.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use config::bedside::Bedside;
use export::volume::{DenseBox, Encoding, write_values, write_weights};
use pipeline::Outcome;
use pipeline::session::{Differences, Finished, REPLAYED, ResultDigest, SessionStatus};
use statistics::{LiveStatistics, write_json};
use volume::Voxels;

use crate::cli::devices::with_remedy;
use crate::cli::provenance::Made;
use crate::cli::reconstruct::filling::{self, FillFlags};
use crate::cli::render::check_png;
use crate::cli::render::drawing::Over;
use crate::cli::{Failure, input};

/// Output flags of a session.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct Outputs {
    /// Write the volume at the end (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz)
    #[arg(long, value_name = "VOL.mha")]
    pub(in crate::cli) volume: Option<PathBuf>,
    /// Write its weights (same formats as the volume)
    #[arg(long, value_name = "W.mha")]
    pub(in crate::cli) weights: Option<PathBuf>,
    #[command(flatten)]
    pub(in crate::cli) filling: FillFlags,
    /// Write the picture at the end
    #[arg(long, value_name = "IMG.png")]
    pub(in crate::cli) picture: Option<PathBuf>,
    /// Write the frame outcomes, device states and timings, as JSON
    #[arg(long, value_name = "FILE.json")]
    pub(in crate::cli) stats: Option<PathBuf>,
}

impl Outputs {
    /// Refuses impossible outputs before the work.
    ///
    /// # Errors
    /// [`Failure`] with the file and the reason.
    pub(in crate::cli) fn check(&self, bedside: &Bedside) -> Result<(), Failure> {
        self.filling.check(&bedside.volume.settings, self.volume.is_some() || self.weights.is_some())?;
        for path in [&self.volume, &self.weights].into_iter().flatten() {
            input::check_volume(path)?;
            input::check_output(path)?;
        }
        if let Some(path) = &self.picture {
            check_png(path)?;
            input::check_output(path)?;
        }
        if let Some(path) = &self.stats {
            input::check_output(path)?;
        }
        Ok(())
    }
}

/// Formats a progress line.
pub(in crate::cli) fn line(status: &SessionStatus) -> String {
    let frames = &status.ledger.frames;
    format!("{} slices of {} frames", frames.used, frames.total) + &troubles(status)
}

/// Formats the present problems, to follow a line; empty without any.
pub(in crate::cli) fn troubles(status: &SessionStatus) -> String {
    let mut text = String::new();
    for device in &status.devices {
        let is_well = ["running", REPLAYED].contains(&device.state);
        if !is_well || !device.why.is_empty() {
            text += &format!("; {} is {}", device.name, device.state);
            if !device.why.is_empty() {
                text += &format!(": {}", with_remedy(&device.why));
            }
        }
    }
    if status.distortion.is_some_and(|found| found.rms_mm.is_some()) {
        text += "; metal distorts the tracker's field at the probe";
    }
    if let Some(seconds) = status.stuck_s {
        text += &format!("; scanner frozen for {seconds:.1} s");
    }
    if let Some(written) = &status.recording {
        if !written.trouble.is_empty() {
            text += &format!("; recording in trouble: {}", written.trouble);
        }
        if written.slow_disk {
            text += "; the disk is slow, a power cut may take more than the last second";
        }
    }
    text
}

#[allow(clippy::print_stderr, reason = "the command's output on the way")]
pub(in crate::cli) fn say(line: &str) {
    eprintln!("sonoweave: {line}");
}

/// Statistics of a session, and of a replay's differences from its recording.
#[derive(Serialize)]
struct Numbers<'a> {
    #[serde(flatten)]
    statistics: LiveStatistics<'a>,
    /// Only for a recording.
    differences: Option<u64>,
    first_difference: Option<&'a str>,
    digest: Option<&'a ResultDigest>,
}

/// Writes the requested files, and prints a report. For a `replayed` recording, the report
/// includes the differences from it.
///
/// # Errors
/// [`Failure`]: the file that failed does not exist.
#[allow(clippy::print_stdout, reason = "the command's output")]
pub(in crate::cli) fn leave(
    bedside: &Bedside,
    outputs: &Outputs,
    finished: &Finished,
    wall: Duration,
    replayed: Option<&Path>,
    differences: Option<&Differences>,
) -> Result<(), Failure> {
    let Finished { outcome, drawn, status, recording, digest, .. } = finished;
    println!("{}", status.ledger);
    if let Some(found) = status.distortion.filter(|found| found.frames > 0) {
        println!("metal distorted the tracker's field during {} frames; their positions may be wrong", found.frames);
    }
    if let (Some(outcome), Some(quantiles)) = (outcome, status.capture_to_volume.quantiles()) {
        println!(
            "{:.1} ms from capture to volume (median; p99 {:.1}, maximum {:.1}), {} voxels updated",
            quantiles.median_ms, quantiles.p99_ms, quantiles.most_ms, outcome.voxels_updated
        );
    }
    if let Some(outcome) = outcome {
        let input = match (replayed, recording) {
            (Some(session), _) => name_of(session),
            (None, Some(recording)) => name_of(&recording.path),
            (None, None) => "devices, not recorded".into(),
        };
        write_volumes(outputs, outcome, input)?;
    } else if outputs.volume.is_some() || outputs.weights.is_some() || outputs.picture.is_some() {
        say("no slice was inserted: there is no volume and no picture");
    }
    if let (Some(path), Some(drawn)) = (&outputs.picture, drawn) {
        let over = Over { renderer: &drawn.renderer, background: bedside.picture.background, slice: None };
        over.write(&bedside.picture.draw, path)?;
        println!("picture: {} ({} on the way)", path.display(), drawn.pictures);
    }
    if let Some(recording) = recording {
        let lost = recording.status.lost + recording.lost.total() + recording.after_end.total();
        println!(
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
    let Some(path) = &outputs.stats else { return Ok(()) };
    let numbers = Numbers {
        statistics: LiveStatistics::new(status, wall, &bedside.effective),
        differences: differences.map(|differences| differences.count),
        first_difference: differences.and_then(|differences| differences.first.as_deref()),
        digest: digest.as_ref(),
    };
    Ok(write_json(path, &numbers)?)
}

#[allow(clippy::print_stdout, reason = "the command's output")]
fn write_volumes(outputs: &Outputs, outcome: &Outcome, input: String) -> Result<(), Failure> {
    if outputs.volume.is_none() && outputs.weights.is_none() {
        return Ok(());
    }
    let reconstructor = &outcome.reconstructor;
    let Some((low, high)) = reconstructor.volume().seen_bounds() else {
        say("no voxel was seen, because the slices' kernel fell between the voxels; give a finer volume.spacing_mm");
        return Ok(());
    };
    let space = DenseBox::around([low, high], reconstructor.world_from_lattice(), reconstructor.settings());
    let encoding = Encoding { scalar: outcome.pixels.scalar(), window: None, unseen: 0.0 };
    // The calibration is recorded in the session. Its file name does not change the volume.
    let calibration = "in the configuration".to_owned();
    let made = Made { outcome, space: &space, encoding: &encoding, input, calibration, cropped: false };
    let mut fields = made.fields();
    let filled = outputs.filling.fill(reconstructor.volume(), &space, reconstructor.settings())?;
    fields.extend(filled.iter().flat_map(filling::fields));
    let volume = filled.as_ref().map_or(reconstructor.volume(), |filled| filled as &dyn Voxels);
    if let Some(path) = &outputs.volume {
        write_values(volume, &space, path, &encoding, &fields)?;
        let [x, y, z] = space.grid.size;
        println!("volume: {} ({x}×{y}×{z} voxels in {})", path.display(), outcome.world);
    }
    if let Some(path) = &outputs.weights {
        write_weights(volume, &space, path, &fields)?;
        println!("weights: {}", path.display());
    }
    if let Some(filled) = &filled {
        println!("{}", filling::sentence(filled));
    }
    Ok(())
}

/// Returns a file's name without its folder.
pub(in crate::cli) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

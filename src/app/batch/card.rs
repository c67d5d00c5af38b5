//! The card of a data set: the numbers of a batch, in the files of a BIDS-style folder.
//!
//! The numbers are sums over the accounts of the finished sweeps (`done.json`). Durations are read
//! from the headers of the recordings, and the calibration's error from the configurations, as far
//! as they are still there and unchanged.
//!
//! - [`participants`]: subjects and sessions, and their labels.
//! - [`files`]: the files of the folder.
//! - `croissant`: the one that describes the tables.

mod croissant;
pub(crate) mod files;
pub(crate) mod participants;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use config::Settings as Config;
use formats::Limits;
use formats::image::open_sequence;

use super::done::{self, Done};
use super::folder::RunFolder;
use super::plan::{self, Planned};
use super::select::Selection;
use super::status;
use crate::app::pseudonym::PseudonymKey;
use crate::failure::{Failure, FailureKind};
use participants::Labels;

/// Numbers of a batch.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub(crate) struct Card {
    pub(crate) sweeps: SweepCounts,
    pub(crate) frames: FrameCounts,
    pub(crate) recorded: Recorded,
    /// Calibrations of the finished sweeps.
    pub(crate) calibrations: Vec<CalibrationUse>,
    /// Versions of the program, with the number of sweeps that each reconstructed.
    pub(crate) programs: BTreeMap<String, u64>,
    /// Settings, with the number of sweeps that have them.
    pub(crate) settings: BTreeMap<String, u64>,
    /// Values of the manifest's column `probe`, with their numbers of sweeps.
    pub(crate) probes: BTreeMap<String, u64>,
    pub(crate) subjects: usize,
    /// The finished sweeps, in the order of the plan.
    #[serde(skip)]
    pub(crate) rows: Vec<SweepRow>,
}

/// Sweeps by their state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub(crate) struct SweepCounts {
    pub(crate) planned: usize,
    pub(crate) done: usize,
    pub(crate) failed: usize,
    pub(crate) waiting: usize,
}

/// Frames of the finished sweeps.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub(crate) struct FrameCounts {
    pub(crate) total: u64,
    pub(crate) used: u64,
    /// Refused frames by reason.
    pub(crate) refused: BTreeMap<String, u64>,
}

/// Duration of the recordings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub(crate) struct Recorded {
    pub(crate) hours: f64,
    /// Sweeps whose duration is not known, as the recording is gone, has changed or has no times.
    pub(crate) unknown: u64,
}

/// A calibration, by its content.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct CalibrationUse {
    /// SHA-256 of its file.
    pub(crate) sha256: String,
    pub(crate) sweeps: u64,
    /// Mean and standard deviation of its error at the phantom, mm, if the file states them.
    pub(crate) error_mm: Option<[f64; 2]>,
    /// Standard deviation of a point's place at the image's worst corner, mm.
    pub(crate) corner_mm: Option<f64>,
}

/// A finished sweep.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SweepRow {
    /// Its id, or the pseudonym of it.
    pub(crate) id: String,
    pub(crate) labels: Labels,
    pub(crate) frames: FrameCounts,
    pub(crate) seconds: Option<f64>,
    pub(crate) calibration: Option<String>,
    /// SHA-256 of the volume; of an OME-Zarr folder, of its root's metadata.
    pub(crate) volume: Option<String>,
}

/// Reads the numbers of a batch; with a key, names become pseudonyms.
///
/// # Errors
/// [`Failure`] when the batch cannot be read, is not finished and not `partial`, or two subjects
/// have one label.
pub(crate) fn read(folder: &RunFolder, partial: bool, key: Option<&PseudonymKey>) -> Result<Card, Failure> {
    let plan = plan::read(folder, &Selection::default())?;
    let state = status::status_of(folder, &plan)?;
    if state.done < state.sweeps && !partial {
        let sentence = format!(
            "{}: {} of {} sweeps are not done; use `batch run` or `batch retry`, or give --partial",
            folder.path().display(),
            state.sweeps - state.done,
            state.sweeps
        );
        return Err(Failure::new(sentence).of(FailureKind::SomeFailed));
    }
    let waiting = state.waiting + state.running;
    let sweeps = SweepCounts { planned: state.sweeps, done: state.done, failed: state.failed, waiting };
    let mut card = Card { sweeps, ..Card::default() };
    let labels = participants::labels(&plan, key)?;
    for (sweep, labels) in plan.iter().zip(labels) {
        // A sweep that became done or was removed meanwhile is not counted.
        if let Some(done) = done::read(folder, sweep) {
            card.add(sweep, &done, labels, key);
        }
    }
    card.sweeps.done = card.rows.len();
    let subjects: std::collections::BTreeSet<&String> = card.rows.iter().map(|row| &row.labels.subject).collect();
    card.subjects = subjects.len();
    Ok(card)
}

impl Card {
    fn add(&mut self, sweep: &Planned, done: &Done, labels: Labels, key: Option<&PseudonymKey>) {
        let frames = FrameCounts::of(&done.report);
        self.frames.total += frames.total;
        self.frames.used += frames.used;
        for (reason, count) in &frames.refused {
            *self.frames.refused.entry(reason.clone()).or_default() += count;
        }
        let seconds = seconds(sweep, done);
        match seconds {
            Some(seconds) => self.recorded.hours += seconds / 3600.0,
            None => self.recorded.unknown += 1,
        }
        *self.programs.entry(done.program.clone()).or_default() += 1;
        *self.settings.entry(done.settings.join(" ")).or_default() += 1;
        if let Some(probe) = sweep.other.get("probe").map(text).filter(|_| key.is_none()) {
            *self.probes.entry(probe).or_default() += 1;
        }
        let calibration = calibration(sweep, done);
        if let Some((sha256, path)) = calibration {
            self.count_calibration(sha256, path, sweep.settings.iter().find_map(|word| word.strip_prefix("--preset=")));
        }
        // The volume is the first of the outputs.
        let is_root = |path: &str| path.ends_with(".ome.zarr/zarr.json") || !path.contains(".ome.zarr/");
        let of_volume = |path: &str| sweep.outputs.first().is_some_and(|name| path.contains(&format!("/{name}")));
        let volume = done.outputs.iter().find(|output| of_volume(&output.path) && is_root(&output.path));
        self.rows.push(SweepRow {
            id: key.map_or_else(|| sweep.id.clone(), |key| key.pseudonym("sweep", &sweep.id)),
            labels,
            frames,
            seconds,
            calibration: calibration.map(|(sha256, _)| sha256.to_owned()),
            volume: volume.map(|output| output.sha256.clone()),
        });
    }

    fn count_calibration(&mut self, sha256: &str, path: &Path, preset: Option<&str>) {
        if let Some(known) = self.calibrations.iter_mut().find(|known| known.sha256 == sha256) {
            known.sweeps += 1;
            return;
        }
        let is_same = crate::app::input::hash(path).is_ok_and(|now| now == sha256);
        let quality = Config::read(path, preset).ok().filter(|_| is_same).and_then(|config| config.record.quality);
        self.calibrations.push(CalibrationUse {
            sha256: sha256.to_owned(),
            sweeps: 1,
            error_mm: quality.map(|quality| quality.error_mm),
            corner_mm: quality.map(|quality| quality.corner_mm),
        });
    }
}

impl FrameCounts {
    /// Returns the counts of an account's frame ledger.
    fn of(report: &Value) -> Self {
        let frames = &report["frames"];
        let count = |value: &Value| value.as_u64().unwrap_or(0);
        let refused = frames["refused"].as_object().into_iter().flatten();
        Self {
            total: count(&frames["total"]),
            used: count(&frames["used"]),
            refused: refused.map(|(reason, number)| (reason.clone(), count(number))).collect(),
        }
    }
}

/// Returns the configuration's hash and file, if the sweep has one.
fn calibration<'a>(sweep: &'a Planned, done: &'a Done) -> Option<(&'a str, &'a Path)> {
    let path = sweep.config.as_deref()?;
    let input = done.inputs.iter().find(|input| input.path == path)?;
    Some((&input.sha256, path))
}

/// Returns the seconds from a recording's first frame to its last.
fn seconds(sweep: &Planned, done: &Done) -> Option<f64> {
    let input = done.inputs.iter().find(|input| input.path == sweep.recording)?;
    let now = sweep.recording.metadata().ok()?;
    if now.len() != input.bytes {
        return None;
    }
    let opened = open_sequence(&sweep.recording, &Limits::default()).ok()?;
    let times = || (0..opened.layout.layers).filter_map(|item| opened.header.item(item).source_s);
    let (first, last) = (times().next()?, times().next_back()?);
    (last >= first).then_some(last - first)
}

/// Returns a cell of the manifest as its text.
fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

//! The plan of a volume that is reconstructed in regions, and its file.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use formats::whole::write_whole;
use ome_zarr::{ShardWriter, plan_path};
use pipeline::regions::SweepPlan;
use pipeline::session::SequenceInput;
use statistics::{RegionNumbers, RegionWork};
use volume::brick::BrickBox;

use crate::app::input;
use crate::app::json::document;
use crate::app::provenance::program;
use crate::app::reconstruct::zarr::{Described, Target};
use crate::failure::{Failure, FailureKind};

/// A file of the recording, as it was when the plan was made: its header's, or its pixels'.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct RecordedFile {
    path: PathBuf,
    /// Length, bytes.
    bytes: u64,
    /// Time of its last change, ns since 1970.
    changed_ns: u128,
    /// SHA-256.
    sha256: String,
}

impl RecordedFile {
    fn of(path: &Path) -> Result<Self, Failure> {
        Ok(Self { sha256: input::hash(path)?, ..Self::without_content(path)? })
    }

    fn without_content(path: &Path) -> Result<Self, Failure> {
        let there = fs::metadata(path).map_err(|error| Failure::io(path, "reading", &error))?;
        let changed = there.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let (changed_ns, sha256) = (changed.unwrap_or_default().as_nanos(), String::new());
        Ok(Self { path: path.into(), bytes: there.len(), changed_ns, sha256 })
    }

    /// Checks that the file is the same: by length and time, else by its content.
    fn check(&self) -> Result<(), Failure> {
        let now = Self::without_content(&self.path)?;
        let is_untouched = (now.bytes, now.changed_ns) == (self.bytes, self.changed_ns);
        if is_untouched || now.bytes == self.bytes && input::hash(&self.path)? == self.sha256 {
            return Ok(());
        }
        Err(Failure::new(format!(
            "{}: has changed since the plan was made; give back the planned recording, or plan again",
            self.path.display()
        ))
        .of(FailureKind::Input))
    }
}

/// The plan of a volume: everything that a process needs to reconstruct one of its regions.
#[derive(Serialize, Deserialize)]
pub(crate) struct RegionsPlan {
    /// Another version or build may decide otherwise.
    program: String,
    /// SHA-256 of the recording, for reports.
    pub(super) sha256: String,
    /// The recording's files, with their paths in full; none for frames in memory.
    recording: Vec<RecordedFile>,
    pub(super) described: Described,
    /// The regions that slices meet.
    pub(crate) regions: Vec<BrickBox>,
    /// Regions that each slice meets, summed over slices.
    pub(super) meetings: u64,
    /// The report of the plan's command.
    pub(super) report: Value,
    /// Slices and settings.
    pub(super) sweep: SweepPlan,
    /// The volume.
    #[serde(skip)]
    path: PathBuf,
}

impl RegionsPlan {
    /// Returns the plan of a volume to be written there.
    pub(super) fn new(
        path: PathBuf,
        sha256: String,
        described: Described,
        regions: Vec<BrickBox>,
        meetings: u64,
        sweep: SweepPlan,
    ) -> Self {
        let (program, report, recording) = (program(), Value::Null, Vec::new());
        Self { program, sha256, recording, described, regions, meetings, report, sweep, path }
    }

    /// The volume.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Reads the plan of an unfinished volume. `threads` will filter and insert.
    ///
    /// # Errors
    /// [`Failure`] when there is none, it is another program's, or the recording has changed.
    pub(super) fn read(path: &Path, threads: usize) -> Result<Self, Failure> {
        let file = plan_path(path);
        if !file.is_file() {
            return Err(Failure::new(format!(
                "{}: has no plan ({} is missing); make one by `sonoweave regions plan`{}",
                path.display(),
                file.display(),
                if path.is_dir() { ", unless this volume is the finished one" } else { "" }
            ))
            .of(FailureKind::Input));
        }
        let text = fs::read(&file).map_err(|error| Failure::io(&file, "reading", &error))?;
        // The program is read first: another one's plan may have other fields.
        let value: Value = serde_json::from_slice(&text).map_err(|error| {
            Failure::new(format!("{}: is no plan ({error}); make it again by `sonoweave regions plan`", file.display()))
                .of(FailureKind::Input)
        })?;
        let made_by = value.get("program").and_then(Value::as_str).unwrap_or_default().to_owned();
        if made_by != program() {
            return Err(Failure::new(format!(
                "{}: was made by sonoweave {made_by}, and this is {}; use that program, or plan again",
                file.display(),
                program()
            ))
            .of(FailureKind::Configuration));
        }
        let mut plan: Self = serde_json::from_value(value).map_err(|error| {
            Failure::new(format!("{}: is damaged ({error}); make it again by `sonoweave regions plan`", file.display()))
                .of(FailureKind::Input)
        })?;
        plan.path = path.to_owned();
        plan.sweep.settings.threads = threads;
        Ok(plan)
    }

    /// Writes the plan into the unfinished volume, for other processes.
    ///
    /// # Errors
    /// [`Failure`] when the recording is no file, or the plan's cannot be written.
    pub(super) fn write(&mut self) -> Result<(), Failure> {
        if let SequenceInput::File(settings) = &mut self.sweep.input {
            let path = settings.path.canonicalize();
            settings.path = path.map_err(|error| Failure::io(&settings.path, "opening", &error))?;
            let (files, _) = input::recording(&settings.path);
            self.recording = files.iter().map(|file| RecordedFile::of(file)).collect::<Result<_, _>>()?;
        }
        let (file, text) = (plan_path(&self.path), serde_json::to_vec(self)?);
        write_whole(&file, |to| to.write_all(&text)).map_err(|error| Failure::io(&file, "writing", &error))
    }

    /// Checks that the recording is the planned one.
    ///
    /// # Errors
    /// [`Failure`] when it has changed.
    pub(super) fn check_recording(&self) -> Result<(), Failure> {
        self.recording.iter().try_for_each(RecordedFile::check)
    }

    /// Prepares to write the volume.
    ///
    /// # Errors
    /// [`Failure`] when threads cannot be started.
    pub(super) fn target(&self) -> Result<Target<'_>, Failure> {
        Target::new(&self.described, self.sweep.settings.threads)
    }

    /// Returns the numbers of the regions.
    pub(super) fn numbers(&self) -> RegionNumbers {
        RegionNumbers { count: self.regions.len() as u64, kept: 0, meetings: self.meetings }
    }

    /// Reconstructs and writes a region, unless it is written already.
    ///
    /// # Errors
    /// [`Failure`] when the recording cannot be read, or a file cannot be written.
    pub(super) fn reconstruct(
        &self,
        target: &Target<'_>,
        writer: &ShardWriter,
        region: &BrickBox,
    ) -> Result<Option<RegionWork>, Failure> {
        if target.has(writer, region) {
            return Ok(None);
        }
        let reconstructor = self.sweep.reconstruct(region)?;
        target.write(writer, reconstructor.volume(), Some(region))?;
        Ok(Some(RegionWork::of(&reconstructor)))
    }

    /// Returns the mean number of regions that a slice meets.
    pub(crate) fn meetings_per_slice(&self) -> f64 {
        self.meetings as f64 / self.sweep.slices.len().max(1) as f64
    }

    /// Returns the report of the plan's command, as a JSON document.
    ///
    /// # Errors
    /// [`Failure`] when it has no JSON form.
    pub(crate) fn document(&self) -> Result<String, Failure> {
        document(&self.report)
    }

    /// Returns the number of slices that meet each region.
    pub(crate) fn slices(&self) -> Vec<usize> {
        let meets = |region: &BrickBox| {
            self.sweep.slices.iter().filter(|slice| !slice.entered.bricks.within(region).is_empty()).count()
        };
        self.regions.iter().map(meets).collect()
    }
}

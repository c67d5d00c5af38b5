//! Outputs of a session: the volume, its weights, a picture, and numbers; and its status in words.

use std::path::PathBuf;

use serde::Serialize;

use config::bedside::Bedside;
use export::fill::Filling;
use export::volume::{DenseBox, Encoding, write_values, write_weights};
use pipeline::Outcome;
use pipeline::session::{REPLAYED, ResultDigest, SessionStatus};
use statistics::LiveStatistics;
use volume::Voxels;

use super::ended::Ended;
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::provenance::Made;
use crate::app::reconstruct::standard_error::ErrorFile;
use crate::app::reconstruct::{filling, first_moment, standard_error};
use crate::failure::{Failure, with_remedy};

/// Files that a session leaves.
#[derive(Debug, Clone)]
pub(crate) struct Outputs {
    /// The volume.
    pub(crate) volume: Option<PathBuf>,
    /// Its weights.
    pub(crate) weights: Option<PathBuf>,
    /// Its standard errors.
    pub(crate) errors: Option<PathBuf>,
    /// Whether the first moment of the volume's values is corrected.
    pub(crate) first_moment: bool,
    /// Filling of holes in the first two; `None` for none.
    pub(crate) filling: Option<Filling>,
    /// The last picture.
    pub(crate) picture: Option<PathBuf>,
    /// Frame outcomes, device states and timings, as JSON.
    pub(crate) json: JsonFlag,
}

impl Outputs {
    /// Refuses impossible outputs before the work.
    ///
    /// # Errors
    /// [`Failure`] with the file and the reason.
    pub(crate) fn check(&self, bedside: &Bedside) -> Result<(), Failure> {
        filling::check(
            self.filling.as_ref(),
            &bedside.volume.settings,
            self.volume.is_some() || self.weights.is_some(),
        )?;
        first_moment::check(self.first_moment, &bedside.volume.settings, self.volume.is_some())?;
        standard_error::check(self.errors.is_some(), &bedside.volume.settings)?;
        if self.errors.is_some() && !bedside.volume.settings.standard_error {
            fail_usage!("--error: the session keeps no sums for it; set volume.standard_error = true, or leave it out");
        }
        for path in [&self.volume, &self.weights, &self.errors].into_iter().flatten() {
            input::check_volume(path)?;
            input::check_output(path)?;
        }
        if let Some(path) = &self.picture {
            input::check_png(path)?;
            input::check_output(path)?;
        }
        self.json.check([])
    }

    /// Writes the volume and its weights, as far as requested; `print` takes a line for each, and
    /// `say` the reason why there is none. `input` names the recording or the devices.
    ///
    /// # Errors
    /// [`Failure`]: the file that failed does not exist.
    pub(crate) fn write_volumes(
        &self,
        outcome: &Outcome,
        input: String,
        print: &dyn Fn(&str),
        say: &dyn Fn(&str),
    ) -> Result<(), Failure> {
        if [&self.volume, &self.weights, &self.errors].into_iter().all(Option::is_none) {
            return Ok(());
        }
        let reconstructor = &outcome.reconstructor;
        let Some((low, high)) = reconstructor.volume().seen_bounds() else {
            say(
                "no voxel was seen, because the slices' kernel fell between the voxels; give a finer volume.spacing_mm",
            );
            return Ok(());
        };
        let space = DenseBox::around([low, high], reconstructor.world_from_lattice(), reconstructor.settings());
        let encoding = Encoding { scalar: outcome.pixels.scalar(), window: None, unseen: 0.0 };
        // The calibration is recorded in the session. Its file name does not change the volume.
        let calibration = "in the configuration".to_owned();
        let made = Made { outcome, space: &space, encoding: &encoding, input, calibration, cropped: false };
        let mut fields = made.fields();
        let corrected = first_moment::correct(self.first_moment, reconstructor);
        fields.extend(corrected.iter().map(|(_, numbers)| first_moment::field(numbers)));
        let volume = corrected.as_ref().map_or(reconstructor.volume(), |(corrected, _)| corrected as &dyn Voxels);
        let filled = filling::fill(self.filling.as_ref(), volume, &space, reconstructor.settings())?;
        fields.extend(filled.iter().flat_map(filling::fields));
        let volume = filled.as_ref().map_or(volume, |filled| filled as &dyn Voxels);
        if let Some(path) = &self.volume {
            write_values(volume, &space, path, &encoding, &fields)?;
            let [x, y, z] = space.grid.size;
            print(&format!("volume: {} ({x}×{y}×{z} voxels in {})", path.display(), outcome.world));
        }
        if let Some(path) = &self.weights {
            write_weights(volume, &space, path, &fields)?;
            print(&format!("weights: {}", path.display()));
        }
        if let Some((_, numbers)) = &corrected {
            print(&first_moment::sentence(numbers));
        }
        if let Some(filled) = &filled {
            print(&filling::sentence(filled));
        }
        // Last, so that a scan without any overlap of slices loses only this file.
        if let Some(path) = &self.errors {
            let made = Made { encoding: &ErrorFile::encoding(), ..made };
            let numbers = ErrorFile::new(path, outcome)?.write(&space, made.fields())?;
            print(&standard_error::sentence(path, &numbers));
        }
        Ok(())
    }

    /// Writes the report, if requested.
    ///
    /// # Errors
    /// [`Failure`]: the file does not exist then.
    pub(crate) fn write_report(&self, ended: &Ended<'_>) -> Result<(), Failure> {
        let Ended { bedside, finished, wall, differences, .. } = ended;
        let numbers = Numbers {
            statistics: LiveStatistics::new(&finished.status, *wall, &bedside.effective),
            differences: differences.map(|differences| differences.count),
            first_difference: differences.and_then(|differences| differences.first.as_deref()),
            digest: finished.digest.as_ref(),
        };
        self.json.write(&numbers)
    }
}

/// Formats a progress line.
pub(crate) fn line(status: &SessionStatus) -> String {
    let frames = &status.ledger.frames;
    format!("{} slices of {} frames", frames.used, frames.total) + &troubles(status)
}

/// Formats the present problems, to follow a line; empty without any.
pub(crate) fn troubles(status: &SessionStatus) -> String {
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

//! Check of a probe's calibration by slices that cross, without a phantom.

mod options;

use std::path::{Path, PathBuf};

use glam::DAffine3;

use calibration::crossings::Checked;
use calibration::drift::Slip;
use calibration::file::{CalibrationFile, Latency};
use config::Settings;
use sonoweave_core::frames::Transform;

use super::latency::{Poses, Source, probe_from_image};
use super::outputs::{Input, Outputs, ProbeResult};
use super::recorded::Recorded;
use super::slices::slices;
use crate::failure::Failure;
pub(crate) use options::Options;

/// A checked calibration.
pub(crate) struct Found {
    pub(crate) checked: Checked,
    /// The sweep before which the sensor slipped or the body moved, if the sweeps tell one.
    pub(crate) slip: Option<Slip>,
    /// From image to probe by the calibration found.
    pub(crate) probe_from_image: DAffine3,
    /// Latencies of video and tracker in use, ms. A sequence's frames hold the poses of their
    /// moments, which no calibration changes.
    pub(crate) in_use_ms: Option<[f64; 2]>,
    pub(crate) inputs: Vec<Input>,
    /// Sentences for the user.
    pub(crate) notes: Vec<String>,
}

impl Options {
    /// Refuses invalid outputs before the work. A calibration file is never changed: the result is
    /// a new one.
    ///
    /// # Errors
    /// [`Failure`] with the file.
    pub(crate) fn check(&self, outputs: &Outputs) -> Result<(), Failure> {
        let inputs = [&self.sequence, &self.session, &self.config].into_iter().flatten();
        let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
        if let Some(path) = outputs.file().filter(|path| path.exists()) {
            fail!("{}: exists already; give the new calibration another name", path.display());
        }
        outputs.check(&inputs)
    }

    /// Checks the calibration.
    ///
    /// # Errors
    /// [`Failure`] when the recording does not determine a calibration near the one in use.
    pub(crate) fn find(&self) -> Result<Found, Failure> {
        let recorded = match (&self.sequence, &self.session) {
            (Some(path), _) => Recorded::of(path)?,
            (_, Some(path)) => Recorded::session(path)?,
            _ => return Err(Failure::new("give --sequence or --session")),
        };
        let source = Source::new(recorded, None);
        let config = self.config.as_deref().map(|path| Settings::read(path, None)).transpose()?;
        let nothing = Settings::default();
        let calibration = config.as_ref().or(source.calibration()).unwrap_or(&nothing);
        let in_use = probe_from_image(calibration)?;
        let in_use_ms = match (source.paired_ms(), config.as_ref().and_then(|config| config.latency)) {
            (None, _) => None,
            (Some(_), Some(latency)) => Some([latency.video_ms, latency.tracker_ms]),
            (Some(paired_ms), None) => {
                let video_ms = source.video_ms().unwrap_or(0.0);
                Some([video_ms, video_ms + paired_ms])
            }
        };
        let mut notes = Vec::new();
        let lag_s = in_use_ms.map_or(0.0, |[video_ms, tracker_ms]| 1e-3 * (tracker_ms - video_ms));
        let slices = slices(&source, calibration, Poses::Smoothed, lag_s, &mut notes)?;
        let checked = slices.checked().map_err(|why| Failure::new(format!("no check: {why}")))?;
        // Sweeps that do not tell are no reason against the check.
        let slip = slices.slipped().ok().flatten().filter(|slip| slip.is_likelier_than(&checked));
        let inputs = source.paths().into_iter().chain(self.config.as_deref()).map(Input::of);
        Ok(Found {
            probe_from_image: checked.corrected(in_use),
            checked,
            slip,
            in_use_ms,
            inputs: inputs.collect::<Result<_, _>>()?,
            notes,
        })
    }

    /// Returns the contents of the checked calibration file that the new one keeps; nothing of
    /// another program's file, nor of a session's.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read.
    pub(crate) fn kept(&self) -> Result<CalibrationFile, Failure> {
        let ours = self.config.as_ref().filter(|path| path.extension().is_some_and(|name| name == "toml"));
        Ok(ours.map(|path| CalibrationFile::read(path)).transpose()?.unwrap_or_default())
    }
}

impl Found {
    /// Returns the failure of a calibration that no longer holds, or of a check that does not tell.
    pub(crate) fn alarm(&self) -> Option<Failure> {
        let checked = &self.checked;
        if let Some(slip) = &self.slip {
            return Some(Failure::new(format!(
                "{slip}; check the sensor on the probe, and record again, or undo its effect by `sonoweave correct drift`"
            )));
        }
        if let Some(why) = checked.undecided() {
            return Some(Failure::new(format!("no check: {why}")));
        }
        if checked.has_slipped() {
            return Some(Failure::new(format!(
                "the calibration displaces the image by {:.2} mm, with a standard error of {:.2} mm; check the sensor on \
                 the probe and the scanner's depth, then calibrate by a phantom, or write the calibration found with -o",
                checked.shift_mm, checked.shift_se_mm
            )));
        }
        let [lag_s, se_s] = checked.lag_s.map(|s| 1e3 * s);
        // A sequence's poses are those of its frames, which no calibration changes.
        (self.in_use_ms.is_some() && checked.is_late()).then(|| {
            Failure::new(format!(
                "the tracker's latency is off by {lag_s:.1} ms, with a standard error of {se_s:.1} ms; run `sonoweave \
                 calibrate latency`, or write the calibration found with -o"
            ))
        })
    }

    /// Returns the calibration for the new file.
    pub(crate) fn result(&self, outputs: &Outputs) -> ProbeResult {
        let names: Vec<String> = self.inputs.iter().map(Input::name).collect();
        let [lag_s, se_s] = self.checked.lag_s;
        let latency = self.in_use_ms.map(|[video_ms, tracker_ms]| Latency {
            video_ms,
            tracker_ms: tracker_ms + 1e3 * lag_s,
            lag_se_ms: Some(1e3 * se_s),
        });
        ProbeResult {
            probe_from_image: Transform::from_affine(self.probe_from_image),
            provenance: format!("by crossings of {}", names.join(" and ")),
            record: calibration::file::record::Record { origin: outputs.origin(&self.inputs), ..Default::default() },
            preset: None,
            latency,
        }
    }
}

//! A bedside's configuration as what the pipeline is told: how frames become a volume and a picture, and what the devices are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use calibration::arm::{Arm, JOINTS};
use drivers::recording::session::{SessionWriter, WriterOptions};
use glam::DQuat;
use serde::{Deserialize, Serialize};

use super::room;
use crate::cli::Failure;
use crate::config::bedside::devices::{PROBE_FRAME, TRACKER_FRAME};
use crate::config::bedside::{Bedside, Effective, Picture, Tracking};
use crate::config::texts::ByPath;
use crate::ingest::live::Gives;
use crate::pipeline::live::{First, Instrument, Looks, Precedent, Record, Session, Watch};
use crate::render::RenderSettings;
use crate::sync::history::Rigid;

/// What the devices of a bedside are called, in sessions too.
pub(in crate::cli) const TRACKING: &str = "tracking";
pub(in crate::cli) const GRABBER: &str = "grabber";
/// The kind of note that a session is configured by,
const CONFIGURATION: &str = "configuration";
/// and that of those whose changes it took over while it ran, as far as it could.
pub(super) const ADOPTED: &str = "adopted";

/// A configuration as a session keeps it.
#[derive(Serialize, Deserialize)]
pub(in crate::cli) struct Kept {
    /// The file's name, as it was given.
    path: PathBuf,
    /// It and the files that it names, whole.
    texts: ByPath,
    /// What held, key by key: for people, and for programs that do not know the defaults.
    effective: Effective,
}

impl Kept {
    pub(in crate::cli) fn of(bedside: &Bedside) -> Self {
        let Bedside { path, texts, effective, .. } = bedside;
        Self { path: path.clone(), texts: texts.clone(), effective: effective.clone() }
    }

    /// The configuration of a recorded session, as it held at the end.
    ///
    /// # Errors
    /// [`Failure`] when it has none, or none that this version reads.
    pub(in crate::cli) fn bedside(session: &Path, precedent: &Precedent) -> Result<Bedside, Failure> {
        let mut bedside = Self::at_first(session, precedent)?;
        for newer in precedent.notes(ADOPTED) {
            bedside.adopt(&Self::read(session, newer)?);
        }
        Ok(bedside)
    }

    /// The same as it held at the beginning: what changes while the session runs comes in as it was told.
    ///
    /// # Errors
    /// As of [`Self::bedside`].
    pub(in crate::cli) fn at_first(session: &Path, precedent: &Precedent) -> Result<Bedside, Failure> {
        let [first] = precedent.notes(CONFIGURATION) else {
            return Err(Failure(format!(
                "{}: holds no configuration, so that nobody knows how it was woven; give one with --config",
                session.display()
            )));
        };
        Self::read(session, first)
    }

    fn read(session: &Path, text: &str) -> Result<Bedside, Failure> {
        let failed = |error: String| Failure(format!("{}: its configuration: {error}", session.display()));
        let kept: Self = serde_json::from_str(text).map_err(|error| failed(error.to_string()))?;
        Bedside::of_texts(&kept.path, kept.texts).map_err(|error| failed(error.to_string()))
    }
}

impl Looks for Picture {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Picture::settings(self, first.slice_axes)
            .map_err(|unfit| format!("picture.{}: {}", unfit.setting, unfit.problem).into())
    }

    fn most_hz(&self) -> f64 {
        self.most_hz
    }
}

/// How frames become a volume, and a picture if somebody looks.
///
/// # Errors
/// [`Failure`] where nobody knows where the picture lies.
pub(in crate::cli) fn stages(bedside: &Bedside, looks: Option<Arc<dyn Looks>>) -> Result<Session, Failure> {
    bedside.calibrated()?;
    Ok(Session {
        pairing: bedside.pairing_options(),
        wait_ns: bedside.pairing.wait_ns,
        longest_gap_ns: bedside.pairing.longest_gap_ns,
        frozen_ns: bedside.scanner.frozen_ns,
        mask: bedside.mask,
        settings: bedside.volume.settings.clone(),
        path: bedside.volume.path,
        planar: bedside.volume.planar,
        looks,
        witnesses: Vec::new(),
        watch: watch(bedside),
        readers: Vec::new(),
        cutter: None,
    })
}

/// Where the tracker's field is bent, by the calibration file; a room without such places is not looked after.
fn watch(bedside: &Bedside) -> Option<Watch> {
    let zones = bedside.calibration.distortion.as_ref().filter(|zones| zones.count() > 0)?;
    match bedside.tracking {
        Tracking::Tracker(_) | Tracking::Remote(_) => {
            Some(Watch { sensor: PROBE_FRAME.to_owned(), zones: Arc::new(zones.clone()) })
        }
        Tracking::Arm(_) => None,
    }
}

/// What the devices are: what carries the probe, and the grabber.
///
/// # Errors
/// [`Failure`] for an arm without kinematics.
pub(in crate::cli) fn instruments(bedside: &Bedside) -> Result<[Instrument; 2], Failure> {
    let (gives, frames) = of_tracking(bedside)?;
    let name = TRACKING.to_owned();
    let tracking = Instrument { name, gives, frames, latency_ns: bedside.tracking.latency_ns() };
    let name = GRABBER.to_owned();
    let (gives, frames) = (Gives::Pictures, Vec::new());
    Ok([tracking, Instrument { name, gives, frames, latency_ns: bedside.grabber.latency_ns }])
}

fn of_tracking(bedside: &Bedside) -> Result<(Gives, Vec<[String; 2]>), Failure> {
    let to_tracker = |frame: &str| [frame.to_owned(), TRACKER_FRAME.to_owned()];
    match &bedside.tracking {
        Tracking::Tracker(tracker) => {
            let (stations, frames) = tracker.roles.all().map(|(station, frame)| (station, to_tracker(frame))).unzip();
            Ok((Gives::Stations(stations), frames))
        }
        Tracking::Remote(remote) => {
            let of = remote.transforms.iter().map(|(name, frame)| (name.clone(), to_tracker(frame)));
            let (names, frames) = of.unzip();
            Ok((Gives::Named(names), frames))
        }
        Tracking::Arm(_) => {
            let Some(arm) = bedside.calibration.arm else {
                return Err(Failure(
                    "the calibration has no [[arm.joint]]: without lengths and zeros counts lead nowhere; give a calibration file that has them".into(),
                ));
            };
            let kinematics = move |counts: &[f64]| placed(&arm, counts);
            Ok((Gives::Arm { joints: JOINTS, kinematics: Box::new(kinematics) }, vec![to_tracker(PROBE_FRAME)]))
        }
    }
}

/// Where the arm's last link is by counts, whole or between two.
fn placed(arm: &Arm, counts: &[f64]) -> Option<Rigid> {
    let counts: [f64; JOINTS] = counts.get(..JOINTS)?.try_into().ok()?;
    let mut values = [0.0; JOINTS];
    for ((value, joint), count) in values.iter_mut().zip(arm.joints()).zip(counts) {
        *value = joint.value(count);
    }
    let affine = arm.pose(&values).tracker_from_probe().affine();
    Some(Rigid { rotation: DQuat::from_mat3(&affine.matrix3).normalize(), position_mm: affine.translation })
}

/// A session's file in a folder, which is made if it is not there.
///
/// # Errors
/// [`Failure`] when it cannot be written there, or nobody knows which part of a frame may be kept.
pub(in crate::cli) fn record(bedside: &Bedside, folder: &Path) -> Result<Record, Failure> {
    record_of(bedside, folder, true)
}

/// The same, of a session that may have no pictures.
pub(in crate::cli) fn record_of(bedside: &Bedside, folder: &Path, pictures: bool) -> Result<Record, Failure> {
    let full_frame = bedside.record.full_frame;
    if pictures && !full_frame && !bedside.mask.is_known() {
        return Err(Failure(
            "nothing is recorded while it is not known which part of the video is the scanner's picture, as the patient's name may stand beside it: give [calibration] clip_px or \
             fan, or say [record] full_frame = true to keep whole frames"
                .into(),
        ));
    }
    room::check(folder, bedside.record.keep_free_bytes)?;
    let writer = SessionWriter::create(folder, WriterOptions::new(concat!("sonoweave ", env!("CARGO_PKG_VERSION"))))?;
    let notes = vec![(CONFIGURATION, serde_json::to_value(Kept::of(bedside))?)];
    Ok(Record { writer, full_frame, notes, keep_free_bytes: bedside.record.keep_free_bytes })
}

//! Converts a session configuration to the pipeline's settings: reconstruction, rendering and
//! devices.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DQuat;
use serde::{Deserialize, Serialize};

use calibration::arm::{Arm, JOINTS, PlanarPose};
use config::bedside::devices::{PROBE_FRAME, TRACKER_FRAME};
use config::bedside::{Bedside, Effective, Tracking};
use config::texts::ByPath;
use formats::session::{SessionWriter, WriterOptions};
use pipeline::session::{DeviceRole, Record, RecordedDecisions, Session, ViewClient, Watch};
use sync::history::Rigid;
use sync::ingest::live::Gives;

use super::free_space;
use crate::app::reconstruct::standard_error::pose_noise;
use crate::failure::Failure;

/// Names of the devices, also used in recorded sessions.
pub(crate) const TRACKING: &str = "tracking";
pub(crate) const GRABBER: &str = "grabber";
/// Kind of the note with a session's configuration.
const CONFIGURATION: &str = "configuration";
/// Kind of the notes with configurations that were partly adopted while it ran.
pub(super) const ADOPTED: &str = "adopted";

/// A configuration as recorded in a session.
#[derive(Serialize, Deserialize)]
pub(crate) struct Kept {
    /// The file's name, as given.
    path: PathBuf,
    /// The file and the files that it names, in full.
    texts: ByPath,
    /// Effective values of all keys: for people, and for programs with other defaults.
    effective: Effective,
}

impl Kept {
    pub(crate) fn of(bedside: &Bedside) -> Self {
        let Bedside { path, texts, effective, .. } = bedside;
        Self { path: path.clone(), texts: texts.clone(), effective: effective.clone() }
    }

    /// Returns a recorded session's configuration at its end.
    ///
    /// # Errors
    /// [`Failure`] when it has none, or none that this version can read.
    pub(crate) fn bedside(session: &Path, decisions: &RecordedDecisions) -> Result<Bedside, Failure> {
        let mut bedside = Self::at_first(session, decisions)?;
        for newer in decisions.notes(ADOPTED) {
            bedside.adopt(&Self::read(session, newer)?);
        }
        Ok(bedside)
    }

    /// Returns a recorded session's configuration at its beginning. Later changes are replayed
    /// as recorded commands.
    ///
    /// # Errors
    /// [`Failure`], as of [`Self::bedside`].
    pub(crate) fn at_first(session: &Path, decisions: &RecordedDecisions) -> Result<Bedside, Failure> {
        let [first] = decisions.notes(CONFIGURATION) else {
            fail!("{}: holds no configuration; give one with --config", session.display());
        };
        Self::read(session, first)
    }

    fn read(session: &Path, text: &str) -> Result<Bedside, Failure> {
        let failed = |error: String| Failure::new(format!("{}: its configuration: {error}", session.display()));
        let kept: Self = serde_json::from_str(text).map_err(|error| failed(error.to_string()))?;
        Bedside::recorded(&kept.path, kept.texts, &kept.effective).map_err(|error| failed(error.to_string()))
    }
}

/// Returns the settings of reconstruction, and of rendering if there is a viewer.
///
/// # Errors
/// [`Failure`] when the image is not calibrated.
pub(crate) fn stages(bedside: &Bedside, client: Option<Arc<dyn ViewClient>>) -> Result<Session, Failure> {
    bedside.calibrated().map_err(Failure::configuration)?;
    Ok(Session {
        pairing: bedside.pairing_options(),
        wait_ns: bedside.pairing.wait_ns,
        longest_gap_ns: bedside.pairing.longest_gap_ns,
        smoothing: bedside.pairing.smoothing,
        pose_noise: pose_noise(bedside.sensor_noise(), &bedside.calibration),
        stuck_after_ns: bedside.scanner.stuck_after_ns,
        mask: bedside.mask,
        settings: bedside.volume.settings.clone(),
        path: bedside.volume.path,
        planar: bedside.volume.planar,
        view_client: client,
        observers: Vec::new(),
        watch: watch(bedside),
        readers: Vec::new(),
        plane_viewer: None,
        brick_viewer: None,
    })
}

/// Returns the zones of field distortion from the calibration file; `None` without zones.
fn watch(bedside: &Bedside) -> Option<Watch> {
    let zones = bedside.calibration.distortion.as_ref().filter(|zones| zones.count() > 0)?;
    match bedside.tracking {
        Tracking::Tracker(_) | Tracking::Remote(_) => {
            Some(Watch { sensor: PROBE_FRAME.to_owned(), zones: Arc::new(zones.clone()) })
        }
        Tracking::Arm(_) => None,
    }
}

/// Returns the devices: the tracker or arm, and the grabber.
///
/// # Errors
/// [`Failure`] for an arm without kinematics.
pub(crate) fn roles(bedside: &Bedside) -> Result<[DeviceRole; 2], Failure> {
    let (gives, frames) = of_tracking(bedside)?;
    let name = TRACKING.to_owned();
    let tracking = DeviceRole { name, gives, frames, latency_ns: bedside.tracking.latency_ns() };
    let name = GRABBER.to_owned();
    let (gives, frames) = (Gives::Pictures, Vec::new());
    Ok([tracking, DeviceRole { name, gives, frames, latency_ns: bedside.grabber.latency_ns }])
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
                fail!(
                    "the calibration has no [[arm.joint]], so counts cannot become poses; give a calibration file with \
                    them"
                );
            };
            let kinematics = Box::new(move |counts: &[f64]| placed(&arm, counts));
            let reach = arm.spread().iter().map(rigid).collect();
            Ok((Gives::Arm { joints: JOINTS, kinematics, reach }, vec![to_tracker(PROBE_FRAME)]))
        }
    }
}

/// Returns the pose of the arm's last link for joint counts, also fractional ones.
fn placed(arm: &Arm, counts: &[f64]) -> Option<Rigid> {
    let counts: [f64; JOINTS] = counts.get(..JOINTS)?.try_into().ok()?;
    let mut values = [0.0; JOINTS];
    for ((value, joint), count) in values.iter_mut().zip(arm.joints()).zip(counts) {
        *value = joint.value(count);
    }
    Some(rigid(&arm.pose(&values)))
}

fn rigid(pose: &PlanarPose) -> Rigid {
    let affine = pose.tracker_from_probe().affine();
    Rigid { rotation: DQuat::from_mat3(&affine.matrix3).normalize(), position_mm: affine.translation }
}

/// Creates a session's file in a folder, which is created if missing.
///
/// # Errors
/// [`Failure`] when it cannot be written, or the part of a frame that may be kept is unknown.
pub(crate) fn record(bedside: &Bedside, folder: &Path) -> Result<Record, Failure> {
    record_of(bedside, folder, true)
}

/// Creates the file of a session that may have no images.
pub(crate) fn record_of(bedside: &Bedside, folder: &Path, pictures: bool) -> Result<Record, Failure> {
    let full_frame = bedside.record.full_frame;
    if pictures && !full_frame && !bedside.mask.is_known() {
        fail!(
            "cannot record, because the scanner's image is unknown in the video, and the patient's name may be beside \
            it; give [calibration] clip_px or fan, or [record] full_frame = true"
        );
    }
    free_space::check(folder, bedside.record.keep_free_bytes)?;
    let writer = SessionWriter::create(folder, WriterOptions::new(concat!("sonoweave ", env!("CARGO_PKG_VERSION"))))?;
    let notes = vec![(CONFIGURATION, serde_json::to_value(Kept::of(bedside))?)];
    Ok(Record { writer, full_frame, notes, keep_free_bytes: bedside.record.keep_free_bytes })
}

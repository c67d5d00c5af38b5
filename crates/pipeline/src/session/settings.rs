//! A session's inputs and results: the source of its readings, and the settings for volume and
//! picture.

use std::sync::Arc;

use mask::MaskSettings;
use reconstruct::Settings;
use reconstruct::path_choice::{Chosen, PathChoice};
use reconstruct::planar::PlanarSettings;
use sonoweave_core::Timing;
use sonoweave_core::frames::{Image, Transform, World};
use sync::PairingOptions;
use sync::ingest::live::{Gives, LiveIngest};
use sync::pairing::timed::{Source as PoseSource, TimedOptions, TimedPairing};
use sync::smoothing::Smoothing;
use sync::survey::gap;

use super::brick_viewer::BrickViewer;
use super::common::Common;
use super::device::{DeviceRole, SessionDevice};
use super::digest::ResultDigest;
use super::pairing_thread::{Pairing, Part, SliceSink, Waiting};
use super::plane_viewer::PlaneViewer;
use super::priority::SchedulingPolicy;
use super::reader::Reader;
use super::recorded_decisions::RecordedDecisions;
use super::recorder::{Record, Recording};
use super::render_thread::{Drawn, ViewClient};
use super::replay::Recorded;
use super::sequence::Sequence;
use super::shared_volume::Shared;
use super::status::SessionStatus;
use super::stuck::StuckDetector;
use super::zones::{Guard, Watch};
use crate::inserter::{Plan, VolumeInserter};
use crate::smoothing::SmoothingStatus;
use crate::{Observer, OffPlane, Outcome, PipelineError, PoseNoise};

/// Settings for volume and picture.
pub struct Session {
    /// Names of the coordinate frames, and the constant transforms.
    pub pairing: PairingOptions,
    /// Longest time a frame waits for its pose, ns.
    pub wait_ns: i64,
    /// Longest time between two poses that are interpolated, ns.
    pub longest_gap_ns: i64,
    /// Smoothing of the trackers' poses; `None` if they are interpolated.
    pub smoothing: Option<Smoothing>,
    /// Noise of the tracker's poses; `None` if it is unknown, or there is none.
    pub pose_noise: Option<PoseNoise>,
    /// Time of equal frames at changing poses after which the scanner counts as stuck, ns.
    pub stuck_after_ns: i64,
    /// The frame's data region.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// The choice of insertion path. The automatic choice is the planar path if an arm can turn
    /// the image only in a plane, else the general path, since live poses are not known beforehand.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// The view settings; with `None`, nothing is rendered.
    pub view_client: Option<Arc<dyn ViewClient>>,
    /// The observers.
    pub observers: Vec<Arc<dyn Observer>>,
    /// The readers of the volume, each with its own thread.
    pub readers: Vec<Arc<dyn Reader>>,
    /// The plane viewer, if there is one.
    pub plane_viewer: Option<Arc<dyn PlaneViewer>>,
    /// The brick viewer, if there is one.
    pub brick_viewer: Option<Arc<dyn BrickViewer>>,
    /// Zones of the distorted tracker field, if they are known and to be monitored.
    pub watch: Option<Watch>,
}

/// The source of a session's readings.
#[allow(clippy::large_enum_variant, reason = "a session has one, moved twice")]
pub enum Source {
    /// Devices.
    Devices {
        /// The devices, stopped.
        devices: Vec<SessionDevice>,
        /// The recording, if the session is recorded.
        record: Option<Record>,
    },
    /// A recorded session. Every decision is made again and compared with the recorded one;
    /// [`RecordedDecisions::differences`] reports deviations. Only the frames dropped then are
    /// dropped: a slow stage delays the others.
    Recording(Recorded),
    /// A recorded sequence. Its slices wait for insertion; a full volume ends it with an error.
    Sequence(Sequence),
}

/// Session inputs.
pub struct SessionInputs {
    /// The source of its readings.
    pub source: Source,
    /// Recorded sessions that are continued, the earliest first. Their slices are inserted
    /// before all others.
    pub resumed: Vec<Recorded>,
    /// Scheduling policy of its threads.
    pub policy: SchedulingPolicy,
}

impl SessionInputs {
    /// Returns the inputs for a source alone.
    pub fn of(source: Source) -> Self {
        Self { source, resumed: Vec::new(), policy: SchedulingPolicy::default() }
    }
}

/// Results of a session.
pub struct Finished {
    /// The volume and the frames' outcome; `None` if no slice was inserted.
    pub outcome: Option<Outcome>,
    /// The picture of all slices, if there was a viewer.
    pub drawn: Option<Drawn>,
    /// Final status of devices, frames and times.
    pub status: SessionStatus,
    /// The session's file.
    pub recording: Option<Recording>,
    /// Digest of volume and picture; for recorded sessions and replays.
    pub digest: Option<ResultDigest>,
    /// The decisions that a replay was compared with.
    pub decisions: Option<RecordedDecisions>,
}

impl Session {
    /// Returns settings without viewers and observers; the insertion path is chosen by poses.
    pub fn new(pairing: PairingOptions, mask: MaskSettings, settings: Settings) -> Self {
        let TimedOptions { wait_ns, .. } = TimedOptions::default();
        Self {
            pairing,
            wait_ns,
            longest_gap_ns: PoseSource::new("", "").longest_gap_ns,
            smoothing: None,
            pose_noise: None,
            stuck_after_ns: i64::MAX,
            mask,
            settings,
            path: PathChoice::Auto,
            planar: PlanarSettings::default(),
            view_client: None,
            observers: Vec::new(),
            readers: Vec::new(),
            plane_viewer: None,
            brick_viewer: None,
            watch: None,
        }
    }

    /// Returns an empty volume for slices of these devices. An automatic choice of the insertion
    /// path depends on the poses that an arm can reach, if `by_reach`; `zero_borders` limits the
    /// automatic mask to borders that are exactly zero.
    pub(super) fn volume<'d>(
        &self,
        devices: impl Iterator<Item = &'d DeviceRole> + Clone,
        by_reach: bool,
        zero_borders: bool,
    ) -> Result<Shared, PipelineError> {
        let chosen = match self.path {
            PathChoice::Auto => None,
            requested => Some(Chosen::by_poses(requested, &self.settings, &self.planar, &[])?),
        };
        let plan = Plan {
            zero_borders,
            choice: self.path,
            settings: self.settings.clone(),
            planar: self.planar,
            chosen,
            reach: if by_reach { self.reach(devices)? } else { Vec::new() },
            off_plane: OffPlane::Settings,
            poses: Vec::new(),
        };
        Ok(Shared::new(VolumeInserter::new(plan, self.mask)))
    }

    /// Returns an empty volume for a recorded session, as it began.
    pub(super) fn volume_of_recording(&self, recorded: &Recorded) -> Result<Shared, PipelineError> {
        let Recorded { decisions, roles, .. } = recorded;
        self.volume(roles.iter(), decisions.is_path_by_reach(), decisions.is_mask_of_zero_borders())
    }

    /// Returns an empty volume for a sequence. The automatic σ across the slices and the insertion
    /// path follow from the poses of all frames to use.
    pub(super) fn volume_of_sequence(&self, sequence: &Sequence) -> Result<Shared, PipelineError> {
        let Sequence { off_plane, used, .. } = sequence;
        let mut settings = self.settings.clone();
        settings.sigma_mm[2] = match off_plane {
            OffPlane::Settings => settings.sigma_mm[2],
            OffPlane::Auto => Some(0.5 * gap(used).ok_or(PipelineError::NoGap)?),
        };
        let chosen = Some(Chosen::by_poses(self.path, &settings, &self.planar, used)?);
        let (choice, planar, off_plane) = (self.path, self.planar, *off_plane);
        let (reach, poses) = (Vec::new(), used.clone());
        let plan = Plan { zero_borders: false, choice, settings, planar, chosen, reach, off_plane, poses };
        Ok(Shared::new(VolumeInserter::new(plan, self.mask)))
    }

    /// Returns image poses spread over those that an arm can reach. Empty if other sources move
    /// the image, too, as any pose may then come.
    fn reach<'d>(
        &self,
        devices: impl Iterator<Item = &'d DeviceRole> + Clone,
    ) -> Result<Vec<Transform<World, Image>>, PipelineError> {
        let timed = self.timed(devices.clone())?;
        let sources = devices.flat_map(|device| device.frames.iter().map(|_| &device.gives));
        let arm = sources.enumerate().find_map(|(source, gives)| match gives {
            Gives::Arm { reach, .. } => Some((source, reach)),
            _ => None,
        });
        let Some((arm, reach)) = arm else { return Ok(Vec::new()) };
        Ok(reach.iter().filter_map(|pose| timed.compose(|source| (source == arm).then_some(*pose))).collect())
    }

    /// Returns the pose sources, device by device.
    fn sources<'d>(&self, devices: impl Iterator<Item = &'d DeviceRole>) -> Vec<PoseSource> {
        let source = |DeviceRole { gives, frames, .. }: &'d DeviceRole| {
            // An arm's encoders have no noise.
            let smoothing = self.smoothing.filter(|_| !matches!(gives, Gives::Arm { .. }));
            frames.iter().map(move |[from, to]| PoseSource {
                longest_gap_ns: self.longest_gap_ns,
                smoothing,
                ..PoseSource::new(from, to)
            })
        };
        devices.flat_map(source).collect()
    }

    pub(super) fn timed<'d>(
        &self,
        devices: impl Iterator<Item = &'d DeviceRole>,
    ) -> Result<TimedPairing<Waiting>, PipelineError> {
        Ok(TimedPairing::new(TimedOptions {
            pairing: self.pairing.clone(),
            sources: self.sources(devices),
            wait_ns: self.wait_ns,
            ..TimedOptions::default()
        })?)
    }

    pub(super) fn pairing_stage<'a>(
        &self,
        roles: Vec<DeviceRole>,
        common: Common<'a>,
        sender: SliceSink,
    ) -> Result<Pairing<'a>, PipelineError> {
        let timed = self.timed(roles.iter())?;
        let guard = self.watch.as_ref().and_then(|watch| {
            let mut frames = roles.iter().flat_map(|role| &role.frames);
            Some(Guard::new(frames.position(|[from, _]| *from == watch.sensor)?, &watch.zones))
        });
        let frames: Vec<[String; 2]> = roles.iter().flat_map(|role| role.frames.clone()).collect();
        let mut first = 0;
        let parts = roles.into_iter().map(|DeviceRole { name, gives, frames, latency_ns }| {
            let sources = first..first + frames.len();
            first = sources.end;
            // The device defines the meaning of its time stamps when it is set up.
            Part { name, ingest: LiveIngest::new(gives, Timing::default(), latency_ns), sources: sources.collect() }
        });
        let parts = parts.collect();
        common.status.route(timed.route());
        common.status.lock().smoothing = self.smoothing.map(SmoothingStatus::new);
        guard.iter().for_each(|guard| common.status.in_zones(guard.found()));
        Ok(Pairing::new(common, parts, timed, StuckDetector::new(self.mask), guard, frames, sender))
    }
}

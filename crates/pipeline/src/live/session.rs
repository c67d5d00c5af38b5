//! A session's inputs and results: its devices, the settings for volume and picture, and its
//! recording.

use std::sync::Arc;

use formats::session::{LineProtocol, SessionWriter};
use mask::MaskSettings;
use reconstruct::path_choice::{Chosen, PathChoice};
use reconstruct::planar::PlanarSettings;
use reconstruct::{Path, Settings};
use sonoweave_core::{Device, Timing};
use sync::PairingOptions;
use sync::bracket::{BracketOptions, Bracketing, Source};
use sync::ingest::live::{Gives, LiveIngest};

use super::decision::Common;
use super::digest::ResultDigest;
use super::frame_observer::FrameObserver;
use super::pairing::{FrameObservers, Pairing, Part, SliceSink, Waiting};
use super::picture::{Drawn, ViewClient};
use super::plane_viewer::PlaneViewer;
use super::priority::SchedulingPolicy;
use super::reader::Reader;
use super::recorder::Recording;
use super::replay::Recorded;
use super::shared_volume::Shared;
use super::status::SessionStatus;
use super::stuck::StuckDetector;
use super::zones::{Guard, Watch};
use crate::inserter::{Plan, VolumeInserter};
use crate::{OffPlane, Outcome, PipelineError};

/// Description of a device for pairing.
pub struct DeviceRole {
    /// Its name, in the recording too.
    pub name: String,
    /// The kind of its readings.
    pub gives: Gives,
    /// For each of its pose sources, the coordinate frames between which the pose maps: from and
    /// to.
    pub frames: Vec<[String; 2]>,
    /// Latency of its times beyond what its driver knows, ns.
    pub latency_ns: i64,
}

/// A device of a session.
pub struct SessionDevice {
    /// Its description.
    pub instrument: DeviceRole,
    /// The device, stopped.
    pub device: Box<dyn Device>,
    /// Protocol of its lines, if their bytes are recorded as readings, too.
    pub speech: Option<LineProtocol>,
}

/// Settings for volume and picture.
pub struct Session {
    /// Names of the coordinate frames, and the constant transforms.
    pub pairing: PairingOptions,
    /// Longest time a frame waits for its pose, ns.
    pub wait_ns: i64,
    /// Longest time between two poses that are interpolated, ns.
    pub longest_gap_ns: i64,
    /// Time of equal frames at changing poses after which the scanner counts as stuck, ns.
    pub stuck_after_ns: i64,
    /// The frame's data region.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// The choice of insertion path. Live poses are not known beforehand, so that the default is
    /// the general path.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// The view settings; with `None`, nothing is rendered.
    pub looks: Option<Arc<dyn ViewClient>>,
    /// The observers.
    pub witnesses: Vec<Arc<dyn FrameObserver>>,
    /// The readers of the volume, each with its own thread.
    pub readers: Vec<Arc<dyn Reader>>,
    /// The plane viewer, if there is one.
    pub cutter: Option<Arc<dyn PlaneViewer>>,
    /// Zones of the distorted tracker field, if they are known and to be monitored.
    pub watch: Option<Watch>,
}

/// Settings of a session's recording.
pub struct Record {
    /// The file, open.
    pub writer: SessionWriter,
    /// Keep whole frames. Otherwise only the data rectangle of each frame is kept, according to
    /// the mask's settings.
    pub full_frame: bool,
    /// Initial notes by kind: settings, calibration.
    pub notes: Vec<(&'static str, serde_json::Value)>,
    /// Space to be left free on the disk, bytes; at 0 the disk is filled.
    pub keep_free_bytes: u64,
}

/// Session inputs.
pub struct SessionInputs {
    /// Its devices.
    pub equipment: Vec<SessionDevice>,
    /// The recording, if the session is recorded.
    pub record: Option<Record>,
    /// Recorded sessions that are continued, the earliest first. Their slices are inserted
    /// before all others.
    pub resumed: Vec<Recorded>,
    /// Scheduling policy of its threads.
    pub standing: SchedulingPolicy,
}

/// Results of a session.
pub struct Finished {
    /// The volume and the frames' outcome; `None` if no slice was inserted.
    pub outcome: Option<Outcome>,
    /// The picture of all slices, if there was a viewer.
    pub drawn: Option<Drawn>,
    /// Final status of devices, frames and times.
    pub account: SessionStatus,
    /// The session's file.
    pub recording: Option<Recording>,
    /// Digest of volume and picture; for recorded sessions and replays.
    pub seal: Option<ResultDigest>,
}

impl Session {
    pub(super) fn loom(&self) -> Shared {
        let chosen = match self.path {
            PathChoice::Planar => Chosen { path: Path::Planar, why: "it was asked for".into() },
            _ => Chosen::general("live poses are not known beforehand"),
        };
        let plan = Plan {
            choice: self.path,
            settings: self.settings.clone(),
            planar: self.planar,
            chosen,
            off_plane: OffPlane::Settings,
            poses: Vec::new(),
        };
        Shared::new(VolumeInserter::of_any_size(plan, self.mask))
    }

    /// Returns the pose sources, device by device.
    fn sources(&self, instruments: &[DeviceRole]) -> Vec<Source> {
        let frames = instruments.iter().flat_map(|instrument| &instrument.frames);
        frames.map(|[from, to]| Source { longest_gap_ns: self.longest_gap_ns, ..Source::new(from, to) }).collect()
    }

    fn bracketing(&self, instruments: &[DeviceRole]) -> Result<Bracketing<Waiting>, PipelineError> {
        Ok(Bracketing::new(BracketOptions {
            image: self.pairing.image.clone(),
            world: self.pairing.world.clone(),
            statics: self.pairing.statics.clone(),
            sources: self.sources(instruments),
            wait_ns: self.wait_ns,
            ..BracketOptions::default()
        })?)
    }

    pub(super) fn pairing_stage<'a>(
        &self,
        instruments: Vec<DeviceRole>,
        common: Common<'a>,
        onward: SliceSink,
    ) -> Result<Pairing<'a>, PipelineError> {
        let bracketing = self.bracketing(&instruments)?;
        let guard = self.watch.as_ref().and_then(|watch| {
            let mut frames = instruments.iter().flat_map(|instrument| &instrument.frames);
            Some(Guard::new(frames.position(|[from, _]| *from == watch.sensor)?, &watch.zones, common.board))
        });
        let frames: Vec<[String; 2]> = instruments.iter().flat_map(|instrument| instrument.frames.clone()).collect();
        let mut first = 0;
        let parts = instruments.into_iter().map(|DeviceRole { name, gives, frames, latency_ns }| {
            let sources = first..first + frames.len();
            first = sources.end;
            // The device defines the meaning of its time stamps when it is set up.
            Part { name, ingest: LiveIngest::new(gives, Timing::default(), latency_ns), sources: sources.collect() }
        });
        let parts = parts.collect();
        common.board.route(bracketing.route());
        let onlookers = FrameObservers { guard, witnesses: self.witnesses.clone(), frames };
        Ok(Pairing::new(common, parts, bracketing, StuckDetector::new(self.mask), onlookers, onward))
    }

    pub(super) fn finish(
        &self,
        loom: VolumeInserter,
        drawn: Option<Drawn>,
        mut account: SessionStatus,
        recording: Option<Recording>,
        seal: Option<ResultDigest>,
    ) -> Finished {
        account.stuck_s = None;
        let outcome = loom.finish().map(|cloth| Outcome {
            world: account.world.clone(),
            route: account.route.clone(),
            voxels_updated: cloth.weaver.work().voxels_updated,
            reconstructor: cloth.weaver,
            chosen: cloth.chosen,
            ledger: account.ledger.clone(),
            mask: cloth.mask,
            reached: None,
            slice_axes: cloth.slice_axes,
            insert_ms: Vec::new(),
            pixels: cloth.pixels,
            notes: account.notes.iter().cloned().chain(cloth.notes).collect(),
        });
        Finished { outcome, drawn, account, recording, seal }
    }
}

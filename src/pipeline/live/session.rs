//! What a session is: its devices, how their readings become a volume and a picture, where it is recorded; and what it leaves.

use std::sync::Arc;

use drivers::recording::session::{SessionWriter, Speech};
use drivers::{Device, Timing};

use super::board::Account;
use super::decision::Common;
use super::fabric::Shared;
use super::frozen::Frozen;
use super::pairing::{Onlookers, Onward, Pairing, Part, Waiting};
use super::picture::{Drawn, Looks};
use super::priority::Standing;
use super::reader::Reader;
use super::recorder::Recording;
use super::replay::Recorded;
use super::seal::Seal;
use super::sections::Cutter;
use super::witness::Witness;
use super::zones::{Guard, Watch};
use crate::ingest::live::{Gives, LiveIngest};
use crate::mask::MaskSettings;
use crate::path::{Chosen, PathChoice};
use crate::pipeline::loom::{Loom, Plan};
use crate::pipeline::{OffPlane, Outcome, PipelineError};
use crate::reconstruct::planar::PlanarSettings;
use crate::reconstruct::{Path, Settings};
use crate::sync::PairingOptions;
use crate::sync::bracket::{BracketOptions, Bracketing, Source};

/// What pairing is told of a device.
pub struct Instrument {
    /// What it is called, in the recording too.
    pub name: String,
    /// What it gives.
    pub gives: Gives,
    /// Of what gives poses: for each of its sources the frames that the pose maps between, from which and to which.
    pub frames: Vec<[String; 2]>,
    /// What its times lie behind its measurements beyond what its driver knows, ns.
    pub latency_ns: i64,
}

/// A device of a session.
pub struct Equipment {
    /// What it is.
    pub instrument: Instrument,
    /// The device, stopped.
    pub device: Box<dyn Device>,
    /// What its lines speak, where their bytes are readings, too.
    pub speech: Option<Speech>,
}

/// How frames become a volume and a picture.
pub struct Session {
    /// The frames' names, and the constant transforms.
    pub pairing: PairingOptions,
    /// How long a frame waits for its pose, ns.
    pub wait_ns: i64,
    /// The longest time between two poses that a pose is made between, ns.
    pub longest_gap_ns: i64,
    /// After how long a time of equal pictures at changing poses the scanner counts as frozen, ns.
    pub frozen_ns: i64,
    /// What of the picture is data.
    pub mask: MaskSettings,
    /// The reconstructor's settings.
    pub settings: Settings,
    /// Who says which path slices go. Poses are not known beforehand, so that of itself it is the general one.
    pub path: PathChoice,
    /// The planar path's settings.
    pub planar: PlanarSettings,
    /// How the volume is looked at; nobody looks for `None`, and then nothing is drawn.
    pub looks: Option<Arc<dyn Looks>>,
    /// Who looks on.
    pub witnesses: Vec<Arc<dyn Witness>>,
    /// Who reads the volume, each by a thread of its own.
    pub readers: Vec<Arc<dyn Reader>>,
    /// Who looks at planes through it, if somebody does.
    pub cutter: Option<Arc<dyn Cutter>>,
    /// Where the tracker's field is bent, if that is known and is to be looked after.
    pub watch: Option<Watch>,
}

/// How a session is recorded.
pub struct Record {
    /// The file, open.
    pub writer: SessionWriter,
    /// Keep whole frames. Without, of frames nothing is kept but the rectangle of what is data, as far as the mask's settings tell it.
    pub full_frame: bool,
    /// What to note at the beginning, by kind: settings, calibration.
    pub notes: Vec<(&'static str, serde_json::Value)>,
    /// It ends before less is left on the disk, bytes; 0 goes on until nothing is.
    pub keep_free_bytes: u64,
}

/// What a session is run on.
pub struct Bed {
    /// Its devices.
    pub equipment: Vec<Equipment>,
    /// Where the session is recorded, if it is.
    pub record: Option<Record>,
    /// Recorded sessions that are gone on with, the earliest first: their slices are woven before anything else.
    pub resumed: Vec<Recorded>,
    /// What its threads have a right to.
    pub standing: Standing,
}

/// What a session that runs is told to do otherwise.
pub enum Order {
    /// A device's latency, by its place among the equipment, ns.
    Latency(usize, i64),
    /// After how long a time the scanner counts as frozen, ns.
    Frozen(i64),
    /// How the volume is looked at, where it is.
    Looks(Arc<dyn Looks>),
    /// Pictures are not used from now on, or are again.
    Pause(bool),
    /// The volume begins anew.
    Clear,
    /// The recording ends before less is left on the disk, bytes.
    KeepFree(u64),
    /// Notes something in the recording, of a kind.
    Note(&'static str, serde_json::Value),
    /// The user should know this sentence.
    Say(String),
}

/// What a session leaves.
pub struct Finished {
    /// The volume, and what became of the frames; `None` where no slice was woven.
    pub outcome: Option<Outcome>,
    /// The picture of all slices, where somebody looked.
    pub drawn: Option<Drawn>,
    /// What there is to say of devices, frames and times.
    pub account: Account,
    /// The session's file.
    pub recording: Option<Recording>,
    /// The bits of volume and picture in a line; of sessions that are recorded, and of recordings.
    pub seal: Option<Seal>,
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
        Shared::new(Loom::of_any_size(plan, self.mask))
    }

    /// What gives poses: each device's own, one after the other.
    fn sources(&self, instruments: &[Instrument]) -> Vec<Source> {
        let frames = instruments.iter().flat_map(|instrument| &instrument.frames);
        frames.map(|[from, to]| Source { longest_gap_ns: self.longest_gap_ns, ..Source::new(from, to) }).collect()
    }

    fn bracketing(&self, instruments: &[Instrument]) -> Result<Bracketing<Waiting>, PipelineError> {
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
        instruments: Vec<Instrument>,
        common: Common<'a>,
        onward: Onward,
    ) -> Result<Pairing<'a>, PipelineError> {
        let bracketing = self.bracketing(&instruments)?;
        let guard = self.watch.as_ref().and_then(|watch| {
            let mut frames = instruments.iter().flat_map(|instrument| &instrument.frames);
            Some(Guard::new(frames.position(|[from, _]| *from == watch.sensor)?, &watch.zones, common.board))
        });
        let frames: Vec<[String; 2]> = instruments.iter().flat_map(|instrument| instrument.frames.clone()).collect();
        let mut first = 0;
        let parts = instruments.into_iter().map(|Instrument { name, gives, frames, latency_ns }| {
            let sources = first..first + frames.len();
            first = sources.end;
            // What its stamps mean it says when it is set up.
            Part { name, ingest: LiveIngest::new(gives, Timing::default(), latency_ns), sources: sources.collect() }
        });
        let parts = parts.collect();
        common.board.route(bracketing.route());
        let onlookers = Onlookers { guard, witnesses: self.witnesses.clone(), frames };
        Ok(Pairing::new(common, parts, bracketing, Frozen::new(self.mask), onlookers, onward))
    }

    pub(super) fn finish(
        &self,
        loom: Loom,
        drawn: Option<Drawn>,
        mut account: Account,
        recording: Option<Recording>,
        seal: Option<Seal>,
    ) -> Finished {
        account.frozen_s = None;
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

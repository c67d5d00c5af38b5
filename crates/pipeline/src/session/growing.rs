//! A volume that grows by recordings and by single frames, for programs that own the loop.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use sonoweave_core::clock::Monotonic;
use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::ledger::Ledger;
use sonoweave_core::reading::PixelType;
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::Slice;
use sync::ingest::{Ingest, Sample};
use volume::brick::BrickIndex;

use super::posed_frames;
use super::priority::SchedulingPolicy;
use super::recorded_decisions::Differences;
use super::replay::Recorded;
use super::run::{Wiring, resume};
use super::sequence::Sequence;
use super::settings::{Session, Source};
use super::shared_volume::{PendingChanges, Shared};
use super::status::SessionStatus;
use crate::inserter::{FinishedVolume, OutcomeSink};
use crate::smoothing::SmoothingStatus;
use crate::{InsertedSlice, MaskOrigin, MaskRefusal, OffPlane, Outcome, PipelineError};
use mask::MaskFound;

/// World and route of frames that come with their poses.
const GIVEN: [&str; 2] = ["World", "given with each frame"];

/// A volume, and the account of all frames that were offered to it.
pub struct GrowingVolume {
    volume: Shared,
    ingest: Ingest,
    /// Size of the first frame, pixels; all must have it.
    size: Option<[u32; 2]>,
    /// Frames offered one by one.
    offered: u64,
    ledger: Ledger,
    world: String,
    route: String,
    smoothing: Option<SmoothingStatus>,
    /// Corrections of the last recorded session.
    corrections: Option<String>,
    /// The worst of its recordings.
    pose_error_mm: Option<f64>,
    notes: Vec<String>,
    insert_ms: Vec<f64>,
}

/// Result of one frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Inserted {
    /// Bricks that changed; those of frames that have waited for the mask, too.
    pub touched: Vec<BrickIndex>,
    /// Refused frames: this one, or earlier ones that have waited for the mask.
    pub refused: Vec<Refusal>,
    /// Frames that wait for the mask, or for the next one; their outcome comes with a later one.
    pub waiting: u64,
}

/// Collects the outcomes of frames. Nobody renders the volume, so that changed bricks are not kept.
struct Collector<'a> {
    ledger: &'a mut Ledger,
    pending: &'a mut PendingChanges,
    insert_ms: &'a mut Vec<f64>,
    inserted: Inserted,
}

impl OutcomeSink for Collector<'_> {
    fn inserted(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), PipelineError> {
        self.ledger.used();
        self.pending.inserted += 1;
        self.insert_ms.push(inserted.insert.as_secs_f64() * 1e3);
        self.inserted.touched.extend(inserted.touched);
        Ok(())
    }

    fn refused(&mut self, refusal: &Refusal) {
        self.ledger.refused(refusal);
        self.inserted.refused.push(refusal.clone());
    }

    fn masked(&mut self, found: &MaskFound, origin: MaskOrigin) {
        tracing::info!(?origin, "mask: {found}");
    }

    fn mask_refused(&mut self, refusal: &MaskRefusal) {
        tracing::warn!("the mask is not changed: {refusal}");
    }
}

impl GrowingVolume {
    /// Returns an empty volume for frames with any poses.
    ///
    /// # Errors
    /// [`PipelineError::NoGap`] if σ is to follow from the poses, which are unknown; settings that
    /// fit no slice.
    pub fn new(session: &Session, off_plane: OffPlane) -> Result<Self, PipelineError> {
        match off_plane {
            OffPlane::Auto => Err(PipelineError::NoGap),
            OffPlane::Settings => Ok(Self::empty(session.volume(std::iter::empty(), false, false)?)),
        }
    }

    /// Returns an empty volume for a sequence, as a reconstruction of it begins.
    ///
    /// # Errors
    /// [`PipelineError`] if the settings do not fit the sequence's poses.
    pub fn of_sequence(session: &Session, sequence: &Sequence) -> Result<Self, PipelineError> {
        Ok(Self::empty(session.volume_of_sequence(sequence)?))
    }

    /// Returns a volume for a recorded session, with the slices of the sessions that it continues,
    /// until `ends` is set.
    ///
    /// # Errors
    /// [`PipelineError`] if the settings do not fit, or one of those cannot be read.
    pub fn of_recording(
        session: &Session,
        recorded: &Recorded,
        resumed: Vec<Recorded>,
        ends: &AtomicBool,
    ) -> Result<Self, PipelineError> {
        let volume = session.volume_of_recording(resumed.first().unwrap_or(recorded))?;
        let notes = resume(session, &volume, resumed, ends)?;
        Ok(Self { notes, ..Self::empty(volume) })
    }

    fn empty(volume: Shared) -> Self {
        let [world, route] = GIVEN.map(str::to_owned);
        Self {
            volume,
            ingest: Ingest::new(),
            size: None,
            offered: 0,
            ledger: Ledger::default(),
            world,
            route,
            smoothing: None,
            corrections: None,
            pose_error_mm: None,
            notes: Vec::new(),
            insert_ms: Vec::new(),
        }
    }

    /// Adds a note for the user.
    pub fn note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// Returns the account of all frames so far.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Inserts a recording, by the threads of a session, until its end or until `ends` is set.
    /// `watch` is called every 20 ms with the status of this recording. Returns the recording's own
    /// account, and a session's differences from the time when it was live.
    ///
    /// # Errors
    /// [`PipelineError`] if the run as a whole fails; slices inserted before remain.
    pub fn extend(
        &mut self,
        session: &Session,
        source: Source,
        ends: &AtomicBool,
        mut watch: impl FnMut(&SessionStatus),
    ) -> Result<(Ledger, Differences), PipelineError> {
        self.end()?;
        if self.ledger.frames.used > 0 {
            self.volume.lock().inserter.extended();
        }
        let before = self.volume.resume();
        let mut last = SessionStatus::default();
        let wiring = Wiring { session, volume: &self.volume, view: None, is_last: true, clock: &Monotonic, ends };
        let ran = wiring.run(source, &mut SchedulingPolicy::default(), Vec::new(), &mut |status| {
            last = status.clone();
            watch(status);
            Vec::new()
        });
        match ran {
            Ok(ran) => {
                self.pose_error_mm =
                    [self.pose_error_mm, ran.status.pose_error_mm()].into_iter().flatten().reduce(f64::max);
                let SessionStatus { ledger, world, route, smoothing, notes, .. } = ran.status;
                (self.world, self.route) = (world, route);
                match (&mut self.smoothing, smoothing) {
                    (Some(own), Some(more)) => own.add(more),
                    (own, more) => *own = own.take().or(more),
                }
                self.corrections =
                    ran.decisions.as_ref().and_then(|decisions| Some(decisions.corrections()?.words.clone()));
                self.notes.extend(notes);
                self.insert_ms.extend(ran.insert_ms);
                self.ledger.add(&ledger);
                Ok((ledger, ran.decisions.map_or_else(Differences::default, |decisions| decisions.differences())))
            }
            Err(error) => {
                // The volume has counted its slices itself.
                let mut ledger = last.ledger;
                let frames = &mut ledger.frames;
                (frames.used, frames.waiting) = (self.volume.lock().pending.inserted - before, 0);
                frames.total = frames.used + frames.refused.values().sum::<u64>();
                self.ledger.add(&ledger);
                Err(error)
            }
        }
    }

    /// Inserts a frame of `size` pixels in MF orientation, u fastest, in native byte order. It may
    /// wait for the mask, if that is to be found.
    ///
    /// # Errors
    /// [`PipelineError`] if no further frame could be inserted either.
    pub fn insert(
        &mut self,
        (size, pixel, pixels): ([u32; 2], PixelType, Arc<[u8]>),
        world_from_image: &[f64; 16],
        time_s: Option<f64>,
    ) -> Result<Inserted, PipelineError> {
        let item = self.offered;
        self.offered += 1;
        self.ledger.arrived();
        let [_, reading] = posed_frames::readings(item, time_s, *world_from_image, (size, pixel, pixels));
        let pose = Transform::<World, Image>::from_rows(world_from_image);
        let slice = match (self.ingest.take(reading), pose) {
            (Sample::Picture(picture), Ok(world_from_image)) => {
                self.ledger.untimed += u64::from(picture.head.untimed);
                Ok(Slice { image: picture.image, time_ns: picture.head.time_ns, world_from_image })
            }
            (Sample::Refused(refusal), _) => Err(refusal),
            (_, Err(bad)) => Err(Refusal::new(item, Reason::from(&bad), bad.to_string())),
            (Sample::Unused(_) | Sample::Transform(_), Ok(_)) => {
                Err(Refusal::new(item, Reason::ImageMissing, "no picture"))
            }
        };
        let slice = slice.and_then(|slice| match *self.size.get_or_insert(size) {
            first if first == size => Ok(slice),
            [width, height] => {
                let [w, h] = size;
                let detail = format!("{w}×{h} pixels after frames of {width}×{height}");
                Err(Refusal::new(item, Reason::SizeChanged, detail))
            }
        });
        match slice {
            Ok(slice) => self.change(|inserter, collector| {
                inserter.extended();
                inserter.insert(item, slice, collector)
            }),
            Err(refusal) => {
                self.ledger.refused(&refusal);
                let waiting = self.ledger.frames.waiting;
                Ok(Inserted { refused: vec![refusal], waiting, ..Inserted::default() })
            }
        }
    }

    /// Inserts the frames that wait: for the mask, by that which the frames so far show, or for the
    /// next one.
    ///
    /// # Errors
    /// Same as [`Self::insert`].
    pub fn end(&mut self) -> Result<Inserted, PipelineError> {
        self.change(|inserter, collector| inserter.end(collector))
    }

    fn change(
        &mut self,
        act: impl FnOnce(&mut crate::inserter::VolumeInserter, &mut Collector<'_>) -> Result<(), PipelineError>,
    ) -> Result<Inserted, PipelineError> {
        let Self { volume, ledger, insert_ms, .. } = self;
        let mut volume = volume.lock();
        let super::shared_volume::SharedVolume { inserter, pending, .. } = &mut *volume;
        let mut collector = Collector { ledger, pending, insert_ms, inserted: Inserted::default() };
        if let Err(error) = act(inserter, &mut collector) {
            // A frame for which there is no memory has its outcome, too.
            if let PipelineError::Memory { item, source } = &error {
                collector.refused(&Refusal::new(*item, Reason::VolumeFull, source.to_string()));
            }
            return Err(error);
        }
        let mut inserted = collector.inserted;
        inserted.waiting = self.ledger.frames.waiting;
        Ok(inserted)
    }

    /// Returns a copy of the present volume with its account, without frames that wait for the
    /// mask. `None` if no slice was inserted.
    ///
    /// # Errors
    /// When the system has no memory for the copy.
    pub fn snapshot(&self) -> std::io::Result<Option<Outcome>> {
        let Some(finished) = self.volume.lock().inserter.snapshot()? else { return Ok(None) };
        let FinishedVolume { reconstructor, chosen, mask, reached, slice_axes, pixels, notes, slices_sha256 } =
            finished;
        Ok(Some(Outcome {
            voxels_updated: reconstructor.work().voxels_updated,
            reconstructor,
            chosen,
            ledger: self.ledger.clone(),
            world: self.world.clone(),
            route: self.route.clone(),
            smoothing: self.smoothing.clone(),
            corrections: self.corrections.clone(),
            pose_error_mm: self.pose_error_mm,
            mask,
            reached,
            slice_axes,
            slices_sha256,
            insert_ms: self.insert_ms.clone(),
            pixels,
            notes: self.ingest.notes().iter().chain(&self.notes).cloned().chain(notes).collect(),
        }))
    }
}

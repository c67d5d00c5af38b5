//! A volume that grows by recordings and by single frames.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use pipeline::PipelineError;
use pipeline::session::{GrowingVolume, Inserted, Source};
use sonoweave_core::ledger::Ledger;
use sonoweave_core::reading::PixelType;

use super::recording::{FRAMES, Run};
use super::session::Opened;
use super::{Keywords, LibraryError, LibraryVolume, Recording};
use crate::app::reconstruct::origin::Origin;
use crate::app::reconstruct::sweep::Sweep;

/// A reconstruction by the command line's settings.
pub struct Reconstruction {
    keywords: Keywords,
    /// Made by the first recording or frame.
    growing: Option<Growing>,
}

struct Growing {
    volume: GrowingVolume,
    /// Settings of the first recording, or of no recording.
    sweep: Sweep,
    /// Keywords of the first recording.
    own: Keywords,
    origin: Origin,
}

impl Reconstruction {
    /// Creates an empty volume.
    ///
    /// # Errors
    /// [`LibraryError`] when a setting does not fit.
    pub fn new(keywords: Keywords) -> Result<Self, LibraryError> {
        sweep_of_nothing(&keywords)?;
        Ok(Self { keywords, growing: None })
    }

    /// Inserts a frame of `size` pixels (width, height) in MF orientation, u fastest, in native
    /// byte order. `world_from_image` is row major and maps pixels (u, v, 0) to world mm.
    ///
    /// # Errors
    /// [`LibraryError`] if no further frame could be inserted either. A refused frame is no error.
    pub fn insert(
        &mut self,
        frame: ([u32; 2], PixelType, Arc<[u8]>),
        world_from_image: &[f64; 16],
        time_s: Option<f64>,
    ) -> Result<Inserted, LibraryError> {
        let memory = Path::new(FRAMES);
        if self.growing.is_none() {
            let sweep = sweep_of_nothing(&self.keywords)?;
            let volume = GrowingVolume::new(&sweep.session, sweep.off_plane);
            let volume = volume.map_err(|error| LibraryError::of_run(memory, error))?;
            let origin = Origin::Frames(memory.into());
            self.growing = Some(Growing { volume, sweep, own: Keywords::default(), origin });
        }
        let Some(growing) = &mut self.growing else { return Ok(Inserted::default()) };
        growing.origin = Origin::Frames(memory.into());
        growing.volume.insert(frame, world_from_image, time_s).map_err(|error| LibraryError::of_run(memory, error))
    }

    /// Inserts a recording, as the command line does, until its end or until `ends` is set. `watch`
    /// is called every 20 ms with the account of this recording so far. Returns its account.
    ///
    /// # Errors
    /// [`LibraryError`] if the run as a whole fails; frames inserted before remain.
    pub fn insert_all(
        &mut self,
        recording: &Recording,
        ends: &AtomicBool,
        mut watch: impl FnMut(&Ledger),
    ) -> Result<Ledger, LibraryError> {
        let failed = |error| LibraryError::of_run(&recording.path, error);
        // The first recording makes the volume.
        let is_first = self.growing.is_none();
        let (sweep, source, made) = match recording.run(&self.keywords, is_first)? {
            Run::Sequence(sweep, sequence) => {
                let made = is_first.then(|| GrowingVolume::of_sequence(&sweep.session, &sequence));
                (sweep, Source::Sequence(sequence), made)
            }
            Run::Session(Opened { sweep, recorded, resumed }) => {
                let made = is_first.then(|| GrowingVolume::of_recording(&sweep.session, &recorded, resumed, ends));
                (sweep, Source::Recording(recorded), made)
            }
        };
        let (mut volume, kept) = match (made.transpose().map_err(failed)?, self.growing.take()) {
            (Some(volume), _) => (volume, None),
            (None, Some(growing)) => (growing.volume, Some((growing.sweep, growing.own))),
            (None, None) => unreachable!("the first recording makes the volume"),
        };
        let ran = volume.extend(&sweep.session, source, ends, |status| watch(&status.ledger));
        let ran = ran.and_then(|(ledger, differences)| {
            if let Some(first) = differences.first.filter(|_| is_first && recording.is_unchanged()) {
                volume.note(format!("{}: differs from the live session; first, {first}", recording.path.display()));
            }
            if ledger.frames.used == 0 {
                return Err(PipelineError::NothingUsed(Box::new(ledger)));
            }
            Ok(ledger)
        });
        let origin = if is_first { recording.origin() } else { Origin::Frames(FRAMES.into()) };
        let (sweep, own) = kept.unwrap_or_else(|| (sweep, recording.keywords()));
        self.growing = Some(Growing { volume, sweep, own, origin });
        ran.map_err(failed)
    }

    /// Returns the account of all frames so far.
    pub fn ledger(&self) -> Ledger {
        self.growing.as_ref().map_or_else(Ledger::default, |growing| growing.volume.ledger().clone())
    }

    /// Returns the present volume. Frames that wait for the mask are inserted before, by the mask
    /// that the frames so far show. `None` if no frame was inserted.
    ///
    /// # Errors
    /// [`LibraryError`] when the system has no memory for a copy.
    pub fn snapshot(&mut self) -> Result<Option<LibraryVolume>, LibraryError> {
        let Some(Growing { volume, sweep, own, origin }) = &mut self.growing else { return Ok(None) };
        volume.end().map_err(|error| LibraryError::of_run(origin.path(), error))?;
        let outcome = volume.snapshot().map_err(|error| {
            LibraryError::Memory(format!("the volume cannot be copied: {error}; write it, or choose a coarser spacing"))
        })?;
        let keywords = self.keywords.or(own);
        outcome.map(|outcome| LibraryVolume::of_outcome(outcome, sweep, keywords, origin.clone())).transpose()
    }
}

/// Returns the settings without a recording.
fn sweep_of_nothing(keywords: &Keywords) -> Result<Sweep, LibraryError> {
    Ok(keywords.flags()?.sweep(Path::new(FRAMES))?)
}

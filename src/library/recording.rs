//! A tracked sequence.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use drivers::replay::Progress;
use pipeline::session::{PosedFrames, Sequence, SequenceInput};
use sonoweave_core::slice::{Image, Pixels};
use sonoweave_core::{NO_DEADLINE, Next};
use sync::ingest::{Ingest, Sample};
use sync::{PairingOptions, Survey};

use super::{Keywords, LibraryError};
use crate::app::input;
use crate::app::reconstruct::sweep::Sweep;

/// A tracked sequence whose poses are known; frames are read when they are needed.
#[derive(Debug, Clone)]
pub struct Recording {
    keywords: Keywords,
    pub(super) path: PathBuf,
    pub(super) input: SequenceInput,
    pub(super) first: u64,
    count: u64,
    survey: Arc<Survey>,
}

/// A frame in MF orientation.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Rows and columns.
    pub shape: [usize; 2],
    /// Grey values, row by row.
    pub pixels: Pixels,
}

impl From<Image> for Picture {
    fn from(image: Image) -> Self {
        Self { shape: [image.height() as usize, image.width() as usize], pixels: image.pixels().clone() }
    }
}

impl Recording {
    /// Opens a sequence file, of which only the header is read. Keywords are those of calibration
    /// and choice: `config`, `preset`, `image_to_probe`, `world`, `frames`.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or has no route to the world.
    pub fn open(path: &Path, keywords: Keywords) -> Result<Self, LibraryError> {
        let failed = |failure| LibraryError::of_failure(path, failure);
        if input::is_session(path).map_err(failed)? {
            return Err(LibraryError::Input(format!(
                "{}: is a session; `sonoweave replay` reconstructs it, and `sonoweave convert` makes a sequence of it",
                path.display()
            )));
        }
        let mut sweep = keywords.flags().and_then(|flags| flags.sweep(path)).map_err(failed)?;
        sweep.input.progress = Progress::default();
        let input = sweep.input.clone().into();
        Self::survey_of(keywords, path, input, &sweep)
    }

    /// Takes frames from memory.
    ///
    /// # Errors
    /// [`LibraryError`] when none of them has a usable pose.
    pub fn of_frames(frames: PosedFrames) -> Result<Self, LibraryError> {
        let (keywords, path) = (Keywords::default(), PathBuf::from(&frames.name));
        let sweep = keywords.flags()?.sweep(&path)?;
        Self::survey_of(keywords, &path, frames.into(), &sweep)
    }

    fn survey_of(keywords: Keywords, path: &Path, input: SequenceInput, sweep: &Sweep) -> Result<Self, LibraryError> {
        let sequence = Sequence::open(input.clone(), sweep.frames.clone(), sweep.off_plane, &sweep.session.pairing);
        let sequence = sequence.map_err(|error| LibraryError::of_run(path, error))?;
        let (first, count) = (sweep.frames.start, sequence.count());
        let survey = Arc::new(sequence.survey().clone());
        Ok(Self { keywords, path: path.to_owned(), input, first, count, survey })
    }

    /// Returns the number of frames to use.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the name of the frame of reference of the poses, and the route to it.
    pub fn world(&self) -> (&str, String) {
        (self.survey.route.world(), self.survey.route.describe())
    }

    /// Returns the pose of each frame, row major: maps pixels (u, v, 0) to world mm. NaN for
    /// frames without a pose.
    pub fn poses(&self) -> Vec<[f64; 16]> {
        let mut poses = vec![[f64::NAN; 16]; self.count as usize];
        for pose in &self.survey.poses {
            if let Some(place) = self.place(pose.item) {
                poses[place] = pose.world_from_image.to_rows();
            }
        }
        poses
    }

    /// Returns the time of each frame, s; NaN for frames without a pose.
    pub fn times_s(&self) -> Vec<f64> {
        let mut times = vec![f64::NAN; self.count as usize];
        for pose in &self.survey.poses {
            if let Some(place) = self.place(pose.item) {
                times[place] = pose.time_ns as f64 / 1e9;
            }
        }
        times
    }

    /// Returns for each frame `ok`, or the reason why it has no pose.
    pub fn status(&self) -> Vec<&'static str> {
        let mut status = vec!["ok"; self.count as usize];
        for refusal in &self.survey.refused {
            if let Some(place) = self.place(refusal.item) {
                status[place] = refusal.reason.name();
            }
        }
        status
    }

    fn place(&self, item: u64) -> Option<usize> {
        let place = item.checked_sub(self.first).filter(|place| *place < self.count)?;
        usize::try_from(place).ok()
    }

    /// Reads one frame, by its number among those to use. A compressed file is read from its
    /// beginning.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or is no usable picture.
    pub fn picture(&self, number: u64) -> Result<Picture, LibraryError> {
        let at = |error| LibraryError::at(&self.path, error);
        let item = self.first + number;
        let mut device = self.input.open_only(Arc::new([item])).map_err(at)?;
        device.start().map_err(at)?;
        let mut ingest = Ingest::new();
        loop {
            match device.next(NO_DEADLINE).map_err(at)? {
                Next::Reading(reading) => match ingest.take(reading) {
                    Sample::Picture(picture) => return Ok(picture.image.into()),
                    Sample::Refused(refusal) => return Err(LibraryError::Input(refusal.to_string())),
                    Sample::Transform(_) | Sample::Unused(_) => {}
                },
                Next::Pending => {}
                Next::End => {
                    return Err(LibraryError::Input(format!(
                        "{}: has no frame {item}; give a number below {}",
                        self.path.display(),
                        self.count
                    )));
                }
            }
        }
    }

    /// Returns the sweep by a reconstruction's keywords, and the sequence for one run.
    pub(super) fn sweep(&self, keywords: &Keywords) -> Result<(Sweep, Sequence), LibraryError> {
        let failed = |failure| LibraryError::of_failure(&self.path, failure);
        let mut sweep =
            keywords.or(&self.keywords).flags().and_then(|flags| flags.sweep(&self.path)).map_err(failed)?;
        let own = self.keywords.flags().and_then(|flags| flags.sweep(&self.path)).map_err(failed)?;
        sweep.frames = own.frames;
        sweep.session.pairing = match self.input {
            SequenceInput::File(_) => own.session.pairing,
            SequenceInput::Frames(_) => PairingOptions::default(),
        };
        let sequence =
            Sequence::open(self.input.clone(), sweep.frames.clone(), sweep.off_plane, &sweep.session.pairing);
        let sequence = sequence.map_err(|error| LibraryError::of_run(&self.path, error))?;
        Ok((sweep, sequence))
    }

    /// Returns the keywords.
    pub(super) fn keywords(&self) -> &Keywords {
        &self.keywords
    }

    /// Whether it is a file.
    pub(super) fn is_file(&self) -> bool {
        matches!(self.input, SequenceInput::File(_))
    }
}

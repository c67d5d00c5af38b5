//! A tracked sequence, or a session.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use drivers::replay::Progress;
use pipeline::session::{PosedFrames, Sequence, SequenceInput, Session};
use sonoweave_core::frames::{self, Transform, World};
use sonoweave_core::slice::{Image, Pixels};
use sonoweave_core::{NO_DEADLINE, Next};
use sync::ingest::{Ingest, Sample};
use sync::{PairingOptions, Survey};

use super::session::{Opened, RecordedSession};
use super::{Keywords, LibraryError};
use crate::app::input;
use crate::app::reconstruct::origin::Origin;
use crate::app::reconstruct::sweep::Sweep;

/// Name of frames in provenance, if they are not those of one file.
pub(super) const FRAMES: &str = "frames in memory";

/// A tracked sequence, or a recorded session; frames are read when they are needed.
pub struct Recording {
    keywords: Keywords,
    pub(super) path: PathBuf,
    content: Content,
}

#[allow(clippy::large_enum_variant, reason = "few, and never moved")]
enum Content {
    /// Frames beside their poses.
    Sequence { input: SequenceInput, first: u64, count: u64, survey: Survey },
    /// Frames whose poses follow from readings around them.
    Session(RecordedSession),
}

/// A recording, opened for one run, with the settings of its reconstruction.
#[allow(clippy::large_enum_variant, reason = "a run has one, moved once")]
pub(super) enum Run {
    Sequence(Sweep, Sequence),
    Session(Opened),
}

/// Poses of all frames.
#[derive(Debug, Clone)]
pub struct Poses {
    /// Pose of each frame, row major: maps pixels (u, v, 0) to world mm. NaN for frames without a
    /// pose.
    pub world_from_image: Vec<[f64; 16]>,
    /// Time of each frame, s; NaN for frames without a pose. A session's are of its host's clock.
    pub times_s: Vec<f64>,
    /// For each frame `ok`, or the reason why it has no pose.
    pub status: Vec<&'static str>,
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
    /// Opens a sequence file, of which only the header is read, or a session (.mcap). Keywords of a
    /// sequence are those of calibration and choice: `config`, `preset`, `image_to_probe`, `world`,
    /// `frames`. A session has `config` alone, another session configuration.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or has no route to the world.
    pub fn open(path: &Path, keywords: Keywords) -> Result<Self, LibraryError> {
        let failed = |failure| LibraryError::of_failure(path, failure);
        if input::is_session(path).map_err(failed)? {
            let content = Content::Session(RecordedSession::open(path, &keywords)?);
            return Ok(Self { keywords, path: path.to_owned(), content });
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
        let Session { pairing, smoothing, .. } = &sweep.session;
        let sequence = Sequence::open(input.clone(), sweep.frames.clone(), sweep.off_plane, pairing, *smoothing);
        let sequence = sequence.map_err(|error| LibraryError::of_run(path, error))?;
        let (first, count) = (sweep.frames.start, sequence.count());
        let content = Content::Sequence { input, first, count, survey: sequence.survey().clone() };
        Ok(Self { keywords, path: path.to_owned(), content })
    }

    /// Returns the number of frames to use.
    pub fn count(&self) -> u64 {
        match &self.content {
            Content::Sequence { count, .. } => *count,
            Content::Session(session) => session.count,
        }
    }

    /// Returns the name of the frame of reference of the poses, and the route to it.
    pub fn world(&self) -> [String; 2] {
        match &self.content {
            Content::Sequence { survey, .. } => [survey.route.world().into(), survey.route.describe()],
            Content::Session(session) => session.world.clone(),
        }
    }

    /// Returns the frames' poses, times and status. Those of a session are paired at the first
    /// call, for which the whole file is read.
    ///
    /// # Errors
    /// [`LibraryError`] when the file cannot be read.
    pub fn poses(&self) -> Result<Poses, LibraryError> {
        let count = self.count() as usize;
        let (world_from_image, times_s) = (vec![[f64::NAN; 16]; count], vec![f64::NAN; count]);
        let mut poses = Poses { world_from_image, times_s, status: vec!["ok"; count] };
        match &self.content {
            Content::Sequence { first, survey, .. } => {
                let place = |item: u64| usize::try_from(item.checked_sub(*first)?).ok().filter(|place| *place < count);
                for pose in &survey.poses {
                    place(pose.item).into_iter().for_each(|at| poses.set(at, pose.time_ns, &pose.world_from_image));
                }
                for refusal in &survey.refused {
                    place(refusal.item).into_iter().for_each(|at| poses.status[at] = refusal.reason.name());
                }
            }
            Content::Session(session) => {
                for (at, frame) in session.paired()?.iter().enumerate() {
                    match frame {
                        Ok((time_ns, pose)) => poses.set(at, *time_ns, pose),
                        Err(reason) => poses.status[at] = reason,
                    }
                }
            }
        }
        Ok(poses)
    }

    /// Reads one frame, by its number among those to use. A compressed sequence is read from its
    /// beginning.
    ///
    /// # Errors
    /// [`LibraryError`] when it cannot be read, or is no usable picture.
    pub fn picture(&self, number: u64) -> Result<Picture, LibraryError> {
        let at = |error| LibraryError::at(&self.path, error);
        let (input, item) = match &self.content {
            Content::Sequence { input, first, .. } => (input, first + number),
            Content::Session(session) => return Ok(session.picture(number as usize)?.into()),
        };
        let mut device = input.open_only(Arc::new([item])).map_err(at)?;
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
                        self.count()
                    )));
                }
            }
        }
    }

    /// Opens it for one run, by a reconstruction's keywords; `is_first` if they make the volume.
    pub(super) fn run(&self, keywords: &Keywords, is_first: bool) -> Result<Run, LibraryError> {
        let input = match &self.content {
            Content::Sequence { input, .. } => input,
            Content::Session(session) => {
                let keywords = if is_first { keywords } else { &Keywords::default() };
                return Ok(Run::Session(session.opened(keywords)?));
            }
        };
        let failed = |failure| LibraryError::of_failure(&self.path, failure);
        let mut sweep =
            keywords.or(&self.keywords).flags().and_then(|flags| flags.sweep(&self.path)).map_err(failed)?;
        let own = self.keywords.flags().and_then(|flags| flags.sweep(&self.path)).map_err(failed)?;
        sweep.frames = own.frames;
        sweep.session.pairing = match input {
            SequenceInput::File(_) => own.session.pairing,
            SequenceInput::Frames(_) => PairingOptions::default(),
        };
        let Session { pairing, smoothing, .. } = &sweep.session;
        let sequence = Sequence::open(input.clone(), sweep.frames.clone(), sweep.off_plane, pairing, *smoothing);
        let sequence = sequence.map_err(|error| LibraryError::of_run(&self.path, error))?;
        Ok(Run::Sequence(sweep, sequence))
    }

    /// Returns the keywords that a volume's outputs need, too.
    pub(super) fn keywords(&self) -> Keywords {
        match &self.content {
            Content::Sequence { .. } => self.keywords.clone(),
            // Its configuration is no calibration file.
            Content::Session(_) => Keywords::default(),
        }
    }

    /// Returns its origin, if its frames are the only ones of a volume.
    pub(super) fn origin(&self) -> Origin {
        match &self.content {
            Content::Sequence { input: SequenceInput::File(_), .. } => Origin::File(self.path.clone()),
            Content::Sequence { input: SequenceInput::Frames(_), .. } => Origin::Frames(FRAMES.into()),
            Content::Session(_) => Origin::Session(self.path.clone()),
        }
    }

    /// Whether the replay of a session is to have the recorded results.
    pub(super) fn is_unchanged(&self) -> bool {
        matches!(&self.content, Content::Session(session) if session.is_unchanged())
    }
}

impl Poses {
    fn set(&mut self, at: usize, time_ns: i64, world_from_image: &Transform<World, frames::Image>) {
        (self.times_s[at], self.world_from_image[at]) = (time_ns as f64 / 1e9, world_from_image.to_rows());
    }
}

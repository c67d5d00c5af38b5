//! The origin of a recorded sequence: a file, or frames in memory.

use std::sync::Arc;

use drivers::replay::{Replay, SequenceSettings};
use sonoweave_core::{Device, Error};

use super::posed_frames::{PosedFrames, PosedFramesDevice};

/// A recorded sequence that can be opened any number of times.
#[derive(Debug, Clone)]
pub enum SequenceInput {
    /// A file.
    File(SequenceSettings),
    /// Frames in memory.
    Frames(PosedFrames),
}

impl From<SequenceSettings> for SequenceInput {
    fn from(settings: SequenceSettings) -> Self {
        Self::File(settings)
    }
}

impl From<PosedFrames> for SequenceInput {
    fn from(frames: PosedFrames) -> Self {
        Self::Frames(frames)
    }
}

impl SequenceInput {
    /// Opens it, without pixels if `images` is false.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open(&self, images: bool) -> Result<Box<dyn Device>, Error> {
        match self {
            Self::File(settings) => Ok(Box::new(Replay::open(&SequenceSettings { images, ..settings.clone() })?)),
            Self::Frames(frames) => Ok(Box::new(PosedFramesDevice::new(frames.clone(), images))),
        }
    }

    /// Opens only some frames, in ascending order, with their pixels.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn open_only(&self, only: Arc<[u64]>) -> Result<Box<dyn Device>, Error> {
        match self {
            Self::File(settings) => {
                Ok(Box::new(Replay::open(&SequenceSettings { only: Some(only), ..settings.clone() })?))
            }
            Self::Frames(frames) => Ok(Box::new(PosedFramesDevice::new(frames.clone(), true).only(only))),
        }
    }

    /// Returns its name, for errors and reports.
    pub fn name(&self) -> String {
        match self {
            Self::File(settings) => settings.path.display().to_string(),
            Self::Frames(frames) => frames.name.clone(),
        }
    }
}

//! The frames of a recorded session, one by one.

use std::path::Path;

use formats::Limits;
use formats::session::Frames;
use sonoweave_core::Timing;
use sonoweave_core::reading::{Frame, Reading};
use sonoweave_core::slice::Image;
use sync::ingest::live::{Gives, Live, LiveIngest};

use crate::app::live::stages::GRABBER;
use crate::failure::Failure;

/// The session's frames.
pub(crate) struct Reel {
    frames: Frames,
    /// Capture time of the first frame, host ns of the recording.
    first_ns: Option<i64>,
}

/// A single frame.
pub(crate) struct Still {
    /// The number that its device gave it.
    pub(crate) item: u64,
    /// Capture time, s after the first frame.
    pub(crate) time_s: f64,
    /// The image in MF orientation.
    pub(crate) image: Image,
}

impl Reel {
    /// Finds all frames.
    ///
    /// # Errors
    /// [`Failure`] when the session cannot be read.
    pub(crate) fn open(session: &Path) -> Result<Self, Failure> {
        Ok(Self { frames: Frames::open(session, GRABBER, &Limits::default())?, first_ns: None })
    }

    /// Returns the number of frames.
    pub(crate) fn count(&self) -> usize {
        self.frames.count()
    }

    /// Reads a frame, by its place from 0.
    ///
    /// # Errors
    /// A sentence when it cannot be read, or is not a usable image.
    pub(crate) fn still(&mut self, place: usize) -> Result<Still, String> {
        let first_ns = match self.first_ns {
            Some(first_ns) => first_ns,
            None => {
                let first = self.frame(0)?;
                *self.first_ns.insert(captured_ns(&first))
            }
        };
        let frame = self.frame(place)?;
        let (item, at_ns) = (frame.stamp.item, captured_ns(&frame));
        // The conversion to an image needs no other frame; its clock is not used.
        match LiveIngest::new(Gives::Pictures, Timing::default(), 0).take(Reading::Frame(frame)) {
            Live::Picture { picture, .. } => {
                let time_s = at_ns.saturating_sub(first_ns) as f64 * 1e-9;
                Ok(Still { item, time_s, image: picture.image })
            }
            Live::Refused(refusal) => Err(refusal.to_string()),
            _ => Err("it is no picture".into()),
        }
    }

    fn frame(&mut self, place: usize) -> Result<Frame, String> {
        let found = self.frames.read(place).map_err(|error| error.to_string())?;
        found.ok_or_else(|| "it is not in the recording".into())
    }
}

fn captured_ns(frame: &Frame) -> i64 {
    frame.stamp.host_ns.unwrap_or_default()
}

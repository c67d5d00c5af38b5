//! The pictures of a recorded session, one by one.

use std::path::Path;

use drivers::Timing;
use drivers::reading::{Frame, Reading};
use drivers::recording::Limits;
use drivers::recording::session::Frames;

use crate::cli::Failure;
use crate::cli::live::stages::GRABBER;
use crate::ingest::live::{Gives, Live, LiveIngest};
use crate::slice::Image;

/// Its frames.
pub(super) struct Reel {
    frames: Frames,
    /// When the first of them was captured, host ns of then.
    first_ns: Option<i64>,
}

/// One of them.
pub(super) struct Still {
    /// The number that its device gave it.
    pub(super) item: u64,
    /// When it was captured, s after the first one.
    pub(super) time_s: f64,
    /// In MF orientation.
    pub(super) image: Image,
}

impl Reel {
    /// Finds them all.
    ///
    /// # Errors
    /// [`Failure`] when the session cannot be read.
    pub(super) fn open(session: &Path) -> Result<Self, Failure> {
        Ok(Self { frames: Frames::open(session, GRABBER, &Limits::default())?, first_ns: None })
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.frames.count()
    }

    /// One of them, by its place from 0.
    ///
    /// # Errors
    /// A sentence where it cannot be read, or is no picture that can be used.
    pub(super) fn still(&mut self, place: usize) -> Result<Still, String> {
        let first_ns = match self.first_ns {
            Some(first_ns) => first_ns,
            None => {
                let first = self.frame(0)?;
                *self.first_ns.insert(captured_ns(&first))
            }
        };
        let frame = self.frame(place)?;
        let (item, at_ns) = (frame.stamp.item, captured_ns(&frame));
        // What makes a picture of it knows no other frame; its clock is not asked.
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

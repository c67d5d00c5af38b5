//! Random access to the frames of a session.

use std::path::{Path, PathBuf};

use sonoweave_core::reading::{Frame, Reading};

use crate::session::message::Maker;
use crate::session::reader::{Event, Message, SessionReader};
use crate::{Error, Limits};

/// Position of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    /// Position of the frame's chunk, bytes from the beginning of the file.
    chunk: u64,
    /// Index of the frame among the device's frames in the chunk.
    within: u32,
}

/// The frames of one device of a session. Reading a frame needs only its chunk, of about 4 MB,
/// and not the frames before it.
///
/// Memory: 16 bytes per frame, and one chunk.
pub struct Frames {
    path: PathBuf,
    reader: SessionReader,
    maker: Maker,
    device: String,
    places: Vec<Place>,
}

impl Frames {
    /// Searches the whole file for the frames of a device, without decoding pixels. Unreadable
    /// parts contribute no frames.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, [`Error::NoSession`] when it is no session.
    pub fn open(path: &Path, device: &str, limits: &Limits) -> Result<Self, Error> {
        let mut reader = SessionReader::open(path, limits)?;
        let mut places: Vec<Place> = Vec::new();
        loop {
            let is_ours = match reader.next_event()? {
                Some(Event::Message(message)) => is_of(&message, device),
                Some(Event::Damage(_)) => false,
                None => break,
            };
            if is_ours {
                let chunk = reader.chunk();
                let before = places.last().filter(|last| last.chunk == chunk);
                let within = before.map_or(0, |last| last.within + 1);
                places.push(Place { chunk, within });
            }
        }
        let maker = Maker::new(true, limits.frame_bytes);
        Ok(Self { path: path.to_owned(), reader, maker, device: device.to_owned(), places })
    }

    /// Returns the number of frames.
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// Returns a frame by its index, from 0; `None` after the last.
    ///
    /// # Errors
    /// [`Error::Io`] when the file can no longer be read. [`Error::Session`] when the frame is
    /// no longer at its position, [`Error::Message`] when this version cannot read it.
    pub fn read(&mut self, place: usize) -> Result<Option<Frame>, Error> {
        let Some(Place { chunk, within }) = self.places.get(place).copied() else { return Ok(None) };
        let Self { path, reader, maker, device, .. } = self;
        let other = || {
            let problem =
                format!("the frame at byte {chunk} is not there any more; the file was written again: reopen it");
            Error::Session { path: path.clone(), problem }
        };
        reader.return_to(chunk)?;
        let mut left = within;
        loop {
            let found = match reader.next_event()? {
                Some(Event::Message(message)) if is_of(&message, device) => {
                    let found = (left == 0).then(|| maker.read(&message));
                    left = left.saturating_sub(1);
                    found
                }
                Some(_) => None,
                None => return Err(other()),
            };
            if reader.chunk() != chunk {
                return Err(other());
            }
            match found {
                Some(Ok(Some(Reading::Frame(frame)))) => return Ok(Some(frame)),
                Some(Ok(_)) => return Err(other()),
                Some(Err(source)) => return Err(Error::Message { path: path.clone(), source }),
                None => {}
            }
        }
    }
}

fn is_of(message: &Message<'_>, device: &str) -> bool {
    message.is_frame() && message.channel.device() == Some(device)
}

//! Frames of a session one by one, in any order.

use std::path::{Path, PathBuf};

use super::message::Maker;
use super::reader::{Event, Message, SessionReader};
use crate::Error;
use crate::reading::{Frame, Reading};
use crate::recording::Limits;

/// Where a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    /// The chunk that has it, bytes from the file's beginning,
    chunk: u64,
    /// and which of the chunk's frames of the device it is.
    within: u32,
}

/// The frames of a session's device, each of which is read without those before it: only the chunk that has it is, which is some 4 MB.
///
/// Memory: 16 bytes a frame, and a chunk.
pub struct Frames {
    path: PathBuf,
    reader: SessionReader,
    maker: Maker,
    device: String,
    places: Vec<Place>,
}

impl Frames {
    /// Looks through the whole file for the frames of a device; no pixels are made. Parts that cannot be read have none.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, [`Error::Session`] when it is no session.
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

    /// How many there are.
    pub fn count(&self) -> usize {
        self.places.len()
    }

    /// A frame by its place among them, from 0; `None` behind the last.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read any more, [`Error::Session`] when the frame is not where it was, or none that this version reads.
    pub fn read(&mut self, place: usize) -> Result<Option<Frame>, Error> {
        let Some(Place { chunk, within }) = self.places.get(place).copied() else { return Ok(None) };
        let Self { path, reader, maker, device, .. } = self;
        let failed = |problem: &str| Error::Session { path: path.clone(), offset: chunk, problem: problem.into() };
        let other = || failed("has something else where a frame was; was it written anew?");
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
                Some(Err(why)) => return Err(failed(&why.to_string())),
                None => {}
            }
        }
    }
}

fn is_of(message: &Message<'_>, device: &str) -> bool {
    message.is_frame() && message.channel.device() == Some(device)
}

//! Movies: pictures of one size at a constant rate, in one file.
//!
//! | file | pictures | for |
//! |---|---|---|
//! | `.apng` | exact | browsers; an animated PNG |
//! | `.gif` | exact if grey, else at most 256 colours each | chats and slides |
//! | `.avi` | JPEG of quality 92 | players; Motion JPEG |
//!
//! A thread of its own encodes, while the caller makes the next picture. Its queue is short and
//! waits, so no picture is left out. The file appears whole or not at all.

mod apng;
mod avi;
mod changed;
mod gif;
mod reel;
#[cfg(test)]
mod tests;

use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use formats::whole::{persist, temporary};
use image::RgbImage;
use tempfile::NamedTempFile;

use super::ExportError;
use reel::Reel;
pub use reel::{Format, Rate};

/// Pictures that wait for the encoder.
const WAITING: usize = 2;

enum Message {
    Picture(Arc<RgbImage>),
    End,
}

/// A movie that is being written. Dropped unfinished, it leaves no file, and an earlier file of
/// its name as it was.
pub struct Movie {
    path: PathBuf,
    reel: Reel,
    pictures: u64,
    queue: Option<SyncSender<Message>>,
    encoder: Option<JoinHandle<io::Result<u64>>>,
}

impl Movie {
    /// Begins a movie of pictures of a size, in the kind of file that its name asks for.
    ///
    /// # Errors
    /// [`ExportError`] for another name, and errors of the file system.
    pub fn create(path: &Path, size: [u32; 2], rate: Rate) -> Result<Self, ExportError> {
        let Some(format) = Format::of(path) else { return Err(ExportError::MovieName { path: path.to_owned() }) };
        let failed = |source| ExportError::Write { path: path.to_owned(), source };
        let file = temporary(path).map_err(failed)?;
        let (queue, pictures) = sync_channel(WAITING);
        let (to, reel) = (path.to_owned(), Reel { size, rate });
        let encoder = std::thread::Builder::new()
            .name("movie".into())
            .spawn(move || encode(format, file, &to, reel, &pictures))
            .map_err(failed)?;
        Ok(Self { path: path.to_owned(), reel, pictures: 0, queue: Some(queue), encoder: Some(encoder) })
    }

    /// Returns the rate.
    pub fn rate(&self) -> Rate {
        self.reel.rate
    }

    /// Returns the number of pictures so far.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Adds a picture. Waits while the encoder is busy with earlier ones.
    ///
    /// # Errors
    /// [`ExportError::Write`], also for earlier pictures.
    ///
    /// # Panics
    /// When the picture has another size: this is an error of the caller.
    pub fn push(&mut self, picture: Arc<RgbImage>) -> Result<(), ExportError> {
        assert_eq!([picture.width(), picture.height()], self.reel.size, "all pictures have the movie's size");
        self.send(Message::Picture(picture))?;
        self.pictures += 1;
        Ok(())
    }

    /// Completes the file. Returns its bytes.
    ///
    /// # Errors
    /// [`ExportError::NoPicture`] and [`ExportError::Write`]; there is no new file then.
    pub fn finish(mut self) -> Result<u64, ExportError> {
        if self.pictures == 0 {
            return Err(ExportError::NoPicture { path: self.path.clone() });
        }
        self.send(Message::End)?;
        self.join()
    }

    fn send(&mut self, message: Message) -> Result<(), ExportError> {
        // The encoder ends early only if it fails.
        match self.queue.as_ref().map(|queue| queue.send(message)) {
            Some(Ok(())) => Ok(()),
            _ => self.join().map(drop),
        }
    }

    fn join(&mut self) -> Result<u64, ExportError> {
        self.queue = None;
        let outcome = match self.encoder.take().map(JoinHandle::join) {
            Some(Ok(outcome)) => outcome,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Err(io::Error::other("the movie has failed before")),
        };
        outcome.map_err(|source| ExportError::Write { path: self.path.clone(), source })
    }
}

impl Drop for Movie {
    fn drop(&mut self) {
        // The temporary file is deleted by the encoder.
        self.queue = None;
        if let Some(encoder) = self.encoder.take() {
            drop(encoder.join());
        }
    }
}

/// Encodes pictures until the end. Returns the file's bytes.
fn encode(format: Format, file: NamedTempFile, path: &Path, reel: Reel, queue: &Receiver<Message>) -> io::Result<u64> {
    let mut to = BufWriter::new(file);
    let mut ended = false;
    let pictures = std::iter::from_fn(|| match queue.recv() {
        Ok(Message::Picture(picture)) => Some(picture),
        Ok(Message::End) => {
            ended = true;
            None
        }
        Err(_) => None,
    });
    match format {
        Format::Apng => apng::write(&mut to, reel, pictures)?,
        Format::Gif => gif::write(&mut to, reel, pictures)?,
        Format::Avi => avi::write(&mut to, reel, pictures)?,
    }
    let file = to.into_inner().map_err(io::IntoInnerError::into_error)?;
    let bytes = file.as_file().metadata()?.len();
    if ended {
        persist(file, path)?;
    }
    Ok(bytes)
}

//! Recordings: sequence files, sessions and what lines brought, and the devices that replay them at any pace.

pub mod image;
mod line;
mod pace;
mod replay;
pub mod session;

pub use line::{LineReplay, Source};
pub use pace::{Pace, Pacer};
pub use replay::Replay;
pub use session::{SessionDriver, SessionSettings};

use std::path::PathBuf;

use crate::{Device, Driver, Error, Listing, OpenSettings};

/// Opens sequence files.
#[derive(Debug)]
pub struct SequenceDriver;

/// What to open, and how much of it.
#[derive(Debug, Clone)]
pub struct SequenceSettings {
    /// The file.
    pub path: PathBuf,
    /// Whether to deliver pixels. Without them, only the header is read: transforms and frames come all the same, the frames' pixels
    /// are empty.
    pub images: bool,
    /// How fast it goes by, by the items' times; items without a time wait for nothing.
    pub pace: Pace,
    /// What the file may ask for at most.
    pub limits: Limits,
    /// Told how far it is before the first reading, of a file all of whose frames must be read for that.
    pub told: Progress,
}

/// Who is told how far something is: how many of how many parts are done.
#[derive(Clone, Default)]
pub struct Progress(pub Option<image::Told>);

impl std::fmt::Debug for Progress {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(if self.0.is_some() { "told" } else { "not told" })
    }
}

impl SequenceSettings {
    /// All of `path`, with default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            images: true,
            pace: Pace::Unpaced,
            limits: Limits::default(),
            told: Progress::default(),
        }
    }
}

/// Upper bounds that keep a damaged or hostile file from taking the machine down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of header. Interpreted, it takes about twice as much memory, and ten times at worst (millions of frames with one short field each).
    pub header_bytes: u64,
    /// Bytes of one frame, decompressed.
    pub frame_bytes: u64,
    /// Frames (or tracker samples, or a volume's slices).
    pub items: u64,
    /// Bytes of all frames together where they must be held at once: their list is the first axis, so that each lies all over the file.
    pub transposed_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { header_bytes: 128 << 20, frame_bytes: 64 << 20, items: 1 << 24, transposed_bytes: 2 << 30 }
    }
}

impl Driver for SequenceDriver {
    fn name(&self) -> &'static str {
        "sequence"
    }

    fn list(&self) -> Vec<Listing> {
        Vec::new()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        let OpenSettings::Sequence(settings) = settings else {
            return Err(Error::Misuse("these settings are not a sequence file's".into()));
        };
        Ok(Box::new(Replay::open(settings)?))
    }
}

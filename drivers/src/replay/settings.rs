//! Settings of replays: the file, the parts to deliver, and the pace.

use std::path::PathBuf;
use std::sync::Arc;

use formats::Limits;
use formats::image::OnRows;

use super::pace::Pace;

/// Settings: the sequence file to open, and the parts to deliver.
#[derive(Debug, Clone)]
pub struct SequenceSettings {
    /// The file.
    pub path: PathBuf,
    /// Whether to deliver pixels. Without them only the header is read: transforms and frames
    /// are still delivered, but the frames' pixels are empty.
    pub images: bool,
    /// Frames to deliver, in ascending order; the others are skipped with their transforms. `None`
    /// for all.
    pub only: Option<Arc<[u64]>>,
    /// Replay pace, by the items' times. Items without a time are delivered at once.
    pub pace: Pace,
    /// Upper bounds on memory and item count.
    pub limits: Limits,
    /// Receives the progress before the first reading, for a file whose frames must all be read
    /// first.
    pub progress: Progress,
}

/// Progress callback: receives the numbers of finished parts and of all parts.
#[derive(Clone, Default)]
pub struct Progress(pub Option<OnRows>);

impl std::fmt::Debug for Progress {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(if self.0.is_some() { "told" } else { "not told" })
    }
}

impl SequenceSettings {
    /// Returns settings for all of `path`, with default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            images: true,
            only: None,
            pace: Pace::Unpaced,
            limits: Limits::default(),
            progress: Progress::default(),
        }
    }
}

/// Settings: the session to open, and the parts to deliver.
#[derive(Debug, Clone)]
pub struct SessionSettings {
    /// The file.
    pub path: PathBuf,
    /// One device of the session; `None` for all.
    pub device: Option<String>,
    /// Whether frames have pixels.
    pub images: bool,
    /// Whether to decode the bytes of lines again, instead of delivering the recorded readings.
    pub decode: bool,
    /// Replay pace, by the times at which readings were handed to the writer.
    pub pace: Pace,
    /// Upper bounds on memory and item count.
    pub limits: Limits,
}

impl SessionSettings {
    /// Returns settings for all of `path` as recorded, unpaced, with default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        let (pace, limits) = (Pace::Unpaced, Limits::default());
        Self { path: path.into(), device: None, images: true, decode: false, pace, limits }
    }
}

//! Reasons why a command to a session is refused, or a volume is not saved.

use std::path::PathBuf;

use export::ExportError;

use crate::MaskRefusal;
use crate::session::NoVolume;

/// Reason why a command is refused. Nothing has changed then.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// There is no folder to record and save in.
    #[error("there is no folder to save in; name one when sonoweave is started")]
    NoFolder,
    /// The session begins or ends.
    #[error("the session is just beginning or ending; wait a moment")]
    Busy,
    /// The session is over.
    #[error("the session is over; record or scan to begin a new one")]
    Over,
    /// The session is recorded already.
    #[error("the session is already being recorded; stop it before you begin another")]
    AlreadyRecording,
    /// The session is not recorded.
    #[error("the session is not recorded; record it to mark moments")]
    NotRecorded,
    /// The session runs already.
    #[error("the session is already running; clear it to begin a new volume")]
    AlreadyRunning,
    /// A volume is being saved.
    #[error("a volume is being saved; wait until it is finished")]
    Saving,
    /// The session is a recording.
    #[error("this session is a recording and cannot be changed; run it again with other settings")]
    Recorded,
    /// The session is live.
    #[error(
        "this session is live; only a recorded session can be run again or shown frame by frame: use sonoweave replay"
    )]
    Live,
    /// The replay begins or ends.
    #[error("the recording is being opened, or its replay is ending; wait a moment")]
    ReplayBusy,
    /// The replay runs.
    #[error("the replay is running; wait for its end, or stop it, to see single frames")]
    ReplayRunning,
    /// There is no such frame.
    #[error("there is no frame {number}; give one from 1 to {frames}")]
    NoFrame {
        /// The requested frame.
        number: u64,
        /// Frames in the recording.
        frames: u64,
    },
    /// The mask cannot be taken.
    #[error(transparent)]
    Mask(#[from] MaskRefusal),
    /// The other settings of a replay are invalid.
    #[error(transparent)]
    Settings(#[from] config::Error),
}

/// Reason why a volume is not saved. No file is left then.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// There is no folder.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// There is no volume.
    #[error(transparent)]
    NoVolume(#[from] NoVolume),
    /// The folder cannot be made.
    #[error("{}: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The folder has no free name.
    #[error("{}: has {most} volumes; choose another folder", folder.display())]
    Full {
        /// The folder.
        folder: PathBuf,
        /// Volumes that it may have.
        most: u32,
    },
    /// The files cannot be written.
    #[error(transparent)]
    Export(#[from] ExportError),
}

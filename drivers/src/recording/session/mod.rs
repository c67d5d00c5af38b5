//! Sessions: all that the devices delivered and the daemon decided, in one MCAP file, as it happened.
//!
//! [`SessionWriter`] writes it, [`SessionReader`] reads it, whole or damaged, [`repair()`] makes a whole one of a damaged one, and [`SessionReplay`] is the device that
//! delivers it again; [`Frames`] are its pictures in any order.
//!
//! # What is in the file
//!
//! | topic | schema | what |
//! |---|---|---|
//! | `/session` | `sonoweave.v1.Session` | both clocks at one instant, first and last of all, and the program |
//! | `/losses` | `sonoweave.v1.Loss` | what could not be written, when and why, by topic |
//! | `/note/KIND` | `sonoweave.v1.Note` | the daemon's own: clock maps, decisions, settings, calibration; JSON, numbered |
//! | `/DEVICE/about` | `sonoweave.v1.Device` | what its lines speak, with which settings, and what it says of itself; again when that changes |
//! | `/DEVICE/raw` | `sonoweave.v1.Raw` | bytes of its lines as they came |
//! | `/DEVICE/image` | `foxglove.CompressedImage` | frames: PNG, without loss (`picture.rs` says why, with figures) |
//! | `/DEVICE/pose/STATION` | `foxglove.PoseInFrame` | poses, in metres for who shows them, and as they came |
//! | `/DEVICE/counts` | `sonoweave.v1.Counts` | counts of an arm |
//! | `/DEVICE/transform` | `sonoweave.v1.Transform` | transforms that know their frames |
//!
//! Messages are Protocol Buffers, with their descriptors in the file: any reader of MCAP takes them apart, and Foxglove shows frames and poses, whose messages are its own
//! with exact values added behind its fields. So there is no second copy for other programs to see: it would have doubled the file. Every message is exact: numbers bit by
//! bit, and whether there was one. Each has the version of its meaning (field 1000), own schemas in their names, too; a number of a field keeps its meaning for ever.
//!
//! A message's `log_time` is when it was handed over to be written, CLOCK_MONOTONIC, never going back; `publish_time` is its own stamp. What has to be added to have times
//! since 1970 is in `/session` and in the file's metadata. `sequence` counts the messages of a topic, those that were lost included. Fields are numbered in `schema.rs`.
//!
//! The wall clock is read by [`About::now`] alone, when a session begins and when it ends: for the file's name, and for what has to be added to its times. Whoever sets it back
//! meanwhile changes the second of the two in `/session`, and no other time.
//!
//! No name of a patient is in a session, and of frames nothing but the part that was asked for.
//!
//! # What becomes of it when something fails
//!
//! Messages are gathered in chunks with a checksum, which go to the disk as a whole when they are half a second or 4 MB old. So a program that is ended at any instant
//! leaves all but the last second. While the disk takes nothing, chunks wait in memory (64 MB), and the file ends with its last whole chunk; then frames are lost, and at
//! last everything, which is counted and said in the file as soon as it takes something again. Each chunk begins with the names of all topics (one of MCAP's private records,
//! 0x81), so that it can be read when those before it cannot.

mod about;
mod account;
mod decode;
mod frames;
mod held;
mod message;
mod picture;
mod place;
mod proto;
mod reader;
mod record;
mod repair;
mod replay;
mod schema;
mod walk;
mod writer;

pub use about::{About, Loss, RecordedDevice};
pub use account::{Account, Room};
pub use decode::Speech;
pub use frames::Frames;
pub use held::Store;
pub use message::{Crop, Maker, Unreadable};
pub use reader::{Channel, Ending, Event, Message, SessionReader};
pub use repair::{Repaired, repair};
pub use replay::SessionReplay;
pub use walk::Damage;
pub use writer::{SessionWriter, Source, WriterOptions};

use std::path::PathBuf;

use super::{Limits, Pace};
use crate::{Device, Driver, Error, Listing, OpenSettings};

/// MCAP's profile of a session, and the name of its metadata.
const PROFILE: &str = "sonoweave";
/// The private record of a chunk that has the file's channels: their numbers, topics and schemas.
const CHANNELS: u8 = 0x81;

/// Opens sessions.
#[derive(Debug)]
pub struct SessionDriver;

/// What to open, and how much of it.
#[derive(Debug, Clone)]
pub struct SessionSettings {
    /// The file.
    pub path: PathBuf,
    /// One device of it; all of it otherwise.
    pub device: Option<String>,
    /// Whether frames have their pixels.
    pub images: bool,
    /// Whether the bytes of lines are decoded anew, instead of delivering the readings that were made of them when they came.
    pub decode: bool,
    /// How fast it goes by, by the times at which readings were handed over.
    pub pace: Pace,
    /// What the file may ask for at most.
    pub limits: Limits,
}

impl SessionSettings {
    /// All of `path` as it was recorded, unpaced, with default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        let (pace, limits) = (Pace::Unpaced, Limits::default());
        Self { path: path.into(), device: None, images: true, decode: false, pace, limits }
    }
}

impl Driver for SessionDriver {
    fn name(&self) -> &'static str {
        "session"
    }

    fn list(&self) -> Vec<Listing> {
        Vec::new()
    }

    fn open(&self, settings: &OpenSettings) -> Result<Box<dyn Device>, Error> {
        let OpenSettings::Session(settings) = settings else {
            return Err(Error::Misuse("these settings are not a session's".into()));
        };
        Ok(Box::new(SessionReplay::open(settings)?))
    }
}

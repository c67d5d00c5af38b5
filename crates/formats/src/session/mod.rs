//! Sessions: all readings of the devices and all decisions of the daemon, in one MCAP file,
//! written live.
//!
//! [`SessionWriter`] writes a session and [`SessionReader`] reads it, intact or damaged.
//! [`repair()`] makes an intact session of a damaged one. `SessionReplay`, in the drivers, is a
//! device that replays it; [`Frames`] gives random access to its frames.
//!
//! # Content of the file
//!
//! | topic | schema | content |
//! |---|---|---|
//! | `/session` | `sonoweave.v1.Session` | both clocks at one instant, and the program; the first and the last message |
//! | `/losses` | `sonoweave.v1.Loss` | messages that could not be written, with time and reason, by topic |
//! | `/note/KIND` | `sonoweave.v1.Note` | the daemon's clock maps, decisions, settings, calibration; JSON, numbered |
//! | `/DEVICE/about` | `sonoweave.v1.Device` | protocol and settings of its lines, and its description; again after a change |
//! | `/DEVICE/raw` | `sonoweave.v1.Raw` | bytes of its lines as received |
//! | `/DEVICE/image` | `foxglove.CompressedImage` | frames: lossless PNG (`picture.rs` gives reasons and measurements) |
//! | `/DEVICE/pose/STATION` | `foxglove.PoseInFrame` | poses, in metres for viewers, and exactly as received |
//! | `/DEVICE/counts` | `sonoweave.v1.Counts` | counts of an arm |
//! | `/DEVICE/transform` | `sonoweave.v1.Transform` | transforms with named frames |
//!
//! Messages are Protocol Buffers, with their descriptors in the file, so that any MCAP reader
//! can decode them. Foxglove shows frames and poses: these use its own messages, with exact
//! values added after its fields. A second copy for other programs is therefore not needed; it
//! would have doubled the file. Every message is exact: every bit of a number, and whether the
//! number was present. Each message has the version of its meaning (field 1000); the project's
//! own schemas also have it in their names. A field number never changes its meaning.
//!
//! A message's `log_time` is the time it was handed to the writer, CLOCK_MONOTONIC, and never
//! decreases. `publish_time` is the message's own stamp. `/session` and the file's metadata
//! give the offset to times since 1970. `sequence` counts the messages of a topic, including
//! lost ones. `schemas/` lists the field numbers.
//!
//! Only [`About::now`] reads the wall clock, at the session's begin and end: for the file's
//! name, and for the offset of its times. If the wall clock is changed meanwhile, only the
//! second offset in `/session` changes, and no other time.
//!
//! A session holds no patient's name, and only the requested part of each frame.
//!
//! # Behaviour on failure
//!
//! The writer collects messages in chunks with a checksum. A chunk is written as a whole when it is
//! 0.4 s old or 4 MB large, and synced on a thread that no write waits for (`syncing.rs`). A
//! program that is killed, or a machine whose power is cut, therefore loses at most the last
//! second. While the disk accepts nothing, chunks wait in memory (64 MB), and the
//! file ends with its last whole chunk. When the memory is full, frames are dropped, and
//! finally everything. The losses are counted, and recorded in the file as soon as writing
//! works again. Each chunk begins with a table of all topics (an MCAP private record, 0x81), so
//! that it is readable without the chunks before it.

pub mod about;
mod account;
mod frames;
pub mod message;
mod names;
mod picture;
mod place;
mod proto;
pub mod reader;
mod record;
mod repair;
pub mod schema;
mod syncing;
pub mod walk;
mod write_buffer;
mod writer;

pub use about::{About, LineProtocol, Loss, RecordedDevice};
pub use account::{Account, Room};
pub use frames::Frames;
pub use message::{Crop, Maker};
pub use reader::{Channel, Ending, Event, Message, SessionReader};
pub use repair::{Repaired, repair};
pub use syncing::{DataSync, Syncer};
pub use walk::Damage;
pub use write_buffer::Store;
pub use writer::{SessionWriter, Source, WriterOptions};

/// MCAP profile of a session, and the name of its metadata record.
const PROFILE: &str = "sonoweave";
/// Private record with the file's channels at the beginning of a chunk: numbers, topics and
/// schemas.
const CHANNELS: u8 = 0x81;

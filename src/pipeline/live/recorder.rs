//! The recording's thread, and the queue before it: nothing that is recorded ever holds up what is recorded.
//!
//! When the disk is slow, what is written waits in the writer's memory first and then in this queue. Frames find it full at three quarters, so that the few bytes of trackers
//! and arms, and what was decided, go on being kept. What is not is counted and named.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use drivers::clock::Clock;
use drivers::reading::Frame;
use drivers::recording::session::{Account, Crop, Room, SessionWriter, Source};
use drivers::{Description, Reading};
use serde::Serialize;

use crate::ingest::stored_rect;
use crate::mask::MaskSettings;

/// Messages that wait for the writer: some seconds of all devices.
const QUEUE: usize = 4096;
/// Of which frames may take so many.
const FRAMES: usize = QUEUE / 4 * 3;
/// The longest that the writer waits before it looks whether something is due.
const TURN: Duration = Duration::from_millis(100);

/// What is written.
enum Entry {
    Reading {
        source: usize,
        reading: Reading,
        at_ns: i64,
    },
    Description {
        source: usize,
        description: Box<Description>,
    },
    Note {
        kind: &'static str,
        json: String,
        at_ns: i64,
        /// It is one of the things that come in, whose times are those of their messages.
        comes_in: bool,
    },
    /// Nothing follows.
    End,
}

/// Where stages hand over what is to be recorded. Without a session nothing is done.
pub(super) struct Recorder {
    queue: Option<Sender<Entry>>,
    lost_frames: AtomicU64,
    lost_others: AtomicU64,
}

/// What became of a session's file.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The file.
    pub path: PathBuf,
    /// What the writer was given, and what became of it.
    pub account: Account,
    /// Frames that found the queue before the writer full.
    pub lost_frames: u64,
    /// Everything else that did.
    pub lost_others: u64,
    /// Room on the disk, as last looked at.
    pub room: Option<Room>,
}

impl Recorder {
    /// One that records nothing.
    pub(super) fn nowhere() -> Self {
        Self { queue: None, lost_frames: AtomicU64::new(0), lost_others: AtomicU64::new(0) }
    }

    /// One that hands over to a thread, and what that thread reads.
    pub(super) fn new() -> (Self, Queue) {
        let (sender, receiver) = bounded(QUEUE);
        (Self { queue: Some(sender), ..Self::nowhere() }, Queue(receiver))
    }

    fn give(&self, entry: Entry) {
        let Some(queue) = &self.queue else { return };
        let is_frame = matches!(entry, Entry::Reading { reading: Reading::Frame(_), .. });
        let lost = if is_frame { &self.lost_frames } else { &self.lost_others };
        if is_frame && queue.len() >= FRAMES {
            lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if let Err(TrySendError::Full(_)) = queue.try_send(entry) {
            lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Whether anything is recorded.
    pub(super) fn records(&self) -> bool {
        self.queue.is_some()
    }

    /// A device's reading.
    pub(super) fn take(&self, source: usize, reading: Reading, at_ns: i64) {
        self.give(Entry::Reading { source, reading, at_ns });
    }

    /// What a device says of itself now.
    pub(super) fn describe(&self, source: usize, description: &Description) {
        if self.queue.is_some() {
            self.give(Entry::Description { source, description: Box::new(description.clone()) });
        }
    }

    /// Something that was decided.
    pub(super) fn note(&self, kind: &'static str, value: &impl Serialize, at_ns: i64) {
        self.note_of(kind, value, at_ns, false);
    }

    /// Something that comes in, as readings do.
    pub(super) fn comes_in(&self, kind: &'static str, value: &impl Serialize, at_ns: i64) {
        self.note_of(kind, value, at_ns, true);
    }

    fn note_of(&self, kind: &'static str, value: &impl Serialize, at_ns: i64, comes_in: bool) {
        if self.queue.is_none() {
            return;
        }
        match serde_json::to_string(value) {
            Ok(json) => self.give(Entry::Note { kind, json, at_ns, comes_in }),
            Err(error) => tracing::error!(kind, %error, "cannot be recorded"),
        }
    }

    /// What found the queue full: frames, and everything else.
    pub(super) fn lost(&self) -> [u64; 2] {
        [&self.lost_frames, &self.lost_others].map(|lost| lost.load(Ordering::Relaxed))
    }

    /// The thread ends when it has written what waits.
    pub(super) fn close(&self) {
        if let Some(queue) = &self.queue
            && queue.send(Entry::End).is_err()
        {
            tracing::error!("the recording's thread is gone");
        }
    }
}

/// What waits to be written.
pub(super) struct Queue(Receiver<Entry>);

/// Of frames the part that is kept: the rectangle of what is data, in the pixels as they are stored.
struct Cropping {
    mask: MaskSettings,
    /// Size and orientation of the frames that a source's crop is for.
    known: Vec<Option<([u32; 2], String)>>,
}

impl Cropping {
    /// Sees to it that the writer crops this frame as it should.
    fn prepare(&mut self, frame: &Frame, source: usize, writer: &mut SessionWriter, of_writer: Source) {
        let known = &mut self.known[source];
        if known.as_ref().is_some_and(|(size, code)| *size == frame.size && *code == frame.orientation) {
            return;
        }
        *known = Some((frame.size, frame.orientation.clone()));
        let rect = stored_rect(frame.size, &frame.orientation, |size| self.mask.bounds(size));
        let crop = rect.map(|rect| Crop { offset: [rect.x, rect.y], size: [rect.width, rect.height] });
        writer.crop(of_writer, crop);
    }
}

/// Writes until the queue is closed, and ends the file. Of frames what `kept` says is data is kept, all of them without.
pub(super) fn run(
    queue: &Queue,
    mut writer: SessionWriter,
    sources: &[Source],
    kept: Option<MaskSettings>,
    clock: &dyn Clock,
    mut told: impl FnMut(&Account, Option<Room>),
) -> Recording {
    let mut cropping = kept.map(|mask| Cropping { mask, known: vec![None; sources.len()] });
    let path = writer.path().to_owned();
    let mut room = None;
    let mut looked_ns = i64::MIN;
    loop {
        let written = match queue.0.recv_timeout(TURN) {
            Ok(Entry::Reading { source, reading, at_ns }) => {
                if let (Some(cropping), Reading::Frame(frame)) = (&mut cropping, &reading) {
                    cropping.prepare(frame, source, &mut writer, sources[source]);
                }
                writer.write(sources[source], &reading, at_ns)
            }
            Ok(Entry::Description { source, description }) => writer.describe(sources[source], &description),
            Ok(Entry::Note { kind, json, at_ns, comes_in: true }) => writer.note(kind, &json, at_ns),
            Ok(Entry::Note { kind, json, at_ns, comes_in: false }) => writer.note_behind(kind, &json, at_ns),
            Err(RecvTimeoutError::Timeout) => writer.tick(clock.now_ns()),
            Ok(Entry::End) | Err(RecvTimeoutError::Disconnected) => break,
        };
        if let Err(error) = written {
            // Acquisition goes on; what is lost meanwhile the writer counts.
            tracing::error!("{}: {error}", path.display());
        }
        let now_ns = clock.now_ns();
        if now_ns.saturating_sub(looked_ns) >= drivers::clock::SECOND {
            looked_ns = now_ns;
            room = writer.room();
            told(&writer.account(), room);
        }
    }
    let before = writer.account();
    let account = writer.finish(clock.now_ns()).unwrap_or_else(|error| {
        tracing::error!("{}: {error}", path.display());
        Account { trouble: error.to_string(), ..before }
    });
    told(&account, room);
    Recording { path, account, lost_frames: 0, lost_others: 0, room }
}

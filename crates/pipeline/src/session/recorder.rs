//! The recording's thread, and the queue before it. Recording never delays its sources.
//!
//! When the disk is slow, messages wait in the writer's memory first and then in this queue.
//! Frames find it full at three quarters, so that the few bytes of trackers and arms and the
//! decisions are still kept. Lost messages are counted by kind, in the file too: notes of the
//! kind `lost` give the total so far. Before less space is left on the disk than is to be kept
//! free, the file is ended properly, with a note of the kind `end`. Later messages are counted,
//! too.
//!
//! A second thread syncs the written data, so that a power cut takes at most the last second
//! ([`Syncer`](formats::session::Syncer)). The writer does not wait for it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use serde::Serialize;
use tracing::trace_span;

use formats::session::{Account, Crop, LineProtocol, Room, SessionWriter, Source};
use mask::MaskSettings;
use sonoweave_core::clock::Clock;
use sonoweave_core::reading::Frame;
use sonoweave_core::{Description, Reading};
use sync::ingest::stored_rect;

use super::memory::places;
use super::priority::{Role, SchedulingPolicy};
use super::recorded_decisions::RULES;
use super::spawn::spawn;
use super::unsynced::Unsynced;
use crate::trace::STAGE;

/// Messages that wait for the writer: some seconds of all devices.
const QUEUE: usize = 4096;
/// Limit of frames among them.
const FRAMES: usize = QUEUE / 4 * 3;
/// Longest wait before the writer checks whether something is due.
const TURN: Duration = Duration::from_millis(100);

/// An entry to be written.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved twice")]
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
        /// Whether it is a session event, which has the time of its message.
        comes_in: bool,
    },
    /// No entry follows.
    End,
}

/// Space for the end of the file, which is its index, bytes.
const END_BYTES: u64 = 1 << 20;

/// Settings of a session's recording.
pub struct Record {
    /// The file, open.
    pub writer: SessionWriter,
    /// Keep whole frames. Otherwise only the data rectangle of each frame is kept, according to
    /// the mask's settings.
    pub full_frame: bool,
    /// Initial notes by kind: settings, calibration.
    pub notes: Vec<(&'static str, serde_json::Value)>,
    /// Space to be left free on the disk, bytes; at 0 the disk is filled.
    pub keep_free_bytes: u64,
}

/// Takes messages for the recording from the stages. Does nothing if the session is not
/// recorded.
pub(super) struct Recorder {
    queue: Option<Sender<Entry>>,
    lost: Arc<Lost>,
}

/// Frames and other messages that found the queue full.
#[derive(Default)]
struct Lost {
    frames: AtomicU64,
    others: AtomicU64,
}

impl Lost {
    fn so_far(&self) -> Unwritten {
        let [frames, others] = [&self.frames, &self.others].map(|lost| lost.load(Ordering::Relaxed));
        Unwritten { frames, others }
    }
}

/// Messages that were to be recorded and never reached the writer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Unwritten {
    /// Frames.
    pub frames: u64,
    /// Readings, notes and decisions.
    pub others: u64,
}

impl Unwritten {
    /// Returns their sum.
    pub fn total(self) -> u64 {
        self.frames + self.others
    }

    fn add(&mut self, entry: &Entry) {
        match entry {
            Entry::Reading { reading: Reading::Frame(_), .. } => self.frames += 1,
            Entry::Reading { .. } | Entry::Description { .. } | Entry::Note { .. } => self.others += 1,
            Entry::End => {}
        }
    }
}

/// State of a session's file.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// The file.
    pub path: PathBuf,
    /// Messages given to the writer, and their outcome.
    pub status: Account,
    /// Messages that found the queue before the writer full.
    pub lost: Unwritten,
    /// Reason why the file ended before the session, as a sentence; empty otherwise.
    pub ended: String,
    /// Messages that arrived after that.
    pub after_end: Unwritten,
    /// Data that are not synced.
    pub unsynced: Unsynced,
    /// Space on the disk that the recording may still take, as last checked.
    pub room: Option<Room>,
}

impl Recorder {
    /// Returns a recorder that records nothing.
    pub(super) fn nowhere() -> Self {
        Self { queue: None, lost: Arc::default() }
    }

    /// Returns a recorder that feeds a thread, and that thread's queue.
    pub(super) fn new() -> (Self, Queue) {
        let (sender, receiver) = bounded(QUEUE);
        let lost = Arc::<Lost>::default();
        (Self { queue: Some(sender), lost: Arc::clone(&lost) }, Queue { entries: receiver, lost })
    }

    /// Returns the memory of its queue's places, bytes.
    pub(super) fn place_bytes(&self) -> usize {
        self.queue.as_ref().map_or(0, places)
    }

    fn give(&self, entry: Entry) {
        let Some(queue) = &self.queue else { return };
        let is_frame = matches!(entry, Entry::Reading { reading: Reading::Frame(_), .. });
        let lost = if is_frame { &self.lost.frames } else { &self.lost.others };
        if is_frame && queue.len() >= FRAMES {
            lost.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if let Err(TrySendError::Full(_)) = queue.try_send(entry) {
            lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Returns whether anything is recorded.
    pub(super) fn records(&self) -> bool {
        self.queue.is_some()
    }

    /// Records a device's reading.
    pub(super) fn take(&self, source: usize, reading: Reading, at_ns: i64) {
        self.give(Entry::Reading { source, reading, at_ns });
    }

    /// Records a device's present description.
    pub(super) fn describe(&self, source: usize, description: &Description) {
        if self.queue.is_some() {
            self.give(Entry::Description { source, description: Box::new(description.clone()) });
        }
    }

    /// Records a decision.
    pub(super) fn note(&self, kind: &'static str, value: &impl Serialize, at_ns: i64) {
        self.note_of(kind, value, at_ns, false);
    }

    /// Records that the session has this program's rules. A replay has those of its recording.
    pub(super) fn note_rules(&self, at_ns: i64) {
        RULES.iter().for_each(|rule| self.note(rule, &true, at_ns));
    }

    /// Records a session event other than a reading.
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

    /// Ends the thread after it has written all waiting messages.
    pub(super) fn close(&self) {
        if let Some(queue) = &self.queue
            && queue.send(Entry::End).is_err()
        {
            tracing::error!("the recording's thread is gone");
        }
    }
}

/// Begins a session's file with the devices' descriptions, in the order of their indices, and
/// the initial notes. Returns the stages' side and the thread's side.
///
/// # Errors
/// The writer's, if it cannot take them.
pub(super) fn open<'a>(
    Record { mut writer, full_frame, notes, keep_free_bytes: _ }: Record,
    devices: impl Iterator<Item = (&'a str, Option<LineProtocol>, &'a Description)>,
    mask: MaskSettings,
    keep_free: &Arc<AtomicU64>,
    clock: &dyn Clock,
) -> Result<(Recorder, (Queue, File)), sonoweave_core::Error> {
    let mut sources = Vec::new();
    for (name, protocol, description) in devices {
        sources.push(writer.device(name, protocol, description, None)?);
    }
    for (kind, note) in &notes {
        writer.note(kind, &note.to_string(), clock.now_ns())?;
    }
    let (of_stages, queue) = Recorder::new();
    let kept = (!full_frame).then_some(mask);
    Ok((of_stages, (queue, File { writer, sources, kept, keep_free: Arc::clone(keep_free) })))
}

/// Starts the threads that write and sync a session's file. The first reports once per second, and
/// returns the outcome.
pub(super) fn start<'scope, 'env: 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    policy: &SchedulingPolicy,
    (queue, file): (Queue, File),
    clock: &'env dyn Clock,
    report: impl FnMut(&Recording) + Send + 'scope,
) -> ScopedJoinHandle<'scope, Recording> {
    let syncer = file.writer.syncer();
    spawn(scope, "recorder-sync", (policy, Role::Usual), move || syncer.run());
    spawn(scope, "recorder", (policy, Role::Usual), move || run(&queue, file, clock, report))
}

/// Messages that wait to be written.
pub(super) struct Queue {
    entries: Receiver<Entry>,
    lost: Arc<Lost>,
}

/// The file that a session is written to.
pub(super) struct File {
    pub(super) writer: SessionWriter,
    /// Devices in the order of their indices.
    pub(super) sources: Vec<Source>,
    /// Mask of the data that is kept of a frame; without it, whole frames are kept.
    pub(super) kept: Option<MaskSettings>,
    /// Space to be left free on the disk, bytes; may change during the recording.
    pub(super) keep_free: Arc<AtomicU64>,
}

/// Crops frames to the part that is kept: the rectangle of the data, in the pixels as they are
/// stored.
struct Cropping {
    mask: MaskSettings,
    /// Size and orientation of the frames that a source's crop is for.
    known: Vec<Option<([u32; 2], Cow<'static, str>)>>,
}

impl Cropping {
    /// Sets the writer's crop for this frame.
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

/// Writes until the queue is closed, or until less space than `keep_free` would be left; then
/// ends the file.
fn run(queue: &Queue, file: File, clock: &dyn Clock, mut report: impl FnMut(&Recording)) -> Recording {
    let File { writer, sources, kept, keep_free } = file;
    let mut cropping = kept.map(|mask| Cropping { mask, known: vec![None; sources.len()] });
    let mut recording = Recording {
        path: writer.path().to_owned(),
        status: Account::default(),
        lost: Unwritten::default(),
        ended: String::new(),
        after_end: Unwritten::default(),
        unsynced: Unsynced::default(),
        room: None,
    };
    let mut open = Some(writer);
    let mut noted = Unwritten::default();
    let mut checked_ns = i64::MIN;
    loop {
        let entry = match queue.entries.recv_timeout(TURN) {
            Ok(Entry::End) | Err(RecvTimeoutError::Disconnected) => break,
            Ok(entry) => Some(entry),
            Err(RecvTimeoutError::Timeout) => None,
        };
        let Some(writer) = &mut open else {
            if let Some(entry) = &entry {
                recording.after_end.add(entry);
            }
            continue;
        };
        let written = match entry {
            Some(Entry::Reading { source, reading, at_ns }) => {
                if let (Some(cropping), Reading::Frame(frame)) = (&mut cropping, &reading) {
                    cropping.prepare(frame, source, writer, sources[source]);
                }
                let frame = matches!(reading, Reading::Frame(_)).then(|| reading.stamp().item);
                let _span = frame.map(|frame| trace_span!(target: STAGE, "record", frame).entered());
                writer.write(sources[source], &reading, at_ns)
            }
            Some(Entry::Description { source, description }) => writer.describe(sources[source], &description),
            Some(Entry::Note { kind, json, at_ns, comes_in: true }) => writer.note(kind, &json, at_ns),
            Some(Entry::Note { kind, json, at_ns, comes_in: false }) => writer.note_behind(kind, &json, at_ns),
            Some(Entry::End) | None => writer.tick(clock.now_ns()),
        };
        if let Err(error) = written {
            // Acquisition continues; the writer counts the messages lost meanwhile.
            tracing::error!("{}: {error}", recording.path.display());
        }
        let now_ns = clock.now_ns();
        let keep_free = keep_free.load(Ordering::Relaxed);
        let room = writer.room();
        let status = writer.account();
        let unsynced_ns = status.unsynced_since_ns.map_or(0, |since_ns| now_ns - since_ns);
        recording.unsynced.note(unsynced_ns, now_ns, &recording.path);
        let held = status.held_bytes;
        let needed = keep_free.saturating_add(held).saturating_add(END_BYTES);
        let is_full = keep_free > 0 && room.is_some_and(|room| room.free_bytes < needed);
        if !is_full && now_ns.saturating_sub(checked_ns) < sonoweave_core::clock::SECOND {
            continue;
        }
        // Space that may still be written.
        let left = room.map(|room| Room { free_bytes: room.free_bytes.saturating_sub(keep_free), ..room });
        (checked_ns, recording.room) = (now_ns, left);
        if is_full {
            recording.ended = format!(
                "the recording has ended, so that {} MB stay free on the disk: make room, and begin a new session; what comes now is not recorded",
                keep_free / 1_000_000
            );
            tracing::error!("{}: {}", recording.path.display(), recording.ended);
            end(&mut open, queue, noted, clock, &mut recording);
        } else {
            recording.lost = note_lost(writer, queue, &mut noted, now_ns);
            recording.status = writer.account();
        }
        report(&recording);
    }
    end(&mut open, queue, noted, clock, &mut recording);
    report(&recording);
    recording
}

/// Notes losses in the queue in the file, if they have increased. Tries again until there is
/// room for the note.
fn note_lost(writer: &mut SessionWriter, queue: &Queue, noted: &mut Unwritten, now_ns: i64) -> Unwritten {
    let lost = queue.lost.so_far();
    if lost == *noted {
        return lost;
    }
    // Messages waiting in memory go to the disk first, if it takes any.
    logged(writer.tick(now_ns), writer.path());
    let before = writer.account().lost;
    logged(writer.note_behind("lost", &serde_json::json!(lost).to_string(), now_ns), writer.path());
    if writer.account().lost == before {
        *noted = lost;
        log_lost(writer.path(), lost);
    }
    lost
}

fn log_lost(path: &Path, lost: Unwritten) {
    tracing::error!("{}: {} messages found the queue before the disk full", path.display(), lost.total());
}

fn logged(outcome: Result<(), formats::Error>, path: &Path) {
    if let Err(error) = outcome {
        tracing::error!("{}: {error}", path.display());
    }
}

/// Ends the file, with the losses in the queue, if they were not noted, and the reason, if it
/// ends before the session.
fn end(
    open: &mut Option<SessionWriter>,
    queue: &Queue,
    noted: Unwritten,
    clock: &dyn Clock,
    recording: &mut Recording,
) {
    let Some(mut writer) = open.take() else { return };
    let now_ns = clock.now_ns();
    recording.lost = queue.lost.so_far();
    if recording.lost != noted {
        log_lost(&recording.path, recording.lost);
        logged(writer.last_note("lost", &serde_json::json!(recording.lost).to_string(), now_ns), &recording.path);
    }
    if !recording.ended.is_empty() {
        let why = serde_json::json!({ "why": recording.ended }).to_string();
        logged(writer.last_note("end", &why, now_ns), &recording.path);
    }
    let before = writer.account();
    match writer.finish(now_ns) {
        Ok(status) => {
            recording.status = status;
            recording.unsynced.ended();
        }
        Err(error) => {
            tracing::error!("{}: {error}", recording.path.display());
            // Those that waited are lost.
            let lost = before.messages - before.stored;
            recording.status = Account { trouble: error.to_string(), lost, held_bytes: 0, ..before };
        }
    }
}

#[cfg(test)]
mod tests {
    use formats::Limits;
    use formats::session::{Event, Maker, SessionReader, WriterOptions};
    use sonoweave_core::clock::{Manual, SECOND};

    use super::*;

    #[test]
    fn last_note_of_losses_is_there_even_if_no_memory_is_left() {
        let folder = tempfile::tempdir().unwrap();
        // No chunk is due before the end, so that all wait in memory, which has room for few.
        let options = WriterOptions { chunk_ns: 3600 * SECOND, held_bytes: 10_000, ..WriterOptions::new("a test") };
        let writer = SessionWriter::create(folder.path(), options).unwrap();
        let (recorder, queue) = Recorder::new();
        recorder.note("test", &"", 0);
        let mut recorder = Some(recorder);
        let more = 10;
        let file = File { writer, sources: Vec::new(), kept: None, keep_free: Arc::default() };
        // More messages than the queue holds come while the first report is made. The clock
        // stands still, so that the losses are not looked at again before the end.
        let recording = run(&queue, file, &Manual::at(0), |_| {
            if let Some(recorder) = recorder.take() {
                let text = "-".repeat(100);
                (0..QUEUE + more).for_each(|_| recorder.note("test", &text, 0));
            }
        });
        assert_eq!(recording.lost, Unwritten { frames: 0, others: more as u64 });
        assert!(recording.status.lost > QUEUE as u64 / 2, "the memory was full: {:?}", recording.status);

        let mut reader = SessionReader::open(&recording.path, &Limits::default()).unwrap();
        let mut maker = Maker::new(false, Limits::default().frame_bytes);
        let mut notes = Vec::new();
        while let Some(event) = reader.next_event().unwrap() {
            if let Event::Message(message) = event
                && let Some(Reading::Recorded(note)) = maker.read(&message).unwrap()
                && note.topic == "lost"
            {
                notes.push(note.text);
            }
        }
        assert_eq!(notes, [format!(r#"{{"frames":0,"others":{more}}}"#)]);
    }
}

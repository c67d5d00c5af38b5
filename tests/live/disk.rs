//! A full, slow or read-only disk: acquisition continues, and losses are counted and reported.

use std::io::{Cursor, Error, ErrorKind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use drivers::simulated::Faults;
use drivers::simulated::grabber::Grabber;
use formats::Limits;
use formats::session::{
    About, DataSync, Ending, Event, Loss, Maker, SessionReader, SessionWriter, Store, WriterOptions,
};
use pipeline::session::{Finished, Recording};
use sonoweave_core::Reading;
use sonoweave_core::clock::{MS, Monotonic, SECOND};

use crate::script::{Act, Script, begin, frames as all_frames, pose, poses, poses_timing};
use crate::set::{Memory, SIZE, Set, frames};

/// Content of a session's file.
#[derive(Default)]
pub(crate) struct Read {
    pub(crate) frame_numbers: Vec<u64>,
    pub(crate) poses: u64,
    pub(crate) messages: u64,
    pub(crate) times: Vec<i64>,
    pub(crate) losses: Vec<Loss>,
    pub(crate) notes: Vec<(String, String)>,
    pub(crate) ending: Option<Ending>,
    /// Missing messages, by the numbers of the others.
    pub(crate) missing: u64,
    pub(crate) damaged: bool,
}

pub(crate) fn read(bytes: &[u8]) -> Read {
    let limits = Limits::default();
    let mut reader =
        SessionReader::of(Cursor::new(bytes), bytes.len() as u64, Path::new("memory.mcap"), &limits).unwrap();
    let mut maker = Maker::new(false, limits.frame_bytes);
    let mut read = Read::default();
    while let Some(event) = reader.next_event().unwrap() {
        let Event::Message(message) = event else {
            read.damaged = true;
            continue;
        };
        read.messages += 1;
        read.times.push(message.log_ns());
        read.losses.extend(message.loss());
        match maker.read(&message).unwrap() {
            Some(Reading::Frame(frame)) => read.frame_numbers.push(frame.frame_number.unwrap()),
            Some(Reading::Pose(_)) => read.poses += 1,
            Some(Reading::Recorded(note)) => read.notes.push((note.topic, note.text)),
            _ => {}
        }
    }
    read.ending = reader.ending();
    read.missing = reader.channels().iter().map(|channel| channel.missing).sum();
    read
}

impl Read {
    /// Returns the messages of a kind that were lost according to the file.
    fn lost(&self, topic: &str) -> u64 {
        self.losses.iter().flat_map(|loss| &loss.lost).filter(|(of, ..)| of.contains(topic)).map(|(_, n, _)| n).sum()
    }

    fn notes_of(&self, kind: &str) -> Vec<&str> {
        self.notes.iter().filter(|(of, _)| of == kind).map(|(_, text)| text.as_str()).collect()
    }
}

/// Checks that everything received is in the file or reported as lost, by kind.
fn agrees(finished: &Finished, read: &Read) {
    let recording = finished.recording.as_ref().unwrap();
    let Recording { status, lost, after_end, .. } = recording;
    let ledger = &finished.status.ledger;
    assert_eq!((read.ending, read.damaged), (Some(Ending::Finished), false));
    assert!(read.times.is_sorted(), "times go forward");
    let in_file = read.frame_numbers.len() as u64;
    let of_frames = read.lost("/image") + lost.frames + after_end.frames;
    assert_eq!(ledger.frames.total, in_file + of_frames, "{recording:?}");
    // Every message given to the writer was written or reported.
    assert_eq!(status.messages, status.stored + status.lost, "{status:?}");
    assert_eq!(status.stored, read.messages);
    assert_eq!(status.lost, read.losses.iter().map(Loss::messages).sum::<u64>());
    if lost.total() > 0 {
        let reported: serde_json::Value = serde_json::from_str(read.notes_of("lost").last().unwrap()).unwrap();
        assert_eq!((reported["frames"].as_u64(), reported["others"].as_u64()), (Some(lost.frames), Some(lost.others)));
    }
    let readings = &ledger.readings[0];
    let unwritten = read.lost("/pose") + lost.others + after_end.others;
    assert!(read.poses <= readings.total && read.poses + unwritten >= readings.total, "{}", readings.total);
}

/// A disk that refuses writes for a while, and those beyond its room.
#[derive(Clone)]
struct Refusing {
    disk: Memory,
    why: ErrorKind,
    refuses: Arc<AtomicBool>,
    /// Size of the largest file, bytes.
    room: u64,
}

impl Store for Refusing {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> std::io::Result<()> {
        let left = self.room.saturating_sub(at).min(bytes.len() as u64) as usize;
        // Half of the data were written, like on a real disk.
        let written = if self.refuses.load(Ordering::Relaxed) { left / 2 } else { left };
        self.disk.write_at(&bytes[..written], at)?;
        if written < bytes.len() { Err(Error::from(self.why)) } else { Ok(()) }
    }

    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        self.disk.cut(length)
    }

    fn data_sync(&self) -> std::io::Result<Box<dyn DataSync>> {
        Ok(Box::new(()))
    }

    fn free_bytes(&self) -> Option<u64> {
        None
    }
}

/// Small chunks, and little memory to wait in.
fn tight() -> WriterOptions {
    WriterOptions { chunk_ns: 50 * MS, held_bytes: 10_000, retry_ns: 50 * MS, ..WriterOptions::new("a test") }
}

#[test]
fn temporary_disk_failure_stops_nothing_and_losses_are_counted() {
    for why in [ErrorKind::StorageFull, ErrorKind::ReadOnlyFilesystem, ErrorKind::PermissionDenied] {
        let begin_ns = begin();
        let refuses = Arc::new(AtomicBool::new(false));
        let disk = Refusing { disk: Memory::default(), why, refuses: Arc::clone(&refuses), room: u64::MAX };
        let set = Set::of(poses(begin_ns, 75), all_frames(begin_ns, 75)).recorded(disk.clone(), tight(), 0);
        let (finished, seen) = set.until(|status, _| {
            refuses.store((15..50).contains(&status.ledger.frames.total), Ordering::Relaxed);
            false
        });
        assert_eq!(frames(&finished), (75, 75, vec![]), "the volume has them all");
        let read = read(&disk.disk.bytes());
        agrees(&finished, &read);
        assert!(read.lost("/image") > 0, "{why}: {:?}", finished.recording);
        let recording = finished.recording.as_ref().unwrap();
        assert_eq!((recording.status.failures, recording.status.trouble.as_str()), (1, ""));
        assert!(read.losses[0].why.contains("writing the session"), "{:?}", read.losses);
        // The status reports the losses too, during the failure or at least at the end.
        assert_eq!(seen.written.last().unwrap().lost, recording.status.lost);
    }
}

#[test]
fn full_disk_leaves_file_valid_up_to_that_point() {
    let begin_ns = begin();
    // By room, not by time: a busy machine stores late, and frames later than poses. All messages
    // but those of frames take less than half of it, and all together twice as much.
    let refuses = Arc::default();
    let disk = Refusing { disk: Memory::default(), why: ErrorKind::StorageFull, refuses, room: 150_000 };
    // Memory for all, so that a busy machine loses none before the disk is full.
    let options = WriterOptions { held_bytes: 10 << 20, ..tight() };
    let set = Set::of(poses(begin_ns, 60), all_frames(begin_ns, 60)).recorded(disk.clone(), options, 0);
    let (finished, seen) = set.until(|_, _| false);
    assert_eq!(frames(&finished), (60, 60, vec![]));
    let status = &finished.recording.as_ref().unwrap().status;
    assert!(status.trouble.contains("memory.mcap") && status.lost > 0, "{status:?}");
    assert_eq!(seen.written.last().unwrap().trouble, status.trouble, "and on the status");
    let read = read(&disk.disk.bytes());
    assert_eq!((read.ending, read.damaged, read.messages), (Some(Ending::BrokenOff), false, status.stored));
    let numbers = &read.frame_numbers;
    assert!(numbers.len() >= 10 && numbers.iter().copied().eq(0..numbers.len() as u64), "{numbers:?}");
}

/// A slow disk.
struct Slow {
    disk: Memory,
    each: Duration,
    slow: Arc<AtomicBool>,
}

impl Store for Slow {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> std::io::Result<()> {
        if self.slow.load(Ordering::Relaxed) {
            std::thread::sleep(self.each);
        }
        self.disk.write_at(bytes, at)
    }

    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        self.disk.cut(length)
    }

    fn data_sync(&self) -> std::io::Result<Box<dyn DataSync>> {
        Ok(Box::new(()))
    }

    fn free_bytes(&self) -> Option<u64> {
        None
    }
}

#[test]
fn slow_disk_loses_recorded_frames_first_and_no_slices() {
    // 3000 poses per second, so that the queue of some seconds is full within two; each 50 ms of
    // them take the disk half a second.
    let begin_ns = begin();
    let every = SECOND / 3000;
    let acts = (0..8000).map(|n: i64| {
        let at_ns = begin_ns - SECOND / 10 + n * every;
        (at_ns, Act::Give(pose(n as u64, 1, None, at_ns, n as f64 * 0.006)))
    });
    let timing = sonoweave_core::Timing { rate_hz: Some(3000.0), ..poses_timing(false) };
    let (disk, slow) = (Memory::default(), Arc::new(AtomicBool::new(true)));
    let store = Slow { disk: disk.clone(), each: Duration::from_millis(500), slow: Arc::clone(&slow) };
    let set = Set::of(Script::new("a fast tracker", timing, acts), all_frames(begin_ns, 60));
    let (finished, seen) = set.recorded(store, tight(), 0).until(|status, _| {
        // After all frames have arrived, the disk is fast again.
        slow.store(status.ledger.frames.total < 60, Ordering::Relaxed);
        false
    });
    assert_eq!(frames(&finished), (60, 60, vec![]), "acquisition is not slowed");
    assert_eq!(finished.status.ledger.readings[0].used, 8000);
    agrees(&finished, &read(&disk.bytes()));
    let lost = finished.recording.as_ref().unwrap().lost;
    assert!(lost.frames > 0, "{lost:?}");
    assert!(seen.written.last().unwrap().lost >= lost.total(), "said on the status");
}

/// A disk with limited space.
struct Small {
    disk: Memory,
    free: Arc<AtomicU64>,
}

impl Store for Small {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> std::io::Result<()> {
        self.disk.write_at(bytes, at)?;
        self.free.fetch_sub(bytes.len() as u64, Ordering::Relaxed);
        Ok(())
    }

    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        self.disk.cut(length)
    }

    fn data_sync(&self) -> std::io::Result<Box<dyn DataSync>> {
        Ok(Box::new(()))
    }

    fn free_bytes(&self) -> Option<u64> {
        Some(self.free.load(Ordering::Relaxed))
    }
}

#[test]
fn recording_ends_properly_before_free_space_limit() {
    const KEEP: u64 = 50_000_000;
    // Space for the file's end, and for some of the frames.
    let free = Arc::new(AtomicU64::new(KEEP + (1 << 20) + 100_000));
    let disk = Memory::default();
    let begin_ns = begin();
    let noise = Box::new(move |at_ns: i64, pixels: &mut [u8]| {
        let mut random = at_ns as u64 | 1;
        for pixel in pixels {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            *pixel = random as u8;
        }
    });
    let grabber = Grabber::new(noise, SIZE, 50.0, Faults::default(), Arc::new(Monotonic)).unwrap();
    let store = Small { disk: disk.clone(), free: Arc::clone(&free) };
    let options = WriterOptions { chunk_ns: 50 * MS, ..WriterOptions::new("a test") };
    let set = Set::of(poses(begin_ns, 200), grabber).waits(SECOND).recorded(store, options, KEEP);
    let (finished, seen) = set.until(|status, _| status.ledger.frames.total >= 150);
    let left = free.load(Ordering::Relaxed);
    assert!((KEEP..KEEP + (1 << 20) + 50_000).contains(&left), "{left}");
    let recording = finished.recording.as_ref().unwrap();
    assert!(recording.ended.contains("so that 50 MB stay free"), "{}", recording.ended);
    assert!(recording.after_end.frames > 50 && recording.after_end.others > 100, "{recording:?}");
    let reported = seen.written.last().unwrap();
    assert!(reported.trouble == recording.ended && reported.minutes_left.is_none(), "{reported:?}");
    let read = read(&disk.bytes());
    agrees(&finished, &read);
    assert!(read.notes_of("end")[0].contains("so that 50 MB stay free"), "and in the session");
    // Acquisition continued: far more frames were used than recorded.
    assert!(finished.status.ledger.frames.used > read.frame_numbers.len() as u64 + 50, "{}", finished.status.ledger);
}

#[test]
fn wall_clock_set_back_does_not_change_session_times() {
    // A session that began with a wall clock one year ahead, which is then set back: it ends
    // with today's time.
    let program = "a test".to_owned();
    let now = About::now(&program);
    let about = About { realtime_ns: now.realtime_ns + 365 * 86_400 * SECOND, ..now };
    let disk = Memory::default();
    let writer =
        SessionWriter::on(Box::new(disk.clone()), Path::new("m.mcap"), about.clone(), WriterOptions::new(&program));
    let begin_ns = begin();
    let mut set = Set::of(poses(begin_ns, 25), all_frames(begin_ns, 25));
    set.record = Some((writer.unwrap(), 0));
    let (finished, _) = set.run();
    assert_eq!(frames(&finished), (25, 25, vec![]));
    let bytes = disk.bytes();
    let read = read(&bytes);
    agrees(&finished, &read);
    let [first, last] = [read.times[0], read.times[read.times.len() - 1]];
    assert!(first >= about.monotonic_ns && last - first < 60 * SECOND, "{first} {last}");
    // Both offsets are in the session: its clock at the beginning and at the end.
    let mut reader =
        SessionReader::of(Cursor::new(&bytes[..]), bytes.len() as u64, Path::new("m.mcap"), &Limits::default())
            .unwrap();
    let mut offsets = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        if let Event::Message(message) = event {
            offsets.extend(message.about().map(|about| about.offset_ns()));
        }
    }
    assert_eq!(offsets.len(), 2);
    assert!((offsets[0] - offsets[1] - 365 * 86_400 * SECOND).abs() < 60 * SECOND, "{offsets:?}");
}

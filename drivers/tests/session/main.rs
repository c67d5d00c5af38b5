//! Sessions: written, read, damaged and repaired; the effects of a full disk and a killed
//! program.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

mod damage;
mod exact;
mod faults;
mod frames;
mod kill;
mod power;
mod replayed;

use std::io::Cursor;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use formats::session::{
    About, Crop, Damage, DataSync, Ending, Event, Maker, SessionReader, SessionWriter, Source, Store, WriterOptions,
};
use formats::{Error, Limits};
use sonoweave_core::Description;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::{Counts, Frame, NamedTransform, PixelType, Pose, Raw, Reading, Recorded, Stamp, Status};

/// Host time at which sessions begin here: not 0.
pub(crate) const BEGIN: i64 = 77 * SECOND;

/// A disk in memory, which may be full or broken.
#[derive(Debug, Default)]
pub(crate) struct Disk {
    pub(crate) bytes: Vec<u8>,
    /// Capacity in bytes, if limited.
    pub(crate) room: Option<usize>,
    /// Number of bytes after which every write fails.
    pub(crate) broken: Option<usize>,
    /// Whether truncation fails, too.
    pub(crate) cannot_cut: bool,
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Shared(pub(crate) Arc<Mutex<Disk>>);

impl Shared {
    pub(crate) fn disk(&self) -> std::sync::MutexGuard<'_, Disk> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.disk().bytes.clone()
    }
}

impl Store for Shared {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> std::io::Result<()> {
        let disk = &mut *self.disk();
        let at = at as usize;
        assert!(at <= disk.bytes.len(), "a hole in the file");
        let fits = disk.room.map_or(bytes.len(), |room| room.saturating_sub(at).min(bytes.len()));
        let written = disk.broken.unwrap_or(fits).min(fits);
        disk.bytes.truncate(at);
        disk.bytes.extend_from_slice(&bytes[..written]);
        if written == bytes.len() { Ok(()) } else { Err(std::io::Error::from_raw_os_error(28)) }
    }

    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        let disk = &mut *self.disk();
        if disk.cannot_cut {
            return Err(std::io::Error::from_raw_os_error(5));
        }
        disk.bytes.truncate(length as usize);
        Ok(())
    }

    fn data_sync(&self) -> std::io::Result<Box<dyn DataSync>> {
        Ok(Box::new(()))
    }

    fn free_bytes(&self) -> Option<u64> {
        let disk = self.disk();
        disk.room.map(|room| room.saturating_sub(disk.bytes.len()) as u64)
    }
}

pub(crate) fn about() -> About {
    About { monotonic_ns: BEGIN, realtime_ns: 1_795_000_000 * SECOND, program: "a test".into() }
}

pub(crate) fn writer(options: WriterOptions) -> (SessionWriter, Shared) {
    let disk = Shared::default();
    let writer = SessionWriter::on(Box::new(disk.clone()), Path::new("memory.mcap"), about(), options).unwrap();
    (writer, disk)
}

pub(crate) fn stamp(item: u64, host_ns: i64) -> Stamp {
    Stamp { item, host_ns: Some(host_ns), ..Stamp::default() }
}

pub(crate) fn frame(item: u64, at_ns: i64, size: [u32; 2]) -> Reading {
    let pixels: Arc<[u8]> = (0..size[0] * size[1]).map(|n| (u64::from(n) * (item % 7) / 5 + item) as u8).collect();
    Reading::Frame(Frame {
        stamp: Stamp { ticks: Some(item), ..stamp(item, at_ns) },
        frame_number: Some(item),
        status: Status::Ok,
        size,
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MFA".into(),
        image_type: "BRIGHTNESS".into(),
        pixels,
        fields: Vec::new(),
    })
}

pub(crate) fn pose(item: u64, at_ns: i64) -> Reading {
    Reading::Pose(Pose {
        stamp: stamp(item, at_ns),
        station: 1 + (item % 2) as u8,
        position_cm: [item as f64 * 0.1, -0.0, f64::MIN_POSITIVE],
        quaternion_wxyz: [0.5, -0.5, 0.5, -0.5],
        buttons: 1,
        distortion: Some(-3),
        code: Some(b'j'),
        status: Status::Other("sensor saturated".into()),
    })
}

pub(crate) fn raw(item: u64, at_ns: i64) -> Reading {
    let bytes: Arc<[u8]> = (0..item % 40).map(|n| (n * 37 + item) as u8).collect();
    Reading::Raw(Raw { stamp: stamp(item, at_ns), line: (item % 3) as u8, bytes })
}

pub(crate) fn counts(item: u64, at_ns: i64) -> Reading {
    Reading::Counts(Counts {
        stamp: Stamp { ticks: Some(u64::MAX - item), ..stamp(item, at_ns) },
        first: 0,
        axes: 3,
        counts: [i64::MIN, -(item as i64), i64::MAX, 0, 0, 0],
        homed: 5,
        buttons: 2,
        status: Status::Ok,
    })
}

pub(crate) fn transform(item: u64) -> Reading {
    let mut matrix = [0.0; 16];
    matrix[3] = f64::NAN;
    matrix[7] = f64::NEG_INFINITY;
    Reading::NamedTransform(NamedTransform {
        stamp: Stamp { item, source_s: Some(0.1 + item as f64), unfiltered_s: Some(-0.0), ..Stamp::default() },
        from: "Probe".into(),
        to: String::new(),
        matrix,
        status: Status::Other("MISSING".into()),
    })
}

pub(crate) fn note(item: u64, at_ns: i64) -> Reading {
    let text = format!("{{\"slice\": {item}, \"why\": \"\\u00e4 \\\"x\\\"\"}}");
    Reading::Recorded(Recorded { stamp: stamp(item, at_ns), topic: "decision".into(), text })
}

/// Writes a few readings of every kind, 1 ms apart, from two devices; returns them with their
/// devices.
pub(crate) fn mixture(writer: &mut SessionWriter, rounds: u64) -> Vec<(Option<&'static str>, String)> {
    let about = |name: &str| Description { name: name.into(), ..Description::default() };
    let crop = Some(Crop { offset: [3, 2], size: [10, 7] });
    let tracker = writer.device("tracker", None, &about("a tracker"), None).unwrap();
    let grabber = writer.device("grabber", None, &about("a grabber"), crop.filter(|_| false)).unwrap();
    let mut written = Vec::new();
    for item in 0..rounds {
        let at = BEGIN + item as i64 * 20 * MS;
        let all: [(Option<&'static str>, Source, Reading); 6] = [
            (Some("tracker"), tracker, raw(item, at)),
            (Some("tracker"), tracker, pose(item, at)),
            (Some("grabber"), grabber, frame(item, at - 3 * MS, [16, 12])),
            (Some("tracker"), tracker, counts(item, at)),
            (Some("grabber"), grabber, transform(item)),
            (None, tracker, note(item, at)),
        ];
        for (n, (name, source, reading)) in (0..).zip(all) {
            writer.write(source, &reading, at + n * MS).unwrap();
            written.push((name, format!("{reading:?}")));
        }
    }
    written
}

/// All readable content of a file.
#[derive(Debug, Default)]
pub(crate) struct Read {
    /// Device, number of the message in its topic, topic, and the reading.
    pub(crate) readings: Vec<(Option<String>, u32, String, String)>,
    pub(crate) damage: Vec<Damage>,
    pub(crate) ending: Option<Ending>,
    pub(crate) missing: u64,
    /// Log times, ns.
    pub(crate) times: Vec<i64>,
    pub(crate) losses: Vec<formats::session::Loss>,
}

pub(crate) fn read(bytes: &[u8]) -> Result<Read, Error> {
    let limits = Limits::default();
    let mut reader = SessionReader::of(Cursor::new(bytes), bytes.len() as u64, Path::new("memory.mcap"), &limits)?;
    let mut maker = Maker::new(true, limits.frame_bytes);
    let mut read = Read::default();
    while let Some(event) = reader.next_event()? {
        match event {
            Event::Damage(damage) => read.damage.push(damage),
            Event::Message(message) => {
                read.times.push(message.log_ns());
                read.losses.extend(message.loss());
                let reading = maker.read(&message).expect("what a checksum vouches for can be read");
                if let Some(reading) = reading {
                    let device = message.channel.device().map(str::to_owned);
                    let topic = message.channel.topic.clone();
                    read.readings.push((device, message.sequence(), topic, format!("{reading:?}")));
                }
            }
        }
    }
    read.missing = reader.channels().iter().map(|channel| channel.missing).sum();
    read.ending = reader.ending();
    Ok(read)
}

/// Returns options with this chunk duration, ns.
pub(crate) fn chunks_of(ns: i64) -> WriterOptions {
    WriterOptions { chunk_ns: ns, ..WriterOptions::new("a test") }
}

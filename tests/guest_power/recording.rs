//! A session of virtual devices, by the real recorder: frames of noise, 30 a second, and poses, 100
//! a second. A device that is not asked for its readings in time loses them, as hardware does.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use formats::Limits;
use formats::session::{Ending, Event, Loss, Maker, SessionReader, SessionWriter, WriterOptions};
use mask::MaskSettings;
use pipeline::session::{
    DeviceRole, Record, RecordEvent, Recording, SchedulingPolicy, SessionDevice, SessionStatus, record_only,
};
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Frame, PixelType, Pose, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Health, Next};
use sync::ingest::live::{Gives, Live};

/// Size of the frames, pixels.
const SIZE: [u32; 2] = [160, 120];
/// Frames and poses per second.
pub(crate) const FRAMES: u64 = 30;
const POSES: u64 = 100;
/// Time for which a device keeps readings that nobody takes.
const KEPT_NS: i64 = SECOND;

/// Returns bytes that no other seed gives and that cannot be compressed.
pub(crate) fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut bytes = vec![0; length];
    random.fill(&mut bytes);
    bytes
}

/// Returns the pixels of a frame of a session.
fn pixels(session: u64, number: u64) -> Vec<u8> {
    noise(session << 32 | number, (SIZE[0] * SIZE[1]) as usize)
}

/// A device with a constant rate.
struct Paced<F> {
    reading: F,
    per_second: u64,
    begin_ns: i64,
    number: u64,
    description: Description,
    health: Health,
}

impl<F: Fn(Stamp) -> Reading + Send> Paced<F> {
    fn new(name: &str, per_second: u64, begin_ns: i64, reading: F) -> Self {
        let description = Description { name: name.into(), ..Description::default() };
        Self { reading, per_second, begin_ns, number: 0, description, health: Health::default() }
    }

    fn due_ns(&self) -> i64 {
        self.begin_ns + (self.number as i64) * SECOND / self.per_second as i64
    }
}

impl<F: Fn(Stamp) -> Reading + Send> Device for Paced<F> {
    fn start(&mut self) -> Result<(), Error> {
        self.health.received.set_up = 1;
        self.health.state = State::Running;
        Ok(())
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        while self.due_ns() < Monotonic.now_ns() - KEPT_NS {
            self.health.received.lost += 1;
            self.number += 1;
        }
        let due_ns = self.due_ns();
        Monotonic.wait_until(due_ns.min(deadline_ns));
        if due_ns > deadline_ns {
            return Ok(Next::Pending);
        }
        let stamp = Stamp { item: self.number, host_ns: Some(Monotonic.now_ns()), ..Stamp::default() };
        self.number += 1;
        self.health.received.readings += 1;
        Ok(Next::Reading((self.reading)(stamp)))
    }

    fn stop(&mut self) -> Result<(), Error> {
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}

fn devices(session: u64) -> Vec<SessionDevice> {
    let begin_ns = Monotonic.now_ns() + SECOND / 10;
    let grabber = Paced::new("grabber", FRAMES, begin_ns, move |stamp| {
        Reading::Frame(Frame {
            stamp,
            frame_number: Some(stamp.item),
            status: Status::Ok,
            size: SIZE,
            channels: 1,
            pixel: PixelType::U8,
            orientation: "MF".into(),
            image_type: "".into(),
            pixels: pixels(session, stamp.item).into(),
            fields: Vec::new(),
        })
    });
    let tracker = Paced::new("tracking", POSES, begin_ns, |stamp| {
        Reading::Pose(Pose {
            stamp,
            station: 1,
            position_cm: [stamp.item as f64, 0.0, 0.0],
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            buttons: 0,
            distortion: None,
            code: None,
            status: Status::Ok,
        })
    });
    let device = |name: &str, gives, frames, device| SessionDevice {
        role: DeviceRole { name: name.into(), gives, frames, latency_ns: 0 },
        device,
        protocol: None,
    };
    let frames = vec![["Probe".to_owned(), "Tracker".to_owned()]];
    vec![
        device("tracking", Gives::Stations(vec![1]), frames, Box::new(tracker)),
        device("grabber", Gives::Pictures, Vec::new(), Box::new(grabber)),
    ]
}

/// Records a session into a folder, until `watch` returns true for the status. `handed_over`
/// receives the number of each frame that the recorder has been given, and the time of that.
pub(crate) fn record(
    folder: &Path,
    session: u64,
    options: WriterOptions,
    mut handed_over: impl FnMut(u64, i64),
    mut watch: impl FnMut(&SessionStatus) -> bool,
) -> (Recording, SessionStatus) {
    let writer = SessionWriter::create(folder, options).unwrap();
    let record = Record { writer, full_frame: true, notes: Vec::new(), keep_free_bytes: 0 };
    let ends = Arc::new(AtomicBool::new(false));
    let policy = SchedulingPolicy::default();
    let mask = MaskSettings::default();
    let handle = |event: RecordEvent<'_>| match event {
        RecordEvent::Sample(_, Live::Picture { picture, .. }) => {
            let stamp = &picture.head.stamp;
            handed_over(stamp.item, stamp.host_ns.unwrap());
        }
        RecordEvent::Sample(..) => {}
        RecordEvent::Turn(status) => {
            if watch(status) {
                ends.store(true, Ordering::Relaxed);
            }
        }
    };
    let (recording, status) =
        record_only(devices(session), Some(record), &policy, mask, &Monotonic, &ends, handle).unwrap();
    (recording.unwrap(), status)
}

/// Content of a session's file.
#[derive(Debug, Default)]
pub(crate) struct Content {
    /// Numbers of the frames.
    pub(crate) frames: Vec<u64>,
    pub(crate) messages: u64,
    /// Messages of each topic that are missing, by the others' numbers.
    pub(crate) missing: u64,
    pub(crate) losses: Vec<Loss>,
    pub(crate) damaged_parts: usize,
    pub(crate) ending: Option<Ending>,
}

/// Reads a session. Fails if a frame's pixels are wrong.
pub(crate) fn read(path: &Path, session: u64) -> Result<Content, formats::Error> {
    let limits = Limits::default();
    let mut reader = SessionReader::open(path, &limits)?;
    let mut maker = Maker::new(true, limits.frame_bytes);
    let mut content = Content::default();
    while let Some(event) = reader.next_event()? {
        let Event::Message(message) = event else {
            content.damaged_parts += 1;
            continue;
        };
        content.messages += 1;
        content.losses.extend(message.loss());
        if let Some(Reading::Frame(frame)) = maker.read(&message).unwrap() {
            let number = frame.frame_number.unwrap();
            assert!(*frame.pixels == pixels(session, number), "frame {number} has other pixels");
            content.frames.push(number);
        }
    }
    content.missing = reader.channels().iter().map(|channel| channel.missing).sum();
    content.ending = reader.ending();
    Ok(content)
}

/// Returns the only session in a folder; `None` without one.
pub(crate) fn only_session(folder: &Path) -> Option<PathBuf> {
    let mut entries = std::fs::read_dir(folder).ok()?;
    let path = entries.next()?.unwrap().path();
    assert!(entries.next().is_none(), "one session in {}", folder.display());
    Some(path)
}

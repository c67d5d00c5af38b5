//! What the stages say of themselves while they run: the ledger, and how each device is. One lock, held for as long as it takes to count, or to copy some kilobytes.

use std::path::PathBuf;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use drivers::Health;
use drivers::health::State;
use serde::Serialize;

use super::Instrument;
use super::fabric::Bulk;
use super::picture::Drawn;
use super::priority::Granted;
use super::pulse::{Pulse, Turns};
use super::recorder::{Recording, Unwritten};
use super::timing::Spread;
use super::zones::InZones;
use crate::ingest::live::Gives;
use crate::ledger::{Ledger, Queue, Readings};
use crate::refusal::Refusal;
use crate::sync::clock::{Mapping, State as ClockState};
use crate::sync::graph::Route;

/// State of a device that a recording stands in for.
pub const REPLAYED: &str = "replayed";

/// A device of the session.
#[derive(Debug, Clone, Serialize)]
pub struct DeviceBoard {
    /// What it is called.
    pub name: String,
    /// One word: running, absent, silent, …
    pub state: &'static str,
    /// Why, and what to do; empty where all is well.
    pub why: String,
    /// Bytes received.
    pub bytes: u64,
    /// Readings delivered.
    pub readings: u64,
    /// Readings, or frames, lost before they came, by its own count.
    pub lost: u64,
    /// Times that it was set up.
    pub set_up: u64,
    /// For how long nothing has come from it, s; `None` where nothing ever did.
    pub last_reading_s_ago: Option<f64>,
    /// Its clocks: one, or one for each of its sources.
    pub clocks: Vec<ClockBoard>,
}

/// How far a device's clock is to be believed, as last published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ClockBoard {
    /// Its state.
    pub state: ClockState,
    /// How far the truth may lie from it, ms.
    pub bound_ms: f64,
    /// How much faster the host's clock runs than it says, parts in 10⁶.
    pub drift_ppm: f64,
    /// Times that it was published.
    pub published: u64,
}

/// Everything at one moment. What is told of a session is this, wherever it is told.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Account {
    /// What became of frames and readings.
    #[serde(flatten)]
    pub ledger: Ledger,
    /// The devices.
    pub devices: Vec<DeviceBoard>,
    /// When the first slice was in the volume, host ns.
    #[serde(skip)]
    pub first_slice_ns: Option<i64>,
    /// From a frame's capture until it is in the volume.
    pub capture_to_volume: Spread,
    /// From the reading that made its pose known until it is in the volume.
    pub pose_to_volume: Spread,
    /// From the newest frame's capture until its picture is drawn.
    pub capture_to_picture: Spread,
    /// From taking the volume to its picture.
    pub draw: Spread,
    /// Pictures drawn.
    pub pictures: u64,
    /// Slices that came while another picture was drawn, and were drawn with the next.
    pub pictures_skipped: u64,
    /// For how long the scanner has shown one picture while the probe moved, s; `None` while it does not.
    pub frozen_s: Option<f64>,
    /// Frames that were taken where the tracker's field is bent; `None` where there are no zones.
    pub distortion: Option<InZones>,
    /// The volume's extent, while slices are in it.
    pub volume: Option<Bulk>,
    /// Whether pictures are not used at present, by the wish of who looks on.
    pub paused: bool,
    /// The recording, as the writer has it.
    pub recording: Option<Written>,
    /// What the threads have a right to.
    pub scheduling: Granted,
    /// How far the stages are that move while a session does.
    pub stages: Vec<Turns>,
    /// What the user should know: sentences.
    pub notes: Vec<String>,
    /// Name of the frame where the volume lives,
    pub world: String,
    /// and the transforms that lead there, in words.
    pub route: String,
}

/// What there is to say of a recording, while it is written and when it is ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Written {
    /// The file.
    pub path: PathBuf,
    /// Messages that the writer was given.
    pub messages: u64,
    /// Of these, messages that the disk has taken,
    pub stored: u64,
    /// and messages that were lost, as there was no room for them, in the writer's memory or in the queue before it.
    pub lost: u64,
    /// Those in the queue.
    pub lost_before_writer: Unwritten,
    /// What came after the recording was ended, as the disk was full.
    pub after_end: Unwritten,
    /// Bytes of the file.
    pub bytes: u64,
    /// Minutes until the disk is full, at the present rate.
    pub minutes_left: Option<f64>,
    /// Why nothing is written now; empty while all is well.
    pub trouble: String,
}

/// [`Account`], shared.
pub(super) struct Board {
    account: Mutex<Account>,
    /// When each device last delivered.
    last: Mutex<Vec<Option<Instant>>>,
    /// The stages' turns.
    pub(super) pulse: Pulse,
    /// Place of each device among the ledger's readings; `None` for grabbers, whose readings are frames.
    rows: Vec<Option<usize>>,
    frozen_after_ns: AtomicI64,
}

impl Board {
    /// Of these devices; pictures that come again for longer than so many ns are told.
    pub(super) fn new(devices: &[Instrument], frozen_ns: i64) -> Self {
        let mut account = Account::default();
        let mut rows = Vec::new();
        for Instrument { name, gives, .. } in devices {
            let grabs = matches!(gives, Gives::Pictures);
            rows.push((!grabs).then_some(account.ledger.readings.len()));
            if !grabs {
                account.ledger.readings.push(Readings { device: name.clone(), ..Readings::default() });
            }
            account.devices.push(DeviceBoard {
                name: name.clone(),
                state: State::Stopped.word(),
                why: String::new(),
                bytes: 0,
                readings: 0,
                lost: 0,
                set_up: 0,
                last_reading_s_ago: None,
                clocks: Vec::new(),
            });
        }
        Self {
            account: Mutex::new(account),
            last: Mutex::new(vec![None; devices.len()]),
            pulse: Pulse::new(devices.iter().map(|device| device.name.as_str())),
            rows,
            frozen_after_ns: AtomicI64::new(frozen_ns),
        }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, Account> {
        self.account.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How it is at this moment.
    pub(super) fn snapshot(&self) -> Account {
        let mut account = self.lock().clone();
        account.stages = self.pulse.turns();
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        for (device, last) in account.devices.iter_mut().zip(last.iter()) {
            device.last_reading_s_ago = last.map(|last| last.elapsed().as_secs_f64());
        }
        account
    }

    /// A device's reading has arrived and waits.
    pub(super) fn arrived(&self, source: usize) {
        let mut account = self.lock();
        match self.rows[source] {
            Some(row) => account.ledger.readings[row].total += 1,
            None => account.ledger.arrived(),
        }
    }

    /// A waiting reading found a queue full.
    pub(super) fn dropped(&self, source: usize, queue: Queue) {
        let mut account = self.lock();
        match self.rows[source] {
            Some(row) => account.ledger.readings[row].dropped += 1,
            None => account.ledger.dropped(queue),
        }
    }

    /// A reading other than a frame became a sample, or why it did not.
    pub(super) fn sampled(&self, source: usize, refused: Option<&'static str>) {
        let mut account = self.lock();
        let Some(row) = self.rows[source] else { return };
        let row = &mut account.ledger.readings[row];
        match refused {
            None => row.used += 1,
            Some(why) => *row.refused.entry(why).or_default() += 1,
        }
    }

    /// A waiting frame found a queue full.
    pub(super) fn dropped_frame(&self, queue: Queue) {
        self.lock().ledger.dropped(queue);
    }

    /// For how long the scanner has shown one picture while the probe moved, ns, if it does.
    pub(super) fn frozen(&self, since_ns: Option<i64>) {
        let after_ns = self.frozen_after_ns.load(Ordering::Relaxed);
        self.lock().frozen_s = since_ns.filter(|ns| *ns >= after_ns).map(|ns| ns as f64 / 1e9);
    }

    /// Pictures are not used from now on, or are again.
    pub(super) fn paused(&self, paused: bool) {
        self.lock().paused = paused;
    }

    /// How the sensor is to the zones.
    pub(super) fn in_zones(&self, found: InZones) {
        self.lock().distortion = Some(found);
    }

    /// The devices are those of a recording.
    pub(super) fn replayed(&self) {
        self.lock().devices.iter_mut().for_each(|device| device.state = REPLAYED);
        self.pulse.without_captures();
    }

    /// From how long a time on that is told, ns.
    pub(super) fn frozen_after(&self, ns: i64) {
        self.frozen_after_ns.store(ns, Ordering::Relaxed);
    }

    /// The way to the world.
    pub(super) fn route(&self, route: &Route) {
        let mut account = self.lock();
        (account.world, account.route) = (route.world().to_owned(), route.describe());
    }

    /// What the user should know.
    pub(super) fn note(&self, note: String) {
        self.lock().notes.push(note);
    }

    /// How the recording is.
    pub(super) fn recording(&self, recording: &Recording) {
        let Recording { path, account, lost, ended, after_end, room } = recording;
        self.lock().recording = Some(Written {
            path: path.clone(),
            messages: account.messages,
            stored: account.stored,
            lost: account.lost + lost.total(),
            lost_before_writer: *lost,
            after_end: *after_end,
            bytes: account.file_bytes,
            minutes_left: room.filter(|_| ended.is_empty()).and_then(|room| room.minutes()),
            trouble: if account.trouble.is_empty() { ended } else { &account.trouble }.clone(),
        });
    }

    /// A picture was drawn.
    pub(super) fn drawn(&self, drawn: &Drawn) {
        let mut account = self.lock();
        (account.pictures, account.pictures_skipped) = (drawn.pictures, drawn.skipped);
        account.capture_to_picture.set_to(&drawn.capture_to_picture);
        account.draw.set_to(&drawn.draw);
    }

    /// A device's clock was published.
    pub(super) fn clock(&self, source: usize, clock: usize, mapping: &Mapping) {
        let mut account = self.lock();
        let clocks = &mut account.devices[source].clocks;
        if clocks.len() <= clock {
            clocks.resize(clock + 1, ClockBoard::default());
        }
        clocks[clock] = ClockBoard {
            state: mapping.state,
            bound_ms: mapping.bound_ns as f64 * 1e-6,
            drift_ppm: mapping.drift_ppb as f64 * 1e-3,
            published: mapping.number + 1,
        };
    }

    /// What the threads have a right to.
    pub(super) fn granted(&self, granted: &Granted) {
        self.lock().scheduling = granted.clone();
    }

    /// A waiting frame was refused.
    pub(super) fn refused(&self, refusal: &Refusal) {
        self.lock().ledger.refused(refusal);
    }

    /// A device has ended by an error of its own; the others go on.
    pub(super) fn failed(&self, source: usize, error: &drivers::Error) {
        let device = &mut self.lock().devices[source];
        (device.state, device.why) = (State::Ended.word(), error.to_string());
    }

    /// How a device is now.
    pub(super) fn health(&self, source: usize, health: &Health) {
        let mut account = self.lock();
        let Account { ledger, devices, .. } = &mut *account;
        let device = &mut devices[source];
        device.state = health.state.word();
        if device.why != health.why {
            device.why.clone_from(&health.why);
        }
        let received = health.received;
        if received.readings > device.readings {
            self.last.lock().unwrap_or_else(PoisonError::into_inner)[source] = Some(Instant::now());
        }
        (device.bytes, device.readings, device.set_up) = (received.bytes, received.readings, received.set_up);
        // What was lost since last time: there may be two grabbers.
        let more = received.lost.saturating_sub(device.lost);
        device.lost = received.lost;
        match self.rows[source] {
            Some(row) => ledger.readings[row].lost += more,
            None => ledger.frames.lost += more,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_and_frames_are_each_accounted_for_once() {
        let of = |name: &str, gives| Instrument { name: name.into(), gives, frames: Vec::new(), latency_ns: 0 };
        let board = Board::new(&[of("tracker", Gives::Stations(vec![1])), of("grabber", Gives::Pictures)], 500);
        for _ in 0..5 {
            board.arrived(0);
            board.arrived(1);
        }
        board.sampled(0, None);
        board.sampled(0, Some("not valid"));
        board.dropped(0, Queue::Pairing);
        board.dropped(1, Queue::Pairing);
        let mut health = Health { state: State::Silent, why: "says nothing".into(), ..Health::default() };
        for lost in [2, 2, 7] {
            health.received.lost = lost;
            board.health(0, &health);
            board.health(1, &health);
        }
        let account = board.snapshot();
        let row = &account.ledger.readings[0];
        assert_eq!((row.total, row.used, row.dropped, row.lost, row.waiting()), (5, 1, 1, 7, 2));
        assert_eq!(row.refused["not valid"], 1);
        let frames = &account.ledger.frames;
        assert_eq!((frames.total, frames.waiting, frames.lost), (5, 4, 7));
        assert_eq!(frames.dropped[&Queue::Pairing], 1);
        assert_eq!((account.devices[0].state, account.devices[1].why.as_str()), ("silent", "says nothing"));
        assert_eq!(account.devices[0].last_reading_s_ago, None, "by its health nothing came");
        health.received.readings = 1;
        board.health(0, &health);
        let [tracker, grabber] = [0, 1].map(|at| board.snapshot().devices[at].last_reading_s_ago);
        assert!(tracker.is_some_and(|ago| ago >= 0.0) && grabber.is_none());
        let told = |since| {
            board.frozen(since);
            board.snapshot().frozen_s
        };
        assert_eq!([Some(499), Some(500), None].map(told), [None, Some(500e-9), None]);
        board.frozen_after(600);
        assert_eq!(told(Some(599)), None);
    }
}

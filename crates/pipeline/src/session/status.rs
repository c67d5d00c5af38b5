//! Session status while it runs: the frame ledger and the state of each device. One lock guards
//! it, held only to count or to copy some kilobytes.

use std::path::PathBuf;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Instant;

use serde::Serialize;

use mask::{MaskFound, MaskSettings};
use render::RenderMemory;
use sonoweave_core::Health;
use sonoweave_core::health::State;
use sonoweave_core::ledger::{Ledger, Queue, Readings};
use sonoweave_core::refusal::Refusal;
use sync::clock::{Mapping, State as ClockState};
use sync::graph::Route;
use sync::ingest::live::Gives;

use super::device::DeviceRole;
use super::memory::MemoryByOwner;
use super::page_faults::{PageFaults, SLICES_BEFORE};
use super::priority::SchedulingGrant;
use super::recorder::{Recording, Unwritten};
use super::render_thread::Drawn;
use super::shared_volume::VolumeExtent;
use super::timing::Spread;
use super::turns::{StageTurns, Turns};
use super::zones::InZones;
use crate::smoothing::SmoothingStatus;
use crate::{MaskOrigin, MaskStatus, PoseNoise};

/// State of a device that is replaced by a recording.
pub const REPLAYED: &str = "replayed";

/// A device of the session.
#[derive(Debug, Clone, Serialize)]
pub struct DeviceStatus {
    /// Its name.
    pub name: String,
    /// One word: running, absent, silent, …
    pub state: &'static str,
    /// Reason and remedy; empty if the device works.
    pub why: String,
    /// Bytes received.
    pub bytes: u64,
    /// Readings delivered.
    pub readings: u64,
    /// Readings or frames lost before they arrived, counted by the device.
    pub lost: u64,
    /// Number of set-ups.
    pub set_up: u64,
    /// Time since its last reading, s; `None` if none has arrived.
    pub last_reading_s_ago: Option<f64>,
    /// Its clocks: one, or one for each of its sources.
    pub clocks: Vec<ClockStatus>,
}

/// Accuracy of a device's clock, as last published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ClockStatus {
    /// Its state.
    pub state: ClockState,
    /// Bound on its error, ms.
    pub bound_ms: f64,
    /// Excess of the host clock's rate over this clock's nominal rate, parts in 10⁶.
    pub drift_ppm: f64,
    /// Number of publications.
    pub published: u64,
}

/// Snapshot of the session status. Every report of a session uses this type.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SessionStatus {
    /// Frame ledger and readings.
    #[serde(flatten)]
    pub ledger: Ledger,
    /// The devices.
    pub devices: Vec<DeviceStatus>,
    /// Time since a grabber's last frame, s; `None` before the first.
    pub last_frame_s_ago: Option<f64>,
    /// Present insertion path of slices, `general` or `planar`; `None` before the first slice.
    pub path: Option<&'static str>,
    /// Reason for the path, as the end of a sentence.
    pub path_reason: String,
    /// The mask of slices; `None` until it is known.
    pub mask: Option<MaskStatus>,
    /// Time at which the first slice was in the volume, host ns.
    #[serde(skip)]
    pub first_slice_ns: Option<i64>,
    /// Time from a frame's capture until it is in the volume.
    pub capture_to_volume: Spread,
    /// Time from the reading that made its pose known until the frame is in the volume.
    pub pose_to_volume: Spread,
    /// Time from the newest frame's capture until its picture is rendered.
    pub capture_to_picture: Spread,
    /// Time from reading the volume to the finished picture.
    pub draw: Spread,
    /// Pictures rendered.
    pub pictures: u64,
    /// Those of them for which only rays through the slab of the last slice were cast again.
    pub pictures_by_slab: u64,
    /// Those of them that were drawn in parts of the volume, each by itself.
    pub pictures_in_parts: u64,
    /// Slices that arrived during a rendering and were rendered with the next picture.
    pub pictures_skipped: u64,
    /// Renderers made for the pictures.
    pub picture_renderers: u64,
    /// Times that a renderer took a wider box, as slices left its own.
    pub picture_boxes_widened: u64,
    /// Page faults of insertion and rendering since the tenth slice; `None` before.
    pub page_faults: Option<PageFaults>,
    /// Time for which the scanner has repeated one frame while the probe moved, s; `None` if it
    /// does not.
    #[serde(rename = "frozen_s")]
    pub stuck_s: Option<f64>,
    /// Frames by the smoothing of their poses; `None` if they are interpolated.
    pub smoothing: Option<SmoothingStatus>,
    /// Noise of the tracker's poses, if it is known.
    #[serde(skip)]
    pub pose_noise: Option<PoseNoise>,
    /// Frames taken where the tracker's field is distorted; `None` without zones.
    pub distortion: Option<InZones>,
    /// The volume's extent, once it has slices.
    pub volume: Option<VolumeExtent>,
    /// Slices too dark to tell shadows, whose pixels all count fully; `None` unless the volume
    /// weighs shadows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dark_slices: Option<u64>,
    /// Whether the user has frozen the session: frames are ignored.
    pub frozen: bool,
    /// The recording, as reported by the writer.
    pub recording: Option<Written>,
    /// Memory in use.
    pub memory: MemoryByOwner,
    /// Scheduling grant of the threads.
    pub scheduling: SchedulingGrant,
    /// Progress of the stages that run during a session.
    pub stages: Vec<Turns>,
    /// Notes for the user, as sentences.
    pub notes: Vec<String>,
    /// Name of the frame in which the volume lies.
    pub world: String,
    /// Description of the transforms that lead to that frame.
    pub route: String,
}

impl SessionStatus {
    /// Returns the root mean square error of places in the image by the noise of poses, mm: as
    /// smoothing states it, else by the noise that is known. `None` if it is unknown, and before
    /// the mask gives the image's size.
    pub fn pose_error_mm(&self) -> Option<f64> {
        let smoothed = self.smoothing.as_ref().filter(|smoothing| smoothing.smoothed > 0);
        let known = || Some(self.pose_noise?.error_mm(self.mask.as_ref()?.size_px, &self.world));
        smoothed.map(|smoothing| smoothing.error_rms_mm).or_else(known)
    }
}

/// Status of a recording, while it is written and after it has ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Written {
    /// The file.
    pub path: PathBuf,
    /// Messages given to the writer.
    pub messages: u64,
    /// Those of them that are on the disk.
    pub stored: u64,
    /// Messages lost for want of room, in the writer's memory or in the queue before it.
    pub lost: u64,
    /// Those lost in the queue.
    pub lost_before_writer: Unwritten,
    /// Messages that came after the recording ended because the disk was full.
    pub after_end: Unwritten,
    /// Bytes of the file.
    pub bytes: u64,
    /// Those of them that survive a power cut.
    pub synced_bytes: u64,
    /// Age of the oldest message that may not survive one, s; 0 if there is none.
    pub unsynced_s: f64,
    /// The largest such age so far, s.
    pub unsynced_most_s: f64,
    /// Whether that age has exceeded a second within the last 10 s.
    pub slow_disk: bool,
    /// Bytes that it may still take on the disk; `None` after its end.
    pub free_bytes: Option<u64>,
    /// Minutes until the disk is full, at the present rate.
    pub minutes_left: Option<f64>,
    /// Reason why nothing is written or synced now; empty otherwise.
    pub trouble: String,
}

/// Shared [`SessionStatus`].
pub(super) struct StatusCollector {
    status: Mutex<SessionStatus>,
    /// Time of each device's last delivery.
    last: Mutex<Vec<Option<Instant>>>,
    /// Turns of the stages.
    pub(super) turns: StageTurns,
    /// Index of each device among the ledger's readings; `None` for grabbers, whose readings are
    /// frames.
    rows: Vec<Option<usize>>,
    stuck_after_ns: AtomicI64,
    /// Settings of the part of frames that is recorded; `None` for all of it.
    recorded: Option<MaskSettings>,
    /// Bytes of a frame.
    frame_bytes: u64,
    /// Memory of the queues' places.
    place_bytes: AtomicU64,
    /// Page faults when the tenth slice was in the volume.
    faults_before: OnceLock<PageFaults>,
}

impl StatusCollector {
    /// Returns the status of these devices. Repeated frames are reported once they last longer
    /// than `stuck_after_ns`.
    pub(super) fn new(devices: &[DeviceRole], stuck_after_ns: i64) -> Self {
        let mut status = SessionStatus::default();
        let mut rows = Vec::new();
        for DeviceRole { name, gives, .. } in devices {
            let grabs = matches!(gives, Gives::Pictures);
            rows.push((!grabs).then_some(status.ledger.readings.len()));
            if !grabs {
                status.ledger.readings.push(Readings { device: name.clone(), ..Readings::default() });
            }
            status.devices.push(DeviceStatus {
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
            status: Mutex::new(status),
            last: Mutex::new(vec![None; devices.len()]),
            turns: StageTurns::new(devices.iter().map(|device| device.name.as_str())),
            rows,
            stuck_after_ns: AtomicI64::new(stuck_after_ns),
            recorded: None,
            frame_bytes: 0,
            place_bytes: AtomicU64::new(0),
            faults_before: OnceLock::new(),
        }
    }

    /// Sets the size of a frame, and the devices' prepared data, bytes.
    pub(super) fn with_memory(self, frame_bytes: u64, prepared_bytes: u64) -> Self {
        self.lock().memory.prepared_bytes = prepared_bytes;
        Self { frame_bytes, ..self }
    }

    /// Adds a queue's own memory, bytes: its places, full or empty.
    pub(super) fn queue_places(&self, bytes: usize) {
        self.place_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Sets the part of frames that is recorded; `None` for all of it.
    pub(super) fn recording_of(self, recorded: Option<MaskSettings>) -> Self {
        Self { recorded, ..self }
    }

    pub(super) fn lock(&self) -> MutexGuard<'_, SessionStatus> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the present status.
    pub(super) fn snapshot(&self) -> SessionStatus {
        let mut status = self.lock().clone();
        status.stages = self.turns.turns();
        status.memory.queue_bytes =
            self.place_bytes.load(Ordering::Relaxed) + status.ledger.frames.waiting * self.frame_bytes;
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        for (device, last) in status.devices.iter_mut().zip(last.iter()) {
            device.last_reading_s_ago = last.map(|last| last.elapsed().as_secs_f64());
        }
        let grabbers = self.rows.iter().zip(&status.devices).filter(|(row, _)| row.is_none());
        status.last_frame_s_ago = grabbers.filter_map(|(_, device)| device.last_reading_s_ago).min_by(f64::total_cmp);
        status
    }

    /// Counts the page faults since the tenth slice.
    pub(super) fn count_page_faults(&self) {
        if self.lock().ledger.frames.used >= SLICES_BEFORE {
            let now = PageFaults::now();
            let before = *self.faults_before.get_or_init(|| now);
            let mut status = self.lock();
            status.page_faults = Some(now.since(before, status.page_faults));
        }
    }

    /// Counts a device's reading that has arrived and waits.
    pub(super) fn arrived(&self, source: usize) {
        let mut status = self.lock();
        match self.rows[source] {
            Some(row) => status.ledger.readings[row].total += 1,
            None => status.ledger.arrived(),
        }
    }

    /// Counts a waiting reading that was dropped because a queue was full.
    pub(super) fn dropped(&self, source: usize, queue: Queue) {
        let mut status = self.lock();
        match self.rows[source] {
            Some(row) => status.ledger.readings[row].dropped += 1,
            None => status.ledger.dropped(queue),
        }
    }

    /// Counts a reading other than a frame: used as a sample, or refused for a reason.
    pub(super) fn sampled(&self, source: usize, refused: Option<&'static str>) {
        let mut status = self.lock();
        let Some(row) = self.rows[source] else { return };
        let row = &mut status.ledger.readings[row];
        match refused {
            None => row.used += 1,
            Some(why) => *row.refused.entry(why).or_default() += 1,
        }
    }

    /// Counts a waiting frame that was dropped because a queue was full.
    pub(super) fn dropped_frame(&self, queue: Queue) {
        self.lock().ledger.dropped(queue);
    }

    /// Sets for how long the scanner has repeated one frame while the probe moved, ns; `None` if
    /// it does not.
    pub(super) fn stuck(&self, since_ns: Option<i64>) {
        let after_ns = self.stuck_after_ns.load(Ordering::Relaxed);
        self.lock().stuck_s = since_ns.filter(|ns| *ns >= after_ns).map(|ns| ns as f64 / 1e9);
    }

    /// Sets whether frames are ignored at present.
    pub(super) fn freeze(&self, on: bool) {
        self.lock().frozen = on;
    }

    /// Sets the mask of slices.
    pub(super) fn masked(&self, found: &MaskFound, origin: MaskOrigin) {
        self.lock().mask = Some(MaskStatus::new(found.clone(), origin, self.recorded));
    }

    /// Sets the sensor's position relative to the zones.
    pub(super) fn in_zones(&self, found: InZones) {
        self.lock().distortion = Some(found);
    }

    /// Marks all devices as replaced by a recording.
    pub(super) fn replayed(&self) {
        self.lock().devices.iter_mut().for_each(|device| device.state = REPLAYED);
        self.turns.without_captures();
    }

    /// Sets after how long repeated frames are reported, ns.
    pub(super) fn stuck_after(&self, ns: i64) {
        self.stuck_after_ns.store(ns, Ordering::Relaxed);
    }

    /// Sets the route to the world.
    pub(super) fn route(&self, route: &Route) {
        let mut status = self.lock();
        (status.world, status.route) = (route.world().to_owned(), route.describe());
    }

    /// Adds a note for the user.
    pub(super) fn note(&self, note: String) {
        self.lock().notes.push(note);
    }

    /// Sets the status of the recording.
    pub(super) fn recording(&self, recording: &Recording) {
        let Recording { path, status, lost, ended, after_end, unsynced, room } = recording;
        let room = room.filter(|_| ended.is_empty());
        let mut current = self.lock();
        current.memory.recorder_bytes = status.held_bytes;
        current.recording = Some(Written {
            path: path.clone(),
            messages: status.messages,
            stored: status.stored,
            lost: status.lost + lost.total(),
            lost_before_writer: *lost,
            after_end: *after_end,
            bytes: status.file_bytes,
            synced_bytes: status.synced_bytes,
            unsynced_s: unsynced.now_ns as f64 * 1e-9,
            unsynced_most_s: unsynced.most_ns as f64 * 1e-9,
            slow_disk: unsynced.late_ns.is_some(),
            free_bytes: room.map(|room| room.free_bytes),
            minutes_left: room.and_then(|room| room.minutes()),
            trouble: if status.trouble.is_empty() { ended } else { &status.trouble }.clone(),
        });
    }

    /// Counts a rendered picture.
    pub(super) fn drawn(&self, drawn: &Drawn) {
        let mut status = self.lock();
        (status.pictures, status.pictures_by_slab) = (drawn.pictures, drawn.by_slab);
        status.pictures_in_parts = drawn.in_parts;
        status.pictures_skipped = drawn.skipped;
        (status.picture_renderers, status.picture_boxes_widened) = (drawn.renderers, drawn.widened);
        status.capture_to_picture.set_to(&drawn.capture_to_picture);
        status.draw.set_to(&drawn.draw);
        let RenderMemory { voxels, rays } = drawn.renderer.memory();
        (status.memory.render_voxel_bytes, status.memory.render_ray_bytes) = (voxels, rays);
    }

    /// Stores a device's published clock.
    pub(super) fn clock(&self, source: usize, clock: usize, mapping: &Mapping) {
        let mut status = self.lock();
        let clocks = &mut status.devices[source].clocks;
        if clocks.len() <= clock {
            clocks.resize(clock + 1, ClockStatus::default());
        }
        clocks[clock] = ClockStatus {
            state: mapping.state,
            bound_ms: mapping.bound_ns as f64 * 1e-6,
            drift_ppm: mapping.drift_ppb as f64 * 1e-3,
            published: mapping.number + 1,
        };
    }

    /// Sets the scheduling grant of the threads.
    pub(super) fn granted(&self, granted: &SchedulingGrant) {
        self.lock().scheduling = granted.clone();
    }

    /// Counts a waiting frame that was refused.
    pub(super) fn refused(&self, refusal: &Refusal) {
        self.lock().ledger.refused(refusal);
    }

    /// Marks a device that ended by an error of its own; the others continue.
    pub(super) fn failed(&self, source: usize, error: &sonoweave_core::Error) {
        let device = &mut self.lock().devices[source];
        (device.state, device.why) = (State::Ended.word(), error.to_string());
    }

    /// Sets a device's present health.
    pub(super) fn health(&self, source: usize, health: &Health) {
        let mut status = self.lock();
        let SessionStatus { ledger, devices, .. } = &mut *status;
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
        // Only the loss since the last call is added: there may be two grabbers.
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
        let of = |name: &str, gives| DeviceRole { name: name.into(), gives, frames: Vec::new(), latency_ns: 0 };
        let collector =
            StatusCollector::new(&[of("tracker", Gives::Stations(vec![1])), of("grabber", Gives::Pictures)], 500);
        for _ in 0..5 {
            collector.arrived(0);
            collector.arrived(1);
        }
        collector.sampled(0, None);
        collector.sampled(0, Some("not valid"));
        collector.dropped(0, Queue::Pairing);
        collector.dropped(1, Queue::Pairing);
        let mut health = Health { state: State::Silent, why: "says nothing".into(), ..Health::default() };
        for lost in [2, 2, 7] {
            health.received.lost = lost;
            collector.health(0, &health);
            collector.health(1, &health);
        }
        let status = collector.snapshot();
        let row = &status.ledger.readings[0];
        assert_eq!((row.total, row.used, row.dropped, row.lost, row.waiting()), (5, 1, 1, 7, 2));
        assert_eq!(row.refused["not valid"], 1);
        let frames = &status.ledger.frames;
        assert_eq!((frames.total, frames.waiting, frames.lost), (5, 4, 7));
        assert_eq!(frames.dropped[&Queue::Pairing], 1);
        assert_eq!((status.devices[0].state, status.devices[1].why.as_str()), ("silent", "says nothing"));
        assert_eq!(status.devices[0].last_reading_s_ago, None, "its health counts no reading");
        health.received.readings = 1;
        collector.health(0, &health);
        let last = || {
            let status = collector.snapshot();
            (status.devices[0].last_reading_s_ago, status.last_frame_s_ago)
        };
        assert!(last().0.is_some_and(|ago| ago >= 0.0) && last().1.is_none(), "a tracker has no frames");
        collector.health(1, &health);
        assert!(last().1.is_some_and(|ago| ago >= 0.0));
        let stuck_s = |since| {
            collector.stuck(since);
            collector.snapshot().stuck_s
        };
        assert_eq!([Some(499), Some(500), None].map(stuck_s), [None, Some(500e-9), None]);
        collector.stuck_after(600);
        assert_eq!(stuck_s(Some(599)), None);
    }
}

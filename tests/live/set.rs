//! A session with a test's own devices, and the observed status.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::DVec3;

use formats::session::{DataSync, SessionWriter, Store, WriterOptions};
use mask::{Clip, MaskSettings};
use pipeline::command::Instruction;
use pipeline::session::{
    BrickViewer, DeviceRole, Finished, PlaneViewer, Record, RecordEvent, SchedulingPolicy, Session, SessionDevice,
    SessionInputs, SessionStatus, Source, ViewClient, Watch, Written, record_only, run,
};
use reconstruct::path_choice::PathChoice;
use reconstruct::planar::PlanarSettings;
use reconstruct::{Settings, ShadowWeights};
use sonoweave_core::Device;
use sonoweave_core::clock::{MS, Monotonic, SECOND};
use sonoweave_core::ledger::Frames;
use sonoweave_core::named::StaticTransform;
use sonoweave_core::refusal::Reason;
use sync::PairingOptions;
use sync::ingest::live::{Gives, Live};
use sync::smoothing::Smoothing;

/// Size of all frames, pixels.
pub(crate) const SIZE: [u32; 2] = [64, 64];
/// Pixel size, mm.
const PIXEL_MM: f64 = 0.5;
/// A session that takes longer has hung.
const PATIENCE: Duration = Duration::from_secs(120);

/// A session: a tracker or an arm, a grabber, and the settings.
pub(crate) struct Set {
    pub(crate) tracking: Box<dyn Device>,
    pub(crate) gives: Gives,
    /// The tracked objects: the probe, and the patient if there is a second station.
    pub(crate) of: Vec<&'static str>,
    pub(crate) tracking_latency_ns: i64,
    pub(crate) grabber: Box<dyn Device>,
    pub(crate) wait_ns: i64,
    pub(crate) looks: Option<Arc<dyn ViewClient>>,
    pub(crate) plane_viewer: Option<Arc<dyn PlaneViewer>>,
    pub(crate) brick_viewer: Option<Arc<dyn BrickViewer>>,
    pub(crate) record: Option<(SessionWriter, u64)>,
    pub(crate) watch: Option<Watch>,
    /// Smoothing of the poses.
    pub(crate) smoothing: Option<Smoothing>,
    /// Whether the volume keeps standard errors.
    pub(crate) standard_error: bool,
    /// Whether the volume weighs pixels by the shadows that they lie in.
    pub(crate) shadow_weights: bool,
}

/// Observed status.
#[derive(Default)]
pub(crate) struct Seen {
    /// States and reasons of the tracking device and of the grabber, each time that either
    /// changed.
    pub(crate) devices: [Vec<(&'static str, String)>; 2],
    /// Reported duration of a stuck scanner, each time that it changed.
    pub(crate) stuck: Vec<Option<f64>>,
    /// Reported status of the recording.
    pub(crate) written: Vec<Written>,
}

impl Seen {
    fn look(&mut self, status: &SessionStatus) {
        for (seen, device) in self.devices.iter_mut().zip(&status.devices) {
            if seen.last().is_none_or(|(state, why)| *state != device.state || *why != device.why) {
                seen.push((device.state, device.why.clone()));
            }
        }
        if self.stuck.last() != Some(&status.stuck_s) {
            self.stuck.push(status.stuck_s);
        }
        if self.written.last() != status.recording.as_ref() {
            self.written.extend(status.recording.clone());
        }
    }

    /// Returns the states of a device, without the transient ones.
    pub(crate) fn states(&self, device: usize) -> Vec<&'static str> {
        let mut states: Vec<_> = self.devices[device].iter().map(|(state, _)| *state).collect();
        states.dedup();
        states
    }

    /// Returns whether a device was ever in a state for a reason.
    pub(crate) fn said(&self, device: usize, state: &str, why: &str) -> bool {
        self.devices[device].iter().any(|(own, said)| *own == state && said.contains(why))
    }
}

impl Set {
    /// Returns a session with a tracker, whose station 1 is on the probe, and a grabber.
    pub(crate) fn of(tracker: impl Device + 'static, grabber: impl Device + 'static) -> Self {
        Self {
            tracking: Box::new(tracker),
            gives: Gives::Stations(vec![1]),
            of: vec!["Probe"],
            tracking_latency_ns: 0,
            grabber: Box::new(grabber),
            wait_ns: 5 * SECOND,
            looks: None,
            plane_viewer: None,
            brick_viewer: None,
            record: None,
            watch: None,
            smoothing: None,
            standard_error: false,
            shadow_weights: false,
        }
    }

    /// Adds a second station on the patient, in whose frame the volume lies.
    pub(crate) fn with_reference(self) -> Self {
        Self { gives: Gives::Stations(vec![1, 2]), of: vec!["Probe", "Reference"], ..self }
    }

    pub(crate) fn waits(self, wait_ns: i64) -> Self {
        Self { wait_ns, ..self }
    }

    /// Records the session on a store, of which `keep_free` bytes stay free.
    pub(crate) fn recorded(self, store: impl Store + 'static, options: WriterOptions, keep_free: u64) -> Self {
        let about = formats::session::About::now(&options.program);
        let writer = SessionWriter::on(Box::new(store), Path::new("memory.mcap"), about, options).unwrap();
        Self { record: Some((writer, keep_free)), ..self }
    }

    /// Runs until its devices have ended.
    pub(crate) fn run(self) -> (Finished, Seen) {
        self.until(|_, _| false)
    }

    /// Runs until its devices have ended, or `ends` returns true for the status and the elapsed
    /// time.
    pub(crate) fn until(self, mut ends: impl FnMut(&SessionStatus, Duration) -> bool) -> (Finished, Seen) {
        self.instructed(|status, since| if ends(status, since) { None } else { Some(Vec::new()) })
    }

    /// Runs until its devices have ended, or `instructions` returns `None`.
    pub(crate) fn instructed(
        self,
        mut instructions: impl FnMut(&SessionStatus, Duration) -> Option<Vec<Instruction>>,
    ) -> (Finished, Seen) {
        let (watch, plane_viewer) = (self.watch.clone(), self.plane_viewer.clone());
        let brick_viewer = self.brick_viewer.clone();
        let smoothing = self.smoothing;
        let mut session =
            Session { watch, plane_viewer, brick_viewer, smoothing, ..stages(self.wait_ns, self.looks.clone()) };
        session.settings.standard_error = self.standard_error;
        session.settings.shadow_weights = self.shadow_weights.then(ShadowWeights::default);
        let inputs = self.inputs();
        let (told, began) = (AtomicBool::new(false), Instant::now());
        let mut seen = Seen::default();
        let finished = run(&session, inputs, &Monotonic, &told, |status| {
            seen.look(status);
            adds_up(status);
            assert!(began.elapsed() < PATIENCE, "{status:?}");
            instructions(status, began.elapsed()).unwrap_or_else(|| {
                told.store(true, Ordering::Relaxed);
                Vec::new()
            })
        });
        let finished = finished.unwrap().finish();
        seen.look(&finished.status);
        adds_up(&finished.status);
        is_settled(&finished.status);
        let ledger = &finished.status.ledger;
        assert_eq!(ledger.frames.waiting, 0, "all frames are decided upon: {ledger}");
        assert!(ledger.readings.iter().all(|readings| readings.waiting() == 0), "{ledger}");
        (finished, seen)
    }
}

impl Set {
    pub(crate) fn inputs(self) -> SessionInputs {
        let (devices, record) = self.devices();
        SessionInputs::of(Source::Devices { devices, record })
    }

    fn devices(self) -> (Vec<SessionDevice>, Option<Record>) {
        let [tracking, grabber] = roles();
        let frames = self.of.iter().map(|of| [(*of).to_owned(), "Tracker".to_owned()]).collect();
        let tracking = DeviceRole { gives: self.gives, frames, latency_ns: self.tracking_latency_ns, ..tracking };
        let devices = vec![
            SessionDevice { role: tracking, device: self.tracking, protocol: None },
            SessionDevice { role: grabber, device: self.grabber, protocol: None },
        ];
        let record = self.record.map(|(writer, keep_free_bytes)| Record {
            writer,
            full_frame: true,
            notes: Vec::new(),
            keep_free_bytes,
        });
        (devices, record)
    }

    /// Records its devices until they have ended, or `ends` returns true, which sets `told`.
    /// Returns every received sample with its device's index, and the status.
    pub(crate) fn record_only(
        self,
        told: &AtomicBool,
        mut ends: impl FnMut(&SessionStatus) -> bool,
    ) -> (Vec<(usize, Live)>, SessionStatus) {
        let mut received = Vec::new();
        let began = Instant::now();
        let mask = MaskSettings { clip: Clip::None, ..MaskSettings::default() };
        let (devices, record) = self.devices();
        let gathered =
            record_only(devices, record, &SchedulingPolicy::default(), mask, &Monotonic, told, |what| match what {
                RecordEvent::Sample(device, live) => received.push((device, live)),
                RecordEvent::Turn(status) => {
                    adds_up(status);
                    assert!(began.elapsed() < PATIENCE, "{status:?}");
                    told.fetch_or(ends(status), Ordering::Relaxed);
                }
            });
        let (_, status) = gathered.unwrap();
        adds_up(&status);
        assert_eq!(status.ledger.frames.waiting, 0, "all frames are decided upon: {}", status.ledger);
        (received, status)
    }
}

/// Returns a tracker, whose station 1 is on the probe, and a grabber.
pub(crate) fn roles() -> [DeviceRole; 2] {
    let of = |name: &str, gives, frames| DeviceRole { name: name.into(), gives, frames, latency_ns: 0 };
    let frames = vec![["Probe".to_owned(), "Tracker".to_owned()]];
    [of("tracking", Gives::Stations(vec![1]), frames), of("grabber", Gives::Pictures, Vec::new())]
}

/// Returns settings for frames of [`SIZE`], a volume of 1 mm, and a waiting time of frames.
pub(crate) fn stages(wait_ns: i64, looks: Option<Arc<dyn ViewClient>>) -> Session {
    let p = PIXEL_MM;
    let rows = [p, 0.0, 0.0, 0.0, 0.0, p, 0.0, 0.0, 0.0, 0.0, p, 0.0, 0.0, 0.0, 0.0, 1.0];
    let statics = vec![StaticTransform::new("Image", "Probe", &rows).unwrap()];
    Session {
        pairing: PairingOptions { statics, ..PairingOptions::default() },
        wait_ns,
        longest_gap_ns: 100 * MS,
        pose_noise: None,
        smoothing: None,
        stuck_after_ns: SECOND / 2,
        mask: MaskSettings { clip: Clip::None, ..MaskSettings::default() },
        settings: Settings::new(DVec3::ONE),
        path: PathChoice::General,
        planar: PlanarSettings::default(),
        view_client: looks,
        observers: Vec::new(),
        watch: None,
        readers: Vec::new(),
        plane_viewer: None,
        brick_viewer: None,
    }
}

/// Checks that every frame and reading is counted once at any moment.
fn adds_up(status: &SessionStatus) {
    let Frames { total, used, waiting, refused, dropped, .. } = &status.ledger.frames;
    let counted = used + waiting + refused.values().sum::<u64>() + dropped.values().sum::<u64>();
    assert_eq!(*total, counted, "{}", status.ledger);
    for readings in &status.ledger.readings {
        let counted = readings.used + readings.dropped + readings.refused.values().sum::<u64>();
        assert!(counted <= readings.total, "{}", status.ledger);
    }
}

/// Checks that nothing waits for its outcome any more.
fn is_settled(status: &SessionStatus) {
    assert_eq!(status.ledger.frames.waiting, 0, "{}", status.ledger);
    for readings in &status.ledger.readings {
        let counted = readings.used + readings.dropped + readings.refused.values().sum::<u64>();
        assert_eq!(readings.total, counted, "{}", status.ledger);
    }
}

/// Returns the outcome of frames: all, used, and refused by reason.
pub(crate) fn frames(finished: &Finished) -> (u64, u64, Vec<(Reason, u64)>) {
    let Frames { total, used, refused, dropped, .. } = &finished.status.ledger.frames;
    assert!(dropped.is_empty(), "a machine that inserts 64×64 pixels has time for them: {}", finished.status.ledger);
    (*total, *used, refused.iter().map(|(reason, count)| (*reason, *count)).collect())
}

/// Returns whether the volume has data within 1 mm of a height, in the middle of the frames.
pub(crate) fn seen_at(finished: &Finished, z_mm: f64) -> bool {
    let volume = finished.outcome.as_ref().unwrap().reconstructor.volume();
    let [x, y] = SIZE.map(|side| (f64::from(side) * PIXEL_MM / 2.0) as i64);
    (-1..=1).any(|near| volume.voxel([x, y, z_mm.round() as i64 + near]).1 > 0.0)
}

/// A session's bytes in memory, like a disk of any size.
#[derive(Clone, Default)]
pub(crate) struct Memory(pub(crate) Arc<Mutex<Vec<u8>>>);

impl Memory {
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }
}

impl Store for Memory {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> std::io::Result<()> {
        let mut held = self.0.lock().unwrap();
        held.truncate(at as usize);
        held.extend_from_slice(bytes);
        Ok(())
    }

    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        self.0.lock().unwrap().truncate(length as usize);
        Ok(())
    }

    fn data_sync(&self) -> std::io::Result<Box<dyn DataSync>> {
        Ok(Box::new(()))
    }

    fn free_bytes(&self) -> Option<u64> {
        None
    }
}

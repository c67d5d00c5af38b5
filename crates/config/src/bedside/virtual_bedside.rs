//! The virtual bedside: the scan that its devices measure, and their faults.

use std::fmt;
use std::sync::Arc;

use drivers::simulated::Faults;
use phantom::bedside::Disturbance;
use phantom::bedside::arm::{BedsideArm, standard_arm};
use phantom::bedside::stylus::StylusMotion;
use phantom::named::{MotionOptions, ProbeName, SceneOptions, TrajectoryName};
use phantom::scan::Depth;
use phantom::{self, PhantomError, Scan, ScanSettings, TrackerNoise};
use sonoweave_core::keys::Table;

use super::devices::{Grabber, Tracking};
use super::reader::Reader;
use super::schema;
use super::schema::values::{Name, ns};
use crate::Error;

/// Default image size of a virtual grabber, pixels.
const IMAGE_SIZE: [u32; 2] = [640, 480];
/// Its default rate, frames a second.
const RATE_HZ: f64 = 30.0;
/// Least number of landmarks that give a phantom's pose.
const LEAST_LANDMARKS: usize = 3;

/// A virtual bedside.
#[derive(Clone)]
pub struct VirtualBedside {
    /// The scanned scene, and the motion of the hand.
    pub scan: Arc<Scan>,
    /// The motion of the stylus, if there is one.
    pub stylus: StylusMotion,
    /// Slow errors of the scan.
    pub disturbance: Disturbance,
    /// Frames a second of the grabber.
    pub rate_hz: f64,
    /// Renders its images before the session begins, one for each frame of the scan.
    pub painted: bool,
    /// Faults between the tracker or arm and the host.
    pub line: Faults,
    /// Faults of the grabber.
    pub grabber: Faults,
}

impl fmt::Debug for VirtualBedside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A scan's scene and beams have a hundred thousand numbers, so they are left out.
        let Self { scan: _, stylus, disturbance, rate_hz, painted, line, grabber } = self;
        let mut text = f.debug_struct("VirtualBedside");
        text.field("stylus", stylus)
            .field("disturbance", disturbance)
            .field("rate_hz", rate_hz)
            .field("painted", painted);
        text.field("line", line).field("grabber", grabber).finish_non_exhaustive()
    }
}

impl VirtualBedside {
    /// Returns the arm that carries the hand's probe, with encoders of `counts_per_turn`.
    ///
    /// # Errors
    /// [`Error::Setting`] for a motion that no arm, or not this one, can follow.
    pub fn carried(hand: Arc<phantom::Bedside>, counts_per_turn: u32) -> Result<BedsideArm, Error> {
        let arm = standard_arm(counts_per_turn.into()).map_err(|e| Error::setting("", e.to_string()))?;
        BedsideArm::new(hand, arm).map_err(|e| Error::setting("", e.to_string()))
    }

    /// Reads it without its faults, which are in the returned table's subsections.
    pub(super) fn read<'a>(
        mut keys: Reader<'a, '_>,
        tracking: &Tracking,
        grabber: &Grabber,
    ) -> Result<(ScannedHand, Option<Table<'a>>), Error> {
        let given: schema::virtual_bedside::Virtual = keys.read()?;
        let (scene, frames, seed) = (given.scene.0, given.frames, given.seed);
        let (usual_trajectory, usual_probe) = match tracking {
            Tracking::Tracker(_) | Tracking::Remote(_) => (TrajectoryName::Freehand, scene.usual_probe()),
            Tracking::Arm(_) => (TrajectoryName::Arm, scene.usual_probe().map(|_| ProbeName::Linear)),
        };
        let trajectory = given.trajectory.unwrap_or(Name(usual_trajectory));
        keys.note("trajectory", &trajectory);
        let trajectory = trajectory.0;
        if given.probe.is_some() && usual_probe.is_none() {
            return Err(keys.error("probe", "the scene has no simulated echoes; delete it, or give another scene"));
        }
        let probe = given.probe.or(usual_probe.map(Name));
        keys.note("probe", &probe);
        let has_stylus = matches!(tracking, Tracking::Tracker(tracker) if tracker.roles.stylus.is_some());
        if given.stylus.is_some() && !has_stylus {
            return Err(keys.error("stylus", "there is no stylus; give its station ([tracker] stylus_station), too"));
        }
        let stylus = given.stylus.map_or(StylusMotion::default(), |name| name.0);
        let tracker_noise =
            TrackerNoise { position_mm: given.tracker_noise_mm, rotation_degrees: given.tracker_noise_deg };
        let probe = probe.map(|name| name.0);
        let shown = scene.content(&SceneOptions { probe, ..SceneOptions::new(seed.into()) });
        let image_size = grabber.turned(grabber.settings.size.unwrap_or(IMAGE_SIZE));
        let rate_hz = grabber.settings.rate_hz.unwrap_or(RATE_HZ);
        let pixel_mm = given.pixel_mm.unwrap_or_else(|| shown.usual_pixel_mm(image_size));
        let scanner = shown.scanned().map(|scanned| scanned.scanner);
        let gap_mm = given.gap_mm.unwrap_or_else(|| trajectory.usual_gap_mm(&shown, frames));
        let noise_sd = given.noise_sd.unwrap_or_else(|| shown.usual_noise_sd());
        let touched = shown.scanned().map_or(0, |scanned| scanned.body.landmarks.len());
        if stylus == StylusMotion::Landmarks && touched < LEAST_LANDMARKS {
            let problem = format!("the scene has {touched} landmarks, but {LEAST_LANDMARKS} are needed; give n-wire");
            return Err(keys.error("scene", problem));
        }
        let unfit = |e: PhantomError| keys.unfit(Error::setting("", e.to_string()), |setting| setting);
        if given.pressure_mm > 0.0 && scanner.is_some() {
            return Err(keys.error("pressure_mm", "the scene has simulated echoes, which are not pressed; give blobs"));
        }
        let disturbance = Disturbance { drift_mm: given.tracker_drift_mm, pressure_mm: given.pressure_mm };
        let scene = shown.placed(image_size, pixel_mm).map_err(unfit)?;
        let scan = Scan::new(ScanSettings {
            motion: trajectory.motion(&MotionOptions::default(), &scene),
            scene,
            frames,
            gap_mm,
            image_size,
            pixel_mm: [pixel_mm; 2],
            noise_sd,
            depth: Depth::U8,
            fan: None,
            scanner,
            tracker_noise,
            seed: seed.into(),
            first_ns: 0,
            interval_ns: (1e9 / rate_hz).round() as i64,
        });
        let scan = scan.map_err(unfit)?;
        let hand = ScannedHand { scan, stylus, disturbance, rate_hz, painted: given.painted, seed: seed.into() };
        Ok((hand, keys.into_table()))
    }
}

/// A virtual bedside without faults.
pub(super) struct ScannedHand {
    scan: Scan,
    stylus: StylusMotion,
    disturbance: Disturbance,
    rate_hz: f64,
    painted: bool,
    seed: u64,
}

impl ScannedHand {
    pub(super) fn with_faults(self, line: Faults, grabber: Faults) -> VirtualBedside {
        let Self { scan, stylus, disturbance, rate_hz, painted, seed } = self;
        // The two devices have different random faults.
        let (line, grabber) = (Faults { seed, ..line }, Faults { seed: seed.wrapping_add(1), ..grabber });
        VirtualBedside { scan: Arc::new(scan), stylus, disturbance, rate_hz, painted, line, grabber }
    }
}

/// Reads the faults of a line.
pub(super) fn of_line(mut keys: Reader<'_, '_>) -> Result<Faults, Error> {
    let schema::virtual_bedside::Line { latency_ms, jitter_ms, packet_ms, drift_ppm, drop, noise, dropout } =
        keys.read()?;
    let [latency_ns, jitter_ns, packet_ns] = [latency_ms, jitter_ms, packet_ms].map(ns);
    Ok(Faults { latency_ns, jitter_ns, packet_ns, drift_ppm, drop, noise, dropout, ..Faults::default() })
}

/// Reads the faults of a grabber.
pub(super) fn of_grabber(mut keys: Reader<'_, '_>) -> Result<Faults, Error> {
    let schema::virtual_bedside::Grabber { latency_ms, jitter_ms, drift_ppm, dropout } = keys.read()?;
    let [latency_ns, jitter_ns] = [latency_ms, jitter_ms].map(ns);
    Ok(Faults { latency_ns, jitter_ns, drift_ppm, dropout, ..Faults::default() })
}

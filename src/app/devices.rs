//! Opens the devices of a session configuration: real ones by their drivers, virtual ones as
//! simulations of one hand movement.
//!
//! A virtual tracker or arm uses its model's own protocol on a line within the process, so that
//! its driver works as with the real device. A virtual grabber delivers its frames in process. The
//! times of both are those of the simulation, however late a loaded machine reads them.

mod homed;
mod together;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use calibration::arm::JOINTS;
use config::bedside::{Arm, ArmKind, Bedside, Roles, Tracker, Tracking, VIRTUAL, VirtualBedside};
use drivers::OpenSettings;
use drivers::arm::ea1;
use drivers::replay::line_protocol;
use drivers::simulated::grabber::{Grabber, Pictures};
use drivers::simulated::{self, Faults, Motion, Placed, fastrak, isotrak, liberty, microscribe, qsb, trembling, viper};
use drivers::tracker::polhemus::{Model, Port};
use drivers::transport::Peer;
use formats::session::LineProtocol;
use phantom::bedside::{PROBE_STATION, REFERENCE_STATION, STYLUS_STATION};
use phantom::{self, Scan, TrackerNoise};
use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic};
use sync::ingest::stored;

use homed::Homed;
use together::together;

/// Opened devices, stopped. A device that is absent is not an error: once started, its health
/// reports what it waits for.
pub struct Devices {
    /// The tracker or arm that carries the probe.
    pub tracking: Box<dyn Device>,
    /// Protocol of its lines, so that a recording's bytes can be decoded again.
    pub protocol: Option<LineProtocol>,
    /// To be set when the arm is in its home position; `None` without an arm.
    pub at_home: Option<Arc<AtomicBool>>,
    /// The frame grabber.
    pub grabber: Box<dyn Device>,
}

/// A simulated device at the other end of a line.
type Twin = Arc<Mutex<dyn Peer>>;

/// Reason why devices cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Settings that no such device has.
    #[error(transparent)]
    Device(#[from] drivers::Error),
    /// There is no simulation of the device.
    #[error("{0}")]
    NoTwin(String),
}

/// Opens all devices of a session configuration. The hand of a virtual bedside begins to move at
/// `begin_ns`, host ns. If `keeps_raw`, received bytes become readings, too.
///
/// # Errors
/// [`OpenError`].
pub fn open(bedside: &Bedside, begin_ns: i64, keeps_raw: bool) -> Result<Devices, OpenError> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic);
    let hand = bedside.virtual_bedside.as_ref().map(|virtual_bedside| {
        let hand = phantom::Bedside::new(Scan::clone(&virtual_bedside.scan), begin_ns);
        let hand = hand.with_stylus(virtual_bedside.stylus).with_disturbance(virtual_bedside.disturbance);
        (Arc::new(hand), virtual_bedside)
    });
    let mut twins = Vec::new();
    let settings = match (&bedside.tracking, &hand) {
        (Tracking::Tracker(tracker), Some((hand, virtual_bedside))) if tracker.port.is_none() => {
            let TrackerNoise { position_mm, rotation_degrees } = hand.scan().settings().tracker_noise;
            let motion = trembling(hand.motion(), position_mm, rotation_degrees, virtual_bedside.line.seed);
            twins.push(twin(tracker, seen_by(tracker.roles, motion), virtual_bedside.line));
            tracker.open_settings(Port::Serial { path: VIRTUAL.into(), baud: None }, keeps_raw)
        }
        (Tracking::Tracker(tracker), _) => {
            let port = tracker.port.clone().unwrap_or(Port::Usb(None));
            tracker.open_settings(port, keeps_raw)
        }
        (Tracking::Remote(remote), _) => remote.open_settings(),
        (Tracking::Arm(arm), hand) => {
            let ports = match (&arm.ports, hand) {
                (Some(ports), _) => ports.clone(),
                (None, Some((hand, virtual_bedside))) => {
                    twins = carrying(arm, Arc::clone(hand), virtual_bedside.line, begin_ns)?;
                    vec![VIRTUAL.into(); twins.len()]
                }
                (None, None) => Vec::new(),
            };
            arm.open_settings(&ports, keeps_raw)
        }
    };
    let protocol = line_protocol(&settings);
    let (tracking, at_home) = match &settings {
        OpenSettings::Arm(_) => {
            let (arm, at_home) = Homed::new(drivers::open_simulated(&settings, &twins)?);
            (Box::new(arm) as Box<dyn Device>, Some(at_home))
        }
        _ => (drivers::open_simulated(&settings, &twins)?, None),
    };
    let grabber: Box<dyn Device> = match &hand {
        Some((hand, VirtualBedside { rate_hz, painted, grabber: faults, scan, .. })) if bedside.grabber.is_virtual => {
            let (size, orientation) = (scan.settings().image_size, bedside.grabber.settings.orientation);
            let (pictures, painted_bytes) = match *painted {
                true => (hand.painted(), u64::from(scan.frames()) * u64::from(size[0]) * u64::from(size[1])),
                false => (hand.pictures(), 0),
            };
            let prepared_bytes = hand.table_bytes() + painted_bytes;
            let pictures = lying(pictures, size, orientation);
            let clock = Arc::clone(&clock);
            let mut grabber = Grabber::new(pictures, bedside.grabber.turned(size), *rate_hz, *faults, clock)?;
            (grabber.orientation, grabber.prepared_bytes) = (orientation, prepared_bytes);
            Box::new(grabber)
        }
        _ => drivers::open(&bedside.grabber.open_settings())?,
    };
    let (tracking, grabber) = if !twins.is_empty() && bedside.grabber.is_virtual {
        together(tracking, streams(&bedside.tracking), grabber, clock)
    } else {
        (tracking, grabber)
    };
    Ok(Devices { tracking, protocol, at_home, grabber })
}

/// Returns the stations or axes whose readings make a pose.
fn streams(tracking: &Tracking) -> Vec<u8> {
    match tracking {
        Tracking::Tracker(tracker) => tracker.roles.all().map(|(station, _)| station).collect(),
        Tracking::Arm(_) => (0..JOINTS as u8).collect(),
        Tracking::Remote(_) => Vec::new(),
    }
}

/// Converts MF frames of that size to the grabber's orientation.
fn lying(mut pictures: Pictures, size: [u32; 2], orientation: &'static str) -> Pictures {
    if orientation == "MF" {
        return pictures;
    }
    let mut mf = vec![0; size[0] as usize * size[1] as usize];
    Box::new(move |at_ns, pixels| {
        pictures(at_ns, &mut mf);
        pixels.copy_from_slice(&stored(&mf, size, orientation));
    })
}

/// Returns the hand's movement in terms of the tracker's stations for its sensors.
fn seen_by(roles: Roles, motion: Motion) -> Motion {
    Arc::new(move |station, at_ns| -> Placed {
        let of_hand = match station {
            station if station == roles.probe => PROBE_STATION,
            station if Some(station) == roles.stylus => STYLUS_STATION,
            _ => REFERENCE_STATION,
        };
        motion(of_hand, at_ns)
    })
}

/// Returns a simulated tracker, with the requested sensors plugged in.
fn twin(tracker: &Tracker, motion: Motion, faults: Faults) -> Twin {
    let sensors = tracker.roles.all().fold(0, |sensors: u16, (station, _)| sensors | 1 << (station - 1));
    match tracker.model {
        Model::Isotrak => peer(isotrak::Twin::new(motion, faults)),
        Model::Fastrak => peer(fastrak::Twin::new(motion, faults)),
        Model::Liberty | Model::Patriot => {
            let new = if tracker.model == Model::Liberty { liberty::Twin::new } else { liberty::Twin::patriot };
            let mut twin = new(motion, faults);
            twin.active = sensors;
            peer(twin)
        }
        Model::Viper => {
            let mut twin = viper::Twin::new(motion, faults);
            twin.sensors = sensors;
            peer(twin)
        }
    }
}

/// Returns the simulated lines of an arm, base first; its home position is where the hand begins.
fn carrying(arm: &Arm, hand: Arc<phantom::Bedside>, faults: Faults, now_ns: i64) -> Result<Vec<Twin>, OpenError> {
    let counts_per_turn = arm.twin_counts_per_turn();
    let carried =
        VirtualBedside::carried(hand, counts_per_turn).map_err(|unfit| OpenError::NoTwin(unfit.to_string()))?;
    let joints = Arc::new(carried).joints();
    Ok(match arm.kind {
        ArmKind::Ea1(protocol) => {
            let mut twin = simulated::ea1::Twin::new(joints, faults);
            twin.counts_per_turn = [counts_per_turn; 3];
            // It is at home and switched on before.
            (twin.homed, twin.starts_when_opened) = (7, false);
            twin.set_clock(now_ns, 0);
            twin.bare = protocol == ea1::SampleFormat::BareNumbers;
            if twin.bare {
                // The driver cannot query this setting.
                twin.rate_hz = arm.settings.rate_hz;
            }
            vec![peer(twin)]
        }
        ArmKind::Qsb => {
            let line = |axis| {
                let mut twin = qsb::Twin::new(Arc::clone(&joints), axis, faults);
                twin.resets_when_opened = false;
                peer(twin)
            };
            (0..3).map(line).collect()
        }
        ArmKind::MicroScribe(..) => vec![peer(microscribe::Twin::new(joints, faults))],
    })
}

fn peer(twin: impl Peer + 'static) -> Twin {
    Arc::new(Mutex::new(twin))
}

//! The devices of a bedside, opened: real ones by their drivers, virtual ones as twins that see one hand.
//!
//! A virtual tracker or arm speaks on a pseudo-terminal, in its model's own bytes, so that its driver does all that it does at the bedside; a virtual grabber delivers its
//! pictures in process.

mod homed;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use drivers::arm::ea1;
use drivers::clock::{Clock, Monotonic};
use drivers::polhemus::{Model, Port};
use drivers::recording::session::Speech;
use drivers::simulated::grabber::{Grabber, Pictures};
use drivers::simulated::{
    self, Faults, Motion, Placed, Pty, fastrak, isotrak, liberty, microscribe, qsb, trembling, viper,
};
use drivers::transport::Peer;
use drivers::{Device, Error, OpenSettings};

use crate::config::bedside::{Arm, ArmKind, Bedside, Rehearsal, Roles, Tracker, Tracking};
use crate::ingest::stored;
use crate::phantom::bedside::{PROBE_STATION, REFERENCE_STATION};
use crate::phantom::{self, Scan, TrackerNoise};
use homed::Homed;

/// Opened devices, stopped. What is not there yet is no error: a started device says in its health what it waits for.
pub struct Devices {
    /// What carries the probe.
    pub tracking: Box<dyn Device>,
    /// What its lines speak, so that a recording's bytes can be decoded anew.
    pub speech: Option<Speech>,
    /// To be set when the arm is in its home position, where an arm carries the probe.
    pub at_home: Option<Arc<AtomicBool>>,
    /// The frame grabber.
    pub grabber: Box<dyn Device>,
    /// Twins of what carries the probe. They hang up when this is dropped, so the devices go first.
    pub twins: Vec<Pty>,
}

/// Why devices cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Settings that no such device has.
    #[error(transparent)]
    Device(#[from] Error),
    /// A twin has no line.
    #[error("no pseudo-terminal for a virtual device: {0}; is /dev/pts mounted?")]
    Line(#[source] std::io::Error),
    /// What there is no twin of.
    #[error("{0}")]
    NoTwin(String),
}

/// Opens all devices of a bedside. The hand of a virtual one begins to move at `begin_ns`, host ns. With `keeps_raw` bytes that come are readings, too.
///
/// # Errors
/// [`OpenError`].
pub fn open(bedside: &Bedside, begin_ns: i64, keeps_raw: bool) -> Result<Devices, OpenError> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic);
    let hand = bedside.rehearsal.as_ref().map(|rehearsal| {
        let hand = phantom::Bedside::new(Scan::clone(&rehearsal.scan), begin_ns);
        (Arc::new(hand), rehearsal)
    });
    let mut twins = Vec::new();
    let settings = match (&bedside.tracking, &hand) {
        (Tracking::Tracker(tracker), Some((hand, rehearsal))) if tracker.port.is_none() => {
            let TrackerNoise { position_mm, rotation_degrees } = hand.scan().settings().tracker_noise;
            let motion = trembling(hand.motion(), position_mm, rotation_degrees, rehearsal.line.seed);
            let twin = twin(tracker, seen_by(tracker.roles, motion), rehearsal.line);
            let twin = twin.map_err(OpenError::Line)?;
            let port = Port::Serial { path: twin.path().to_owned(), baud: None };
            twins.push(twin);
            tracker.open_settings(port, keeps_raw)
        }
        (Tracking::Tracker(tracker), _) => {
            let port = tracker.port.clone().unwrap_or(Port::Usb(None));
            tracker.open_settings(port, keeps_raw)
        }
        (Tracking::Remote(remote), _) => remote.open_settings(),
        (Tracking::Arm(arm), hand) => {
            let ports = match (&arm.ports, hand) {
                (Some(ports), _) => ports.clone(),
                (None, Some((hand, rehearsal))) => {
                    twins = carrying(arm, Arc::clone(hand), rehearsal.line, begin_ns)?;
                    twins.iter().map(|twin| twin.path().to_owned()).collect()
                }
                (None, None) => Vec::new(),
            };
            arm.open_settings(&ports, keeps_raw)
        }
    };
    let speech = Speech::of(&settings);
    let (tracking, at_home) = match &settings {
        OpenSettings::Arm(_) => {
            let (arm, at_home) = Homed::new(drivers::open(&settings)?);
            (Box::new(arm) as Box<dyn Device>, Some(at_home))
        }
        _ => (drivers::open(&settings)?, None),
    };
    let grabber: Box<dyn Device> = match &hand {
        Some((hand, Rehearsal { rate_hz, painted, grabber: faults, scan, .. })) if bedside.grabber.is_virtual => {
            let (size, orientation) = (scan.settings().image_size, bedside.grabber.settings.orientation);
            let pictures = if *painted { hand.painted() } else { hand.pictures() };
            let pictures = lying(pictures, size, orientation);
            let mut grabber = Grabber::new(pictures, bedside.grabber.turned(size), *rate_hz, *faults, clock)?;
            grabber.orientation = orientation;
            Box::new(grabber)
        }
        _ => drivers::open(&bedside.grabber.open_settings())?,
    };
    Ok(Devices { tracking, speech, at_home, grabber, twins })
}

/// MF pictures of that size as a grabber shows them whose video lies otherwise.
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

/// The hand as the stations see it that a tracker has for its sensors.
fn seen_by(roles: Roles, motion: Motion) -> Motion {
    Arc::new(move |station, at_ns| -> Placed {
        let of_hand = if station == roles.probe { PROBE_STATION } else { REFERENCE_STATION };
        motion(of_hand, at_ns)
    })
}

/// A tracker's twin, with the sensors that are asked for plugged in.
fn twin(tracker: &Tracker, motion: Motion, faults: Faults) -> std::io::Result<Pty> {
    let sensors = tracker.roles.all().fold(0, |sensors: u16, (station, _)| sensors | 1 << (station - 1));
    match tracker.model {
        Model::Isotrak => play(isotrak::Twin::new(motion, faults)),
        Model::Fastrak => play(fastrak::Twin::new(motion, faults)),
        Model::Liberty | Model::Patriot => {
            let new = if tracker.model == Model::Liberty { liberty::Twin::new } else { liberty::Twin::patriot };
            let mut twin = new(motion, faults);
            twin.active = sensors;
            play(twin)
        }
        Model::Viper => {
            let mut twin = viper::Twin::new(motion, faults);
            twin.sensors = sensors;
            play(twin)
        }
    }
}

/// The twins of an arm's lines, base first; homed where the hand begins.
fn carrying(arm: &Arm, hand: Arc<phantom::Bedside>, faults: Faults, now_ns: i64) -> Result<Vec<Pty>, OpenError> {
    let counts_per_turn = arm.twin_counts_per_turn();
    let carried = Rehearsal::carried(hand, counts_per_turn).map_err(|unfit| OpenError::NoTwin(unfit.problem))?;
    let joints = Arc::new(carried).joints();
    let lines: std::io::Result<Vec<Pty>> = match arm.kind {
        ArmKind::Ea1(speech) => {
            let mut twin = simulated::ea1::Twin::new(joints, faults);
            twin.counts_per_turn = [counts_per_turn; 3];
            twin.homed = 7;
            twin.set_clock(now_ns, 0);
            twin.bare = speech == ea1::Speech::BareNumbers;
            if twin.bare {
                // Nobody can tell it.
                twin.rate_hz = arm.settings.rate_hz;
            }
            play(twin).map(|line| vec![line])
        }
        ArmKind::Qsb => (0..3).map(|axis| play(qsb::Twin::new(Arc::clone(&joints), axis, faults))).collect(),
        ArmKind::MicroScribe(..) => play(microscribe::Twin::new(joints, faults)).map(|line| vec![line]),
    };
    lines.map_err(OpenError::Line)
}

fn play(peer: impl Peer + 'static) -> std::io::Result<Pty> {
    Pty::run(Arc::new(Mutex::new(peer)))
}

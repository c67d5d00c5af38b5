//! A device's thread: takes each delivery of the device and passes it on, independently of the
//! later stages.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Scope, ScopedJoinHandle};

use tracing::trace_span;

use formats::session::LineProtocol;
use sonoweave_core::clock::MS;
use sonoweave_core::{Device, Next, Reading};

use super::common::Common;
use super::device::{DeviceRole, SessionDevice};
use super::priority::{Role, SchedulingPolicy};
use super::sequencer::EventSequencer;
use super::spawn::{joined, spawn};
use super::status::StatusCollector;
use super::turns::Stage;
use crate::trace::STAGE;

/// Longest wait for a device before its health is checked again, ns.
const TURN: i64 = 50 * MS;

/// Runs a device until `ends` is set or the device ends by itself.
///
/// # Errors
/// The device's: a setting that it refuses, or damaged data of a recording.
pub(super) fn run(
    source: usize,
    device: &mut dyn Device,
    common: Common<'_>,
    ends: &AtomicBool,
    sequencer: &EventSequencer<'_>,
) -> Result<(), sonoweave_core::Error> {
    let Common { clock, status, .. } = common;
    let mut set_up = u64::MAX;
    let turns = status.turns.begin(Stage::Capture(source));
    device.start()?;
    while !ends.load(Ordering::Relaxed) {
        turns.turn();
        let next = device.next(clock.now_ns() + TURN)?;
        status.health(source, device.health());
        if device.health().received.set_up != set_up {
            set_up = device.health().received.set_up;
            if !sequencer.set_up(source, device.describe()) {
                break;
            }
        }
        let goes_on = match next {
            Next::Reading(reading) => {
                let frame = matches!(reading, Reading::Frame(_)).then(|| reading.stamp().item);
                let _span = frame.map(|frame| trace_span!(target: STAGE, "capture", frame).entered());
                sequencer.take(source, reading)
            }
            Next::Pending => true,
            Next::End => false,
        };
        if !goes_on {
            break;
        }
    }
    let stopped = device.stop();
    status.health(source, device.health());
    stopped
}

/// Assumed size of an unknown frame, bytes.
const USUAL_FRAME: u64 = 1920 * 1080;

/// Devices, roles and unit protocols, each in the order of the devices' indices.
pub(super) struct Parts {
    pub(super) devices: Vec<Box<dyn Device>>,
    pub(super) roles: Vec<DeviceRole>,
    pub(super) protocols: Vec<Option<LineProtocol>>,
}

pub(super) fn parts(equipment: Vec<SessionDevice>) -> Parts {
    let mut parts = Parts { devices: Vec::new(), roles: Vec::new(), protocols: Vec::new() };
    for SessionDevice { role, device, protocol } in equipment {
        parts.devices.push(device);
        parts.roles.push(role);
        parts.protocols.push(protocol);
    }
    parts
}

/// A device's thread, which ends with its device.
pub(super) type Capturing<'scope> = ScopedJoinHandle<'scope, Result<(), sonoweave_core::Error>>;

/// Starts a thread for each device.
pub(super) fn capturing<'scope, 'env>(
    scope: &'scope Scope<'scope, 'env>,
    devices: Vec<Box<dyn Device>>,
    names: &[String],
    policy: &SchedulingPolicy,
    common: Common<'env>,
    ends: &'env AtomicBool,
    sequencer: &'env EventSequencer<'env>,
) -> Vec<Capturing<'scope>> {
    let capture = |(source, mut device): (usize, Box<dyn Device>)| {
        spawn(scope, &format!("capture-{}", names[source]), (policy, Role::Capture), move || {
            let ran = run(source, device.as_mut(), common, ends, sequencer);
            ran.inspect_err(|error| common.status.failed(source, error))
        })
    };
    devices.into_iter().enumerate().map(capture).collect()
}

/// Waits for the capture threads, and notes the errors of those that failed.
pub(super) fn captured(captures: Vec<Capturing<'_>>, names: &[String], status: &StatusCollector) {
    for (capture, name) in captures.into_iter().zip(names) {
        if let Err(error) = joined(capture) {
            status.note(format!("{name}: {error}"));
        }
    }
}

/// Returns the size of a frame in bytes, by the devices' descriptions.
pub(super) fn frame_bytes(devices: &[Box<dyn Device>]) -> u64 {
    let sizes = devices.iter().filter_map(|device| device.describe().image_size);
    sizes.map(|[width, height]| u64::from(width) * u64::from(height)).max().unwrap_or(USUAL_FRAME)
}

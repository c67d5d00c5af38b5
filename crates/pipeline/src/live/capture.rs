//! A device's thread: takes each delivery of the device and passes it on, independently of the
//! later stages.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use tracing::trace_span;

use sonoweave_core::clock::MS;
use sonoweave_core::{Device, Next, Reading};

use super::decision::Common;
use super::pulse::Stage;
use super::sequencer::EventSequencer;
use crate::trace::STAGE;

/// Longest wait for a device before its health is checked again, ns.
const TURN: i64 = 50 * MS;

/// Frames between capture and the volume, over all queues. Their number is limited, which bounds
/// the memory that they hold.
pub(super) struct InFlight {
    frames: AtomicI64,
    most: i64,
}

impl InFlight {
    pub(super) fn new(most: u64) -> Self {
        Self { frames: AtomicI64::new(0), most: i64::try_from(most).unwrap_or(i64::MAX).max(4) }
    }

    /// Counts one more frame if there is room; returns whether there was.
    pub(super) fn enter(&self) -> bool {
        let before = self.frames.fetch_add(1, Ordering::Relaxed);
        if before >= self.most {
            self.leave();
            return false;
        }
        true
    }

    pub(super) fn leave(&self) {
        self.frames.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Runs a device until `ends` is set or the device ends by itself.
///
/// # Errors
/// The device's: a setting that it refuses, or damaged data of a recording.
pub(super) fn run(
    source: usize,
    device: &mut dyn Device,
    common: Common<'_>,
    ends: &AtomicBool,
    intake: &EventSequencer<'_>,
) -> Result<(), sonoweave_core::Error> {
    let Common { clock, board, .. } = common;
    let mut set_up = u64::MAX;
    let beat = board.pulse.of(Stage::Capture(source));
    device.start()?;
    while !ends.load(Ordering::Relaxed) {
        beat.turn();
        let next = device.next(clock.now_ns() + TURN)?;
        board.health(source, device.health());
        if device.health().received.set_up != set_up {
            set_up = device.health().received.set_up;
            if !intake.set_up(source, device.describe()) {
                break;
            }
        }
        let goes_on = match next {
            Next::Reading(reading) => {
                let frame = matches!(reading, Reading::Frame(_)).then(|| reading.stamp().item);
                let _span = frame.map(|frame| trace_span!(target: STAGE, "capture", frame).entered());
                intake.take(source, reading)
            }
            Next::Pending => true,
            Next::End => false,
        };
        if !goes_on {
            break;
        }
    }
    let stopped = device.stop();
    board.health(source, device.health());
    stopped
}

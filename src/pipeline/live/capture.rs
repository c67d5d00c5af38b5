//! A device's thread: takes what the device delivers and hands it on, whatever the stages behind it are doing.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use drivers::clock::MS;
use drivers::{Device, Next, Reading};
use tracing::trace_span;

use super::decision::Common;
use super::intake::Intake;
use super::pulse::Stage;
use crate::trace::STAGE;

/// The longest that a device is waited for before its health is looked at again, ns.
const TURN: i64 = 50 * MS;

/// Frames that are on their way between capture and the volume, all queues together: a bound on the memory that they hold.
pub(super) struct InFlight {
    frames: AtomicI64,
    most: i64,
}

impl InFlight {
    pub(super) fn new(most: u64) -> Self {
        Self { frames: AtomicI64::new(0), most: i64::try_from(most).unwrap_or(i64::MAX).max(4) }
    }

    /// Whether there is room for one more; then it counts.
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

/// Runs a device until it is told to end or has ended by itself.
///
/// # Errors
/// The device's: a setting that it refuses, or data of a recording that are damaged.
pub(super) fn run(
    source: usize,
    device: &mut dyn Device,
    common: Common<'_>,
    ends: &AtomicBool,
    intake: &Intake<'_>,
) -> Result<(), drivers::Error> {
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

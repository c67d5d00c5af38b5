//! A device's thread: takes what the device delivers and hands it on, whatever the stages behind it are doing.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use crossbeam_channel::{Sender, TrySendError};
use drivers::clock::MS;
use drivers::{Device, Next, Reading, Timing};

use super::pairing::Common;
use crate::ledger::Queue;

/// The longest that a device is waited for before its health is looked at again, ns.
const TURN: i64 = 50 * MS;

/// What a device has to say.
pub(super) struct Delivery {
    /// Which device, by its place in the session.
    pub(super) source: usize,
    pub(super) word: Word,
}

/// One of its words.
#[allow(clippy::large_enum_variant, reason = "nearly all values are the large ones, moved once")]
pub(super) enum Word {
    /// It was set up, perhaps anew: what its stamps mean.
    SetUp(Timing),
    /// A reading.
    Reading(Reading),
}

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
    onward: &Sender<Delivery>,
) -> Result<(), drivers::Error> {
    let Common { clock, board, recorder, in_flight } = common;
    let mut set_up = u64::MAX;
    device.start()?;
    while !ends.load(Ordering::Relaxed) {
        let next = device.next(clock.now_ns() + TURN)?;
        board.health(source, device.health());
        if device.health().received.set_up != set_up {
            set_up = device.health().received.set_up;
            recorder.describe(source, device.describe());
            // Never dropped: without it no reading has a time.
            if onward.send(Delivery { source, word: Word::SetUp(device.describe().timing) }).is_err() {
                break;
            }
        }
        let reading = match next {
            Next::Reading(reading) => reading,
            Next::Pending => continue,
            Next::End => break,
        };
        recorder.take(source, &reading, clock.now_ns());
        if matches!(reading, Reading::Raw(_)) {
            continue;
        }
        let is_frame = matches!(reading, Reading::Frame(_));
        board.arrived(source);
        if is_frame && !in_flight.enter() {
            board.dropped(source, Queue::Pairing);
            continue;
        }
        match onward.try_send(Delivery { source, word: Word::Reading(reading) }) {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                board.dropped(source, Queue::Pairing);
                if is_frame {
                    in_flight.leave();
                }
            }
            Err(TrySendError::Disconnected(_)) => break,
        }
    }
    let stopped = device.stop();
    board.health(source, device.health());
    stopped
}

//! The virtual bedside's order of start: its scanner is switched on when its tracker or arm
//! delivers. A frame before the first pose would be refused, although nothing is wrong.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use sonoweave_core::clock::{Clock, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Reading, Status};
use sonoweave_core::{Description, Device, Error, Health, Next};

/// Readings of each station or axis until tracking counts as running. The first ones set the
/// clock, so that a frame's time would be uncertain against theirs.
const ENOUGH: u8 = 3;
/// Longest time that the grabber waits for them, ns.
const PATIENCE: i64 = 5 * SECOND;

/// A tracker or arm that reports its first valid poses, or its first counts.
pub(super) struct Leader {
    tracking: Box<dyn Device>,
    /// A bit for each station or axis.
    wanted: u32,
    /// Readings of each, up to [`ENOUGH`].
    seen: [u8; u32::BITS as usize],
    runs: Arc<AtomicBool>,
}

/// A grabber that begins when the leader runs.
pub(super) struct Follower {
    grabber: Box<dyn Device>,
    runs: Arc<AtomicBool>,
    clock: Arc<dyn Clock>,
    /// End of the wait, host ns; `None` before the start and after the wait.
    until_ns: Option<i64>,
    /// Health during the wait.
    waits: Health,
}

/// Returns both devices, of which the grabber waits for the tracking. `wanted` are the stations
/// or axes whose readings it needs.
pub(super) fn together(
    tracking: Box<dyn Device>,
    wanted: impl IntoIterator<Item = u8>,
    grabber: Box<dyn Device>,
    clock: Arc<dyn Clock>,
) -> (Box<dyn Device>, Box<dyn Device>) {
    let wanted = wanted.into_iter().fold(0, |bits, n| bits | bit(n));
    let runs = Arc::new(AtomicBool::new(false));
    let leader = Leader { tracking, wanted, seen: [0; u32::BITS as usize], runs: Arc::clone(&runs) };
    (Box::new(leader), Box::new(Follower { grabber, runs, clock, until_ns: None, waits: Health::default() }))
}

/// Returns the bit of a station or axis.
fn bit(n: u8) -> u32 {
    1_u32.checked_shl(n.into()).unwrap_or(0)
}

impl Leader {
    fn take(&mut self, reading: &Reading) {
        let bits = match reading {
            Reading::Pose(pose) if pose.status == Status::Ok => bit(pose.station),
            // An arm that is not homed counts, too; its readings say so.
            Reading::Counts(counts) => {
                (0..counts.axes).fold(0, |bits, axis| bits | bit(counts.first.saturating_add(axis)))
            }
            _ => return,
        };
        let mut runs = true;
        for (at, seen) in self.seen.iter_mut().enumerate() {
            *seen = (*seen + (bits >> at & 1) as u8).min(ENOUGH);
            runs &= self.wanted >> at & 1 == 0 || *seen == ENOUGH;
        }
        if runs {
            self.runs.store(true, Ordering::Relaxed);
        }
    }
}

impl Device for Leader {
    fn start(&mut self) -> Result<(), Error> {
        self.tracking.start()
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        let next = self.tracking.next(deadline_ns)?;
        if let Next::Reading(reading) = &next
            && !self.runs.load(Ordering::Relaxed)
        {
            self.take(reading);
        }
        Ok(next)
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.tracking.stop()
    }

    fn home(&mut self, axes: u8) -> Result<(), Error> {
        self.tracking.home(axes)
    }

    fn describe(&self) -> &Description {
        self.tracking.describe()
    }

    fn health(&self) -> &Health {
        self.tracking.health()
    }
}

/// Pause between two looks at the leader, ns.
const LOOK: i64 = SECOND / 100;

impl Device for Follower {
    fn start(&mut self) -> Result<(), Error> {
        let now_ns = self.clock.now_ns();
        self.until_ns = Some(now_ns + PATIENCE);
        self.waits.enter(State::Starting, "waits for the tracker or arm", now_ns);
        self.grabber.start()
    }

    fn next(&mut self, deadline_ns: i64) -> Result<Next, Error> {
        while let Some(until_ns) = self.until_ns {
            let now_ns = self.clock.now_ns();
            if self.runs.load(Ordering::Relaxed) || now_ns >= until_ns {
                self.until_ns = None;
            } else if now_ns >= deadline_ns {
                return Ok(Next::Pending);
            } else {
                self.clock.wait_until(deadline_ns.min(now_ns + LOOK));
            }
        }
        self.grabber.next(deadline_ns)
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.until_ns = None;
        self.grabber.stop()
    }

    fn describe(&self) -> &Description {
        self.grabber.describe()
    }

    fn prepared_bytes(&self) -> u64 {
        self.grabber.prepared_bytes()
    }

    fn health(&self) -> &Health {
        if self.until_ns.is_some() { &self.waits } else { self.grabber.health() }
    }
}

#[cfg(test)]
mod tests {
    use drivers::simulated::Faults;
    use drivers::simulated::grabber::Grabber;
    use sonoweave_core::clock::{MS, Manual};
    use sonoweave_core::reading::{Pose, Stamp};

    use super::*;

    /// Delivers a pose every 10 ms: station 1 from the beginning, station 2 from `second_ns` on.
    struct Tracker {
        clock: Manual,
        second_ns: i64,
        number: u64,
        description: Description,
        health: Health,
    }

    impl Device for Tracker {
        fn start(&mut self) -> Result<(), Error> {
            Ok(())
        }

        fn next(&mut self, _: i64) -> Result<Next, Error> {
            self.clock.pass(10 * MS);
            self.number += 1;
            let station = if self.number % 2 == 1 { 1 } else { 2 };
            let is_silent = station == 2 && self.clock.now_ns() < self.second_ns;
            Ok(Next::Reading(Reading::Pose(Pose {
                stamp: Stamp { item: self.number, host_ns: Some(self.clock.now_ns()), ..Stamp::default() },
                station,
                position_cm: [0.0; 3],
                quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
                buttons: 0,
                code: None,
                distortion: None,
                status: if is_silent { Status::Other("out of range".into()) } else { Status::Ok },
            })))
        }

        fn stop(&mut self) -> Result<(), Error> {
            Ok(())
        }

        fn describe(&self) -> &Description {
            &self.description
        }

        fn health(&self) -> &Health {
            &self.health
        }
    }

    /// Runs both devices for 8 s; returns the time of the first frame, host ns.
    fn first_frame_ns(second_ns: i64) -> i64 {
        let clock = Manual::at(0);
        let tracker = Tracker {
            clock: clock.clone(),
            second_ns,
            number: 0,
            description: Description::default(),
            health: Health::default(),
        };
        let timer: Arc<dyn Clock> = Arc::new(clock.clone());
        let grabber = Grabber::new(Box::new(|_, _| {}), [4, 4], 50.0, Faults::default(), Arc::clone(&timer)).unwrap();
        let (mut leader, mut follower) = together(Box::new(tracker), [1, 2], Box::new(grabber), timer);
        leader.start().unwrap();
        follower.start().unwrap();
        assert_eq!(follower.health().state, State::Starting);
        while clock.now_ns() < 8 * SECOND {
            leader.next(0).unwrap();
            if let Next::Reading(Reading::Frame(frame)) = follower.next(clock.now_ns()).unwrap() {
                assert_eq!((frame.frame_number, follower.health().received.lost), (Some(0), 0));
                return frame.stamp.host_ns.unwrap();
            }
        }
        panic!("no frame");
    }

    #[test]
    fn grabber_begins_when_each_station_has_delivered() {
        // The third pose of station 2 is the sixth of all.
        assert_eq!(first_frame_ns(0), 60 * MS);
        assert_eq!(first_frame_ns(2 * SECOND), 2 * SECOND + 40 * MS);
    }

    #[test]
    fn grabber_begins_alone_when_tracking_stays_away() {
        assert_eq!(first_frame_ns(i64::MAX), PATIENCE);
    }
}

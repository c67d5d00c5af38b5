//! Converts samples to readings: which are accepted, which axes are homed, which were lost.
//!
//! The arm itself reports which axes are homed: by its flags, when its index marks pass or after
//! `!Z`. This module uses only received bytes, so a recording's bytes give the same readings. The
//! arm echoes a ping's number; the answer to a time ping behind a `!Z` therefore names the axes
//! that were zeroed.

use std::collections::VecDeque;

use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::reading::{self, Counts, Reading, Stamp, Status};

use super::{AXES, Command, Framing, Record, Sample, flag};
use crate::arm::Settings;
use crate::arm::homing::{Between, Homing, Passed};

/// Time limit of the answer to a ping, ns.
const ANSWER: i64 = 300 * MS;
/// Time between two time pings, ns.
const PING: i64 = SECOND;
/// Number of times that an unanswered ping is sent.
const TRIES: u8 = 3;
/// Bit position, in a ping's number, of the axes that were zeroed just before it.
const ZEROED: u32 = 29;

/// A reading before it is accepted or refused.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    sample: Sample,
    at_ns: i64,
}

/// An unanswered request for the arm's time.
#[derive(Debug, Clone, Copy)]
struct Ping {
    token: u32,
    sent_ns: i64,
    tries: u8,
}

/// Axes that were zeroed before the arm's time `by_us`, µs.
#[derive(Debug, Clone, Copy)]
struct Zeroed {
    axes: u8,
    by_us: u32,
}

/// State of an arm that sends samples.
#[derive(Debug)]
pub(super) struct Follower {
    fastest: i64,
    /// Whether the arm sends only bare numbers.
    bare: bool,
    homing: Homing<Taken>,
    zeroed: Option<Zeroed>,
    /// Axes that the next message zeroes.
    to_zero: u8,
    ping: Option<Ping>,
    pings: u32,
    next_ping_ns: i64,
    round_trip_ns: Option<i64>,
    /// Whether the arm has restarted while it was read.
    restarted: bool,
    last: Option<Sample>,
    /// Recent time between two samples, µs.
    period_us: Option<i64>,
    /// Lost samples, from the gaps in their numbers.
    lost: u64,
    refused: u64,
    trouble: String,
    /// Samples since the last overrun.
    since_overrun: u32,
}

/// Number of samples for which an overrun is reported.
const OVERRUN_SAMPLES: u32 = 100;

impl Follower {
    pub(super) fn new(settings: &Settings, bare: bool) -> Self {
        // Bare numbers are timed by the host, which receives them in packets.
        let grace_ns = if bare { 50 * MS } else { MS };
        Self {
            fastest: settings.fastest.into(),
            bare,
            homing: Homing::new(0, AXES as u8, AXES as u8, 32, settings.fastest, grace_ns),
            zeroed: None,
            to_zero: 0,
            ping: None,
            pings: 0,
            next_ping_ns: i64::MIN,
            round_trip_ns: None,
            restarted: false,
            last: None,
            period_us: None,
            lost: 0,
            refused: 0,
            trouble: String::new(),
            since_overrun: OVERRUN_SAMPLES,
        }
    }

    /// Clears all state; the arm may be another one.
    pub(super) fn restart(&mut self) {
        // An EA1 arm reports its own homing.
        self.homing.restart(if self.bare { 0 } else { self.homing.all() });
        (self.zeroed, self.ping, self.last, self.period_us) = (None, None, None, None);
        (self.restarted, self.next_ping_ns) = (false, i64::MIN);
        (self.lost, self.refused) = (0, 0);
        self.trouble.clear();
    }

    /// See [`super::Unit::home`].
    pub(super) fn home(&mut self, axes: u8) {
        if self.bare {
            self.homing.home(axes);
        } else {
            self.to_zero |= axes & self.homing.all();
        }
    }

    /// See [`super::Unit::round_trip_ns`].
    pub(super) fn round_trip_ns(&self) -> Option<i64> {
        self.round_trip_ns
    }

    /// Returns the numbers of lost and of refused readings.
    pub(super) fn losses(&self) -> [u64; 2] {
        [self.lost, self.refused]
    }

    pub(super) fn trouble(&self) -> &str {
        &self.trouble
    }

    /// Returns whether the arm has restarted since the last call: it then sends nothing until the
    /// host asks.
    pub(super) fn has_restarted(&mut self) -> bool {
        std::mem::take(&mut self.restarted)
    }

    /// Appends the bytes to send now.
    pub(super) fn ask(&mut self, now_ns: i64, to: &mut Vec<u8>) {
        if self.to_zero != 0 {
            let axes = std::mem::take(&mut self.to_zero);
            Command::Zero(axes).write(to);
            self.send_ping(axes, now_ns, to);
        } else if let Some(ping) = &mut self.ping {
            if now_ns < ping.sent_ns + ANSWER {
                return;
            }
            if ping.tries < TRIES {
                (ping.sent_ns, ping.tries) = (now_ns, ping.tries + 1);
                Command::Time(ping.token).write(to);
                return;
            }
            let axes = (ping.token >> ZEROED) as u8;
            self.ping = None;
            if axes != 0 {
                self.homing
                    .distrust(axes, "the arm was told that it is at home and does not answer: home it once more");
            }
        } else if now_ns >= self.next_ping_ns {
            self.next_ping_ns = now_ns + PING;
            self.send_ping(0, now_ns, to);
        }
    }

    fn send_ping(&mut self, axes: u8, now_ns: i64, to: &mut Vec<u8>) {
        self.pings += 1;
        let token = u32::from(axes) << ZEROED | self.pings & ((1 << ZEROED) - 1);
        self.ping = Some(Ping { token, sent_ns: now_ns, tries: 1 });
        Command::Time(token).write(to);
    }

    /// Takes a record from the arm.
    pub(super) fn push(&mut self, record: &Record<'_>, at_ns: i64, found: &mut VecDeque<Reading>) {
        match *record {
            Record::Sample(sample) => {
                let (period_us, zeroed) = (self.period_us, self.zeroed);
                let passed = self.homing.push(Taken { sample, at_ns }, wide(sample.counts), |earlier, later| {
                    between(&earlier.sample, &later.sample, period_us, zeroed)
                });
                self.pass(passed, found);
            }
            Record::Unreliable(counts) => self.push_bare(counts, at_ns, found),
            Record::Time { token, t_us } => self.answered(token, t_us, at_ns),
            Record::Identity(_) => self.restarted = true,
            Record::Error(code) => tracing::debug!("the arm answers with error {code}"),
        }
    }

    /// Takes the answer to a ping.
    fn answered(&mut self, token: u32, t_us: u32, at_ns: i64) {
        let axes = (token >> ZEROED) as u8;
        if axes != 0 {
            self.zeroed = Some(Zeroed { axes, by_us: t_us });
        }
        if let Some(ping) = self.ping.take_if(|ping| ping.token == token)
            && ping.tries == 1
        {
            let took = at_ns - ping.sent_ns;
            self.round_trip_ns = Some(self.round_trip_ns.map_or(took, |best| best.min(took)));
        }
    }

    /// Delivers one more accepted sample.
    fn pass(&mut self, passed: Passed<Taken>, found: &mut VecDeque<Reading>) {
        self.refused += passed.refused;
        let jumped = passed.held.is_some();
        for (Taken { sample, at_ns }, counts) in [passed.held, passed.this].into_iter().flatten() {
            if let Some(last) = self.last.replace(sample) {
                self.count(&last, &sample);
            }
            let reported = homed_of(sample.flags);
            let fault = (sample.flags / flag::FAULT[0]) as u8 & self.homing.all();
            // Axes that the arm reports as not homed are trusted again once it reports them as
            // homed.
            self.homing.trust(!reported & self.homing.all());
            self.zero(&sample, reported, counts);
            let homed = reported & self.homing.homed() & !fault;
            if homed == self.homing.all() {
                self.homing.settle();
            }
            let status = self.homing.status_after(jumped, homed, fault);
            let is_overrun = sample.flags & flag::OVERRUN != 0;
            self.since_overrun = if is_overrun { 0 } else { self.since_overrun.saturating_add(1) };
            self.note(self.since_overrun < OVERRUN_SAMPLES, &status);
            let ticks = Some(u64::from(sample.t_us));
            let counts = Counts { homed, buttons: sample.buttons, status, ..blank(ticks, at_ns, counts) };
            found.push_back(Reading::Counts(counts));
        }
    }

    /// Takes bare numbers, by the host's time.
    fn push_bare(&mut self, shown: [i32; AXES], at_ns: i64, found: &mut VecDeque<Reading>) {
        let sample = Sample { seq: 0, t_us: 0, counts: shown, flags: 0, buttons: 0, framing: Framing::Lines };
        let passed = self.homing.push(Taken { sample, at_ns }, wide(shown), |earlier, later| Between::Later {
            ns: later.at_ns - earlier.at_ns,
            set: 0,
            expected: true,
        });
        self.refused += passed.refused;
        for (Taken { at_ns, .. }, counts) in [passed.held, passed.this].into_iter().flatten() {
            let homed = self.homing.homed();
            let status = self.homing.status(homed, 0);
            self.note(false, &status);
            found.push_back(Reading::Counts(Counts { homed, status, ..blank(None, at_ns, counts) }));
        }
    }

    /// Counts the loss between two accepted samples, and tracks their period.
    fn count(&mut self, earlier: &Sample, later: &Sample) {
        let (steps, us) = steps(earlier, later);
        // A backward step is a restart: nothing was lost.
        self.lost += u64::try_from(steps - 1).unwrap_or(0);
        self.period_us = match self.period_us {
            _ if steps <= 0 || us <= 0 => None,
            None => Some(us / steps),
            // The rate has changed; this is not jitter of the arm's timer.
            Some(period) if (us / steps - period).abs() > period / 2 => Some(us / steps),
            Some(period) => Some(period + (us / steps - period) / 4),
        };
    }

    /// Checks in the first sample after zeroing whether the axes are zeroed.
    fn zero(&mut self, sample: &Sample, reported: u8, counts: [i64; reading::AXES]) {
        let Some(Zeroed { axes, by_us }) = self.zeroed else { return };
        let since_us = i64::from(sample.t_us.wrapping_sub(by_us).cast_signed());
        if since_us < 0 {
            return;
        }
        self.zeroed = None;
        let moved = self.fastest * (since_us + ANSWER / 1000) / 1_000_000;
        let is_there = |axis: &usize| reported & 1 << axis != 0 && counts[*axis].abs() <= moved;
        let zeroed =
            (0..AXES).filter(|axis| axes & 1 << axis != 0).filter(is_there).fold(0, |all, axis| all | 1 << axis);
        self.homing.trust(zeroed);
        if zeroed != axes {
            let why = "the arm was told that it is at home and has not taken it: home it once more";
            self.homing.distrust(axes & !zeroed, why);
        }
    }

    /// Updates the reported problem from the status of the last reading.
    fn note(&mut self, overrun: bool, status: &Status) {
        let trouble = match status {
            Status::Ok if overrun => {
                "takes more samples than it can send: ask for fewer (arm.rate_hz), for blocks, or set a faster line (arm.baud)"
            }
            // The user chose bare numbers; the warning stays as long as they are in use.
            Status::Ok if self.bare => UNRELIABLE,
            status => self.homing.trouble(status),
        };
        if self.trouble != trouble {
            trouble.clone_into(&mut self.trouble);
        }
    }
}

/// Warning about bare numbers.
const UNRELIABLE: &str = "sent as bare numbers, without checksum, number and time: not to be relied on";

fn homed_of(flags: u16) -> u8 {
    (flags & 7) as u8
}

fn wide([a, b, c]: [i32; AXES]) -> [i64; reading::AXES] {
    [a.into(), b.into(), c.into(), 0, 0, 0]
}

fn blank(ticks: Option<u64>, at_ns: i64, counts: [i64; reading::AXES]) -> Counts {
    let stamp = Stamp { host_ns: Some(at_ns), ticks, ..Stamp::default() };
    Counts { stamp, first: 0, axes: AXES as u8, counts, homed: 0, buttons: 0, status: Status::Ok }
}

/// Returns the numbers and µs from one sample to another.
fn steps(earlier: &Sample, later: &Sample) -> (i64, i64) {
    let signed = |difference: u32| i64::from(difference.cast_signed());
    (signed(later.seq.wrapping_sub(earlier.seq)), signed(later.t_us.wrapping_sub(earlier.t_us)))
}

/// Relates two samples of an arm with the sample period `period_us`, if known.
fn between(earlier: &Sample, later: &Sample, period_us: Option<i64>, zeroed: Option<Zeroed>) -> Between {
    let (steps, us) = steps(earlier, later);
    if steps <= 0 || us <= 0 {
        return Between::Anew;
    }
    let is_past = |by_us: u32, sample: &Sample| sample.t_us.wrapping_sub(by_us).cast_signed() >= 0;
    let zeroing = zeroed.filter(|zeroed| is_past(zeroed.by_us, later) && !is_past(zeroed.by_us, earlier));
    // An index mark passed.
    let marked = homed_of(later.flags) & !homed_of(earlier.flags);
    // Number and time must advance together, or one of them is corrupted. The arm's timer may
    // restart when the arm is zeroed.
    let expected =
        zeroing.is_some() || period_us.is_none_or(|period| (us - steps * period).abs() <= period / 2 + us / 8);
    Between::Later { ns: us * 1000, set: zeroing.map_or(0, |zeroed| zeroed.axes) | marked, expected }
}

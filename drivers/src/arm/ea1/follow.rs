//! From samples to readings: which are believed, which axes are at home, what was lost.
//!
//! Where an arm is at home is the arm's to say: by its flags, as its index marks go by or as it is told by `!Z`. What happens on the way is read from what the arm sends
//! and from nothing else, so that a recording's bytes make the same readings: the answer to a time ping behind a `!Z` names the axes that were zeroed, since the arm
//! sends a ping's number back as it came.

use std::collections::VecDeque;

use super::{AXES, Command, Framing, Record, Sample, flag};
use crate::arm::Settings;
use crate::arm::homing::{Between, Homing, Passed};
use crate::clock::{MS, SECOND};
use crate::reading::{self, Counts, Reading, Stamp, Status};

/// What an answer to a ping may take, ns.
const ANSWER: i64 = 300 * MS;
/// Between two time pings, ns.
const PING: i64 = SECOND;
/// A ping that is not answered is sent so often.
const TRIES: u8 = 3;
/// In a ping's number, the axes that were zeroed just before it stand above so many bits.
const ZEROED: u32 = 29;

/// A reading before it is told whether it is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Taken {
    sample: Sample,
    at_ns: i64,
}

/// A question for the arm's time that is not answered yet.
#[derive(Debug, Clone, Copy)]
struct Ping {
    token: u32,
    sent_ns: i64,
    tries: u8,
}

/// Axes that were zeroed before the arm's time was so many µs.
#[derive(Debug, Clone, Copy)]
struct Zeroed {
    axes: u8,
    by_us: u32,
}

/// What is known of an arm that sends samples.
#[derive(Debug)]
pub(super) struct Follower {
    fastest: i64,
    /// Bare numbers are all that there is.
    bare: bool,
    homing: Homing<Taken>,
    zeroed: Option<Zeroed>,
    /// To be zeroed when there is time to send it.
    to_zero: u8,
    ping: Option<Ping>,
    pings: u32,
    next_ping_ns: i64,
    round_trip_ns: Option<i64>,
    /// The arm has started anew while it was listened to.
    restarted: bool,
    last: Option<Sample>,
    /// Between two samples, µs, as it was lately.
    period_us: Option<i64>,
    /// By the samples' numbers.
    lost: u64,
    refused: u64,
    trouble: String,
    /// Samples since the last one that others were left out before.
    since_overrun: u32,
}

/// An overrun is spoken of for so many samples.
const SPOKEN_OF: u32 = 100;

impl Follower {
    pub(super) fn new(settings: &Settings, bare: bool) -> Self {
        // Bare numbers have the host's time, which comes in packets.
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
            since_overrun: SPOKEN_OF,
        }
    }

    /// Nothing is known, and the arm may be another one.
    pub(super) fn restart(&mut self) {
        // Otherwise what is at home is the arm's to say.
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

    /// Readings lost and readings refused.
    pub(super) fn losses(&self) -> [u64; 2] {
        [self.lost, self.refused]
    }

    pub(super) fn trouble(&self) -> &str {
        &self.trouble
    }

    /// Whether the arm has started anew since this was asked last: it sends nothing until it is told to.
    pub(super) fn has_restarted(&mut self) -> bool {
        std::mem::take(&mut self.restarted)
    }

    /// Adds what there is to be sent now.
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

    /// What the arm has sent.
    pub(super) fn take(&mut self, record: &Record<'_>, at_ns: i64, found: &mut VecDeque<Reading>) {
        match *record {
            Record::Sample(sample) => {
                let (period_us, zeroed) = (self.period_us, self.zeroed);
                let passed = self.homing.take(Taken { sample, at_ns }, wide(sample.counts), |earlier, later| {
                    between(&earlier.sample, &later.sample, period_us, zeroed)
                });
                self.pass(passed, found);
            }
            Record::Unreliable(counts) => self.take_bare(counts, at_ns, found),
            Record::Time { token, t_us } => self.answered(token, t_us, at_ns),
            Record::Identity(_) => self.restarted = true,
            Record::Error(code) => tracing::debug!("the arm answers with error {code}"),
        }
    }

    /// The answer to a ping.
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

    /// What one more sample comes to.
    fn pass(&mut self, passed: Passed<Taken>, found: &mut VecDeque<Reading>) {
        self.refused += passed.refused;
        let jumped = passed.held.is_some();
        for (Taken { sample, at_ns }, counts) in [passed.held, passed.this].into_iter().flatten() {
            if let Some(last) = self.last.replace(sample) {
                self.count(&last, &sample);
            }
            let says = homed_of(sample.flags);
            let fault = (sample.flags / flag::FAULT[0]) as u8 & self.homing.all();
            // What the arm does not know itself is known when the arm knows it.
            self.homing.trust(!says & self.homing.all());
            self.zero(&sample, says, counts);
            let homed = says & self.homing.homed() & !fault;
            if homed == self.homing.all() {
                self.homing.settle();
            }
            let mut status = self.homing.status(homed, fault);
            if jumped && status != Status::Ok && !self.homing.why().is_empty() {
                status = Status::Other(self.homing.why().to_owned().into());
            }
            let is_overrun = sample.flags & flag::OVERRUN != 0;
            self.since_overrun = if is_overrun { 0 } else { self.since_overrun.saturating_add(1) };
            self.note(self.since_overrun < SPOKEN_OF, &status);
            let ticks = Some(u64::from(sample.t_us));
            let counts = Counts { homed, buttons: sample.buttons, status, ..blank(ticks, at_ns, counts) };
            found.push_back(Reading::Counts(counts));
        }
    }

    /// Bare numbers, by the host's time.
    fn take_bare(&mut self, shown: [i32; AXES], at_ns: i64, found: &mut VecDeque<Reading>) {
        let sample = Sample { seq: 0, t_us: 0, counts: shown, flags: 0, buttons: 0, framing: Framing::Lines };
        let passed = self.homing.take(Taken { sample, at_ns }, wide(shown), |earlier, later| Between::Later {
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

    /// What lies between two samples that are believed.
    fn count(&mut self, earlier: &Sample, later: &Sample) {
        let (steps, us) = steps(earlier, later);
        // Backwards is a beginning: nothing was lost.
        self.lost += u64::try_from(steps - 1).unwrap_or(0);
        self.period_us = match self.period_us {
            _ if steps <= 0 || us <= 0 => None,
            None => Some(us / steps),
            // Another rate, and not what the arm's timer is late by.
            Some(period) if (us / steps - period).abs() > period / 2 => Some(us / steps),
            Some(period) => Some(period + (us / steps - period) / 4),
        };
    }

    /// The first sample after axes were zeroed: whether they are.
    fn zero(&mut self, sample: &Sample, says: u8, counts: [i64; reading::AXES]) {
        let Some(Zeroed { axes, by_us }) = self.zeroed else { return };
        let since_us = i64::from(sample.t_us.wrapping_sub(by_us).cast_signed());
        if since_us < 0 {
            return;
        }
        self.zeroed = None;
        let moved = self.fastest * (since_us + ANSWER / 1000) / 1_000_000;
        let is_there = |axis: &usize| says & 1 << axis != 0 && counts[*axis].abs() <= moved;
        let zeroed =
            (0..AXES).filter(|axis| axes & 1 << axis != 0).filter(is_there).fold(0, |all, axis| all | 1 << axis);
        self.homing.trust(zeroed);
        if zeroed != axes {
            let why = "the arm was told that it is at home and has not taken it: home it once more";
            self.homing.distrust(axes & !zeroed, why);
        }
    }

    /// What is the matter with an arm whose last reading had this status.
    fn note(&mut self, overrun: bool, status: &Status) {
        let trouble = match status {
            Status::Other(why) if self.homing.why().is_empty() => why,
            Status::Other(_) => self.homing.why(),
            Status::Ok if overrun => {
                "takes more samples than it can send: ask for fewer (arm.rate_hz), for blocks, or set a faster line (arm.baud)"
            }
            // Who has asked for bare numbers uses them, and is told of what they are as long as he does.
            Status::Ok if self.bare => UNRELIABLE,
            Status::Ok => "",
        };
        if self.trouble != trouble {
            trouble.clone_into(&mut self.trouble);
        }
    }
}

/// What is said of bare numbers.
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

/// Numbers and µs from one sample to another.
fn steps(earlier: &Sample, later: &Sample) -> (i64, i64) {
    let signed = |difference: u32| i64::from(difference.cast_signed());
    (signed(later.seq.wrapping_sub(earlier.seq)), signed(later.t_us.wrapping_sub(earlier.t_us)))
}

/// What lies between two samples of an arm that takes one every `period_us`, as far as that is known.
fn between(earlier: &Sample, later: &Sample, period_us: Option<i64>, zeroed: Option<Zeroed>) -> Between {
    let (steps, us) = steps(earlier, later);
    if steps <= 0 || us <= 0 {
        return Between::Anew;
    }
    let is_past = |by_us: u32, sample: &Sample| sample.t_us.wrapping_sub(by_us).cast_signed() >= 0;
    let told = zeroed.filter(|zeroed| is_past(zeroed.by_us, later) && !is_past(zeroed.by_us, earlier));
    // An index mark went by.
    let met = homed_of(later.flags) & !homed_of(earlier.flags);
    // Number and time go together, or one of them is damaged; but the timer of an arm may begin anew when it is zeroed.
    let expected = told.is_some() || period_us.is_none_or(|period| (us - steps * period).abs() <= period / 2 + us / 8);
    Between::Later { ns: us * 1000, set: told.map_or(0, |zeroed| zeroed.axes) | met, expected }
}

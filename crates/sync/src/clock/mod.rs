//! Computes measurement times in host ns from a device's ticks and the host's receive times.
//!
//! Data is received later than it was measured: by a known delay (the wire, the sampling, the
//! calibrated latency), and by a random delay that is never negative, mostly small and at times
//! large. Therefore the clock is the lower envelope of the receive times (`envelope`). A sample
//! that arrives late is not a late measurement: its ticks give its time.
//!
//! - `settings`: a clock's knowledge of its device.
//! - `hull`, `envelope`: the line under a window of samples, and its error bound.
//! - `infer`: the measurement number of a record if the device does not send it.
//! - `rate`: the duration of a tick if the device does not give it, or may give a wrong one.
//! - `mapping`: the clock as it is published and recorded: integers that give the same times
//!   bit for bit.
//! - `flags`: flags of a time.
//! - `publish`: when the clock is published, and the times that follow from it.
//! - `watch`: the clock's reliability, from the times of timely samples.
//!
//! Everything is driven by pushed samples and given times; nothing here reads a system clock.
//! No sample is discarded because its times disagree: it is flagged, and its bound includes the
//! disagreement. After the first seconds nothing is allocated.
//!
//! A constant delay cannot be observed. It is `latency_ns`, which is calibrated. The bound is
//! statistical, not strict: it assumes that delays come near their minimum every few seconds.

mod envelope;
mod flags;
mod hull;
mod infer;
mod mapping;
mod publish;
mod rate;
mod settings;
#[cfg(test)]
pub(crate) mod simulation;
#[cfg(test)]
mod tests;
mod watch;

use serde::{Deserialize, Serialize};

use sonoweave_core::Ticks;

pub use envelope::Work;
use envelope::{Change, Envelope, Line, UNKNOWN_NS};
pub use flags::TimeFlags;
use hull::Point;
use infer::Inference;
use mapping::clamped;
pub use mapping::{Basis, Mapping, State};
pub use publish::{PUBLISHED_EVERY_NS, PUBLISHED_NS};
pub use settings::ClockSettings;
use watch::Watch;

/// Number of samples from which an unknown rate is determined.
const BOOTSTRAP: usize = 16;
/// Samples later than this are flagged, ns. Known slow adapters that are left alone collect for
/// 16 ms.
pub const LATE_NS: i64 = 20_000_000;
/// Samples earlier than this, beyond the clock's own bound, are not explained by delay, ns.
const EARLY_NS: i64 = 2_000_000;
/// Samples later than this are not explained by delay either, ns.
const FAR_NS: i64 = 2_000_000_000;
/// Number of consecutive samples that disagree with the clock, and agree with each other, until
/// they begin a new epoch.
const CONFIRMED: usize = 3;
/// The same for samples that disagree only in their order, since some devices send out of
/// order.
const CONFIRMED_ORDER: usize = 8;
/// Largest disagreement among themselves, ns.
const AGREE_NS: i64 = 250_000_000;
/// Silence after which the count of a device without ticks restarts, ns: it may have been
/// switched off.
const UNCOUNTED_NS: i64 = 1_000_000_000;

/// Time of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Timed {
    /// Host ns.
    pub time_ns: i64,
    /// Bound on the error of the time, ns.
    pub bound_ns: i64,
    /// The basis of the time.
    pub basis: Basis,
    /// Number of the publication used: its [`Mapping::time`] of the basis is `time_ns`.
    pub mapping: u64,
    /// Flags of the time.
    pub flags: TimeFlags,
    /// Measurements missing before it, by the device's count or by the gap; negative if
    /// measurements reported missing have arrived.
    pub missing: i64,
}

/// The start of an epoch, where x and z are 0.
#[derive(Debug, Clone, Copy)]
struct Origin {
    tick: i64,
    time_ns: i64,
    /// Nominal time from tick to tick, in 2⁻³² ns.
    period_q32: i64,
}

/// A sample: its tick, and its time minus the known delays.
type Sample = (i64, i64);

/// The clock of a device, or of one of its independently counting streams.
#[derive(Debug)]
pub struct ClockMap {
    settings: ClockSettings,
    origin: Option<Origin>,
    /// Samples that wait until the rate is known.
    waiting: Vec<Sample>,
    /// Rate seen in samples before those: ns from tick to tick, and the time since which it
    /// holds.
    seen: Option<(f64, i64)>,
    envelope: Envelope,
    inference: Inference,
    /// The newest tick that follows from earlier ones, and its time.
    last: Option<Sample>,
    /// Consecutive samples that disagree with the clock.
    suspects: Vec<Sample>,
    watch: Watch,
    epoch: u32,
    mapping: Mapping,
    published: Option<Mapping>,
}

impl ClockMap {
    /// Returns a clock that has received nothing.
    pub fn new(settings: ClockSettings) -> Self {
        let limit = limit_ppb(settings.slope_ppm);
        let mapping = Mapping {
            number: 0,
            epoch: 0,
            state: State::Acquiring,
            published_ns: 0,
            tick: 0,
            time_ns: 0,
            ns_per_tick_q32: 0,
            drift_ppb: 0,
            bound_ns: UNKNOWN_NS,
            bound_until_ns: i64::MAX,
            growth_ppb: 0,
            delay_ns: settings.delay_ns,
        };
        Self {
            settings,
            origin: None,
            waiting: Vec::with_capacity(BOOTSTRAP),
            seen: None,
            envelope: Envelope::new(limit),
            inference: Inference::default(),
            last: None,
            suspects: Vec::with_capacity(CONFIRMED_ORDER),
            watch: Watch::default(),
            epoch: 0,
            mapping,
            published: Some(mapping),
        }
    }

    /// The clock's settings.
    pub fn settings(&self) -> &ClockSettings {
        &self.settings
    }

    /// The last published clock.
    pub fn mapping(&self) -> &Mapping {
        &self.mapping
    }

    /// Returns the last published clock if it was not taken yet. Call after each push or
    /// advance, and record it. One call publishes at most once.
    pub fn take_published(&mut self) -> Option<Mapping> {
        self.published.take()
    }

    /// Reliability of the clock.
    pub fn state(&self) -> State {
        self.mapping.state
    }

    /// Work done so far.
    pub fn work(&self) -> Work {
        self.envelope.work()
    }

    /// Begins an epoch: the device was set up anew, and may count from any value.
    pub fn restart(&mut self) {
        let limit = limit_ppb(self.settings.slope_ppm);
        self.begin(limit);
    }

    fn begin(&mut self, limit_ppb: i64) {
        self.epoch += 1;
        self.origin = None;
        self.waiting.clear();
        self.seen = None;
        self.envelope.clear(limit_ppb);
        self.inference = Inference::default();
        self.last = None;
        self.suspects.clear();
        self.watch.begin();
    }

    /// Handles elapsed time without samples: the state may change and be published.
    pub fn advance(&mut self, now_ns: i64) -> State {
        self.watch.pass(now_ns.saturating_sub(self.settings.delay_ns));
        self.publish(now_ns, false);
        self.mapping.state
    }

    /// Adds a sample, by its time of receipt and its raw ticks, and returns its measurement
    /// time.
    pub fn push(&mut self, host_ns: i64, ticks: Option<u64>) -> Timed {
        let time_ns = host_ns.saturating_sub(self.settings.delay_ns);
        match (self.settings.ticks, ticks) {
            (Ticks::None, _) => self.push_uncounted(host_ns, time_ns),
            (_, Some(ticks)) => self.push_counted(host_ns, time_ns, ticks),
            // A record without ticks from a device that sends them.
            (_, None) => self.received(host_ns, UNKNOWN_NS, TimeFlags::NONE),
        }
    }

    fn push_counted(&mut self, host_ns: i64, time_ns: i64, ticks: u64) -> Timed {
        let tick = self.unwrap(time_ns, ticks);
        if self.origin.is_none() && !self.know_rate((tick, time_ns)) {
            return self.received(host_ns, UNKNOWN_NS, TimeFlags::NONE);
        }
        let Some(last) = self.last else {
            self.enter(host_ns, (tick, time_ns));
            return self.timed(host_ns, tick, TimeFlags::NONE, 0, 0);
        };
        let late = self.lateness((tick, time_ns));
        let is_early = late < -self.allowance();
        let is_back = tick < last.0;
        if is_early || late > FAR_NS || is_back {
            let mut flags = TimeFlags::STEP;
            if is_early {
                flags |= TimeFlags::EARLY;
            } else if is_back && late <= FAR_NS {
                flags = TimeFlags::OUT_OF_ORDER;
            }
            let needed = if flags == TimeFlags::OUT_OF_ORDER { CONFIRMED_ORDER } else { CONFIRMED };
            if self.suspect(host_ns, (tick, time_ns), late, needed) {
                return self.timed(host_ns, tick, TimeFlags::STEP, 0, 0);
            }
            if flags == TimeFlags::OUT_OF_ORDER {
                self.publish(host_ns, false);
                // Its ticks may also be those of a device that was set back by as much as the
                // sample is late.
                return self.timed(host_ns, tick, flags, late.max(0), 0);
            }
            let bound = if is_early { late.saturating_abs().saturating_add(self.doubt(time_ns)) } else { UNKNOWN_NS };
            return self.received(host_ns, bound, flags);
        }
        self.suspects.clear();
        let mut flags = TimeFlags::NONE;
        let mut missing = 0;
        if tick == last.0 {
            flags |= TimeFlags::REPEATED;
        } else if self.settings.ticks == Ticks::Measurements && tick > last.0 + 1 {
            flags |= TimeFlags::GAP;
            missing = tick.saturating_sub(last.0) - 1;
        }
        if self.enter(host_ns, (tick, time_ns)) {
            flags |= TimeFlags::STEP;
        }
        self.timed(host_ns, tick, flags, 0, missing)
    }

    fn push_uncounted(&mut self, host_ns: i64, time_ns: i64) -> Timed {
        if let Some((_, last_ns)) = self.last
            && time_ns.saturating_sub(last_ns) > UNCOUNTED_NS
        {
            let limit = self.envelope.limit_ppb();
            self.begin(limit);
        }
        if self.origin.is_none() {
            let tick = self.waiting.len() as i64;
            self.last = Some((tick, time_ns));
            if !self.know_rate((tick, time_ns)) {
                return self.received(host_ns, UNKNOWN_NS, TimeFlags::INFERRED);
            }
            // Waiting samples are counted now that the period is known.
            let waiting = std::mem::take(&mut self.waiting);
            for (_, time_ns) in &waiting {
                let inferred = self.count(*time_ns);
                if !inferred.in_doubt {
                    self.fit((inferred.tick, *time_ns));
                }
            }
            self.waiting = waiting;
            self.publish(host_ns, true);
            let tick = self.inference.last().map_or(0, |last| last.0);
            return self.timed(host_ns, tick, TimeFlags::INFERRED, 0, 0);
        }
        let late = self.inference.last().map_or(0, |(last, _)| self.lateness((last + 1, time_ns)));
        let inferred = self.count(time_ns);
        let mut flags = TimeFlags::INFERRED;
        if inferred.impossible {
            flags |= TimeFlags::EARLY | TimeFlags::STEP;
            if self.suspect(host_ns, (inferred.tick, time_ns), late, CONFIRMED) {
                return self.received(host_ns, UNKNOWN_NS, flags);
            }
            let bound = late.saturating_abs().saturating_add(self.doubt(time_ns));
            return self.received(host_ns, bound, flags);
        }
        self.suspects.clear();
        if inferred.hopeless {
            // Another period explains it; the next records will give it.
            let limit = self.envelope.limit_ppb();
            self.begin(limit);
            return self.received(host_ns, UNKNOWN_NS, flags | TimeFlags::STEP);
        }
        if inferred.repeated {
            flags |= TimeFlags::REPEATED;
        } else if inferred.missing > 0 {
            flags |= TimeFlags::GAP;
        }
        if inferred.in_doubt {
            self.last = Some((inferred.tick, time_ns));
            self.watch.sample(time_ns, late.max(0), &self.envelope.doubt());
            self.publish(host_ns, false);
        } else if self.enter(host_ns, (inferred.tick, time_ns)) {
            flags |= TimeFlags::STEP;
        }
        let open_ns = inferred.open.saturating_mul(self.period_ns());
        self.timed(host_ns, inferred.tick, flags, open_ns, inferred.missing)
    }

    fn count(&mut self, time_ns: i64) -> infer::Inferred {
        let (period, origin, line) = (self.period_ns(), self.origin, self.envelope.line().copied());
        let within = self.envelope.doubt().bound_ns.saturating_add(EARLY_NS);
        self.inference.record(time_ns, period, within, |tick| expected(origin, line.as_ref(), tick))
    }

    /// Actual time from tick to tick, ns.
    fn period_ns(&self) -> i64 {
        (self.rate_q32() + (1 << 31)) >> 32
    }

    fn rate_q32(&self) -> i64 {
        let nominal = self.origin.map_or(0, |origin| origin.period_q32);
        let drift = self.envelope.line().map_or(0.0, Line::slope);
        nominal + (nominal as f64 * drift).round() as i64
    }

    /// Unwraps ticks: chooses, among the counts with the same raw value, the one closest to the
    /// time.
    fn unwrap(&self, time_ns: i64, ticks: u64) -> i64 {
        let ticks = i128::from(ticks);
        let (Some(wraps), Some((last, last_ns))) = (self.settings.wraps_at.map(i128::from), self.last) else {
            return clamped(ticks);
        };
        let rate = self.rate_q32();
        let passed = if rate > 0 {
            ((i128::from(time_ns) - i128::from(last_ns)) << 32) / i128::from(rate)
        } else {
            // Unknown rate: the count nearest to the last one is used.
            0
        };
        let about = i128::from(last) + passed;
        clamped(ticks + (about - ticks + wraps / 2).div_euclid(wraps) * wraps)
    }

    fn point(&self, (tick, time_ns): Sample) -> Option<Point> {
        let origin = self.origin?;
        let x = ((i128::from(tick) - i128::from(origin.tick)) * i128::from(origin.period_q32)) >> 32;
        let z = i128::from(time_ns) - i128::from(origin.time_ns) - x;
        // Half of i64's range, so that differences fit.
        let fits = |wide: &i128| wide.unsigned_abs() < 1 << 62;
        (fits(&x) && fits(&z)).then_some(Point { x: clamped(x), z: clamped(z) })
    }

    /// Delay of a sample relative to the clock's line, ns.
    fn lateness(&self, sample: Sample) -> i64 {
        match (self.point(sample), self.envelope.line()) {
            (Some(point), Some(line)) => line.below(point),
            // Beyond the range of the clock.
            (None, _) => i64::MAX,
            (_, None) => 0,
        }
    }

    /// Tolerance for early samples before they are suspected, ns.
    fn allowance(&self) -> i64 {
        let doubt = self.envelope.doubt();
        let known = if doubt.spread_ns < UNKNOWN_NS { 3 * doubt.spread_ns } else { self.watch.latest_ns() };
        EARLY_NS.saturating_add(known)
    }

    /// The clock's own bound at a time, ns.
    fn doubt(&self, time_ns: i64) -> i64 {
        self.mapping.bound(time_ns).min(UNKNOWN_NS)
    }

    /// Notes a sample that disagrees; returns whether an epoch begins with the noted samples.
    fn suspect(&mut self, host_ns: i64, sample: Sample, late: i64, needed: usize) -> bool {
        let agrees = |other: &Sample| {
            let other_late = self.lateness(*other);
            other.0 <= sample.0 && late.abs_diff(other_late) < AGREE_NS.unsigned_abs()
        };
        if !self.suspects.last().is_none_or(agrees) || self.suspects.len() == CONFIRMED_ORDER {
            self.suspects.clear();
        }
        self.suspects.push(sample);
        if self.suspects.len() < needed {
            return false;
        }
        let suspects = std::mem::take(&mut self.suspects);
        self.restart();
        if self.settings.ticks != Ticks::None {
            for suspect in &suspects {
                if self.origin.is_some() || self.know_rate(*suspect) {
                    self.fit(*suspect);
                }
            }
            self.publish(host_ns, true);
        }
        self.suspects = suspects;
        self.suspects.clear();
        self.origin.is_some() || self.settings.ticks == Ticks::None
    }

    /// Adds a sample to the fit and publishes the result. Returns whether an epoch begins with
    /// it.
    fn enter(&mut self, host_ns: i64, sample: Sample) -> bool {
        let change = self.fit(sample);
        self.publish(host_ns, change != Change::None);
        change == Change::Shift
    }

    fn fit(&mut self, sample: Sample) -> Change {
        let Some(point) = self.point(sample) else { return Change::None };
        let late = self.envelope.line().map_or(0, |line| line.below(point));
        if self.last.is_none_or(|last| last.0 <= sample.0) {
            self.last = Some(sample);
        }
        let change = self.envelope.insert(point);
        self.watch.sample(sample.1, late, &self.envelope.doubt());
        self.epoch += u32::from(change == Change::Shift);
        change
    }
}

/// Receive time of a tick's sample without random delay, minus the known delays, host ns.
fn expected(origin: Option<Origin>, line: Option<&Line>, tick: i64) -> i64 {
    let Some(origin) = origin else { return 0 };
    let x = clamped(((i128::from(tick) - i128::from(origin.tick)) * i128::from(origin.period_q32)) >> 32);
    let z = line.map_or(0, |line| line.at(x));
    origin.time_ns.saturating_add(x).saturating_add(z)
}

fn limit_ppb(ppm: f64) -> i64 {
    (ppm.clamp(1.0, settings::UNKNOWN_PPM) * 1000.0).round() as i64
}

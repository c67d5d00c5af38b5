//! Simulated devices with known ground truth, for tests: measurement times, counts and receive
//! times.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use sonoweave_core::{Ticks, Timing};

use super::{ClockMap, ClockSettings, Mapping, State, Timed};

pub(super) const MS: i64 = 1_000_000;
pub(super) const SECOND: i64 = 1_000 * MS;

/// Random numbers with the same bits on every machine.
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn exponential(&mut self, mean: f64) -> f64 {
        -mean * libm::log(1.0 - self.unit())
    }

    /// Standard normal, by Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }
}

/// Random delay beyond the known one.
#[derive(Debug, Clone, Copy)]
pub(super) enum Jitter {
    None,
    /// Uniform from 0 to this, ns.
    Uniform(i64),
    /// Exponential, mostly small: of this mean, ns.
    Exponential(i64),
    /// Forwarded only at multiples of this time, ns.
    Packets(i64),
    /// Exponential of this mean; in this fraction of seconds everything is held back for 200 ms
    /// and arrives at once.
    Stalls(i64, f64),
    /// Exponential of this mean; in this fraction of seconds everything is 200 ms late for half
    /// a second. Two such seconds are at least two seconds apart.
    Late(i64, f64),
}

/// A device.
#[derive(Debug, Clone, Copy)]
pub(super) struct Device {
    pub(super) seed: u64,
    pub(super) ticks: Ticks,
    pub(super) hz: f64,
    /// Ticks per second if they are of time.
    pub(super) tick_hz: f64,
    pub(super) drift_ppm: f64,
    /// Amplitude of the rate's variation within a minute, ppm.
    pub(super) wander_ppm: f64,
    pub(super) jitter: Jitter,
    /// Fraction of measurements that are not sent.
    pub(super) loss: f64,
    pub(super) wraps_at: Option<u64>,
    pub(super) first_tick: u64,
    /// Whether the clock is given the rate.
    pub(super) stated: bool,
}

/// Known delay.
pub(super) const DELAY_NS: i64 = 8 * MS;

impl Device {
    pub(super) const LIBERTY: Self = Self {
        seed: 1,
        ticks: Ticks::Measurements,
        hz: 240.0,
        tick_hz: 240.0,
        drift_ppm: 80.0,
        wander_ppm: 0.5,
        jitter: Jitter::Exponential(MS),
        loss: 0.001,
        wraps_at: Some(1 << 32),
        first_tick: 1000,
        stated: true,
    };
    pub(super) const FASTRAK: Self =
        Self { ticks: Ticks::None, hz: 60.0, tick_hz: 60.0, wraps_at: None, first_tick: 0, ..Self::LIBERTY };
    pub(super) const EA1: Self = Self { ticks: Ticks::Time, hz: 100.0, tick_hz: 1e6, ..Self::LIBERTY };
    pub(super) const GRABBER: Self = Self { hz: 29.97, tick_hz: 30.0, first_tick: 0, ..Self::LIBERTY };

    pub(super) fn settings(&self) -> ClockSettings {
        let timing = Timing {
            ticks: self.ticks,
            tick_hz: (self.stated && self.ticks != Ticks::None).then_some(self.tick_hz),
            wraps_at: self.wraps_at,
            rate_hz: self.stated.then_some(self.tick_hz),
            sampling_ns: DELAY_NS / 2,
            wire_ns: DELAY_NS / 4,
        };
        let settings = ClockSettings::new(&timing, DELAY_NS / 4);
        // A grabber's actual rate differs from the nominal one.
        if self.hz != self.tick_hz && self.ticks == Ticks::Measurements {
            return ClockSettings::video(&timing, DELAY_NS / 4);
        }
        settings
    }

    /// Samples sent in this many seconds.
    pub(super) fn samples(&self, seconds: i64) -> Vec<Sample> {
        let mut draws = Draws::new(self.seed);
        let mut samples = Vec::new();
        let [mut held_until, mut late_until, mut second, mut before] = [0_i64; 4];
        for n in 0..(seconds as f64 * self.hz) as i64 {
            let at = n as f64 / self.hz;
            let slow = 1.0 + self.drift_ppm * 1e-6;
            let turn = std::f64::consts::TAU / 60.0;
            let wander = self.wander_ppm * 1e-6 / turn * (1.0 - libm::cos(turn * at));
            let true_ns = 3 * SECOND + ((at * slow + wander) * 1e9).round() as i64;
            if true_ns / SECOND > second && second > 0 {
                let hit = draws.unit();
                match self.jitter {
                    Jitter::Stalls(_, share) if hit < share => held_until = true_ns + 200 * MS,
                    Jitter::Late(_, share) if hit < share && late_until + 2 * SECOND < true_ns => {
                        late_until = true_ns + 500 * MS
                    }
                    _ => {}
                }
            }
            second = true_ns / SECOND;
            let sent = true_ns + DELAY_NS;
            let random = match self.jitter {
                Jitter::None => 0.0,
                Jitter::Uniform(most) => draws.unit() * most as f64,
                Jitter::Exponential(mean) | Jitter::Stalls(mean, _) | Jitter::Late(mean, _) => {
                    draws.exponential(mean as f64)
                }
                Jitter::Packets(every) => (every - sent.rem_euclid(every)) as f64,
            };
            let mut host_ns = (sent + random as i64).max(held_until);
            if true_ns < late_until {
                host_ns += 200 * MS;
            }
            // Order is kept.
            host_ns = host_ns.max(before);
            before = host_ns;
            let lost = draws.unit() < self.loss;
            if lost {
                continue;
            }
            let count = self.first_tick.wrapping_add((n as f64 / self.hz * self.tick_of()).round() as u64);
            let ticks = (self.ticks != Ticks::None).then(|| self.wraps_at.map_or(count, |at| count % at));
            samples.push(Sample { true_ns, host_ns, ticks });
        }
        samples
    }

    fn tick_of(&self) -> f64 {
        if self.ticks == Ticks::Time { self.tick_hz } else { self.hz }
    }
}

/// A sample with its true measurement time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) true_ns: i64,
    pub(super) host_ns: i64,
    pub(super) ticks: Option<u64>,
}

/// Output of a clock for samples.
pub(super) struct Run {
    pub(super) clock: ClockMap,
    pub(super) mappings: Vec<Mapping>,
    pub(super) timed: Vec<(Sample, Timed, State)>,
}

impl Run {
    pub(super) fn of(settings: ClockSettings, samples: &[Sample]) -> Self {
        let mut clock = ClockMap::new(settings);
        let mut mappings: Vec<Mapping> = clock.take_published().into_iter().collect();
        let timed = samples
            .iter()
            .map(|sample| {
                let timed = clock.push(sample.host_ns, sample.ticks);
                mappings.extend(clock.take_published());
                (*sample, timed, clock.state())
            })
            .collect();
        Self { clock, mappings, timed }
    }

    /// Number of samples in a state, and of those whose error is within the bound.
    pub(super) fn within(&self, state: State) -> [usize; 2] {
        let of = self.timed.iter().filter(|(_, _, at)| *at == state);
        let honest = of.clone().filter(|(sample, timed, _)| (timed.time_ns - sample.true_ns).abs() <= timed.bound_ns);
        [of.count(), honest.count()]
    }

    /// Error in a state: root mean square and mean, ms, and the mean bound, ms.
    pub(super) fn errors_ms(&self, state: State) -> [f64; 3] {
        let of: Vec<_> = self.timed.iter().filter(|(_, _, at)| *at == state).collect();
        let count = of.len() as f64;
        let error = |(sample, timed, _): &(Sample, Timed, State)| (timed.time_ns - sample.true_ns) as f64 * 1e-6;
        let square = of.iter().map(|each| error(each).powi(2)).sum::<f64>();
        let sum = of.iter().map(|each| error(each)).sum::<f64>();
        let bound = of.iter().map(|(_, timed, _)| timed.bound_ns as f64 * 1e-6).sum::<f64>();
        [(square / count).sqrt(), sum / count, bound / count]
    }
}

//! The line of a virtual device: bytes to the host take time, and may be corrupted or lost.

use std::collections::VecDeque;

use sonoweave_core::clock::SECOND;

use super::{Faults, Tally};

/// Bits of a byte: one start, eight data, one stop.
const BITS: i64 = 10;
/// Bits per second of USB: bytes arrive at once.
const USB: u32 = 480_000_000;

/// A device's line: its state, and the bytes in transit to the host.
#[derive(Debug)]
pub struct Wire {
    /// The device's rate, bits per second.
    pub baud: u32,
    /// The device is on USB, which has no rate.
    pub usb: bool,
    /// The device has power and is plugged in.
    pub plugged: bool,
    /// The device stays silent, like a program that hangs.
    pub hung: bool,
    /// Commands obeyed so far, as bytes.
    pub obeyed: Vec<Vec<u8>>,
    faults: Faults,
    random: fastrand::Rng,
    /// Arrival time of each piece, in order.
    on_the_way: VecDeque<(i64, Vec<u8>)>,
    /// Time at which the last byte put on the wire has left the device.
    busy_until: i64,
    /// Arrival time of the last piece, which later pieces do not overtake.
    last_ns: i64,
    tally: Tally,
}

impl Wire {
    /// Creates the idle line of a device at this rate.
    pub fn new(baud: u32, faults: Faults) -> Self {
        let random = fastrand::Rng::with_seed(faults.seed);
        Self {
            baud,
            usb: false,
            plugged: true,
            hung: false,
            obeyed: Vec::new(),
            faults,
            random,
            on_the_way: VecDeque::new(),
            busy_until: i64::MIN,
            last_ns: i64::MIN,
            tally: Tally::default(),
        }
    }

    /// Returns its faults.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// Replaces its faults.
    pub fn set_faults(&mut self, faults: Faults) {
        (self.faults, self.random) = (faults, fastrand::Rng::with_seed(faults.seed));
    }

    /// Returns the statistics of everything put on the wire.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Decides whether the device omits a record, and counts it.
    pub fn withholds(&mut self) -> bool {
        let withheld = self.chance(self.faults.dropout);
        self.tally.withheld += u64::from(withheld);
        withheld
    }

    /// Returns true in this share of calls.
    fn chance(&mut self, share: f64) -> bool {
        share > 0.0 && self.random.f64() < share
    }

    /// Returns whether all bytes put on the wire have left the device at that time.
    pub fn is_idle(&self, now_ns: i64) -> bool {
        self.busy_until <= now_ns
    }

    /// Returns whether the host's rate is another, so that neither understands the other. A rate
    /// of 0 is that of a pseudo-terminal, which has none.
    pub fn mistakes(&self, line_baud: u32) -> bool {
        !self.usb && line_baud != 0 && line_baud != self.baud
    }

    /// Puts bytes on the wire at `now_ns`, for a host that listens at `line_baud`. Returns whether
    /// they will arrive intact.
    pub fn send(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64) -> bool {
        let garbled = self.mistakes(line_baud);
        let baud = if self.usb { USB } else { self.baud };
        let begin = self.busy_until.max(now_ns);
        self.busy_until = begin + bytes.len() as i64 * BITS * SECOND / i64::from(baud);
        let mut there = Vec::with_capacity(bytes.len());
        self.tally.bytes += bytes.len() as u64;
        for byte in bytes {
            if self.chance(self.faults.drop) {
                self.tally.dropped += 1;
                continue;
            }
            let harmed = garbled || self.chance(self.faults.noise);
            self.tally.garbled += u64::from(harmed);
            there.push(if harmed { self.random.u8(..) } else { *byte });
        }
        let jitter = if self.faults.jitter_ns > 0 { self.random.i64(0..=self.faults.jitter_ns) } else { 0 };
        let mut at = self.busy_until + self.faults.latency_ns + jitter;
        if self.faults.packet_ns > 0 {
            at = at.div_euclid(self.faults.packet_ns) * self.faults.packet_ns + self.faults.packet_ns;
        }
        self.last_ns = self.last_ns.max(at);
        let whole = there == bytes;
        if !there.is_empty() {
            self.on_the_way.push_back((self.last_ns, there));
        }
        whole
    }

    /// Returns the arrival time of the next bytes.
    pub fn due(&self) -> Option<i64> {
        self.on_the_way.front().map(|(at, _)| *at)
    }

    /// Returns all bytes that have arrived at `now_ns`, and the arrival time of the last.
    pub fn receive(&mut self, now_ns: i64) -> Option<(i64, Vec<u8>)> {
        let mut taken: Option<(i64, Vec<u8>)> = None;
        while self.due().is_some_and(|at| at <= now_ns) {
            let Some((at, mut bytes)) = self.on_the_way.pop_front() else { break };
            match &mut taken {
                Some((last, all)) => {
                    *last = at;
                    all.append(&mut bytes);
                }
                None => taken = Some((at, bytes)),
            }
        }
        taken
    }

    /// Discards everything in transit.
    pub fn cut(&mut self) {
        self.on_the_way.clear();
        self.busy_until = i64::MIN;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::clock::MS;

    #[test]
    fn bytes_take_ten_bits_and_queue() {
        let mut wire = Wire::new(9600, Faults::default());
        wire.send(&[1, 2, 3], 9600, 0);
        wire.send(&[4], 9600, MS);
        assert_eq!(wire.due(), Some(3 * 10 * SECOND / 9600));
        assert!(!wire.is_idle(4 * MS) && wire.is_idle(5 * MS));
        assert_eq!(wire.receive(4 * MS).unwrap().1, [1, 2, 3]);
        assert_eq!(wire.receive(5 * MS).unwrap(), (3 * 10 * SECOND / 9600 + 10 * SECOND / 9600, vec![4]));
    }

    #[test]
    fn faults_match_their_shares_and_are_reproducible() {
        let faults = Faults { drop: 0.1, noise: 0.05, jitter_ns: MS, ..Faults::default() };
        let run = || {
            let mut wire = Wire::new(115_200, faults);
            let mut there = Vec::new();
            for n in 0..1000 {
                wire.send(&[0; 20], 115_200, n * 10 * MS);
            }
            let mut last = 0;
            while let Some(due) = wire.due() {
                assert!(due >= last, "nothing overtakes");
                last = due;
                there.extend(wire.receive(due).unwrap().1);
            }
            (there, wire.tally())
        };
        let (there, tally) = run();
        let lost = 20_000 - there.len();
        let harmed = there.iter().filter(|byte| **byte != 0).count();
        assert!((1800..2200).contains(&lost) && (750..1050).contains(&harmed), "{lost} {harmed}");
        assert_eq!((tally.bytes, tally.dropped), (20_000, lost as u64));
        // One of 256 garbled bytes is unchanged.
        assert!((harmed as u64..harmed as u64 + 30).contains(&tally.garbled), "{tally:?}");
        assert_eq!((there, tally), run());
    }

    #[test]
    fn packet_bytes_arrive_together() {
        let mut wire = Wire::new(115_200, Faults::slow_adapter());
        for n in 0..6 {
            wire.send(&[n], 115_200, i64::from(n) * 8 * MS);
        }
        assert_eq!(wire.receive(15 * MS), None);
        assert_eq!(wire.receive(16 * MS), Some((16 * MS, vec![0, 1])));
        assert_eq!(wire.receive(48 * MS), Some((48 * MS, vec![2, 3, 4, 5])));
    }
}

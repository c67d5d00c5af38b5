//! Counts the outcome of everything handed to a writer, and estimates the recording time left.

use std::collections::VecDeque;

use sonoweave_core::clock::SECOND;

use crate::session::about::Loss;

/// Message counts of a writer: `messages` = `stored` + `lost` + those waiting in memory.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Account {
    /// Messages handed to the writer.
    pub messages: u64,
    /// Messages written to the disk.
    pub stored: u64,
    /// Messages lost because neither the disk nor the memory had room.
    pub lost: u64,
    /// Size of the file, bytes.
    pub file_bytes: u64,
    /// Bytes waiting in memory.
    pub held_bytes: u64,
    /// Bytes of the file that survive a power cut.
    pub synced_bytes: u64,
    /// Hand-over time of the first message that may not survive one, ns.
    pub unsynced_since_ns: Option<i64>,
    /// Number of times that writing or syncing began to fail.
    pub failures: u64,
    /// Why nothing is written or synced now, as a sentence; empty if all is well.
    pub trouble: String,
}

/// Free space on a disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Free bytes.
    pub free_bytes: u64,
    /// Recent write rate, bytes per second; `None` before there are enough samples.
    pub bytes_per_s: Option<f64>,
}

impl Room {
    /// Returns the minutes until the disk is full, at the present rate.
    pub fn minutes(&self) -> Option<f64> {
        self.bytes_per_s.filter(|rate| *rate > 0.0).map(|rate| self.free_bytes as f64 / rate / 60.0)
    }
}

/// Time span of the present rate, ns.
const LATELY: i64 = 20 * SECOND;
/// Interval between two samples, ns.
const STEP: i64 = SECOND;

/// Growth rate of a file.
#[derive(Debug, Default)]
pub(super) struct Rate(VecDeque<(i64, u64)>);

impl Rate {
    pub(super) fn note(&mut self, now_ns: i64, bytes: u64) {
        if self.0.back().is_some_and(|(at_ns, _)| now_ns - at_ns < STEP) {
            return;
        }
        while self.0.front().is_some_and(|(at_ns, _)| now_ns - at_ns > LATELY) && self.0.len() > 2 {
            self.0.pop_front();
        }
        self.0.push_back((now_ns, bytes));
    }

    pub(super) fn bytes_per_s(&self) -> Option<f64> {
        let ((from_ns, from), (until_ns, until)) = (*self.0.front()?, *self.0.back()?);
        (until_ns - from_ns >= 2 * STEP)
            .then(|| until.saturating_sub(from) as f64 * SECOND as f64 / (until_ns - from_ns) as f64)
    }
}

/// Messages lost since the last report in the session, by channel.
#[derive(Debug, Default)]
pub(super) struct Losing {
    from_ns: i64,
    until_ns: i64,
    lost: Vec<(u16, u64, u64)>,
}

impl Losing {
    pub(super) fn add(&mut self, channel: u16, bytes: usize, at_ns: i64) {
        if self.lost.is_empty() {
            self.from_ns = at_ns;
        }
        self.until_ns = at_ns;
        let known = self.lost.iter().position(|(one, _, _)| *one == channel);
        let at = known.unwrap_or_else(|| {
            self.lost.push((channel, 0, 0));
            self.lost.len() - 1
        });
        self.lost[at].1 += 1;
        self.lost[at].2 += bytes as u64;
    }

    /// Returns the losses to be reported, and resets them.
    pub(super) fn drain(&mut self, why: &str, topic_of: impl Fn(u16) -> String) -> Option<Loss> {
        if self.lost.is_empty() {
            return None;
        }
        let lost = std::mem::take(&mut self.lost);
        let lost = lost.into_iter().map(|(channel, messages, bytes)| (topic_of(channel), messages, bytes)).collect();
        Some(Loss { from_ns: self.from_ns, until_ns: self.until_ns, why: why.to_owned(), lost })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minutes_left_follow_present_rate() {
        let mut rate = Rate::default();
        let mut bytes = 0;
        for second in 0..100 {
            assert_eq!(rate.bytes_per_s().is_some(), second > 2);
            rate.note(second * SECOND, bytes);
            rate.note(second * SECOND + 1, bytes);
            bytes += if second < 50 { 9_000_000 } else { 1_000_000 };
        }
        let room = Room { free_bytes: 120_000_000, bytes_per_s: rate.bytes_per_s() };
        assert!((room.minutes().unwrap() - 2.0).abs() < 1e-9, "{room:?}");
        assert_eq!(Room { bytes_per_s: Some(0.0), ..room }.minutes(), None);
        assert!(rate.0.len() < 30);
    }
}

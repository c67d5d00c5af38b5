//! Logs lost data as errors: each cause at its first loss, and then periodically while it
//! continues.
//!
//! The losses are read from the session status, so that reporting them costs the stages nothing.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::status::SessionStatus;

/// Shortest time between two messages about one cause.
const PAUSE: Duration = Duration::from_secs(10);

/// Last report about one cause.
#[derive(Debug, Clone, Copy)]
struct LastReport {
    count: u64,
    at: Instant,
}

/// Last report about each cause.
#[derive(Debug, Default)]
pub(super) struct Losses {
    reported: BTreeMap<String, LastReport>,
}

impl Losses {
    /// Logs losses not yet reported as errors; at the end of a session without the pause.
    /// Returns the sentences.
    pub(super) fn log(&mut self, status: &SessionStatus, now: Instant, is_end: bool) -> Vec<String> {
        let mut sentences = Vec::new();
        for (what, count) in lost(status) {
            let before = self.reported.get(&what).copied();
            let due = before.is_none_or(|reported| is_end || now.duration_since(reported.at) >= PAUSE);
            let more = count - before.map_or(0, |reported| reported.count).min(count);
            if more == 0 || !due {
                continue;
            }
            let sentence =
                if more == count { format!("{more} {what}") } else { format!("{more} more {what}, {count} in all") };
            tracing::error!("lost: {sentence}");
            sentences.push(sentence);
            self.reported.insert(what, LastReport { count, at: now });
        }
        sentences
    }
}

/// Returns every cause of loss, phrased to follow a number, with its count. The writer itself
/// reports messages that the session's file has no room for.
fn lost(status: &SessionStatus) -> Vec<(String, u64)> {
    let frames = &status.ledger.frames;
    let mut causes: Vec<(String, u64)> = Vec::new();
    for (queue, count) in &frames.dropped {
        causes.push((format!("frames, as there was no room before {}", queue.name()), *count));
    }
    for readings in &status.ledger.readings {
        causes
            .push((format!("readings of {}, as there was no room before pairing", readings.device), readings.dropped));
    }
    for device in &status.devices {
        causes.push((format!("that {} sent and that never arrived, by its own count", device.name), device.lost));
    }
    if let Some(written) = &status.recording {
        causes.push((
            "frames of the recording, as there was no room before its writer".into(),
            written.lost_before_writer.frames,
        ));
        causes.push((
            "other messages of the recording, as there was no room before its writer".into(),
            written.lost_before_writer.others,
        ));
    }
    causes.retain(|(_, count)| *count > 0);
    causes
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::ledger::{Queue, Readings};

    #[test]
    fn losses_reported_at_once_periodically_and_at_end() {
        let (mut losses, mut status, begin) = (Losses::default(), SessionStatus::default(), Instant::now());
        let at = |seconds| begin + Duration::from_secs(seconds);
        assert!(losses.log(&status, at(0), true).is_empty());
        status.ledger.frames.dropped.insert(Queue::Insertion, 3);
        status.ledger.readings.push(Readings { device: "tracker".into(), dropped: 0, ..Readings::default() });
        assert_eq!(losses.log(&status, at(1), false), ["3 frames, as there was no room before insertion"]);
        status.ledger.frames.dropped.insert(Queue::Insertion, 7);
        status.ledger.readings[0].dropped = 1;
        let other = "1 readings of tracker, as there was no room before pairing";
        assert_eq!(losses.log(&status, at(2), false), [other], "another cause does not wait for the first");
        status.ledger.frames.dropped.insert(Queue::Insertion, 9);
        assert!(losses.log(&status, at(10), false).is_empty());
        let more = "6 more frames, as there was no room before insertion, 9 in all";
        assert_eq!(losses.log(&status, at(11), false), [more]);
        status.ledger.readings[0].dropped = 2;
        assert_eq!(losses.log(&status, at(11), true).len(), 1, "what is left is said at the end");
        assert!(losses.log(&status, at(99), true).is_empty(), "and nothing twice");
    }
}

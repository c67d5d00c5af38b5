//! A tracker with latency, bursts, clock steps, or a station that becomes silent.

use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::refusal::Reason;

use crate::script::{Act, FRAME, Script, begin, frames as all_frames, height_mm, measured, pose, poses_timing};
use crate::set::{Set, frames, seen_at};

/// Frames of each of these sessions.
const COUNT: u64 = 60;

/// A tracker of one station whose readings arrive at other times; `at` maps each measurement's
/// time.
fn received(begin_ns: i64, counts: bool, at: impl Fn(i64) -> i64) -> Script {
    let acts: Vec<(i64, Act)> = measured(COUNT)
        .map(|(item, after, mm)| {
            let at_ns = at(begin_ns + after);
            (at_ns, Act::Give(pose(item, 1, counts.then_some(item), at_ns, mm)))
        })
        .collect();
    Script::new("a scripted tracker", poses_timing(counts), acts)
}

#[test]
fn frames_wait_for_a_late_tracker() {
    let begin_ns = begin();
    let tracker = received(begin_ns, false, |at_ns| at_ns + 200 * MS);
    let mut set = Set::of(tracker, all_frames(begin_ns, COUNT));
    set.tracking_latency_ns = 200 * MS;
    let (finished, _) = set.run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]));
    let bounds = finished.outcome.as_ref().unwrap().reconstructor.volume().seen_bounds().unwrap();
    // The first frame lies at 0, the last at 47.2 mm; a kernel reaches a little further.
    assert!((-3..=0).contains(&bounds.0[2]) && (47..=50).contains(&bounds.1[2]), "{bounds:?}");
    let waited = finished.status.capture_to_volume.quantiles().unwrap();
    assert!(waited.median_ms >= 200.0, "{waited:?}");
}

#[test]
fn packets_and_stalls_lose_and_move_no_frame() {
    // An adapter that collects for 16 ms, and one that stalls for 200 ms repeatedly.
    for (counts, packet) in [(false, 16 * MS), (true, 16 * MS), (true, 200 * MS)] {
        let begin_ns = begin();
        let tracker = received(begin_ns, counts, |at_ns| (at_ns.div_euclid(packet) + 1) * packet);
        let (finished, _) = Set::of(tracker, all_frames(begin_ns, COUNT)).run();
        assert_eq!(frames(&finished), (COUNT, COUNT, vec![]), "{counts} {packet}");
        let readings = &finished.status.ledger.readings[0];
        assert_eq!((readings.used, readings.total), (measured(COUNT).count() as u64, readings.used));
        assert!((0..COUNT as i64).all(|n| seen_at(&finished, height_mm(n * FRAME))), "{counts} {packet}");
    }
}

#[test]
fn silent_station_is_named_and_frames_resume_with_it() {
    let begin_ns = begin();
    // The patient's sensor is silent from frame 20 to frame 40.
    let silent = 20 * FRAME..40 * FRAME;
    let mut acts = Vec::new();
    for (item, after, mm) in measured(COUNT) {
        let at_ns = begin_ns + after;
        acts.push((at_ns, Act::Give(pose(2 * item, 1, None, at_ns, mm))));
        if !silent.contains(&after) {
            acts.push((at_ns, Act::Give(pose(2 * item + 1, 2, None, at_ns, 0.0))));
        }
    }
    let tracker = Script::new("a tracker of two stations", poses_timing(false), acts);
    let (finished, _) = Set::of(tracker, all_frames(begin_ns, COUNT)).with_reference().run();
    let (total, used, refused) = frames(&finished);
    let [(Reason::PoseMissing, missing)] = refused[..] else { panic!("{refused:?}") };
    // Its clock is accurate to a ms or two, so frames 20 and 40 may fall on either side.
    assert!(total == COUNT && used + missing == COUNT && (19..=21).contains(&missing), "{}", finished.status.ledger);
    let first = &finished.status.ledger.first_refusals[&Reason::PoseMissing];
    assert!(first.detail.starts_with("ReferenceToTracker: "), "{first:?}");
    let at = |n: i64| seen_at(&finished, height_mm(n * FRAME));
    assert!(at(10) && !at(30) && at(50));
}

#[test]
fn clock_step_or_restart_loses_no_frame() {
    let begin_ns = begin();
    // Its counter jumps at frame 20; at frame 40 it is set up again and counts from 0.
    let mut acts = Vec::new();
    let mut anew: Option<u64> = None;
    for (item, after, mm) in measured(COUNT) {
        let at_ns = begin_ns + after;
        if after >= 40 * FRAME && anew.is_none() {
            acts.push((at_ns, Act::Be(State::Silent, "it was set up anew")));
            acts.push((at_ns, Act::SetUp));
            acts.push((at_ns, Act::Be(State::Running, "")));
            anew = Some(item);
        }
        let ticks = match anew {
            Some(first) => item - first,
            None if after >= 20 * FRAME => 1_000_000 + item,
            None => item,
        };
        acts.push((at_ns, Act::Give(pose(item, 1, Some(ticks), at_ns, mm))));
    }
    let tracker = Script::new("a tracker that counts", poses_timing(true), acts);
    let (finished, _) = Set::of(tracker, all_frames(begin_ns, COUNT)).waits(SECOND).run();
    assert_eq!(frames(&finished), (COUNT, COUNT, vec![]), "{}", finished.status.ledger);
    assert!((0..COUNT as i64).all(|n| seen_at(&finished, height_mm(n * FRAME))));
    assert_eq!(finished.status.devices[0].set_up, 2);
}

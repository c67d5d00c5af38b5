//! A scanner without a signal, or with a stuck image.

use std::sync::Arc;

use drivers::simulated::Faults;
use drivers::simulated::grabber::Grabber;
use sonoweave_core::clock::{Monotonic, SECOND};
use sonoweave_core::refusal::Reason;

use crate::script::{Act, FRAME, POSE, Script, begin, frame, height_mm, pose, poses, poses_timing, video};
use crate::set::{SIZE, Set, frames, seen_at};

#[test]
fn frames_without_signal_are_refused_and_next_are_used() {
    // Ten good frames, ten that the driver flags, ten good ones.
    let begin_ns = begin();
    let acts = (0..30).map(|n| {
        let at_ns = begin_ns + n as i64 * FRAME;
        let mut reading = frame(n, n, at_ns, n);
        if let (10..20, sonoweave_core::Reading::Frame(frame)) = (n, &mut reading) {
            frame.status = sonoweave_core::reading::Status::Other("NO SIGNAL".into());
        }
        (at_ns, Act::Give(reading))
    });
    let (finished, seen) = Set::of(poses(begin_ns, 30), Script::new("a grabber", video(), acts)).run();
    assert_eq!(frames(&finished), (30, 20, vec![(Reason::ImageStatus, 10)]));
    let first = &finished.status.ledger.first_refusals[&Reason::ImageStatus];
    assert!(first.item == 10 && first.detail.contains("NO SIGNAL"), "{first:?}");
    assert!(seen.stuck.iter().all(Option::is_none), "black is not stuck");
    // The probe continued: there is a gap at the frames without a signal.
    let at = |n: i64| seen_at(&finished, height_mm(n * FRAME));
    assert!(at(5) && !at(15) && at(25));
}

#[test]
fn missing_grabber_signal_is_in_the_status() {
    let dark = Box::new(|_: i64, pixels: &mut [u8]| pixels.fill(90));
    let grabber = Grabber::new(dark, SIZE, 50.0, Faults::default(), Arc::new(Monotonic)).unwrap();
    let controls = grabber.controls();
    controls.lock().unwrap().signal = false;
    let (finished, seen) = Set::of(poses(begin(), 40), grabber).until(|status, _| status.ledger.frames.total >= 30);
    let (total, used, refused) = frames(&finished);
    assert_eq!((used, refused), (0, vec![(Reason::ImageStatus, total)]));
    assert!(seen.said(1, "running", "has no signal; check its cable"), "{:?}", seen.devices[1]);
    assert!(finished.outcome.is_none(), "no slice, no volume");
}

/// Frames of which those in a range show one image.
fn with_a_stop(begin_ns: i64, count: u64, stop: std::ops::Range<u64>) -> Script {
    let acts = (0..count).map(|n| {
        let at_ns = begin_ns + n as i64 * FRAME;
        let picture = if stop.contains(&n) { stop.start } else { n };
        (at_ns, Act::Give(frame(n, n, at_ns, picture)))
    });
    Script::new("a scripted grabber", video(), acts)
}

#[test]
fn stuck_scanner_is_refused_and_reported_until_it_moves() {
    let begin_ns = begin();
    // The first of the equal frames is an ordinary one; then follows 1 s of repetitions.
    let (finished, seen) = Set::of(poses(begin_ns, 60), with_a_stop(begin_ns, 60, 20..46)).run();
    assert_eq!(frames(&finished), (60, 35, vec![(Reason::SamePicture, 25)]));
    let reported: Vec<f64> = seen.stuck.iter().flatten().copied().collect();
    assert!(!reported.is_empty() && reported.iter().all(|seconds| (0.5..=1.0).contains(seconds)), "{:?}", seen.stuck);
    assert!(reported.windows(2).all(|two| two[0] < two[1]), "{reported:?}");
    assert_eq!((seen.stuck.first(), seen.stuck.last()), (Some(&None), Some(&None)), "withdrawn");
    let at = |n: i64| seen_at(&finished, height_mm(n * FRAME));
    assert!(at(10) && !at(33) && at(52));
}

#[test]
fn less_than_half_a_second_of_one_image_is_not_stuck() {
    let begin_ns = begin();
    // 12 repetitions over 0.44 s.
    let (finished, seen) = Set::of(poses(begin_ns, 60), with_a_stop(begin_ns, 60, 20..33)).run();
    assert_eq!(frames(&finished), (60, 48, vec![(Reason::SamePicture, 12)]));
    assert!(seen.stuck.iter().all(Option::is_none), "{:?}", seen.stuck);
}

#[test]
fn repeated_frame_at_same_pose_adds_no_work_or_weight() {
    // The probe rests at an angle with a constant image: the result equals that of one frame.
    let run = |frames: u64| {
        let begin_ns = begin();
        let acts = (-60..(frames as i64 * FRAME + SECOND / 2) / POSE).map(|n| {
            let at_ns = begin_ns + n * POSE;
            let mut reading = pose((n + 60) as u64, 1, None, at_ns, 3.7);
            if let sonoweave_core::Reading::Pose(pose) = &mut reading {
                pose.quaternion_wxyz = [0.8, 0.1, -0.5, 0.316_227_766_016_837_94];
            }
            (at_ns, Act::Give(reading))
        });
        let tracker = Script::new("a tracker at rest", poses_timing(false), acts);
        Set::of(tracker, with_a_stop(begin_ns, frames, 0..frames)).run()
    };
    let (one, _) = run(1);
    let (many, seen) = run(50);
    assert_eq!(frames(&one), (1, 1, vec![]));
    assert_eq!(frames(&many), (50, 1, vec![(Reason::Repeated, 49)]));
    assert!(seen.stuck.iter().all(Option::is_none), "a probe at rest: {:?}", seen.stuck);
    let [one, many] = [one, many].map(|finished| finished.outcome.unwrap());
    assert!(one.voxels_updated > 0);
    assert_eq!(one.voxels_updated, many.voxels_updated);
    let bounds = |outcome: &pipeline::Outcome| outcome.reconstructor.volume().seen_bounds().unwrap();
    let (low, high) = bounds(&one);
    assert_eq!((low, high), bounds(&many));
    for z in low[2]..=high[2] {
        for y in low[1]..=high[1] {
            for x in low[0]..=high[0] {
                let of = |outcome: &pipeline::Outcome| outcome.reconstructor.volume().voxel([x, y, z]);
                assert_eq!(of(&one), of(&many));
            }
        }
    }
}

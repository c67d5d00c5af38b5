//! Frames and poses that arrive out of order, twice, or not at all.

use std::sync::Arc;

use drivers::simulated::Faults;
use drivers::simulated::grabber::Grabber;
use formats::session::WriterOptions;
use sonoweave_core::clock::{Monotonic, SECOND};
use sonoweave_core::refusal::Reason;

use crate::disk::read;
use crate::script::{
    Act, FRAME, Script, begin, frame, frames as all_frames, height_mm, measured, pose, poses, poses_timing, video,
};
use crate::set::{Memory, SIZE, Set, frames, seen_at};

#[test]
fn disordered_frames_are_counted_once_with_correct_poses() {
    let begin_ns = begin();
    // Numbers in their order of arrival: 8 comes twice, 15 and 16 never; 21 comes after 23.
    let numbers: Vec<u64> = (0..9).chain(8..15).chain(17..21).chain([22, 23, 21]).chain(24..40).collect();
    let mut acts = Vec::new();
    for (item, n) in (0..).zip(&numbers) {
        let at_ns = begin_ns + *n as i64 * FRAME;
        if *n == 17 {
            acts.push((at_ns, Act::Lose(2)));
        }
        acts.push((at_ns, Act::Give(frame(item, *n, at_ns, *n))));
    }
    let (finished, _) = Set::of(poses(begin_ns, 40), Script::new("a grabber", video(), acts)).run();
    assert_eq!(frames(&finished), (39, 38, vec![(Reason::Repeated, 1)]));
    assert_eq!(finished.status.ledger.frames.lost, 2);
    assert_eq!(finished.status.ledger.first_refusals[&Reason::Repeated].item, 9);
    for n in [7, 8, 9, 13, 18, 21, 23, 30] {
        assert!(seen_at(&finished, height_mm(n * FRAME)), "{n}");
    }
}

#[test]
fn disordered_and_repeated_poses_are_used() {
    let begin_ns = begin();
    for counts in [false, true] {
        let begin_ns = if counts { begin() } else { begin_ns };
        // In each ten, the sixth comes before the fifth, with its own arrival time, and the
        // ninth comes twice.
        let mut acts: Vec<(i64, Act)> = Vec::new();
        for (item, after, mm) in measured(40) {
            let at_ns = begin_ns + after;
            let ticks = counts.then_some(1000 + item);
            acts.push((at_ns, Act::Give(pose(item, 1, ticks, at_ns, mm))));
            match item % 10 {
                5 => {
                    let len = acts.len();
                    acts.swap(len - 1, len - 2);
                }
                8 => acts.push((at_ns, Act::Give(pose(item, 1, ticks, at_ns, mm)))),
                _ => {}
            }
        }
        let given = acts.len() as u64;
        let tracker = Script::new("a tracker", poses_timing(counts), acts);
        let (finished, _) = Set::of(tracker, all_frames(begin_ns, 40)).run();
        assert_eq!(frames(&finished), (40, 40, vec![]), "{counts}");
        let readings = &finished.status.ledger.readings[0];
        assert_eq!((readings.total, readings.used), (given, given));
        assert!((0..40).all(|n| seen_at(&finished, height_mm(n * FRAME))));
    }
}

#[test]
fn lost_grabber_frames_are_counted_by_number_gaps() {
    let picture = Box::new(|at_ns: i64, pixels: &mut [u8]| {
        pixels.iter_mut().zip(at_ns.to_le_bytes().iter().cycle()).for_each(|(pixel, byte)| *pixel = 100 + byte % 100);
    });
    let faults = Faults { dropout: 0.2, ..Faults::default() };
    let grabber = Grabber::new(picture, SIZE, 100.0, faults, Arc::new(Monotonic)).unwrap();
    let disk = Memory::default();
    let set =
        Set::of(poses(begin(), 100), grabber).waits(SECOND).recorded(disk.clone(), WriterOptions::new("a test"), 0);
    let (finished, _) = set.until(|status, _| status.ledger.frames.total >= 200);
    let ledger = &finished.status.ledger;
    let read = read(&disk.bytes());
    let numbers = &read.frame_numbers;
    assert_eq!(numbers.len() as u64, ledger.frames.total);
    let gaps: u64 = numbers.windows(2).map(|two| two[1] - two[0] - 1).sum();
    // Losses before the first frame and after the last leave no gap in the numbers.
    let [first, last] = [numbers[0], numbers[numbers.len() - 1]];
    assert!(
        ledger.frames.lost >= gaps + first && ledger.frames.lost <= gaps + first + 20,
        "{} {gaps}",
        ledger.frames.lost
    );
    assert!(gaps > 20 && last + 1 == ledger.frames.total + gaps + first, "{gaps} {last}");
}

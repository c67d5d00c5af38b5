//! Cut anywhere, with any byte changed: every message that comes is one that was written, and what is missing is said.

use std::collections::HashMap;

use drivers::clock::{MS, SECOND};
use drivers::recording::Limits;
use drivers::recording::session::{Ending, repair};
use proptest::prelude::*;

use crate::{BEGIN, Read, chunks_of, mixture, read, writer};

/// A small session of several chunks, finished or not.
fn session(finished: bool) -> Vec<u8> {
    let (mut session, disk) = writer(chunks_of(40 * MS));
    mixture(&mut session, 12);
    if finished {
        session.finish(BEGIN + SECOND).unwrap();
        return disk.bytes();
    }
    session.tick(BEGIN + SECOND).unwrap();
    let bytes = disk.bytes();
    drop(session);
    bytes
}

/// By topic and number.
fn known(read: &Read) -> HashMap<(String, u32), String> {
    read.readings.iter().map(|(_, n, topic, reading)| ((topic.clone(), *n), reading.clone())).collect()
}

/// What is left is a part of what there was; how many are not there.
fn assert_part(left: &Read, all: &Read, known: &HashMap<(String, u32), String>) -> usize {
    for (_, n, topic, reading) in &left.readings {
        assert_eq!(known.get(&(topic.clone(), *n)), Some(reading), "a message that was never written");
    }
    assert!(left.times.is_sorted());
    all.readings.len() - left.readings.len()
}

#[test]
fn cut_anywhere_what_is_before_the_cut_is_there() {
    let bytes = session(true);
    let all = read(&bytes).unwrap();
    let known = known(&all);
    let (mut before, mut refused) = (0, 0);
    for length in (0..bytes.len()).step_by(13) {
        match read(&bytes[..length]) {
            Ok(left) => {
                assert_part(&left, &all, &known);
                // Within the index behind the last message nothing else is missing.
                let in_index = left.ending == Some(Ending::Finished);
                assert!(!in_index || left.readings.len() == all.readings.len() && !left.damage.is_empty());
                assert_eq!(left.missing, 0, "at {length}");
                assert!(left.damage.len() <= 1 && left.damage.iter().all(|part| part.until == length as u64));
                assert!(left.readings.len() >= before, "more of the file and less in it");
                before = left.readings.len();
            }
            Err(error) => {
                assert_eq!(before, 0, "at {length}");
                let said = error.to_string();
                assert!(said.contains("give a file") || said.contains("nothing in it"), "{said}");
                refused = length;
            }
        }
    }
    assert!(refused > 0 && before == all.readings.len(), "{before}");
}

fn assert_noticed(
    bytes: &[u8],
    finished: bool,
    at: usize,
    with: u8,
    all: &Read,
    known: &HashMap<(String, u32), String>,
) {
    let mut harmed = bytes.to_vec();
    harmed[at] ^= with;
    let Ok(left) = read(&harmed) else { panic!("{at} ^ {with}: one byte hides a whole session") };
    let gone = assert_part(&left, all, known);
    // A session that was finished has checksums of everything.
    assert!(!finished || !left.damage.is_empty(), "{at} ^ {with}: not noticed");
    assert!(gone == 0 || left.damage.iter().any(|part| part.is_loss), "{at} ^ {with}: {gone} are gone in silence");
    for part in &left.damage {
        assert!(part.from < part.until && part.until <= bytes.len() as u64, "{part:?}");
        assert!(!part.is_loss || (part.from..part.until).contains(&(at as u64)), "{:?} and not at {at}", left.damage);
    }
    // No more than a chunk of it.
    assert!(gone <= all.readings.len() / 2, "{at} ^ {with}: {gone} are gone");
}

#[test]
fn every_byte_changed_is_noticed_and_costs_a_chunk_at_most() {
    for finished in [true, false] {
        let bytes = session(finished);
        let all = read(&bytes).unwrap();
        let known = known(&all);
        let mut random = fastrand::Rng::with_seed(3);
        for at in (0..bytes.len()).step_by(7) {
            assert_noticed(&bytes, finished, at, 1 << random.u32(0..8), &all, &known);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn any_byte_changed_is_noticed(at: prop::sample::Index, with in 1_u8..=255, finished: bool) {
        let bytes = session(finished);
        let all = read(&bytes).unwrap();
        assert_noticed(&bytes, finished, at.index(bytes.len()), with, &all, &known(&all));
    }

    #[test]
    fn parts_taken_out_doubled_or_of_noise_never_make_a_message(
        from: prop::sample::Index, length in 1_usize..3000, kind in 0_u8..3, seed: u64,
    ) {
        let bytes = session(true);
        let all = read(&bytes).unwrap();
        let from = from.index(bytes.len());
        let until = (from + length).min(bytes.len());
        let mut random = fastrand::Rng::with_seed(seed);
        let harmed = match kind {
            0 => [&bytes[..from], &bytes[until..]].concat(),
            1 => [&bytes[..until], &bytes[from..]].concat(),
            _ => {
                let mut harmed = bytes.clone();
                harmed[from..until].iter_mut().for_each(|byte| *byte = random.u8(..));
                harmed
            }
        };
        if let Ok(left) = read(&harmed) {
            let known = known(&all);
            for (_, n, topic, reading) in &left.readings {
                prop_assert_eq!(known.get(&(topic.clone(), *n)), Some(reading));
            }
            prop_assert!(!left.damage.is_empty() || left.ending == Some(Ending::BrokenOff) || harmed == bytes);
        }
    }

    #[test]
    fn arbitrary_bytes_are_refused(bytes: Vec<u8>) {
        let error = read(&bytes).err().unwrap().to_string();
        prop_assert!(error.contains("give a file that"), "{}", error);
    }
}

#[test]
fn a_repaired_session_is_whole_and_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["harmed.mcap", "whole.mcap"].map(|name| folder.path().join(name));
    let bytes = session(true);
    let all = read(&bytes).unwrap();
    let mut harmed = bytes.clone();
    let middle = bytes.windows(4).enumerate().filter(|(_, four)| four == b"IDAT").map(|(at, _)| at).nth(5).unwrap();
    harmed[middle] ^= 0x10;
    std::fs::write(&from, &harmed).unwrap();
    let repaired = repair(&from, &to, &Limits::default()).unwrap();
    let left = read(&harmed).unwrap();
    let again = read(&std::fs::read(&to).unwrap()).unwrap();
    assert_eq!((again.damage.len(), again.ending, &again.readings), (0, Some(Ending::Finished), &left.readings));
    assert!(repaired.damage.len() == 1 && repaired.damage[0].from < middle as u64 && !repaired.missing.is_empty());
    let missing: u64 = repaired.missing.iter().map(|(_, count)| count).sum();
    assert_eq!((missing, missing as usize), (left.missing, all.readings.len() - left.readings.len()));
    assert_eq!((again.missing, again.losses[0].messages()), (left.missing, missing));
    assert!(again.losses[0].why.contains("1 damaged part"), "{:?}", again.losses);
    // Nothing is written over, and what cannot be repaired leaves nothing behind.
    assert!(repair(&from, &to, &Limits::default()).err().unwrap().to_string().contains("exists"));
    std::fs::write(&from, "no session").unwrap();
    let other = folder.path().join("other.mcap");
    assert!(repair(&from, &other, &Limits::default()).is_err() && !other.exists());
    // The beginning lost: the rest is there all the same.
    let mut harmed = bytes.clone();
    let first = bytes.windows(8).position(|eight| eight == BEGIN.to_le_bytes()).unwrap();
    harmed[first + 60] ^= 1;
    let left = read(&harmed).unwrap();
    assert!(left.readings.len() >= all.readings.len() - 20 && left.damage.len() == 1, "{:?}", left.damage);
}

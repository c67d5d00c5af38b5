//! Truncated files and changed bytes: every message read is one that was written, and missing
//! ones are reported.

use std::collections::HashMap;

use proptest::prelude::*;

use formats::session::{Ending, repair};
use formats::{Error, Limits, NoSession};
use sonoweave_core::clock::{MS, SECOND};

use crate::{BEGIN, Read, chunks_of, mixture, read, writer};

/// Returns a small session of several chunks, finished or not.
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

/// Maps topic and number to the reading.
fn known(read: &Read) -> HashMap<(String, u32), String> {
    read.readings.iter().map(|(_, n, topic, reading)| ((topic.clone(), *n), reading.clone())).collect()
}

/// Checks that the remaining messages are a part of the original ones; returns the number of
/// missing ones.
fn assert_part(left: &Read, all: &Read, known: &HashMap<(String, u32), String>) -> usize {
    for (_, n, topic, reading) in &left.readings {
        assert_eq!(known.get(&(topic.clone(), *n)), Some(reading), "a message that was never written");
    }
    assert!(left.times.is_sorted());
    all.readings.len() - left.readings.len()
}

#[test]
fn cut_file_keeps_messages_before_cut() {
    let bytes = session(true);
    let all = read(&bytes).unwrap();
    let known = known(&all);
    let (mut before, mut refused) = (0, 0);
    for length in (0..bytes.len()).step_by(13) {
        match read(&bytes[..length]) {
            Ok(left) => {
                assert_part(&left, &all, &known);
                // A cut within the index, after the last message, loses no messages.
                let in_index = left.ending == Some(Ending::Finished);
                assert!(!in_index || left.readings.len() == all.readings.len() && !left.damage.is_empty());
                assert_eq!(left.missing, 0, "at {length}");
                assert!(left.damage.len() <= 1 && left.damage.iter().all(|part| part.until == length as u64));
                assert!(left.readings.len() >= before, "more of the file and less in it");
                before = left.readings.len();
            }
            Err(error) => {
                assert_eq!(before, 0, "at {length}");
                let Error::NoSession { source, .. } = error else { panic!("{error}") };
                assert!(matches!(source, NoSession::NoChunk | NoSession::Empty), "{source}");
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
    // A finished session has checksums of everything.
    assert!(!finished || !left.damage.is_empty(), "{at} ^ {with}: not noticed");
    assert!(gone == 0 || left.damage.iter().any(|part| part.is_loss), "{at} ^ {with}: {gone} are gone in silence");
    for part in &left.damage {
        assert!(part.from < part.until && part.until <= bytes.len() as u64, "{part:?}");
        assert!(!part.is_loss || (part.from..part.until).contains(&(at as u64)), "{:?} and not at {at}", left.damage);
    }
    // At most one chunk is lost.
    assert!(gone <= all.readings.len() / 2, "{at} ^ {with}: {gone} are gone");
}

#[test]
fn changed_byte_is_reported_and_costs_one_chunk() {
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
    fn random_changed_byte_is_reported(at: prop::sample::Index, with in 1_u8..=255, finished: bool) {
        let bytes = session(finished);
        let all = read(&bytes).unwrap();
        assert_noticed(&bytes, finished, at.index(bytes.len()), with, &all, &known(&all));
    }

    #[test]
    fn removed_doubled_or_noisy_parts_give_no_false_message(
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
        let error = read(&bytes).err().unwrap();
        prop_assert!(matches!(error, Error::NoSession { source: NoSession::NoChunk, .. }), "{}", error);
    }
}

#[test]
fn repaired_session_is_intact_and_reports_losses() {
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
    // An existing file is not overwritten, and a failed repair leaves no file.
    assert!(repair(&from, &to, &Limits::default()).err().unwrap().to_string().contains("exists"));
    std::fs::write(&from, "no session").unwrap();
    let other = folder.path().join("other.mcap");
    assert!(repair(&from, &other, &Limits::default()).is_err() && !other.exists());
    // If the beginning is lost, the rest is still readable.
    let mut harmed = bytes.clone();
    let first = bytes.windows(8).position(|eight| eight == BEGIN.to_le_bytes()).unwrap();
    harmed[first + 60] ^= 1;
    let left = read(&harmed).unwrap();
    assert!(left.readings.len() >= all.readings.len() - 20 && left.damage.len() == 1, "{:?}", left.damage);
}

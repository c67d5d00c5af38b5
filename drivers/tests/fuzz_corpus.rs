//! Bytes that were found by fuzzing or written down as its beginnings, tried again by the functions that `make fuzz` tries them with.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot be set up has failed")]

#[path = "../fuzz/targets.rs"]
mod targets;

use std::fs;
use std::path::Path;

#[test]
fn every_input_of_the_corpus_does_no_harm() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    for (name, target) in targets::ALL {
        assert!(fuzz.join(format!("fuzz_targets/{name}.rs")).is_file(), "{name} is no target of the fuzzer");
        let mut tried = 0;
        for entry in fs::read_dir(fuzz.join("corpus").join(name)).unwrap() {
            let input = fs::read(entry.unwrap().path()).unwrap();
            target(&input);
            // Shorter by a byte at either end, and with other settings and cuts.
            target(&input[..input.len().saturating_sub(1)]);
            for choice in 0..=255 {
                let mut other = input.clone();
                other.iter_mut().take(2).for_each(|byte| *byte = byte.wrapping_add(choice));
                target(&other);
            }
            tried += 1;
        }
        assert!(tried > 0, "{name} has no corpus");
    }
    assert_eq!(fs::read_dir(fuzz.join("fuzz_targets")).unwrap().count(), targets::ALL.len());
}

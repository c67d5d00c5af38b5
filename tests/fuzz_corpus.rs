//! Texts that were found by fuzzing or written down as its beginnings, tried again by the functions that `make fuzz` tries them with: whole, cut short, and damaged.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

#[path = "fuzz/targets.rs"]
mod targets;

use std::fs;
use std::path::Path;

/// Places of a text that are damaged, evenly over it.
const PLACES: usize = 200;
/// What comes there instead.
const DAMAGE: [u8; 8] = *b"<\"9-.e]\n";

#[test]
fn every_text_of_the_corpus_does_no_harm() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz");
    for (name, target) in targets::ALL {
        assert!(fuzz.join(format!("fuzz_targets/{name}.rs")).is_file(), "{name} is no target of the fuzzer");
        let mut tried = 0;
        for entry in fs::read_dir(fuzz.join("corpus").join(name)).unwrap() {
            let input = fs::read(entry.unwrap().path()).unwrap();
            target(&input);
            for place in (0..input.len()).step_by(input.len().div_ceil(PLACES).max(1)) {
                target(&input[..place]);
                for byte in DAMAGE {
                    let mut other = input.clone();
                    other[place] = byte;
                    target(&other);
                }
            }
            tried += 1;
        }
        assert!(tried > 0, "{name} has no corpus");
    }
    assert_eq!(fs::read_dir(fuzz.join("fuzz_targets")).unwrap().count(), targets::ALL.len());
}

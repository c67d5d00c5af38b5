//! Texts that were found by fuzzing or written down as its beginnings, tried again by the functions that `make fuzz` tries them with: whole, cut short, and damaged.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

#[path = "../drivers/fuzz/corpus.rs"]
mod corpus;
#[path = "fuzz/targets.rs"]
mod targets;

use std::path::Path;

/// Places of a text that are damaged, evenly over it.
const PLACES: usize = 200;
/// What comes there instead.
const DAMAGE: [u8; 8] = *b"<\"9-.e]\n";

#[test]
fn every_text_of_the_corpus_does_no_harm() {
    corpus::each(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz"), &targets::ALL, |target, input| {
        target(input);
        for place in (0..input.len()).step_by(input.len().div_ceil(PLACES).max(1)) {
            target(&input[..place]);
            for byte in DAMAGE {
                let mut other = input.to_vec();
                other[place] = byte;
                target(&other);
            }
        }
    });
}

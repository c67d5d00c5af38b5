//! Tests texts found by fuzzing, or written as its seeds, with the functions of `make fuzz`:
//! whole, truncated, and damaged.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

#[path = "../drivers/fuzz/corpus.rs"]
mod corpus;
#[path = "fuzz/targets.rs"]
mod targets;

use std::path::Path;

/// Number of damaged positions, evenly distributed over a text.
const PLACES: usize = 200;
/// The bytes that replace them.
const DAMAGE: [u8; 8] = *b"<\"9-.e]\n";

#[test]
fn corpus_texts_cause_no_failure() {
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

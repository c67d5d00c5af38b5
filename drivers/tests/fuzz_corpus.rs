//! Bytes that were found by fuzzing or written down as its beginnings, tried again by the functions that `make fuzz` tries them with.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot be set up has failed")]

#[path = "../fuzz/corpus.rs"]
mod corpus;
#[path = "../fuzz/targets.rs"]
mod targets;

use std::path::Path;

#[test]
fn every_input_of_the_corpus_does_no_harm() {
    corpus::each(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz"), &targets::ALL, |target, input| {
        target(input);
        // Shorter by a byte at either end, and with other settings and cuts.
        target(&input[..input.len().saturating_sub(1)]);
        for choice in 0..=255 {
            let mut other = input.to_vec();
            other.iter_mut().take(2).for_each(|byte| *byte = byte.wrapping_add(choice));
            target(&other);
        }
    });
}

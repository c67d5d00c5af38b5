//! Repeats the fuzzing corpus, of found inputs and hand-written seeds, with the functions of
//! `make fuzz`.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot be set up has failed")]

#[path = "../fuzz/corpus.rs"]
mod corpus;
#[path = "../fuzz/targets.rs"]
mod targets;

use std::path::Path;

#[test]
fn corpus_inputs_never_panic() {
    corpus::each(&Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz"), &targets::ALL, |target, input| {
        target(input);
        // Also one byte shorter, and with other settings and divisions.
        target(&input[..input.len().saturating_sub(1)]);
        for choice in 0..=255 {
            let mut other = input.to_vec();
            other.iter_mut().take(2).for_each(|byte| *byte = byte.wrapping_add(choice));
            target(&other);
        }
    });
}

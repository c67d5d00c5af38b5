//! Products of transforms with mismatched frames must not compile.

#[test]
fn mismatched_frames_do_not_compile() {
    let cases = trybuild::TestCases::new();
    // Shows that the cases below fail because of their frames and not because of the set-up.
    cases.pass("tests/mismatch/meeting.rs");
    cases.compile_fail("tests/mismatch/product.rs");
    cases.compile_fail("tests/mismatch/inverse.rs");
}

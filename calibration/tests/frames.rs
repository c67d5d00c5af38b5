//! Products of transforms whose frames do not meet must not compile.

#[test]
fn mismatched_frames_do_not_compile() {
    let cases = trybuild::TestCases::new();
    // Proves that the cases below fail for their frames and not for a slip in the set-up.
    cases.pass("tests/mismatch/meeting.rs");
    cases.compile_fail("tests/mismatch/product.rs");
    cases.compile_fail("tests/mismatch/inverse.rs");
}

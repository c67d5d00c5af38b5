//! Number of random cases, by the length of the stress tests: `SONOWEAVE_STRESS=full` (`make
//! stress`), `quick` as in CI, or none. The tests' limits follow from the number.

/// Returns the number of cases of a test: all if the stress tests are full, a quarter otherwise.
pub(crate) fn draws(full: u64) -> u64 {
    if std::env::var("SONOWEAVE_STRESS").is_ok_and(|length| length == "full") { full } else { full.div_ceil(4) }
}

//! Number of random cases.

/// Returns the number of random cases of a test: `full` with `SONOWEAVE_STRESS=full` (`make
/// stress`), a quarter of it otherwise. The test's limits follow from the number.
pub(crate) fn draws(full: u64) -> u64 {
    if std::env::var("SONOWEAVE_STRESS").is_ok_and(|length| length == "full") { full } else { full.div_ceil(4) }
}

//! `--version`: the version, its commit, and the instruction sets of this machine.

use std::sync::LazyLock;

use simd::Simd;

/// Commit of the build; empty if it is unknown.
const COMMIT: &str = env!("SONOWEAVE_BUILT_FROM");
/// Cargo features of the build, separated by spaces.
const FEATURES: &str = env!("SONOWEAVE_FEATURES");

/// Returns the text of `--version`; `-V` prints its first line only.
pub(super) fn long() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let sets: Vec<&str> = Simd::ALL.into_iter().filter(|set| set.is_available()).map(Simd::name).collect();
        text(env!("CARGO_PKG_VERSION"), [COMMIT, FEATURES], &sets, Simd::detect().name())
    });
    &TEXT
}

fn text(version: &str, [commit, features]: [&str; 2], sets: &[&str], used: &str) -> String {
    let or = |text: &str, other: &str| if text.is_empty() { other.to_owned() } else { text.to_owned() };
    format!(
        "{version}\ncommit: {}\nfeatures: {}\ninstruction sets: {}; {used} is used",
        or(commit, "not recorded, as in development builds and source archives"),
        or(features, "none"),
        sets.join(", "),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_names_commit_features_and_sets() {
        let known = text("1.2.3", ["84cf1bf0aa11", "extra"], &["avx2", "portable"], "avx2");
        let lines: Vec<&str> = known.lines().collect();
        assert_eq!(
            lines,
            ["1.2.3", "commit: 84cf1bf0aa11", "features: extra", "instruction sets: avx2, portable; avx2 is used"]
        );
        let unknown = text("1.2.3", ["", ""], &["portable"], "portable");
        assert!(unknown.contains("commit: not recorded") && unknown.contains("features: none"), "{unknown}");
        assert!(long().contains("portable") && long().starts_with(env!("CARGO_PKG_VERSION")));
    }
}

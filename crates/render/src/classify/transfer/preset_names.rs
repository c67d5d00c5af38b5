//! Names of transfer functions.

/// Name and purpose of every preset; the first is the default.
pub(super) const PRESETS: [(&str, &str); 5] = [
    ("tissue", "soft surfaces: dark fluid and faint speckle clear, bright and steep echoes opaque"),
    ("bone", "only the brightest echoes"),
    ("surface", "the surface halfway between black and white"),
    ("xray", "thin and even, like an x-ray picture"),
    ("phantom", "grey bodies on a dark background"),
];

/// Returns the names, as a sentence lists them.
pub(super) fn names() -> String {
    let [first @ .., last] = PRESETS.map(|(name, _)| name);
    format!("{} and {last}", first.join(", "))
}

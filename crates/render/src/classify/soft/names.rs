//! Names of soft lights.

/// Name and purpose of every preset; the first is the default.
pub(crate) const PRESETS: [(&str, &str); 4] = [
    ("portrait", "skin: soft tissue in a fluid, with light through thin parts"),
    ("bone", "the brightest echoes, as bone"),
    ("vessel", "fluid as a body: dark tubes and pockets, with the tissue clear"),
    ("glass", "borders only, so that bodies inside one another are visible"),
];

/// Returns the names, as a sentence lists them.
pub(crate) fn names() -> String {
    let [first @ .., last] = PRESETS.map(|(name, _)| name);
    format!("{} and {last}", first.join(", "))
}

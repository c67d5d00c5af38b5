//! Lists of known exceptions: a heading a paragraph, and entries below it, indented.

use std::collections::BTreeSet;

/// Paragraphs of a list, each as its heading and its sorted entries.
pub(crate) struct Known(pub(crate) BTreeSet<(String, Vec<String>)>);

impl Known {
    /// Reads a list. Lines that begin with `#` are comments; headings may repeat.
    pub(crate) fn parse(text: &str) -> Self {
        let mut all: Vec<(String, Vec<String>)> = Vec::new();
        for line in text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty()) {
            if !line.starts_with(' ') {
                all.push((line.trim().to_owned(), Vec::new()));
            } else if let Some((_, entries)) = all.last_mut() {
                entries.push(line.trim().to_owned());
            }
        }
        for (_, entries) in &mut all {
            entries.sort();
        }
        Self(all.into_iter().collect())
    }
}

/// Writes paragraphs in the form that [`Known::parse`] reads.
pub(crate) fn format(all: impl IntoIterator<Item = (String, Vec<String>)>) -> String {
    let paragraph = |(heading, entries): (String, Vec<String>)| {
        entries.iter().fold(heading, |text, entry| text + "\n    " + entry) + "\n"
    };
    let paragraphs: BTreeSet<String> = all.into_iter().map(paragraph).collect();
    paragraphs.into_iter().collect::<Vec<_>>().join("\n")
}

#[test]
fn known_list_is_read_as_written() {
    let text = "a\n    b\n    c\n\nd\n    e\n";
    assert_eq!(format(Known::parse(&format!("# comment\n{text}")).0), text);
}

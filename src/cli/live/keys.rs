//! Every key of a configuration, for people.

use crate::config::bedside::schema::{Applies, SECTIONS};

/// Columns before what is said of a key.
const INDENT: usize = 4;
/// Columns of a line.
const WIDTH: usize = 110;

/// All sections.
pub(super) fn text() -> String {
    let mut text = wrapped(
        "A configuration is TOML that begins with format = \"sonoweave-bedside\" and version = 1. Times are by this machine's clock. Keys with * can be changed while a session \
         runs; all others count from the next session on.",
        0,
    );
    for section in SECTIONS {
        text += &format!("\n[{}]\n", section.name);
        text += &wrapped(&format!("{}.", section.about), 0);
        for key in section.keys {
            let mark = if key.applies == Applies::AtOnce { " *" } else { "" };
            text += &format!("  {} = {}{mark}\n", key.name, key.takes);
            text += &wrapped(key.about, INDENT);
        }
    }
    text
}

/// Lines of words, indented.
fn wrapped(words: &str, indent: usize) -> String {
    let mut text = String::new();
    let mut column = 0;
    for word in words.split_whitespace() {
        let length = word.chars().count();
        if column > 0 && column + 1 + length > WIDTH {
            text.push('\n');
            column = 0;
        }
        if column == 0 {
            text += &" ".repeat(indent);
            column = indent;
        } else {
            text.push(' ');
            column += 1;
        }
        text += word;
        column += length;
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_said_within_the_lines() {
        let text = text();
        for section in SECTIONS {
            assert!(text.contains(&format!("\n[{}]\n", section.name)), "{}", section.name);
            for key in section.keys {
                let mark = if key.applies == Applies::AtOnce { " *\n" } else { "\n" };
                assert!(text.contains(&format!("  {} = {}{mark}", key.name, key.takes)), "{}", key.name);
            }
        }
        let longest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(longest <= WIDTH, "{longest}");
    }
}

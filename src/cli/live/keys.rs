//! Lists every key of a configuration, for people.

use config::bedside::schema::SECTIONS;

/// Columns before the description of a key.
const INDENT: usize = 4;
/// Columns of a line.
const WIDTH: usize = 110;

/// Formats all sections.
pub(super) fn text() -> String {
    let mut text = wrapped(
        "A session configuration is TOML that begins with format = \"sonoweave-bedside\" and version = 1. Times refer \
        to this machine's clock. Changes of keys with * take effect while a session runs; changes of all others take \
        effect in the next session.",
        0,
    );
    for section in SECTIONS.iter() {
        text += &format!("\n[{}]\n", section.name);
        text += &wrapped(&format!("{}.", section.about), 0);
        for key in &section.keys {
            let mark = if key.at_once { " *" } else { "" };
            text += &format!("  {} = {}{mark}\n", key.name, key.takes);
            text += &wrapped(&key.about, INDENT);
        }
    }
    text
}

/// Wraps words to indented lines.
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
    fn text_lists_every_key_within_width() {
        let text = text();
        for section in SECTIONS.iter() {
            assert!(text.contains(&format!("\n[{}]\n", section.name)), "{}", section.name);
            for key in &section.keys {
                let mark = if key.at_once { " *\n" } else { "\n" };
                assert!(text.contains(&format!("  {} = {}{mark}", key.name, key.takes)), "{}", key.name);
            }
        }
        let longest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(longest <= WIDTH, "{longest}");
    }
}

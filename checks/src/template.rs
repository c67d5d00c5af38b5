//! Templates: Markdown with placeholders for the figures of records.
//!
//! | placeholder | text |
//! |---|---|
//! | `{RECORD}` | commit, date, command and machine |
//! | `{RECORD/FIGURE:2}` | the number, or the median, with two decimals |
//! | `{RECORD/FIGURE.p99:2}` | a part of its spread |
//! | `{RECORD/FIGURE:+2}`, `{RECORD/FIGURE:e0}` | with its sign; with an exponent |
//! | `{RECORD/FIGURE ÷ RECORD/FIGURE:1}` | a ratio |
//!
//! Paragraphs and items are filled to the width of the documents. Rows of tables and pictures are
//! lines of their own.

use std::collections::{BTreeMap, BTreeSet};

use crate::record::{Figure, Record};

/// Widest line, columns.
const COLUMNS: usize = 100;

/// Records by their names.
pub type Records = BTreeMap<String, Record>;

/// A template that has been read.
#[derive(Debug)]
pub struct Template<'a> {
    /// Texts and placeholders in turns, a text first.
    parts: Vec<&'a str>,
}

impl<'a> Template<'a> {
    /// Splits a template at its placeholders.
    ///
    /// # Errors
    /// If a bracket is not closed.
    pub fn new(text: &'a str) -> Result<Self, String> {
        let mut parts = Vec::new();
        let mut rest = text.trim_end();
        while let Some((before, behind)) = rest.split_once('{') {
            let (inner, after) = behind.split_once('}').ok_or_else(|| format!("{{{behind:.20} is not closed"))?;
            parts.extend([before, inner]);
            rest = after;
        }
        parts.push(rest);
        Ok(Self { parts })
    }

    fn placeholders(&self) -> impl Iterator<Item = &'a str> {
        self.parts.iter().skip(1).step_by(2).copied()
    }

    /// Returns the names of the records that the template uses.
    pub fn records(&self) -> BTreeSet<&'a str> {
        let name = |name: &'a str| name.split('/').next().unwrap_or(name);
        self.placeholders().flat_map(|p| operands(p).into_iter().map(name)).collect()
    }

    /// Returns the figures that the template uses, as pairs of record and figure, with parts of
    /// spreads.
    pub fn figures(&self) -> BTreeSet<(&'a str, &'a str)> {
        self.placeholders().flat_map(|p| operands(p).into_iter().filter_map(|name| name.split_once('/'))).collect()
    }

    /// Returns the records whose statement the template shows.
    pub fn statements(&self) -> BTreeSet<&'a str> {
        self.placeholders().filter(|p| !p.contains('/')).collect()
    }

    /// Returns the text without figures: each placeholder is a letter.
    pub fn text(&self) -> String {
        self.parts.iter().enumerate().map(|(i, part)| if i % 2 == 0 { part } else { "x" }).collect()
    }

    /// Returns the Markdown. `is_current` tells of a record whether it measured today's sources.
    ///
    /// # Errors
    /// If a record or figure is missing, or a format is unknown.
    pub fn render(&self, records: &Records, is_current: impl Fn(&str) -> bool) -> Result<String, String> {
        let mut text = String::new();
        for (i, part) in self.parts.iter().enumerate() {
            match i % 2 {
                0 => text += part,
                _ if part.contains('/') => text += &number(part, records)?,
                _ => {
                    let record = records.get(*part).ok_or_else(|| format!("there is no record {part:?}"))?;
                    text += &record.statement(is_current(part));
                }
            }
        }
        Ok(filled(&text))
    }
}

/// Returns the names of figures, or of the record, in a placeholder.
fn operands(placeholder: &str) -> Vec<&str> {
    let name = placeholder.rsplit_once(':').map_or(placeholder, |(name, _)| name);
    name.split(" ÷ ").collect()
}

/// Returns the name of the figure that a placeholder's name refers to, and its value or that of
/// its part.
pub fn lookup<'a>(figures: &'a BTreeMap<String, Figure>, name: &str) -> Option<(&'a str, f64)> {
    if let Some((whole, figure)) = figures.get_key_value(name) {
        return Some((whole, figure.value()?));
    }
    let (whole, part) = name.rsplit_once('.')?;
    let (whole, figure) = figures.get_key_value(whole)?;
    Some((whole, figure.part(part)?))
}

fn number(placeholder: &str, records: &Records) -> Result<String, String> {
    let (_, format) = placeholder.rsplit_once(':').ok_or_else(|| format!("{{{placeholder}}} lacks its decimals"))?;
    let mut result: Option<f64> = None;
    for operand in operands(placeholder) {
        let found = operand.split_once('/').and_then(|(record, name)| lookup(&records.get(record)?.figures, name));
        let (_, found) = found.ok_or_else(|| format!("there is no figure {operand:?}"))?;
        result = Some(result.map_or(found, |result| result / found));
    }
    let result = result.unwrap_or(f64::NAN);
    let digits = |text: &str| text.parse::<usize>().map_err(|_| format!("{{{placeholder}}}: {format:?} is no format"));
    let text = match format.as_bytes().first() {
        Some(b'e') => format!("{result:.*e}", digits(&format[1..])?),
        Some(b'+') => format!("{result:+.*}", digits(&format[1..])?),
        _ => format!("{result:.*}", digits(format)?),
    };
    // A minus sign, but not in exponents.
    Ok(text.strip_prefix('-').map_or(text.clone(), |rest| format!("−{rest}")))
}

/// Fills paragraphs and items.
fn filled(text: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut indent = "";
    let mut goes_on = false;
    for line in text.lines() {
        if line.is_empty() || line.starts_with(['|', '!', '#']) {
            lines.push(line.to_owned());
            goes_on = false;
            continue;
        }
        if line.starts_with("- ") || !goes_on {
            indent = if line.starts_with("- ") { "  " } else { "" };
            lines.push(String::new());
        }
        for word in line.split_whitespace() {
            let last = lines.last_mut().expect("a line was begun");
            if last.is_empty() {
                *last = word.to_owned();
            } else if last.chars().count() + 1 + word.chars().count() <= COLUMNS {
                last.push(' ');
                last.push_str(word);
            } else {
                lines.push(format!("{indent}{word}"));
            }
        }
        goes_on = true;
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Machine;

    fn records() -> Records {
        let spread = [("median".to_owned(), 0.456), ("p99".to_owned(), 2.0)];
        let figures = [
            ("a b/ms".to_owned(), Figure::Spread(spread.into())),
            ("σ 0.3".to_owned(), Figure::Value(-6.5)),
            ("tiny".to_owned(), Figure::Value(5e-6)),
        ];
        let record = Record {
            peers: [].into(),
            commit: "0123abcd".into(),
            date: "2026-11-21".into(),
            command: "make bench".into(),
            machine: Machine { cpu: "a Xeon".into(), cores: 1, os: "Debian".into() },
            sources: [("crates/a".into(), "0".repeat(40))].into(),
            figures: figures.into(),
        };
        [("r".to_owned(), record)].into()
    }

    fn rendered(text: &str) -> Result<String, String> {
        Template::new(text)?.render(&records(), |_| false)
    }

    #[test]
    fn placeholders_become_numbers_and_statements() {
        let row = "| x | {r/a b/ms:2} ({r/a b/ms.p99:0}) | {r/σ 0.3:1} | {r/tiny:e0} | {r/a b/ms:+1} |";
        assert_eq!(rendered(row), Ok("| x | 0.46 (2) | −6.5 | 5e-6 | +0.5 |".into()));
        assert_eq!(rendered("{r/a b/ms.p99 ÷ r/a b/ms:1} times"), Ok("4.4 times".into()));
        assert_eq!(
            rendered("{r}."),
            Ok("Measured at 0123abc, 2026-11-21, by `make bench`, on 1 core of a Xeon.".into())
        );
        let template = Template::new("{r}. {r/a b/ms ÷ q/b:1}").expect("a template");
        assert!(template.render(&records(), |_| true).is_err());
        assert_eq!(template.records().into_iter().collect::<Vec<_>>(), ["q", "r"]);
        assert_eq!(template.figures().into_iter().collect::<Vec<_>>(), [("q", "b"), ("r", "a b/ms")]);
        assert_eq!(template.statements().into_iter().collect::<Vec<_>>(), ["r"]);
        assert_eq!(template.text(), "x. x");
    }

    #[test]
    fn faulty_placeholders_are_refused() {
        for text in ["{r/a b/ms}", "{r/a b/ms:two}", "{r/none:1}", "{none/a:1}", "{none}", "{r/a b/ms.p42:1}", "{r"] {
            assert!(rendered(text).is_err(), "{text}");
        }
    }

    #[test]
    fn paragraphs_are_filled_and_rows_are_not() {
        let row = format!("| {} |", "a ".repeat(80));
        let text = format!("{}\n\n{row}\n\n- {}\n  end\n- b", "word ".repeat(30), "word ".repeat(30));
        let filled = filled(&text);
        let lines: Vec<&str> = filled.lines().collect();
        assert_eq!(lines[0].chars().count(), 99);
        assert_eq!((lines[2], lines[3], lines[4]), ("", row.as_str(), ""));
        assert!(lines[5].starts_with("- word") && lines[6].starts_with("  word") && lines[6].ends_with("word end"));
        assert_eq!(lines[7], "- b");
        assert!(lines.iter().all(|line| line.starts_with('|') || line.chars().count() <= COLUMNS));
    }
}

//! Aligned lines for people.

use std::fmt::Write as _;

/// Columns before the values.
const LABEL: usize = 16;

/// Headed lists of labels and values, the values in one column.
#[derive(Debug, Default)]
pub(in crate::cli) struct Text(String);

impl Text {
    /// Writes a heading, after an empty line unless it is the first.
    pub(in crate::cli) fn heading(&mut self, text: &str) {
        if !self.0.is_empty() {
            self.0.push('\n');
        }
        self.line(text);
    }

    /// Writes one value.
    pub(in crate::cli) fn row(&mut self, label: &str, value: impl AsRef<str>) {
        self.rows(label, [value]);
    }

    /// Writes values below each other, the label before the first; nothing without values.
    pub(in crate::cli) fn rows<S: AsRef<str>>(&mut self, label: &str, values: impl IntoIterator<Item = S>) {
        for (n, value) in values.into_iter().enumerate() {
            let label = if n == 0 { label } else { "" };
            // All lines of a value are aligned to its column.
            let value = value.as_ref().replace('\n', &format!("\n  {:LABEL$}", ""));
            self.line(format!("  {label:LABEL$}{value}").trim_end());
        }
    }

    fn line(&mut self, text: &str) {
        // Writing to a string does not fail.
        let _ = writeln!(self.0, "{text}");
    }

    pub(in crate::cli) fn finish(self) -> String {
        self.0
    }
}

/// Joins numbers with ×, for sizes and spacings.
pub(in crate::cli) fn times<T: std::fmt::Display, const N: usize>(values: [T; N]) -> String {
    values.map(|v| v.to_string()).join("×")
}

/// Formats three numbers as a point.
pub(in crate::cli) fn point(values: [f64; 3]) -> String {
    values.map(|v| v.to_string()).join(", ")
}

/// Rounds a number for reading; the JSON form has all digits.
pub(in crate::cli) fn short(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 { format!("{value:.2e}") } else { format!("{value:.3}") }
}

/// Formats a file's size.
pub(in crate::cli) fn bytes(count: u64) -> String {
    match count {
        0..10_000 => format!("{count} bytes"),
        10_000..1_000_000 => format!("{:.1} kB", count as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", count as f64 / 1e6),
        _ => format!("{:.2} GB", count as f64 / 1e9),
    }
}

/// Formats a count with its noun.
pub(in crate::cli) fn count(n: u64, one: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {one}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_align_in_one_column() {
        let mut text = Text::default();
        text.heading("file.mha: volume");
        text.row("size", "3×4×5");
        text.rows("fields", ["A = 1", "B = 2\nmore"]);
        text.rows("nothing", [""; 0]);
        text.heading("place");
        let expected = "file.mha: volume\n  size            3×4×5\n  fields          A = 1\n                  B = 2\n                  more\n\nplace\n";
        assert_eq!(text.finish(), expected);
    }

    #[test]
    fn short_keeps_small_numbers_nonzero() {
        assert_eq!([0.0, 1e-4, 0.25, -12.3456].map(short), ["0.000", "1.00e-4", "0.250", "-12.346"]);
        assert_eq!([12, 12_345, 3_481_178, 20_000_000_000].map(bytes), ["12 bytes", "12.3 kB", "3.5 MB", "20.00 GB"]);
        assert_eq!((count(1, "frame"), count(0, "frame")), ("1 frame".into(), "0 frames".into()));
    }
}

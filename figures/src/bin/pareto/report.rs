//! Results of a run besides rows: pictures, sections of Markdown, and errors.

use std::error::Error;
use std::fs;
use std::path::Path;

use sonoweave_figures::{Findings, files};

#[derive(Debug, Default)]
pub(crate) struct Report {
    /// Pictures and checks.
    pub(crate) findings: Findings,
    sections: Vec<String>,
}

impl Report {
    /// Adds Markdown to `table.md`, and prints it.
    pub(crate) fn section(&mut self, text: String) {
        println!("\n{}", text.trim_end());
        self.sections.push(text);
    }

    /// Reports a timed answer that is wrong, as found by the checks shared with the bench.
    pub(crate) fn wrong(&mut self, what: impl Into<String>) {
        self.findings.wrong(what);
    }

    /// Writes the Markdown, and the page with `more` in its introduction. Returns whether all was
    /// right.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(crate) fn finish(self, title: &str, more: &str, folder: &Path) -> Result<bool, Box<dyn Error>> {
        fs::write(folder.join("table.md"), self.sections.join("\n"))?;
        let safe = self.sections.join("\n").replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let text = format!(
            "<p>The tables are in <a href=\"table.md\">table.md</a>. {more}</p>\n<details><summary>Tables</summary><pre>{safe}</pre></details>"
        );
        fs::write(folder.join("index.html"), files::page(title, &text, self.findings.figures()))?;
        Ok(self.findings.report())
    }
}

/// Returns a Markdown table.
pub(crate) fn markdown(columns: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let head = line(&columns.iter().map(ToString::to_string).collect::<Vec<_>>());
    let rule = format!("|{}\n", "---|".repeat(columns.len()));
    head + &rule + &rows.iter().map(|row| line(row)).collect::<String>()
}

/// Formats a number with `count` significant digits, without trailing zeros.
pub(crate) fn digits(value: f64, count: i32) -> String {
    if !value.is_finite() || value == 0.0 {
        return if value == 0.0 { "0".into() } else { "–".into() };
    }
    let decimals = usize::try_from(count - 1 - value.abs().log10().floor() as i32).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_significant_digits_only() {
        let shown = [0.28125, 0.5, 12.345, 1234.5, 0.0, -0.001_234_5, f64::NAN].map(|v| digits(v, 3));
        assert_eq!(shown, ["0.281", "0.5", "12.3", "1234", "0", "-0.00123", "–"]);
    }

    #[test]
    fn table_lines_have_equal_cell_counts() {
        let table = markdown(&["a", "b"], &[vec!["1".into(), "2".into()]]);
        assert!(table.lines().all(|line| line.matches('|').count() == 3), "{table}");
    }
}

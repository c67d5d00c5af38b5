//! Texts of other files than Rust: Markdown, and comments of scripts, pages and manifests.

use crate::comments::{Line, check_prose, is_narrow};
use crate::findings::Finding;
use crate::sources::Source;

/// Returns all findings in a Markdown file, or in the comments that fill lines of another file.
pub(crate) fn check(source: &Source) -> Vec<Finding> {
    let path = source.path.as_str();
    let lines = match path.rsplit('.').next() {
        Some("md") => markdown(source.text),
        Some("js") => comments(source.text, "//"),
        Some("sh" | "py" | "toml") => comments(source.text, "#"),
        _ => return Vec::new(),
    };
    let all: Vec<&str> = source.text.lines().collect();
    let mut findings: Vec<Finding> =
        lines.iter().filter_map(|line| is_narrow(path, line.number, all[line.number - 1])).collect();
    findings.extend(check_prose(path, &lines));
    findings.dedup();
    findings
}

/// Returns the lines of a Markdown file outside of code.
fn markdown(text: &'static str) -> Vec<Line<'static>> {
    let mut is_code = false;
    let mut kept = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let trimmed = line.trim();
        if trimmed.starts_with("```") {
            is_code = !is_code;
        } else if !is_code {
            kept.push(Line { number: at + 1, marker: "", text: trimmed });
        }
    }
    kept
}

/// Returns the comments that fill lines.
fn comments(text: &'static str, marker: &'static str) -> Vec<Line<'static>> {
    let lines = text.lines().enumerate().filter_map(|(at, line)| {
        let text = line.trim().strip_prefix(marker).filter(|text| !text.starts_with('!'))?;
        Some(Line { number: at + 1, marker, text: text.trim() })
    });
    lines.collect()
}

#[cfg(test)]
mod tests {
    use super::check;
    use crate::sources::Sources;

    fn sentences(path: &str, text: &str) -> Vec<String> {
        let found = Sources::of(&[(path, text)]);
        found.all().flat_map(check).map(|f| format!("{}: {}", f.line, f.sentence)).collect()
    }

    #[test]
    fn markdown_is_checked_outside_code_and_tables() {
        let wide = "w, ".repeat(40);
        assert_eq!(sentences("a.md", &format!("Right.\n\n{wide}\n")).len(), 2);
        assert_eq!(sentences("a.md", &format!("```\nWhat is {wide}\n```\n| {wide} |\n")), [""; 0]);
        assert_eq!(sentences("a.md", "Right. Of\nall.\n"), ["1: a sentence begins with \"Of\""]);
    }

    #[test]
    fn comment_of_script_or_page_is_checked() {
        assert_eq!(sentences("a.sh", "#!/bin/sh\n# What is.\nHow=1\n").len(), 2);
        assert_eq!(sentences("a.js", "// Who is.\nlet What = 1;\n").len(), 2);
        assert_eq!(sentences("Cargo.toml", &format!("# {}\n", "ä".repeat(99))).len(), 1);
        assert_eq!(sentences("a.css", "/* What */"), [""; 0]);
    }
}

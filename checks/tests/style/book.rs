//! The documents as a book: its table of contents, its links, and the messages that it explains.

use std::collections::{BTreeMap, BTreeSet};

use crate::findings::Finding;
use crate::lexer::Kind;
use crate::sources::{Source, Sources};

/// Table of contents.
const SUMMARY: &str = "docs/SUMMARY.md";
/// Page of messages.
const MESSAGES: &str = "docs/trouble.md";
/// Fewest letters of a part of a message that must be in the sources.
const LETTERS: usize = 3;

/// Returns the pages whose links are checked.
fn pages(sources: &Sources) -> impl Iterator<Item = &Source> {
    let is_page = |path: &str| path.strip_prefix("docs/").is_some_and(|name| !name.contains('/'));
    sources
        .all()
        .filter(move |source| source.path.ends_with(".md") && (source.path == "README.md" || is_page(&source.path)))
}

/// Returns the lines of a page outside of its blocks of code, with their numbers.
fn prose(page: &Source) -> Vec<(usize, &'static str)> {
    let mut is_code = false;
    let mut kept = Vec::new();
    for (at, line) in page.text.lines().enumerate() {
        let is_fence = line.trim_start().starts_with("```");
        is_code ^= is_fence;
        if !is_code && !is_fence {
            kept.push((at + 1, line));
        }
    }
    kept
}

/// Returns the targets of a page's links and images, with their lines.
fn targets(page: &Source) -> Vec<(usize, &'static str)> {
    let of_line = |(number, line): (usize, &'static str)| {
        let found = line.split("](").skip(1).filter_map(|rest| rest.split_once(')'));
        found.map(move |(target, _)| (number, target)).collect::<Vec<_>>()
    };
    prose(page).into_iter().flat_map(of_line).collect()
}

/// Returns the anchors of a page's headings, as GitHub and mdBook name them.
fn anchors(page: &Source) -> BTreeSet<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let headings = prose(page).into_iter().filter_map(|(_, line)| {
        let rest = line.trim_start_matches('#');
        (rest.len() < line.len()).then(|| rest.strip_prefix(' ')).flatten()
    });
    let names = headings.map(|heading| {
        let kept = |c: char| match c {
            ' ' => Some('-'),
            c if c.is_alphanumeric() || c == '-' || c == '_' => Some(c),
            _ => None,
        };
        let name: String = heading.trim().to_lowercase().chars().filter_map(kept).collect();
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        if *count > 1 { format!("{name}-{}", *count - 1) } else { name }
    });
    names.collect()
}

/// Returns a target's path from the repository's root.
fn resolved(page: &str, target: &str) -> String {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in target.split('/') {
        match part {
            ".." => {
                parts.pop();
            }
            "." => {}
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// Returns links to files that do not exist, and to headings that their pages do not have.
pub(crate) fn links(sources: &Sources, exists: impl Fn(&str) -> bool) -> Vec<Finding> {
    let mut findings = Vec::new();
    for page in pages(sources) {
        for (line, target) in targets(page).into_iter().filter(|(_, target)| !target.contains("://")) {
            let (file, heading) = target.split_once('#').map_or((target, None), |(file, of)| (file, Some(of)));
            let path = if file.is_empty() { page.path.clone() } else { resolved(&page.path, file) };
            let sentence = match (heading, sources.get(&path)) {
                _ if !exists(&path) => format!("{target:?} leads to no file"),
                (Some(heading), Some(of)) if !anchors(of).contains(heading) => {
                    format!("{path} has no heading {heading:?}")
                }
                (Some(_), None) => format!("{path} has no headings"),
                _ => continue,
            };
            findings.push(Finding::new(&page.path, line, sentence));
        }
    }
    findings
}

/// Returns pages that the table of contents lacks or names twice. Its links are checked as any.
pub(crate) fn contents(sources: &Sources) -> Vec<Finding> {
    let Some(summary) = sources.get(SUMMARY) else { return vec![Finding::new(SUMMARY, 1, "is missing")] };
    let mut findings = Vec::new();
    let mut listed = BTreeSet::new();
    for (line, target) in targets(summary) {
        if !listed.insert(resolved(SUMMARY, target)) {
            findings.push(Finding::new(SUMMARY, line, format!("{target:?} is listed twice")));
        }
    }
    let pages = pages(sources).filter(|page| page.path.starts_with("docs/") && page.path != SUMMARY);
    let lacking = pages.filter(|page| !listed.contains(&page.path));
    findings.extend(lacking.map(|page| Finding::new(&page.path, 1, format!("is not listed in {SUMMARY}"))));
    findings
}

/// Returns the messages of the page that no source has. They are in the first columns of its
/// tables, between backticks; `…` stands for names and numbers.
pub(crate) fn messages(sources: &Sources) -> Vec<Finding> {
    let Some(page) = sources.get(MESSAGES) else { return vec![Finding::new(MESSAGES, 1, "is missing")] };
    let literals = sources.rust().filter(|source| !source.path.contains("tests")).flat_map(|source| &source.tokens);
    let texts: String = literals.filter(|t| t.kind == Kind::Literal).map(|t| joined(t.text) + "\n").collect();
    let mut findings = Vec::new();
    for (line, row) in prose(page) {
        let Some(cell) = row.strip_prefix('|').and_then(|row| row.split(" | ").next()) else { continue };
        for part in cell.split('`').skip(1).step_by(2).flat_map(|message| message.split('…')) {
            let part = part.trim_matches(|c: char| c.is_whitespace() || ".,:;".contains(c));
            if part.len() >= LETTERS && !texts.contains(part) {
                findings.push(Finding::new(MESSAGES, line, format!("no source has the words {part:?}")));
            }
        }
    }
    findings
}

/// Joins the lines of a literal, and removes the escapes that messages have.
fn joined(literal: &str) -> String {
    let mut lines = literal.split("\\\n");
    let mut text = lines.next().unwrap_or_default().to_owned();
    lines.for_each(|line| text += line.trim_start());
    text.replace("\\\"", "\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sentences(findings: Vec<Finding>) -> Vec<String> {
        findings.into_iter().map(|f| format!("{}:{}: {}", f.file, f.line, f.sentence)).collect()
    }

    #[test]
    fn broken_links_are_found() {
        let sources = Sources::of(&[
            ("README.md", "[a](docs/a.md#two-words) [b](docs/b.md)\n```\n[c](c.md)\n```\n"),
            ("docs/a.md", "# Two words!\n[in](#two-words), [out](../README.md), ![p](p.png#x) [w](https://x.y/#z)\n"),
            ("docs/deep/c.md", "[nowhere](d.md)\n"),
            ("docs/e.md", "[a](a.md#three-words)\n## Same\n## Same\n[s](#same-1) [t](#same-2)\n"),
        ]);
        let exists = |path: &str| ["README.md", "docs/a.md", "docs/p.png", "docs/e.md"].contains(&path);
        assert_eq!(
            sentences(links(&sources, exists)),
            [
                "README.md:1: \"docs/b.md\" leads to no file",
                "docs/a.md:2: docs/p.png has no headings",
                "docs/e.md:1: docs/a.md has no heading \"three-words\"",
                "docs/e.md:4: docs/e.md has no heading \"same-2\"",
            ]
        );
    }

    #[test]
    fn pages_outside_the_contents_are_found() {
        let sources = Sources::of(&[
            ("docs/SUMMARY.md", "- [A](a.md)\n- [A again](a.md)\n"),
            ("docs/a.md", ""),
            ("docs/b.md", ""),
            ("docs/deep/c.md", ""),
        ]);
        let expected = ["docs/SUMMARY.md:2: \"a.md\" is listed twice", "docs/b.md:1: is not listed in docs/SUMMARY.md"];
        assert_eq!(sentences(contents(&sources)), expected);
    }

    #[test]
    fn messages_of_no_source_are_found() {
        let page = "| message | cure |\n|---|---|\n| `is not \"there\"; plug …`, `it in` | `none` |\n| `is lost` | |\n";
        let code = "fn f() { say(\"{x} is not \\\"there\\\"; \\\n    plug {y}: it in\"); } // is lost\n";
        let sources = Sources::of(&[("docs/trouble.md", page), ("src/a.rs", code), ("src/tests.rs", "\"is lost\"")]);
        assert_eq!(sentences(messages(&sources)), ["docs/trouble.md:4: no source has the words \"is lost\""]);
    }
}

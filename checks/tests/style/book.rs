//! The documents as a book: its table of contents, its links, and the messages that it explains.

use std::collections::{BTreeMap, BTreeSet};

use crate::errors::{Variant, closing, constants, is_test, unquoted, variants};
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

/// First pages of the documents, for those who read nothing else.
const FIRST: [&str; 2] = ["README.md", "docs/start.md"];

/// Returns first pages that do not give the program's notice, by its words in the sources.
pub(crate) fn notice(sources: &Sources) -> Vec<Finding> {
    let constants = constants(sources);
    let Some(notice) = constants.get("NOTICE") else {
        return vec![Finding::new(FIRST[0], 1, "no source has a NOTICE")];
    };
    let lacks = |path: &&str| sources.get(path).is_none_or(|page| !page.text.contains(notice.as_str()));
    FIRST.into_iter().filter(lacks).map(|path| Finding::new(path, 1, format!("does not say {notice:?}"))).collect()
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

/// Error types, and single variants, that `live` and `devices` do not meet: those of calibration,
/// of image files, and of other commands.
const ELSEWHERE: &str = "Apart ArmError::Ends ArmError::Few ArmError::OneDivot ArmError::OnePose \
    ArmError::Senseless ArmError::Undetermined ArmError::Units ArmError::Unknown BadMeta BadNumber BadShard \
    CalibrationError DenseError Error::NoDevice Error::Recorded ExportError::DicomTooLarge ExportError::DicomTooLong \
    ExportError::FloatingPoint ExportError::Grid ExportError::Identifier ExportError::Memory ExportError::NoFrame \
    ExportError::Outside ExportError::Paper ExportError::PixelType ExportError::Threads ExportError::Window \
    GeometryError LandmarksError LatencyError ListError NoImage NoLine OmeZarrError PipelineError::NoSuchFrames PivotError \
    ProbeError SegmentError SurfaceError TrackerError Unsolved";

/// Fewest words of a sentence beside its placeholders that the page explains; others are those of
/// the placeholders.
const WORDS: usize = 3;

/// Returns the sentences of errors, and of warnings in the log, that the page does not explain.
pub(crate) fn unexplained(sources: &Sources) -> Vec<Finding> {
    let Some(page) = sources.get(MESSAGES) else { return Vec::new() };
    let cells = prose(page).into_iter().filter_map(|(_, row)| row.strip_prefix('|')?.split(" | ").next());
    let spans: Vec<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    let mut findings = Vec::new();
    let mut find = |file: &str, line: usize, text: &str| {
        if words(text) >= WORDS && !spans.iter().any(|span| explains(span, text)) {
            findings.push(Finding::new(file, line, format!("{MESSAGES} does not explain {text:?}")));
        }
    };
    for variant in variants(sources).iter().filter(|variant| !is_elsewhere(variant)) {
        variant.text.iter().for_each(|text| find(&variant.file, variant.line, text));
    }
    for source in sources.rust().filter(|source| !is_test(&source.path)) {
        let code = source.code();
        for at in 0..code.len().saturating_sub(2) {
            let is_log =
                ["warn", "error"].iter().any(|name| code[at].is(name)) && code[at + 1].is("!") && code[at + 2].is("(");
            let end = if is_log { closing(&code, at + 2) } else { None };
            let text = end.and_then(|end| code[at..end].iter().find(|token| token.text.starts_with('"')));
            let text = text.map(|token| unquoted(token.text));
            text.iter().for_each(|text| find(&source.path, code[at].line, text));
        }
    }
    findings
}

fn is_elsewhere(variant: &Variant) -> bool {
    ELSEWHERE.split_whitespace().any(|name| name == variant.of || name == variant.path())
}

/// Returns the number of words beside the placeholders.
fn words(text: &str) -> usize {
    let beside = text.split('{').map(|part| part.split_once('}').map_or(part, |(_, rest)| rest));
    beside.flat_map(|part| part.split(|c: char| !c.is_alphabetic())).filter(|word| !word.is_empty()).count()
}

/// Whether a message of the page is a part of a sentence; `…` stands for anything.
fn explains(span: &str, text: &str) -> bool {
    let parts = span.split('…').map(|part| part.trim_matches(|c: char| c.is_whitespace() || ".,:;".contains(c)));
    let parts: Vec<&str> = parts.filter(|part| part.len() >= LETTERS).collect();
    let mut rest = Some(text);
    for part in &parts {
        rest = rest.and_then(|rest| rest.split_once(part)).map(|(_, rest)| rest);
    }
    !parts.is_empty() && rest.is_some()
}

/// Joins the lines of a literal, and removes the escapes that messages have.
pub(crate) fn joined(literal: &str) -> String {
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
    fn first_pages_without_notice_are_found() {
        let core = ("crates/core/src/lib.rs", "pub const NOTICE: &str = \"For trials.\";");
        let sources = Sources::of(&[core, ("README.md", "**For trials.**"), ("docs/start.md", "For all.")]);
        assert_eq!(sentences(notice(&sources)), ["docs/start.md:1: does not say \"For trials.\""]);
    }

    #[test]
    fn unexplained_errors_and_warnings_are_found() {
        let page = "| message | cure |\n|---|---|\n| `the … is not there`, `it is slow` | `the disk is full` |\n";
        let code = "
            #[derive(thiserror::Error)]
            enum E {
                #[error(\"{path}: the {what} is not there; plug it in\")] Explained,
                #[error(\"{path}: the disk is full; make room\")] Unexplained,
                #[error(\"{path}: reading {source}\")] OtherWords,
            }
            fn f() { warn!(\"{x}: it is slow\"); tracing::error!(count = 3, \"it is too slow\"); }";
        let sources = Sources::of(&[("docs/trouble.md", page), ("src/a.rs", code), ("src/tests.rs", code)]);
        let expected = [
            "src/a.rs:5: docs/trouble.md does not explain \"{path}: the disk is full; make room\"",
            "src/a.rs:8: docs/trouble.md does not explain \"it is too slow\"",
        ];
        assert_eq!(sentences(unexplained(&sources)), expected);
    }

    #[test]
    fn messages_of_no_source_are_found() {
        let page = "| message | cure |\n|---|---|\n| `is not \"there\"; plug …`, `it in` | `none` |\n| `is lost` | |\n";
        let code = "fn f() { say(\"{x} is not \\\"there\\\"; \\\n    plug {y}: it in\"); } // is lost\n";
        let sources = Sources::of(&[("docs/trouble.md", page), ("src/a.rs", code), ("src/tests.rs", "\"is lost\"")]);
        assert_eq!(sentences(messages(&sources)), ["docs/trouble.md:4: no source has the words \"is lost\""]);
    }
}

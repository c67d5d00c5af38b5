//! Comments: width, first words of sentences and lines, length of sentences.

use crate::findings::Finding;
use crate::lexer::{Kind, Token};
use crate::sources::Source;

/// Widest line that ends with a comment, columns.
const COLUMNS: usize = 100;

/// Longest sentence, words. Code between backticks is one word.
const WORDS: usize = 30;

/// Words that begin an inverted sentence.
const INVERTED: [&str; 9] = ["What", "How", "Of", "Who", "Whoever", "Whatever", "Whose", "Whom", "Whatsoever"];

/// Words whose dot does not end a sentence.
const ABBREVIATIONS: [&str; 18] = [
    "e.g.", "i.e.", "cf.", "vs.", "etc.", "Eq.", "Eqs.", "eq.", "Fig.", "Figs.", "fig.", "Sec.", "No.", "no.", "p.",
    "pp.", "al.", "approx.",
];

/// A line of a comment.
pub(crate) struct Line<'a> {
    pub(crate) number: usize,
    /// `//`, `///`, `//!` or `/*`; `#` of scripts, and nothing of Markdown.
    pub(crate) marker: &'a str,
    /// The text behind the marker.
    pub(crate) text: &'a str,
}

/// Returns all findings in the comments of a file.
pub(crate) fn check(source: &Source) -> Vec<Finding> {
    let file = &source.path;
    let lines: Vec<&str> = source.text.lines().collect();
    let comments: Vec<Line> =
        source.tokens.iter().filter(|t| t.kind == Kind::Comment).flat_map(comment_lines).collect();
    let mut findings = Vec::new();
    findings.extend(comments.iter().filter_map(|comment| is_narrow(file, comment.number, lines[comment.number - 1])));
    findings.extend(check_prose(file, &without_fences(comments)));
    findings.dedup();
    findings
}

/// Returns a finding if a line is too wide. Rows of tables and addresses cannot be split.
pub(crate) fn is_narrow(file: &str, number: usize, line: &str) -> Option<Finding> {
    let columns = line.chars().count();
    let is_table = line.trim_start().trim_start_matches(['/', '!']).trim_start().starts_with('|');
    let is_wide = columns > COLUMNS && !line.contains("http") && !is_table;
    is_wide.then(|| Finding::new(file, number, format!("{columns} columns, of at most {COLUMNS}")))
}

/// Returns the findings in the sentences of consecutive lines.
pub(crate) fn check_prose(file: &str, prose: &[Line]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for line in prose {
        if let Some(word) = inverted(line.text) {
            findings.push(Finding::new(file, line.number, format!("a line of a text begins with {word:?}")));
        }
    }
    for paragraph in paragraphs(prose) {
        for sentence in sentences(&paragraph) {
            check_sentence(file, sentence, &mut findings);
        }
    }
    findings
}

/// Splits a comment into its lines, without markers.
fn comment_lines<'a>(token: &Token<'a>) -> Vec<Line<'a>> {
    let text = token.text;
    let marker = match text.as_bytes() {
        [b'/', b'*', ..] => "/*",
        [b'/', b'/', b'!', ..] => "//!",
        [b'/', b'/', b'/', ..] => "///",
        _ => "//",
    };
    let body = if marker == "/*" { text[2..].trim_end_matches("*/") } else { &text[marker.len()..] };
    let lines = body.split('\n').enumerate().map(|(i, text)| {
        let text = if marker == "/*" { text.trim_start().trim_start_matches('*') } else { text };
        Line { number: token.line + i, marker, text: text.trim() }
    });
    lines.collect()
}

/// Removes code between fences. A fence ends with its comment at the latest.
fn without_fences(lines: Vec<Line>) -> Vec<Line> {
    let mut is_code = false;
    let mut last = 0;
    let mut kept = Vec::new();
    for line in lines {
        is_code &= line.number <= last + 1;
        last = line.number;
        if line.text.starts_with("```") {
            is_code = !is_code;
        } else if !is_code {
            kept.push(line);
        }
    }
    kept
}

/// Returns the words of each paragraph with their lines. Bullets, rows of tables, headings and
/// trailing comments begin paragraphs of their own.
fn paragraphs(lines: &[Line]) -> Vec<Vec<(String, usize)>> {
    let mut all: Vec<Vec<&Line>> = Vec::new();
    let mut last: Option<&Line> = None;
    for line in lines {
        let goes_on = last.is_some_and(|l| {
            line.number == l.number + 1 && line.marker == l.marker && !l.text.is_empty() && !l.text.starts_with('#')
        });
        let is_item = line.text.starts_with("- ")
            || line.text.starts_with("* ")
            || line.text.starts_with('#')
            || is_numbered(line.text);
        last = Some(line);
        if line.text.is_empty() || line.text.starts_with('|') {
            last = None;
        } else if goes_on && !is_item {
            all.last_mut().expect("a paragraph goes on").push(line);
        } else {
            all.push(vec![line]);
        }
    }
    all.iter().map(|lines| words(lines)).collect()
}

fn is_numbered(text: &str) -> bool {
    let rest = text.trim_start_matches(|c: char| c.is_ascii_digit());
    rest.len() < text.len() && rest.starts_with(". ")
}

/// Returns the words of a paragraph with their lines. Code between backticks becomes `_`, so that
/// it neither splits nor ends a sentence.
fn words(lines: &[&Line]) -> Vec<(String, usize)> {
    let mut all = Vec::new();
    let mut word = String::new();
    let mut begin = 0;
    let mut ticks: usize = lines.iter().map(|l| l.text.matches('`').count()).sum();
    let mut is_code = false;
    for line in lines {
        for c in line.text.chars().chain([' ']) {
            if c == '`' {
                ticks -= 1;
                // The last backtick of an odd number opens nothing.
                if is_code {
                    is_code = false;
                } else if ticks > 0 {
                    is_code = true;
                }
            }
            if is_code && c != '`' {
                continue;
            }
            if !c.is_whitespace() {
                if word.is_empty() {
                    begin = line.number;
                }
                word.push(if c == '`' { '_' } else { c });
            } else if !word.is_empty() {
                all.push((std::mem::take(&mut word), begin));
            }
        }
    }
    let bullets = all.iter().take_while(|(w, _)| matches!(w.as_str(), "-" | "*" | "•") || is_bullet_number(w)).count();
    all.split_off(bullets)
}

fn is_bullet_number(word: &str) -> bool {
    word.strip_suffix('.').is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
}

/// Splits a paragraph behind `.`, `!`, `?`, `;` and `:`.
fn sentences(words: &[(String, usize)]) -> Vec<&[(String, usize)]> {
    words.split_inclusive(|(word, _)| ends_sentence(word)).collect()
}

fn ends_sentence(word: &str) -> bool {
    let word = word.trim_start_matches(['(', '[', '"', '“', '*']).trim_end_matches([')', '"', '”', '*']);
    word.ends_with(['.', '!', '?', ';', ':']) && !ABBREVIATIONS.contains(&word)
}

fn check_sentence(file: &str, sentence: &[(String, usize)], findings: &mut Vec<Finding>) {
    let Some((first, line)) = sentence.first() else { return };
    if let Some(word) = inverted(first) {
        findings.push(Finding::new(file, *line, format!("a sentence begins with {word:?}")));
    }
    if sentence.len() > WORDS {
        let begin: Vec<&str> = sentence.iter().take(6).map(|(w, _)| w.as_str()).collect();
        let sentence = format!("{} words, of at most {WORDS}: {} …", sentence.len(), begin.join(" "));
        findings.push(Finding::new(file, *line, sentence));
    }
}

/// Returns the word that a text must not begin with, if it does.
fn inverted(text: &str) -> Option<&'static str> {
    let text = text.trim_start_matches(['-', '*', '•', '(', ' ']);
    let rest = text.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_');
    let word = &text[..text.len() - rest.len()];
    INVERTED.into_iter().find(|w| *w == word)
}

#[cfg(test)]
mod tests {
    use super::check;
    use crate::sources::Sources;

    fn sentences(text: &str) -> Vec<String> {
        Sources::of(&[("a.rs", text)]).rust().flat_map(check).map(|f| format!("{}: {}", f.line, f.sentence)).collect()
    }

    #[test]
    fn wide_comment_is_found_in_columns_not_bytes() {
        let width = |n: usize| format!("let a = 1; // {}\n", "ä".repeat(n - 14));
        assert_eq!(sentences(&width(100)), [""; 0]);
        assert_eq!(sentences(&width(101)), ["1: 101 columns, of at most 100"]);
        assert_eq!(sentences(&format!("//! | {} |\n", "a ".repeat(60))), [""; 0]);
        assert_eq!(sentences(&format!("let a = {:?};\n", "// a ".repeat(60))), [""; 0]);
    }

    #[test]
    fn inverted_sentence_is_found() {
        assert_eq!(sentences("/// Right. What is\n/// wrong.\n"), ["1: a sentence begins with \"What\""]);
        assert_eq!(
            sentences("/// See (Fig. 3, i.e. Of) whose\n/// How long."),
            ["2: a line of a text begins with \"How\""]
        );
        assert_eq!(sentences("/* Right.\n * Who. */\n").len(), 2);
        assert_eq!(sentences("/// ```\n///\n/// What = 1;\n/// ```\n/// Whatever's end\n").len(), 2);
        assert_eq!(sentences("/// Off, whatever, `a. What b` and Howard.\nlet a = \"What\";\n"), [""; 0]);
    }

    #[test]
    fn long_sentence_is_found_across_lines() {
        let words = |n: usize| "w ".repeat(n).trim_end().to_owned();
        assert_eq!(sentences(&format!("// {}\n// {}.\n", words(15), words(16))).len(), 1);
        assert_eq!(sentences(&format!("// {}\n// {}\n", words(14), words(16))), [""; 0]);
        assert_eq!(sentences(&format!("// {}\n// `{}`\n", words(14), words(16))), [""; 0]);
        assert_eq!(sentences(&format!("// {}\n//\n// {}\n", words(20), words(20))), [""; 0]);
        assert_eq!(sentences(&format!("// {}\n// - {}\n", words(20), words(20))), [""; 0]);
        assert_eq!(sentences(&format!("// {} e.g. {}\n", words(15), words(15))).len(), 1);
    }
}

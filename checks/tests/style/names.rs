//! Names: of test functions, and of types and modules with retired words.

use std::collections::BTreeMap;

use crate::findings::Finding;
use crate::known::{self, Known};
use crate::lexer::Token;
use crate::sources::{Source, Sources};

/// Longest name of a test function, characters.
const TEST_NAME: usize = 60;

/// Keywords before the names of types and modules.
const DEFINITIONS: [&str; 5] = ["struct", "enum", "trait", "type", "mod"];

/// Metaphors that gave way to the field's terms. No name may contain one, in singular or plural.
const RETIRED: &str = "\
    bed cloth coach conduct counsel crowd cutter deed desk dialect doubt dress dresser easel \
    fabric fate gather glance heard intake ladder law linger loom matter onlooker onto onward \
    pencil precedent rehearsal rung said seal seat shelf sight sitting swatch teller telling \
    told trial weave weaver weaving wish witness woven";

/// Those of them without another plain sense. No identifier may contain one: functions, fields and
/// variables have the words of their things, too.
const METAPHORS: &str = "\
    cloth conduct counsel crowd cutter deed desk dialect dresser easel fabric glance intake ladder linger loom \
    onlooker onward precedent rehearsal rung sitting telling weave weaver weaving wish witness woven";

/// Returns the identifiers that contain a metaphor, once a line.
pub(crate) fn metaphors(source: &Source) -> Vec<Finding> {
    let mut findings = Vec::new();
    for name in source.code().iter().filter(|token| token.is_word()) {
        if let Some(word) = word_of(name.text, METAPHORS) {
            let sentence = format!("{} has the metaphor {word:?} in its name", name.text);
            findings.push(Finding::new(&source.path, name.line, sentence));
        }
    }
    findings.dedup();
    findings
}

/// A type or module whose name has a retired word.
pub(crate) struct Retired {
    /// Folder of the crate, or of the root crate's sources or tests.
    area: String,
    /// Keyword and name.
    name: String,
    finding: Finding,
}

/// Returns the test functions with long or wrongly formed names.
pub(crate) fn tests(source: &Source) -> Vec<Finding> {
    let file = &source.path;
    let code = source.code();
    let mut findings = Vec::new();
    for at in 0..code.len() {
        let Some(name) = test_name(&code, at) else { continue };
        let length = name.text.chars().count();
        if length > TEST_NAME {
            let sentence = format!("the test's name has {length} characters, of at most {TEST_NAME}: {}", name.text);
            findings.push(Finding::new(file, name.line, sentence));
        }
        if !name.text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_') {
            let sentence = format!("the test's name is not in lower snake case: {}", name.text);
            findings.push(Finding::new(file, name.line, sentence));
        }
    }
    findings
}

/// Returns the name of the function behind `#[test]` or `#[path::test]`, if that begins here.
fn test_name<'a>(code: &[Token<'a>], at: usize) -> Option<Token<'a>> {
    if !code[at].is("#") || !code.get(at + 1)?.is("[") {
        return None;
    }
    let end = at + code[at..].iter().position(|t| t.is("]"))?;
    let path = &code[at + 2..end];
    if !path.last()?.is("test") || !path.iter().all(|t| t.is_word() || t.is(":")) {
        return None;
    }
    let function = end + code[end..].iter().position(|t| t.is("fn"))?;
    code.get(function + 1).filter(|t| t.is_word()).copied()
}

/// Returns the definitions of types and modules that have a retired word in their names.
pub(crate) fn retired(sources: &Sources) -> Vec<Retired> {
    let mut all = Vec::new();
    for source in sources.rust() {
        let file = &source.path;
        let code = source.code();
        for pair in code.windows(2) {
            let [keyword, name] = pair else { continue };
            if !name.is_word() || !DEFINITIONS.iter().any(|d| keyword.is(d)) {
                continue;
            }
            let Some(word) = retired_word(name.text) else { continue };
            let sentence = format!("{} {} has the retired word {word:?} in its name", keyword.text, name.text);
            all.push(Retired {
                area: area(file).to_owned(),
                name: format!("{} {}", keyword.text, name.text),
                finding: Finding::new(file, name.line, sentence),
            });
        }
    }
    all
}

/// Returns the first retired word of a name, such as `seat` of `ViewerSeats` and of `free_seat`.
fn retired_word(name: &str) -> Option<&'static str> {
    word_of(name, RETIRED)
}

/// Returns the first word of a name that is in a list.
fn word_of(name: &str, list: &'static str) -> Option<&'static str> {
    let mut words = vec![String::new()];
    for c in name.chars() {
        if c == '_' || c.is_uppercase() {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| c != '_') {
            word.extend(c.to_lowercase());
        }
    }
    let is = |word: &str, retired: &str| word.strip_prefix(retired).is_some_and(|end| matches!(end, "" | "s" | "es"));
    words.iter().find_map(|word| list.split_whitespace().find(|retired| is(word, retired)))
}

/// Returns the folder in front of `/src/`, `src` for the root's, or else a file's folder.
fn area(file: &str) -> &str {
    if file.starts_with("src/") {
        return "src";
    }
    let end = file.find("/src/").or_else(|| file.rfind('/')).unwrap_or(file.len());
    &file[..end]
}

/// Writes the list of names by area.
pub(crate) fn list(all: &[Retired]) -> String {
    let mut areas: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for retired in all {
        areas.entry(retired.area.clone()).or_default().push(retired.name.clone());
    }
    for names in areas.values_mut() {
        names.sort();
    }
    known::format(areas)
}

/// Returns the names that are not listed, and the listed ones that are gone.
pub(crate) fn compare(found: &[Retired], known: &Known) -> Vec<Finding> {
    let mut rest: Vec<(&str, &str)> =
        known.0.iter().flat_map(|(area, names)| names.iter().map(move |n| (area.as_str(), n.as_str()))).collect();
    let mut findings = Vec::new();
    for retired in found {
        match rest.iter().position(|known| *known == (retired.area.as_str(), retired.name.as_str())) {
            Some(at) => drop(rest.swap_remove(at)),
            None => findings.push(retired.finding.clone()),
        }
    }
    let gone = |(area, name)| {
        Finding::new("checks/tests/style/names.txt", 1, format!("{area} has no {name} any more: remove it here"))
    };
    findings.extend(rest.into_iter().map(gone));
    findings
}

#[cfg(test)]
mod unit {
    use super::*;

    #[test]
    fn long_and_mixed_test_names_are_found() {
        let long = "a".repeat(61);
        let text = format!(
            "#[test]\n#[ignore = \"x\"]\nfn {long}() {{}}\n#[cfg(test)]\nfn Other() {{}}\n#[test]\nfn wRong() {{}}"
        );
        let found: Vec<usize> = Sources::of(&[("a.rs", &text)]).rust().flat_map(tests).map(|f| f.line).collect();
        assert_eq!(found, [3, 7]);
    }

    #[test]
    fn retired_words_are_found_within_names() {
        assert_eq!(retired_word("ViewerSeats"), Some("seat"));
        assert_eq!(retired_word("free_wishes"), Some("wish"));
        assert_eq!(retired_word("Toldest"), None);
        assert_eq!(retired_word("Lawn"), None);
    }

    #[test]
    fn metaphors_are_found_in_identifiers_only() {
        let text = "fn f(loom: u8) {\n    // the loom\n    let text = \"loom\";\n    weaveSlice(bloom)\n}\n";
        let found: Vec<usize> = Sources::of(&[("a.rs", text)]).rust().flat_map(metaphors).map(|f| f.line).collect();
        assert_eq!(found, [1, 4]);
        assert_eq!(word_of("WovenSlices", METAPHORS), Some("woven"));
        assert_eq!(word_of("sonoweave_core", METAPHORS), None);
    }

    #[test]
    fn new_and_gone_names_are_found() {
        let sources = Sources::of(&[("crates/a/src/x.rs", "struct Loom;\n// struct Desk;\nenum Wishes {}\n")]);
        let known = Known::parse("crates/a\n    struct Loom\n    struct Seat\n");
        let found: Vec<(String, usize)> =
            compare(&retired(&sources), &known).into_iter().map(|f| (f.file, f.line)).collect();
        assert_eq!(found, [("crates/a/src/x.rs".to_owned(), 3), ("checks/tests/style/names.txt".to_owned(), 1)]);
    }
}

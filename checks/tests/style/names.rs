//! Names: of test functions, and of types and modules with retired words.

use crate::findings::Finding;
use crate::lexer::Token;
use crate::sources::Source;

/// Longest name of a test function, characters.
const TEST_NAME: usize = 60;

/// Keywords before the names of types and modules.
const DEFINITIONS: [&str; 5] = ["struct", "enum", "trait", "type", "mod"];

/// Metaphors that gave way to the field's terms. No name may contain one, in singular or plural.
const RETIRED: &str = "\
    bed cloth coach conduct counsel crowd cutter deed desk dialect doubt dress dresser easel \
    fabric fate gather glance heard held intake ladder law linger loom matter onlooker onto onward \
    pencil precedent rehearsal rung said seal seat shelf shown sight sitting swatch teller telling \
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
pub(crate) fn retired(source: &Source) -> Vec<Finding> {
    let code = source.code();
    let definitions = code.windows(2).filter(|pair| pair[1].is_word() && DEFINITIONS.iter().any(|d| pair[0].is(d)));
    let findings = definitions.filter_map(|pair| {
        let word = word_of(pair[1].text, RETIRED)?;
        let sentence = format!("{} {} has the retired word {word:?} in its name", pair[0].text, pair[1].text);
        Some(Finding::new(&source.path, pair[1].line, sentence))
    });
    findings.collect()
}

/// Returns the first word of a name that is in a list, such as `seat` of `ViewerSeats` and of
/// `free_seat`.
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

#[cfg(test)]
mod unit {
    use super::*;
    use crate::sources::Sources;

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
        assert_eq!(word_of("ViewerSeats", RETIRED), Some("seat"));
        assert_eq!(word_of("free_wishes", RETIRED), Some("wish"));
        assert_eq!(word_of("Toldest", RETIRED), None);
        assert_eq!(word_of("Lawn", RETIRED), None);
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
    fn definitions_with_retired_words_are_found() {
        let text = "struct Loom;\n// struct Desk;\nenum Wishes {}\nstruct Lawn;\n";
        let found: Vec<usize> = Sources::of(&[("a.rs", text)]).rust().flat_map(retired).map(|f| f.line).collect();
        assert_eq!(found, [1, 3]);
    }
}

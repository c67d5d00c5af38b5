//! The list, and how its mutants are put into a source.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;

/// One error, and the test that must notice it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mutant {
    /// What is wrong with it, in a few words.
    pub(crate) name: String,
    /// The source, from the project's root.
    pub(crate) file: String,
    /// An expression, or whole statements up to their last semicolon that name nothing used later.
    original: String,
    /// What stands there instead; may be empty for statements.
    mutated: String,
    /// A text that holds the original and occurs once, where the original alone does not.
    #[serde(default)]
    within: Option<String>,
    /// `lib` (the tests in the source) or the name of a target in `tests/`; of another crate with its folder before it, `drivers/lib`.
    pub(crate) suite: String,
    /// Which of its tests: part of their names.
    pub(crate) test: String,
}

#[derive(Deserialize)]
struct List {
    mutant: Vec<Mutant>,
}

pub(crate) fn read() -> Vec<Mutant> {
    let list: List = toml::from_str(include_str!("list.toml")).expect("tests/mutants/list.toml");
    let names: BTreeSet<&str> = list.mutant.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names.len(), list.mutant.len(), "tests/mutants/list.toml: two mutants of one name");
    list.mutant
}

/// The tests that mutants name, each once.
pub(crate) fn tests(mutants: &[Mutant]) -> BTreeSet<(String, String)> {
    mutants.iter().map(|m| (m.suite.clone(), m.test.clone())).collect()
}

impl Mutant {
    /// Where the original stands in its source.
    fn place(&self, source: &str) -> Result<usize, String> {
        let gone = |what: &str, text: &str, count: usize| {
            format!(
                "mutant {:?} no longer applies to {}: its {what} occurs {count} times, not once. Update it in tests/mutants/list.toml.\n{text}",
                self.name, self.file
            )
        };
        let once = |what: &str, text: &str, place: &str| match place.matches(text).count() {
            1 => Ok(place.find(text).unwrap_or_default()),
            count => Err(gone(what, text, count)),
        };
        match &self.within {
            None => once("original text", &self.original, source),
            Some(within) => {
                Ok(once("surrounding text", within, source)? + once("original text", &self.original, within)?)
            }
        }
    }
}

/// A file's source with all its mutants in it, each behind its switch.
pub(crate) fn switched(file: &str, source: &str, mutants: &[Mutant]) -> Result<String, String> {
    // Several mutants may change one text.
    let mut places: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (number, mutant) in mutants.iter().enumerate().filter(|(_, m)| m.file == file) {
        places.entry(mutant.place(source)?).or_default().push(number);
    }
    let mut result = String::new();
    let mut done = 0;
    for (place, numbers) in places {
        let original = &mutants[numbers[0]].original;
        if place < done || numbers.iter().any(|n| mutants[*n].original != *original) {
            return Err(format!("mutant {:?} changes a text that another changes in part", mutants[numbers[0]].name));
        }
        result += &source[done..place];
        let arms: String = numbers
            .iter()
            .map(|n| format!("if crate::mutants::is_on({n}) {{ {} }} else ", mutants[*n].mutated))
            .collect();
        let statements = original.trim_end().ends_with(';');
        let (open, close) = if statements { ("{ ", " }") } else { ("(", ")") };
        result += &format!("{open}{arms}{{ {original} }}{close}");
        done = place + original.len();
    }
    result += &source[done..];
    Ok(result)
}

/// The switch, appended to the library.
pub(crate) const SWITCH: &str = r#"
#[allow(missing_docs)]
pub mod mutants {
    static ON: std::sync::LazyLock<Option<u32>> =
        std::sync::LazyLock::new(|| std::env::var("SONOWEAVE_MUTANT").ok().and_then(|n| n.parse().ok()));
    pub fn is_on(number: u32) -> bool {
        *ON == Some(number)
    }
}
"#;

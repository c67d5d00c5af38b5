//! The list of mutants, and their insertion into the sources.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize;

/// An error, and the test that must detect it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Mutant {
    /// Short description of the error.
    pub(crate) name: String,
    /// The source, relative to the project's root.
    pub(crate) file: String,
    /// An expression, or whole statements up to their last semicolon that name nothing used
    /// later.
    pub(crate) original: String,
    /// Its replacement; may be empty for statements.
    mutated: String,
    /// A text that contains the original and occurs once, if the original alone does not.
    #[serde(default)]
    within: Option<String>,
    /// `lib` (the tests in the source) or the name of a target in `tests/`. For a crate other
    /// than the root's, preceded by the last name of its folder: `drivers/lib`.
    pub(crate) suite: String,
    /// Filter of its tests: part of their names.
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

impl Mutant {
    /// Returns the position of the original in its source.
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

/// Returns a file's source with all its mutants in it, each behind its switch.
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

/// The switch, appended to each library that has mutants.
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

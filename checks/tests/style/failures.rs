//! Sentences of the program's own failures, which are texts: each says what to do, or passes on an
//! error that does.

use std::io::Write as _;

use crate::errors::{is_test, placeholders, unquoted};
use crate::findings::Finding;
use crate::lexer::Kind;
use crate::messages::instructs;
use crate::sources::{Source, Sources};

/// Macro, type and closures that a failure is made by.
const MAKERS: [&str; 4] = ["fail", "fail_usage", "Failure", "within"];

/// Names of values with errors that are walked elsewhere, or with words of advice.
const PASSED_ON: &str = "advice e error flag flags hint none problem question remedy why";

/// Verdicts, after which a user has nothing to mend.
const VERDICTS: [&str; 2] = ["more than --limit", "differs from the live session"];

/// Checks all failures, and says how many there are.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let ours = sources.rust().filter(|source| source.path.starts_with("src/") && !is_test(&source.path));
    let all: Vec<Failure> = ours.flat_map(of_source).collect();
    // The harness captures what macros print.
    let _ = writeln!(std::io::stderr(), "{} failures of the program walked", all.len());
    let poor = all.into_iter().filter(|failure| !is_helpful(&failure.text));
    poor.map(|Failure { file, line, text }| Finding::new(&file, line, format!("does not say what to do: {text:?}")))
        .collect()
}

/// A failure's text, where it is made.
struct Failure {
    file: String,
    line: usize,
    text: String,
}

fn of_source(source: &Source) -> Vec<Failure> {
    let code = source.code();
    let is_made = |at: &usize| MAKERS.iter().any(|maker| code[*at].is(maker));
    let text = |at: usize| {
        let skipped = |sign: &str| ["!", "(", "format", "&", "path", ",", ":", "usage", "new"].contains(&sign);
        let first = code[at + 1..].iter().find(|token| token.kind == Kind::Literal || !skipped(token.text))?;
        let is_text = first.kind == Kind::Literal && first.text.contains('"');
        is_text.then(|| Failure { file: source.path.clone(), line: first.line, text: unquoted(first.text) })
    };
    (0..code.len()).filter(is_made).filter_map(text).collect()
}

/// Whether a sentence instructs, gives a verdict, or ends with an error or advice.
fn is_helpful(text: &str) -> bool {
    let passes_on = placeholders(text).iter().any(|place| {
        let is_advice = PASSED_ON.split_whitespace().any(|name| name == place.name);
        // Values follow an error: a flag, the counts of the frames that were left out.
        let is_last = place.rest.split_inclusive('}').all(|part| part.starts_with('{') && part.ends_with('}'));
        is_advice && is_last
    });
    instructs(text) || passes_on || VERDICTS.iter().any(|verdict| text.contains(verdict))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_without_advice_are_found() {
        let text = r#"
            fn f() {
                fail!("{}: is odd", x);
                fail!("{}: is odd; give another", x);
                let a = Failure(format!("{}: is \
                    even", x));
                let b = Failure(format!("{x}: {why}"));
                let c = Failure("is odd".into());
                let d = within(path, format!("takes {n}"));
                let e = Failure(sentence);
            }"#;
        let sources =
            Sources::of(&[("src/app/a.rs", text), ("src/app/tests/b.rs", text), ("crates/a/src/lib.rs", text)]);
        let found: Vec<(usize, String)> =
            check(&sources).into_iter().map(|found| (found.line, found.sentence)).collect();
        let says = |text: &str| format!("does not say what to do: {text:?}");
        let expected = [(3, says("{}: is odd")), (5, says("{}: is even")), (8, says("is odd")), (9, says("takes {n}"))];
        assert_eq!(found, expected);
    }
}

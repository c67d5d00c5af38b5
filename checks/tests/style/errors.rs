//! Variants of error types: their sentences, and the fields in them, as the sources define them.

use std::collections::BTreeMap;

use crate::lexer::{Kind, Token};
use crate::sources::{Source, Sources};

/// A variant of an error type; or a struct that is an error, which has one sentence.
#[derive(Debug)]
pub(crate) struct Variant {
    pub(crate) file: String,
    pub(crate) line: usize,
    /// The type, and the variant's name; that of the type for a struct.
    pub(crate) of: String,
    pub(crate) name: String,
    /// Sentence with its placeholders, and the texts of constants; `None` if it is that of the only
    /// field.
    pub(crate) text: Option<String>,
    /// The rest of the attribute: values of the placeholders.
    pub(crate) arguments: String,
    /// Names of the fields, or their numbers, and their types.
    pub(crate) fields: Vec<(String, String)>,
}

/// A placeholder of a sentence.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Placeholder<'a> {
    /// Field or argument; empty if it is computed.
    pub(crate) name: &'a str,
    /// Format behind the colon.
    pub(crate) format: &'a str,
    /// The sentence behind it.
    pub(crate) rest: &'a str,
}

impl Variant {
    /// Returns the type of a field, if it is one.
    pub(crate) fn field(&self, name: &str) -> Option<&str> {
        self.fields.iter().find(|(field, _)| field == name).map(|(_, of)| of.as_str())
    }

    /// Returns the name by which code refers to the variant.
    pub(crate) fn path(&self) -> String {
        if self.of == self.name { self.of.clone() } else { format!("{}::{}", self.of, self.name) }
    }
}

/// Returns the placeholders of a sentence, in order.
pub(crate) fn placeholders(text: &str) -> Vec<Placeholder<'_>> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find('{') {
        let inner = &rest[at + 1..];
        if let Some(behind) = inner.strip_prefix('{') {
            rest = behind;
            continue;
        }
        let Some((inside, behind)) = inner.split_once('}') else { break };
        let (name, format) = inside.split_once(':').unwrap_or((inside, ""));
        found.push(Placeholder { name, format, rest: behind });
        rest = behind;
    }
    found
}

/// Returns the error variants of all sources but tests.
pub(crate) fn variants(sources: &Sources) -> Vec<Variant> {
    let constants = constants(sources);
    let mut all: Vec<Variant> = sources.rust().filter(|source| !is_test(&source.path)).flat_map(of_source).collect();
    for text in all.iter_mut().filter_map(|variant| variant.text.as_mut()) {
        for (name, value) in &constants {
            *text = text.replace(&format!("{{{name}}}"), value);
        }
    }
    all
}

/// Returns the texts of constants, by name.
pub(crate) fn constants(sources: &Sources) -> BTreeMap<&'static str, String> {
    let mut found = BTreeMap::new();
    for source in sources.rust().filter(|source| !is_test(&source.path)) {
        // const NAME: &str = "…"
        for part in source.code().windows(7).filter(|part| part[0].is("const") && part[6].kind == Kind::Literal) {
            found.insert(part[1].text, unquoted(part[6].text));
        }
    }
    found
}

/// Whether a source is of tests, benches or other programs.
pub(crate) fn is_test(path: &str) -> bool {
    let inner = path.contains("/tests/") || path.ends_with("/tests.rs") || path.contains("/benches/");
    inner || ["tests/", "benches/", "figures/", "checks/", "scripts/"].iter().any(|folder| path.starts_with(folder))
}

fn of_source(source: &Source) -> Vec<Variant> {
    let code = source.code();
    let mut found = Vec::new();
    let mut at = 0;
    while at < code.len() {
        let is_error = attribute(&code, at).is_some_and(|(inner, _)| {
            inner.first().is_some_and(|token| token.is("derive")) && inner.iter().any(|token| token.is("Error"))
        });
        at += 1;
        if is_error {
            found.extend(item(source, &code, at - 1));
        }
    }
    found
}

/// Returns the tokens inside an attribute that begins at `at`, and the position behind it.
fn attribute<'a>(code: &'a [Token<'static>], at: usize) -> Option<(&'a [Token<'static>], usize)> {
    let begins = code.get(at)?.is("#") && code.get(at + 1)?.is("[");
    let end = begins.then(|| closing(code, at + 1)).flatten()?;
    Some((&code[at + 2..end], end + 1))
}

/// Returns the position of the bracket that closes the one at `at`.
pub(crate) fn closing(code: &[Token<'_>], at: usize) -> Option<usize> {
    let mut depth = 0_usize;
    for (n, token) in code.iter().enumerate().skip(at).filter(|(_, token)| token.kind == Kind::Sign) {
        match token.text {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => {
                depth -= 1;
                if depth == 0 {
                    return Some(n);
                }
            }
            _ => {}
        }
    }
    None
}

/// Returns sentence and arguments of an attribute `error(…)`, if it is one. A transparent one has
/// no sentence.
fn sentence(inner: &[Token<'static>]) -> Option<(Option<String>, String)> {
    if !inner.first()?.is("error") {
        return None;
    }
    let at = inner.iter().position(|token| token.kind == Kind::Literal);
    let end = inner.len() - 1;
    let rest = inner[at.map_or(end, |at| at + 1)..end].iter().map(|token| token.text).collect();
    Some((at.map(|at| unquoted(inner[at].text)), rest))
}

/// Returns the text of a string literal.
pub(crate) fn unquoted(literal: &str) -> String {
    let text = crate::book::joined(literal);
    let text = text.trim_start_matches(['r', '#']).trim_end_matches('#');
    text.strip_prefix('"').and_then(|text| text.strip_suffix('"')).unwrap_or(text).to_owned()
}

/// Returns the variants of the type whose attributes begin at `at`.
fn item(source: &Source, code: &[Token<'static>], mut at: usize) -> Vec<Variant> {
    let mut own = None;
    while let Some((inner, behind)) = attribute(code, at) {
        own = own.or(sentence(inner));
        at = behind;
    }
    let Some(keyword) = (at..code.len()).find(|n| code[*n].is("enum") || code[*n].is("struct")) else {
        return Vec::new();
    };
    let name = code[keyword + 1];
    let variant = |token: Token<'_>, said: Option<(Option<String>, String)>, fields| {
        let (text, arguments) = said.unwrap_or_default();
        let (file, of) = (source.path.clone(), name.text.to_owned());
        Variant { file, line: token.line, of, name: token.text.to_owned(), text, arguments, fields }
    };
    let Some(open) = (keyword..code.len()).find(|n| code[*n].is("{") || code[*n].is("(") || code[*n].is(";")) else {
        return Vec::new();
    };
    let Some(end) = closing(code, open) else { return Vec::new() };
    if code[keyword].is("struct") {
        return vec![variant(name, own, fields(&code[open..=end]))];
    }
    let mut found = Vec::new();
    let (mut next, mut text) = (open + 1, None);
    while next < end {
        if let Some((inner, behind)) = attribute(code, next) {
            text = text.or(sentence(inner));
            next = behind;
        } else if code[next].is_word() {
            let is_open = code[next + 1].is("{") || code[next + 1].is("(");
            let close = if is_open { closing(code, next + 1).unwrap_or(end) } else { next };
            let of_variant = if is_open { fields(&code[next + 1..=close]) } else { Vec::new() };
            found.push(variant(code[next], text.take(), of_variant));
            next = close + 1;
        } else {
            next += 1;
        }
    }
    found
}

/// Returns the fields between brackets: names or numbers, and types.
fn fields(code: &[Token<'static>]) -> Vec<(String, String)> {
    let is_named = code[0].is("{");
    let mut found = Vec::new();
    let mut at = 1;
    while at + 1 < code.len() {
        if let Some((_, behind)) = attribute(code, at) {
            at = behind;
            continue;
        }
        let mut depth = 0_i32;
        let end = (at..code.len() - 1).find(|n| {
            depth += i32::from(["<", "(", "["].iter().any(|sign| code[*n].is(sign)));
            depth -= i32::from([">", ")", "]"].iter().any(|sign| code[*n].is(sign)));
            depth == 0 && code[*n].is(",")
        });
        let end = end.unwrap_or(code.len() - 1);
        let part: Vec<&Token<'_>> = code[at..end].iter().filter(|token| !token.is("pub")).collect();
        let words = |part: &[&Token<'_>]| part.iter().map(|token| token.text).collect::<String>();
        match part.as_slice() {
            [] => {}
            [name, colon, of @ ..] if is_named && colon.is(":") => found.push((name.text.to_owned(), words(of))),
            of => found.push((found.len().to_string(), words(of))),
        }
        at = end + 1;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_have_sentences_and_fields() {
        let text = "
            /// Doc.
            #[derive(Debug, thiserror::Error)]
            pub enum E {
                #[error(transparent)]
                File(#[from] formats::Error),
                #[error(\"{path}: {} of \\\"{name}\\\" in {{braces}}, \\
                    {level:?}: {0}\", .0.len(), path = .path.display())]
                Two { /** The file. */ path: PathBuf, #[source] level: Option<Vec<(u8, u8)>>, name: String },
                Bare,
            }
            #[derive(Debug, thiserror::Error)]
            #[error(\"at {at}\")]
            pub struct S { pub at: [u8; 2] }
            #[derive(Debug)]
            enum NoError { A }";
        let sources = Sources::of(&[("crates/a/src/error.rs", text), ("crates/a/src/tests.rs", text)]);
        let found = variants(&sources);
        let names: Vec<String> = found.iter().map(Variant::path).collect();
        assert_eq!(names, ["E::File", "E::Two", "E::Bare", "S"]);
        assert_eq!(found[1].text.as_deref(), Some("{path}: {} of \"{name}\" in {{braces}}, {level:?}: {0}"));
        assert_eq!(found[1].arguments, ",.0.len(),path=.path.display()");
        assert_eq!((found[0].text.as_deref(), found[0].field("0")), (None, Some("formats::Error")));
        assert_eq!(found[1].field("level"), Some("Option<Vec<(u8,u8)>>"));
        assert_eq!((found[3].text.as_deref(), found[3].field("at")), (Some("at {at}"), Some("[u8;2]")));
        let places = placeholders(found[1].text.as_deref().unwrap());
        let shown: Vec<_> = places.iter().map(|place| (place.name, place.format)).collect();
        assert_eq!(shown, [("path", ""), ("", ""), ("name", ""), ("level", "?"), ("0", "")]);
        assert_eq!((places[3].rest, places[4].rest), (": {0}", ""));
    }
}

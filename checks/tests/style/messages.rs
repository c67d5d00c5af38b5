//! Sentences of errors: what is wrong, where, and what to do.
//!
//! All variants of all error types are walked. A sentence says where by a field (a path, a line, a
//! key, a value), or its type is one of [`PLACED`]. It says what to do by an instruction, by valid
//! values (`must be …`), by words named advice or remedy, or by an error that it ends with. That
//! error is walked itself, and the program adds a remedy to one of the system (`src/failure.rs`).

use std::collections::BTreeSet;
use std::io::Write as _;

use crate::errors::{Variant, placeholders, variants};
use crate::findings::Finding;
use crate::sources::Sources;

/// Longest sentence, characters of its text.
const LONGEST: usize = 260;

/// Sources whose matches add commands and flags to errors of the libraries.
const REMEDIES: [&str; 2] = ["src/failure.rs", "src/app/reconstruct/filling.rs"];

/// Types with sentences that have no field, and what says where instead.
const PLACED: [(&str, &str); 35] = [
    ("Apart", "the command names both volumes before it"),
    ("ArmError", "of the touches and the arm that the command names"),
    ("BadMeta", "follows the volume's path"),
    ("BadRegion", "follows its key or flag"),
    ("BadShard", "follows the volume's path and the shard's key"),
    ("BadStatic", "follows its key"),
    ("ControlError", "answers the command that it refuses"),
    ("CovarianceError", "follows its key in the calibration's file"),
    ("CurveError", "follows the point's number in its file, or answers a request"),
    ("ExportError", "names the setting; the program adds its flag"),
    ("GeometryError", "follows the phantom's file"),
    ("IgtlError", "answers the command that it refuses"),
    ("LandmarksError", "of the phantom and the recording that the command names"),
    ("LatencyError", "of the recording that the command names"),
    ("LightError", "follows its key or flag"),
    ("LineError", "follows the device's name"),
    ("MaskRefusal", "answers the command that it refuses"),
    ("MeasureError", "answers the figure that it refuses"),
    ("NoImage", "follows the file's path"),
    ("NoLine", "of a frame that the command counts"),
    ("NoSession", "follows the file's path"),
    ("NoVolume", "answers the request that it refuses"),
    ("PipelineError", "names the setting; the program adds its flag"),
    ("ProbeError", "of the recording that the command names"),
    ("Refused", "follows the frame's number, or is a reason in the frame ledger"),
    ("RenderError", "names the setting; the program adds its flag"),
    ("RepeatError", "follows the frame's number"),
    ("RequestError", "answers the request that it refuses"),
    ("SectionError", "names the setting, and follows its flag"),
    ("SettingsError", "names the setting"),
    ("SurfaceError", "of the volume and the grey value that the command names"),
    ("Unreadable", "follows the file's path"),
    ("UnsureReason", "of the frames that the mask is searched in"),
    ("Unwritable", "follows the file's path"),
    ("TransferError", "names the setting, and follows its key or flag"),
];

/// First words of instructions.
const INSTRUCTIONS: &str = "\
    add ask begin bend bring calibrate check choose clear close connect convert copy correct \
    crop delete draw end enter export fix free give hold home install keep lay leave let list \
    lower make measure move name narrow plug point put raise read reconstruct record remove \
    rename repair replay report request restore run save scan see send set shorten show sort \
    split start stop sweep switch take tilt touch try turn unfreeze use wait widen write";

/// Facts of all sources by which a sentence is judged.
struct Known<'a> {
    types: BTreeSet<&'a str>,
    /// Paths of the variants that the program's remedies match.
    remedied: BTreeSet<String>,
}

/// Checks all variants, and says how many there are.
pub(crate) fn check(sources: &Sources) -> Vec<Finding> {
    let all = variants(sources);
    let types: BTreeSet<&str> = all.iter().map(|variant| variant.of.as_str()).collect();
    // The harness captures what macros print.
    let _ = writeln!(std::io::stderr(), "{} error variants of {} types walked", all.len(), types.len());
    let known = Known { types, remedied: remedied(sources) };
    let mut findings: Vec<Finding> = all.iter().flat_map(|variant| known.check(variant)).collect();
    let is_bare = |variant: &Variant| variant.text.as_ref().is_some_and(|text| placeholders(text).is_empty());
    for (of, _) in PLACED {
        if !all.iter().any(|variant| variant.of == of && is_bare(variant)) {
            findings.push(Finding::new(file!(), 1, format!("{of} has no sentence without a field: remove its row")));
        }
    }
    findings
}

fn remedied(sources: &Sources) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for source in REMEDIES.iter().filter_map(|path| sources.get(path)) {
        for part in source.code().windows(4).filter(|part| part[1].is(":") && part[2].is(":")) {
            found.insert(format!("{}::{}", part[0].text, part[3].text));
        }
    }
    found
}

impl Known<'_> {
    fn check(&self, variant: &Variant) -> Vec<Finding> {
        let mut findings = Vec::new();
        let mut find = |sentence: String| {
            let sentence = format!("{}: {sentence}", variant.path());
            findings.push(Finding::new(&variant.file, variant.line, sentence));
        };
        let Some(text) = variant.text.as_deref() else {
            let inner = variant.fields.first().map_or("", |(_, of)| of);
            if !self.is_walked(inner) {
                find(format!("is transparent, and {inner:?} is no error that is walked"));
            }
            return findings;
        };
        let all = placeholders(text);
        for place in all.iter().filter(|place| place.format.contains('?')) {
            if !is_words(variant.field(place.name).unwrap_or_default()) {
                find(format!("shows {{{}}} in its form for programmers", place.name));
            }
        }
        let length = text.chars().count();
        if length > LONGEST {
            find(format!("has {length} characters, of at most {LONGEST}"));
        }
        if text.contains("::") || text.ends_with('.') {
            find("has a name of the code, or ends with a full stop".into());
        }
        if all.is_empty() && !PLACED.iter().any(|(of, _)| *of == variant.of) {
            find(format!("says no place: {text:?}"));
        }
        if !instructs(text) && !self.is_open(variant, text) && !self.remedied.contains(&variant.path()) {
            find(format!("does not say what to do: {text:?}"));
        }
        findings
    }

    /// Whether a sentence ends with a field that says what to do.
    fn is_open(&self, variant: &Variant, text: &str) -> bool {
        let all = placeholders(text);
        let Some(last) = all.last().filter(|last| last.rest.is_empty()) else { return false };
        match variant.field(last.name) {
            Some(of) => is_words(of) || self.is_walked(of),
            None => ["advice", "remedy"].iter().any(|name| variant.arguments.contains(name)),
        }
    }

    /// Whether a type is an error that is walked, one of another crate of the workspace, or one of
    /// the system.
    fn is_walked(&self, of: &str) -> bool {
        let name = of.rsplit("::").next().unwrap_or(of);
        of.starts_with("Box<dyn") || of.ends_with("io::Error") || self.types.contains(name)
    }
}

/// Whether a type is a text, which may be shown in quotes, and which is checked where it is made.
fn is_words(of: &str) -> bool {
    ["String", "&'staticstr"].contains(&of)
}

/// Whether a text holds an instruction, or valid values.
pub(crate) fn instructs(text: &str) -> bool {
    let begins = |clause: &str| {
        let word = clause.split(|c: char| !c.is_alphabetic()).next().unwrap_or_default();
        INSTRUCTIONS.split_whitespace().any(|verb| verb == word)
    };
    let clauses = ["; ", ": ", ", ", " and ", " or ", "("];
    let has = clauses.iter().any(|mark| text.match_indices(mark).any(|(at, _)| begins(&text[at + mark.len()..])));
    has || begins(text) || text.contains("must ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poor_sentences_are_found() {
        let text = "
            const ADVICE: &str = \"plug it in\";
            #[derive(thiserror::Error)]
            enum Poor {
                #[error(\"{0} is odd\")] NoAdvice(u8),
                #[error(\"it is odd; give another\")] NoPlace,
                #[error(\"{0:?} must be a number\")] Debug(Vec<u8>),
                #[error(\"{0}: use Status::Ok\")] Code(u8),
                #[error(\"{0}: {1}\")] Foreign(u8, mcap::McapError),
                #[error(transparent)] Bare(mcap::McapError),
            }
            #[derive(thiserror::Error)]
            enum Good {
                #[error(\"{0} is odd: {ADVICE}\")] Constant(u8),
                #[error(\"{0:?} must be a number\")] Quoted(String),
                #[error(\"{0}: {1}\")] System(u8, std::io::Error),
                #[error(\"{0}: {1}\")] Inner(u8, Poor),
                #[error(\"{0} is odd; {}\", advice(.0))] Advised(u8),
                #[error(\"{0} is odd\")] Remedied(u8),
                #[error(transparent)] Wrapped(#[from] Poor),
            }";
        let remedies = "fn f(e: Good) { match e { Good::Remedied(_) => \" (--odd)\" } }";
        let sources = Sources::of(&[("crates/a/src/error.rs", text), ("src/failure.rs", remedies)]);
        let found: Vec<String> =
            check(&sources).into_iter().filter(|f| f.file.starts_with("crates")).map(|f| f.sentence).collect();
        let expected = [
            "Poor::NoAdvice: does not say what to do: \"{0} is odd\"",
            "Poor::NoPlace: says no place: \"it is odd; give another\"",
            "Poor::Debug: shows {0} in its form for programmers",
            "Poor::Code: has a name of the code, or ends with a full stop",
            "Poor::Foreign: does not say what to do: \"{0}: {1}\"",
            "Poor::Bare: is transparent, and \"mcap::McapError\" is no error that is walked",
        ];
        assert_eq!(found, expected);
    }
}

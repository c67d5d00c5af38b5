//! A row's settings: flags of `reconstruct`, checked by its own parser, in one form.

use crate::failure::Reason;
use clap::error::{ContextKind, ContextValue};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Args as _, Command, FromArgMatches as _};

use crate::app::batch::once::Once;
use crate::app::batch::plan::Settings;
use crate::cli::negative::with_negative_numbers;
use crate::cli::{Failure, reconstruct};

/// Flags that the batch gives itself, and the way to say them.
const OWN: [(&str, &str); 5] = [
    ("format", "give --format of `batch plan`"),
    ("config", "give it in the column of that name"),
    ("weights", "give --weights of `batch plan`"),
    ("planes", "give --planes of `batch plan`"),
    ("json", "leave it out; done.json has the report"),
];

/// Flags that change no result.
const RESOURCES: [&str; 4] = ["max-memory", "out-of-core", "simd", "threads"];

/// Flags whose values are numbers, which have several forms. Others are names.
const NUMBERS: [&str; 20] = [
    "clip",
    "decay-rate",
    "decay-wait",
    "fan",
    "fill-radius",
    "image-to-probe",
    "leakage",
    "max-memory",
    "max-weight",
    "origin",
    "planar-tolerance",
    "resolution",
    "sigma",
    "size",
    "smoothing",
    "spacing",
    "support",
    "threads",
    "unseen",
    "window",
];

/// Flags of rows in one form. The parser is built once, and the same flags are parsed once.
pub(super) struct CanonicalSettings<'a> {
    /// File format of the volumes.
    format: &'a str,
    command: Command,
    known: Once<(Vec<String>, bool), Result<Settings, String>>,
}

impl<'a> CanonicalSettings<'a> {
    pub(super) fn new(format: &'a str) -> Self {
        let mut command = command();
        command.build();
        Self { format, command, known: Once::default() }
    }

    /// Returns a row's flags in one form: with all defaults, and the same text for the same
    /// numbers.
    pub(super) fn of(&self, words: &[String], has_config: bool) -> Result<Settings, String> {
        let parse = || canonical(self.command.clone(), words, has_config, self.format);
        self.known.get((words.to_vec(), has_config), parse)
    }
}

/// Returns a row's flags in one form, by a parser of its own.
fn canonical(mut command: Command, words: &[String], has_config: bool, format: &str) -> Result<Settings, String> {
    let output = format!("volume.{format}");
    let config = has_config.then_some(["--config", "configuration"]);
    let first = ["reconstruct", "recording.mha", "--output", &output];
    let all = first.into_iter().chain(config.into_iter().flatten()).chain(words.iter().map(String::as_str));
    let matches = &command.try_get_matches_from_mut(all).map_err(|error| said(&error))?;
    if matches.get_many::<std::path::PathBuf>("sequences").is_some_and(|paths| paths.len() > 1) {
        return Err(format!("{:?} holds words that are no flags; leave them out", words.join(" ")));
    }
    for (flag, advice) in OWN {
        let is_ours = flag == "config" && has_config;
        if !is_ours && matches.value_source(flag) == Some(ValueSource::CommandLine) {
            return Err(format!("--{flag}: is the batch's own; {advice}"));
        }
    }
    check(matches, has_config)?;
    let (mut settings, mut resources) = (Vec::new(), Vec::new());
    for argument in command.get_arguments() {
        let Some(flag) = argument.get_long() else { continue };
        if flag == "output" || OWN.iter().any(|(own, _)| *own == flag) {
            continue;
        }
        let id = argument.get_id().as_str();
        let Some(word) = word(matches, flag, id, argument.get_action()) else { continue };
        if RESOURCES.contains(&flag) { resources.push(word) } else { settings.push(word) }
    }
    settings.sort();
    resources.sort();
    Ok(Settings { settings, resources })
}

/// Returns `reconstruct` alone, without the flags of the log.
fn command() -> Command {
    with_negative_numbers(reconstruct::Arguments::augment_args(Command::new("reconstruct")))
}

/// Checks values that contradict each other. The configuration is read by the run: without it, a
/// preset means nothing.
fn check(matches: &ArgMatches, has_config: bool) -> Result<(), String> {
    if has_config {
        return Ok(());
    }
    let arguments = reconstruct::Arguments::from_arg_matches(matches).map_err(|error| said(&error))?;
    arguments.check().map_err(|Failure(Reason { sentence, .. })| sentence)
}

/// Returns a flag with its value as one word; `None` if it has none.
fn word(matches: &ArgMatches, flag: &str, id: &str, action: &ArgAction) -> Option<String> {
    if matches!(action, ArgAction::SetTrue) {
        return matches.get_flag(id).then(|| format!("--{flag}"));
    }
    let values = matches.try_get_raw(id).ok()??;
    let values: Vec<String> = values.map(|value| value.to_string_lossy().into_owned()).collect();
    let value = values.join(",");
    let value = if NUMBERS.contains(&flag) { plain(&value) } else { value };
    Some(format!("--{flag}={value}"))
}

/// Returns the same text for the same numbers, between commas, equals signs and spaces.
fn plain(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut result = String::new();
    for part in text.split_inclusive([',', '=', ' ']) {
        let number = part.trim_end_matches([',', '=', ' ']);
        let end = &part[number.len()..];
        let number = match (number.parse::<u64>(), number.parse::<f64>()) {
            (Ok(whole), _) => whole.to_string(),
            // Adding zero makes −0 to 0.
            (_, Ok(value)) if value.is_finite() => (value + 0.0).to_string(),
            _ => number.to_owned(),
        };
        result.push_str(&number);
        result.push_str(end);
    }
    result
}

/// Returns clap's error as a sentence of one line.
fn said(error: &clap::Error) -> String {
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
    let flag = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(flag)) if !first.contains(flag.as_str()) => format!("{flag}: "),
        _ => String::new(),
    };
    format!("{flag}{first}; give flags of `sonoweave reconstruct`")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(words: &str) -> Result<Settings, String> {
        CanonicalSettings::new("mha").of(&words.split_whitespace().map(str::to_owned).collect::<Vec<_>>(), false)
    }

    #[test]
    fn same_settings_have_one_form() {
        let first = of("--spacing 0.5,0.5,1 --method linear --threads 4").unwrap();
        for words in [
            "--method=linear --spacing .5,0.50,1.0 --max-memory 2",
            "--spacing 5e-1,0.5,1 --method linear --compound mean --max-weight 256 --out-of-core --simd portable",
        ] {
            let same = if words.contains("out-of-core") {
                CanonicalSettings::new("ome.zarr").of(&words.split(' ').map(str::to_owned).collect::<Vec<_>>(), false)
            } else {
                of(words)
            };
            assert_eq!(first.settings, same.unwrap().settings, "{words}");
        }
        assert_eq!(first.resources, ["--max-memory=8", "--simd=auto", "--threads=4"]);
        assert_ne!(first.settings, of("--spacing 0.5 --method linear").unwrap().settings);
        assert_ne!(of("--world 1.0").unwrap().settings, of("--world 1").unwrap().settings, "a name");
        assert_eq!(plain("energy=0.0010, -0,007  1e400 x"), "energy=0.001, 0,7 1e400 x");
    }

    #[test]
    fn unusable_settings_are_refused_with_their_flag() {
        for (words, says) in [
            ("--spacing x", "--spacing"),
            ("--no-such 3", "--no-such"),
            ("other.mha", "holds words that are no flags"),
            ("--config a.xml", "column of that name"),
            ("--weights w.mha", "batch plan"),
            ("--json", "done.json"),
            ("--quiet", "--quiet"),
            ("-o other.mha", "--output"),
            ("--max-memory 0", "--max-memory 0"),
            ("--out-of-core", "writes OME-Zarr only"),
            ("--fan 1,2", "--fan"),
            ("--help", "flags of"),
        ] {
            let refused = of(words).unwrap_err();
            assert!(refused.contains(says) && !refused.contains('\n'), "{words}: {refused}");
        }
        let words = ["--preset", "4 cm"].map(str::to_owned);
        let settings = CanonicalSettings::new("mha");
        assert!(settings.of(&words, true).unwrap().settings.contains(&"--preset=4 cm".to_owned()));
        assert!(settings.of(&words, false).is_err(), "a preset needs a configuration");
    }

    #[test]
    fn every_named_flag_exists() {
        let command = command();
        let has = |flag: &str| command.get_arguments().any(|argument| argument.get_long() == Some(flag));
        assert!(RESOURCES.iter().chain(&NUMBERS).all(|flag| has(flag)));
        assert!(OWN.iter().all(|(flag, _)| has(flag)));
    }
}

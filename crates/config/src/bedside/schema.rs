//! Every section and key of a session configuration, derived from the structs that read them: its
//! values, its meaning, and when a change of it takes effect.
//!
//! A struct's documentation is the section's subject, and a field's is the key's meaning. Unknown
//! keys and invalid values are detected by the schema. `x-takes` words the valid values where the
//! schema cannot. `x-at-once` marks keys, or whole sections, whose changes a running session
//! adopts; `x-required` marks keys without a default.
//!
//! - `values`: types of keys' values.
//! - `devices`, `session`, `volume`, `virtual_bedside`: the sections.

pub(crate) mod devices;
pub(crate) mod session;
pub(crate) mod values;
pub(crate) mod virtual_bedside;
pub(crate) mod volume;

use std::sync::LazyLock;

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde::Serialize;
use serde_json::{Map, Value, json};

use sonoweave_core::keys::{Entry, FileError};

/// The value of `format`.
pub const FORMAT: &str = "sonoweave-bedside";
/// The newest supported version.
pub const VERSION: u32 = 1;

/// A section of the file.
#[derive(Debug)]
pub struct Section {
    /// Its heading, dotted.
    pub name: &'static str,
    /// Its subject.
    pub about: String,
    /// Its keys.
    pub keys: Vec<Key>,
}

/// A key of a section.
#[derive(Debug)]
pub struct Key {
    /// Its name, its unit last.
    pub name: String,
    /// Its valid values.
    pub takes: String,
    /// Its meaning, and its default.
    pub about: String,
    /// Whether a running session adopts a change of it; others wait for the next session.
    pub at_once: bool,
    /// Its JSON schema.
    pub(super) schema: Value,
}

/// All sections, in the order in which a slice passes them.
pub static SECTIONS: LazyLock<Vec<Section>> = LazyLock::new(|| {
    vec![
        Section::of::<session::Calibration>("calibration"),
        Section::of::<devices::Tracker>("tracker"),
        Section::of::<devices::Arm>("arm"),
        Section::of::<devices::Remote>("remote"),
        Section::of::<devices::Grabber>("grabber"),
        Section::of::<session::Pairing>("pairing"),
        Section::of::<session::Scanner>("scanner"),
        Section::of::<volume::Volume>("volume"),
        Section::of::<volume::Picture>("picture"),
        Section::of::<session::Record>("record"),
        Section::of::<session::Status>("status"),
        Section::of::<session::Igtl>("igtl"),
        Section::of::<session::Markers>("markers"),
        Section::of::<session::Process>("process"),
        Section::of::<virtual_bedside::Virtual>("virtual"),
        Section::of::<virtual_bedside::Line>("virtual.line"),
        Section::of::<virtual_bedside::Grabber>("virtual.grabber"),
    ]
});

/// Returns the section of a heading.
pub fn section(name: &str) -> Option<&'static Section> {
    SECTIONS.iter().find(|section| section.name == name)
}

/// Returns the key of a dotted name.
pub fn key(dotted: &str) -> Option<&'static Key> {
    let (heading, name) = dotted.rsplit_once('.')?;
    section(heading)?.key(name)
}

/// Returns the JSON schema of the file, for editors.
pub fn json() -> Value {
    let mut root = json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Session configuration of sonoweave",
        "type": "object",
        "additionalProperties": false,
        "required": ["format", "version", "grabber"],
        "properties": { "format": { "const": FORMAT }, "version": { "const": VERSION } },
    });
    for section in SECTIONS.iter() {
        let of_section = section.name.split('.').fold(&mut root, |outer, part| &mut outer["properties"][part]);
        let required = section.keys.iter().filter(|key| key.schema["x-required"] == true);
        *of_section = json!({
            "description": section.about,
            "type": "object",
            "additionalProperties": false,
            "required": required.map(|key| &key.name).collect::<Vec<_>>(),
            "properties": section.keys.iter().map(Key::json).collect::<Map<_, _>>(),
        });
    }
    root
}

impl Section {
    fn of<T: JsonSchema + Default + Serialize>(name: &'static str) -> Self {
        let settings = SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true);
        let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
        let (about, at_once) = (about(&schema), schema["x-at-once"] == true);
        let keys = schema["properties"].as_object_mut().map(std::mem::take).into_iter().flatten();
        let mut keys: Vec<Key> = keys.map(|(name, schema)| Key::new(name, schema, at_once)).collect();
        // A JSON schema sorts its keys. The serialised struct has the order of declaration.
        let declared = serde_json::to_string(&T::default()).unwrap_or_default();
        keys.sort_by_key(|key| declared.find(&format!("\"{}\":", key.name)));
        Self { name, about, keys }
    }

    /// Returns a key by its name.
    pub fn key(&self, name: &str) -> Option<&Key> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// Returns the names of its keys and subsections.
    pub fn known(&self) -> Vec<&str> {
        let inner = SECTIONS.iter().filter_map(|section| section.name.strip_prefix(self.name)?.strip_prefix('.'));
        self.keys.iter().map(|key| key.name.as_str()).chain(inner).collect()
    }
}

impl Key {
    fn new(name: String, mut schema: Value, at_once: bool) -> Self {
        without_null(&mut schema);
        let usual = schema.get("default").map(|usual| format!("; default: {}", text_of(usual)));
        let about = about(&schema) + &usual.unwrap_or_default();
        let at_once = at_once || schema["x-at-once"] == true;
        Self { name, takes: takes(&schema), about, at_once, schema }
    }

    fn json(&self) -> (String, Value) {
        let mut schema = self.schema.clone();
        schema["description"] = format!("{}. Values: {}", self.about, self.takes).into();
        (self.name.clone(), schema)
    }
}

/// Removes null, which TOML lacks, from the schema of an optional value.
fn without_null(schema: &mut Value) {
    let Some(schema) = schema.as_object_mut() else { return };
    for all in ["type", "enum"] {
        if let Some(Value::Array(all)) = schema.get_mut(all) {
            all.retain(|one| !one.is_null() && one != "null");
        }
    }
    schema.retain(|name, value| name != "default" || !value.is_null());
}

fn about(schema: &Value) -> String {
    let words: Vec<&str> = schema["description"].as_str().unwrap_or_default().split_whitespace().collect();
    words.join(" ")
}

/// Describes a default.
fn text_of(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.as_f64().unwrap_or_default().to_string(),
        Value::Array(all) if all.is_empty() => "none".into(),
        Value::Array(all) if all[0].is_string() => named(all, "and"),
        Value::Array(all) => format!("[{}]", all.iter().map(text_of).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// Describes the valid values.
fn takes(schema: &Value) -> String {
    let bound = |name: &str| schema[name].as_f64();
    match (schema["x-takes"].as_str(), schema["enum"].as_array()) {
        (Some(takes), _) => return takes.to_owned(),
        (_, Some(names)) => return named(names, "or"),
        _ => {}
    }
    match (bound("exclusiveMinimum"), bound("minimum"), bound("maximum")) {
        (Some(low), _, Some(high)) => format!("above {low}, up to {high}"),
        (Some(low), _, None) => format!("above {low}"),
        (None, Some(low), Some(high)) => format!("{low} to {high}"),
        (None, Some(low), None) => format!("{low} or more"),
        (None, None, _) => kinds(schema).first().map_or_else(String::new, |kind| in_words(kind).to_owned()),
    }
}

/// Joins names as a sentence lists them.
fn named(names: &[Value], last_by: &str) -> String {
    let names: Vec<&str> = names.iter().filter_map(Value::as_str).collect();
    match names.as_slice() {
        [head @ .., last] if !head.is_empty() => format!("{} {last_by} {last}", head.join(", ")),
        _ => names.concat(),
    }
}

fn kinds(schema: &Value) -> Vec<&str> {
    match &schema["type"] {
        Value::Array(all) => all.iter().filter_map(Value::as_str).collect(),
        one => one.as_str().into_iter().collect(),
    }
}

/// Returns the words for a kind of the schema, as entries describe their values.
fn in_words(kind: &str) -> &'static str {
    match kind {
        "integer" => "a whole number",
        "number" => "a number",
        "boolean" => "true or false",
        "array" => "a list",
        "object" => "a table",
        _ => "a text",
    }
}

/// Checks a value's kind, names and range. Its type checks the rest.
pub(super) fn check(entry: &Entry<'_>, schema: &Value) -> Result<(), FileError> {
    let kinds = kinds(schema);
    let fits = |kind: &&str| in_words(kind) == entry.kind() || (*kind == "number" && entry.kind() == "a whole number");
    match (kinds.iter().copied().find(|kind| fits(kind)), kinds.as_slice()) {
        (Some("integer"), _) => check_range(entry, entry.whole()?.into(), schema),
        (Some("number"), _) => check_range(entry, entry.number()?, schema),
        (Some("array"), _) => {
            let all = entry.items("a list")?;
            if schema["minItems"].as_u64().is_some_and(|count| count != all.len() as u64) {
                return Err(entry.error(format!("must hold {}, not {}", items(schema), all.len())));
            }
            all.iter().try_for_each(|item| check(item, &schema["items"]))
        }
        (Some("object"), _) => {
            let mut properties = schema["properties"].as_object().into_iter().flatten();
            let known: Vec<&str> = properties.clone().map(|(name, _)| name.as_str()).collect();
            let table = entry.table(&known)?;
            // Tables within sections have no optional keys.
            properties.try_for_each(|(name, schema)| check(&table.need(name)?, schema))
        }
        (Some(_), _) => match (entry.as_text(), schema["enum"].as_array()) {
            (Some(text), Some(names)) if !names.iter().any(|name| name == text) => {
                Err(entry.error(format!("\"{text}\" is none of {}", named(names, "and"))))
            }
            _ => Ok(()),
        },
        (None, ["array"]) => Err(entry.wrong(&format!("a list of {}", items(schema)))),
        (None, [one]) => Err(entry.wrong(in_words(one))),
        (None, _) => Err(entry.wrong(&takes(schema))),
    }
}

fn check_range(entry: &Entry<'_>, x: f64, schema: &Value) -> Result<(), FileError> {
    let bound = |name: &str| schema[name].as_f64();
    let (above, low, high) = (bound("exclusiveMinimum"), bound("minimum"), bound("maximum"));
    if above.is_none_or(|above| x > above) && low.is_none_or(|low| x >= low) && high.is_none_or(|high| x <= high) {
        return Ok(());
    }
    let low = low.unwrap_or(f64::MIN);
    let rule = match (above, high) {
        (Some(above), Some(high)) => format!("must lie above {above} and not above {high}"),
        (Some(above), None) => format!("must be above {above}"),
        (None, Some(high)) => format!("must lie between {low} and {high}"),
        (None, None) => format!("must be {low} or more"),
    };
    Err(entry.error(format!("{rule}, not at {x}")))
}

/// Describes the items of a list, and their number if it is fixed.
fn items(schema: &Value) -> String {
    let all = match schema["items"]["type"].as_str() {
        Some("integer") => "whole numbers",
        Some("number") => "numbers",
        _ => "texts",
    };
    schema["minItems"].as_u64().map_or_else(|| all.to_owned(), |count| format!("{count} {all}"))
}

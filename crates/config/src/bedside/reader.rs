//! Reads a section key by key. The effective value of every key is noted under its name, whether
//! it was given or not.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Serialize;
use serde_json::Value;

use sonoweave_core::keys::{Entry, FileError, Table};

use super::schema::{self, Section};
use crate::Unfit;

/// Effective values by dotted key, given or not; `null` if nothing was given and something else
/// decides.
pub type Effective = BTreeMap<String, Value>;

/// A section of a file, and its effective values.
pub(super) struct Reader<'a, 'e> {
    path: &'a Path,
    section: &'static Section,
    /// `None` if the file has no such section.
    table: Option<Table<'a>>,
    effective: &'e mut Effective,
}

impl<'a, 'e> Reader<'a, 'e> {
    /// Opens the section `name` of `parent`. Unknown keys that are not subsections are refused.
    pub(super) fn new(
        path: &'a Path,
        parent: Option<&Table<'a>>,
        name: &'static str,
        effective: &'e mut Effective,
    ) -> Result<Self, FileError> {
        let Some(section) = schema::section(name) else { unreachable!("{name} is in the schema") };
        let heading = name.rsplit('.').next().unwrap_or(name);
        let entry = parent.and_then(|parent| parent.get(heading));
        let table = entry.map(|entry| entry.table(&section.known())).transpose()?;
        Ok(Self { path, section, table, effective })
    }

    /// Returns a path relative to the file's folder.
    pub(super) fn path_of(&self, told: &str) -> PathBuf {
        beside(self.path, told)
    }

    /// Whether the section may hold such a key.
    pub(super) fn knows(&self, key: &str) -> bool {
        self.section.keys.iter().any(|known| known.name == key)
    }

    /// Returns the section's table, for its subsections.
    pub(super) fn into_table(self) -> Option<Table<'a>> {
        self.table
    }

    /// Returns the value of a key, if it is given.
    pub(super) fn entry(&self, key: &str) -> Option<Entry<'a>> {
        debug_assert!(self.knows(key), "{key} is not in the schema");
        self.table.as_ref()?.get(key)
    }

    /// Makes an error at a key of the section; at the section if the key is not given.
    pub(super) fn error(&self, key: &str, problem: impl Into<String>) -> FileError {
        match self.entry(key) {
            Some(entry) => entry.error(problem),
            None => self.missing(key, problem),
        }
    }

    fn missing(&self, key: &str, problem: impl Into<String>) -> FileError {
        let key = format!("{}.{key}", self.section.name);
        FileError::Key { path: self.path.to_owned(), line: self.line(), key, problem: problem.into() }
    }

    /// Returns the section's first line.
    fn line(&self) -> usize {
        self.table.as_ref().map_or(1, Table::line)
    }

    /// Makes an error from settings whose keys have other names here.
    pub(super) fn unfit(&self, unfit: Unfit, key_of: fn(&'static str) -> &'static str) -> FileError {
        let settings = || unfit.setting.split(", ").filter(|setting| !setting.is_empty()).map(key_of);
        // If several keys could be meant, the error names a given one.
        if let Some(key) = settings().find(|key| self.entry(key).is_some()).or(settings().next()) {
            return self.error(key, unfit.problem);
        }
        let key = format!("[{}]", self.section.name);
        FileError::Key { path: self.path.to_owned(), line: self.line(), key, problem: unfit.problem }
    }

    fn note(&mut self, key: &str, value: &impl Serialize) {
        // A value that cannot be converted to JSON (there is no such type here) is noted as
        // null.
        let value = serde_json::to_value(value).unwrap_or_default();
        self.effective.insert(format!("{}.{key}", self.section.name), value);
    }

    /// Reads a value, if it is given.
    pub(super) fn value_if<T: Serialize>(
        &mut self,
        key: &str,
        read: impl FnOnce(&Entry<'a>) -> Result<T, FileError>,
    ) -> Result<Option<T>, FileError> {
        let value = self.entry(key).map(|entry| read(&entry)).transpose()?;
        self.note(key, &value);
        Ok(value)
    }

    /// Reads a value, or takes the default.
    pub(super) fn value<T: Serialize>(
        &mut self,
        key: &str,
        usual: T,
        read: impl FnOnce(&Entry<'a>) -> Result<T, FileError>,
    ) -> Result<T, FileError> {
        let value = self.entry(key).map(|entry| read(&entry)).transpose()?.unwrap_or(usual);
        self.note(key, &value);
        Ok(value)
    }

    /// Notes an effective value that the file does not contain.
    pub(super) fn notes(&mut self, key: &str, value: &impl Serialize) {
        self.note(key, value);
    }

    /// Reads a number in a range.
    pub(super) fn number(&mut self, key: &str, usual: f64, range: RangeInclusive<f64>) -> Result<f64, FileError> {
        self.value(key, usual, |entry| between(entry, range))
    }

    /// Reads a number in a range, if it is given.
    pub(super) fn number_if(&mut self, key: &str, range: RangeInclusive<f64>) -> Result<Option<f64>, FileError> {
        self.value_if(key, |entry| between(entry, range))
    }

    /// Reads a whole number in a range.
    pub(super) fn whole(&mut self, key: &str, usual: u32, range: RangeInclusive<u32>) -> Result<u32, FileError> {
        self.value(key, usual, |entry| whole_between(entry, range))
    }

    /// Reads a whole number in a range, if it is given.
    pub(super) fn whole_if(&mut self, key: &str, range: RangeInclusive<u32>) -> Result<Option<u32>, FileError> {
        self.value_if(key, |entry| whole_between(entry, range))
    }

    /// Reads true or false.
    pub(super) fn truth(&mut self, key: &str, usual: bool) -> Result<bool, FileError> {
        self.value(key, usual, |entry| entry.truth())
    }

    /// Reads a text, if it is given.
    pub(super) fn text_if(&mut self, key: &str) -> Result<Option<String>, FileError> {
        self.value_if(key, |entry| entry.text().map(str::to_owned))
    }

    /// Reads milliseconds in a range, as ns.
    pub(super) fn ms(&mut self, key: &str, usual: f64, range: RangeInclusive<f64>) -> Result<i64, FileError> {
        // No overflow: even days would fit.
        self.number(key, usual, range).map(|ms| (ms * 1e6).round() as i64)
    }

    /// Parses a text, or numbers joined in the flag's notation, with a flag's parser.
    pub(super) fn parsed_if<T>(
        &mut self,
        key: &str,
        joined_by: &str,
        parse: fn(&str) -> Result<T, String>,
    ) -> Result<Option<T>, FileError> {
        let Some(entry) = self.entry(key) else {
            self.note(key, &Value::Null);
            return Ok(None);
        };
        let text = joined(&entry, joined_by)?;
        let value = parse(&text).map_err(|problem| entry.error(problem))?;
        self.note(key, &text);
        Ok(Some(value))
    }

    /// Reads one of several names, if it is given.
    pub(super) fn choice_if<T: Copy>(
        &mut self,
        key: &str,
        names: &[(&'static str, T)],
    ) -> Result<Option<T>, FileError> {
        let Some(entry) = self.entry(key) else {
            self.note(key, &Value::Null);
            return Ok(None);
        };
        let (name, value) = one_of(&entry, names)?;
        self.note(key, &name);
        Ok(Some(value))
    }

    /// Reads one of several names, or takes the default.
    pub(super) fn choice<T: Copy>(
        &mut self,
        key: &str,
        usual: &'static str,
        names: &[(&'static str, T)],
    ) -> Result<T, FileError> {
        if let Some(value) = self.choice_if(key, names)? {
            return Ok(value);
        }
        self.note(key, &usual);
        let found = names.iter().find(|(name, _)| *name == usual);
        found.map(|(_, value)| *value).ok_or_else(|| self.missing(key, "is missing"))
    }

    /// Reads one of a flag's names, or takes the default.
    pub(super) fn named<T: ValueEnum + Copy>(&mut self, key: &str, usual: T) -> Result<T, FileError> {
        Ok(match self.named_if(key)? {
            Some(value) => value,
            None => {
                self.note(key, &name_of(&usual));
                usual
            }
        })
    }

    /// Reads one of a flag's names, if it is given.
    pub(super) fn named_if<T: ValueEnum + Copy>(&mut self, key: &str) -> Result<Option<T>, FileError> {
        let Some(entry) = self.entry(key) else {
            self.note(key, &Value::Null);
            return Ok(None);
        };
        let text = entry.text()?;
        let value = T::from_str(text, false).map_err(|_| {
            let all: Vec<String> = T::value_variants().iter().map(name_of).collect();
            entry.error(not_among(text, all.iter().map(String::as_str)))
        })?;
        self.note(key, &text);
        Ok(Some(value))
    }
}

/// Returns the name of a flag's value.
pub(super) fn name_of<T: ValueEnum>(value: &T) -> String {
    value.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

/// Reads one of several names.
pub(super) fn one_of<T: Copy>(entry: &Entry<'_>, names: &[(&'static str, T)]) -> Result<(&'static str, T), FileError> {
    let text = entry.text()?;
    let found = names.iter().find(|(name, _)| *name == text).copied();
    found.ok_or_else(|| entry.error(not_among(text, names.iter().map(|(name, _)| *name))))
}

fn not_among<'n>(text: &str, names: impl Iterator<Item = &'n str>) -> String {
    let names: Vec<&str> = names.collect();
    match names.as_slice() {
        [head @ .., last] if !head.is_empty() => format!("\"{text}\" is none of {} and {last}", head.join(", ")),
        _ => format!("\"{text}\" is not {}", names.join(", ")),
    }
}

/// Reads a number in a range.
pub(super) fn between(entry: &Entry<'_>, range: RangeInclusive<f64>) -> Result<f64, FileError> {
    let x = entry.number()?;
    if range.contains(&x) {
        return Ok(x);
    }
    let (low, high) = (range.start(), range.end());
    let wanted = match (*low == f64::MIN_POSITIVE, high.is_finite()) {
        (true, false) => "must be above 0".to_owned(),
        (true, true) => format!("must lie above 0 and not above {high}"),
        (false, false) => format!("must be {low} or more"),
        (false, true) => format!("must lie between {low} and {high}"),
    };
    Err(entry.error(format!("{wanted}, not at {x}")))
}

fn whole_between(entry: &Entry<'_>, range: RangeInclusive<u32>) -> Result<u32, FileError> {
    let n = entry.whole()?;
    if range.contains(&n) {
        return Ok(n);
    }
    Err(entry.error(format!("must be a whole number from {} to {}, not {n}", range.start(), range.end())))
}

/// Returns a text unchanged, a number, or a list of numbers joined in a flag's notation.
fn joined(entry: &Entry<'_>, by: &str) -> Result<String, FileError> {
    if let Some(text) = entry.as_text() {
        return Ok(text.to_owned());
    }
    if !entry.is_list() {
        return entry.number().map(|x| x.to_string());
    }
    let items = entry.items("a list")?;
    let numbers = items.iter().map(|item| item.number().map(|x| x.to_string())).collect::<Result<Vec<_>, _>>()?;
    Ok(numbers.join(by))
}

/// Returns a path relative to a file's folder.
pub(super) fn beside(file: &Path, told: &str) -> PathBuf {
    file.parent().map_or_else(|| told.into(), |folder| folder.join(told))
}

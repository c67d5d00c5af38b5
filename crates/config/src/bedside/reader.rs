//! Reads a section into its struct. The effective value of every key is noted under its name,
//! whether it was given or not.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use calibration::tracker::noise::TrackerNoise;
use sonoweave_core::keys::{Entry, FileError, Table};

use super::schema::devices::Noise;
use super::schema::values::{LatencyMs, Notation, RelativePath, ns};
use super::schema::{self, Section};
use crate::Error;
use crate::kind::MAX_BYTES;
use crate::texts::Texts;

/// Largest noise of a sensor, mm and degrees.
const MOST_NOISE: f64 = 10.0;

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
    ) -> Result<Self, Error> {
        let Some(section) = schema::section(name) else { unreachable!("{name} is in the schema") };
        let heading = name.rsplit('.').next().unwrap_or(name);
        let entry = parent.and_then(|parent| parent.get(heading));
        let table = entry.map(|entry| entry.table(&section.known())).transpose()?;
        Ok(Self { path, section, table, effective })
    }

    /// Reads the section, and notes its values. Keys that are not given have their defaults.
    pub(super) fn read<T: Default + Serialize + Deserialize<'a>>(&mut self) -> Result<T, Error> {
        for key in &self.section.keys {
            self.entry(&key.name).map(|entry| schema::check(&entry, &key.schema)).transpose()?;
        }
        let read = self.table.as_ref().map(Table::read).transpose()?.unwrap_or_else(T::default);
        // A value that cannot be converted to JSON (there is no such type here) is noted as null.
        let values = serde_json::to_value(&read).unwrap_or_default();
        for key in &self.section.keys {
            self.note(&key.name, &values[&key.name]);
        }
        Ok(read)
    }

    /// Returns a path relative to the file's folder.
    pub(super) fn path_of(&self, given: &str) -> PathBuf {
        self.path.with_file_name(given)
    }

    /// Returns an optional path relative to the file's folder.
    pub(super) fn path_if(&self, given: Option<RelativePath>) -> Option<PathBuf> {
        given.map(|given| self.path_of(&given.0))
    }

    /// Whether the section may hold such a key.
    pub(super) fn knows(&self, key: &str) -> bool {
        self.section.key(key).is_some()
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

    /// Makes an error at a key of the section, or at an item such as `key[1]`. Its line is the
    /// section's if the key is not given.
    pub(super) fn error(&self, key: &str, problem: impl Into<String>) -> Error {
        let given = self.entry(key.split('[').next().unwrap_or(key));
        let line = given.map_or_else(|| self.line(), |entry| entry.line());
        self.error_at(line, format!("{}.{key}", self.section.name), problem.into())
    }

    /// Returns the text of the file that a key names.
    pub(super) fn named(&self, key: &str, file: &Path, texts: &Texts) -> Result<String, Error> {
        texts.text(file, MAX_BYTES).map_err(|error| match error {
            FileError::Io { doing, source, .. } => {
                let file = file.display();
                self.error(
                    key,
                    format!("names {file}, but {doing} failed: {source}; correct the name, or make the file"),
                )
            }
            other => other.into(),
        })
    }

    fn error_at(&self, line: usize, key: String, problem: String) -> Error {
        FileError::Key { path: self.path.to_owned(), line, key, problem }.into()
    }

    /// Returns the section's first line.
    fn line(&self) -> usize {
        self.table.as_ref().map_or(1, Table::line)
    }

    /// Returns the value of a key without default.
    pub(super) fn need<T>(&self, key: &str, given: Option<T>) -> Result<T, Error> {
        let takes = || self.section.key(key).map_or("", |key| &key.takes);
        given.ok_or_else(|| self.error(key, format!("is missing: give {}", takes())))
    }

    /// Makes an error from settings whose keys have other names here.
    pub(super) fn unfit(&self, error: Error, key_of: fn(&'static str) -> &'static str) -> Error {
        let Error::Setting { setting, problem } = error else { return error };
        let settings = || setting.split(", ").filter(|setting| !setting.is_empty()).map(key_of);
        // If several keys could be meant, the error names a given one.
        if let Some(key) = settings().find(|key| self.entry(key).is_some()).or(settings().next()) {
            return self.error(key, problem);
        }
        self.error_at(self.line(), format!("[{}]", self.section.name), problem)
    }

    /// Notes an effective value that is not as the file contains it.
    pub(super) fn note(&mut self, key: &str, value: &impl Serialize) {
        let value = serde_json::to_value(value).unwrap_or_default();
        self.effective.insert(format!("{}.{key}", self.section.name), value);
    }

    /// Parses a value with a flag's parser; `by` joins numbers in the flag's notation.
    pub(super) fn parsed<T>(
        &mut self,
        key: &str,
        given: Notation,
        by: &str,
        parse: fn(&str) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let text = given.joined(by);
        self.note(key, &text);
        parse(&text).map_err(|error| self.error(key, error.to_string()))
    }

    /// Parses a value whose numbers are joined by commas, if it is given.
    pub(super) fn parsed_if<T>(
        &mut self,
        key: &str,
        given: Option<Notation>,
        parse: fn(&str) -> Result<T, Error>,
    ) -> Result<Option<T>, Error> {
        given.map(|given| self.parsed(key, given, ",", parse)).transpose()
    }

    /// Returns the file's latency, or else the calibration's, in ns.
    pub(super) fn latency_ns(&mut self, given: Option<LatencyMs>, calibrated_ms: f64) -> i64 {
        let ms = given.map_or(calibrated_ms, |latency| latency.0);
        self.note("latency_ms", &ms);
        ns(ms)
    }

    /// Returns the noise of sensors that the key `noise` gives.
    pub(super) fn noise(&self, given: Option<Noise>) -> Result<Option<TrackerNoise>, Error> {
        let Some(Noise { mm, deg }) = given else { return Ok(None) };
        match [mm, deg].iter().all(|sd| (0.0..=MOST_NOISE).contains(sd)) {
            true => Ok(Some(TrackerNoise { position_mm: mm, rotation_deg: deg })),
            false => Err(self.error("noise", format!("both numbers must lie between 0 and {MOST_NOISE}"))),
        }
    }

    /// Converts a driver's refusal of settings to an error at the right key.
    pub(super) fn refused(&self, error: &drivers::Error) -> Error {
        let line = if self.knows("port") { "port" } else { "device" };
        match error {
            drivers::Error::Setting { setting, problem, .. } => match *setting {
                "stations" => self.error("probe_station", problem),
                "stylus" => self.error("stylus_station", problem),
                "fastest" => self.error("fastest_counts_per_s", problem),
                // For a server's settings: names of transforms, and of the image.
                "transforms" => self.error("probe", problem),
                "image" => self.error("input", problem),
                setting if self.knows(setting) => self.error(setting, problem),
                _ => self.error(line, error.to_string()),
            },
            _ => self.error(line, error.to_string()),
        }
    }
}

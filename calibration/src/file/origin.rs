//! Origin of a result in a calibration file: its day and its input files.

use sonoweave_core::date::Date;
use sonoweave_core::keys::{Entry, FileError, Table};

use super::values::line;

/// Keys of an origin, which several tables have.
pub(super) const KEYS: [&str; 2] = ["made", "input"];

/// The day of a result, and the files it was made from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Origin {
    /// The day it was made.
    pub made: Option<Date>,
    /// The files it was made from.
    pub inputs: Vec<Input>,
}

/// A file that a calibration was made from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// Its name, without its folder.
    pub file: String,
    /// Its SHA-256, as `sha256sum` prints it.
    pub sha256: String,
}

/// No day, and no inputs.
pub(super) static UNKNOWN: Origin = Origin { made: None, inputs: Vec::new() };

impl Origin {
    /// Reads the keys `made` and `input` of a table.
    pub(super) fn read(table: &Table<'_>) -> Result<Self, FileError> {
        let made = table
            .get("made")
            .map(|entry| Date::parse(entry.text()?).ok_or_else(|| entry.error("must be a day, as in \"2026-11-22\"")));
        Ok(Self {
            made: made.transpose()?,
            inputs: table.get("input").map(|entry| inputs(&entry)).transpose()?.unwrap_or_default(),
        })
    }

    /// Writes the day, among a table's values.
    pub(super) fn write_day(&self, text: &mut String) {
        if let Some(made) = self.made {
            line(text, format_args!("made = \"{made}\""));
        }
    }

    /// Writes the inputs as tables within the table `of`, after all its values.
    pub(super) fn write_inputs(&self, of: &str, text: &mut String) {
        for Input { file, sha256 } in &self.inputs {
            let file = toml::Value::String(file.clone());
            line(text, format_args!("\n[[{of}.input]]\nfile = {file}\nsha256 = \"{sha256}\""));
        }
    }
}

fn inputs(entry: &Entry<'_>) -> Result<Vec<Input>, FileError> {
    let items = entry.items("a list of tables, each with file and sha256")?;
    let input = |item: &Entry<'_>| -> Result<Input, FileError> {
        let table: Table<'_> = item.table(&["file", "sha256"])?;
        let hash = table.need("sha256")?;
        let sha256 = hash.text()?.to_owned();
        if sha256.len() != 64 || !sha256.bytes().all(|b| b.is_ascii_hexdigit()) {
            return Err(hash.error("must be 64 hexadecimal digits, as `sha256sum` prints them"));
        }
        Ok(Input { file: table.need("file")?.text()?.to_owned(), sha256 })
    };
    items.iter().map(input).collect()
}

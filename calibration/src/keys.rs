//! TOML read key by key, so that every complaint names the file, the key and the line.

use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// What is wrong with a file of ours. The display is a sentence that says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file cannot be read or written at all.
    #[error("{path}: {doing} failed: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// Larger than any file of its kind.
    #[error("{path}: holds more than {limit} bytes, too many for its kind; is this the right file?", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What it may hold at most, bytes.
        limit: u64,
    },
    /// The text is not TOML.
    #[error("{path}: line {line}: {problem}", path = path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The parser's words.
        problem: String,
    },
    /// A key is unknown, missing, or holds what it should not.
    #[error("{path}: {key} (line {line}): {problem}", path = path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// Line, from 1; of the table where a key is missing.
        line: usize,
        /// The key with its tables, dotted.
        key: String,
        /// What is wrong and what to do.
        problem: String,
    },
}

/// A file's text, for lines.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file's path, for sentences.
    pub path: &'a Path,
    /// Its whole text.
    pub text: &'a str,
}

impl<'a> Source<'a> {
    /// Parses the text.
    pub fn parse(&self) -> Result<Spanned<DeTable<'a>>, FileError> {
        DeTable::parse(self.text).map_err(|e| FileError::Syntax {
            path: self.path.to_owned(),
            line: self.line(e.span().unwrap_or(0..0)),
            problem: e.message().trim().replace('\n', ", "),
        })
    }

    fn line(&self, span: Range<usize>) -> usize {
        let end = span.start.min(self.text.len());
        1 + self.text.as_bytes()[..end].iter().filter(|&&b| b == b'\n').count()
    }
}

/// A table, and where it stands in the file.
pub struct Table<'a> {
    source: Source<'a>,
    table: &'a DeTable<'a>,
    span: Range<usize>,
    /// Dotted name, empty for the file itself.
    path: String,
}

/// A key's value, and where it stands.
pub struct Entry<'a> {
    source: Source<'a>,
    value: &'a DeValue<'a>,
    span: Range<usize>,
    path: String,
}

impl<'a> Table<'a> {
    /// The whole file; `known` are the keys it may hold.
    pub fn root(source: Source<'a>, root: &'a Spanned<DeTable<'a>>, known: &[&str]) -> Result<Self, FileError> {
        let table = Self::bare(source, root);
        table.only(known)?;
        Ok(table)
    }

    /// The whole file, whatever keys it holds.
    pub fn bare(source: Source<'a>, root: &'a Spanned<DeTable<'a>>) -> Self {
        Self { source, table: root.get_ref(), span: 0..0, path: String::new() }
    }

    fn only(&self, known: &[&str]) -> Result<(), FileError> {
        for key in self.table.keys() {
            let name: &str = key.get_ref();
            if !known.contains(&name) {
                return Err(FileError::Key {
                    path: self.source.path.to_owned(),
                    line: self.source.line(key.span()),
                    key: join(&self.path, name),
                    problem: format!("unknown key{}", nearest(name, known)),
                });
            }
        }
        Ok(())
    }

    /// The line where it begins, from 1.
    pub fn line(&self) -> usize {
        self.source.line(self.span.clone())
    }

    /// The value of `key`, if it is there.
    pub fn get(&self, key: &str) -> Option<Entry<'a>> {
        let value = self.table.get(key)?;
        Some(Entry { source: self.source, value: value.get_ref(), span: value.span(), path: join(&self.path, key) })
    }

    /// The value of `key`.
    pub fn need(&self, key: &str) -> Result<Entry<'a>, FileError> {
        self.get(key).ok_or_else(|| FileError::Key {
            path: self.source.path.to_owned(),
            line: self.line(),
            key: join(&self.path, key),
            problem: "is missing".into(),
        })
    }
}

impl<'a> Entry<'a> {
    /// A complaint about this value.
    pub fn error(&self, problem: impl Into<String>) -> FileError {
        FileError::Key {
            path: self.source.path.to_owned(),
            line: self.source.line(self.span.clone()),
            key: self.path.clone(),
            problem: problem.into(),
        }
    }

    fn wrong(&self, wanted: &str) -> FileError {
        self.error(format!("must be {wanted}, not {}", kind(self.value)))
    }

    /// A text.
    pub fn text(&self) -> Result<&'a str, FileError> {
        self.value.as_str().ok_or_else(|| self.wrong("a text"))
    }

    /// The text, where it is one; for keys that take other things too.
    pub fn as_text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    /// Whether it is a list; for keys that take other things too.
    pub fn is_list(&self) -> bool {
        self.value.as_array().is_some()
    }

    /// True or false.
    pub fn truth(&self) -> Result<bool, FileError> {
        self.value.as_bool().ok_or_else(|| self.wrong("true or false"))
    }

    /// A whole number that fits 32 bits and is not negative.
    pub fn whole(&self) -> Result<u32, FileError> {
        let DeValue::Integer(number) = self.value else { return Err(self.wrong("a whole number")) };
        u32::from_str_radix(number.as_str(), number.radix())
            .map_err(|_| self.error(format!("must be a whole number from 0 to {}, not {number}", u32::MAX)))
    }

    /// A finite number.
    pub fn number(&self) -> Result<f64, FileError> {
        let x = match self.value {
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(|x| x as f64),
            _ => return Err(self.wrong("a number")),
        };
        x.filter(|x| x.is_finite()).ok_or_else(|| self.error("is not a finite number"))
    }

    /// Exactly N finite numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N], FileError> {
        let items = self.items(&format!("a list of {N} numbers"))?;
        if items.len() != N {
            return Err(self.error(format!("must hold {N} numbers, not {}", items.len())));
        }
        let mut numbers = [0.0; N];
        for (number, item) in numbers.iter_mut().zip(&items) {
            *number = item.number()?;
        }
        Ok(numbers)
    }

    /// Exactly N finite numbers above zero.
    pub fn positive<const N: usize>(&self) -> Result<[f64; N], FileError> {
        let numbers = self.numbers::<N>()?;
        match numbers.iter().find(|x| **x <= 0.0) {
            Some(x) => Err(self.error(format!("must hold numbers above 0, not {x}"))),
            None => Ok(numbers),
        }
    }

    /// The elements of a list.
    pub fn items(&self, wanted: &str) -> Result<Vec<Entry<'a>>, FileError> {
        let items = self.value.as_array().ok_or_else(|| self.wrong(wanted))?;
        Ok(items
            .iter()
            .enumerate()
            .map(|(index, item)| Entry {
                source: self.source,
                value: item.get_ref(),
                span: item.span(),
                path: format!("{}[{index}]", self.path),
            })
            .collect())
    }

    /// A table with no keys but `known`.
    pub fn table(&self, known: &[&str]) -> Result<Table<'a>, FileError> {
        let table = self.value.as_table().ok_or_else(|| self.wrong("a table"))?;
        let table = Table { source: self.source, table, span: self.span.clone(), path: self.path.clone() };
        table.only(known)?;
        Ok(table)
    }
}

fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) => "a whole number",
        DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}

/// A hint at the known key that was probably meant, or all of them.
fn nearest(name: &str, known: &[&str]) -> String {
    let best = known.iter().map(|k| (strsim::damerau_levenshtein(name, k), k)).min_by_key(|(distance, _)| *distance);
    match best {
        Some((distance, key)) if distance <= 2 + key.len() / 4 => format!("; did you mean {key}?"),
        _ => format!("; known here: {}", known.join(", ")),
    }
}

//! Reads TOML key by key, so that every error names the file, the key and the line.

use std::io::Read as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// Errors of this program's files. The message says what is wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The file cannot be read or written.
    #[error("{path}: {doing} failed: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The failed operation.
        doing: &'static str,
        /// The system's error.
        #[source]
        source: std::io::Error,
    },
    /// The file is no text.
    #[error("{path}: holds bytes that are no text (UTF-8); check that it is the right file", path = path.display())]
    NoText {
        /// The file.
        path: PathBuf,
    },
    /// The file is larger than any of its kind.
    #[error("{path}: holds more than {limit} bytes, the limit for its kind; check that it is the right file", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Size limit, bytes.
        limit: u64,
    },
    /// The text is not TOML.
    #[error("{path}: line {line}: {problem}", path = path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The parser's message.
        problem: String,
    },
    /// A key is unknown, missing, or holds an invalid value.
    #[error("{path}: {key} (line {line}): {problem}", path = path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// Line, from 1; the table's line if the key is missing.
        line: usize,
        /// The dotted key, including its tables.
        key: String,
        /// The problem and its remedy.
        problem: String,
    },
}

/// A file's text, for finding line numbers.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file's path, for messages.
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

/// A table and its position in the file.
pub struct Table<'a> {
    source: Source<'a>,
    table: &'a DeTable<'a>,
    span: Range<usize>,
    /// Dotted name, empty for the file itself.
    path: String,
}

/// A key's value and its position in the file.
pub struct Entry<'a> {
    source: Source<'a>,
    value: &'a DeValue<'a>,
    span: Range<usize>,
    path: String,
}

impl<'a> Table<'a> {
    /// Returns the file's root table; `known` lists the allowed keys.
    pub fn root(source: Source<'a>, root: &'a Spanned<DeTable<'a>>, known: &[&str]) -> Result<Self, FileError> {
        let table = Self::bare(source, root);
        table.only(known)?;
        Ok(table)
    }

    /// Returns the file's root table without checking its keys.
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

    /// Returns the line where the table begins, from 1.
    pub fn line(&self) -> usize {
        self.source.line(self.span.clone())
    }

    /// Returns the value of `key`, if present.
    pub fn get(&self, key: &str) -> Option<Entry<'a>> {
        let value = self.table.get(key)?;
        Some(Entry { source: self.source, value: value.get_ref(), span: value.span(), path: join(&self.path, key) })
    }

    /// Reads the table into a type. The type's errors are placed at the key that holds the value.
    ///
    /// # Errors
    /// [`FileError::Key`] with the type's sentence.
    pub fn read<T: Deserialize<'a>>(&self) -> Result<T, FileError> {
        let value = Spanned::new(self.span.clone(), DeValue::Table(self.table.clone()));
        T::deserialize(ValueDeserializer::from(value)).map_err(|e| {
            let span = e.span().unwrap_or_else(|| self.span.clone());
            let holder = self.table.iter().find(|(_, value)| value.span().contains(&span.start));
            let path = holder.map_or_else(|| self.path.clone(), |(key, _)| join(&self.path, key.get_ref()));
            Entry { source: self.source, value: &DeValue::Boolean(false), span, path }.error(e.message())
        })
    }

    /// Returns the value of `key`; an error if it is missing.
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
    /// Returns an error about this value.
    pub fn error(&self, problem: impl Into<String>) -> FileError {
        FileError::Key {
            path: self.source.path.to_owned(),
            line: self.line(),
            key: self.path.clone(),
            problem: problem.into(),
        }
    }

    /// Returns an error about a value of another kind than `expected`.
    pub fn wrong(&self, expected: &str) -> FileError {
        self.error(format!("must be {expected}, not {}", self.kind()))
    }

    /// Returns the line where the value begins, from 1.
    pub fn line(&self) -> usize {
        self.source.line(self.span.clone())
    }

    /// Returns the kind of the value, in words.
    pub fn kind(&self) -> &'static str {
        match self.value {
            DeValue::String(_) => "a text",
            DeValue::Integer(_) => "a whole number",
            DeValue::Float(_) => "a number",
            DeValue::Boolean(_) => "true or false",
            DeValue::Datetime(_) => "a date",
            DeValue::Array(_) => "a list",
            DeValue::Table(_) => "a table",
        }
    }

    /// Returns a text.
    pub fn text(&self) -> Result<&'a str, FileError> {
        self.value.as_str().ok_or_else(|| self.wrong("a text"))
    }

    /// Returns the text, if it is one; for keys that take other types too.
    pub fn as_text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    /// Returns a boolean.
    pub fn truth(&self) -> Result<bool, FileError> {
        self.value.as_bool().ok_or_else(|| self.wrong("true or false"))
    }

    /// Returns a whole number that fits 32 bits and is not negative.
    pub fn whole(&self) -> Result<u32, FileError> {
        let DeValue::Integer(number) = self.value else { return Err(self.wrong("a whole number")) };
        u32::from_str_radix(number.as_str(), number.radix())
            .map_err(|_| self.error(format!("must be a whole number from 0 to {}, not {number}", u32::MAX)))
    }

    /// Returns a finite number.
    pub fn number(&self) -> Result<f64, FileError> {
        let x = match self.value {
            DeValue::Float(x) => x.as_str().parse::<f64>().ok(),
            DeValue::Integer(x) => i64::from_str_radix(x.as_str(), x.radix()).ok().map(|x| x as f64),
            _ => return Err(self.wrong("a number")),
        };
        x.filter(|x| x.is_finite()).ok_or_else(|| self.error("is not a finite number"))
    }

    /// Returns exactly N finite numbers.
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

    /// Returns exactly N finite numbers above zero.
    pub fn positive<const N: usize>(&self) -> Result<[f64; N], FileError> {
        let numbers = self.numbers::<N>()?;
        match numbers.iter().find(|x| **x <= 0.0) {
            Some(x) => Err(self.error(format!("must hold numbers above 0, not {x}"))),
            None => Ok(numbers),
        }
    }

    /// Returns the elements of a list.
    pub fn items(&self, expected: &str) -> Result<Vec<Entry<'a>>, FileError> {
        let items = self.value.as_array().ok_or_else(|| self.wrong(expected))?;
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

    /// Returns a table with no keys but `known`.
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

/// Suggests the known key nearest to `name`, or lists all known keys.
fn nearest(name: &str, known: &[&str]) -> String {
    let best = known.iter().map(|k| (strsim::damerau_levenshtein(name, k), k)).min_by_key(|(distance, _)| *distance);
    match best {
        Some((distance, key)) if distance <= 2 + key.len() / 4 => format!("; did you mean {key}?"),
        _ => format!("; known here: {}", known.join(", ")),
    }
}

/// Returns the text of a file of at most `limit` bytes.
///
/// # Errors
/// [`FileError`]: unreadable, not UTF-8, or larger; at most `limit` + 1 bytes are read.
pub fn read_text(path: &Path, limit: u64) -> Result<String, FileError> {
    let io = |source: std::io::Error| match source.kind() {
        std::io::ErrorKind::InvalidData => FileError::NoText { path: path.to_owned() },
        _ => FileError::Io { path: path.to_owned(), doing: "reading", source },
    };
    let mut text = String::new();
    // Limits the bytes read, because a pipe or a device states no size.
    std::fs::File::open(path).map_err(io)?.take(limit + 1).read_to_string(&mut text).map_err(io)?;
    if text.len() as u64 > limit {
        return Err(FileError::TooLarge { path: path.to_owned(), limit });
    }
    Ok(text)
}

/// Reason why a text does not hold the expected numbers.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BadNumbers {
    /// A word is not a number; long words are shortened.
    #[error("\"{0}\" is not a number; correct it")]
    NotNumber(String),
    /// A number is NaN or infinite.
    #[error("number {position} must be finite, not {word}")]
    NotFinite {
        /// Position of the number, from 1.
        position: usize,
        /// Its text.
        word: String,
    },
    /// The text holds more numbers, or fewer.
    #[error("must hold {expected} number{}, not {found}", if *.expected == 1 { "" } else { "s" })]
    Count {
        /// The expected count.
        expected: usize,
        /// The count found.
        found: usize,
    },
}

/// Parses N finite numbers separated by white space, commas or both.
///
/// # Errors
/// [`BadNumbers`].
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], BadNumbers> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    let mut numbers = [0.0; N];
    let mut found = 0;
    for word in words {
        let number = word.parse::<f64>().map_err(|_| BadNumbers::NotNumber(shortened(word)))?;
        if !number.is_finite() {
            return Err(BadNumbers::NotFinite { position: found + 1, word: word.to_owned() });
        }
        if let Some(slot) = numbers.get_mut(found) {
            *slot = number;
        }
        found += 1;
    }
    if found == N { Ok(numbers) } else { Err(BadNumbers::Count { expected: N, found }) }
}

/// Lets `?` pass the sentence on in functions whose error is a text.
impl From<BadNumbers> for String {
    fn from(bad: BadNumbers) -> Self {
        bad.to_string()
    }
}

fn shortened(word: &str) -> String {
    let mut short: String = word.chars().take(40).collect();
    if short.len() < word.len() {
        short.push('…');
    }
    short
}

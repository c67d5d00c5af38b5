//! A header's fields, and the errors that name them.

use std::path::Path;

use crate::Error;
use crate::error::place;

/// A header error without its file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// A field is missing, malformed or contradicts another.
    Field { field: String, offset: u64, problem: String },
    /// A stated limit was exceeded.
    Limit { what: String, value: u128, limit: u128, advice: &'static str },
}

impl Fault {
    pub(crate) fn field(field: impl Into<String>, offset: u64, problem: impl ToString) -> Self {
        Self::Field { field: field.into(), offset, problem: problem.to_string() }
    }

    /// Formats the fault for a caller that names the file itself.
    pub(crate) fn sentence(self) -> String {
        match self {
            Self::Field { field, problem, .. } => format!("{}: {problem}", place(&field)),
            Self::Limit { what, value, limit, advice } => format!("{what} is {value}, more than {limit}: {advice}"),
        }
    }

    /// Adds the file's path.
    pub(crate) fn at(self, path: &Path) -> Error {
        let path = path.to_owned();
        match self {
            Self::Field { field, offset, problem } => Error::Header { path, field, offset, problem },
            Self::Limit { what, value, limit, advice } => Error::Limit { path, what, value, limit, advice },
        }
    }
}

/// A global field, valid for the whole file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Field {
    pub(crate) name: Box<str>,
    pub(crate) value: Box<str>,
    /// Position of its line, in bytes from the beginning of the file.
    pub(crate) offset: u64,
}

impl Field {
    /// Creates a fault of this field.
    pub(crate) fn fault(&self, problem: impl ToString) -> Fault {
        Fault::field(&*self.name, self.offset, problem)
    }
}

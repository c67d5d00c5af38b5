//! The flags of `reconstruct` as keywords.

pub use crate::cli::keywords::Keyword;
use crate::cli::keywords::parse;
use crate::cli::reconstruct::flags::Flags;
use crate::failure::Failure;

use super::LibraryError;

/// Flags of `reconstruct` by name, with `_` for `-`, each with its value in the command line's
/// notation. A flag that is not given has the command line's default.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Keywords(Vec<Keyword>);

impl Keywords {
    /// Creates them.
    ///
    /// # Errors
    /// [`LibraryError::Input`] if a name or a value does not fit.
    pub fn new(given: Vec<Keyword>) -> Result<Self, LibraryError> {
        parse::<Flags>(&given)?;
        Ok(Self(given))
    }

    /// Returns them with those of `other` that they lack.
    pub(super) fn or(&self, other: &Self) -> Self {
        let missing = other.0.iter().filter(|(name, _)| !self.has(name));
        Self(self.0.iter().chain(missing).cloned().collect())
    }

    /// Whether a flag is given.
    pub(super) fn has(&self, name: &str) -> bool {
        self.names().any(|given| given == name)
    }

    /// Returns the names of the flags.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// Returns a flag's value.
    pub(super) fn value(&self, name: &str) -> Option<&str> {
        self.0.iter().find(|(given, _)| given == name)?.1.as_deref()
    }

    /// Returns the flags.
    pub(super) fn flags(&self) -> Result<Flags, Failure> {
        parse(&self.0)
    }
}

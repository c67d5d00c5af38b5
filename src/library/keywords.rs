//! The flags of `reconstruct` as keywords.

use crate::cli::reconstruct::flags::Flags;
use crate::cli::reconstruct::keywords::parse;
use crate::failure::Failure;

use super::LibraryError;

/// Flags of `reconstruct` by name, with `_` for `-`, each with its value in the command line's
/// notation. A flag that is not given has the command line's default.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Keywords(Vec<(String, String)>);

impl Keywords {
    /// Creates them.
    ///
    /// # Errors
    /// [`LibraryError::Input`] if a name or a value does not fit.
    pub fn new(given: Vec<(String, String)>) -> Result<Self, LibraryError> {
        parse(&given)?;
        Ok(Self(given))
    }

    /// Returns them with those of `other` that they lack.
    pub(super) fn or(&self, other: &Self) -> Self {
        let missing = other.0.iter().filter(|(name, _)| !self.has(name));
        Self(self.0.iter().chain(missing).cloned().collect())
    }

    /// Whether a flag is given.
    pub(super) fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(given, _)| given == name)
    }

    /// Returns the flags.
    pub(super) fn flags(&self) -> Result<Flags, Failure> {
        parse(&self.0)
    }
}

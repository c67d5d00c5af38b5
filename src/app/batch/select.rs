//! Selection of a batch's sweeps, for parts that run elsewhere.

use crate::app::part::Part;
use crate::failure::Failure;

/// Sweeps to consider.
#[derive(Debug, Clone, Default)]
pub(crate) struct Selection {
    /// Ids; empty for all.
    pub(crate) only: Vec<String>,
    pub(crate) part: Option<Part>,
}

impl Selection {
    /// Whether the sweep of an id is selected.
    pub(crate) fn has(&self, id: &str) -> bool {
        let is_named = self.only.is_empty() || self.only.iter().any(|only| only == id);
        is_named && self.part.is_none_or(|part| part.has(id))
    }

    /// Checks that a plan has all named ids.
    ///
    /// # Errors
    /// [`Failure`] for an id that the plan lacks.
    pub(crate) fn check(&self, is_there: impl Fn(&str) -> bool) -> Result<(), Failure> {
        if let Some(unknown) = self.only.iter().find(|id| !is_there(id)) {
            return Err(Failure::usage(format!("--only {unknown}: the plan has no such id; give one of its own")));
        }
        Ok(())
    }
}

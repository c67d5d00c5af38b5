//! Selection of a batch's sweeps, for parts that run elsewhere.

use super::plan::Planned;
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
    /// Returns the selected sweeps.
    ///
    /// # Errors
    /// [`Failure`] for an id that the plan lacks.
    pub(crate) fn of<'a>(&self, sweeps: &'a [Planned]) -> Result<Vec<&'a Planned>, Failure> {
        if let Some(unknown) = self.only.iter().find(|id| !sweeps.iter().any(|sweep| sweep.id == **id)) {
            return Err(Failure::usage(format!("--only {unknown}: the plan has no such id; give one of its own")));
        }
        let is_selected = |sweep: &&Planned| {
            (self.only.is_empty() || self.only.contains(&sweep.id)) && self.part.is_none_or(|part| part.has(&sweep.id))
        };
        Ok(sweeps.iter().filter(is_selected).collect())
    }
}

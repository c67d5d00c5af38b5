//! Reports of commands as JSON documents, in one form.

use serde::Serialize;

use crate::failure::Failure;

mod options;
pub(crate) use options::{Json, JsonFlag};

/// Returns a report as a document that ends its line.
///
/// # Errors
/// [`Failure`] when it has no JSON form.
pub(crate) fn document(report: &impl Serialize) -> Result<String, Failure> {
    Ok(serde_json::to_string_pretty(report)? + "\n")
}

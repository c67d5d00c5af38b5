//! Measured figures of the documents.
//!
//! A [`record`] holds the figures of one run, with commit, date, machine, command and the
//! hashes of the sources that it measured. A [`template`] is Markdown with placeholders
//! for figures, and a [`chart`] shows some of them. [Blocks](documents) are the places of the
//! documents that show a template's text. The tests compare each block with its template, and each
//! record with [today's sources](sources).

pub mod chart;
pub mod documents;
pub mod record;
pub mod sources;
pub mod template;

/// Folder of records and templates, from the repository's root.
pub const FOLDER: &str = "docs/numbers";

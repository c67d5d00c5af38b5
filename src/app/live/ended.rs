//! The result of a session or of a replay.

use std::path::Path;
use std::time::Duration;

use config::bedside::Bedside;
use pipeline::session::{Differences, Finished};

use crate::failure::Failure;

/// The result of a session or of a replay.
pub(crate) struct Ended<'a> {
    pub(crate) bedside: &'a Bedside,
    pub(crate) finished: &'a Finished,
    /// Time since its beginning.
    pub(crate) wall: Duration,
    /// The recording that was replayed.
    pub(crate) replayed: Option<&'a Path>,
    /// Differences of the replay from the live session, if they were compared.
    pub(crate) differences: Option<&'a Differences>,
}

/// Writes and reports a result.
pub(crate) type Leave<'a> = &'a dyn Fn(&Ended<'_>) -> Result<(), Failure>;

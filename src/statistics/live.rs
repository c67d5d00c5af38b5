//! What a session did, in numbers: the content of `live --stats` at its end, and of `GET /status` while it runs.

use std::time::Duration;

use serde::Serialize;

use super::process::ProcessNumbers;
use crate::coach::CoachTold;
use crate::config::bedside::Effective;
use crate::pipeline::live::Account;

/// The numbers of a session.
#[derive(Debug, Clone, Serialize)]
pub struct LiveStatistics<'a> {
    /// Of the program.
    pub version: &'static str,
    /// Since the session began, s.
    pub wall_s: f64,
    /// What became of frames and readings, how each device is and how long things took.
    #[serde(flatten)]
    pub account: &'a Account,
    /// How the scan goes, for who holds the probe; where a page could show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coach: Option<&'a CoachTold>,
    /// From the program's start until the first slice was in the volume, s.
    pub start_to_first_slice_s: Option<f64>,
    /// What it took.
    pub process: ProcessNumbers,
    /// The settings that hold.
    pub config: &'a Effective,
}

impl<'a> LiveStatistics<'a> {
    /// Of a session that has lasted so long.
    pub fn new(account: &'a Account, wall: Duration, config: &'a Effective) -> Self {
        let process = ProcessNumbers::now();
        Self {
            start_to_first_slice_s: account.first_slice_ns.map(|ns| ns as f64 * 1e-9 - process.began_s),
            version: env!("CARGO_PKG_VERSION"),
            wall_s: wall.as_secs_f64(),
            account,
            coach: None,
            process,
            config,
        }
    }

    /// With what the coach tells.
    #[must_use]
    pub fn with_coach(self, coach: Option<&'a CoachTold>) -> Self {
        Self { coach, ..self }
    }
}

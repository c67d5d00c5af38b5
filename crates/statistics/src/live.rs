//! Numbers of a session: the content of `live --json` at its end, and of `GET /status` while it
//! runs.

use std::time::Duration;

use serde::Serialize;

use config::bedside::Effective;
use guidance::GuidanceStatus;
use pipeline::session::SessionStatus;

use super::process::ProcessNumbers;

/// Clients of the OpenIGTLink server.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct IgtlNumbers {
    /// Clients that were served.
    pub served: u64,
    /// Connections from addresses in no allowed network.
    pub not_allowed: u64,
    /// Connections that were refused because all slots were taken.
    pub turned_away: u64,
    /// Clients that were disconnected because they received too slowly.
    pub cut_off: u64,
    /// Clients that were disconnected because they sent too many messages.
    pub too_many: u64,
    /// Clients that were disconnected for invalid data.
    pub nonsense: u64,
    /// Messages that newer ones replaced before they were sent.
    pub replaced: u64,
}

/// The numbers of a session.
#[derive(Debug, Clone, Serialize)]
pub struct LiveStatistics<'a> {
    /// Version of the program.
    pub version: &'static str,
    /// Time since the session began, s.
    pub wall_s: f64,
    /// The session status.
    #[serde(flatten)]
    pub account: &'a SessionStatus,
    /// Scan guidance for the user, if a page can show it.
    #[serde(rename = "coach", skip_serializing_if = "Option::is_none")]
    pub guidance: Option<&'a GuidanceStatus>,
    /// Clients of the OpenIGTLink server, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub igtl: Option<IgtlNumbers>,
    /// Time from the program's start until the first slice was in the volume, s.
    pub start_to_first_slice_s: Option<f64>,
    /// Resources of the process.
    pub process: ProcessNumbers,
    /// The effective settings.
    pub config: &'a Effective,
}

impl<'a> LiveStatistics<'a> {
    /// Returns the numbers of a session of this duration.
    pub fn new(account: &'a SessionStatus, wall: Duration, config: &'a Effective) -> Self {
        let process = ProcessNumbers::now();
        Self {
            start_to_first_slice_s: account.first_slice_ns.map(|ns| ns as f64 * 1e-9 - process.began_s),
            version: env!("CARGO_PKG_VERSION"),
            wall_s: wall.as_secs_f64(),
            account,
            guidance: None,
            igtl: None,
            process,
            config,
        }
    }

    /// Adds the scan guidance.
    #[must_use]
    pub fn with_guidance(self, guidance: Option<&'a GuidanceStatus>) -> Self {
        Self { guidance, ..self }
    }

    /// Adds the clients of the OpenIGTLink server.
    #[must_use]
    pub fn with_igtl(self, igtl: Option<IgtlNumbers>) -> Self {
        Self { igtl, ..self }
    }
}

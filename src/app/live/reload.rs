//! SIGHUP: reads the configuration again, and applies the changes that are allowed while a
//! session runs.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use config::bedside::Bedside;
use pipeline::command::{Instruction, Setting};

use super::stages::{ADOPTED, Kept};
use super::viewers::Viewers;
use crate::app::reporter::Reporter;
use crate::failure::Failure;

/// The active configuration, and the flag to read it again.
pub(super) struct Reload {
    bedside: Bedside,
    /// The last configuration read, if it is only partly active.
    newer: Option<Bedside>,
    told: Arc<AtomicBool>,
}

impl Reload {
    /// Begins with this configuration, and installs the signal handler.
    ///
    /// # Errors
    /// [`Failure`] when the system refuses the handler.
    pub(super) fn new(bedside: &Bedside) -> Result<Self, Failure> {
        let told = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::clone(&told))?;
        Ok(Self { bedside: bedside.clone(), newer: None, told })
    }

    /// Returns the active configuration.
    pub(super) fn bedside(&self) -> &Bedside {
        &self.bedside
    }

    /// Activates all of the last configuration read, for a new session.
    pub(super) fn begins_anew(&mut self) {
        if let Some(newer) = self.newer.take() {
            self.bedside = newer;
        }
    }

    /// Whether the configuration is to be read again.
    pub(super) fn is_requested(&self) -> bool {
        self.told.load(Ordering::Relaxed)
    }

    /// Returns the instructions for the session, if a reload was requested. An unusable file
    /// changes nothing, and is reported.
    pub(super) fn instructions(&mut self, reporter: &dyn Reporter, viewers: Option<&Arc<Viewers>>) -> Vec<Instruction> {
        if !self.told.swap(false, Ordering::Relaxed) {
            return Vec::new();
        }
        match Bedside::read(&self.bedside.path) {
            Ok(newer) => self.adopt(&newer, reporter, viewers),
            Err(error) => {
                let note =
                    format!("the configuration was read again and cannot be used, so that the old one holds: {error}");
                reporter.say(&note);
                vec![Instruction::Report(note)]
            }
        }
    }

    fn adopt(&mut self, newer: &Bedside, reporter: &dyn Reporter, viewers: Option<&Arc<Viewers>>) -> Vec<Instruction> {
        let changes = self.bedside.changes(newer);
        self.newer = Some(newer.clone());
        let mut said = vec!["the configuration was read again".to_owned()];
        if changes.is_empty() {
            said.push("nothing has changed".into());
        }
        said.extend(changes.at_once.iter().map(|change| format!("from now on {change}")));
        said.extend(changes.next_session.iter().map(|change| format!("in the next session {change}")));
        let said = said.join("; ");
        reporter.say(&said);
        let mut instructions = vec![Instruction::Report(said)];
        if changes.at_once.is_empty() {
            return instructions;
        }
        self.bedside.adopt(newer);
        let bedside = &self.bedside;
        let settings = [
            Setting::Latency { device: 0, ns: bedside.tracking.latency_ns() },
            Setting::Latency { device: 1, ns: bedside.grabber.latency_ns },
            Setting::StuckAfter(bedside.scanner.stuck_after_ns),
            Setting::KeepFree(bedside.record.keep_free_bytes),
        ];
        instructions.extend(settings.map(Instruction::from));
        let is_otherwise = changes.at_once.iter().any(|change| change.key.starts_with("picture."));
        if let Some(viewers) = viewers.filter(|_| is_otherwise) {
            viewers.set_picture(&bedside.picture);
            instructions.push(Setting::View.into());
        }
        // A replay adopts it, too, except for latencies, which are recorded as commands.
        match serde_json::to_value(Kept::of(newer)) {
            Ok(kept) => instructions.push(Instruction::Note(ADOPTED, kept)),
            Err(error) => tracing::error!(%error, "the new configuration cannot be recorded"),
        }
        instructions
    }
}

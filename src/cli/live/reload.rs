//! SIGHUP: the configuration is read again, and what may change while a session runs changes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::outputs::say;
use super::stages::{ADOPTED, Kept};
use super::terminal::Terminal;
use super::viewers::Viewers;
use crate::cli::Failure;
use crate::config::bedside::Bedside;
use crate::pipeline::live::{Looks, Order};

/// The configuration that holds, and whether it is to be read again.
pub(super) struct Reload {
    bedside: Bedside,
    /// What was read last, where that holds in part only.
    newer: Option<Bedside>,
    told: Arc<AtomicBool>,
}

impl Reload {
    /// Of a session that begins with this.
    ///
    /// # Errors
    /// [`Failure`] when the system takes no handler.
    pub(super) fn new(bedside: &Bedside) -> Result<Self, Failure> {
        let told = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register(signal_hook::consts::SIGHUP, Arc::clone(&told))?;
        Ok(Self { bedside: bedside.clone(), newer: None, told })
    }

    /// The configuration that holds.
    pub(super) fn bedside(&self) -> &Bedside {
        &self.bedside
    }

    /// Another session begins: what was read last holds whole.
    pub(super) fn begins_anew(&mut self) {
        if let Some(newer) = self.newer.take() {
            self.bedside = newer;
        }
    }

    /// Whether it is to be read again.
    pub(super) fn is_told(&self) -> bool {
        self.told.load(Ordering::Relaxed)
    }

    /// What the session is to do otherwise, if it was told to read again. A file that cannot be used changes nothing, and is said.
    pub(super) fn orders(&mut self, terminal: Option<&Arc<Terminal>>, viewers: Option<&Arc<Viewers>>) -> Vec<Order> {
        if !self.told.swap(false, Ordering::Relaxed) {
            return Vec::new();
        }
        match Bedside::read(&self.bedside.path) {
            Ok(newer) => self.adopt(&newer, terminal, viewers),
            Err(error) => {
                let note =
                    format!("the configuration was read again and cannot be used, so that the old one holds: {error}");
                tell(&note, terminal);
                vec![Order::Say(note)]
            }
        }
    }

    fn adopt(
        &mut self,
        newer: &Bedside,
        terminal: Option<&Arc<Terminal>>,
        viewers: Option<&Arc<Viewers>>,
    ) -> Vec<Order> {
        let changes = self.bedside.changes(newer);
        self.newer = Some(newer.clone());
        let mut said = vec!["the configuration was read again".to_owned()];
        if changes.is_empty() {
            said.push("nothing has changed".into());
        }
        said.extend(changes.at_once.iter().map(|change| format!("from now on {change}")));
        said.extend(changes.next_session.iter().map(|change| format!("in the next session {change}")));
        let said = said.join("; ");
        tell(&said, terminal);
        let mut orders = vec![Order::Say(said)];
        if changes.at_once.is_empty() {
            return orders;
        }
        self.bedside.adopt(newer);
        let bedside = &self.bedside;
        orders.push(Order::Latency(0, bedside.tracking.latency_ns()));
        orders.push(Order::Latency(1, bedside.grabber.latency_ns));
        orders.push(Order::Frozen(bedside.scanner.frozen_ns));
        orders.push(Order::KeepFree(bedside.record.keep_free_bytes));
        let is_otherwise = changes.at_once.iter().any(|change| change.key.starts_with("picture."));
        if let Some(viewers) = viewers.filter(|_| is_otherwise) {
            viewers.look(&bedside.picture);
            orders.push(Order::Looks(Arc::clone(viewers) as Arc<dyn Looks>));
        }
        // A replay adopts it, too, but for latencies, which come in as they were told.
        match serde_json::to_value(Kept::of(newer)) {
            Ok(kept) => orders.push(Order::Note(ADOPTED, kept)),
            Err(error) => tracing::error!(%error, "the new configuration cannot be recorded"),
        }
        orders
    }
}

fn tell(note: &str, terminal: Option<&Arc<Terminal>>) {
    match terminal {
        Some(terminal) => terminal.print(&format!("sonoweave: {note}")),
        None => say(note),
    }
}

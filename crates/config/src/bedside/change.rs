//! Changes between two configurations, and the subset that a running session can adopt.

use std::fmt;

use serde::Serialize;
use serde_json::Value;

use super::schema;
use super::{Bedside, Tracking};

/// A key whose value changed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Change {
    /// Dotted.
    pub key: String,
    /// Old value; `null` if it was not given.
    pub from: Value,
    /// New value.
    pub to: Value,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = |value: &Value| if value.is_null() { "nothing said".to_owned() } else { value.to_string() };
        write!(f, "{}: {} → {}", self.key, text(&self.from), text(&self.to))
    }
}

/// All changes.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Changes {
    /// Changes that [`Bedside::adopt`] takes over.
    pub at_once: Vec<Change>,
    /// Changes that wait for the next session.
    pub next_session: Vec<Change>,
}

impl Changes {
    /// Whether nothing has changed.
    pub fn is_empty(&self) -> bool {
        self.at_once.is_empty() && self.next_session.is_empty()
    }
}

impl Bedside {
    /// Returns the changes from this configuration to a newer one. Another notation of an equal
    /// value is no change.
    pub fn changes(&self, newer: &Self) -> Changes {
        let mut changes = Changes::default();
        let keys = self.effective.keys().chain(newer.effective.keys().filter(|key| !self.effective.contains_key(*key)));
        for key in keys {
            let held = |bedside: &Self| bedside.effective.get(key).cloned().unwrap_or_default();
            let (from, to) = (held(self), held(newer));
            if from == to {
                continue;
            }
            // A device that was replaced by another has no key in common with it.
            let replaced = self.effective.contains_key(key) != newer.effective.contains_key(key);
            let at_once = !replaced && schema::key(key).is_some_and(|key| key.at_once);
            let list = if at_once { &mut changes.at_once } else { &mut changes.next_session };
            list.push(Change { key: key.clone(), from, to });
        }
        let is_listed = changes.next_session.iter().any(|change| change.key.starts_with("calibration."));
        if self.calibration != newer.calibration && !is_listed {
            let [from, to] = ["as it was read first", "written anew"].map(Value::from);
            changes.next_session.push(Change { key: "calibration.file".into(), from, to });
        }
        changes
    }

    /// Takes over from a newer configuration the changes in [`Changes::at_once`], and nothing
    /// else.
    pub fn adopt(&mut self, newer: &Self) {
        for change in self.changes(newer).at_once {
            self.effective.insert(change.key, change.to);
        }
        match (&mut self.tracking, &newer.tracking) {
            (own @ Tracking::Tracker(_), other @ Tracking::Tracker(_))
            | (own @ Tracking::Arm(_), other @ Tracking::Arm(_))
            | (own @ Tracking::Remote(_), other @ Tracking::Remote(_)) => own.set_latency_ns(other.latency_ns()),
            _ => {}
        }
        self.grabber.latency_ns = newer.grabber.latency_ns;
        self.scanner = newer.scanner;
        self.picture = newer.picture.clone();
        self.igtl = newer.igtl.clone();
        self.record.keep_free_bytes = newer.record.keep_free_bytes;
    }
}

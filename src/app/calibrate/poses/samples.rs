//! A stylus's poses, and counts of the used and refused items of a recording.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use sonoweave_core::frames::{Reference, Stylus, Transform};
use sonoweave_core::ledger::Ledger;
use sonoweave_core::refusal::{Reason, Refusal};

use crate::failure::Failure;

/// A stylus's poses.
#[derive(Debug)]
pub struct Poses {
    /// Name of the frame that they are in.
    pub frame: String,
    /// The transforms between: `Stylus → Tracker → Reference`.
    pub route: String,
    /// Time, s from the recording's beginning, and rigid pose, in the order of the recording.
    pub poses: Vec<(f64, Transform<Reference, Stylus>)>,
    /// Counts of used and refused items.
    pub counts: Counts,
}

/// Counts of used and refused items of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Counts {
    /// Items of the recording within the requested time.
    pub read: u64,
    /// Items with a pose.
    pub usable: u64,
    /// The other items, by reason.
    pub refused: BTreeMap<Reason, u64>,
    /// Reason of the first refusal.
    pub first_refusal: Option<String>,
}

impl Counts {
    /// Lists the refused items by reason, for a line of text; empty without any.
    pub(crate) fn refusals(&self) -> String {
        let listed: Vec<String> = self.refused.iter().map(|(reason, n)| format!("{n} {reason}")).collect();
        if listed.is_empty() { String::new() } else { format!(", refused: {}", listed.join(", ")) }
    }

    /// Notes the unusable items, for the end of a refusal.
    pub(crate) fn also(&self) -> String {
        match &self.first_refusal {
            Some(why) if self.usable < self.read => {
                format!(" ({} of {} poses could not be used; the first: {why})", self.read - self.usable, self.read)
            }
            _ => String::new(),
        }
    }
}

/// Collects samples, and counts the refused ones.
pub(crate) struct Taken<T> {
    /// Name of the samples, in words that follow a number.
    what: String,
    within_s: [f64; 2],
    ledger: Ledger,
    samples: Vec<(f64, T)>,
    first_refusal: Option<String>,
}

impl<T> Taken<T> {
    /// Takes the samples between two times from the recording's beginning, s.
    ///
    /// # Errors
    /// [`Failure`] if `from` is not before `to`.
    pub(crate) fn new(what: &str, from: Option<f64>, to: Option<f64>) -> Result<Self, Failure> {
        let within_s = [from.unwrap_or(f64::NEG_INFINITY), to.unwrap_or(f64::INFINITY)];
        let [begin, end] = within_s;
        if begin >= end {
            fail!("--from {begin} is not before --to {end}; give an earlier begin");
        }
        let (ledger, samples) = (Ledger::default(), Vec::new());
        Ok(Self { what: what.to_owned(), within_s, ledger, samples, first_refusal: None })
    }

    /// Takes a sample, or its refusal, at a time from the recording's beginning, s.
    pub(crate) fn put(&mut self, time_s: f64, sample: Result<T, Refusal>) {
        if time_s < self.within_s[0] || time_s > self.within_s[1] {
            return;
        }
        self.ledger.arrived();
        match sample {
            Ok(sample) => {
                self.ledger.used();
                self.samples.push((time_s, sample));
            }
            Err(refusal) => {
                self.ledger.refused(&refusal);
                self.first_refusal.get_or_insert_with(|| refusal.to_string());
            }
        }
    }

    /// Returns all samples; at least one.
    ///
    /// # Errors
    /// [`Failure`] with the reason if there is none.
    pub(crate) fn all(self, path: &Path) -> Result<(Vec<(f64, T)>, Counts), Failure> {
        let Self { what, ledger, samples, first_refusal, .. } = self;
        let read = ledger.frames.total;
        if samples.is_empty() {
            let why = match first_refusal {
                Some(why) => format!("none of {read} {what} is usable; the first: {why}"),
                None => "holds nothing from the given time; change --from or --to".to_owned(),
            };
            fail!("{}: {why}", path.display());
        }
        let counts = Counts { read, usable: samples.len() as u64, refused: ledger.frames.refused, first_refusal };
        Ok((samples, counts))
    }
}

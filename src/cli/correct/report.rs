//! Reports on corrections, as text and as JSON.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value};

use config::bedside::SettingsOverride;

use crate::app::correct::{Correction, Kind, Listed, State};
use crate::app::input::name_of;

/// A correction that was computed. Its fields are the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// Its number; `None` if it was not stored.
    pub(super) id: Option<u64>,
    kind: Kind,
    /// The file that it was stored in.
    file: PathBuf,
    settings: SettingsOverride,
    evidence: Map<String, Value>,
    #[serde(skip)]
    words: String,
    /// Sentences on corrections that are stale now.
    pub(super) stale: Vec<String>,
}

impl Report {
    pub(super) fn new(correction: &Correction, file: &Path) -> Self {
        let words = correction.words();
        let Correction { kind, settings, evidence, .. } = correction.clone();
        Self { id: None, kind, file: file.to_owned(), settings, evidence, words, stale: Vec::new() }
    }

    pub(super) fn text(&self) -> String {
        let mut text = format!("{}: {}\n", self.kind, self.words);
        text += &match self.id {
            Some(id) => format!("stored as correction {id} in {}", name_of(&self.file)),
            None => "not stored".to_owned(),
        };
        self.stale.iter().for_each(|sentence| text += &format!("\n{sentence}"));
        text
    }
}

/// The corrections of a session. Its fields are the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct List {
    /// Their file, if there is one.
    file: Option<PathBuf>,
    corrections: Vec<Line>,
}

#[derive(Debug, Serialize)]
struct Line {
    id: u64,
    kind: Kind,
    version: u32,
    program: String,
    state: State,
    settings: SettingsOverride,
    evidence: Map<String, Value>,
    #[serde(skip)]
    words: String,
}

impl List {
    pub(super) fn new(file: &Path, all: Vec<Listed>) -> Self {
        let line = |Listed { correction, program, state }: Listed| {
            let words = correction.words();
            let Correction { id, kind, version, settings, evidence, .. } = correction;
            Line { id, kind, version, program, state, settings, evidence, words }
        };
        let corrections: Vec<Line> = all.into_iter().map(line).collect();
        Self { file: (!corrections.is_empty()).then(|| file.to_owned()), corrections }
    }

    pub(super) fn text(&self) -> String {
        if self.corrections.is_empty() {
            return "no corrections".to_owned();
        }
        let line = |Line { id, kind, state, words, .. }: &Line| {
            format!("{id}  {:<12} {:<8} {words}", kind.name(), state.name())
        };
        self.corrections.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

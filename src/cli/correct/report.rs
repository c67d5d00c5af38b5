//! Reports on corrections, as text and as JSON.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value};

use config::bedside::SettingsOverride;

use crate::app::correct::{Correction, CorrectionFile, Kind, Standing};
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
    /// Sentences on corrections that are stale now.
    pub(super) stale: Vec<String>,
}

impl Report {
    pub(super) fn new(correction: &Correction, file: &Path) -> Self {
        let Correction { kind, settings, evidence, .. } = correction.clone();
        Self { id: None, kind, file: file.to_owned(), settings, evidence, stale: Vec::new() }
    }

    pub(super) fn text(&self) -> String {
        let mut text = format!("{}: {}\n", self.kind, moved(&self.evidence));
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
    corrections: Vec<Listed>,
}

#[derive(Debug, Serialize)]
struct Listed {
    id: u64,
    kind: Kind,
    version: u32,
    program: String,
    state: State,
    settings: SettingsOverride,
    evidence: Map<String, Value>,
}

/// A correction in a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum State {
    Applied,
    Stale,
    Undone,
}

impl State {
    fn name(self) -> &'static str {
        match self {
            Self::Applied => "applied",
            Self::Stale => "stale",
            Self::Undone => "undone",
        }
    }
}

impl List {
    pub(super) fn new(file: &CorrectionFile, standing: &Standing) -> Self {
        let state = |id: u64| match standing.each().find(|(correction, _)| correction.id == id) {
            Some((_, true)) => State::Applied,
            Some((_, false)) => State::Stale,
            None => State::Undone,
        };
        let listed = |(correction, program, _): (&Correction, &str, bool)| {
            let Correction { id, kind, version, settings, evidence, .. } = correction.clone();
            Listed { id, kind, version, program: program.to_owned(), state: state(id), settings, evidence }
        };
        let corrections: Vec<Listed> = file.all().map(listed).collect();
        Self { file: (!corrections.is_empty()).then(|| file.path().to_owned()), corrections }
    }

    pub(super) fn text(&self) -> String {
        if self.corrections.is_empty() {
            return "no corrections".to_owned();
        }
        let line = |listed: &Listed| {
            let Listed { id, kind, state, evidence, .. } = listed;
            format!("{id}  {:<12} {:<8} {}", kind.name(), state.name(), moved(evidence))
        };
        self.corrections.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}

/// Returns the numbers that all corrections have, in words.
fn moved(evidence: &Map<String, Value>) -> String {
    let number = |name: &str| evidence.get(name).and_then(Value::as_f64).unwrap_or(f64::NAN);
    if evidence.contains_key("signal") {
        return format!(
            "{} of {} frames are used; the body moves by {:.2} mm (standard deviation) in these, and by {:.2} mm in all; \
             a sweep at {:.1} mm/s leaves no holes",
            number("frames"),
            number("frames_before"),
            of_list(evidence, "motion_mm", 1),
            of_list(evidence, "motion_mm", 0),
            number("speed_mm_s")
        );
    }
    format!(
        "{} of {} frames have a pose; corners of images moved by {:.2} mm (rms; at most {:.2})",
        number("frames"),
        number("frames_before"),
        number("moved_rms_mm"),
        number("moved_most_mm")
    )
}

/// Returns a number of a list in the evidence.
fn of_list(evidence: &Map<String, Value>, name: &str, place: usize) -> f64 {
    evidence.get(name).and_then(|list| list.get(place)?.as_f64()).unwrap_or(f64::NAN)
}

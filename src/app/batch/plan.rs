//! Plans of batches: the rows of a manifest, checked, with their inputs' hashes and their keys.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::folder::RunFolder;
use super::key::{self, Input, Inputs};
use super::manifest::{self, BadRow, Row};
use super::select::Selection;
use crate::app::provenance::program;
use crate::failure::{Failure, FailureKind};

/// Most rows whose problems are listed.
const LISTED: usize = 20;

/// A sweep of a plan: a line of `plan.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Planned {
    pub(crate) id: String,
    /// Line of the manifest, from 1.
    pub(crate) row: u64,
    pub(crate) recording: PathBuf,
    pub(crate) config: Option<PathBuf>,
    /// The recording's files, then the configuration.
    pub(crate) inputs: Vec<Input>,
    /// Flags that the results follow from, in one form, with the defaults.
    pub(crate) settings: Vec<String>,
    /// Flags that change no result: threads, instruction set, memory.
    pub(crate) resources: Vec<String>,
    /// Names of the files: the volume's, then weights and planes.
    pub(crate) outputs: Vec<String>,
    pub(crate) program: String,
    /// Content key, 64 hexadecimal digits.
    pub(crate) key: String,
    /// Bytes of all frames' pixels: sweeps that cost more begin first.
    pub(crate) cost: u64,
    pub(crate) subject: Option<String>,
    pub(crate) session: Option<String>,
    pub(crate) tags: Vec<String>,
    /// Other columns of the manifest.
    pub(crate) other: Map<String, Value>,
}

/// Flags of a row, in one form.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Settings {
    pub(crate) settings: Vec<String>,
    pub(crate) resources: Vec<String>,
}

/// Brings a row's flags into one form; the second argument is whether it has a configuration. The
/// error is a sentence.
pub(crate) type Canonical<'a> = &'a (dyn Fn(&[String], bool) -> Result<Settings, String> + Sync);

/// Plans the sweeps of a manifest, and writes the plan, whole or not at all.
///
/// # Errors
/// [`Failure`] with all rows that cannot be used; nothing is written then.
pub(crate) fn plan(
    manifest: &Path,
    folder: &Path,
    outputs: &[String],
    canonical: Canonical<'_>,
) -> Result<(RunFolder, Vec<Planned>), Failure> {
    let (rows, mut bad) = manifest::read(manifest)?;
    let beside = manifest.canonicalize().map_err(|e| Failure::io(manifest, "reading", &e))?;
    let beside = beside.parent().unwrap_or(Path::new("/"));
    let (inputs, program) = (Inputs::default(), program());
    let planned: Vec<Result<Planned, BadRow>> = rows
        .into_par_iter()
        .map(|row| {
            let line = row.line;
            planned(row, beside, outputs, (&inputs, &program), canonical).map_err(|why| BadRow { line, why })
        })
        .collect();
    let mut sweeps = Vec::new();
    for sweep in planned {
        match sweep {
            Ok(sweep) => sweeps.push(sweep),
            Err(row) => bad.push(row),
        }
    }
    refuse(manifest, bad)?;
    let folder = RunFolder::create(folder)?;
    let mut text = Vec::new();
    for sweep in &sweeps {
        serde_json::to_writer(&mut text, sweep)?;
        // Writing to memory does not fail.
        let _ = text.write_all(b"\n");
    }
    folder.write(&folder.plan(), &text)?;
    Ok((folder, sweeps))
}

/// Refuses a manifest with unusable rows.
fn refuse(manifest: &Path, mut bad: Vec<BadRow>) -> Result<(), Failure> {
    if bad.is_empty() {
        return Ok(());
    }
    bad.sort_by_key(|row| row.line);
    let many = bad.len();
    let lines: String = bad.iter().take(LISTED).map(|BadRow { line, why }| format!("\n  row {line}: {why}")).collect();
    let more = if many > LISTED { format!("\n  and {} more", many - LISTED) } else { String::new() };
    let rows = if many == 1 { "one row".into() } else { format!("{many} rows") };
    let sentence = format!(
        "{}: {rows} cannot be used, and nothing is planned; correct the manifest:{lines}{more}",
        manifest.display()
    );
    Err(Failure::new(sentence).of(FailureKind::Input))
}

/// Plans a row; the error is a sentence.
fn planned(
    row: Row,
    beside: &Path,
    outputs: &[String],
    (known, program): (&Inputs, &str),
    canonical: Canonical<'_>,
) -> Result<Planned, String> {
    let Row { line, id, recording, calibration, config, settings: mut words, subject, session, tags, other } = row;
    let path = |column: &str, name: &str| {
        let path = beside.join(name);
        match path.is_file() {
            true => Ok(path),
            false => Err(format!("{column}: {} is no file; check the name", path.display())),
        }
    };
    let recording = path("recording", &recording)?;
    let mut config = config.map(|name| path("config", &name)).transpose()?;
    if let Some(calibration) = calibration {
        if is_matrix(&calibration) {
            words.extend(["--image-to-probe".to_owned(), calibration]);
        } else if config.is_none() {
            config = Some(path("calibration", &calibration)?);
        } else {
            return Err(
                "calibration and config: are both files, of which one is read; give one, or the 16 numbers as \
                        calibration"
                    .into(),
            );
        }
    }
    let Settings { settings, resources } =
        canonical(&words, config.is_some()).map_err(|why| format!("settings: {why}"))?;
    let (files, cost) = known.recording(&recording);
    let inputs: Vec<Input> = files.iter().chain(&config).map(|path| known.read(path)).collect::<Result<_, _>>()?;
    let key = key::content_key(&inputs, &settings, outputs, program);
    let (outputs, program) = (outputs.to_vec(), program.to_owned());
    Ok(Planned {
        id,
        row: line,
        recording,
        config,
        inputs,
        settings,
        resources,
        outputs,
        program,
        key,
        cost,
        subject,
        session,
        tags,
        other,
    })
}

/// Whether a calibration is given as the 16 numbers of a matrix.
fn is_matrix(text: &str) -> bool {
    let numbers: Vec<&str> = text.split([' ', ',']).filter(|part| !part.is_empty()).collect();
    numbers.len() == 16 && numbers.iter().all(|number| number.parse::<f64>().is_ok())
}

/// Reads the selected sweeps of a plan. Lines of others are not parsed: a task of a cluster selects
/// one of many.
///
/// # Errors
/// [`Failure`] when it cannot be read, or lacks a selected id.
pub(crate) fn read(folder: &RunFolder, selection: &Selection) -> Result<Vec<Planned>, Failure> {
    let path = folder.plan();
    let text = std::fs::read_to_string(&path).map_err(|e| Failure::io(&path, "reading", &e))?;
    let mut sweeps = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        if id_of(line).is_some_and(|id| !selection.has(id)) {
            continue;
        }
        let sweep: Planned = serde_json::from_str(line).map_err(|e| {
            let sentence = format!("{}: line {number}: {e}; plan the batch again", path.display());
            Failure::new(sentence).of(FailureKind::Input)
        })?;
        sweeps.push(sweep);
    }
    sweeps.retain(|sweep| selection.has(&sweep.id));
    selection.check(|id| sweeps.iter().any(|sweep| sweep.id == id))?;
    Ok(sweeps)
}

/// Returns the id of a line of a plan as [`plan`] writes it: the first field, without escapes.
fn id_of(line: &str) -> Option<&str> {
    Some(line.strip_prefix("{\"id\":\"")?.split_once('"')?.0)
}

/// Checks that a plan is of this program, whose results others' might not equal.
///
/// # Errors
/// [`Failure`] when it is of another one.
pub(crate) fn check_program(folder: &RunFolder, sweeps: &[Planned]) -> Result<(), Failure> {
    let program = program();
    match sweeps.iter().find(|sweep| sweep.program != program) {
        None => Ok(()),
        Some(other) => {
            let path = folder.plan();
            let sentence = format!(
                "{}: is by version {}, and this is {program}; plan the batch again, or run it by that version",
                path.display(),
                other.program
            );
            Err(Failure::new(sentence).of(FailureKind::Configuration))
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// A line with its fields sorted by name, so that the id is not the first.
    fn sorted(id: &str) -> String {
        json!({
            "id": id, "row": 2, "recording": "a.mha", "config": null, "inputs": [], "settings": [], "resources": [],
            "outputs": [], "program": "1", "key": "k", "cost": 1, "subject": null, "session": null, "tags": [],
            "other": {},
        })
        .to_string()
    }

    /// A line as a plan has it.
    fn line(id: &str) -> String {
        serde_json::to_string(&serde_json::from_str::<Planned>(&sorted(id)).unwrap()).unwrap()
    }

    #[test]
    fn lines_of_other_sweeps_are_not_parsed() {
        let place = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(&place.path().join("run")).unwrap();
        let ids = |selection: &Selection, lines: &[String]| {
            folder.write(&folder.plan(), lines.join("\n").as_bytes()).unwrap();
            let sweeps = read(&folder, selection).map_err(|failure| failure.0.sentence)?;
            Ok::<_, String>(sweeps.into_iter().map(|sweep| sweep.id).collect::<Vec<_>>())
        };
        let only = |id: &str| Selection { only: vec![id.to_owned()], part: None };
        let damaged = ["{\"id\":\"a\", damaged".to_owned(), line("b"), sorted("c"), line("bb")];
        assert_eq!(ids(&only("b"), &damaged).unwrap(), ["b"]);
        assert_eq!(ids(&only("c"), &damaged).unwrap(), ["c"]);
        assert!(ids(&only("a"), &damaged).unwrap_err().contains("line 1"));
        assert!(ids(&Selection::default(), &damaged).unwrap_err().contains("line 1"));
        assert!(ids(&only("x"), &damaged).unwrap_err().contains("no such id"));
        let whole = ["a", "b", "c", "d", "e"].map(line);
        let part = |text: &str| Selection { only: Vec::new(), part: Some(text.parse().unwrap()) };
        let mut parts = [ids(&part("1/2"), &whole).unwrap(), ids(&part("2/2"), &whole).unwrap()].concat();
        parts.sort();
        assert_eq!(parts, ["a", "b", "c", "d", "e"]);
    }
}

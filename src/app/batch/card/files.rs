//! Files of a card: BIDS-style, as there is no standard for tracked freehand ultrasound.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde_json::json;

use formats::whole::write_whole;

use super::{CalibrationUse, Card, SweepRow, croissant};
use crate::app::json::document;
use crate::app::provenance::program;
use crate::failure::Failure;

/// The names of the files, in the order in which they are written.
const NAMES: [&str; 5] = [SWEEPS, PARTICIPANTS, "dataset_description.json", "croissant.json", "README.md"];
const SWEEPS: &str = "sweeps.tsv";
const PARTICIPANTS: &str = "participants.tsv";

/// Cell of a table without a value, as BIDS asks.
const NONE: &str = "n/a";

/// Writes the files into a folder that exists. `license` is that of the data set, if it is known.
///
/// # Errors
/// [`Failure`] of the file system.
pub(crate) fn write(card: &Card, name: &str, license: Option<&str>, folder: &Path) -> Result<(), Failure> {
    let (sweeps, participants) = (sweeps(card), participants(card));
    let croissant = croissant::text(name, license, &[(SWEEPS, &sweeps), (PARTICIPANTS, &participants)])?;
    let texts = [sweeps, participants, description(card, name, license)?, croissant, readme(card, name, license)];
    for (file, text) in NAMES.iter().zip(texts) {
        let path = folder.join(file);
        write_whole(&path, |to| to.write_all(text.as_bytes())).map_err(|e| Failure::io(&path, "writing", &e))?;
    }
    Ok(())
}

fn table(columns: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let lines = std::iter::once(columns.join("\t")).chain(rows.map(|row| row.join("\t")));
    lines.map(|line| line + "\n").collect()
}

fn cell<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(|| NONE.to_owned(), |value| value.to_string())
}

/// Returns the table of all finished sweeps. `stem` begins the names of a sweep's files in the
/// layout.
fn sweeps(card: &Card) -> String {
    let columns = [
        "participant_id",
        "session_id",
        "run",
        "sweep",
        "folder",
        "stem",
        "frames",
        "frames_used",
        "seconds",
        "calibration_sha256",
        "volume_sha256",
    ];
    let row = |row: &SweepRow| {
        let labels = &row.labels;
        vec![
            format!("sub-{}", labels.subject),
            cell(labels.session.as_ref().map(|session| format!("ses-{session}"))),
            labels.run.to_string(),
            row.id.clone(),
            labels.folder(),
            labels.stem(),
            row.frames.total.to_string(),
            row.frames.used.to_string(),
            cell(row.seconds),
            cell(row.calibration.as_ref()),
            cell(row.volume.as_ref()),
        ]
    };
    table(&columns, card.rows.iter().map(row))
}

fn participants(card: &Card) -> String {
    let mut subjects: BTreeMap<&str, Vec<&SweepRow>> = BTreeMap::new();
    for row in &card.rows {
        subjects.entry(&row.labels.subject).or_default().push(row);
    }
    let row = |(subject, rows): (&str, Vec<&SweepRow>)| {
        let sessions: std::collections::BTreeSet<_> =
            rows.iter().filter_map(|row| row.labels.session.as_ref()).collect();
        let known = rows.iter().filter_map(|row| row.seconds).sum::<f64>();
        let sum = |count: fn(&SweepRow) -> u64| rows.iter().map(|row| count(row)).sum::<u64>().to_string();
        vec![
            format!("sub-{subject}"),
            sessions.len().to_string(),
            rows.len().to_string(),
            sum(|row| row.frames.total),
            sum(|row| row.frames.used),
            known.to_string(),
        ]
    };
    let columns = ["participant_id", "sessions", "sweeps", "frames", "frames_used", "seconds"];
    table(&columns, subjects.into_iter().map(row))
}

fn description(card: &Card, name: &str, license: Option<&str>) -> Result<String, Failure> {
    let mut described = json!({
        "Name": name,
        // The version whose general rules the names follow; BIDS has none for freehand ultrasound.
        "BIDSVersion": "1.10.0",
        "DatasetType": "derivative",
        "GeneratedBy": [{
            "Name": "sonoweave",
            "Version": program(),
            "Description": "BIDS-style. BIDS has no standard for tracked freehand ultrasound.",
        }],
        "Sonoweave": card,
    });
    if let Some(license) = license {
        described["License"] = license.into();
    }
    document(&described)
}

/// Returns a list with a line for each name and its number.
fn listed(counts: &BTreeMap<String, u64>) -> String {
    let line = |(name, count): (&String, &u64)| {
        let name = if name.is_empty() { "defaults" } else { name };
        format!("- {name}: {count}\n")
    };
    counts.iter().map(line).collect()
}

fn readme(card: &Card, name: &str, license: Option<&str>) -> String {
    let Card { sweeps, frames, recorded, calibrations, programs, settings, probes, subjects, .. } = card;
    let mut text = format!(
        "# {name}\n\nVolumes of tracked freehand ultrasound, reconstructed by sonoweave.\n\nFor research. Not a \
        medical device. Not for diagnosis or treatment.\n\nThe folders and names are BIDS-style. BIDS has no standard \
        for tracked freehand ultrasound, so that its validator knows neither the folder `us` nor the suffixes.\n\n"
    );
    // Writing to a string does not fail.
    if let Some(license) = license {
        let _ = writeln!(text, "License: {license}\n");
    }
    let _ = writeln!(
        text,
        "## Sweeps\n\n| | |\n|---|---|\n| subjects | {subjects} |\n| sweeps, planned | {} |\n| sweeps, done | {} |\n\
        | sweeps, failed | {} |\n| sweeps, not finished | {} |\n| frames | {} |\n| frames, used | {} |\n\
        | frames, refused | {} |\n| hours recorded | {:.4} |",
        sweeps.planned,
        sweeps.done,
        sweeps.failed,
        sweeps.waiting,
        frames.total,
        frames.used,
        frames.refused.values().sum::<u64>(),
        recorded.hours
    );
    if recorded.unknown > 0 {
        let _ = writeln!(
            text,
            "\nThe hours lack {} sweeps, whose recordings have no times or were not found.",
            recorded.unknown
        );
    }
    let refused = if frames.refused.is_empty() { "None.\n".into() } else { listed(&frames.refused) };
    let _ = writeln!(text, "\n## Refused frames by reason\n\n{refused}");
    let _ = writeln!(text, "## Calibrations\n\n{}", calibrated(calibrations));
    if !probes.is_empty() {
        let _ = writeln!(text, "## Sweeps by probe\n\n{}", listed(probes));
    }
    let _ = writeln!(text, "## Sweeps by setting of the reconstruction\n\n{}", listed(settings));
    let _ = writeln!(text, "## Sweeps by version of the program\n\n{}", listed(programs));
    text.push_str(
        "## Files\n\n- `dataset_description.json`: these numbers, for programs.\n- `croissant.json`: the tables, for \
        programs that load data sets (Croissant 1.0).\n- `participants.tsv`: a row for each \
        subject.\n- `sweeps.tsv`: a row for each sweep, with the folder and the first part of its files' names \
        (`…_sweep.igs.mha`, `…_sweep.json`, and `…_vol.mha` below `derivatives/sonoweave`).\n",
    );
    text
}

fn calibrated(calibrations: &[CalibrationUse]) -> String {
    if calibrations.is_empty() {
        return "No sweep has a calibration file: the recordings hold the transforms themselves.\n".into();
    }
    let line = |used: &CalibrationUse| {
        let error = used.error_mm.map_or_else(
            || "no stated error".to_owned(),
            |[mean, deviation]| format!("error at the phantom {mean} mm, standard deviation {deviation} mm"),
        );
        let corner = used.corner_mm.map_or_else(String::new, |mm| format!(", {mm} mm at the image's worst corner"));
        format!("- SHA-256 `{}`, sweeps: {}, {error}{corner}\n", used.sha256, used.sweeps)
    };
    calibrations.iter().map(line).collect()
}

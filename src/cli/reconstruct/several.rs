//! Reconstructs several recordings with one command: a volume each, and a table of results.

use crate::failure::Reason;
use std::path::{Path, PathBuf};

use statistics::Statistics;

use super::flags::Flags;
use super::one::reconstruct;
use crate::app::json::JsonFlag;
use crate::app::reconstruct::several::outputs;
use crate::cli::{Failure, FailureKind};

/// Reconstructs each recording into a volume of its name and a format, in a folder. A failed
/// recording does not affect the others.
///
/// # Errors
/// [`Failure`] before any work if the folder or names do not fit; else if a recording failed:
/// the others' volumes are written then.
pub(super) fn run(sequences: &[PathBuf], (folder, format): (&Path, &str), flags: &Flags) -> Result<(), Failure> {
    let outputs = outputs(sequences, (folder, format), &flags.beside.beside())?;
    let mut rows = vec![["recording", "frames", "voxels", "s", "volume"].map(str::to_owned)];
    let mut failed = 0;
    let mut documents = Vec::new();
    for (sequence, (output, beside)) in sequences.iter().zip(outputs) {
        let name = sequence.display().to_string();
        let json = beside.json.clone().map(JsonFlag::to_file);
        let reconstructed = reconstruct(sequence, &output, flags, beside, false);
        rows.push(match reconstructed.and_then(|done| written(json, done)) {
            Ok((statistics, document)) => {
                documents.push(document);
                done(name, &statistics, &output)
            }
            Err(Failure(Reason { sentence: why, .. })) => {
                failed += 1;
                [name, "–".into(), "–".into(), "–".into(), format!("failed: {why}")]
            }
        });
    }
    print_line!("\n{}", table(&rows).trim_end());
    if flags.beside.json.file().is_none() {
        flags.beside.json.write_text(&array(&documents))?;
    }
    match failed {
        0 => Ok(()),
        n => {
            let sentence = format!("{n} of {} recordings failed; see the table for the reasons", sequences.len());
            Err(Failure::new(sentence).of(FailureKind::SomeFailed))
        }
    }
}

/// Writes a recording's report to its file.
fn written(json: Option<JsonFlag>, done: (Statistics, String)) -> Result<(Statistics, String), Failure> {
    json.map_or(Ok(()), |json| json.write_text(&done.1))?;
    Ok(done)
}

/// Joins documents to one array.
fn array(documents: &[String]) -> String {
    let items: Vec<&str> = documents.iter().map(|document| document.trim_end()).collect();
    format!("[\n{}\n]\n", items.join(",\n"))
}

fn done(name: String, statistics: &Statistics, output: &Path) -> [String; 5] {
    let frames = &statistics.ledger.frames;
    let size = statistics.grid.size.map(|n| n.to_string()).join("×");
    let wall = format!("{:.1}", statistics.wall_s);
    [name, format!("{} of {}", frames.used, frames.total), size, wall, output.display().to_string()]
}

/// Formats cells in columns.
fn table(rows: &[[String; 5]]) -> String {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 5] = std::array::from_fn(width);
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}")).collect();
        text += cells.join("  ").trim_end();
        text.push('\n');
    }
    text
}

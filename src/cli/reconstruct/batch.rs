//! Reconstructs several recordings with one command: a volume each, and a table of results.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use statistics::Statistics;

use super::beside::Beside;
use super::flags::Flags;
use super::one::reconstruct;
use crate::cli::{Failure, input};

/// Reconstructs each recording into a volume of its name in a folder. A failed recording does
/// not affect the others.
///
/// # Errors
/// [`Failure`] before any work if the folder or names do not fit; else if a recording failed:
/// the others' volumes are written then.
#[allow(clippy::print_stdout, reason = "the command's output")]
pub(super) fn run(sequences: &[PathBuf], folder: &Path, flags: &Flags) -> Result<(), Failure> {
    let outputs = outputs(sequences, folder, &flags.beside)?;
    let mut rows = vec![["recording", "frames", "voxels", "s", "volume"].map(str::to_owned)];
    let mut failed = 0;
    for (sequence, (output, beside)) in sequences.iter().zip(outputs) {
        let name = sequence.display().to_string();
        rows.push(match reconstruct(sequence, &output, flags, beside) {
            Ok(statistics) => done(name, &statistics, &output),
            Err(Failure(why)) => {
                failed += 1;
                [name, "–".into(), "–".into(), "–".into(), format!("failed: {why}")]
            }
        });
    }
    print!("\n{}", table(&rows));
    match failed {
        0 => Ok(()),
        n => Err(Failure(format!("{n} of {} recordings failed; the table says why", sequences.len()))),
    }
}

fn done(name: String, statistics: &Statistics, output: &Path) -> [String; 5] {
    let frames = &statistics.ledger.frames;
    let size = statistics.grid.size.map(|n| n.to_string()).join("×");
    let wall = format!("{:.1}", statistics.wall_s);
    [name, format!("{} of {}", frames.used, frames.total), size, wall, output.display().to_string()]
}

/// Returns the outputs of each recording. Their names are the recording's name up to its first
/// point; each must be unique.
fn outputs(sequences: &[PathBuf], folder: &Path, folders: &Beside) -> Result<Vec<(PathBuf, Beside)>, Failure> {
    if !folder.is_dir() {
        fail!(
            "{}: is not a folder, but several recordings need one; make the folder, and give it with -o",
            folder.display()
        );
    }
    folders.check_folders()?;
    let mut taken = BTreeSet::new();
    let mut outputs = Vec::new();
    for sequence in sequences {
        let name = sequence.file_name().unwrap_or(sequence.as_os_str()).to_string_lossy();
        let stem = name.split('.').next().filter(|stem| !stem.is_empty()).unwrap_or("volume");
        let output = folder.join(format!("{stem}.mha"));
        if !taken.insert(output.clone()) {
            fail!(
                "{}: its volume and another recording's would both be {}; reconstruct them by separate commands",
                sequence.display(),
                output.display()
            );
        }
        // An output must not be any of the recordings.
        let beside = folders.of(stem);
        for path in beside.all().chain([&*output]) {
            sequences.iter().try_for_each(|sequence| input::check_is_not(path, sequence))?;
        }
        outputs.push((output, beside));
    }
    Ok(outputs)
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

//! Outputs of several recordings that are reconstructed by one command.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::beside::Beside;
use crate::app::input;
use crate::failure::Failure;

/// Returns the outputs of each recording. Their names are the recording's name up to its first
/// point; each must be unique.
///
/// # Errors
/// [`Failure`] if the folder or names do not fit.
pub(crate) fn outputs(
    sequences: &[PathBuf],
    (folder, format): (&Path, &str),
    folders: &Beside,
) -> Result<Vec<(PathBuf, Beside)>, Failure> {
    if !folder.is_dir() {
        fail_usage!(
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
        let output = folder.join(format!("{stem}.{format}"));
        if !taken.insert(output.clone()) {
            fail_usage!(
                "{}: its volume and another recording's would both be {}; run a command for each",
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

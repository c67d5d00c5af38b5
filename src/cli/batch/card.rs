//! `sonoweave batch card`: the card of a data set, from the accounts of a batch.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::app::batch::card::{files, read};
use crate::app::batch::folder::RunFolder;
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::pseudonym::PseudonymKey;
use crate::cli::Failure;

/// Flags of `batch card`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Writes README.md, dataset_description.json, croissant.json, participants.tsv and sweeps.tsv into FOLDER: sweeps, \
frames used and refused by reason, hours, calibrations with their errors, settings and versions. The numbers are \
sums over the accounts of the finished sweeps. Folders and names are BIDS-style; BIDS has no standard for freehand \
ultrasound.

With --key, subjects, sessions and sweeps have pseudonyms, the same as those of `convert --subject`.

Example: sonoweave batch card run -o dataset --name \"Forearms\" --key ~/study.key")]
pub(super) struct Arguments {
    /// Folder of the plan
    #[arg(value_name = "RUN")]
    folder: PathBuf,
    /// Write the files into this folder, which is made if it is missing
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Name of the data set
    #[arg(long, value_name = "TEXT", default_value = "Freehand ultrasound")]
    name: String,
    /// License of the data set, as its name or address [default: none is stated]
    #[arg(long, value_name = "TEXT")]
    license: Option<String>,
    /// Write the card of a batch that is not finished
    #[arg(long)]
    partial: bool,
    /// Secret key of pseudonyms: a file of 32 random bytes or more, kept apart from the data
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the batch is not finished, or a file cannot be read or written.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { folder, output, name, license, partial, key, json } = arguments;
    json.check([])?;
    for (flag, text) in [("name", Some(name)), ("license", license.as_ref())] {
        if let Some(text) = text.filter(|text| text.trim().is_empty() || text.chars().any(char::is_control)) {
            fail_usage!("--{flag} {text:?}: must be one line of text");
        }
    }
    let run = RunFolder::open(folder)?;
    if let Some(key) = key {
        check_apart(key, [run.path(), output])?;
    }
    let key = key.as_deref().map(PseudonymKey::read).transpose()?;
    let card = read(&run, *partial, key.as_ref())?;
    if output.exists() && !output.is_dir() {
        fail_usage!("{}: is a file; give a folder", output.display());
    }
    input::check_folder(output)?;
    std::fs::create_dir_all(output).map_err(|e| Failure::io(output, "making the folder", &e))?;
    files::write(&card, name, license.as_deref(), output)?;
    print_line!(
        "{}: {} of {} sweeps of {} subjects, {} of {} frames used, {:.4} hours",
        output.display(),
        card.sweeps.done,
        card.sweeps.planned,
        card.subjects,
        card.frames.used,
        card.frames.total,
        card.recorded.hours
    );
    json.write(&card)
}

/// Refuses a key that lies among the data, with which it would be passed on.
fn check_apart<'a>(key: &Path, folders: impl IntoIterator<Item = &'a Path>) -> Result<(), Failure> {
    let Ok(place) = key.canonicalize() else { return Ok(()) };
    let mut folders = folders.into_iter().filter_map(|folder| folder.canonicalize().ok());
    match folders.find(|folder| place.starts_with(folder)) {
        Some(_) => {
            fail_usage!("{}: lies among the data, which are passed on; move the key to another place", key.display())
        }
        None => Ok(()),
    }
}

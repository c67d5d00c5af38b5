//! `sonoweave batch plan`: checks a manifest, and writes the plan of its sweeps.

use std::path::PathBuf;

use clap::Args;

use super::settings::CanonicalSettings;
use crate::app::batch::done::is_done;
use crate::app::batch::plan::plan;
use crate::cli::Failure;
use crate::cli::reconstruct::FORMATS;

/// Flags of `batch plan`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Columns of the manifest: id, recording, calibration (a file, or 16 numbers), config, settings (flags of `reconstruct`), \
subject, session, tags; others are kept. Only the first two are needed. Paths are relative to the manifest's folder. A \
manifest with an unusable row is refused, with all such rows.

A plan may be made again in the same folder: sweeps whose inputs and settings are the same stay done.

Example: sonoweave batch plan manifest.csv -o run --format ome.zarr")]
pub(super) struct Arguments {
    /// Manifest: CSV, or JSON Lines by its ending .jsonl
    #[arg(value_name = "MANIFEST.csv")]
    manifest: PathBuf,
    /// Write the plan, and later the results, to this folder; it is made if missing
    #[arg(short, long, value_name = "RUN")]
    output: PathBuf,
    /// File format of the volumes
    #[arg(long, value_name = "FORMAT", default_value = "mha", value_parser = FORMATS)]
    format: String,
    /// Write the weights of each volume, too
    #[arg(long)]
    weights: bool,
    /// Draw the middle planes of each volume, too
    #[arg(long)]
    planes: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] with all unusable rows; nothing is written then.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { manifest, output, format, weights, planes } = arguments;
    let beside = [(weights, "weights.mha"), (planes, "planes.png")];
    let mut outputs = vec![format!("volume.{format}")];
    outputs.extend(beside.into_iter().filter(|(is_wanted, _)| **is_wanted).map(|(_, name)| name.to_owned()));
    let settings = CanonicalSettings::new(format);
    let (folder, sweeps) = plan(manifest, output, &outputs, &|words, has_config| settings.of(words, has_config))?;
    let done = sweeps.iter().filter(|sweep| is_done(&folder, sweep)).count();
    let megabytes = sweeps.iter().map(|sweep| sweep.cost as f64).sum::<f64>() / 1e6;
    let many = sweeps.len();
    print_line!(
        "{}: {many} sweep{} of {megabytes:.1} MB of pixels, {done} of them done",
        folder.plan().display(),
        if many == 1 { "" } else { "s" }
    );
    Ok(())
}

//! `sonoweave regions`: a volume that several processes reconstruct, each some of its regions.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::inspect::text::times;
use super::progress::steps;
use super::reconstruct::flags::Flags;
use super::{Failure, FailureKind};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::part::Part;
use crate::app::reconstruct::regions::processes::{self, Choice, RegionsStatus, RegionsVerified};

/// Commands of `regions`.
#[derive(Debug, Subcommand)]
pub enum Arguments {
    /// Plan a volume in regions, and begin it
    Plan(Box<PlanArguments>),
    /// Reconstruct regions of a planned volume
    Run(RunArguments),
    /// Show which regions are written
    Status(StatusArguments),
    /// Compare the files of a planned volume with their hashes
    Verify(VerifyArguments),
    /// Write the coarser levels of a volume whose regions are written, and give it its name
    Finish(FinishArguments),
}

/// Flags of `regions plan`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
All decisions that depend on several slices are taken here, once. The regions can then be reconstructed in any order, \
by any number of processes, on every machine that has the folder and the recording under the same names. The volume \
has the bytes of one that `sonoweave reconstruct` writes.

A region is as large as --max-memory permits, which is the memory of one process.

Example: sonoweave regions plan sweep.igs.mha --config PlusConfiguration.xml --spacing 0.1 -o limb.ome.zarr
         sonoweave regions run limb.ome.zarr --part 1/2
         sonoweave regions run limb.ome.zarr --part 2/2
         sonoweave regions finish limb.ome.zarr")]
pub struct PlanArguments {
    /// Recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    #[arg(value_name = "SEQUENCE")]
    sequence: PathBuf,
    /// Volume to plan (.ome.zarr)
    #[arg(short, long, value_name = "VOL.ome.zarr")]
    output: PathBuf,
    #[command(flatten)]
    flags: Flags,
}

/// Flags of `regions run`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Regions that are written already are kept, so that the command may be repeated after an interruption. If two \
processes write the same region, both write the same bytes.")]
pub struct RunArguments {
    /// Planned volume
    #[arg(value_name = "VOL.ome.zarr")]
    volume: PathBuf,
    /// Numbers of the regions, from 0 [default: all]
    #[arg(long, value_name = "N,N", value_delimiter = ',', conflicts_with = "part")]
    only: Vec<usize>,
    /// The K-th of N parts of about equal work, from 1
    #[arg(long, value_name = "K/N")]
    part: Option<Part>,
    /// Threads; any number gives the same volume [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Flags of `regions status`.
#[derive(Debug, Args)]
pub struct StatusArguments {
    /// Planned volume
    #[arg(value_name = "VOL.ome.zarr")]
    volume: PathBuf,
    #[command(flatten)]
    json: JsonFlag,
}

/// Flags of `regions verify`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
Every file of the volume that is written is read and hashed. The exit code is 3 if one is damaged. `regions finish` \
also refuses damaged files.")]
pub struct VerifyArguments {
    /// Planned volume
    #[arg(value_name = "VOL.ome.zarr")]
    volume: PathBuf,
    /// Delete damaged files, and reconstruct their regions again
    #[arg(long)]
    repair: bool,
    /// Threads; any number gives the same volume [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(flatten)]
    json: JsonFlag,
}

/// Flags of `regions finish`.
#[derive(Debug, Args)]
pub struct FinishArguments {
    /// Planned volume
    #[arg(value_name = "VOL.ome.zarr")]
    volume: PathBuf,
    /// Threads; any number gives the same volume [default: one a core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    #[command(flatten)]
    json: JsonFlag,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]: what is written stays, and an earlier volume is unchanged.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    match arguments {
        Arguments::Plan(arguments) => plan(arguments),
        Arguments::Run(arguments) => run_regions(arguments),
        Arguments::Status(arguments) => status(arguments),
        Arguments::Verify(arguments) => verify(arguments),
        Arguments::Finish(arguments) => finish(arguments),
    }
}

fn plan(PlanArguments { sequence, output, flags }: &PlanArguments) -> Result<(), Failure> {
    let (request, sweep) = flags.request(sequence, Some(output), flags.beside.beside())?;
    let plan = processes::plan(&request, sweep, &steps)?;
    let slices = plan.slices();
    print_line!(
        "{}: {} regions, met by up to {} slices each; a slice meets {:.1} (mean)",
        output.display(),
        plan.regions.len(),
        slices.iter().max().unwrap_or(&0),
        plan.meetings_per_slice(),
    );
    print_line!(
        "reconstruct them by `sonoweave regions run {0}`, then write the volume by `sonoweave regions finish {0}`",
        output.display()
    );
    flags.beside.json.write_text(&plan.document()?)
}

fn run_regions(RunArguments { volume, only, part, threads }: &RunArguments) -> Result<(), Failure> {
    let choice = match part {
        Some(part) => Choice::Part(*part),
        None if only.is_empty() => Choice::Part(Part { number: 1, of: 1 }),
        None => Choice::Only(only.clone()),
    };
    let [written, kept] = processes::run(volume, &choice, input::threads(*threads), &steps)?;
    print_line!("{}: {written} regions written, {kept} kept from before", volume.display());
    Ok(())
}

fn status(StatusArguments { volume, json }: &StatusArguments) -> Result<(), Failure> {
    json.check([volume.as_path()])?;
    let status = processes::status(volume)?;
    let RegionsStatus { done, regions } = &status;
    print_line!("{}: {done} of {} regions are written", volume.display(), regions.len());
    for (number, region) in regions.iter().enumerate().filter(|(_, region)| !region.done) {
        let [low, high] = region.voxels;
        let size = std::array::from_fn::<_, 3, _>(|a| high[a] - low[a] + 1);
        print_line!("  {number}: {} voxels from {low:?}, {} slices", times(size), region.slices);
    }
    json.write(&status)
}

fn verify(VerifyArguments { volume, repair, threads, json }: &VerifyArguments) -> Result<(), Failure> {
    json.check([volume.as_path()])?;
    let threads = input::threads(*threads);
    let verified = processes::verify(volume, threads, *repair)?;
    let RegionsVerified { whole, damaged, missing, regions } = &verified;
    print_line!(
        "{}: {whole} files are whole, {} damaged; {} regions are not written",
        volume.display(),
        damaged.len(),
        missing.len()
    );
    damaged.iter().for_each(|file| print_line!("  {file}"));
    json.write(&verified)?;
    if damaged.is_empty() {
        return Ok(());
    }
    if !repair {
        let sentence = format!(
            "{}: {} files are damaged; use --repair to reconstruct their regions again",
            volume.display(),
            damaged.len()
        );
        return Err(Failure::new(sentence).of(FailureKind::Input));
    }
    let [written, _] = processes::run(volume, &Choice::Only(regions.clone()), threads, &steps)?;
    print_line!("{}: {written} regions written again", volume.display());
    Ok(())
}

fn finish(FinishArguments { volume, threads, json }: &FinishArguments) -> Result<(), Failure> {
    json.check([volume.as_path()])?;
    let report = processes::finish(volume, input::threads(*threads))?;
    let number = |name: &str| report[name].as_u64().unwrap_or_default();
    print_line!(
        "{}: {} regions, {} voxels updated, {:.0} MB of bricks in the largest",
        volume.display(),
        report["regions"]["count"],
        number("voxels_updated"),
        number("bytes") as f64 / 1e6,
    );
    json.write(&report)
}

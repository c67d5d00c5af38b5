//! The command line: one file a subcommand, with its flags, help and tests.

#[macro_use]
mod print;

pub mod animate;
pub mod batch;
pub mod calibrate;
pub mod compare;
pub mod completions;
pub mod contours;
pub mod convert;
pub mod correct;
pub mod demo;
pub mod devices;
pub mod dicom;
pub mod doctor;
mod help;
mod igtl;
pub mod init;
pub mod inspect;
pub(crate) mod keywords;
pub mod live;
mod log;
pub mod man;
mod movie;
mod negative;
pub mod phantom;
mod progress;
pub mod reconstruct;
pub mod region;
pub mod regions;
mod renamed;
pub mod render;
pub mod repair;
pub mod replay;
mod smoothing;
pub mod surface;
pub mod twin;
mod version;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

pub use config::values;
use sonoweave_core::NOTICE;

use crate::app::batch::child;
use crate::app::json::Json;
pub use crate::failure::{Failure, FailureKind, Reason};
use log::LogFlags;
use negative::with_negative_numbers;

/// Freehand 3D ultrasound: reconstructs tracked slices into a volume as they arrive.
#[derive(Debug, Parser)]
#[command(name = "sonoweave", version, propagate_version = true, max_term_width = 110, after_help = NOTICE)]
#[command(after_long_help = format!("{}\n{NOTICE}", exit_codes()))]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    log: LogFlags,
    /// Whether stdout gets a JSON document instead of text.
    #[arg(skip)]
    is_json: bool,
}

impl Arguments {
    /// Parses the process's arguments; ends the process with a message if they are invalid.
    fn of_process() -> Self {
        Self::of(std::env::args_os()).unwrap_or_else(|error| error.exit())
    }

    /// Parses arguments, the program's name first.
    fn of(words: impl IntoIterator<Item = impl Into<OsString>>) -> Result<Self, clap::Error> {
        let words: Vec<OsString> = words.into_iter().map(Into::into).collect();
        let mut command = with_negative_numbers(help::grouped(Self::command()).long_version(version::long()));
        let matches = match command.try_get_matches_from_mut(&words) {
            Ok(matches) => matches,
            Err(error) => return Err(renamed::explain(error, &mut command, &words)),
        };
        let mut arguments = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        let mut last = &matches;
        while let Some((_, own)) = last.subcommand() {
            last = own;
        }
        arguments.is_json = matches!(last.try_get_one::<Json>("json"), Ok(Some(Json::Stdout)));
        Ok(arguments)
    }
}

/// Describes the exit codes.
fn exit_codes() -> String {
    let line = |kind: FailureKind| format!("  {:<4} {}\n", kind.code(), kind.words());
    let codes: String = FailureKind::ALL.map(line).concat();
    format!("Exit codes:\n  0    success\n{codes}")
}

/// Returns the command line, with everything that clap adds to it. The subcommand `help` is
/// omitted, because `--help` and the manual have its contents.
pub fn command_line() -> clap::Command {
    let mut command = help::grouped(Arguments::command()).disable_help_subcommand(true);
    command.build();
    command
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Reconstruct a recorded sweep into a volume
    Reconstruct(Box<reconstruct::Arguments>),
    /// Reconstruct a volume by several processes, each some of its regions
    #[command(subcommand)]
    Regions(regions::Arguments),
    /// Reconstruct many sweeps by a manifest, a process each
    Batch(batch::Arguments),
    /// Render a volume
    Render(Box<render::Arguments>),
    /// Replay a recorded session as it ran live, or with another configuration
    Replay(Box<replay::Arguments>),
    /// Correct the poses of a recorded session, list its corrections or undo them
    #[command(subcommand)]
    Correct(correct::Arguments),
    /// Reconstruct a recorded sweep while a picture follows, slice by slice
    Animate(Box<animate::Arguments>),
    /// Write the intact part of a damaged or interrupted session to a new file
    Repair(repair::Arguments),
    /// Convert a sequence, session or volume to another file format
    Convert(convert::Arguments),
    /// Describe a sequence, volume or calibration file
    Inspect(inspect::Arguments),
    /// Make a mesh of a grey value of a volume, and measure its area and volume
    Surface(surface::Arguments),
    /// Find the region of a volume that a seed lies in, and measure its volume
    Region(region::Arguments),
    /// Make the body between contours on planes, and measure its volume
    Contours(contours::Arguments),
    /// Compare two volumes: their difference, its places, and the settings that differ
    Compare(compare::Arguments),
    /// Run a live session: devices to a volume and its picture, recorded
    Live(Box<live::Arguments>),
    /// Calibrate image plane, latency, stylus, arm, phantom or tracker, with error estimates
    Calibrate(calibrate::Arguments),
    /// Run a session on a virtual bedside, which needs no hardware
    Demo(demo::Arguments),
    /// Write a session configuration for the devices of this machine, and check it
    Init(init::Arguments),
    /// Check this machine: devices, permissions, limits, disk, ports and browser
    Doctor(doctor::Arguments),
    /// List connected devices, their drivers, and problems in opening them
    Devices(devices::Arguments),
    /// Write a recorded sweep or a volume as DICOM, for a picture archive
    Dicom(dicom::Arguments),
    /// Make a synthetic sweep with known ground truth
    Phantom(Box<phantom::Arguments>),
    /// Simulate a tracker or an arm on a pseudo-terminal, for drivers to open
    Twin(Box<twin::Arguments>),
    /// Print completions of the command line for a shell
    Completions(completions::Arguments),
    /// Print a manual page, or write all of them to a folder
    Man(man::Arguments),
}

/// The program's main function: parses the process's arguments, runs the command, and returns the
/// exit code.
pub fn main() -> ExitCode {
    let ran = child::begin().and_then(|()| run(&Arguments::of_process()));
    child::end();
    match ran {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(Reason { sentence, kind })) => {
            progress::say(&sentence);
            ExitCode::from(kind.code())
        }
    }
}

/// Runs the requested command.
///
/// # Errors
/// [`Failure`] when the command failed.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Dropped when the command is done, which completes the file.
    let _trace = arguments.log.begin()?;
    let quiet = arguments.log.is_quiet();
    if arguments.is_json {
        print::leave_out();
    }
    match &arguments.command {
        Command::Reconstruct(arguments) => reconstruct::run(arguments),
        Command::Regions(arguments) => regions::run(arguments),
        Command::Batch(arguments) => batch::run(arguments, quiet),
        Command::Render(arguments) => render::run(arguments),
        Command::Replay(arguments) => replay::run(arguments, quiet),
        Command::Correct(arguments) => correct::run(arguments),
        Command::Animate(arguments) => animate::run(arguments),
        Command::Repair(arguments) => repair::run(arguments),
        Command::Convert(arguments) => convert::run(arguments),
        Command::Inspect(arguments) => inspect::run(arguments),
        Command::Surface(arguments) => surface::run(arguments),
        Command::Region(arguments) => region::run(arguments),
        Command::Contours(arguments) => contours::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Live(arguments) => live::run(arguments, quiet),
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Demo(arguments) => demo::run(arguments, quiet),
        Command::Init(arguments) => init::run(arguments),
        Command::Doctor(arguments) => doctor::run(arguments),
        Command::Devices(arguments) => devices::run(arguments),
        Command::Dicom(arguments) => dicom::run(arguments),
        Command::Phantom(arguments) => phantom::run(arguments),
        Command::Twin(arguments) => twin::run(arguments),
        Command::Completions(arguments) => completions::run(arguments, command_line()),
        Command::Man(arguments) => man::run(arguments, &command_line()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_replaces_text_only_without_file() {
        let parsed = |words: &str| Arguments::of(words.split(' ')).unwrap();
        assert!(parsed("sonoweave inspect v.mha --json").is_json);
        assert!(parsed("sonoweave calibrate pivot --sequence s.mha --json").is_json);
        assert!(!parsed("sonoweave inspect v.mha --json=r.json").is_json);
        assert!(!parsed("sonoweave completions bash").is_json);
        assert!(Arguments::of(["sonoweave", "replay", "--no-such-flag"]).is_err());
    }

    #[test]
    fn definitions_consistent_all_commands_have_help() {
        let mut command = Arguments::command();
        command.clone().debug_assert();
        for sub in command.get_subcommands_mut() {
            assert!(sub.get_about().is_some(), "{}", sub.get_name());
            let name = sub.get_name().to_owned();
            for arg in sub.get_arguments().filter(|a| !a.is_global_set()) {
                assert!(arg.get_help().is_some(), "{name} {}", arg.get_id());
            }
        }
    }

    #[test]
    fn failure_names_command_that_remedies_cause() {
        let damage = formats::session::Damage { from: 8, until: 20, what: "an incomplete chunk", is_loss: true };
        let damaged = formats::Error::Damaged { path: "s.mcap".into(), damage };
        let Failure(Reason { sentence: text, .. }) =
            pipeline::PipelineError::from(sonoweave_core::Error::from(damaged)).into();
        let expected = "repair the session by `sonoweave repair FILE -o OUT`, which lists the missing parts";
        assert!(text.ends_with(expected), "{text}");
        let foreign = formats::Error::NoSession { path: "s.mcap".into(), source: formats::NoSession::NoChunk };
        let Failure(Reason { sentence: text, .. }) = drivers::Error::from(foreign).into();
        assert!(text.ends_with("give a recorded session"), "{text}");
    }
}

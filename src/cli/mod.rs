//! The command line: one file a subcommand, with its flags, help and tests.

#[macro_use]
mod print;

pub mod calibrate;
pub mod compare;
pub mod convert;
pub mod demo;
pub mod devices;
pub mod dicom;
mod igtl;
pub mod inspect;
pub mod live;
pub mod phantom;
mod progress;
pub mod reconstruct;
pub mod render;
pub mod replay;
pub mod twin;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use tracing_subscriber::filter::FilterFn;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

pub use config::values;
use pipeline::trace::{self, TraceFile};
use sonoweave_core::NOTICE;

use crate::app::input;
pub use crate::failure::Failure;

/// Freehand 3D ultrasound: reconstructs tracked slices into a volume as they arrive.
#[derive(Debug, Parser)]
#[command(name = "sonoweave", version, propagate_version = true, max_term_width = 110, after_help = NOTICE)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Log to stderr with this filter: error, warn, info, debug, or a tracing filter
    #[arg(long, global = true, value_name = "FILTER", default_value = "warn")]
    log: String,
    /// Write per-frame stage timings, for Perfetto (ui.perfetto.dev) or chrome://tracing
    #[arg(long, global = true, value_name = "FILE.json")]
    trace: Option<PathBuf>,
    /// Names of the flags that were given to the subcommand.
    #[arg(skip)]
    given: Vec<String>,
}

impl Arguments {
    /// Parses the process's arguments; ends the process with a message if they are invalid.
    fn of_process() -> Self {
        Self::of(std::env::args_os()).unwrap_or_else(|error| error.exit())
    }

    /// Parses arguments, the program's name first.
    fn of(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Self, clap::Error> {
        let mut command = with_negative_numbers(Self::command());
        let matches = command.try_get_matches_from_mut(words)?;
        let mut arguments = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        if let Some((name, own)) = matches.subcommand() {
            let is_there = |id: &&str| own.value_source(id) == Some(ValueSource::CommandLine);
            // clap treats flags that share a struct as a group; such groups are not flags.
            let flags: Vec<&str> = command
                .find_subcommand(name)
                .map_or_else(Vec::new, |sub| sub.get_arguments().map(|flag| flag.get_id().as_str()).collect());
            let given = own.ids().map(clap::Id::as_str).filter(|id| flags.contains(id)).filter(is_there);
            arguments.given = given.map(str::to_owned).collect();
        }
        Ok(arguments)
    }
}

/// Lets flags take negative numbers, so that a range is refused by its own sentence.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let command = command.mut_args(|flag| match flag.get_action().takes_values() && !flag.is_positional() {
        true => flag.allow_negative_numbers(true),
        false => flag,
    });
    names.iter().fold(command, |command, name| command.mut_subcommand(name, with_negative_numbers))
}

/// Returns the log's filter.
fn log_filter(text: &str) -> Result<EnvFilter, Failure> {
    let refused = |why: &str| {
        Failure(format!(
            "--log {text}: {why}; give error, warn, info, debug, trace or off, or a filter such as warn,drivers=debug"
        ))
    };
    // A lone word that is no level would be taken for the name of a module.
    let lone = text
        .split(',')
        .map(str::trim)
        .find(|part| !part.contains(['=', '[']) && part.parse::<tracing_subscriber::filter::LevelFilter>().is_err());
    if let Some(lone) = lone {
        return Err(refused(&format!("{lone:?} is no level")));
    }
    EnvFilter::try_new(text).map_err(|e| refused(&e.to_string()))
}

impl Arguments {
    /// Starts logging, and tracing if requested. Returns the trace's file.
    fn listen(&self) -> Result<Option<TraceFile>, Failure> {
        let filter = log_filter(&self.log)?;
        let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_filter(filter);
        let (layer, file) = match &self.trace {
            Some(path) => {
                input::check_output(path)?;
                let begun = trace::begin(path).map_err(|e| Failure(format!("--trace {}: {e}", path.display())))?;
                (Some(begun.0.with_filter(FilterFn::new(trace::is_recorded))), Some(begun.1))
            }
            None => (None, None),
        };
        // A second subscriber in one process (tests) is no failure.
        let _ = tracing_subscriber::registry().with(log).with(layer).try_init();
        Ok(file)
    }
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Reconstruct a recorded sweep into a volume
    Reconstruct(Box<reconstruct::Arguments>),
    /// Render a volume
    Render(Box<render::Arguments>),
    /// Replay a recorded session, or reconstruct a recorded sweep while a picture follows
    Replay(Box<replay::Arguments>),
    /// Convert a sequence, session or volume to another file format
    Convert(convert::Arguments),
    /// Describe a sequence, volume or calibration file
    Inspect(inspect::Arguments),
    /// Compare two volumes: their difference, its places, and the settings that differ
    Compare(compare::Arguments),
    /// Run a live session: devices to a volume and its picture, recorded
    Live(Box<live::Arguments>),
    /// Calibrate image plane, latency, stylus, arm, phantom or tracker, with error estimates
    Calibrate(calibrate::Arguments),
    /// Run a session on a virtual bedside, which needs no hardware
    Demo(demo::Arguments),
    /// List connected devices, their drivers, and problems in opening them
    Devices(devices::Arguments),
    /// Write a recorded sweep or a volume as DICOM, for a picture archive
    Dicom(dicom::Arguments),
    /// Make a synthetic sweep with known ground truth
    Phantom(Box<phantom::Arguments>),
    /// Simulate a tracker or an arm on a pseudo-terminal, for drivers to open
    Twin(Box<twin::Arguments>),
}

/// The program's main function: parses the process's arguments, runs the command, and returns the
/// exit code.
#[allow(clippy::print_stderr, reason = "the one place where a command's failure is said")]
pub fn main() -> ExitCode {
    match run(&Arguments::of_process()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure(sentence)) => {
            eprintln!("sonoweave: {sentence}");
            ExitCode::FAILURE
        }
    }
}

/// Runs the requested command.
///
/// # Errors
/// [`Failure`] when the command failed.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Dropped when the command is done, which completes the file.
    let _trace = arguments.listen()?;
    match &arguments.command {
        Command::Reconstruct(arguments) => reconstruct::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Replay(of_replay) => replay::run(of_replay, &arguments.given),
        Command::Convert(arguments) => convert::run(arguments),
        Command::Inspect(arguments) => inspect::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Live(arguments) => live::run(arguments),
        Command::Calibrate(arguments) => calibrate::run(arguments),
        Command::Demo(arguments) => demo::run(arguments),
        Command::Devices(arguments) => devices::run(arguments),
        Command::Dicom(arguments) => dicom::run(arguments),
        Command::Phantom(arguments) => phantom::run(arguments),
        Command::Twin(arguments) => twin::run(arguments),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_lists_flags_without_groups() {
        let words = "sonoweave replay s.mcap --fill nearest --stats s.json --log info";
        let mut given = Arguments::of(words.split(' ')).unwrap().given;
        given.sort_unstable();
        assert_eq!(given, ["fill", "log", "sequence", "stats"]);
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
        let Failure(text) = pipeline::PipelineError::from(sonoweave_core::Error::from(damaged)).into();
        let expected = "repair the session by `sonoweave inspect FILE --repair OUT`, which lists the missing parts";
        assert!(text.ends_with(expected), "{text}");
        let foreign = formats::Error::NoSession { path: "s.mcap".into(), source: formats::NoSession::NoChunk };
        let Failure(text) = drivers::Error::from(foreign).into();
        assert!(text.ends_with("give a recorded session"), "{text}");
    }
}

//! The command line: one file a subcommand, with its flags, help and tests.

pub mod calibrate;
pub mod compare;
pub mod convert;
pub mod demo;
pub mod devices;
pub mod dicom;
mod histogram;
pub mod input;
pub mod inspect;
pub mod live;
pub mod phantom;
mod provenance;
pub mod reconstruct;
pub mod render;
pub mod replay;
pub mod twin;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use tracing_subscriber::filter::FilterFn;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer as _};

use crate::config::Unfit;
pub use crate::config::values;
use crate::trace::{self, TraceFile};

/// Freehand 3D ultrasound: tracked slices woven into a volume as they arrive.
#[derive(Debug, Parser)]
#[command(name = "sonoweave", version, propagate_version = true, max_term_width = 110)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// What to log to stderr: error, warn, info, debug, or a tracing filter
    #[arg(long, global = true, value_name = "FILTER", default_value = "warn")]
    log: String,
    /// Where to write where the time of each frame went, stage by stage, for Perfetto (ui.perfetto.dev) or chrome://tracing
    #[arg(long, global = true, value_name = "FILE.json")]
    trace: Option<PathBuf>,
    /// Flags of the subcommand that are there, by their names.
    #[arg(skip)]
    given: Vec<String>,
}

impl Arguments {
    /// The process's own; what cannot be parsed ends it, with a sentence.
    pub fn of_process() -> Self {
        Self::of(std::env::args_os()).unwrap_or_else(|error| error.exit())
    }

    /// Of words, the program's name first.
    fn of(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Self, clap::Error> {
        let mut command = Self::command();
        let matches = command.try_get_matches_from_mut(words)?;
        let mut arguments = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        if let Some((name, own)) = matches.subcommand() {
            let is_there = |id: &&str| own.value_source(id) == Some(ValueSource::CommandLine);
            // Flags that are kept in one struct are a group to clap, which is no flag.
            let flags: Vec<&str> = command
                .find_subcommand(name)
                .map_or_else(Vec::new, |sub| sub.get_arguments().map(|flag| flag.get_id().as_str()).collect());
            let given = own.ids().map(clap::Id::as_str).filter(|id| flags.contains(id)).filter(is_there);
            arguments.given = given.map(str::to_owned).collect();
        }
        Ok(arguments)
    }
}

impl Arguments {
    /// Begins to log, and to trace where that is asked for; the trace's file.
    fn listen(&self) -> Result<Option<TraceFile>, Failure> {
        let filter = EnvFilter::try_new(&self.log).map_err(|e| Failure(format!("--log {}: {e}", self.log)))?;
        let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_filter(filter);
        let (layer, file) = match &self.trace {
            Some(path) => {
                input::check_output(path)?;
                let begun = trace::begin(path).map_err(|e| Failure(format!("--trace {}: {e}", path.display())))?;
                (Some(begun.0.with_filter(FilterFn::new(trace::wanted))), Some(begun.1))
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
    /// Weave a recorded sweep into a volume
    Reconstruct(Box<reconstruct::Arguments>),
    /// Render a volume
    Render(Box<render::Arguments>),
    /// Run a recorded session again, or weave a recorded sweep while a picture follows
    Replay(Box<replay::Arguments>),
    /// Write a sequence, session or volume as another kind of file
    Convert(convert::Arguments),
    /// Say what is in a sequence, volume or calibration file
    Inspect(inspect::Arguments),
    /// Say how far two volumes are from each other, where, and which settings differ
    Compare(compare::Arguments),
    /// Run a session at the bedside: devices to a volume and its picture, recorded
    Live(Box<live::Arguments>),
    /// Find where the picture lies on the probe, how late the tracker is, and how sure that is
    Calibrate(calibrate::Arguments),
    /// Run a session on a virtual bedside, which needs no hardware
    Demo(demo::Arguments),
    /// Say what is plugged in, what can be opened, and why not
    Devices(devices::Arguments),
    /// Write a recorded sweep or a volume as DICOM, for a picture archive
    Dicom(dicom::Arguments),
    /// Make a synthetic sweep whose truth is known
    Phantom(Box<phantom::Arguments>),
    /// Play a tracker or an arm on a pseudo-terminal, for drivers to open
    Twin(Box<twin::Arguments>),
}

/// Why a command failed: a sentence for stderr, exit code 1.
#[derive(Debug)]
pub struct Failure(pub String);

impl<E: std::error::Error> From<E> for Failure {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

impl Failure {
    /// Of the flags that have the settings' names.
    fn flag(Unfit { setting, problem }: Unfit) -> Self {
        match setting {
            "" => Self(problem),
            _ => Self(format!("--{}: {problem}", setting.replace(", ", ", --").replace('_', "-"))),
        }
    }
}

/// Runs what the command line asks for.
///
/// # Errors
/// [`Failure`] when the command did not do it.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Dropped when the command is done: then the file is whole.
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
    fn what_is_given_are_flags_and_not_the_groups_that_hold_them() {
        let words = "sonoweave replay s.mcap --fill nearest --stats s.json --log info";
        let mut given = Arguments::of(words.split(' ')).unwrap().given;
        given.sort_unstable();
        assert_eq!(given, ["fill", "log", "sequence", "stats"]);
        assert!(Arguments::of(["sonoweave", "replay", "--no-such-flag"]).is_err());
    }

    #[test]
    fn the_definitions_are_consistent_and_every_command_explains_itself() {
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
}

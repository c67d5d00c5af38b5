//! `sonoweave live`: runs sessions, checks configurations and their devices, and prints keys and
//! examples.

mod arguments;
mod keys;
pub(super) mod report;
mod terminal;

use std::path::PathBuf;

use clap::{ArgGroup, Args, ValueEnum};

use config::bedside::{Bedside, schema};

use super::Failure;
use super::print::print;
use crate::app::json::JsonFlag;
use crate::app::live::check;
use arguments::{OutputFlags, SessionArguments};

/// Flags of `live`.
#[derive(Debug, Args)]
#[command(
    group(ArgGroup::new("modes")),
    group(ArgGroup::new("of_a_session").multiple(true).requires("config").conflicts_with_all(["keys", "keys_schema", "example", "check"]).args(["record", "console", "duration", "resume", "keep", "headless", "output", "weights", "error", "fill", "fill_radius", "picture", "igtl", "igtl_allow", "igtl_save", "igtl_wait"])),
    after_long_help = "\
With --config alone, a session runs until Ctrl-C, SIGTERM or the end of --duration, and then writes its outputs. A \
second signal ends it at once, without further outputs. --check opens all devices and waits 5 s at most for each. It \
reports the results, the faults and their remedies, and records nothing. The exit code is 0 only if there is no \
fault. The program simulates virtual devices itself.

Examples: sonoweave live --example virtual > bedside.toml
          sonoweave live --config bedside.toml --check
          sonoweave live --keys"
)]
pub struct Arguments {
    /// Session configuration: our TOML, or a PLUS device set with supported devices
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Open every device of the configuration, and report the results
    #[arg(long, group = "modes", requires = "config")]
    check: bool,
    #[command(flatten)]
    json: JsonFlag,
    /// Print every key that a configuration may have, its values, and when a change of it takes
    /// effect
    #[arg(long, group = "modes", conflicts_with = "config")]
    keys: bool,
    /// Print the JSON schema of configurations, for editors
    #[arg(long, group = "modes", conflicts_with = "config")]
    keys_schema: bool,
    /// Print a commented configuration to begin with
    #[arg(long, group = "modes", value_enum, value_name = "NAME", conflicts_with = "config")]
    example: Option<Example>,
    #[command(flatten, next_help_heading = "Session")]
    session_arguments: SessionArguments,
    #[command(flatten, next_help_heading = "Outputs")]
    outputs: OutputFlags,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Example {
    /// An arm with protocol EA1, and a frame grabber
    Arm,
    /// The calibration that goes with it: joints and probe
    ArmProbe,
    /// A FASTRAK on a serial line, and a frame grabber; shows most keys
    Fastrak,
    /// A LIBERTY on USB, and an HDMI grabber
    Liberty,
    /// A PLUS server in place of tracker and grabber
    PlusServer,
    /// The calibration that goes with all but the arm's
    Probe,
    /// No hardware at all
    Virtual,
    /// An arm without hardware
    VirtualArm,
}

impl Example {
    fn text(self) -> &'static str {
        match self {
            Self::Arm => include_str!("../../docs/examples/arm.toml"),
            Self::ArmProbe => include_str!("../../docs/examples/arm-probe.toml"),
            Self::Fastrak => include_str!("../../docs/examples/fastrak.toml"),
            Self::Liberty => include_str!("../../docs/examples/liberty.toml"),
            Self::PlusServer => include_str!("../../docs/examples/plus-server.toml"),
            Self::Probe => include_str!("../../docs/examples/probe.toml"),
            Self::Virtual => include_str!("../../docs/examples/virtual.toml"),
            Self::VirtualArm => include_str!("../../docs/examples/virtual-arm.toml"),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the configuration cannot be used, or a check fails.
pub fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    if let Some(example) = arguments.example {
        return print(example.text());
    }
    if arguments.keys {
        return print(&keys::text());
    }
    if arguments.keys_schema {
        return print(&format!("{:#}\n", schema::json()));
    }
    let Some(path) = &arguments.config else {
        fail_usage!(
            "--config: is missing; give a session configuration. `sonoweave live --example virtual` prints one without \
            hardware"
        );
    };
    let bedside = Bedside::read(path).map_err(Failure::configuration)?;
    if !arguments.check {
        let SessionArguments { headless, .. } = arguments.session_arguments;
        let (options, outputs) =
            (arguments.session_arguments.options(quiet), arguments.outputs.outputs(arguments.json.clone()));
        return report::run(&bedside, &options, headless, &outputs).map(drop);
    }
    let report = check::check(&bedside, arguments.session_arguments.accept_example)?;
    print(&report.text())?;
    arguments.json.write(&report)?;
    report.verdict().map_or(Ok(()), |sentence| Err(Failure::new(sentence)))
}

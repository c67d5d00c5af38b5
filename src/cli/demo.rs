//! `sonoweave demo`: runs a complete session on a virtual bedside, without hardware.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::Args;

use config::bedside::Bedside;
use formats::whole::write_whole;

use super::igtl::SharingFlags;
use super::live::report;
use super::progress::say;
use super::{Failure, values};
use crate::app::json::JsonFlag;
use crate::app::live::options::SessionOptions;
use crate::app::live::outputs::Outputs;

/// Session configuration, as `live --example virtual` prints it.
const BEDSIDE: &str = include_str!("../../docs/examples/virtual.toml");
/// The same with an arm, as `live --example virtual-arm` prints it.
const BEDSIDE_WITH_ARM: &str = include_str!("../../docs/examples/virtual-arm.toml");

/// Flags of `demo`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A simulated hand sweeps a virtual probe over a doll in a water tank. A virtual FASTRAK and a virtual frame grabber \
send their data to the real drivers, with realistic latency and jitter. The session is recorded, reconstructed slice \
by slice, and drawn in the terminal and on the page at the printed address. The command writes the session, the \
volume with its weights, the picture, the statistics, and a configuration for `live`. With --arm, a virtual arm \
carries a linear probe instead; it is homed within 3 s, and the planar path inserts its slices.

Example: sonoweave demo --duration 12 -o demo
         sonoweave replay demo/SESSION-….mcap --picture again.png")]
pub struct Arguments {
    /// Carry the probe by a virtual arm instead of a hand with a tracker
    #[arg(long)]
    arm: bool,
    /// End the session after so many seconds; a sweep takes ten [default: run until Ctrl-C or
    /// SIGTERM]
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Folder for the outputs; it is created if missing
    #[arg(short, long, value_name = "DIR", default_value = "demo")]
    output: PathBuf,
    /// Seed of all random numbers: the hand's tremor, speckle, delays
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u32,
    /// Address of the browser console, on this machine only; port 0 takes a free one
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:0", value_parser = values::loopback)]
    console: SocketAddr,
    /// Print progress lines instead of the volume in the terminal
    #[arg(long)]
    headless: bool,
    #[command(flatten, next_help_heading = "OpenIGTLink")]
    sharing: SharingFlags,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the folder cannot be written, or the session cannot begin.
pub fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    let out = &arguments.output;
    let failed = |path: &Path, e: std::io::Error| Failure(format!("{}: cannot be written: {e}", path.display()));
    std::fs::create_dir_all(out).map_err(|e| failed(out, e))?;
    let example = if arguments.arm { BEDSIDE_WITH_ARM } else { BEDSIDE };
    let text = example.replace("\nseed = 1\n", &format!("\nseed = {}\n", arguments.seed));
    let path = out.join("bedside.toml");
    write_whole(&path, |to| to.write_all(text.as_bytes())).map_err(|e| failed(&path, e))?;
    let bedside = Bedside::read(&path)?;
    let options = SessionOptions {
        record: Some(out.clone()),
        duration: arguments.duration,
        resume: None,
        console: Some(arguments.console),
        keep: None,
        accept_example: false,
        quiet,
        kind: "demo",
        sharing: arguments.sharing.sharing(),
    };
    let outputs = Outputs {
        volume: Some(out.join("volume.mha")),
        weights: Some(out.join("weights.mha")),
        picture: Some(out.join("picture.png")),
        filling: None,
        json: JsonFlag::to_file(out.join("statistics.json")),
    };
    let recorded = report::run(&bedside, &options, arguments.headless, &outputs)?;
    if let Some(recorded) = recorded {
        say(&format!("to run the same session again: sonoweave replay {} --picture again.png", recorded.display()));
    }
    Ok(())
}

//! `sonoweave demo`: runs a complete session on a virtual bedside, without hardware.

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;

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
volume, the picture, the statistics, and a configuration for `live`. With --arm, a virtual arm carries a linear probe \
instead, and the planar path inserts its slices.

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
    /// Address of the browser console, on this machine only; port 0 takes a free one [default:
    /// 127.0.0.1:9110, or the next free port]
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::loopback)]
    console: Option<SocketAddr>,
    /// Open the console in the browser, where there is a display
    #[arg(long)]
    open: bool,
    /// Print progress lines instead of the volume in the terminal
    #[arg(long)]
    headless: bool,
    #[command(flatten, next_help_heading = "OpenIGTLink")]
    sharing: SharingFlags,
}

/// First port of the console.
const PORT: u16 = 9110;
/// Ports that are tried.
const PORTS: u16 = 50;

/// Returns the first free port's address, and says so if it is not the usual one. The system
/// chooses if none of those that are tried is free.
fn free_address() -> SocketAddr {
    let mut addresses = (PORT..PORT + PORTS).map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    let free = addresses.find(|address| TcpListener::bind(address).is_ok());
    if free.is_none_or(|free| free.port() != PORT) {
        say(&format!("port {PORT} is in use; the console takes another"));
    }
    free.unwrap_or_else(|| SocketAddr::from((Ipv4Addr::LOCALHOST, 0)))
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the folder cannot be written, or the session cannot begin.
pub fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    let out = &arguments.output;
    std::fs::create_dir_all(out).map_err(|e| Failure::io(out, "making the folder", &e))?;
    let example = if arguments.arm { BEDSIDE_WITH_ARM } else { BEDSIDE };
    let text = example.replace("\nseed = 1\n", &format!("\nseed = {}\n", arguments.seed));
    let path = out.join("bedside.toml");
    write_whole(&path, |to| to.write_all(text.as_bytes())).map_err(|e| Failure::io(&path, "writing", &e))?;
    let bedside = Bedside::read(&path)?;
    let options = SessionOptions {
        record: Some(out.clone()),
        duration: arguments.duration,
        resume: None,
        console: Some(arguments.console.unwrap_or_else(free_address)),
        opens_browser: arguments.open,
        keep: None,
        accept_example: false,
        quiet,
        kind: "demo",
        sharing: arguments.sharing.sharing(),
    };
    let outputs = Outputs {
        volume: Some(out.join("volume.mha")),
        weights: None,
        errors: None,
        picture: Some(out.join("picture.png")),
        first_moment: false,
        filling: None,
        json: JsonFlag::to_file(out.join("statistics.json")),
    };
    let recorded = report::run(&bedside, &options, arguments.headless, &outputs)?;
    if let Some(recorded) = recorded {
        say(&format!("to run the same session again: sonoweave replay {} --picture again.png", recorded.display()));
    }
    Ok(())
}

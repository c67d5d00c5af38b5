//! `sonoweave demo`: a session on a virtual bedside, from the hand to the picture, for who has no hardware.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::Args;

use super::live::outputs::{Outputs, say};
use super::live::session::{Conduct, session};
use super::{Failure, values};
use crate::config::bedside::Bedside;

/// The bedside, as `live --example virtual` prints it.
const BEDSIDE: &str = include_str!("../../docs/examples/virtual.toml");

/// Flags of `demo`.
#[derive(Debug, Args)]
#[command(after_help = "\
A virtual hand sweeps a virtual probe over a doll in a water tank; a virtual FASTRAK and a virtual frame grabber deliver what they see to their own drivers, late and \
unevenly as at a bedside, and the session goes the way of every other: it is recorded, woven slice by slice, and drawn, in the terminal and on the page whose address it says. It leaves the session, the volume with its weights, the \
picture, the numbers, and the configuration, which `live` takes.

Example: sonoweave demo --duration 12 --out demo
         sonoweave replay demo/SESSION-….mcap --picture again.png")]
pub struct Arguments {
    /// Ends the session after so many seconds; a sweep takes ten [default: when it is told to end, by Ctrl-C or SIGTERM]
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Where to leave what it leaves; the folder is made if it is not there
    #[arg(long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
    /// Of all that is drawn at random: the hand's tremor, speckle, delays
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u32,
    /// Where browsers on this machine are shown the session; port 0 takes one that is free
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:0", value_parser = values::loopback)]
    console: SocketAddr,
    /// Does not show the volume in the terminal, but says how it goes
    #[arg(long)]
    headless: bool,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when nothing can be written there, or the session cannot begin.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let out = &arguments.out;
    let failed = |path: &Path, e: std::io::Error| Failure(format!("{}: cannot be written: {e}", path.display()));
    std::fs::create_dir_all(out).map_err(|e| failed(out, e))?;
    let text = BEDSIDE.replace("\nseed = 1\n", &format!("\nseed = {}\n", arguments.seed));
    let path = out.join("bedside.toml");
    std::fs::write(&path, &text).map_err(|e| failed(&path, e))?;
    let bedside = Bedside::read(&path)?;
    let conduct = Conduct {
        record: Some(out.clone()),
        duration: arguments.duration,
        headless: arguments.headless,
        console: Some(arguments.console),
        demo: true,
        ..Conduct::default()
    };
    let outputs = Outputs {
        volume: Some(out.join("volume.mha")),
        weights: Some(out.join("weights.mha")),
        picture: Some(out.join("picture.png")),
        stats: Some(out.join("statistics.json")),
        ..Outputs::default()
    };
    let recorded = session(&bedside, &conduct, &outputs)?;
    if let Some(recorded) = recorded {
        say(&format!("to run the same session again: sonoweave replay {} --picture again.png", recorded.display()));
    }
    Ok(())
}

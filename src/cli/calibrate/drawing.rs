//! `sonoweave calibrate drawing`: how a phantom is built, on paper.

use std::path::PathBuf;

use calibration::phantom::Plates;
use clap::Args;

use super::super::{Failure, input};
use super::outputs::print;
use crate::config::phantom::PhantomSettings;
use crate::export::drawing::drawing;
use crate::export::whole::write_whole;

/// Flags of `calibrate drawing`.
#[derive(Debug, Args)]
#[command(after_help = "\
The drawing is at 1:1: print it at 100 % and measure the rule on it. It is made of the same numbers that calibrate a probe, so that what is drilled by it is what is reckoned with.

Example: sonoweave calibrate drawing --phantom nwire.toml -o nwire.svg")]
pub struct Arguments {
    /// The phantom with its wires between two parallel plates: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: PathBuf,
    /// Where to write the drawing
    #[arg(short, long, value_name = "DRAWING.svg")]
    output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the phantom is not built of two plates, or does not fit on paper; nothing is written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { phantom, output } = arguments;
    input::check_output(output)?;
    input::check_is_not(output, phantom)?;
    let within = |problem: String| Failure(format!("{}: {problem}", phantom.display()));
    let geometry = PhantomSettings::read(phantom)?.geometry;
    let plates = Plates::of(&geometry).map_err(|e| within(e.to_string()))?;
    let svg = drawing(&geometry, &plates).map_err(|e| within(e.to_string()))?;
    write_whole(output, |to| to.write_all(svg.as_bytes()))
        .map_err(|e| Failure(format!("{}: writing failed: {e}", output.display())))?;
    let [front, back] = plates.plates.each_ref().map(|plate| plate.holes.len());
    print(&format!(
        "{}: {} wires between {front} holes in the front plate and {back} in the back one; print it at 100 %\n",
        output.display(),
        geometry.wires().len()
    ))
}

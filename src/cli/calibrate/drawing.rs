//! `sonoweave calibrate drawing`: a phantom's construction drawing.

use std::path::PathBuf;

use clap::Args;

use calibration::phantom::Plates;
use config::phantom::PhantomSettings;
use export::drawing::drawing;
use formats::whole::write_whole;

use super::super::Failure;
use crate::app::input;
use crate::cli::print::print;

/// Flags of `calibrate drawing`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The drawing has the scale 1:1; print it at 100 % and measure its ruler. Drilled holes match the calibration, because \
both use the same numbers.

Example: sonoweave calibrate drawing --phantom nwire.toml -o nwire.svg")]
pub struct Arguments {
    /// Phantom with its wires between two parallel plates: our file (TOML) or a PLUS XML
    #[arg(long, value_name = "FILE")]
    phantom: PathBuf,
    /// Write the drawing to this file
    #[arg(short, long, value_name = "DRAWING.svg")]
    output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the phantom does not have two plates, or does not fit on paper; nothing is
/// written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { phantom, output } = arguments;
    input::check_output(output)?;
    input::check_is_not(output, phantom)?;
    let within = |problem: String| Failure::new(format!("{}: {problem}", phantom.display()));
    let geometry = PhantomSettings::read(phantom)?.geometry;
    let plates = Plates::of(&geometry).map_err(|e| within(e.to_string()))?;
    let svg = drawing(&geometry, &plates).map_err(|e| within(e.to_string()))?;
    write_whole(output, |to| to.write_all(svg.as_bytes())).map_err(|e| Failure::io(output, "writing", &e))?;
    let [front, back] = plates.plates.each_ref().map(|plate| plate.holes.len());
    print(&format!(
        "{}: {} wires between {front} holes in the front plate and {back} in the back one; print it at 100 %\n",
        output.display(),
        geometry.wires().len()
    ))
}

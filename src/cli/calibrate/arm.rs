//! `sonoweave calibrate arm`: finds an arm's link lengths and encoder zeros, and checks them
//! later.

mod arguments;
mod guide;
mod report;
mod session;
mod touched;
mod work;

use std::path::{Path, PathBuf};

use super::super::Failure;
pub use arguments::Arguments;
use work::Work;

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the recording does not determine the arm, or the arm no longer matches its
/// fit.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let given = [&arguments.session, &arguments.live].into_iter().flatten();
    let inputs: Vec<&Path> = given.chain(arguments.places.file()).map(PathBuf::as_path).collect();
    arguments.outputs.check(&inputs, false)?;
    let made = arguments
        .gathering
        .of(arguments.live.as_ref())?
        .map(|bedside| guide::gathered(bedside, arguments))
        .transpose()?;
    // The command line guarantees that one of the two is present.
    let session = made.as_ref().or(arguments.session.as_ref()).map_or(Path::new(""), PathBuf::as_path);
    let work = Work { arguments, session };
    let recorded = arguments.which.read(session)?;
    let (arm, fit_rms_mm) = work.start(recorded.arm, recorded.fit_rms_mm)?;
    let touched = arguments.which.touches(session, &arm, &recorded.readings, arguments.places.read()?)?;
    if arguments.check {
        work.hold(&arm, fit_rms_mm, &recorded, &touched)
    } else {
        work.find(&arm, &recorded, &touched)
    }
}

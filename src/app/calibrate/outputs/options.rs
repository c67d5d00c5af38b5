//! Output flags of calibrations.

use std::path::PathBuf;

use clap::Args;

/// Output flags.
#[derive(Debug, Args)]
pub(crate) struct Outputs {
    /// Write the result into this calibration file (TOML); its other contents stay
    #[arg(short, long, value_name = "CAL.toml")]
    pub(super) output: Option<PathBuf>,
    /// Write the report: as JSON, or of `calibrate probe` also as a page for a browser (.html);
    /// may be given for both
    #[arg(long, value_name = "R.json|R.html")]
    pub(super) report: Vec<PathBuf>,
}

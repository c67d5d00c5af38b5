//! Output flags of calibrations.

use std::path::PathBuf;

use clap::Args;

use crate::app::json::JsonFlag;

/// Output flags.
#[derive(Debug, Clone, Args)]
pub(crate) struct Outputs {
    /// Write the result into this calibration file (TOML); its other contents stay
    #[arg(short, long, value_name = "CAL.toml")]
    pub(super) output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) json: JsonFlag,
    /// Page of the report for a browser; not every calibration has one.
    #[arg(skip)]
    pub(crate) page: Option<PathBuf>,
}

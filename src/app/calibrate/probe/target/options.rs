//! Flags of the methods that need no phantom file.

use std::path::PathBuf;

use clap::Args;

use config::values;

/// Flags of the methods that need no phantom file.
#[derive(Debug, Args)]
pub(crate) struct TargetOptions {
    /// Stylus tip, for --method stylus: a calibration file (TOML) or a PLUS XML with
    /// StylusTipToStylus
    #[arg(long, value_name = "FILE")]
    pub(super) stylus_tip: Option<PathBuf>,
    /// Name of the frame of the stylus's sensor
    #[arg(long, value_name = "NAME", default_value = "Stylus")]
    pub(super) stylus: String,
    /// Error of the tip's position on the stylus along each axis, mm (one standard deviation)
    #[arg(long, value_name = "MM", default_value_t = 0.3, value_parser = values::positive)]
    pub(super) tip_error: f64,
    /// Name of the frame in which the point or the plane rests [default: Reference if the
    /// recording has one, else Tracker]
    #[arg(long, value_name = "NAME")]
    pub(super) reference: Option<String>,
}

impl TargetOptions {
    /// Returns a given flag that the phantom's method has no use for, if any.
    pub(crate) fn given(&self) -> Option<&'static str> {
        match () {
            () if self.stylus_tip.is_some() => Some("--stylus-tip"),
            () if self.reference.is_some() => Some("--reference"),
            () => None,
        }
    }
}

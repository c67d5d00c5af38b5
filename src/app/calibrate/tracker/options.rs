//! Flags for the recording of one or two sensors.

use clap::Args;

use config::values;

use super::super::guide::Gathering;
use super::super::poses::Source;

/// The recording of one or two sensors.
#[derive(Debug, Args)]
pub(crate) struct Options {
    #[command(flatten)]
    pub(super) source: Source,
    #[command(flatten)]
    pub(super) gathering: Gathering,
    /// Name of the frame of the sensor
    #[arg(long, value_name = "NAME", default_value = "Probe")]
    pub(crate) sensor: String,
    /// Name of the frame of a second sensor, on the same rigid piece: for a map of the room
    #[arg(long, value_name = "NAME")]
    pub(crate) other: Option<String>,
    /// Name of the tracker's own frame
    #[arg(long, value_name = "NAME", default_value = "Tracker")]
    pub(crate) tracker: String,
    /// Edge of the map's cells, mm
    #[arg(long, value_name = "MM", default_value_t = 50.0, value_parser = values::positive, requires = "other")]
    pub(super) cell: f64,
    /// Warn of cells in which the sensors' distance from their nominal place is larger, mm (root
    /// mean square)
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = values::positive, requires = "other")]
    pub(crate) limit: f64,
    /// Leave out everything recorded before: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub(super) from: Option<f64>,
    /// Leave out everything recorded after: seconds from the recording's beginning
    #[arg(long, value_name = "S", value_parser = values::number)]
    pub(super) to: Option<f64>,
}

//! Flags of a session.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use crate::cli::igtl::Sharing;
use crate::cli::values;

/// Flags of a session.
#[derive(Debug, Clone, Default, Args)]
pub(in crate::cli) struct SessionArguments {
    /// Record the session in this folder; it is created if missing [default: the
    /// configuration's, or not recorded]
    #[arg(long, value_name = "DIR")]
    pub(in crate::cli) record: Option<PathBuf>,
    /// End the session after so many seconds [default: run until Ctrl-C or SIGTERM]
    #[arg(long, value_name = "S")]
    pub(in crate::cli) duration: Option<f64>,
    /// Resume a recorded session, for example after a crash: its slices are inserted into the
    /// volume first. The configuration must be the one that it was recorded with
    #[arg(long, value_name = "SESSION")]
    pub(in crate::cli) resume: Option<PathBuf>,
    /// Serve the browser console at this address: the page with image and volume, and the
    /// status. Other machines need certificate, key and token_file under status [default: the
    /// configuration's status.listen, or not served]
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    pub(in crate::cli) console: Option<SocketAddr>,
    /// Folder for the files that pages record, save and keep; it is created if missing [default:
    /// the recording's folder, or none]
    #[arg(long, value_name = "DIR")]
    pub(in crate::cli) keep: Option<PathBuf>,
    /// For trials: accept a calibration file that is an example, or whose rectangle reaches beyond
    /// the grabber's image. The slices' positions are then wrong
    #[arg(long, requires = "config")]
    pub(in crate::cli) accept_example: bool,
    /// Print no progress
    #[arg(long)]
    pub(in crate::cli) quiet: bool,
    /// Print progress lines instead of the volume in the terminal
    #[arg(long)]
    pub(in crate::cli) headless: bool,
    /// Set for the virtual bedside that comes with the program
    #[arg(skip)]
    pub(in crate::cli) demo: bool,
    #[command(flatten)]
    pub(in crate::cli) sharing: Sharing,
}

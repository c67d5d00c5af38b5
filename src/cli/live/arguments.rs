//! Flags of a session, and of its outputs.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use crate::app::json::JsonFlag;
use crate::app::live::options::SessionOptions;
use crate::app::live::outputs::Outputs;
use crate::cli::igtl::SharingFlags;
use crate::cli::reconstruct::filling::FillFlags;
use crate::cli::values;

/// Flags of a session.
#[derive(Debug, Args)]
pub(super) struct SessionArguments {
    /// Record the session in this folder; it is created if missing [default: the
    /// configuration's, or not recorded]
    #[arg(long, value_name = "DIR")]
    pub(super) record: Option<PathBuf>,
    /// End the session after so many seconds [default: run until Ctrl-C or SIGTERM]
    #[arg(long, value_name = "S")]
    pub(super) duration: Option<f64>,
    /// Resume a recorded session, for example after a crash: its slices are inserted into the
    /// volume first. The configuration must be the one that it was recorded with
    #[arg(long, value_name = "SESSION")]
    pub(super) resume: Option<PathBuf>,
    /// Serve the browser console at this address: the page with image and volume, and the
    /// status. Other machines need certificate, key and token_file under status [default: the
    /// configuration's status.listen, or not served]
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    pub(super) console: Option<SocketAddr>,
    /// Folder for the files that pages record, save and keep; it is created if missing [default:
    /// the recording's folder, or none]
    #[arg(long, value_name = "DIR")]
    pub(super) keep: Option<PathBuf>,
    /// For trials: accept a calibration file that is an example, or whose rectangle reaches beyond
    /// the grabber's image. The slices' positions are then wrong
    #[arg(long, requires = "config")]
    pub(super) accept_example: bool,
    /// Print progress lines instead of the volume in the terminal
    #[arg(long)]
    pub(super) headless: bool,
    #[command(flatten)]
    pub(super) sharing: SharingFlags,
}

impl SessionArguments {
    /// Returns the session's settings; `quiet` leaves out its progress.
    pub(super) fn options(&self, quiet: bool) -> SessionOptions {
        SessionOptions {
            record: self.record.clone(),
            duration: self.duration,
            resume: self.resume.clone(),
            console: self.console,
            opens_browser: false,
            keep: self.keep.clone(),
            accept_example: self.accept_example,
            quiet,
            kind: "live",
            sharing: self.sharing.sharing(),
        }
    }
}

/// Output flags of a session.
#[derive(Debug, Args)]
pub(super) struct OutputFlags {
    /// Write the volume to this file at the end (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz)
    #[arg(short, long, value_name = "VOL.mha")]
    output: Option<PathBuf>,
    /// Write its weights (same formats as the volume)
    #[arg(long, value_name = "W.mha")]
    weights: Option<PathBuf>,
    /// Write the standard error of its voxels, in grey levels: −1 for unseen ones. Needs
    /// volume.standard_error = true
    #[arg(long, value_name = "E.mha")]
    error: Option<PathBuf>,
    /// Correct each written value, by the slope around it, where slices lie beside their voxel on
    /// average, as between uneven gaps
    #[arg(long)]
    first_moment: bool,
    #[command(flatten)]
    filling: FillFlags,
    /// Write the picture at the end
    #[arg(long, value_name = "IMG.png")]
    picture: Option<PathBuf>,
}

impl OutputFlags {
    /// Returns the requested outputs, the report among them.
    pub(super) fn outputs(&self, json: JsonFlag) -> Outputs {
        let Self { output, weights, error, first_moment, filling, picture } = self;
        Outputs {
            volume: output.clone(),
            weights: weights.clone(),
            errors: error.clone(),
            first_moment: *first_moment,
            filling: filling.filling(),
            picture: picture.clone(),
            json,
        }
    }
}

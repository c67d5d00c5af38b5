//! `sonoweave replay`: replays a recorded session.

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::path::{Path, PathBuf};

use clap::Args;

use drivers::replay::Pace;

use super::igtl::SharingFlags;
use super::live::report::leave;
use super::movie::MovieFlags;
use super::progress::Lines;
use super::reconstruct::filling::FillFlags;
use super::{Failure, values};
use crate::app::input;
use crate::app::json::JsonFlag;
use crate::app::live::ended::Ended;
use crate::app::live::outputs::Outputs;
use crate::app::replay::series::Series;
use crate::app::replay::session::{self, ReplayRequest};
use crate::app::replay::showing;

/// Flags of `replay`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
The command reconstructs and draws a session as it ran live, with its recorded configuration, readings in their \
order, and new decisions. It compares the outcome with the recorded one, bit by bit. If they differ, it names the \
first different sample, and the exit code is 1. With --config it uses other settings, and compares nothing.

Corrections that `sonoweave correct` has stored beside the session are applied: the volume then is another one than \
the live one.

Examples: sonoweave replay SESSION-20261121-213000.mcap -o volume.mha --picture last.png
          sonoweave replay SESSION-20261121-213000.mcap --movie sweep.apng
          sonoweave replay SESSION-20261121-213000.mcap --console 127.0.0.1:9110")]
pub struct Arguments {
    /// Recorded session (.mcap)
    session: PathBuf,
    /// Write the volume to this file (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz) [default: not
    /// written]
    #[arg(short, long, value_name = "VOL.mha")]
    output: Option<PathBuf>,
    /// Session configuration with other settings: our TOML [default: the recorded one]
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the picture after the last slice to this file
    #[arg(long, value_name = "IMG.png")]
    picture: Option<PathBuf>,
    /// Speed: a multiple of the recorded speed, or max
    #[arg(long, value_name = "N|max", default_value = "max", value_parser = values::speed)]
    speed: Pace,
    /// Serve the session to browsers at this address, to look at single frames and to rerun it
    /// with other settings, until Ctrl-C; other machines need certificate, key and token_file
    /// under its configuration's status
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    console: Option<SocketAddr>,
    /// Folder for the files that pages save and keep; it is created if missing [default: none]
    #[arg(long, value_name = "DIR", requires = "console")]
    keep: Option<PathBuf>,
    #[command(flatten)]
    json: JsonFlag,
    /// Leave out the corrections of `sonoweave correct`
    #[arg(long, hide_short_help = true)]
    as_recorded: bool,
    /// Insert also the frames that the live stages dropped for lack of time. The volume differs
    /// then
    #[arg(long, hide_short_help = true)]
    all: bool,
    /// Write the weights too: 0 for unseen voxels, −1 for filled ones
    #[arg(long, value_name = "FILE.mha", help_heading = "Outputs", hide_short_help = true)]
    weights: Option<PathBuf>,
    /// Write the standard error of its voxels, in grey levels: −1 for unseen ones
    #[arg(long, value_name = "E.mha", help_heading = "Outputs", hide_short_help = true)]
    error: Option<PathBuf>,
    /// Existing folder for intermediate pictures, named by the frame: frame-00012.png
    #[arg(long, value_name = "DIR", help_heading = "Outputs", hide_short_help = true)]
    pictures: Option<PathBuf>,
    /// Number of slices between two intermediate pictures
    #[arg(
        long,
        value_name = "N",
        default_value = "1",
        requires = "pictures",
        help_heading = "Outputs",
        hide_short_help = true
    )]
    every: NonZeroU64,
    /// Correct each written value, by the slope around it, where slices lie beside their voxel on
    /// average, as between uneven gaps
    #[arg(long, help_heading = "Outputs", hide_short_help = true)]
    first_moment: bool,
    #[command(flatten)]
    movie: MovieFlags,
    #[command(flatten)]
    filling: FillFlags,
    #[command(flatten)]
    sharing: SharingFlags,
}

/// Runs the command; `quiet` leaves out its progress.
///
/// # Errors
/// [`Failure`]; intermediate pictures may have been written then.
pub fn run(arguments: &Arguments, quiet: bool) -> Result<(), Failure> {
    let path = &arguments.session;
    if !input::is_session(path)? {
        fail!(
            "{}: is not a session; use `sonoweave animate` to draw the reconstruction of a recorded sweep, or \
            `sonoweave reconstruct` to reconstruct it only",
            path.display()
        );
    }
    let request = arguments.request()?;
    let (lines, leave) = (Lines::new(quiet), |ended: &Ended<'_>| leave(&request.outputs, ended));
    match arguments.console {
        Some(address) => showing::run(&request, address, arguments.keep.as_deref(), &lines, &leave),
        None => session::run(&request, &lines, &leave),
    }
}

impl Arguments {
    /// Returns the request for the session.
    fn request(&self) -> Result<ReplayRequest<'_>, Failure> {
        Ok(ReplayRequest {
            session: &self.session,
            config: self.config.as_deref(),
            pace: self.speed,
            corrected: !self.as_recorded,
            all: self.all,
            series: series(self.pictures.as_deref(), self.every)?,
            movie: self.movie.request()?,
            outputs: Outputs {
                volume: self.output.clone(),
                weights: self.weights.clone(),
                errors: self.error.clone(),
                first_moment: self.first_moment,
                filling: self.filling.filling(),
                picture: self.picture.clone(),
                json: self.json.clone(),
            },
            sharing: self.sharing.sharing(),
        })
    }
}

/// Returns the intermediate pictures in an existing folder.
///
/// # Errors
/// [`Failure`] if the folder does not exist.
pub(super) fn series(pictures: Option<&Path>, every: NonZeroU64) -> Result<Option<Series>, Failure> {
    let Some(folder) = pictures else { return Ok(None) };
    if !folder.is_dir() {
        fail_usage!("--pictures {}: the folder does not exist; make it first", folder.display());
    }
    Ok(Some(Series { folder: folder.to_owned(), every }))
}

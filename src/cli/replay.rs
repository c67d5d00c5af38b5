//! `sonoweave replay`: reconstructs a recorded sweep into a volume, while a picture follows it
//! slice by slice.

mod report;

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use drivers::replay::Pace;
use formats::Limits;
use render::Cache;
use render::settings::CACHE_BYTES;

use super::igtl::SharingFlags;
use super::live::report::leave;
use super::progress::{Lines, steps};
use super::reconstruct::flags::Flags;
use super::reconstruct::one;
use super::render::view_flags::{Mode, ViewFlags};
use super::{Failure, values};
use crate::app::input;
use crate::app::live::ended::Ended;
use crate::app::live::outputs::Outputs;
use crate::app::render::look::Look;
use crate::app::replay::follow::reconstruct;
use crate::app::replay::following::Following;
use crate::app::replay::planes::{Planes, Source};
use crate::app::replay::series::Series;
use crate::app::replay::session::{self, ReplayRequest};
use crate::app::replay::showing;

/// Flags of `replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
The command reconstructs and draws a session as it ran live, with its recorded configuration, readings in their \
order, and new decisions. It compares the outcome with the recorded one, bit by bit. If they differ, it names the \
first different sample, and the exit code is 1. With --config it uses other settings, and compares nothing.

All flags of `reconstruct` and `render` apply to a sequence. --window sets the grey levels of black and white, both \
in the picture and in a written volume; --weights writes a file.

Examples: sonoweave replay SESSION-20261121-213000.mcap -o volume.mha --picture last.png
          sonoweave replay sweep.igs.mha --config PlusConfiguration.xml --picture last.png --stats replay.json")]
pub struct Arguments {
    /// Recorded session (.mcap), or a recorded sweep: a tracked sequence (.mha, .mhd, .nrrd,
    /// .nhdr)
    #[arg(value_name = "SESSION|SEQUENCE")]
    sequence: PathBuf,
    /// Write the volume to this file (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz) [default: not
    /// written]
    #[arg(short, long, value_name = "VOL.mha")]
    output: Option<PathBuf>,
    /// Speed: a multiple of the recorded speed, or max: a sequence's next slice comes when the
    /// picture of the last one is finished
    #[arg(long, value_name = "N|max", default_value = "max", value_parser = values::speed)]
    speed: Pace,
    /// Insert also the frames of a session that the live stages dropped for lack of time. The
    /// volume differs then
    #[arg(long)]
    all: bool,
    /// Write the picture after the last slice to this file
    #[arg(long, value_name = "IMG.png")]
    picture: Option<PathBuf>,
    /// Folder for intermediate pictures, named by the frame: frame-00012.png
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Number of slices between two intermediate pictures
    #[arg(long, value_name = "N", default_value = "1", requires = "pictures")]
    every: NonZeroU64,
    /// Contents of the ray cache between pictures; all give the same picture
    #[arg(long, value_enum, default_value_t, value_name = "CACHE")]
    cache: CacheName,
    /// Memory limit for the cache; beyond it, less is kept
    #[arg(long, value_name = "BYTES", default_value_t = CACHE_BYTES)]
    cache_bytes: u64,
    /// Source of the planes' values, with --mode slice
    #[arg(long, value_enum, default_value_t, value_name = "SOURCE")]
    from: SourceName,
    /// Serve a session to browsers at this address, to look at single frames and to rerun it
    /// with other settings, until Ctrl-C; other machines need certificate, key and token_file
    /// under its configuration's status
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    console: Option<SocketAddr>,
    /// Folder for the files that pages save and keep; it is created if missing [default: none]
    #[arg(long, value_name = "DIR", requires = "console")]
    keep: Option<PathBuf>,
    #[command(flatten)]
    look: ViewFlags,
    #[command(flatten, next_help_heading = "Reconstruction")]
    flags: Flags,
    #[command(flatten, next_help_heading = "OpenIGTLink, of a session")]
    sharing: SharingFlags,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum CacheName {
    /// Nothing: a ray that a change reaches is cast whole
    None,
    /// Every sample: only changed samples are interpolated again
    Linear,
    /// Every sample and every block's composite: only changed blocks are composited again
    #[default]
    TwoLevel,
    /// Every block's composite: a changed block's samples are interpolated again
    OneLevel,
}

/// Source of the planes' values.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum SourceName {
    /// The volume
    #[default]
    Volume,
    /// The nearest slice's own image, within a slice's reach across its plane
    Raw,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]; intermediate pictures may have been written then.
pub fn run(arguments: &Arguments, given: &[String]) -> Result<(), Failure> {
    if input::is_session(&arguments.sequence)? {
        let request = arguments.of_session(given)?;
        let (lines, leave) = (Lines::new(false), |ended: &Ended<'_>| leave(&request.outputs, ended));
        return match arguments.console {
            Some(address) => showing::run(&request, address, arguments.keep.as_deref(), &lines, &leave),
            None => session::run(&request, &lines, &leave),
        };
    }
    if arguments.console.is_some() {
        fail!("--console: applies to recorded sessions only; a sequence is reconstructed without pause");
    }
    if arguments.sharing.is_requested() {
        fail!("--igtl: applies to recorded sessions only; a sequence is reconstructed without pause");
    }
    if arguments.all {
        fail!("--all: has no effect for a sequence, whose frames are never dropped; leave it out");
    }
    let (request, mut sweep) = {
        let Arguments { sequence, output, flags, .. } = arguments;
        flags.request(sequence, output.as_deref(), flags.beside.beside())?
    };
    sweep.input.pace = arguments.speed;
    let (look, series) = arguments.look()?;
    let threads = sweep.session.settings.threads;
    let picture = arguments.picture.as_deref();
    if arguments.look.mode == Mode::Slice {
        let source = match arguments.from {
            SourceName::Volume => Source::Volume,
            SourceName::Raw => Source::Raw,
        };
        let planes = Planes::new(&look, arguments.flags.window, threads, series, source);
        let (outcome, planes) = reconstruct(sweep, planes, &steps)?;
        let statistics = planes.lock().finish(picture, &outcome)?;
        one::report(request.options(), &request.finish(outcome, statistics.as_ref())?);
        statistics.iter().for_each(|statistics| report::of_planes(statistics, picture));
        return Ok(());
    }
    let mut following = Following::new(&look, arguments.flags.window, threads, series);
    following.cache = match arguments.cache {
        CacheName::None => Cache::None,
        CacheName::Linear => Cache::Linear,
        CacheName::TwoLevel => Cache::TwoLevel,
        CacheName::OneLevel => Cache::OneLevel,
    };
    following.cache_bytes = arguments.cache_bytes;
    let (outcome, following) = reconstruct(sweep, following, &steps)?;
    let statistics = following.lock().finish(picture)?;
    one::report(request.options(), &request.finish(outcome, statistics.as_ref())?);
    statistics.iter().for_each(|statistics| report::of_rays(statistics, picture));
    Ok(())
}

impl Arguments {
    /// Returns the request for a session, which has its own settings; `given` are the flags on
    /// the command line.
    fn of_session(&self, given: &[String]) -> Result<ReplayRequest<'_>, Failure> {
        const KNOWN: [&str; 19] = [
            "console",
            "keep",
            "sequence",
            "output",
            "speed",
            "all",
            "picture",
            "pictures",
            "every",
            "config",
            "weights",
            "fill",
            "fill_radius",
            "stats",
            "log",
            "igtl",
            "igtl_allow",
            "igtl_save",
            "igtl_wait",
        ];
        if let Some(flag) = given.iter().find(|flag| !KNOWN.contains(&flag.as_str())) {
            fail!(
                "--{}: a session is replayed with its recorded configuration; to try another, give --config with a \
                session configuration",
                flag.replace('_', "-")
            );
        }
        Ok(ReplayRequest {
            session: &self.sequence,
            config: self.flags.config.as_deref(),
            pace: self.speed,
            all: self.all,
            series: self.on_the_way()?,
            outputs: Outputs {
                volume: self.output.clone(),
                weights: self.flags.beside.weights.clone(),
                filling: self.flags.filling.filling(),
                picture: self.picture.clone(),
                stats: self.flags.beside.stats.clone(),
            },
            sharing: self.sharing.sharing(),
        })
    }

    /// Returns the view and the settings of intermediate pictures. Refuses, before the work, a
    /// request without pictures or with impossible ones.
    fn look(&self) -> Result<(Look, Option<Series>), Failure> {
        if self.picture.is_none() && self.pictures.is_none() {
            // A file that is no sequence is named first.
            formats::image::content(&self.sequence, &Limits::default())?;
            fail!(
                "there is nothing to draw: give --picture for the last picture, or --pictures for all pictures; or use \
                `reconstruct`"
            );
        }
        if let Some(path) = &self.picture {
            input::check_png(path)?;
            input::check_output(path)?;
            input::check_is_not(path, &self.sequence)?;
        }
        let series = self.on_the_way()?;
        let look = self.look.look()?;
        if self.look.mode == Mode::Slice {
            let other =
                [("--cache", self.cache != CacheName::default()), ("--cache-bytes", self.cache_bytes != CACHE_BYTES)];
            if let Some((flag, _)) = other.iter().find(|(_, given)| *given) {
                fail!("{flag}: applies to rays, and --mode slice has none; leave it out");
            }
            if self.from == SourceName::Raw && self.look.planar.wants_weights() {
                return Err(Failure(
                    "--overlay weight: single slices have no weights; give --from volume, or --overlay coverage".into(),
                ));
            }
        } else if self.from == SourceName::Raw {
            return Err(Failure("--from raw: applies to planes only; give --mode slice, or leave it out".into()));
        }
        Ok((look, series))
    }

    /// Returns the existing folder of the intermediate pictures.
    fn on_the_way(&self) -> Result<Option<Series>, Failure> {
        let Some(folder) = &self.pictures else { return Ok(None) };
        if !folder.is_dir() {
            fail!("--pictures {}: the folder does not exist; make it first", folder.display());
        }
        Ok(Some(Series { folder: folder.clone(), every: self.every }))
    }
}

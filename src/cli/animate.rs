//! `sonoweave animate`: reconstructs a recorded sweep into a volume, while a picture follows it
//! slice by slice.

mod report;

use std::num::NonZeroU64;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use drivers::replay::Pace;
use formats::Limits;
use render::Cache;
use render::settings::CACHE_BYTES;

use super::movie::MovieFlags;
use super::progress::{say, steps};
use super::reconstruct::flags::Flags;
use super::reconstruct::one;
use super::render::view_flags::{Mode, ViewFlags};
use super::replay::series;
use super::{Failure, values};
use crate::app::input;
use crate::app::reconstruct::outputs::{Reconstructed, Request};
use crate::app::render::look::Look;
use crate::app::replay::follow::reconstruct;
use crate::app::replay::following::Following;
use crate::app::replay::planes::{Planes, Source};
use crate::app::replay::series::Series;
use crate::app::replay::session_movie::{MovieRequest, SessionMovie};

/// Flags of `animate`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
All flags of `reconstruct` and `render` apply. --window sets the grey levels of black and white, both in the picture \
and in a written volume; --weights writes a file.

Example: sonoweave animate sweep.igs.mha --config PlusConfiguration.xml --picture last.png --json=animate.json")]
pub struct Arguments {
    /// Recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    sequence: PathBuf,
    /// Write the volume to this file (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz) [default: not
    /// written]
    #[arg(short, long, value_name = "VOL.mha")]
    output: Option<PathBuf>,
    /// Speed: a multiple of the recorded speed, or max: the next slice comes when the picture of
    /// the last one is finished
    #[arg(long, value_name = "N|max", default_value = "max", value_parser = values::speed)]
    speed: Pace,
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
    #[command(flatten)]
    movie: MovieFlags,
    #[command(flatten)]
    look: ViewFlags,
    #[command(flatten)]
    flags: Flags,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum CacheName {
    /// Nothing: a ray that a change reaches is cast whole
    None,
    /// Every sample: only changed samples are interpolated again
    Linear,
    /// Every sample and every block's composite: only changed blocks are composited again
    TwoLevel,
    /// Every block's composite: a changed block's samples are interpolated again
    #[default]
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
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let sequence = &arguments.sequence;
    if input::is_session(sequence)? {
        fail!("{}: is a session; use `sonoweave replay`, which replays it as it ran", sequence.display());
    }
    let (request, mut sweep) = {
        let Arguments { output, flags, .. } = arguments;
        flags.request(sequence, output.as_deref(), flags.beside.beside())?
    };
    sweep.input.pace = arguments.speed;
    let movie = arguments.movie.request()?;
    let (look, series) = arguments.look(movie.as_ref())?;
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
        arguments.report(&request, &request.finish(outcome, statistics.as_ref())?)?;
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
    following.movie = movie.as_ref().map(|movie| SessionMovie::create(movie, look.view.image_size)).transpose()?;
    let (outcome, following) = reconstruct(sweep, following, &steps)?;
    let made = following.lock().movie.take();
    if let (Some(made), Some(MovieRequest { path, .. })) = (made, &movie) {
        say(&format!("{}: {}", path.display(), made.finish()?));
    }
    let statistics = following.lock().finish(picture)?;
    arguments.report(&request, &request.finish(outcome, statistics.as_ref())?)?;
    statistics.iter().for_each(|statistics| report::of_rays(statistics, picture));
    Ok(())
}

impl Arguments {
    /// Prints the result, or writes it as JSON.
    fn report(&self, request: &Request, done: &Reconstructed) -> Result<(), Failure> {
        one::report(request.options(), done);
        self.flags.beside.json.write_text(&done.written.document)
    }

    /// Returns the view and the settings of intermediate pictures. Refuses, before the work, a
    /// request without pictures or with impossible ones.
    fn look(&self, movie: Option<&MovieRequest>) -> Result<(Look, Option<Series>), Failure> {
        if self.picture.is_none() && self.pictures.is_none() && movie.is_none() {
            // A file that is no sequence is named first.
            formats::image::content(&self.sequence, &Limits::default())?;
            fail!(
                "there is nothing to draw: give --picture for the last picture, or --pictures or --movie for all \
                pictures; or use `reconstruct`"
            );
        }
        if let Some(path) = &self.picture {
            input::check_png(path)?;
            input::check_output(path)?;
            input::check_is_not(path, &self.sequence)?;
        }
        let series = series(self.pictures.as_deref(), self.every)?;
        let look = self.look.look()?;
        if let Some(MovieRequest { path, .. }) = movie {
            input::check_is_not(path, &self.sequence)?;
        }
        if self.look.mode == Mode::Slice {
            let other = [
                ("--cache", self.cache != CacheName::default()),
                ("--cache-bytes", self.cache_bytes != CACHE_BYTES),
                ("--movie", movie.is_some()),
            ];
            if let Some((flag, _)) = other.iter().find(|(_, given)| *given) {
                fail_usage!("{flag}: applies to rays, and --mode slice has none; leave it out");
            }
            if self.from == SourceName::Raw && self.look.planar.wants_weights() {
                return Err(Failure::usage(
                    "--overlay weight: single slices have no weights; give --from volume, or --overlay coverage",
                ));
            }
        } else if self.from == SourceName::Raw {
            return Err(Failure::usage("--from raw: applies to planes only; give --mode slice, or leave it out"));
        }
        Ok((look, series))
    }
}

//! `sonoweave replay`: a recorded sweep becomes a volume, and a picture follows it slice by slice.

mod following;
mod planes;
mod reel;
mod series;
mod session;
mod showing;

use std::net::SocketAddr;
use std::num::NonZeroU64;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use drivers::OpenSettings;
use drivers::recording::Pace;

use super::igtl::Sharing;
use super::live::outputs::Outputs;
use super::reconstruct::flags::Flags;
use super::reconstruct::outputs::Request;
use super::render::check_png;
use super::render::look::{Look, Mode};
use super::{Failure, input, values};
use crate::pipeline::{self, Job, Onlooker, Outcome};
use crate::render::Cache;
use crate::render::settings::CACHE_BYTES;
use following::Following;
use planes::{Planes, Source};
use series::Series;

/// Flags of `replay`.
#[derive(Debug, Args)]
#[command(after_help = "\
A session is woven and drawn as when it was live, by the configuration that it holds: every reading at its turn, every decision made anew. What comes out is held against \
what the session says came out then, bit by bit; the exit code is 1 where they differ, and the first sample that does is named. With --config another bedside's settings are \
tried, of which there is nothing to compare.

To a sequence all flags of `reconstruct` and of `render` apply; --window says which grey levels are black and white in both the picture and a written volume, and \
--weights writes.

Examples: sonoweave replay SESSION-20261121-213000.mcap -o volume.mha --picture last.png
          sonoweave replay sweep.igs.mha --config PlusConfiguration.xml --picture last.png --stats replay.json")]
pub struct Arguments {
    /// The recorded session (.mcap), or a recorded sweep: a tracked sequence (.mha, .mhd, .nrrd, .nhdr)
    #[arg(value_name = "SESSION|SEQUENCE")]
    sequence: PathBuf,
    /// Where to write the volume (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz) [default: nowhere]
    #[arg(short, long, value_name = "VOL.mha")]
    output: Option<PathBuf>,
    /// How fast: so many times as it was recorded, or max: a sequence's next slice comes when the picture of the last one is finished
    #[arg(long, value_name = "N|max", default_value = "max", value_parser = values::speed)]
    speed: Pace,
    /// Of a session: use also what was dropped when it was live, as a stage had no time for it. The volume is another one then
    #[arg(long)]
    all: bool,
    /// Where to write the picture after the last slice
    #[arg(long, value_name = "IMG.png")]
    picture: Option<PathBuf>,
    /// A folder for pictures on the way, named by the frame: frame-00012.png
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Of how many slices one is pictured there
    #[arg(long, value_name = "N", default_value = "1", requires = "pictures")]
    every: NonZeroU64,
    /// What is kept of rays between pictures; all give the same picture
    #[arg(long, value_enum, default_value_t, value_name = "CACHE")]
    cache: CacheName,
    /// Memory that the cache may take; where it would take more, less is kept
    #[arg(long, value_name = "BYTES", default_value_t = CACHE_BYTES)]
    cache_bytes: u64,
    /// What planes show, with --mode slice
    #[arg(long, value_enum, default_value_t, value_name = "SOURCE")]
    from: Source,
    /// Of a session: shows it to browsers at this address, where its frames are looked at one by one and it is run again by other settings, until Ctrl-C; beyond this machine only with certificate, key and token_file under its configuration's status
    #[arg(long, value_name = "ADDR:PORT", value_parser = values::address)]
    console: Option<SocketAddr>,
    /// A folder for what pages save and keep; it is made if it is not there [default: nowhere]
    #[arg(long, value_name = "DIR", requires = "console")]
    keep: Option<PathBuf>,
    #[command(flatten)]
    look: Look,
    #[command(flatten, next_help_heading = "Reconstruction")]
    flags: Flags,
    #[command(flatten, next_help_heading = "OpenIGTLink, of a session")]
    sharing: Sharing,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum CacheName {
    /// Nothing: a ray that a change reaches is cast whole
    None,
    /// Every sample: only changed samples are interpolated again
    Linear,
    /// Every sample and the fold of every block: only changed blocks are folded again
    #[default]
    TwoLevel,
    /// The fold of every block: a changed block's samples are interpolated again
    OneLevel,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`]; pictures on the way may have been written then.
pub fn run(arguments: &Arguments, given: &[String]) -> Result<(), Failure> {
    if input::is_session(&arguments.sequence)? {
        let wanted = arguments.of_session(given)?;
        return match arguments.console {
            Some(address) => showing::run(&wanted, address, arguments.keep.as_deref()),
            None => session::run(&wanted),
        };
    }
    if arguments.console.is_some() {
        return Err(Failure(
            "--console: shows recorded sessions; a sequence is woven at once, and nobody could look on".into(),
        ));
    }
    if arguments.sharing.is_wanted() {
        return Err(Failure(
            "--igtl: is of recorded sessions; a sequence is woven at once, and nobody could look on".into(),
        ));
    }
    if arguments.all {
        return Err(Failure("--all: of a sequence nothing was ever dropped; leave it out".into()));
    }
    let (request, mut job) = {
        let Arguments { sequence, output, flags, .. } = arguments;
        Request::new(sequence, output.as_deref(), flags, flags.beside.clone())?
    };
    if let OpenSettings::Sequence(sequence) = &mut job.input {
        sequence.pace = arguments.speed;
    }
    let series = arguments.series()?;
    let threads = job.settings.threads;
    if arguments.look.mode == Mode::Slice {
        let mut planes = Planes::new(&arguments.look, arguments.flags.window, threads, series, arguments.from);
        let outcome = weave(job, &mut planes)?;
        let statistics = planes.finish(arguments.picture.as_deref(), &outcome)?;
        request.finish(outcome, statistics.as_ref())?;
        if let Some(statistics) = &statistics {
            planes::report(statistics, arguments.picture.as_ref());
        }
        return Ok(());
    }
    let mut following = Following::new(&arguments.look, arguments.flags.window, threads, series);
    following.cache = match arguments.cache {
        CacheName::None => Cache::None,
        CacheName::Linear => Cache::Linear,
        CacheName::TwoLevel => Cache::TwoLevel,
        CacheName::OneLevel => Cache::OneLevel,
    };
    following.cache_bytes = arguments.cache_bytes;
    let outcome = weave(job, &mut following)?;
    let statistics = following.finish(arguments.picture.as_deref())?;
    request.finish(outcome, statistics.as_ref())?;
    if let Some(statistics) = &statistics {
        following::report(statistics, arguments.picture.as_deref());
    }
    Ok(())
}

/// Weaves a recording while somebody looks on.
fn weave(job: Job, onlooker: &mut impl Onlooker) -> Result<Outcome, Failure> {
    let bar = input::progress("replaying", 1);
    let result = pipeline::reconstruct(job, onlooker, |p| {
        bar.set_length(p.total);
        bar.set_position(p.done);
    });
    bar.finish_and_clear();
    Ok(result?)
}

impl Arguments {
    /// What there is to say of a session, which has its own settings; `given` are the flags that are there.
    fn of_session(&self, given: &[String]) -> Result<session::Wanted<'_>, Failure> {
        const KNOWN: [&str; 18] = [
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
            "igtl_save",
            "igtl_wait",
        ];
        if let Some(flag) = given.iter().find(|flag| !KNOWN.contains(&flag.as_str())) {
            return Err(Failure(format!(
                "--{}: a session is woven and drawn by the configuration that it was recorded with; give --config with another bedside's file to try something else",
                flag.replace('_', "-")
            )));
        }
        Ok(session::Wanted {
            session: &self.sequence,
            config: self.flags.config.as_deref(),
            pace: self.speed,
            all: self.all,
            series: self.on_the_way()?,
            outputs: Outputs {
                volume: self.output.clone(),
                weights: self.flags.beside.weights.clone(),
                filling: self.flags.filling.clone(),
                picture: self.picture.clone(),
                stats: self.flags.beside.stats.clone(),
            },
            sharing: self.sharing.clone(),
        })
    }

    /// The pictures on the way; fails before the work, not after it, where there is nothing to draw, or no way to.
    fn series(&self) -> Result<Option<Series>, Failure> {
        if self.picture.is_none() && self.pictures.is_none() {
            return Err(Failure(
                "nothing to draw: give --picture, for the picture after the last slice, or --pictures, for those on the way; \
                 or choose `reconstruct`"
                    .into(),
            ));
        }
        if let Some(path) = &self.picture {
            check_png(path)?;
            input::check_output(path)?;
            input::check_is_not(path, &self.sequence)?;
        }
        let series = self.on_the_way()?;
        self.look.check()?;
        if self.look.mode == Mode::Slice {
            let other =
                [("--cache", self.cache != CacheName::default()), ("--cache-bytes", self.cache_bytes != CACHE_BYTES)];
            if let Some((flag, _)) = other.iter().find(|(_, given)| *given) {
                return Err(Failure(format!("{flag}: is for rays, and --mode slice has none; leave it out")));
            }
            if self.from == Source::Raw && self.look.planar.wants_weights() {
                return Err(Failure(
                    "--overlay weight: slices by themselves have no weights; give --from volume, or --overlay coverage"
                        .into(),
                ));
            }
        } else if self.from == Source::Raw {
            return Err(Failure("--from raw: is of planes; give --mode slice, or leave it out".into()));
        }
        Ok(series)
    }

    /// The folder of the pictures on the way, which is there.
    fn on_the_way(&self) -> Result<Option<Series>, Failure> {
        let Some(folder) = &self.pictures else { return Ok(None) };
        if !folder.is_dir() {
            return Err(Failure(format!("--pictures {}: there is no such folder; make it first", folder.display())));
        }
        Ok(Some(Series { folder: folder.clone(), every: self.every }))
    }
}

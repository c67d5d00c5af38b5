//! `sonoweave render`: renders a volume to a picture.

mod arguments;
pub(crate) mod keywords;
mod lighting;
mod planar;
pub(super) mod view_flags;

use std::path::PathBuf;

use config::view_settings::Draw;
use export::movie::Format;
use render::camera::View;
use render::classify::soft::SoftLight;

use super::Failure;
use super::progress::{say, steps};
use crate::app::input;
use crate::app::reconstruct::zarr::is_ome_zarr;
use crate::app::render::look::Look;
use crate::app::render::{Contents, Rendered, Request, Task, numbered};
pub use arguments::Arguments;
use view_flags::Mode;

/// Runs the command.
///
/// # Errors
/// [`Failure`]: the picture that failed was not written then.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { volume, output, turntable, .. } = arguments;
    let look = arguments.look()?;
    let request = Request {
        volume,
        weights: arguments.weights.as_deref(),
        output,
        window: arguments.window,
        turntable: *turntable,
        movie: Format::of(output).map(|_| arguments.movie_rate.of(output)).transpose()?,
        threads: input::threads(arguments.threads),
        memory_bytes: gibibytes(arguments.max_memory)?,
        level: arguments.level,
        task: match arguments.part {
            Some(part) => Task::Part(part, arguments.fold),
            None if arguments.composite.is_empty() => Task::Pictures,
            None => Task::Composite(arguments.composite.clone()),
        },
        look: &look,
    };
    let Rendered { contents, document, wall_s, notes } = request.run(&steps)?;
    for note in &notes {
        say(&format!("note: {note}"));
    }
    arguments.json.write_text(&document)?;
    let View { azimuth, elevation, roll, .. } = match contents {
        Contents::Planes(text) | Contents::Part(text) => {
            print_line!("{}: {text}, of {}, in {:.0} ms", output.display(), volume.display(), wall_s * 1e3);
            return Ok(());
        }
        Contents::Rays(view) => view,
    };
    let [width, height] = look.view.image_size;
    let name = match turntable {
        None => output.display().to_string(),
        Some(turns) if request.movie.is_some() => format!("{}, {turns} pictures", output.display()),
        Some(turns) => format!("{} and on, {turns} pictures", numbered(output, 0).display()),
    };
    print_line!(
        "{name}: {width}×{height} pixels of {}, {}, {}, from {azimuth}°, {elevation}°{}, in {:.0} ms",
        volume.display(),
        look.view.mode.name(),
        look.transfer_name(),
        if roll == 0.0 { String::new() } else { format!(", rolled {roll}°") },
        wall_s * 1e3
    );
    Ok(())
}

impl Arguments {
    /// Returns the view. Refuses, before the work, impossible outputs and settings that suit no
    /// volume.
    fn look(&self) -> Result<Look, Failure> {
        let is_movie = Format::of(&self.output).is_some();
        if !is_movie {
            self.movie_rate.check_none("give --turntable and a name that ends in .apng, .gif or .avi")?;
        } else if self.turntable.is_none() {
            fail_usage!(
                "{}: a movie needs the number of its pictures; give --turntable, or a name that ends in .png",
                self.output.display()
            );
        }
        match self.part {
            None if is_movie => {}
            None => input::check_png(&self.output)?,
            Some(_) if input::check_png(&self.output).is_ok() => {
                fail_usage!(
                    "{}: --part writes a message, which is no picture; give another name",
                    self.output.display()
                )
            }
            Some(_) => {}
        }
        input::check_output(&self.output)?;
        let inputs = || {
            let given = [Some(&self.volume), self.weights.as_ref()].into_iter().flatten();
            given.chain(&self.composite).map(PathBuf::as_path)
        };
        inputs().try_for_each(|from| input::check_is_not(&self.output, from))?;
        self.json.check(inputs())?;
        if let Some(what) = self.view_flags.planar.drawn().into_iter().find(|w| matches!(w, Draw::Slice | Draw::Probe))
        {
            fail_usage!(
                "--draw {}: a volume's file has no current slice; draw scale or cube, or use `replay`",
                what.name()
            );
        }
        let of_rays = [
            ("--turntable", self.turntable.is_some()),
            ("--part", self.part.is_some()),
            ("--composite", !self.composite.is_empty()),
        ];
        if let Some((flag, _)) = of_rays.iter().find(|(_, given)| *given && self.view_flags.mode == Mode::Slice) {
            fail_usage!("{flag}: does not apply to --mode slice; leave it out");
        }
        let in_processes = self.part.is_some() || !self.composite.is_empty();
        if in_processes && self.view_flags.adaptive > 0.0 {
            fail_usage!("--adaptive: a picture in parts casts every ray; leave it out");
        }
        if in_processes && !is_ome_zarr(&self.volume) {
            fail_usage!(
                "--part, --composite: apply to OME-Zarr volumes, of which a process reads a part; leave them out"
            );
        }
        if self.view_flags.planar.wants_weights() && self.weights.is_none() && !is_ome_zarr(&self.volume) {
            fail_usage!(
                "--overlay weight: the volume's file has no weights; give --weights with a file from `reconstruct \
                --weights`"
            );
        }
        if let Some(name) = &self.soft {
            if self.view_flags.mode != Mode::Shaded {
                fail_usage!("--soft: applies to --mode shaded only; leave one of both out");
            }
            SoftLight::preset(name, [0.0, 1.0]).map_err(|error| Failure::usage(format!("--soft: {error}")))?;
        }
        Ok(Look { soft: self.soft.clone(), ..self.view_flags.look()? })
    }
}

pub(super) fn gibibytes(gib: f64) -> Result<u64, Failure> {
    let bytes = gib * f64::from(1 << 30);
    if bytes > 0.0 && bytes.is_finite() {
        return Ok(bytes as u64);
    }
    Err(Failure::usage(format!("--max-memory {gib}: must be a positive number of GiB")))
}

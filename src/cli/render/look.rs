//! The flags of all commands that render: from where, what, and how finely.

use std::path::Path;

use calibration::frames::{Transform, Volume, World};
use clap::{Args, ValueEnum};
use glam::DVec3;

use super::planar::PlanarFlags;
use crate::cli::{Failure, values};
use crate::render::camera::{Camera, View};
use crate::render::settings::STOP;
use crate::render::transfer::Transfer;
use crate::render::{RenderSettings, Stage};

/// What a picture shows, and how.
#[derive(Debug, Args)]
#[command(next_help_heading = "Picture")]
pub(in crate::cli) struct Look {
    /// Pixels of the picture
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = values::picture_size)]
    pub(in crate::cli) image_size: ImageSize,
    /// From where: azimuth (0 looks along the world's +y, 90 along −x), elevation (90 looks down along −z), roll, degrees [default: from the deep side,
    /// aslant, with the probe on top; 30,20 if the volume does not say how its slices lay]
    #[arg(long, value_name = "AZ,EL[,ROLL]", value_parser = values::view, allow_hyphen_values = true)]
    pub(super) view: Option<Angles>,
    /// Angle that the smaller side of the picture sees, degrees, up to 170 [default: parallel rays]
    #[arg(long, value_name = "DEG")]
    pub(in crate::cli) perspective: Option<f64>,
    /// What of the volume is drawn
    #[arg(long, value_enum, default_value_t)]
    pub(in crate::cli) mode: Mode,
    /// Opacity and colour of grey levels: a preset (tissue, bone, surface, xray, phantom) or a file
    #[arg(long, value_name = "PRESET|FILE.toml", default_value = Transfer::PRESETS[0].0)]
    pub(in crate::cli) transfer: String,
    /// Distance of samples along a ray, in voxels
    #[arg(long, value_name = "VOXELS", default_value_t = STEP)]
    pub(in crate::cli) step: f64,
    /// Samples that are folded together [default: the power of two next to the root of a ray's samples]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..))]
    pub(in crate::cli) arity: Option<u32>,
    /// A ray ends where less of what lies behind would be seen, 0 to 1; 0 casts all
    #[arg(long, value_name = "T", default_value_t = STOP)]
    pub(in crate::cli) stop: f32,
    /// Leave rays out where the picture differs by less than this from one to the next, in parts of its full range, 0 to 1: 0.004 to 0.03 (1/255 to 8/255) are
    /// usual; 0 casts one a pixel and is exact
    #[arg(long, value_name = "EPS", default_value_t = 0.0)]
    pub(in crate::cli) adaptive: f32,
    /// Colour behind the volume: red, green, blue, 0 to 1
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = values::colour, allow_hyphen_values = true)]
    pub(in crate::cli) background: Colour,
    #[command(flatten)]
    pub(in crate::cli) planar: PlanarFlags,
}

// clap takes an array for its own notation of repeated values; named types are single values to it.
type ImageSize = [u32; 2];
type Colour = [f32; 3];
type Angles = [f64; 3];

const STEP: f64 = 1.0;
const BACKGROUND: Colour = [0.0; 3];

/// What of the volume is drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Mode {
    /// Lit matter, as opaque as --transfer says
    #[default]
    Shaded,
    /// Planes through the volume, by --at or --plane
    Slice,
}

impl Mode {
    /// The name on the command line and in statistics.
    pub(in crate::cli) fn name(self) -> &'static str {
        match self {
            Self::Shaded => "shaded",
            Self::Slice => "slice",
        }
    }
}

/// What the flags are where nobody gives them.
pub(super) struct Usual {
    pub(super) transfer: &'static str,
    pub(super) step: f64,
    pub(super) stop: f32,
    pub(super) background: Colour,
}

impl Look {
    pub(super) fn usual() -> Usual {
        Usual { transfer: Transfer::PRESETS[0].0, step: STEP, stop: STOP, background: BACKGROUND }
    }

    /// The view of a volume whose slices lie along these axes, turned by so many degrees about the world's z axis.
    pub(in crate::cli) fn view(&self, slice_axes: Option<[DVec3; 2]>, turned: f64, turns: bool) -> View {
        let usual = View::of_slices(slice_axes);
        let [azimuth, elevation, roll] = self.view.unwrap_or([usual.azimuth, usual.elevation, usual.roll]);
        View { azimuth: azimuth + turned, elevation, roll, perspective: self.perspective, turns }
    }

    /// Fails before any work where no volume could be rendered so.
    ///
    /// # Errors
    /// [`Failure`]: the flag and what it may be.
    pub(in crate::cli) fn check(&self) -> Result<(), Failure> {
        if !(0.0..=1.0).contains(&self.stop) {
            return Err(Failure(format!("--stop {}: must lie between 0 and 1", self.stop)));
        }
        if !(0.0..=1.0).contains(&self.adaptive) {
            return Err(Failure(format!(
                "--adaptive {}: must lie between 0, which casts all rays, and 1",
                self.adaptive
            )));
        }
        self.planar.check(self)?;
        self.transfer([0.0, 1.0])?;
        let stage = Stage::new(Transform::<World, Volume>::IDENTITY, [0; 3], [0; 3])?;
        Camera::new(&self.view(None, 0.0, false), self.image_size, self.step, &stage)?;
        Ok(())
    }

    /// How to render a volume whose slices lie along some axes, where grey levels go from black to white over `range`.
    ///
    /// # Errors
    /// [`Failure`] when there is no such transfer function.
    pub(in crate::cli) fn settings(
        &self,
        range: [f32; 2],
        slice_axes: Option<[DVec3; 2]>,
        threads: usize,
    ) -> Result<RenderSettings, Failure> {
        Ok(RenderSettings {
            view: self.view(slice_axes, 0.0, false),
            step: self.step,
            arity: self.arity,
            stop: self.stop,
            adaptive: self.adaptive,
            threads,
            ..RenderSettings::new(self.image_size, self.transfer(range)?)
        })
    }

    fn transfer(&self, range: [f32; 2]) -> Result<Transfer, Failure> {
        let name = self.transfer.as_str();
        if Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
            return Ok(Transfer::read(Path::new(name))?);
        }
        Transfer::preset(name, range.map(f64::from))
            .map_err(|e| Failure(format!("--transfer {name}: {e}; or give a file, whose name ends in .toml")))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        look: Look,
    }

    #[test]
    fn the_usual_look_is_the_one_that_nobody_asked_for() {
        let (look, usual) = (Command::parse_from(["render"]).look, Look::usual());
        assert_eq!((look.step, look.stop), (usual.step, usual.stop));
        assert_eq!((look.transfer.as_str(), look.background), (usual.transfer, usual.background));
        assert!(look.view.is_none() && look.perspective.is_none() && look.arity.is_none());
    }
}

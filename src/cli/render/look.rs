//! The flags of all commands that render: from where, what, and how finely.

use std::path::Path;

use calibration::frames::{Transform, Volume, World};
use clap::{Args, ValueEnum};
use glam::DVec3;

use super::lighting::Lighting;
use super::planar::PlanarFlags;
use crate::cli::{Failure, values};
use crate::render::camera::{Camera, View};
use crate::render::settings::STOP;
use crate::render::transfer::Transfer;
use crate::render::{self, RenderSettings, Shading, Stage};

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
    /// The grey level of which --mode iso draws the surface [default: halfway between black and white]
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    isovalue: Option<f64>,
    /// What --transfer classifies, in the modes shaded and opacity [default: voxel]
    #[arg(long, value_enum, value_name = "WHAT")]
    shading: Option<Classified>,
    /// Opacity and colour of grey levels: a preset (tissue, bone, surface, xray, phantom) or a file; the modes mip, average and iso use its colours
    /// only [default: tissue; for mip and average xray, whose greys are those of --window]
    #[arg(long, value_name = "PRESET|FILE.toml")]
    pub(super) transfer: Option<String>,
    /// Distance of samples along a ray, in voxels
    #[arg(long, value_name = "VOXELS", default_value_t = STEP)]
    pub(in crate::cli) step: f64,
    /// Samples that are folded together [default: the power of two next to the root of a ray's samples]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..))]
    pub(in crate::cli) arity: Option<u32>,
    /// A ray ends where less of what lies behind would be seen, 0 to 1, in the modes shaded and opacity; 0 casts all [default: 1/1024]
    #[arg(long, value_name = "T")]
    pub(super) stop: Option<f32>,
    /// Leave rays out where the picture differs by less than this from one to the next, in parts of its full range, 0 to 1: 0.004 to 0.03 (1/255 to 8/255) are
    /// usual; 0 casts one a pixel and is exact
    #[arg(long, value_name = "EPS", default_value_t = 0.0)]
    pub(in crate::cli) adaptive: f32,
    /// Colour behind the volume: red, green, blue, 0 to 1
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = values::colour, allow_hyphen_values = true)]
    pub(in crate::cli) background: Colour,
    #[command(flatten)]
    lighting: Lighting,
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
    /// The largest grey level along each ray
    Mip,
    /// The mean of the grey levels along each ray, as in an x-ray picture
    Average,
    /// The opaque surface of one grey level
    Iso,
    /// How much --transfer hides of what lies behind: white where all
    Opacity,
    /// Planes through the volume, by --at or --plane
    Slice,
}

impl Mode {
    /// The name on the command line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Shaded => "shaded",
            Self::Mip => "mip",
            Self::Average => "average",
            Self::Iso => "iso",
            Self::Opacity => "opacity",
            Self::Slice => "slice",
        }
    }

    fn classifies(self) -> bool {
        matches!(self, Self::Shaded | Self::Opacity)
    }

    fn is_lit(self) -> bool {
        matches!(self, Self::Shaded | Self::Iso)
    }
}

/// What the transfer function classifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Classified {
    /// Voxels, whose colours are interpolated: a new slice costs what it changes
    Voxel,
    /// Samples, whose grey levels and gradients are interpolated: sharper, and slow; for stills
    Sample,
}

/// What the flags are where nobody gives them.
pub(super) struct Usual {
    pub(super) step: f64,
    pub(super) background: Colour,
}

impl Look {
    pub(super) fn usual() -> Usual {
        Usual { step: STEP, background: BACKGROUND }
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
        if let Some(stop) = self.stop.filter(|stop| !(0.0..=1.0).contains(stop)) {
            return Err(Failure(format!("--stop {stop}: must lie between 0 and 1")));
        }
        if let Some(isovalue) = self.isovalue.filter(|value| !value.is_finite()) {
            return Err(Failure(format!("--isovalue {isovalue}: must be a finite number of grey levels")));
        }
        self.planar.check(self)?;
        self.check_mode()?;
        self.lighting.light()?;
        if !(0.0..=1.0).contains(&self.adaptive) {
            return Err(Failure(format!(
                "--adaptive {}: must lie between 0, which casts all rays, and 1",
                self.adaptive
            )));
        }
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
            mode: self.mode(range),
            light: self.lighting.light()?,
            step: self.step,
            arity: self.arity,
            stop: self.stops().unwrap_or(STOP),
            adaptive: self.adaptive,
            threads,
            ..RenderSettings::new(self.image_size, self.transfer(range)?)
        })
    }

    /// Flags that a mode does not heed are refused: who gives one expects something of it.
    fn check_mode(&self) -> Result<(), Failure> {
        let no_use = |flag: &str, why: &str| {
            Err(Failure(format!("{flag} is of no use to --mode {}, {why}: leave it out", self.mode.name())))
        };
        if self.isovalue.is_some() && self.mode != Mode::Iso {
            return no_use("--isovalue", "which draws no surface of one grey level");
        }
        if self.shading.is_some() && !self.mode.classifies() {
            return no_use("--shading", "which takes no opacities from --transfer");
        }
        if self.stop.is_some() && !self.mode.classifies() {
            return no_use("--stop", "in which nothing translucent hides what lies behind");
        }
        match self.lighting.given() {
            Some(flag) if !self.mode.is_lit() => no_use(flag, "on which no light falls"),
            _ => Ok(()),
        }
    }

    /// Where rays end, if they may end early.
    pub(in crate::cli) fn stops(&self) -> Option<f32> {
        self.mode.classifies().then(|| self.stop.unwrap_or(STOP))
    }

    fn mode(&self, [black, white]: [f32; 2]) -> render::Mode {
        let shading = match self.shading {
            None | Some(Classified::Voxel) => Shading::Voxel,
            Some(Classified::Sample) => Shading::Sample,
        };
        match self.mode {
            // Planes have no rays, and nobody asks for theirs.
            Mode::Shaded | Mode::Slice => render::Mode::Shaded(shading),
            Mode::Opacity => render::Mode::Opacity(shading),
            Mode::Mip => render::Mode::Maximum,
            Mode::Average => render::Mode::Average,
            Mode::Iso => {
                let halfway = 0.5 * (f64::from(black) + f64::from(white));
                render::Mode::Isosurface(self.isovalue.unwrap_or(halfway))
            }
        }
    }

    /// The transfer function's preset or file.
    pub(in crate::cli) fn transfer_name(&self) -> &str {
        let usual = match self.mode {
            Mode::Shaded | Mode::Iso | Mode::Opacity | Mode::Slice => Transfer::PRESETS[0].0,
            Mode::Mip | Mode::Average => "xray",
        };
        self.transfer.as_deref().unwrap_or(usual)
    }

    fn transfer(&self, range: [f32; 2]) -> Result<Transfer, Failure> {
        let name = self.transfer_name();
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
        assert_eq!((look.step, look.background), (usual.step, usual.background));
        assert!(look.transfer.is_none() && look.stop.is_none() && look.adaptive == 0.0);
        assert!(look.view.is_none() && look.perspective.is_none() && look.arity.is_none());
    }
}

//! The flags of all commands that render: view, mode, and quality.

use std::path::PathBuf;

use clap::Args;

use super::lighting::Lighting;
use super::planar::PlanarFlags;
use crate::app::render::look::Look;
use crate::cli::{Failure, values};
pub(in crate::cli) use config::view_settings::Mode;
use config::view_settings::{Classified, ViewSettings};
use render::classify::light::Light;
use render::crop::Crop;

/// View, mode and quality of a picture.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Picture")]
pub(in crate::cli) struct ViewFlags {
    /// Pixels of the picture
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = values::picture_size)]
    pub(in crate::cli) image_size: ImageSize,
    /// Viewing direction: azimuth (0 looks along the world's +y, 90 along −x), elevation (90
    /// looks down along −z), roll, degrees [default: oblique, from the deep side, with the probe
    /// on top; 30,20 if the volume's file does not hold the slices' axes]
    #[arg(long, value_name = "AZ,EL[,ROLL]", value_parser = values::view, allow_hyphen_values = true)]
    pub(super) view: Option<Angles>,
    /// Field of view of the picture's smaller side, degrees, up to 170 [default: parallel rays]
    #[arg(long, value_name = "DEG")]
    pub(in crate::cli) perspective: Option<f64>,
    /// Rendering mode
    #[arg(long, value_enum, default_value_t)]
    pub(in crate::cli) mode: Mode,
    /// Grey value of the surface in --mode iso [default: halfway between black and white]
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    isovalue: Option<f64>,
    /// Quantity that --transfer classifies, in the modes shaded and opacity [default: voxel]
    #[arg(long, value_enum, value_name = "WHAT")]
    shading: Option<Classified>,
    /// Opacity and colour of grey values: a preset (tissue, bone, surface, xray, phantom) or a
    /// file; the modes mip, average and iso use its colours only [default: tissue; for mip and
    /// average xray, whose greys are those of --window]
    #[arg(long, value_name = "PRESET|FILE.toml")]
    pub(super) transfer: Option<String>,
    /// Hide the parts of the volume that a crop file names: boxes, planes, balls and more. The
    /// volume stays as it is
    #[arg(long, value_name = "FILE.toml")]
    pub(in crate::cli) crop: Option<PathBuf>,
    /// Distance of samples along a ray, in voxels
    #[arg(long, value_name = "VOXELS", default_value_t = STEP)]
    pub(in crate::cli) step: f64,
    /// Samples composited in one block [default: the power of two next to the root of a ray's
    /// samples]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..))]
    pub(in crate::cli) arity: Option<u32>,
    /// End a ray if less than this part of the farther samples would be visible, 0 to 1, in the
    /// modes shaded and opacity; 0 disables this [default: 1/1024]
    #[arg(long, value_name = "T")]
    pub(super) stop: Option<f32>,
    /// Skip rays if neighbouring rays of the picture differ by less than this, in parts of its
    /// full range, 0 to 1: 0.004 to 0.03 (1/255 to 8/255) are usual; 0 casts one a pixel and is
    /// exact
    #[arg(long, value_name = "EPS", default_value_t = 0.0)]
    pub(in crate::cli) adaptive: f32,
    /// Parts of the volume, cut across its z axis, that threads render each by itself; any number
    /// gives the same picture [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(in crate::cli) parts: Option<u32>,
    /// Colour behind the volume: red, green, blue, 0 to 1
    #[arg(long, value_name = "R,G,B", default_value = "0,0,0", value_parser = values::colour, allow_hyphen_values = true)]
    pub(in crate::cli) background: Colour,
    #[command(flatten)]
    lighting: Lighting,
    #[command(flatten)]
    pub(in crate::cli) planar: PlanarFlags,
}

// clap takes an array for its own notation of repeated values; named types are single values to
// it.
type ImageSize = [u32; 2];
type Colour = [f32; 3];
type Angles = [f64; 3];

const STEP: f64 = 1.0;
const BACKGROUND: Colour = [0.0; 3];

/// Default values of the flags.
pub(super) struct Usual {
    pub(super) step: f64,
    pub(super) background: Colour,
}

impl ViewFlags {
    pub(super) fn usual() -> Usual {
        Usual { step: STEP, background: BACKGROUND }
    }

    /// Returns the settings. Refuses flags that suit no volume, before any work.
    ///
    /// # Errors
    /// [`Failure`] with the flag and its valid values.
    pub(in crate::cli) fn look(&self) -> Result<Look, Failure> {
        self.planar.check(self)?;
        let crop = self.crop.as_deref().map(Crop::read).transpose().map_err(config::Error::from)?;
        let view = ViewSettings { crop: crop.unwrap_or_default(), ..self.view_settings(self.lighting.light()?) };
        view.check().map_err(Failure::flag)?;
        Ok(Look { view, background: self.background, planar: self.planar.planes()?, soft: None })
    }

    fn view_settings(&self, light: Light) -> ViewSettings {
        ViewSettings {
            image_size: self.image_size,
            view: self.view,
            perspective: self.perspective,
            mode: self.mode,
            isovalue: self.isovalue,
            shading: self.shading,
            transfer: self.transfer.clone(),
            read: None,
            crop: Crop::default(),
            step: self.step,
            arity: self.arity,
            stop: self.stop,
            adaptive: self.adaptive,
            parts: self.parts,
            light,
            lit_by: self.lighting.given(),
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        view_flags: ViewFlags,
    }

    #[test]
    fn usual_equals_parser_defaults() {
        let (view_flags, usual) = (Command::parse_from(["render"]).view_flags, ViewFlags::usual());
        assert_eq!((view_flags.step, view_flags.background), (usual.step, usual.background));
        assert!(view_flags.transfer.is_none() && view_flags.stop.is_none() && view_flags.adaptive == 0.0);
        assert!(view_flags.view.is_none() && view_flags.perspective.is_none() && view_flags.arity.is_none());
    }
}

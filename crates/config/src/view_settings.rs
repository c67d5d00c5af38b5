//! Settings of a rendered picture, shared by flags and files.

use std::path::Path;

use clap::ValueEnum;
use glam::DVec3;

use render::camera::{Camera, View};
use render::classify::light::Light;
use render::classify::transfer::Transfer;
use render::crop::Crop;
use render::settings::STOP;
use render::{self, RenderError, RenderRegion, RenderSettings, Shading};
use sonoweave_core::frames::{Transform, Volume, World};

use super::Error;

/// Rendering mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Lit matter, as opaque as --transfer sets it
    #[default]
    Shaded,
    /// The largest grey value along each ray
    Mip,
    /// The mean of the grey values along each ray, as in an x-ray picture
    Average,
    /// The opaque surface of one grey value
    Iso,
    /// Opacity of --transfer along each ray: white if the ray is fully blocked
    Opacity,
    /// Planes through the volume, by --at or --plane
    Slice,
}

impl Mode {
    /// The modes that cast rays.
    pub const OF_RAYS: [Self; 5] = [Self::Shaded, Self::Mip, Self::Average, Self::Iso, Self::Opacity];

    /// Returns the name on the command line and in files.
    pub fn name(self) -> &'static str {
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

/// Quantity that the transfer function classifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Classified {
    /// Voxels, whose colours are interpolated: a new slice costs only its changes
    Voxel,
    /// Samples, whose grey values and gradients are interpolated: sharper, and slow; for still
    /// pictures
    Sample,
}

/// Annotation over a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Draw {
    /// The outline of the slice
    Slice,
    /// The probe above it
    Probe,
    /// A bar of a round number of millimetres
    Scale,
    /// A cube that names the world's axes
    Cube,
    /// Nothing
    None,
}

impl Draw {
    /// Returns the name on the command line, in files and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Slice => "slice",
            Self::Probe => "probe",
            Self::Scale => "scale",
            Self::Cube => "cube",
            Self::None => "none",
        }
    }
}

/// Settings of a picture by rays; `None` for a setting that was not given.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewSettings {
    /// Pixels to the right and down.
    pub image_size: [u32; 2],
    /// Azimuth, elevation and roll, degrees.
    pub view: Option<[f64; 3]>,
    /// Field of view of the picture's smaller side, degrees.
    pub perspective: Option<f64>,
    /// Rendering mode.
    pub mode: Mode,
    /// The grey value of a surface.
    pub isovalue: Option<f64>,
    /// Classified quantity.
    pub shading: Option<Classified>,
    /// A preset's name, or a file.
    pub transfer: Option<String>,
    /// The transfer function from that file, if it has been read.
    pub read: Option<Transfer>,
    /// The hidden parts of the volume.
    pub crop: Crop,
    /// Distance of samples along a ray, voxels.
    pub step: f64,
    /// Samples composited in one block.
    pub arity: Option<u32>,
    /// Transparency below which a ray ends.
    pub stop: Option<f32>,
    /// Difference in the picture below which rays are skipped.
    pub adaptive: f32,
    /// Parts of the volume that are rendered each by itself.
    pub parts: Option<u32>,
    /// The light.
    pub light: Light,
    /// The setting that differs from the default light, if any.
    pub lit_by: Option<&'static str>,
}

impl ViewSettings {
    /// Refuses settings that suit no volume.
    ///
    /// # Errors
    /// [`Error::Setting`] with the setting and its valid values.
    pub fn check(&self) -> Result<(), Error> {
        if let Some(stop) = self.stop.filter(|stop| !(0.0..=1.0).contains(stop)) {
            return Err(Error::setting("stop", format!("must lie between 0 and 1, not at {stop}")));
        }
        if let Some(isovalue) = self.isovalue.filter(|value| !value.is_finite()) {
            return Err(Error::setting("isovalue", format!("must be a finite number of grey levels, not {isovalue}")));
        }
        if !(0.0..=1.0).contains(&self.adaptive) {
            let problem = format!("must lie between 0, which casts all rays, and 1, not at {}", self.adaptive);
            return Err(Error::setting("adaptive", problem));
        }
        if self.adaptive > 0.0
            && let Some(parts) = self.parts.filter(|parts| *parts > 1)
        {
            let error = RenderError::AdaptiveParts { parts };
            return Err(Error::setting("parts", error.to_string()));
        }
        self.check_mode()?;
        self.transfer([0.0, 1.0])?;
        let stage = RenderRegion::new(Transform::<World, Volume>::IDENTITY, [0; 3], [0; 3]);
        let camera =
            stage.and_then(|stage| Camera::new(&self.view(None, 0.0, false), self.image_size, self.step, &stage));
        let setting = |error: &RenderError| match error {
            RenderError::Step { .. } => "step",
            RenderError::Size { .. } => "image_size",
            _ => "",
        };
        camera.map(|_| ()).map_err(|error| Error::setting(setting(&error), error.to_string()))
    }

    /// Refuses settings without effect in the mode: the user expects an effect.
    fn check_mode(&self) -> Result<(), Error> {
        let mode = self.mode;
        let no_use = |setting, why: &str| {
            Err(Error::setting(setting, format!("has no effect in the mode {}, {why}; leave it out", mode.name())))
        };
        if self.isovalue.is_some() && mode != Mode::Iso {
            return no_use("isovalue", "which draws no surface of one grey level");
        }
        if self.shading.is_some() && !mode.classifies() {
            return no_use("shading", "which uses no opacities of a transfer function");
        }
        if self.stop.is_some() && !mode.classifies() {
            return no_use("stop", "which draws nothing translucent");
        }
        match self.lit_by {
            Some(setting) if !mode.is_lit() => no_use(setting, "which uses no light"),
            _ => Ok(()),
        }
    }

    /// Returns the view of a volume whose slices lie along these axes, rotated by `turned`
    /// degrees about the world's z axis.
    pub fn view(&self, slice_axes: Option<[DVec3; 2]>, turned: f64, turns: bool) -> View {
        let usual = View::of_slices(slice_axes);
        let [azimuth, elevation, roll] = self.view.unwrap_or([usual.azimuth, usual.elevation, usual.roll]);
        View { azimuth: azimuth + turned, elevation, roll, perspective: self.perspective, turns, ..View::default() }
    }

    /// Returns the render settings for a volume with these slice axes, and grey values from
    /// black to white over `range`.
    ///
    /// # Errors
    /// [`Error::Setting`] when there is no such transfer function.
    pub fn settings(
        &self,
        range: [f32; 2],
        slice_axes: Option<[DVec3; 2]>,
        threads: usize,
    ) -> Result<RenderSettings, Error> {
        Ok(RenderSettings {
            view: self.view(slice_axes, 0.0, false),
            mode: self.drawn(range),
            light: self.light,
            step: self.step,
            arity: self.arity,
            stop: self.stops().unwrap_or(STOP),
            adaptive: self.adaptive,
            parts: self.parts,
            crop: self.crop.clone(),
            threads,
            ..RenderSettings::new(self.image_size, self.transfer(range)?)
        })
    }

    /// Returns the transparency at which rays end, if they may end early.
    pub fn stops(&self) -> Option<f32> {
        self.mode.classifies().then(|| self.stop.unwrap_or(STOP))
    }

    fn drawn(&self, [black, white]: [f32; 2]) -> render::Mode {
        let shading = match self.shading {
            None | Some(Classified::Voxel) => Shading::Voxel,
            Some(Classified::Sample) => Shading::Sample,
        };
        match self.mode {
            // Planes have no rays, so this value is not used for them.
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

    /// Returns the transfer function's preset or file.
    pub fn transfer_name(&self) -> &str {
        let usual = match self.mode {
            Mode::Shaded | Mode::Iso | Mode::Opacity | Mode::Slice => Transfer::PRESETS[0].0,
            Mode::Mip | Mode::Average => "xray",
        };
        self.transfer.as_deref().unwrap_or(usual)
    }

    fn transfer(&self, range: [f32; 2]) -> Result<Transfer, Error> {
        if let Some(read) = &self.read {
            return Ok(read.clone());
        }
        let name = self.transfer_name();
        if Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")) {
            return Transfer::read(Path::new(name)).map_err(|e| Error::setting("", e.to_string()));
        }
        Transfer::preset(name, range.map(f64::from))
            .map_err(|e| Error::setting("transfer", format!("{e}; or give a file with a name that ends in .toml")))
    }
}

//! The volume that slices are inserted into, and the picture that follows it.

use std::thread::available_parallelism;

use glam::DVec3;

use reconstruct::Compounding;
use reconstruct::path_choice::PathChoice;
use reconstruct::planar::PlanarSettings;
use reconstruct::settings::Settings;
use render::classify::light::{DepthCue, Light};
use render::classify::transfer::Transfer;
use render::crop::Crop;
use render::{Cache, RenderSettings};

use super::reader::Reader;
use super::schema;
use crate::texts::Texts;
use crate::view_settings::{Draw, ViewSettings};
use crate::weighing::Weighing;
use crate::{Error, Settings as Calibration, values};

/// Voxel spacing when neither the session configuration nor the calibration has one, mm.
pub const SPACING_MM: f64 = 0.5;

/// The volume that slices are inserted into.
#[derive(Debug, Clone)]
pub struct Volume {
    /// Lattice, kernel, compounding and means.
    pub settings: Settings,
    /// Insertion path of slices.
    pub path: PathChoice,
    /// The planar path's own settings.
    pub planar: PlanarSettings,
    /// Frame of the volume, if the file contains it.
    pub world: Option<String>,
}

impl Volume {
    pub(super) fn read(mut keys: Reader<'_, '_>, calibration: &Calibration) -> Result<Self, Error> {
        let given: schema::volume::Volume = keys.read()?;
        let spacing = keys.parsed_if("spacing_mm", given.spacing_mm, values::spacing)?;
        let spacing = spacing.or(calibration.spacing_mm.map(DVec3::from_array)).unwrap_or(DVec3::splat(SPACING_MM));
        keys.note("spacing_mm", &spacing.to_array());
        let mut settings = Settings::new(spacing);
        let origin = keys.parsed_if("origin_mm", given.origin_mm, values::point)?;
        settings.lattice_origin_mm = origin.unwrap_or(DVec3::ZERO);
        let path = match given.path.0 {
            // An origin refers to the world's axes.
            PathChoice::Auto if origin.is_some() => PathChoice::WorldBox,
            path => path,
        };
        let planar = PlanarSettings {
            on_departure: given.departure.0,
            tolerance_voxels: given.planar_tolerance_voxels,
            ..PlanarSettings::default()
        };
        let weighing = Weighing {
            method: given.method.0,
            sigma_mm: keys.parsed_if("sigma_mm", given.sigma_mm, values::lengths)?,
            hwhm_mm: keys.parsed_if("hwhm_mm", given.hwhm_mm, values::lengths)?,
            support: keys.parsed_if("support", given.support, values::supports)?,
            max_weight: given.max_weight,
            compound: given.compound.0,
            decay: given.decay.map(|decay| decay.0),
            decay_rate: given.decay_per_s,
            decay_wait: given.decay_wait_s,
            gap_weights: given.gap_weights,
            shadow_weights: given.shadow_weights,
        };
        let key_of = |setting| match setting {
            "sigma" => "sigma_mm",
            "decay_rate" => "decay_per_s",
            "decay_wait" => "decay_wait_s",
            other => other,
        };
        weighing.apply(calibration.hwhm_mm, &mut settings).map_err(|unfit| keys.unfit(unfit, key_of))?;
        settings.standard_error = given.standard_error;
        if given.standard_error && settings.compounding != Compounding::Mean {
            return Err(keys.error(
                "standard_error",
                format!(
                    "a standard error is that of a mean; leave it out, or choose compound = \"mean\" instead of \"{}\"",
                    settings.compounding.name()
                ),
            ));
        }
        if path == PathChoice::Planar
            && let Some(beyond) = settings.beyond_planar()
        {
            return Err(keys
                .error("path", format!("the planar path does not support {beyond}; choose \"general\" or \"auto\"")));
        }
        settings.threads = threads(given.threads);
        settings.memory_bytes = (given.max_memory_gib * f64::from(1 << 30)) as u64;
        Ok(Self { settings, path, planar, world: given.world })
    }
}

/// The picture that follows the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Its view, mode and quality.
    pub view: ViewSettings,
    /// The grey values that are black and white.
    pub window: [f32; 2],
    /// Colour behind the volume.
    pub background: [f32; 3],
    /// Largest rate, pictures a second.
    pub most_hz: f64,
    /// Contents of the ray cache.
    pub cache: Cache,
    /// Memory limit of the ray cache, bytes.
    pub cache_bytes: u64,
    /// Annotations drawn over it, each once.
    pub draw: Vec<Draw>,
    /// Threads that render.
    pub threads: usize,
}

impl Picture {
    /// Returns the render settings for a volume with these slice axes.
    ///
    /// # Errors
    /// [`Error`] when a transfer function's file has become unreadable.
    pub fn settings(&self, slice_axes: Option<[DVec3; 2]>) -> Result<RenderSettings, Error> {
        let settings = self.view.settings(self.window, slice_axes, self.threads)?;
        Ok(RenderSettings { cache: self.cache, cache_bytes: self.cache_bytes, ..settings })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, texts: &Texts) -> Result<Self, Error> {
        let given: schema::volume::Picture = keys.read()?;
        let size = keys.parsed("image_size", given.image_size, "x", values::picture_size)?;
        keys.note("image_size", &size);
        let usual = Light::default();
        let light = usual.with_parts(given.ambient, given.diffuse, given.specular, given.shininess);
        let light = light.map_err(|e| keys.error("ambient", e.to_string()))?;
        let source = keys.parsed_if("light", given.light, values::light)?.unwrap_or(usual.source());
        let light = light.with_source(source).map_err(|e| keys.error("light", e.to_string()))?;
        let cue = keys.parsed_if("depth_cue", given.depth_cue, values::depth_cue)?;
        let cue = cue.map(|[near, far]| DepthCue::new(near, far)).transpose();
        let cue = cue.map_err(|e| keys.error("depth_cue", e.to_string()))?;
        let named = given.transfer;
        // Reads the file now: it may be gone later.
        let file = named.as_deref().filter(|name| name.ends_with(".toml")).map(|name| keys.path_of(name));
        let read = match &file {
            Some(file) => Some(Transfer::parse(file, &keys.named("transfer", file, texts)?)?),
            None => None,
        };
        let transfer = file.map(|file| file.to_string_lossy().into_owned()).or(named);
        let crop = match given.crop.as_deref().map(|name| keys.path_of(name)) {
            Some(file) => Crop::parse(&file, &keys.named("crop", &file, texts)?)?,
            None => Crop::default(),
        };
        let view = ViewSettings {
            image_size: size,
            view: keys.parsed_if("view_deg", given.view_deg, values::view)?,
            perspective: given.perspective_deg,
            mode: given.mode.0,
            isovalue: given.isovalue,
            shading: given.shading.map(|shading| shading.0),
            transfer,
            read,
            crop,
            step: given.step_voxels,
            arity: given.arity,
            stop: given.stop.map(|x| x as f32),
            adaptive: given.adaptive as f32,
            parts: given.parts,
            light: light.with_two_sided(given.two_sided).with_depth_cue(cue),
            lit_by: ["light", "ambient", "diffuse", "specular", "shininess", "two_sided", "depth_cue"]
                .into_iter()
                .find(|key| keys.entry(key).is_some()),
        };
        let key_of = |setting| match setting {
            "step" => "step_voxels",
            "view" => "view_deg",
            "perspective" => "perspective_deg",
            other => other,
        };
        view.check().map_err(|unfit| keys.unfit(unfit, key_of))?;
        let window = keys.parsed("window", given.window, ",", values::window)?;
        keys.note("window", &window);
        let background = keys.parsed("background", given.background, ",", values::colour)?;
        keys.note("background", &background);
        let mut draw: Vec<Draw> = given.draw.iter().map(|draw| draw.0).collect();
        draw.sort_unstable();
        draw.dedup();
        keys.note("draw", &draw.iter().map(|draw| draw.name()).collect::<Vec<_>>());
        Ok(Self {
            view,
            window,
            background,
            most_hz: given.most_hz,
            cache: given.cache.0,
            cache_bytes: u64::from(given.cache_mib) << 20,
            draw,
            threads: threads(given.threads),
        })
    }
}

fn threads(given: Option<u32>) -> usize {
    let cores = || available_parallelism().map_or(1, usize::from);
    given.and_then(|n| usize::try_from(n).ok()).unwrap_or_else(cores)
}

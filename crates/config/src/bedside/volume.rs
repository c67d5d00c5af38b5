//! The volume that slices are inserted into, and the picture that follows it.

use std::thread::available_parallelism;

use glam::DVec3;

use reconstruct::kernel::Method;
use reconstruct::path_choice::PathChoice;
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::settings::{MAX_WEIGHT, MOST_WEIGHT, Settings};
use render::classify::light::{DepthCue, Light};
use render::classify::transfer::Transfer;
use render::settings::CACHE_BYTES;
use render::{Cache, RenderSettings};
use sonoweave_core::keys::FileError;

use super::reader::{Reader, one_of};
use crate::look::{Draw, Look, Mode};
use crate::texts::Texts;
use crate::weighing::{CompoundName, Weighing};
use crate::{MAX_BYTES, Settings as Calibration, Unfit, values};

/// Voxel spacing when neither the session configuration nor the calibration has one, mm.
pub const SPACING_MM: f64 = 0.5;
/// Default of [`Picture::most_hz`].
const MOST_HZ: f64 = 30.0;

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
    pub(super) fn read(mut keys: Reader<'_, '_>, calibration: &Calibration) -> Result<Self, FileError> {
        let world = keys.text_if("world")?;
        let spacing = keys.parsed_if("spacing_mm", ",", values::spacing)?;
        let spacing = spacing.or(calibration.spacing_mm.map(DVec3::from_array)).unwrap_or(DVec3::splat(SPACING_MM));
        keys.notes("spacing_mm", &spacing.to_array());
        let mut settings = Settings::new(spacing);
        let origin = keys.parsed_if("origin_mm", ",", values::point)?;
        settings.lattice_origin_mm = origin.unwrap_or(DVec3::ZERO);
        let paths = [("auto", PathChoice::Auto), ("general", PathChoice::General), ("planar", PathChoice::Planar)];
        let path = match keys.choice("path", "auto", &paths)? {
            // An origin refers to the world's axes.
            PathChoice::Auto if origin.is_some() => PathChoice::WorldBox,
            path => path,
        };
        let departures = [("upgrade", OnDeparture::Upgrade), ("refuse", OnDeparture::Refuse)];
        let usual = PlanarSettings::default();
        let planar = PlanarSettings {
            on_departure: keys.choice("departure", "upgrade", &departures)?,
            tolerance_voxels: keys.number("planar_tolerance_voxels", usual.tolerance_voxels, 0.0..=f64::INFINITY)?,
            ..usual
        };
        let methods = Method::ALL.map(|method| (method.name(), method));
        let weighing = Weighing {
            method: keys.choice("method", Method::default().name(), &methods)?,
            sigma_mm: keys.parsed_if("sigma_mm", ",", values::lengths)?,
            hwhm_mm: keys.parsed_if("hwhm_mm", ",", values::lengths)?,
            support: keys.parsed_if("support", ",", values::supports)?,
            max_weight: keys.number("max_weight", MAX_WEIGHT, 1.0..=MOST_WEIGHT)?,
            compound: keys.named("compound", CompoundName::default())?,
            decay: keys.named_if("decay")?,
            decay_rate: keys.number_if("decay_per_s", 1e-6..=1e6)?,
            decay_wait: keys.number_if("decay_wait_s", 0.0..=1e6)?,
        };
        let key_of = |setting| match setting {
            "sigma" => "sigma_mm",
            "decay_rate" => "decay_per_s",
            "decay_wait" => "decay_wait_s",
            other => other,
        };
        weighing.apply(calibration.hwhm_mm, &mut settings).map_err(|unfit| keys.unfit(unfit, key_of))?;
        if path == PathChoice::Planar
            && let Some(beyond) = settings.beyond_planar()
        {
            return Err(keys
                .error("path", format!("the planar path does not support {beyond}; choose \"general\" or \"auto\"")));
        }
        settings.threads = threads(&mut keys)?;
        let memory = keys.number("max_memory_gib", 8.0, f64::MIN_POSITIVE..=1e6)?;
        settings.memory_bytes = (memory * f64::from(1 << 30)) as u64;
        Ok(Self { settings, path, planar, world })
    }
}

/// The picture that follows the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Its view, mode and quality.
    pub look: Look,
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
    /// [`Unfit`] when a transfer function's file has become unreadable.
    pub fn settings(&self, slice_axes: Option<[DVec3; 2]>) -> Result<RenderSettings, Unfit> {
        let settings = self.look.settings(self.window, slice_axes, self.threads)?;
        Ok(RenderSettings { cache: self.cache, cache_bytes: self.cache_bytes, ..settings })
    }

    pub(super) fn read(mut keys: Reader<'_, '_>, texts: &Texts) -> Result<Self, FileError> {
        let modes = Mode::OF_RAYS.map(|mode| (mode.name(), mode));
        let size = keys.parsed_if("image_size", "x", values::picture_size)?.unwrap_or([512, 512]);
        keys.notes("image_size", &size);
        let named = keys.text_if("transfer")?;
        // Reads the file now: it may be gone later.
        let file = named.as_deref().filter(|name| name.ends_with(".toml")).map(|name| keys.path_of(name));
        let read = match &file {
            Some(file) => Some(Transfer::parse(file, &texts.text(file, MAX_BYTES)?)?),
            None => None,
        };
        let transfer = file.map(|file| file.to_string_lossy().into_owned()).or(named);
        let look = Look {
            image_size: size,
            view: keys.parsed_if("view_deg", ",", values::view)?,
            perspective: keys.number_if("perspective_deg", f64::MIN_POSITIVE..=170.0)?,
            mode: keys.choice("mode", "shaded", &modes)?,
            isovalue: keys.number_if("isovalue", f64::MIN..=f64::MAX)?,
            shading: keys.named_if("shading")?,
            transfer,
            read,
            step: keys.number("step_voxels", 1.0, f64::MIN_POSITIVE..=f64::INFINITY)?,
            arity: keys.whole_if("arity", 1..=u32::MAX)?,
            stop: keys.number_if("stop", 0.0..=1.0)?.map(|x| x as f32),
            adaptive: keys.number("adaptive", 0.0, 0.0..=1.0)? as f32,
            light: light(&mut keys)?,
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
        look.check().map_err(|unfit| keys.unfit(unfit, key_of))?;
        let window = keys.parsed_if("window", ",", values::window)?.unwrap_or([0.0, 255.0]);
        keys.notes("window", &window);
        let background = keys.parsed_if("background", ",", values::colour)?.unwrap_or([0.0; 3]);
        keys.notes("background", &background);
        let caches = Cache::ALL.map(|cache| (cache.name(), cache));
        let usual_mib = u32::try_from(CACHE_BYTES >> 20).unwrap_or(u32::MAX);
        Ok(Self {
            look,
            window,
            background,
            most_hz: keys.number("most_hz", MOST_HZ, 0.1..=1000.0)?,
            cache: keys.choice("cache", Cache::default().name(), &caches)?,
            cache_bytes: u64::from(keys.whole("cache_mib", usual_mib, 0..=1 << 20)?) << 20,
            draw: draw(&mut keys)?,
            threads: threads(&mut keys)?,
        })
    }
}

fn light(keys: &mut Reader<'_, '_>) -> Result<Light, FileError> {
    let usual = Light::default();
    let parts = usual.parts();
    let source = keys.parsed_if("light", ",", values::light)?;
    let ambient = keys.number("ambient", parts.ambient, 0.0..=1.0)?;
    let diffuse = keys.number("diffuse", parts.diffuse, 0.0..=1.0)?;
    let specular = keys.number("specular", parts.specular, 0.0..=1.0)?;
    let shininess = keys.whole("shininess", parts.shininess, 1..=u32::MAX)?;
    let two_sided = keys.truth("two_sided", usual.is_two_sided())?;
    let light = usual.with_parts(ambient, diffuse, specular, shininess);
    let light = light.map_err(|e| keys.error("ambient", e.to_string()))?;
    let light = light.with_source(source.unwrap_or(usual.source())).map_err(|e| keys.error("light", e.to_string()))?;
    let cue = keys.parsed_if("depth_cue", ",", values::depth_cue)?.map(|[near, far]| DepthCue::new(near, far));
    let cue = cue.transpose().map_err(|e| keys.error("depth_cue", e.to_string()))?;
    Ok(light.with_two_sided(two_sided).with_depth_cue(cue))
}

fn draw(keys: &mut Reader<'_, '_>) -> Result<Vec<Draw>, FileError> {
    let names = [Draw::Slice, Draw::Probe, Draw::Scale, Draw::Cube].map(|draw| (draw.name(), draw));
    let given = keys.entry("draw").map(|entry| {
        let items = entry.items("a list of texts")?;
        items.iter().map(|item| one_of(item, &names).map(|(_, draw)| draw)).collect::<Result<Vec<_>, _>>()
    });
    let mut draw = given.transpose()?.unwrap_or_else(|| vec![Draw::Slice, Draw::Probe]);
    draw.sort_unstable();
    draw.dedup();
    let said: Vec<&str> = draw.iter().map(|draw| draw.name()).collect();
    keys.notes("draw", &said);
    Ok(draw)
}

fn threads(keys: &mut Reader<'_, '_>) -> Result<usize, FileError> {
    let given = keys.whole_if("threads", 1..=1024)?;
    let cores = || available_parallelism().map_or(1, usize::from);
    Ok(given.and_then(|n| usize::try_from(n).ok()).unwrap_or_else(cores))
}

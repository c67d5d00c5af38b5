//! Soft light: pictures in which smoothed bodies cast soft shadows, and thin parts let light
//! through.
//!
//! A picture is rendered in three steps, all from the volume as it is:
//!
//! - `smoothed`: values without most of their speckle, by local statistics (Lee 1980) and a
//!   Gaussian over what was seen (normalised convolution, Knutsson & Westin 1993).
//! - `field`: the light that reaches places, on a lattice of half the resolution. A wave front
//!   goes from slice to slice away from the light and spreads (Kniss and others 2003). Thin parts
//!   let red through first. Hollows are darker by the mean opacity around them (Schlegel 2011).
//! - The renderer lights voxels by these ([`SoftShade`]), and casts rays as always.
//!
//! The shadows depend on all voxels between a place and the light, so a changed slice changes
//! them anywhere. Such a picture is therefore rendered as a whole. Pictures that follow a
//! volume use [`Light`](crate::classify::light::Light) alone.

pub(crate) mod field;
pub(crate) mod smoothed;
mod work;

use std::sync::Arc;

use simd::sharing::Sharing;
use volume::Values;
use volume::brick::VOXELS;

pub use work::SoftWork;

use super::camera::Camera;
use super::classify::soft::{SoftLight, SoftShade};
use super::crop::{Crop, Cropped, LatticeCrop};
use super::error::RenderError;
use super::mode::{Mode, Shading};
use super::region::RenderRegion;
use super::renderer::Renderer;
use super::settings::{Cache, RenderSettings};
use smoothed::Smoothed;

/// Bytes of a brick, as it is and smoothed.
const BRICK_BYTES: u64 = 2 * 8 * VOXELS as u64;
/// Bytes of the light in a brick's place, and of what it is made of.
const LIGHT_BYTES: u64 = 64 * 36;

/// Returns the most bytes that soft light takes, beside those of the renderer, for a volume with so
/// many bricks in a region.
pub fn most_bytes(region: &RenderRegion, bricks: u64) -> u64 {
    let places: u64 = region.bricks().map(u64::from).iter().product();
    bricks.saturating_mul(BRICK_BYTES).saturating_add(places.saturating_mul(LIGHT_BYTES))
}

/// Renders a volume in soft light: returns the renderer of the picture, and the work done before
/// it. View, size, step, opacity, colour, crop and stop are those of
/// the settings. Mode, light and cache are not used. Any number of threads and every instruction
/// set give the same bits.
///
/// # Errors
/// [`RenderError`] for invalid settings.
pub fn render(
    volume: &(impl Values + ?Sized),
    settings: &RenderSettings,
    light: &SoftLight,
    region: &RenderRegion,
) -> Result<(Renderer, SoftWork), RenderError> {
    let (prepared, smoothed, work) = prepare(volume, settings, light, region)?;
    let mut renderer = Renderer::new(&prepared, *region)?;
    renderer.update_all(&smoothed);
    Ok((renderer, work))
}

/// Returns the settings by which a smoothed volume is rendered in soft light, and that volume.
pub(crate) fn prepare(
    volume: &(impl Values + ?Sized),
    settings: &RenderSettings,
    light: &SoftLight,
    region: &RenderRegion,
) -> Result<(RenderSettings, Smoothed, SoftWork), RenderError> {
    let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
    let team = settings.team()?;
    let (simd, sharing) = (settings.simd, Sharing::of(team.as_deref()));
    let crop = LatticeCrop::new(settings.crop.present(), region.world_from_lattice());
    let mut work = SoftWork::default();
    let visible = settings.transfer.visible();
    let volume = &Cropped::new(volume, &crop);
    let smoothed = Smoothed::new(volume, region, (light, visible), (simd, sharing), &mut work);
    let to_light = light.towards(&camera.axes());
    let field = field::light(&smoothed, &settings.transfer, (light, to_light), region, sharing);
    let prepared = RenderSettings {
        mode: Mode::Shaded(Shading::Voxel),
        crop: Crop::default(),
        adaptive: 0.0,
        cache: Cache::None,
        parts: Some(1),
        soft: Some(SoftShade::new(light, to_light, Arc::new(field))),
        ..settings.clone()
    };
    Ok((prepared, smoothed, work))
}

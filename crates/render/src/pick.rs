//! Picking: the place visible at a pixel, as the distance along its ray.
//!
//! | composite of the samples | the place |
//! |---|---|
//! | over | where half of the background is hidden; for an isosurface, where the ray enters it |
//! | maximum or average | where the largest sample lies |
//!
//! A sample's tissue extends evenly from half a step before it to half a step behind. The depth
//! uncertainty is the width in which the place can lie. It is one step, combined with the range
//! over which opacity rises from a quarter to three quarters. For the largest sample it is
//! combined with the samples about it above half of its intensity.

use glam::DVec3;

use super::classify::shade::Lit;
use super::layers::{Channels, channels};
use super::rays::composite::CompositeMode;
use super::rays::line::Line;
use super::rays::run::{RUN, Run};
use super::renderer::Renderer;
use super::voxels::Sampler;
use super::work::RenderWork;

/// Opacity up to the place, and at the two ends of the width about it.
const HALF: f32 = 0.5;
const QUARTERS: [f32; 2] = [0.25, 0.75];
/// There is no intensity where less than this share was seen.
const SEEN: f32 = 0.5;

/// A place visible in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// Position in the world, mm.
    pub point: DVec3,
    /// Unit direction of its ray in the world, away from the viewer.
    pub along: DVec3,
    /// Width along the ray in which the place can lie, mm.
    pub depth_mm: f64,
    /// Width of a pixel there, mm.
    pub pixel_mm: f64,
}

impl Renderer {
    /// Returns the place visible at a picture position in pixels, whole at pixel centres; `None`
    /// if nothing is visible there, or too little. Uses the volume as last read, even if
    /// refinement is not finished. Changes nothing.
    pub fn pick(&self, at: [f64; 2]) -> Option<Picked> {
        let camera = self.camera();
        let ray = camera.ray_through(at);
        let [low, high] = self.region().bounds().map(|at| std::array::from_fn(|a| at[a] - self.region().first()[a]));
        let line = Line::new(&ray, low, high, camera.samples());
        let composite_mode = self.fold().composite_mode;
        let depth = channels!(self.image(), layers => {
            let whole = Sampler::new(&layers.voxels, self.shader());
            depth(&self.parts().along(whole, &line, self.fold()), composite_mode)
        })?;
        let to_world = self.region().world_from_region();
        let place = |[i, j]: [f64; 2]| {
            let ray = camera.ray_through([i, j]);
            to_world.transform_point3(ray.base + ray.step * depth.at)
        };
        Some(Picked {
            point: place(at),
            along: to_world.transform_vector3(ray.step).normalize(),
            depth_mm: depth.width.hypot(1.0) * camera.step_mm(),
            pixel_mm: place([at[0] - 0.5, at[1]]).distance(place([at[0] + 0.5, at[1]])),
        })
    }
}

/// Position of a place along its ray and its width, in samples.
#[derive(Debug, Clone, Copy)]
struct Depth {
    at: f64,
    width: f64,
}

/// Finds the place on a line whose pieces are given in view order, each with its sampler.
fn depth<const C: usize>(pieces: &[(Sampler<C>, Line)], composite_mode: CompositeMode) -> Option<Depth> {
    let mut samples = Vec::new();
    let (mut run, mut work) = (Run::new(), RenderWork::default());
    for (sampler, line) in pieces {
        for k in (line.first..line.end).step_by(RUN as usize) {
            let n = (line.end - k).min(RUN);
            if sampler.run(line, k, n, &mut run, &mut work) {
                samples.extend((0..n).map(|i| (k + i, run.sample(i as usize))));
            }
        }
    }
    let surface = |k: u32| {
        let (sampler, line) = pieces.iter().find(|(_, line)| (line.first..line.end).contains(&k))?;
        sampler.surface(line, k)
    };
    match composite_mode {
        CompositeMode::Over => opaque(surface, &samples),
        CompositeMode::Thin | CompositeMode::Most { .. } => largest(&samples),
    }
}

/// Finds where half of the background is hidden.
fn opaque<const C: usize>(surface: impl Fn(u32) -> Option<f64>, samples: &[(u32, Lit<f32, C>)]) -> Option<Depth> {
    let mut transmittance = 1.0_f32;
    let (mut half, mut quarters) = (None, [None; 2]);
    let mut end = 0.0;
    for (k, Lit { alpha, .. }) in samples.iter().filter(|(_, lit)| lit.alpha > 0.0) {
        let behind = transmittance * (1.0 - alpha);
        let passes = |opacity: f32| {
            let through = 1.0 - opacity;
            // In evenly absorbing tissue the logarithm of the transmittance falls evenly.
            let share = || f64::from((transmittance / through).ln() / (transmittance / behind).ln());
            (transmittance > through && behind <= through).then(|| f64::from(*k) - 0.5 + share())
        };
        if let (None, Some(at)) = (half, passes(HALF)) {
            half = Some(surface(*k).unwrap_or(at));
        }
        for (quarter, opacity) in quarters.iter_mut().zip(QUARTERS) {
            *quarter = quarter.or_else(|| passes(opacity));
        }
        (transmittance, end) = (behind, f64::from(*k) + 0.5);
    }
    // If the opacity never reaches three quarters, the width ends at the last visible sample.
    let [from, to] = quarters.map(|quarter| quarter.unwrap_or(end));
    half.map(|at| Depth { at, width: to - from })
}

/// Finds where the largest intensity lies.
fn largest<const C: usize>(samples: &[(u32, Lit<f32, C>)]) -> Option<Depth> {
    let intensity = |lit: &Lit<f32, C>| (lit.alpha >= SEEN).then(|| lit.colour[0] / lit.alpha);
    let mut most: Option<(usize, f32)> = None;
    for (n, (_, lit)) in samples.iter().enumerate() {
        if let Some(value) = intensity(lit).filter(|value| most.is_none_or(|(_, most)| *value > most)) {
            most = Some((n, value));
        }
    }
    let (at, most) = most?;
    let is_bright = |(_, lit): &&(u32, Lit<f32, C>)| intensity(lit).is_some_and(|value| value > 0.5 * most);
    let behind = samples[at + 1..].iter().take_while(is_bright).count();
    let before = samples[..at].iter().rev().take_while(is_bright).count();
    Some(Depth { at: f64::from(samples[at].0), width: (before + behind) as f64 })
}

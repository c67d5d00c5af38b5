//! The place that is seen at a pixel: how far its ray goes before it meets what the picture shows there.
//!
//! | what samples make | the place |
//! |---|---|
//! | what is seen through them | where half of what lies behind is hidden; of an isosurface, where the ray enters it |
//! | the largest, or their mean | where the largest of them lies |
//!
//! A sample's matter lies evenly about it, from half a step before to half a step behind. How far the place may be off along its ray is told as the width that it lies in
//! anywhere: a step, and with it what the opacity takes from a quarter to three quarters, or what of the samples about the largest has more than half of its intensity.

use glam::DVec3;

use super::cast::Line;
use super::law::Law;
use super::layers::Image;
use super::renderer::Renderer;
use super::run::{RUN, Run};
use super::shade::Lit;
use super::voxels::Sampler;
use super::work::RenderWork;

/// Opacity of what lies up to the place, and of what lies within the width about it.
const HALF: f32 = 0.5;
const QUARTERS: [f32; 2] = [0.25, 0.75];
/// Of what less than half was seen there is no intensity.
const SEEN: f32 = 0.5;

/// A place that is seen in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// Where it lies in the world, mm.
    pub point: DVec3,
    /// The direction of its ray in the world, of length 1, away from who looks.
    pub along: DVec3,
    /// The width along the ray in which it may lie anywhere, mm.
    pub depth_mm: f64,
    /// Width of a pixel there, mm.
    pub pixel_mm: f64,
}

impl Renderer {
    /// The place that is seen at a place of the picture, in pixels, whole at their centres; `None` where nothing is, or too little for a place. Of the volume as it was
    /// read last, whatever is still to be refined. Changes nothing.
    pub fn pick(&self, at: [f64; 2]) -> Option<Picked> {
        let camera = self.camera();
        let ray = camera.ray_through(at);
        let [low, high] = self.stage().bounds().map(|at| std::array::from_fn(|a| at[a] - self.stage().first()[a]));
        let line = Line::new(&ray, low, high, camera.samples());
        let law = self.fold().law;
        let depth = match self.image() {
            Image::Grey(layers) => depth(&Sampler::new(&layers.voxels, self.shader()), &line, law),
            Image::Colour(layers) => depth(&Sampler::new(&layers.voxels, self.shader()), &line, law),
        }?;
        let to_world = self.stage().world_from_stage();
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

/// How far a place lies along its ray, and how wide that is, in samples.
#[derive(Debug, Clone, Copy)]
struct Depth {
    at: f64,
    width: f64,
}

fn depth<const C: usize>(sampler: &Sampler<C>, line: &Line, law: Law) -> Option<Depth> {
    let mut samples = Vec::new();
    let (mut run, mut work) = (Run::new(), RenderWork::default());
    for k in (line.first..line.end).step_by(RUN as usize) {
        let n = (line.end - k).min(RUN);
        if sampler.run(line, k, n, &mut run, &mut work) {
            samples.extend((0..n).map(|i| (k + i, run.sample(i as usize))));
        }
    }
    match law {
        Law::Over => opaque(sampler, line, &samples),
        Law::Thin | Law::Most { .. } => largest(&samples),
    }
}

/// Where half of what lies behind is hidden.
fn opaque<const C: usize>(sampler: &Sampler<C>, line: &Line, samples: &[(u32, Lit<f32, C>)]) -> Option<Depth> {
    let mut transmittance = 1.0_f32;
    let (mut half, mut quarters) = (None, [None; 2]);
    let mut end = 0.0;
    for (k, Lit { alpha, .. }) in samples.iter().filter(|(_, lit)| lit.alpha > 0.0) {
        let behind = transmittance * (1.0 - alpha);
        let passes = |opacity: f32| {
            let through = 1.0 - opacity;
            // Evenly absorbing matter lets through so much that its logarithm falls evenly.
            let share = || f64::from((transmittance / through).ln() / (transmittance / behind).ln());
            (transmittance > through && behind <= through).then(|| f64::from(*k) - 0.5 + share())
        };
        if let (None, Some(at)) = (half, passes(HALF)) {
            half = Some(sampler.surface(line, *k).unwrap_or(at));
        }
        for (quarter, opacity) in quarters.iter_mut().zip(QUARTERS) {
            *quarter = quarter.or_else(|| passes(opacity));
        }
        (transmittance, end) = (behind, f64::from(*k) + 0.5);
    }
    // What never hides three quarters lies up to the last of it.
    let [from, to] = quarters.map(|quarter| quarter.unwrap_or(end));
    half.map(|at| Depth { at, width: to - from })
}

/// Where the largest intensity lies.
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

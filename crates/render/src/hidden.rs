//! Occlusion: how much of a place in the volume is visible through the tissue in front of it.

use glam::DVec3;

use super::layers::{Channels, channels};
use super::rays::composite::CompositeMode;
use super::rays::line::Line;
use super::rays::run::{RUN, Run};
use super::renderer::Renderer;
use super::voxels::Sampler;
use super::work::RenderWork;

/// Samples before a place that do not hide it; otherwise a surface would hide a plane that lies
/// in it.
const BEFORE: f64 = 1.5;

impl Renderer {
    /// Returns the transmittance from the eye (or from afar) to a world position (mm): 1 if
    /// nothing lies before it, 0 behind opaque tissue. It uses the volume as shown in the
    /// picture, at the picture's sample distance. Only overlays drawn on the picture use it.
    pub fn transmittance_to(&self, at: DVec3) -> f32 {
        let camera = self.camera();
        let at = self.region().region_from_world().transform_point3(at);
        let Some(pixel) = camera.project(at) else { return 1.0 };
        let ray = camera.ray_through(pixel);
        let samples =
            ((at - ray.base).dot(ray.step) / ray.step.length_squared() - BEFORE).min(f64::from(camera.samples()));
        // In average and maximum modes nothing is hidden.
        if samples <= 0.0 || self.fold().composite_mode != CompositeMode::Over {
            return 1.0;
        }
        let [low, high] = self.region().bounds().map(|at| std::array::from_fn(|a| at[a] - self.region().first()[a]));
        // Not negative, and at most the camera's number of samples.
        let line = Line::new(&ray, low, high, samples.ceil() as u32);
        channels!(self.image(), layers => {
            let whole = Sampler::new(&layers.voxels, self.shader());
            through(&self.parts().along(whole, &line, self.fold()), samples)
        })
    }
}

/// Returns the transmittance of a line whose pieces are given in view order, each with its
/// sampler.
fn through<const C: usize>(pieces: &[(Sampler<C>, Line)], samples: f64) -> f32 {
    let (mut transmittance, mut run, mut work) = (1.0, Run::new(), RenderWork::default());
    for (sampler, line) in pieces {
        for k in (line.first..line.end).step_by(RUN as usize) {
            let n = (line.end - k).min(RUN);
            if sampler.run(line, k, n, &mut run, &mut work) {
                for i in 0..n {
                    // Only the part of the last sample that lies before the place counts.
                    let part = (samples - f64::from(k + i)).min(1.0) as f32;
                    transmittance *= 1.0 - run.sample(i as usize).alpha * part;
                }
            }
        }
    }
    transmittance
}

//! How much of a place in the volume is seen through what lies before it.

use glam::DVec3;

use super::cast::Line;
use super::law::Law;
use super::layers::Image;
use super::renderer::Renderer;
use super::run::{RUN, Run};
use super::voxels::Sampler;
use super::work::RenderWork;

/// Samples before a place that do not hide it: a plane that lies in a surface would else be hidden by it.
const BEFORE: f64 = 1.5;

impl Renderer {
    /// The transmittance from the eye (or from afar) to a world position (mm): 1 where nothing lies before it, 0 behind what is opaque. Of what the picture shows,
    /// at the distances of its own samples; what is drawn over the picture asks, and nothing else.
    pub fn transmittance_to(&self, at: DVec3) -> f32 {
        let camera = self.camera();
        let at = self.stage().stage_from_world().transform_point3(at);
        let Some(pixel) = camera.project(at) else { return 1.0 };
        let ray = camera.ray_through(pixel);
        let samples =
            ((at - ray.base).dot(ray.step) / ray.step.length_squared() - BEFORE).min(f64::from(camera.samples()));
        // Of a mean or a maximum nothing hides what lies behind it.
        if samples <= 0.0 || self.fold().law != Law::Over {
            return 1.0;
        }
        let [low, high] = self.stage().bounds().map(|at| std::array::from_fn(|a| at[a] - self.stage().first()[a]));
        // Not negative, and no more than the camera's.
        let line = Line::new(&ray, low, high, samples.ceil() as u32);
        match self.image() {
            Image::Grey(layers) => through(&Sampler::new(&layers.voxels, self.shader()), &line, samples),
            Image::Colour(layers) => through(&Sampler::new(&layers.voxels, self.shader()), &line, samples),
        }
    }
}

fn through<const C: usize>(sampler: &Sampler<C>, line: &Line, samples: f64) -> f32 {
    let (mut transmittance, mut run, mut work) = (1.0, Run::new(), RenderWork::default());
    for k in (line.first..line.end).step_by(RUN as usize) {
        let n = (line.end - k).min(RUN);
        if sampler.run(line, k, n, &mut run, &mut work) {
            for i in 0..n {
                // Of the last sample the part that lies before the place.
                let part = (samples - f64::from(k + i)).min(1.0) as f32;
                transmittance *= 1.0 - run.sample(i as usize).alpha * part;
            }
        }
    }
    transmittance
}

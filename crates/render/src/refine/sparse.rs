//! A picture of adaptive rays.

use crate::camera::Camera;
use crate::refine::adaptive::Regions;
use crate::refine::features::Features;
use crate::region::RenderRegion;

/// A picture without one ray a pixel.
pub(crate) struct Sparse<const C: usize> {
    pub(crate) regions: Regions<C>,
    pub(super) features: Features,
}

impl<const C: usize> Sparse<C> {
    /// Creates the picture of an empty volume; `settled` if it is shown as such, otherwise no
    /// region has been evaluated.
    pub(crate) fn new(camera: &Camera, region: &RenderRegion, epsilon: f32, settled: bool) -> Self {
        let regions = Regions::new(camera.size(), epsilon, settled);
        let features = Features::new(camera, region, epsilon, regions.count());
        Self { regions, features }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.regions.bytes() + self.features.bytes()
    }
}

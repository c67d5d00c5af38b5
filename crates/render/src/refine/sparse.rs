//! A picture without one ray a pixel, and the remaining work for it.

use crate::camera::Camera;
use crate::refine::adaptive::Regions;
use crate::refine::features::Features;
use crate::refine::preview::Preview;
use crate::region::RenderRegion;

/// A picture without one ray a pixel: by choice, or not yet.
pub(crate) struct Sparse<const C: usize> {
    pub(crate) regions: Regions<C>,
    /// Small features, if rays are adaptive.
    pub(super) features: Option<Features>,
    pub(super) refinement: Option<Refinement<C>>,
}

impl<const C: usize> Sparse<C> {
    /// Creates the picture of an empty volume.
    pub(crate) fn new(camera: &Camera, region: &RenderRegion, epsilon: f32) -> Self {
        let regions = Regions::new(camera.size(), epsilon, true);
        let features = Some(Features::new(camera, region, epsilon, regions.count()));
        Self { regions, features, refinement: None }
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.regions.bytes() + self.features.as_ref().map_or(0, Features::bytes)
    }
}

/// Remaining work for a new view.
pub(super) struct Refinement<const C: usize> {
    pub(super) preview: Preview<C>,
    pub(super) begun: bool,
    /// Whether the light on voxels has changed.
    pub(super) relight: bool,
    /// Bricks to be lit, and to be searched for small features.
    pub(super) unlit: Vec<[i64; 3]>,
    pub(super) unsearched: Vec<[i64; 3]>,
    /// Number of rows, from the first, that are set up for the view; and whether all are, and
    /// the cache is chosen.
    pub(super) lined: usize,
    pub(super) chosen: bool,
    /// Rows whose rays can be cast.
    pub(super) ready: Vec<bool>,
}

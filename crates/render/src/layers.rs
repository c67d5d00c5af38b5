//! The shaded voxels and the rows of one picture, for one or three channels of light.

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;

use super::camera::Camera;
use super::classify::shade::Shader;
use super::rays::composite::{Accumulated, Fold};
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::refine::sparse::Sparse;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::voxels::{Sampler, Voxels};
use super::work::RenderWork;

/// One channel for grey light, three for coloured light.
pub(super) enum Channels<G, C> {
    Grey(G),
    Colour(C),
}

/// Runs the same code for either number of channels.
macro_rules! channels {
    ($image:expr, $layers:ident => $call:expr) => {
        match $image {
            Channels::Grey($layers) => $call,
            Channels::Colour($layers) => $call,
        }
    };
}
pub(super) use channels;

pub(super) type Image = Channels<Layers<1>, Layers<3>>;

pub(super) struct Layers<const C: usize> {
    pub(super) voxels: Voxels<C>,
    /// Number of the first row in the picture.
    pub(super) first_row: u32,
    pub(super) rows: Vec<Row<C>>,
    /// The picture, if it does not have one ray a pixel.
    pub(super) sparse: Option<Sparse<C>>,
}

impl Image {
    pub(super) fn keep(&mut self, cache: Cache, fold: Fold) {
        channels!(self, layers => layers.rows.iter_mut().for_each(|row| row.keep(cache, fold)));
    }
}

impl<const C: usize> Layers<C> {
    pub(super) fn new(camera: &Camera, region: &RenderRegion, settings: &RenderSettings) -> Self {
        Self::of_rows(camera, region, settings, 0..camera.size()[1])
    }

    pub(super) fn of_rows(camera: &Camera, region: &RenderRegion, settings: &RenderSettings, rows: Range<u32>) -> Self {
        let first_row = rows.start;
        let rows = rows.map(|j| Row::new(camera, region, j)).collect();
        Self { voxels: Voxels::new(region, settings), first_row, rows, sparse: None }
    }

    /// Casts again the rays that some changes can have reached.
    pub(super) fn cast(
        &mut self,
        marks: &Marks,
        shader: &Shader<f32>,
        fold: Fold,
        simd: Simd,
        sharing: Sharing,
    ) -> RenderWork {
        let sampler = Sampler::new(&self.voxels, shader);
        sharing.chunks(&mut self.rows, 1, |j, rows| {
            for row in rows {
                row.work = RenderWork::default();
                let [first, end] = row.mark(j as u32, marks, simd);
                (first..end).for_each(|at| row.cast(at, sampler, fold, simd));
            }
        });
        let mut work = RenderWork::default();
        self.rows.iter().for_each(|row| work += row.work);
        work
    }

    pub(super) fn bytes(&self) -> u64 {
        self.rows.iter().map(Row::bytes).sum::<u64>() + self.sparse.as_ref().map_or(0, Sparse::bytes)
    }

    /// Returns the picture, row by row.
    pub(super) fn pixels(&self, of: impl Fn(&Accumulated<C>) -> [f32; 4]) -> Vec<[f32; 4]> {
        match &self.sparse {
            Some(sparse) => sparse.regions.seen.iter().map(of).collect(),
            None => self.rows.iter().flat_map(|row| row.pixels.iter().map(&of)).collect(),
        }
    }
}

//! The shaded voxels and the rows of one picture, for one or three channels of light.

use std::ops::Range;

use simd::sharing::Sharing;
use simd::{Fused, Simd};

use super::camera::Camera;
use super::classify::shade::Shader;
use super::rays::cast::Casting;
use super::rays::composite::{Accumulated, Fold};
use super::rays::marks::Marks;
use super::rays::rows::Row;
use super::refine::refinement::Refinement;
use super::refine::sparse::Sparse;
use super::region::RenderRegion;
use super::settings::{Cache, RenderSettings};
use super::stock::stocked;
use super::voxels::Voxels;
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
    /// The picture, if rays are adaptive.
    pub(super) sparse: Option<Sparse<C>>,
    /// Remaining work for a new view.
    pub(super) refinement: Option<Refinement<C>>,
}

/// Job that converts a row of pixels to bytes.
struct Converting<'a, const C: usize, F> {
    pixels: &'a [Accumulated<C>],
    bytes: &'a mut [u8],
    of: F,
}

impl<const C: usize, const N: usize, F: Fn(&Accumulated<C>) -> [u8; N]> Fused for Converting<'_, C, &F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (bytes, pixel) in self.bytes.as_chunks_mut().0.iter_mut().zip(self.pixels) {
            *bytes = (self.of)(pixel);
        }
    }
}

impl Image {
    pub(super) fn keep(&mut self, cache: Cache, fold: Fold) {
        channels!(self, layers => layers.rows.iter_mut().for_each(|row| row.keep(cache, fold)));
    }
}

impl<const C: usize> Layers<C> {
    pub(super) fn new(camera: &Camera, region: &RenderRegion, settings: &RenderSettings, fold: Fold) -> Self {
        Self::of_rows(camera, region, settings, fold, 0..camera.size()[1])
    }

    pub(super) fn of_rows(
        camera: &Camera,
        region: &RenderRegion,
        settings: &RenderSettings,
        fold: Fold,
        rows: Range<u32>,
    ) -> Self {
        let first_row = rows.start;
        let rows = rows.map(|j| Row::new(camera, region, (fold, settings.simd), j)).collect();
        let voxels = Voxels::new(camera, region, settings, fold, stocked(region));
        Self { voxels, first_row, rows, sparse: None, refinement: None }
    }

    /// Casts again the rays that some changes can have reached, in the rows that have been cast for
    /// this view.
    pub(super) fn cast(
        &mut self,
        marks: &Marks,
        shader: &Shader<f32>,
        (fold, simd, sharing): (Fold, Simd, Sharing),
    ) -> RenderWork {
        let Self { voxels, rows, refinement, .. } = self;
        let casting = Casting::new(voxels, shader, (fold, simd, sharing));
        let is_ready = |j: usize| refinement.as_ref().is_none_or(|refinement| refinement.ready[j]);
        sharing.chunks(rows, 1, |j, rows| {
            let row = &mut rows[0];
            row.work = RenderWork::default();
            if is_ready(j) {
                let [first, end] = row.mark(j as u32, marks, simd);
                let tiles = casting.visible.of_row(j);
                (first..end).for_each(|at| row.cast(at, tiles, casting));
            }
        });
        let mut work = RenderWork::default();
        rows.iter().for_each(|row| work += row.work);
        work
    }

    pub(super) fn bytes(&self) -> u64 {
        let of_rows = self.rows.iter().map(Row::bytes).sum::<u64>();
        of_rows + self.voxels.visible.bytes() + self.sparse.as_ref().map_or(0, Sparse::bytes)
    }

    /// Returns the picture, row by row.
    pub(super) fn pixels(&self, of: impl Fn(&Accumulated<C>) -> [f32; 4]) -> Vec<[f32; 4]> {
        if let Some(sparse) = &self.sparse {
            return sparse.regions.seen.iter().map(of).collect();
        }
        (0..self.rows.len()).flat_map(|j| self.row(j)).map(of).collect()
    }

    /// Converts the picture to bytes, `N` a pixel, row by row.
    pub(super) fn bytes_of<const N: usize>(
        &self,
        width: u32,
        (simd, sharing): (Simd, Sharing),
        of: impl Fn(&Accumulated<C>) -> [u8; N] + Sync,
    ) -> Vec<u8> {
        let width = width as usize;
        let mut bytes = vec![0; self.rows.len() * width * N];
        sharing.chunks(&mut bytes, width * N, |j, bytes| {
            let pixels = match &self.sparse {
                Some(sparse) => &sparse.regions.seen[j * width..][..width],
                None => self.row(j),
            };
            simd.fused(Converting { pixels, bytes, of: &of });
        });
        bytes
    }

    /// Returns a row of the picture, if there is one ray a pixel.
    fn row(&self, j: usize) -> &[Accumulated<C>] {
        &self.rows[j].pixels
    }
}

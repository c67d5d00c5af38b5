//! The voxels of a picture and the samples between them, for the picture's mode.

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;

use super::camera::Camera;
use super::classify::classifier::SampleReader;
use super::classify::interval::Interval;
use super::classify::shade::Shader;
use super::mode::VoxelData;
use super::rays::composite::Fold;
use super::rays::line::Line;
use super::rays::run::{Reader, Run};
use super::rays::visible_blocks::VisibleBlocks;
use super::region::RenderRegion;
use super::settings::RenderSettings;
use super::shaded::{Dirty, Shaded};
use super::snapshot::{Changed, VoxelSnapshot};
use super::work::RenderWork;

/// Voxels whose samples have C channels, and the blocks of a picture's rays in which any may be
/// visible.
pub(super) struct Voxels<const C: usize> {
    pub(super) shaded: ShadedVoxels<C>,
    pub(super) visible: VisibleBlocks,
}

/// Voxels whose samples have C channels.
pub(super) enum ShadedVoxels<const C: usize> {
    /// Voxels that keep final sample values; samples are only interpolated.
    Lit(Shaded<C>),
    /// Intensity and gradient, from which samples are classified.
    SampleClassifier(Shaded<4>),
}

/// Runs the same code for either kind of voxels.
macro_rules! shaded {
    ($voxels:expr, $shaded:ident => $call:expr) => {
        match $voxels {
            ShadedVoxels::Lit($shaded) => $call,
            ShadedVoxels::SampleClassifier($shaded) => $call,
        }
    };
}

impl<const C: usize> Voxels<C> {
    /// Creates voxels of an empty volume. Up to `stocked` bricks are made in advance.
    pub(super) fn new(
        camera: &Camera,
        region: &RenderRegion,
        settings: &RenderSettings,
        fold: Fold,
        stocked: usize,
    ) -> Self {
        let shaded = match settings.mode.voxel_data() {
            VoxelData::Lit | VoxelData::Intensity => ShadedVoxels::Lit(Shaded::new(region, Interval::ALL, stocked)),
            VoxelData::SampleClassifier => {
                ShadedVoxels::SampleClassifier(Shaded::new(region, Interval::of(settings), stocked))
            }
        };
        Self { shaded, visible: VisibleBlocks::new(camera, fold) }
    }

    /// Same as [`Shaded::update`].
    pub(super) fn update(
        &mut self,
        snapshot: &VoxelSnapshot,
        voxels: &[Changed],
        shader: &Shader<f32>,
        (simd, sharing): (Simd, Sharing),
        dirty: &mut Vec<Dirty>,
    ) -> RenderWork {
        let Self { shaded, visible } = self;
        let mut appeared = Vec::new();
        let work = shaded!(shaded, shaded => {
            shaded.update(snapshot, voxels, shader, (simd, sharing), dirty, &mut appeared)
        });
        appeared.into_iter().for_each(|brick| visible.add(brick));
        work
    }

    /// Same as [`Shaded::relight`].
    pub(super) fn relight(
        &mut self,
        snapshot: &VoxelSnapshot,
        places: &[[i64; 3]],
        shader: &Shader<f32>,
        (simd, sharing): (Simd, Sharing),
    ) -> u64 {
        shaded!(&mut self.shaded, shaded => shaded.relight(snapshot, places, shader, (simd, sharing)))
    }

    /// Same as [`Shaded::widen`].
    pub(super) fn widen(&mut self, region: &RenderRegion, by: [i64; 3], stocked: usize) {
        shaded!(&mut self.shaded, shaded => shaded.widen(region, by, stocked));
    }

    /// Begins another view, in which no block is visible before [`Self::project`].
    pub(super) fn turn(&mut self, camera: &Camera, fold: Fold) {
        self.visible = VisibleBlocks::new(camera, fold);
    }

    /// Enters all bricks into the blocks of a new view.
    pub(super) fn project(&mut self) {
        let Self { shaded, visible } = self;
        shaded!(shaded, shaded => shaded.places().for_each(|brick| visible.add(brick)));
    }

    /// Returns the lit voxels, if voxels keep final sample values.
    pub(super) fn lit(&self) -> Option<&Shaded<C>> {
        if let ShadedVoxels::Lit(shaded) = &self.shaded { Some(shaded) } else { None }
    }

    /// Same as [`Shaded::adopt`]; both are for one mode. The blocks stay as they are.
    pub(super) fn adopt(&mut self, other: Self, layers: &Range<i64>) {
        match (&mut self.shaded, other.shaded) {
            (ShadedVoxels::Lit(shaded), ShadedVoxels::Lit(other)) => shaded.adopt(other, layers),
            (ShadedVoxels::SampleClassifier(shaded), ShadedVoxels::SampleClassifier(other)) => {
                shaded.adopt(other, layers);
            }
            _ => {}
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        shaded!(&self.shaded, shaded => shaded.bytes())
    }
}

/// Takes the samples of rays.
#[derive(Clone, Copy)]
pub(super) enum Sampler<'a, const C: usize> {
    /// From voxels that keep final sample values.
    Lit(Reader<'a, C>),
    /// From intensity and gradient.
    SampleClassifier(SampleReader<'a>),
}

impl<'a, const C: usize> Sampler<'a, C> {
    pub(super) fn new(voxels: &'a Voxels<C>, shader: &'a Shader<f32>) -> Self {
        match &voxels.shaded {
            ShadedVoxels::Lit(shaded) => Self::Lit(Reader::of_visible(shaded)),
            ShadedVoxels::SampleClassifier(shaded) => Self::SampleClassifier(SampleReader::new(shaded, shader)),
        }
    }

    /// Same as [`Reader::run`].
    #[inline(always)]
    pub(super) fn run(&self, line: &Line, k: u32, n: u32, run: &mut Run<C>, work: &mut RenderWork) -> bool {
        match self {
            Self::Lit(reader) => reader.run(line, k, n, run, work),
            Self::SampleClassifier(reader) => reader.run(line, k, n, run, work),
        }
    }

    /// Same as [`SampleReader::surface`].
    pub(super) fn surface(&self, line: &Line, k: u32) -> Option<f64> {
        match self {
            Self::Lit(_) => None,
            Self::SampleClassifier(reader) => reader.surface(line, k),
        }
    }
}

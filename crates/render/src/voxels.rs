//! The voxels of a picture and the samples between them, for the picture's mode.

use std::ops::Range;

use simd::Simd;
use simd::sharing::Sharing;

use super::classify::classifier::SampleReader;
use super::classify::interval::Interval;
use super::classify::shade::Shader;
use super::mode::VoxelData;
use super::rays::line::Line;
use super::rays::run::{Reader, Run};
use super::region::RenderRegion;
use super::settings::RenderSettings;
use super::shaded::{Dirty, Shaded};
use super::snapshot::{Changed, VoxelSnapshot};
use super::work::RenderWork;

/// Voxels whose samples have C channels.
pub(super) enum Voxels<const C: usize> {
    /// Voxels that keep final sample values; samples are only interpolated.
    Lit(Shaded<C>),
    /// Intensity and gradient, from which samples are classified.
    SampleClassifier(Shaded<4>),
}

impl<const C: usize> Voxels<C> {
    pub(super) fn new(region: &RenderRegion, settings: &RenderSettings) -> Self {
        match settings.mode.voxel_data() {
            VoxelData::Lit | VoxelData::Intensity => Self::Lit(Shaded::new(region, Interval::ALL)),
            VoxelData::SampleClassifier => Self::SampleClassifier(Shaded::new(region, Interval::of(settings))),
        }
    }

    /// Same as [`Shaded::update`].
    pub(super) fn update(
        &mut self,
        snapshot: &VoxelSnapshot,
        voxels: &[Changed],
        shader: &Shader<f32>,
        simd: Simd,
        sharing: Sharing,
        dirty: &mut Vec<Dirty>,
    ) -> u64 {
        match self {
            Self::Lit(shaded) => shaded.update(snapshot, voxels, shader, simd, sharing, dirty),
            Self::SampleClassifier(shaded) => shaded.update(snapshot, voxels, shader, simd, sharing, dirty),
        }
    }

    /// Same as [`Shaded::adopt`]; both are for one mode.
    pub(super) fn adopt(&mut self, other: Self, layers: &Range<i64>) {
        match (self, other) {
            (Self::Lit(shaded), Self::Lit(other)) => shaded.adopt(other, layers),
            (Self::SampleClassifier(shaded), Self::SampleClassifier(other)) => shaded.adopt(other, layers),
            _ => {}
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        match self {
            Self::Lit(shaded) => shaded.bytes(),
            Self::SampleClassifier(shaded) => shaded.bytes(),
        }
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
        match voxels {
            Voxels::Lit(shaded) => Self::Lit(Reader::of_visible(shaded)),
            Voxels::SampleClassifier(shaded) => Self::SampleClassifier(SampleReader::new(shaded, shader)),
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

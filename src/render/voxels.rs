//! The voxels of a picture and the samples between them, as its mode has them.

use super::cast::Line;
use super::interval::Interval;
use super::matter::MatterReader;
use super::mode::Keeps;
use super::run::{Reader, Run};
use super::settings::RenderSettings;
use super::shade::Shader;
use super::shaded::{Dirty, Shaded};
use super::shown::{Changed, Shown};
use super::stage::Stage;
use super::work::RenderWork;
use crate::sharing::Sharing;
use crate::simd::Simd;

/// Voxels whose samples have C channels.
pub(super) enum Voxels<const C: usize> {
    /// What samples have: they are interpolated, and that is all.
    Lit(Shaded<C>),
    /// Intensity and gradient, of which samples are made.
    Matter(Shaded<4>),
}

impl<const C: usize> Voxels<C> {
    pub(super) fn new(stage: &Stage, settings: &RenderSettings) -> Self {
        match settings.mode.keeps() {
            Keeps::Lit | Keeps::Intensity => Self::Lit(Shaded::new(stage, Interval::ALL)),
            Keeps::Matter => Self::Matter(Shaded::new(stage, Interval::of(settings))),
        }
    }

    /// As [`Shaded::update`].
    pub(super) fn update(
        &mut self,
        shown: &Shown,
        voxels: &[Changed],
        shader: &Shader<f32>,
        simd: Simd,
        sharing: Sharing,
        dirty: &mut Vec<Dirty>,
    ) -> u64 {
        match self {
            Self::Lit(shaded) => shaded.update(shown, voxels, shader, simd, sharing, dirty),
            Self::Matter(shaded) => shaded.update(shown, voxels, shader, simd, sharing, dirty),
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        match self {
            Self::Lit(shaded) => shaded.bytes(),
            Self::Matter(shaded) => shaded.bytes(),
        }
    }
}

/// Takes the samples of rays.
#[derive(Clone, Copy)]
pub(super) enum Sampler<'a, const C: usize> {
    /// Of voxels that keep what samples have.
    Lit(Reader<'a, C>),
    /// Of matter.
    Matter(MatterReader<'a>),
}

impl<'a, const C: usize> Sampler<'a, C> {
    pub(super) fn new(voxels: &'a Voxels<C>, shader: &'a Shader<f32>) -> Self {
        match voxels {
            Voxels::Lit(shaded) => Self::Lit(Reader::of_visible(shaded)),
            Voxels::Matter(shaded) => Self::Matter(MatterReader::new(shaded, shader)),
        }
    }

    /// As [`Reader::run`].
    #[inline(always)]
    pub(super) fn run(&self, line: &Line, k: u32, n: u32, run: &mut Run<C>, work: &mut RenderWork) -> bool {
        match self {
            Self::Lit(reader) => reader.run(line, k, n, run, work),
            Self::Matter(reader) => reader.run(line, k, n, run, work),
        }
    }

    /// As [`MatterReader::surface`].
    pub(super) fn surface(&self, line: &Line, k: u32) -> Option<f64> {
        match self {
            Self::Lit(_) => None,
            Self::Matter(reader) => reader.surface(line, k),
        }
    }
}

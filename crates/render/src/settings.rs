//! Render settings, including memory and thread limits.

use std::sync::Arc;

use simd::Simd;
use simd::team::Team;

use super::RenderError;
use super::camera::View;
use super::classify::light::Light;
use super::classify::soft::SoftShade;
use super::classify::transfer::Transfer;
use super::crop::Crop;
use super::mode::{Mode, VoxelData};
use super::rays::composite::Fold;

/// The data kept of rays between pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cache {
    /// Nothing: a ray that a change reaches is cast whole.
    None,
    /// Every sample: only changed samples are interpolated again, and all are composited.
    Linear,
    /// Every sample and every composited block: only changed blocks are composited again.
    TwoLevel,
    /// Every composited block: a changed block's samples are interpolated again. The default: to
    /// keep samples saves no time, since they come from memory no faster than they are made.
    #[default]
    OneLevel,
}

impl Cache {
    /// Returns the name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Linear => "linear",
            Self::TwoLevel => "two-level",
            Self::OneLevel => "one-level",
        }
    }

    /// All caches, the one that keeps most first.
    pub const ALL: [Self; 4] = [Self::TwoLevel, Self::Linear, Self::OneLevel, Self::None];

    pub(super) fn keeps_samples(self) -> bool {
        matches!(self, Self::Linear | Self::TwoLevel)
    }

    pub(super) fn keeps_blocks(self) -> bool {
        matches!(self, Self::OneLevel | Self::TwoLevel)
    }
}

/// Default limit of the ray cache, bytes.
pub const CACHE_BYTES: u64 = 256 << 20;
/// Default of [`RenderSettings::stop`]: a quarter of the step of an 8 bit picture.
pub const STOP: f32 = 1.0 / 1024.0;

/// Settings of a rendered picture.
#[derive(Debug, Clone)]
pub struct RenderSettings {
    /// The view.
    pub view: View,
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// Distance of samples along a ray, in the finest voxel spacing.
    pub step: f64,
    /// The render mode.
    pub mode: Mode,
    /// Opacity and colour of intensities.
    pub transfer: Transfer,
    /// The parts of the volume that are hidden.
    pub crop: Crop,
    /// The light.
    pub light: Light,
    /// Soft light instead of it, made by [`crate::soft`] for one view and volume.
    pub soft: Option<SoftShade>,
    /// Samples of a composited block; `None` for [`usual_arity`].
    pub arity: Option<u32>,
    /// A ray ends when its transmittance is below this, 0 to 1; 0 casts all.
    pub stop: f32,
    /// Pixel difference below which rays are left out, as a share of the full range; see
    /// `adaptive`. 0 casts one ray a pixel; 1/255 to 8/255 are usual.
    pub adaptive: f32,
    /// The data kept of rays.
    pub cache: Cache,
    /// Limit of the ray cache, bytes; if it would take more, less is kept.
    pub cache_bytes: u64,
    /// Parts of the volume that are rendered each by itself, see [`crate::partition`]; any number
    /// gives the same picture. `None` is one: the volume is not cut.
    pub parts: Option<u32>,
    /// Threads; any number gives the same picture.
    pub threads: usize,
    /// Instruction set of the hot loops; all give the same picture.
    pub simd: Simd,
}

impl RenderSettings {
    /// Returns settings for a picture of `size` pixels from the front, one voxel a sample, on
    /// one thread.
    pub fn new(size: [u32; 2], transfer: Transfer) -> Self {
        Self {
            view: View::default(),
            size,
            step: 1.0,
            mode: Mode::default(),
            transfer,
            crop: Crop::default(),
            light: Light::default(),
            soft: None,
            arity: None,
            stop: STOP,
            adaptive: 0.0,
            cache: Cache::default(),
            cache_bytes: CACHE_BYTES,
            parts: None,
            threads: 1,
            simd: Simd::detect(),
        }
    }

    pub(super) fn fold(&self, samples: u32) -> Result<Fold, RenderError> {
        let arity = self.arity.unwrap_or_else(|| usual_arity(samples));
        if arity == 0 {
            return Err(RenderError::Arity);
        }
        if !(0.0..=1.0).contains(&self.stop) {
            return Err(RenderError::Stop { stop: self.stop });
        }
        if !(0.0..=1.0).contains(&self.adaptive) {
            return Err(RenderError::Adaptive { epsilon: self.adaptive });
        }
        if self.adaptive > 0.0 && self.mode.voxel_data() != VoxelData::Lit {
            return Err(RenderError::AdaptiveMode { mode: self.mode.name() });
        }
        Ok(Fold { arity, composite_mode: self.mode.composite_mode(&self.transfer), stop: self.stop })
    }

    pub(super) fn team(&self) -> Result<Option<Arc<Team>>, RenderError> {
        team(self.threads)
    }
}

/// Returns a team of `threads` threads; `None` for one: the calling thread then works alone.
///
/// # Errors
/// [`RenderError::Threads`].
pub fn team(threads: usize) -> Result<Option<Arc<Team>>, RenderError> {
    let team = Team::new("render", threads).map_err(|e| RenderError::Threads { threads, why: e.to_string() })?;
    Ok(team.map(Arc::new))
}

/// Returns the samples of a block for rays of `samples` samples: the power of two nearest to
/// their square root, by ratio. It depends on this number alone, so that a picture is the same
/// on every machine.
pub fn usual_arity(samples: u32) -> u32 {
    let root = f64::from(samples.max(1)).sqrt();
    1 << (libm::log2(root).round() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_arity_is_near_square_root() {
        assert_eq!([1, 2, 64, 128, 256, 512, 1024].map(usual_arity), [1, 2, 8, 16, 16, 32, 32]);
        for samples in 1..5000 {
            let ratio = f64::from(usual_arity(samples)) / f64::from(samples).sqrt();
            assert!((0.7..=1.4143).contains(&ratio), "{samples}: {ratio}");
        }
    }
}

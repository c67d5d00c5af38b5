//! What to render, and with how much memory and how many threads.

use std::sync::Arc;

use super::RenderError;
use super::camera::View;
use super::cast::Fold;
use super::light::Light;
use super::mode::{Keeps, Mode};
use super::transfer::Transfer;
use crate::simd::Simd;

/// What is kept of rays between pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cache {
    /// Nothing: a ray that a change reaches is cast whole.
    None,
    /// Every sample: only changed samples are interpolated again, and all are folded.
    Linear,
    /// Every sample and the fold of every block: only changed blocks are folded again.
    #[default]
    TwoLevel,
    /// The fold of every block: a changed block's samples are interpolated again.
    OneLevel,
}

impl Cache {
    /// The name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Linear => "linear",
            Self::TwoLevel => "two-level",
            Self::OneLevel => "one-level",
        }
    }

    /// All, the one that keeps most first.
    pub const ALL: [Self; 4] = [Self::TwoLevel, Self::Linear, Self::OneLevel, Self::None];

    pub(super) fn keeps_samples(self) -> bool {
        matches!(self, Self::Linear | Self::TwoLevel)
    }

    pub(super) fn keeps_blocks(self) -> bool {
        matches!(self, Self::OneLevel | Self::TwoLevel)
    }
}

/// Bytes that a ray cache may take by default.
pub const CACHE_BYTES: u64 = 256 << 20;
/// Default of [`RenderSettings::stop`]: a quarter of the step of an 8 bit picture.
pub const STOP: f32 = 1.0 / 1024.0;

/// How a volume is rendered.
#[derive(Debug, Clone)]
pub struct RenderSettings {
    /// From where.
    pub view: View,
    /// Pixels to the right and down.
    pub size: [u32; 2],
    /// Distance of samples along a ray, in the finest voxel spacing.
    pub step: f64,
    /// What of the volume is shown.
    pub mode: Mode,
    /// Opacity and colour of intensities.
    pub transfer: Transfer,
    /// The light.
    pub light: Light,
    /// Samples of a block of the fold; `None` for [`usual_arity`].
    pub arity: Option<u32>,
    /// A ray ends where less of what lies behind would be seen, 0 to 1; 0 casts all.
    pub stop: f32,
    /// Rays are left out where the picture differs by less from one to the next, in parts of its full range; see `adaptive`. 0 casts one a pixel. 1/255 to 8/255
    /// are usual.
    pub adaptive: f32,
    /// What is kept of rays.
    pub cache: Cache,
    /// Bytes that a ray cache may take; where it would take more, less is kept.
    pub cache_bytes: u64,
    /// Threads; any number makes the same picture.
    pub threads: usize,
    /// Instruction set of the hot loops; all make the same picture.
    pub simd: Simd,
}

impl RenderSettings {
    /// A picture of that many pixels from the front, one voxel a sample, on one thread.
    pub fn new(size: [u32; 2], transfer: Transfer) -> Self {
        Self {
            view: View::default(),
            size,
            step: 1.0,
            mode: Mode::default(),
            transfer,
            light: Light::default(),
            arity: None,
            stop: STOP,
            adaptive: 0.0,
            cache: Cache::default(),
            cache_bytes: CACHE_BYTES,
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
        if self.adaptive > 0.0 && self.mode.keeps() != Keeps::Lit {
            return Err(RenderError::AdaptiveMode { mode: self.mode.name() });
        }
        Ok(Fold { arity, law: self.mode.law(&self.transfer), stop: self.stop })
    }

    pub(super) fn pool(&self) -> Result<Option<Arc<rayon::ThreadPool>>, RenderError> {
        pool(self.threads)
    }
}

/// So many threads that work together; `None` for one, who works alone.
///
/// # Errors
/// [`RenderError::Threads`].
pub fn pool(threads: usize) -> Result<Option<Arc<rayon::ThreadPool>>, RenderError> {
    match threads {
        0 | 1 => Ok(None),
        n => rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .thread_name(|i| format!("render-{i}"))
            .build()
            .map(|pool| Some(Arc::new(pool)))
            .map_err(|e| RenderError::Threads { threads: n, why: e.to_string() }),
    }
}

/// Samples of a block for rays of so many samples: the power of two nearest to their square root, by ratio. A function of the number alone, so that a picture
/// is the same on every machine.
pub fn usual_arity(samples: u32) -> u32 {
    let root = f64::from(samples.max(1)).sqrt();
    1 << (libm::log2(root).round() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_arity_is_near_the_square_root() {
        assert_eq!([1, 2, 64, 128, 256, 512, 1024].map(usual_arity), [1, 2, 8, 16, 16, 32, 32]);
        for samples in 1..5000 {
            let ratio = f64::from(usual_arity(samples)) / f64::from(samples).sqrt();
            assert!((0.7..=1.4143).contains(&ratio), "{samples}: {ratio}");
        }
    }
}

//! Composited samples, and composite modes: how the samples along a ray are combined.
//!
//! All modes share the state, premultiplied colour and transmittance, and the neutral element
//! (0, 1). Each is associative except for rounding.

use crate::work::RenderWork;

/// Composited samples: premultiplied colour, and the transmittance to whatever lies behind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Accumulated<const C: usize> {
    pub(crate) colour: [f32; C],
    pub(crate) transmittance: f32,
}

impl<const C: usize> Accumulated<C> {
    /// No samples.
    pub(crate) const CLEAR: Self = Self { colour: [0.0; C], transmittance: 1.0 };

    /// Adds a sample behind.
    #[inline(always)]
    pub(crate) fn add(&mut self, colour: [f32; C], alpha: f32) {
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance = (-self.transmittance).mul_add(alpha, self.transmittance);
    }

    /// Adds a block behind; returns whether the ray ends with it.
    #[inline(always)]
    pub(crate) fn ends_behind(&mut self, block: &Self, fold: Fold, work: &mut RenderWork) -> bool {
        fold.composite_mode.join(self, block);
        work.blocks_folded += 1;
        fold.composite_mode.ends(self, fold.stop)
    }

    /// Adds a block behind.
    #[inline(always)]
    pub(crate) fn join(&mut self, block: &Self) {
        for (sum, c) in self.colour.iter_mut().zip(block.colour) {
            *sum = self.transmittance.mul_add(c, *sum);
        }
        self.transmittance *= block.transmittance;
    }

    pub(crate) fn same_bits(&self, other: &Self) -> bool {
        self.transmittance.to_bits() == other.transmittance.to_bits()
            && self.colour.iter().zip(&other.colour).all(|(a, b)| a.to_bits() == b.to_bits())
    }
}

/// Composite mode of the samples along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum CompositeMode {
    /// Samples in front hide those behind.
    Over,
    /// Tissue so thin that nothing is hidden: colours and opacities add up. This is the first
    /// order of [`Self::Over`] in the opacity. The transmittance can end anywhere below 1, and
    /// colour / (1 − transmittance) is the mean.
    Thin,
    /// The largest colour of the samples seen by half or more, not premultiplied. The
    /// transmittance is 0 once there was one.
    Most {
        /// Larger values make no difference.
        top: f32,
    },
}

impl CompositeMode {
    /// Adds a sample behind.
    #[inline(always)]
    pub(crate) fn add<const C: usize>(self, front: &mut Accumulated<C>, colour: [f32; C], alpha: f32) {
        match self {
            Self::Over => front.add(colour, alpha),
            Self::Thin => {
                for (sum, c) in front.colour.iter_mut().zip(colour) {
                    *sum += c;
                }
                front.transmittance -= alpha;
            }
            Self::Most { .. } => {
                if alpha >= 0.5 {
                    let mut value = colour;
                    for c in &mut value {
                        *c /= alpha;
                    }
                    larger(front, &value);
                }
            }
        }
    }

    /// Adds a block behind.
    #[inline(always)]
    pub(crate) fn join<const C: usize>(self, front: &mut Accumulated<C>, block: &Accumulated<C>) {
        match self {
            Self::Over => front.join(block),
            Self::Thin => {
                for (sum, c) in front.colour.iter_mut().zip(block.colour) {
                    *sum += c;
                }
                front.transmittance += block.transmittance - 1.0;
            }
            Self::Most { .. } => {
                if block.transmittance < 1.0 {
                    larger(front, &block.colour);
                }
            }
        }
    }

    /// Returns whether samples further behind make no difference, or too little: the
    /// transmittance is below `stop`.
    #[inline(always)]
    pub(crate) fn ends<const C: usize>(self, front: &Accumulated<C>, stop: f32) -> bool {
        match self {
            Self::Over => front.transmittance < stop,
            Self::Thin => false,
            Self::Most { top } => front.transmittance < 1.0 && front.colour[0] >= top,
        }
    }
}

/// Parameters for compositing samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fold {
    /// Samples of a block.
    pub(crate) arity: u32,
    /// The composite mode.
    pub(crate) composite_mode: CompositeMode,
    /// The ray ends at the end of a block if the transmittance is below this.
    pub(crate) stop: f32,
}

impl Fold {
    /// Returns the number of the block that holds a sample.
    #[inline(always)]
    pub(crate) fn block_of(self, k: u32) -> u32 {
        // The usual numbers of samples are powers of two, and a division takes long.
        if self.arity.is_power_of_two() { k >> self.arity.trailing_zeros() } else { k / self.arity }
    }
}

/// Keeps the larger one; anything is larger than nothing.
#[inline(always)]
fn larger<const C: usize>(front: &mut Accumulated<C>, value: &[f32; C]) {
    if front.transmittance >= 1.0 || value[0] > front.colour[0] {
        front.colour = *value;
        front.transmittance = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODES: [CompositeMode; 3] = [CompositeMode::Over, CompositeMode::Thin, CompositeMode::Most { top: 255.0 }];

    fn folded(composite_mode: CompositeMode, samples: &[(f32, f32)]) -> Accumulated<1> {
        let mut all = Accumulated::CLEAR;
        samples.iter().for_each(|(c, alpha)| composite_mode.add(&mut all, [*c], *alpha));
        all
    }

    #[test]
    fn composited_blocks_equal_composited_samples() {
        let samples: Vec<(f32, f32)> = (0..60_u16)
            .map(|i| {
                let alpha = f32::from(i * 7 % 11) / 11.0;
                (alpha * f32::from(i * 13 % 17), alpha)
            })
            .collect();
        for composite_mode in MODES {
            let whole = folded(composite_mode, &samples);
            for arity in [1, 4, 7, 59] {
                let mut all = Accumulated::CLEAR;
                samples.chunks(arity).for_each(|block| composite_mode.join(&mut all, &folded(composite_mode, block)));
                let off = (all.colour[0] - whole.colour[0]).abs().max((all.transmittance - whole.transmittance).abs());
                assert!(off < 1e-3, "{composite_mode:?} in {arity}s: {all:?}, not {whole:?}");
            }
            let mut same = whole;
            composite_mode.join(&mut same, &Accumulated::CLEAR);
            let mut behind_nothing = Accumulated::CLEAR;
            composite_mode.join(&mut behind_nothing, &whole);
            assert!(same.same_bits(&whole), "{composite_mode:?}");
            assert!((behind_nothing.transmittance - whole.transmittance).abs() < 1e-5, "{composite_mode:?}");
        }
    }

    #[test]
    fn maximum_uses_seen_samples_and_allows_negative() {
        let most = MODES[2];
        assert_eq!(
            folded(most, &[(-6.0, 1.0), (-3.0, 0.75), (90.0, 0.4)]),
            Accumulated { colour: [-4.0], transmittance: 0.0 }
        );
        assert_eq!(folded(most, &[(90.0, 0.4), (0.0, 0.0)]), Accumulated::CLEAR);
        assert!(most.ends(&folded(most, &[(255.0, 1.0)]), 0.0) && !most.ends(&folded(most, &[(254.0, 1.0)]), 1.0));
        assert!(!most.ends(&Accumulated::<1>::CLEAR, 1.0));
    }

    #[test]
    fn thin_mode_is_limit_of_over_mode() {
        let (samples, thin) = ([(30.0, 0.5), (200.0, 1.0), (90.0, 0.75)], 1e-4);
        let faint = samples.map(|(c, alpha)| (c * thin, alpha * thin));
        let (mean, over) = (folded(CompositeMode::Thin, &samples), folded(CompositeMode::Over, &faint));
        assert_eq!(mean, Accumulated { colour: [320.0], transmittance: -1.25 });
        assert!((mean.colour[0] - over.colour[0] / thin).abs() < 0.1);
        assert!(((1.0 - mean.transmittance) - (1.0 - over.transmittance) / thin).abs() < 2e-3);
    }
}

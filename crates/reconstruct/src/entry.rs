//! Entry of a slice's values into a vector of voxels: added, selected, or added to fading sums.
#![allow(unsafe_code, reason = "runs on `Lanes`, by pointer")]

use simd::{LANES, Lanes};
use volume::brick::{Ages, Brick, Squares, Stamps};

use super::compounding::Entry;
use super::decay::{Decay, EpochChange, Fading, LEAST_FACTOR, LEAST_SUM, LEAST_TOUCH};
use super::falloff::power_of_two;
use super::task::{FilteredSlice, Task};

/// Returns numerators with negligible ones set to 0.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
pub(crate) unsafe fn shrunk<L: Lanes>(sum: L) -> L {
    // SAFETY: as for this function.
    unsafe {
        let zero = L::splat(0.0);
        L::select(sum.max(zero.sub(sum)).le(L::splat(LEAST_SUM)), zero, sum)
    }
}

/// A brick with its stamps, ages and sums of squares.
pub(crate) struct BrickData<'a> {
    pub(crate) brick: &'a mut Brick,
    pub(crate) stamps: Option<&'a mut Stamps>,
    pub(crate) ages: Option<&'a mut Ages>,
    pub(crate) squares: Option<&'a mut Squares>,
    /// Effect of the slice on the brick's times.
    pub(crate) change: EpochChange,
}

/// Values of a slice at a vector of voxels.
pub(crate) struct Sample<L> {
    /// Weight across the plane.
    pub(crate) weight: L,
    /// Σ k·c·(b − level) in the plane.
    pub(crate) contrast: L,
    /// Σ k·c in the plane.
    pub(crate) certainty: L,
    pub(crate) level: L,
}

impl<L: Lanes> Sample<L> {
    /// Σ k·c·b.
    ///
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    unsafe fn sum(&self) -> L {
        // SAFETY: as for this function.
        unsafe { self.contrast.add(self.certainty.mul(self.level)) }
    }

    /// Returns the in-plane filtered value, exact for a constant image.
    ///
    /// # Safety
    /// The instruction set of `L` must be available.
    #[inline(always)]
    unsafe fn value(&self) -> L {
        // SAFETY: as for this function.
        unsafe { self.contrast.div(self.certainty).add(self.level) }
    }
}

/// Enters a sample into the vector of voxels that begins at `at` in the brick, in the lanes of
/// `mask`.
///
/// # Safety
/// The instruction set of `L` must be available; `at` begins a vector of the brick.
#[inline(always)]
pub(crate) unsafe fn enter<L: Lanes>(
    data: &mut BrickData<'_>,
    at: usize,
    mask: L::Mask,
    sample: &Sample<L>,
    filtered: &FilteredSlice<'_>,
    task: &mut Task,
) {
    // SAFETY: as for this function.
    unsafe {
        let most = filtered.rule.most_weight;
        match filtered.rule.entry {
            Entry::Mean => mean::<L, false>(data, at, mask, sample, filtered, task),
            Entry::MeanAndSquares => mean::<L, true>(data, at, mask, sample, filtered, task),
            Entry::Maximum => raise(data.brick, at, mask, sample.value(), task),
            Entry::Latest => replace(data, at, mask, sample.value(), filtered.time.stamp, task),
            Entry::Decay(fading) => {
                let mask = L::and(mask, L::splat(LEAST_TOUCH).le(sample.certainty.mul(sample.weight)));
                if fading.keeps_ages() {
                    fade(data, at, mask, sample, most, &fading, task);
                } else {
                    let gain = data.change.gain;
                    let weight = sample.weight.mul(L::splat(gain));
                    add::<L, false>(data, at, mask, [weight, sample.sum(), sample.certainty], most * gain, task);
                }
            }
        }
    }
}

/// Implements [`Entry::Mean`], and with `SQUARES` [`Entry::MeanAndSquares`].
///
/// # Safety
/// Same as for [`enter`].
#[inline(always)]
pub(crate) unsafe fn mean<L: Lanes, const SQUARES: bool>(
    data: &mut BrickData<'_>,
    at: usize,
    mask: L::Mask,
    sample: &Sample<L>,
    filtered: &FilteredSlice<'_>,
    task: &mut Task,
) {
    // SAFETY: as for this function.
    unsafe {
        let summed = [sample.weight, sample.sum(), sample.certainty];
        add::<L, SQUARES>(data, at, mask, summed, filtered.rule.most_weight, task);
    }
}

/// Adds to the sums of a vector at `at`, in the lanes of `mask`, and clamps the weights to
/// `most`. With `SQUARES`, adds to the sums of squares, too.
///
/// # Safety
/// The instruction set of `L` must be available; `at` begins a vector of the brick.
#[inline(always)]
unsafe fn add<L: Lanes, const SQUARES: bool>(
    data: &mut BrickData<'_>,
    at: usize,
    mask: L::Mask,
    [weight, sum, certainty]: [L; 3],
    most: f32,
    task: &mut Task,
) {
    // SAFETY: as for this function; the sums of squares have the brick's shape.
    unsafe {
        let most = L::splat(most);
        let brick = &mut *data.brick;
        let r = L::load(brick.r.as_ptr().add(at));
        let w = L::load(brick.w.as_ptr().add(at));
        let mut new_r = sum.mul_add(weight, r);
        let mut new_w = certainty.mul_add(weight, w);
        let bits = L::bits(mask);
        task.updated += bits.count_ones();
        let fits = new_w.le(most);
        let above = bits & !L::bits(fits);
        if SQUARES && let Some(squares) = &mut data.squares {
            let tile = &mut squares.tiles[at / LANES];
            if above != 0 {
                // All weights of a voxel shrink as their sum is clamped.
                let (mut weights, mut clamped) = ([0.0; LANES], [0.0; LANES]);
                let reached = L::select(mask, new_w, w);
                reached.store(weights.as_mut_ptr());
                reached.min(most).store(clamped.as_mut_ptr());
                shrink(tile, &weights, &clamped);
            }
            square(tile, mask, [certainty.mul(weight), sum.mul(weight)], [r, w, new_w]);
        }
        if above != 0 {
            // most·(r + s·f) / (w + c·f), computed as a step from r. Scaling the sum down would
            // add another rounding with every slice, and a constant would drift (measured:
            // 2.6e-4, against 1e-6 with this).
            let excess = certainty.mul_add(weight, w.sub(most));
            let step = sum.mul(weight).mul_add(most, L::splat(0.0).sub(excess.mul(r))).div(new_w);
            new_r = L::select(fits, new_r, shrunk(r.add(step)));
            new_w = L::select(fits, new_w, most);
            task.clamped += above.count_ones();
        }
        L::select(mask, new_r, r).store(brick.r.as_mut_ptr().add(at));
        L::select(mask, new_w, w).store(brick.w.as_mut_ptr().add(at));
    }
}

/// Product of weights from which a slice adds to the sum of squares. Below, the slice or all slices
/// before it are negligible, and the quotient would not be exact.
const LEAST_PRODUCT: f32 = 1e-20;

/// Adds to the sums of squares of a tile.
///
/// b and v are the sample's weight and value, r and w the sums before it. The square about the mean
/// grows by b·w/(w + b)·(v − r/w)² (West 1979). Nothing large cancels, for any grey levels.
///
/// # Safety
/// The instruction set of `L` must be available.
#[inline(always)]
unsafe fn square<L: Lanes>(tile: &mut [f32; 4], mask: L::Mask, [weight, weighted]: [L; 2], [r, w, new_w]: [L; 3]) {
    // SAFETY: as for this function.
    unsafe {
        let zero = L::splat(0.0);
        // b·w·(v − r/w).
        let step = weighted.mul(w).sub(r.mul(weight));
        let product = weight.mul(w).mul(new_w);
        let gain = step.mul(step.div(product));
        let gain = L::select(product.le(L::splat(LEAST_PRODUCT)), zero, gain);
        L::add_halves(L::select(mask, weight.mul(weight), zero), L::select(mask, gain, zero), tile.as_mut_ptr());
    }
}

/// Scales the sums of a tile's cells for weights that are clamped: by the ratio of the sums of
/// weights, and of their squares.
fn shrink(tile: &mut [f32; 4], weights: &[f32; LANES], clamped: &[f32; LANES]) {
    for cell in 0..2 {
        let ratio = |power: i32| {
            let lanes = (0..LANES).filter(|lane| lane / 2 % 2 == cell);
            let [sum, all] = lanes
                .fold([0.0; 2], |[sum, all], lane| [sum + clamped[lane].powi(power), all + weights[lane].powi(power)]);
            if all > 0.0 { sum / all } else { 1.0 }
        };
        tile[cell] *= ratio(2);
        tile[2 + cell] *= ratio(1);
    }
}

/// Raises values to those of the slice if these are larger; unseen voxels take them. A seen
/// voxel has weight 1.
///
/// # Safety
/// Same as for [`add`].
#[inline(always)]
unsafe fn raise<L: Lanes>(brick: &mut Brick, at: usize, mask: L::Mask, value: L, task: &mut Task) {
    // SAFETY: as for this function.
    unsafe {
        let r = L::load(brick.r.as_ptr().add(at));
        let w = L::load(brick.w.as_ptr().add(at));
        let unseen = w.le(L::splat(0.0));
        task.updated += (L::bits(mask) & (L::bits(unseen) | !L::bits(value.le(r)))).count_ones();
        let raised = L::select(unseen, value, value.max(r));
        L::select(mask, raised, r).store(brick.r.as_mut_ptr().add(at));
        L::select(mask, L::splat(1.0), w).store(brick.w.as_mut_ptr().add(at));
    }
}

/// Replaces values that are not newer than the slice. A seen voxel has weight 1.
///
/// # Safety
/// Same as for [`add`].
#[inline(always)]
unsafe fn replace<L: Lanes>(data: &mut BrickData<'_>, at: usize, mask: L::Mask, value: L, stamp: u32, task: &mut Task) {
    let Some(stamps) = &mut data.stamps else { return };
    // SAFETY: as for this function; the stamps have the brick's shape.
    unsafe {
        let stamps = stamps.0.as_mut_ptr().add(at);
        // An unseen voxel's stamp is 0, older than any.
        let mask = L::and(mask, L::not_above(stamps, stamp));
        task.updated += L::bits(mask).count_ones();
        L::replace_where(mask, stamps, stamp);
        let brick = &mut data.brick;
        let r = L::load(brick.r.as_ptr().add(at));
        let w = L::load(brick.w.as_ptr().add(at));
        L::select(mask, value, r).store(brick.r.as_mut_ptr().add(at));
        L::select(mask, L::splat(1.0), w).store(brick.w.as_mut_ptr().add(at));
    }
}

/// Adds to sums that fade with the age of their voxel.
///
/// # Safety
/// Same as for [`add`].
#[inline(always)]
unsafe fn fade<L: Lanes>(
    data: &mut BrickData<'_>,
    at: usize,
    mask: L::Mask,
    sample: &Sample<L>,
    most: f32,
    fading: &Fading,
    task: &mut Task,
) {
    let Some(ages) = &mut data.ages else { return };
    // SAFETY: as for this function; the ages have the brick's shape.
    unsafe {
        let zero = L::splat(0.0);
        let ages = ages.0.as_mut_ptr().add(at);
        let passed = L::splat(f32::from(data.change.now)).sub(L::load_halves(ages));
        let late = passed.sub(L::splat(fading.wait)).max(zero);
        let factor = power_of_two(late.mul(L::splat(fading.per_tick)));
        let r = L::load(data.brick.r.as_ptr().add(at));
        let w = L::load(data.brick.w.as_ptr().add(at));
        // Negligible factors become 0: subnormal products cost a hundred times as much. Unseen
        // voxels have no past.
        let factor = L::select(factor.le(L::splat(LEAST_FACTOR)), zero, factor);
        let factor = L::select(w.le(zero), zero, factor);
        let weight = match fading.decay {
            Decay::PaperLiteral { .. } => sample.weight.mul(L::splat(1.0).sub(factor)),
            Decay::Exponential { .. } | Decay::DeadTime { .. } => sample.weight,
        };
        L::select(mask, shrunk(r.mul(factor)), r).store(data.brick.r.as_mut_ptr().add(at));
        L::select(mask, w.mul(factor), w).store(data.brick.w.as_mut_ptr().add(at));
        L::replace_halves_where(mask, ages, data.change.now);
        add::<L, false>(data, at, mask, [weight, sample.sum(), sample.certainty], most, task);
    }
}

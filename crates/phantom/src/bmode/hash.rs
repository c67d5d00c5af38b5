//! Pseudorandom numbers from positions: repeatable, and uncorrelated between neighbouring
//! cells.

/// Mixes all bits (Wellons' `lowbias32`, found by search for the least bias).
#[inline(always)]
pub(super) fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Returns a cell's bits, two words, for a key.
#[inline(always)]
pub(super) fn cell([x, y, z]: [i32; 3], key: u32) -> [u32; 2] {
    // The casts keep all bits, which identify the cell.
    let plane = mix(key ^ mix((z as u32).wrapping_mul(0x9e37_79b9)));
    let row = mix(plane ^ (y as u32).wrapping_mul(0x85eb_ca6b));
    in_row(row, x)
}

/// Returns the row's part of a cell's bits: [`cell`] equals `in_row(row, x)`.
#[inline(always)]
pub(super) fn row(y: i32, z: i32, key: u32) -> u32 {
    let plane = mix(key ^ mix((z as u32).wrapping_mul(0x9e37_79b9)));
    mix(plane ^ (y as u32).wrapping_mul(0x85eb_ca6b))
}

/// Returns a cell's bits in its row.
#[inline(always)]
pub(super) fn in_row(row: u32, x: i32) -> [u32; 2] {
    let first = mix(row ^ (x as u32).wrapping_mul(0xc2b2_ae35));
    [first, mix(first.wrapping_add(0x9e37_79b9))]
}

/// Returns a key for a purpose and a seed.
pub(super) fn key(seed: u64, purpose: u32) -> u32 {
    // Both halves of the seed count.
    mix(mix(seed as u32 ^ 0x5bf0_3635).wrapping_add((seed >> 32) as u32) ^ mix(purpose))
}

/// Returns two numbers of mean 0 and variance ½ each, uniform within ±√1.5, from 32 bits.
#[inline(always)]
pub(super) fn amplitudes(bits: u32) -> [f32; 2] {
    const STEP: f32 = 1.224_744_9 / 32_768.0;
    let even = |half: u32| (half as f32 - 32_767.5) * STEP;
    [even(bits & 0xffff), even(bits >> 16)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_cells_are_uncorrelated() {
        let (mut sums, mut squares, mut products) = ([0.0; 2], [0.0; 2], [0.0; 4]);
        let n = 64;
        for (x, y, z) in (0..n).flat_map(|x| (0..n).flat_map(move |y| (0..n).map(move |z| (x - 32, y - 32, z - 32)))) {
            let at = |x, y, z| amplitudes(cell([x, y, z], 7)[1]).map(f64::from);
            let [a, b] = at(x, y, z);
            for (k, value) in [a, b].into_iter().enumerate() {
                sums[k] += value;
                squares[k] += value * value;
            }
            for (k, other) in [at(x + 1, y, z)[0], at(x, y + 1, z)[0], at(x, y, z + 1)[0], b].into_iter().enumerate() {
                products[k] += a * other;
            }
        }
        let n = f64::from(n * n * n);
        // Five standard errors: σ²/√n of products, σ√(4/5)… below that.
        let limit = 5.0 * 0.5 / n.sqrt();
        assert!(sums.iter().all(|s| (s / n).abs() < 5.0 * (0.5 / n).sqrt()), "{sums:?}");
        assert!(squares.iter().all(|s| (s / n - 0.5).abs() < limit), "{squares:?}");
        assert!(products.iter().all(|s| (s / n).abs() < limit), "{products:?}");
        assert_eq!(cell([3, -4, 5], 9), in_row(row(-4, 5, 9), 3));
        assert_ne!(key(1, 1), key(2, 1));
        assert_ne!(key(1, 1), key(1, 2));
        assert_ne!(key(1, 1), key(1 << 32 | 1, 1));
    }
}

//! Halves a shard: the weighted mean of 2×2×2 voxels.

use crate::scalar::Sample;

/// Writes the means of a child shard's voxels into its octant of the parent shard. Both have `edge`
/// voxels along each axis, x fastest; `octant` is 0 or 1 along z, y, x.
///
/// Sums are in f64, over z, y and x in this order. A voxel without seen children keeps the parent's
/// content. The stored weight is an eighth of the sum, in slices' units, and above 0 for each seen
/// voxel.
pub(crate) fn halve<T: Sample>(
    edge: usize,
    (values, weights): (&[T], &[f32]),
    octant: [usize; 3],
    (parent_values, parent_weights): (&mut [T], &mut [f32]),
) {
    let half = edge / 2;
    let at = |[z, y, x]: [usize; 3]| (z * edge + y) * edge + x;
    for z in 0..half {
        for y in 0..half {
            for x in 0..half {
                let (mut weight, mut sum) = (0.0, 0.0);
                for child in 0..8 {
                    let place = at([2 * z + (child >> 2), 2 * y + (child >> 1 & 1), 2 * x + (child & 1)]);
                    let w = f64::from(weights[place]);
                    // Filled voxels have a negative weight, and are not seen.
                    if w > 0.0 {
                        weight += w;
                        sum += w * values[place].to_f64();
                    }
                }
                if weight > 0.0 {
                    let place = at([octant[0] * half + z, octant[1] * half + y, octant[2] * half + x]);
                    parent_values[place] = T::of_mean(sum / weight);
                    parent_weights[place] = ((weight / 8.0) as f32).max(f32::from_bits(1));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn halved<T: Sample>(values: &[T; 8], weights: &[f32; 8], unseen: T) -> (T, f32) {
        let (mut parent, mut weight) = ([unseen; 8], [0.0; 8]);
        halve(2, (values, weights), [1, 0, 1], (&mut parent, &mut weight));
        assert!((0..8).all(|i| i == 5 || (parent[i].is_same(unseen) && weight[i] == 0.0)));
        (parent[5], weight[5])
    }

    #[test]
    fn mean_is_weighted_and_rounded_to_even() {
        let weights = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0];
        assert_eq!(halved(&[2_u8, 3, 9, 9, 9, 9, 9, 9], &weights, 7), (2, 0.25));
        assert_eq!(halved(&[3_u16, 4, 9, 9, 9, 9, 9, 9], &weights, 7), (4, 0.25));
        let weights = [3.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(halved(&[1.0_f32, 2.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0], &weights, 7.0), (1.25, 0.5));
    }

    #[test]
    fn voxel_is_seen_if_one_child_is() {
        let mut weights = [0.0; 8];
        assert_eq!(halved(&[200_u8; 8], &weights, 7), (7, 0.0));
        weights[6] = f32::from_bits(1);
        assert_eq!(halved(&[200_u8; 8], &weights, 7), (200, f32::from_bits(1)));
    }
}

//! Fills holes between slices from their surroundings, as is common practice after a
//! nearest-voxel reconstruction.

/// Gives every unseen voxel (NaN) a weighted mean of the seen voxels in the smallest surrounding
/// cube that contains any. The weight is the inverse distance; cubes extend up to `reach` voxels
/// to each side. x is the fastest index.
///
/// The size of a voxel's cube is found by growing the seen region voxel by voxel. Only the
/// cube's surface is read, since its interior is unseen.
pub(crate) fn fill_holes(values: &mut [f32], size: [usize; 3], reach: usize) {
    let radius = radii(values, size, reach);
    let seen = values.to_vec();
    let [nx, ny, _] = size;
    for (i, value) in values.iter_mut().enumerate().filter(|(i, _)| (1..=reach).contains(&usize::from(radius[*i]))) {
        *value = surface_mean(&seen, size, [i % nx, i / nx % ny, i / (nx * ny)], usize::from(radius[i]));
    }
}

/// Returns half the edge of the smallest cube about each voxel that contains a seen one; 0 at
/// seen voxels, `u8::MAX` beyond the reach.
fn radii(values: &[f32], size: [usize; 3], reach: usize) -> Vec<u8> {
    let mut radius: Vec<u8> = values.iter().map(|v| if v.is_nan() { u8::MAX } else { 0 }).collect();
    let strides = [1, size[0], size[0] * size[1]];
    // A cube is separable: each pass, along one axis, takes the largest of the distances.
    for axis in 0..3 {
        let before = radius.clone();
        let (n, stride) = (size[axis], strides[axis]);
        for (i, nearest) in radius.iter_mut().enumerate().filter(|(_, nearest)| **nearest > 0) {
            let at = i / stride % n;
            for away in 1..=reach.min(usize::from(*nearest).saturating_sub(1)) {
                let away_byte = u8::try_from(away).unwrap_or(u8::MAX);
                if away_byte >= *nearest {
                    break;
                }
                let low = if at >= away { before[i - away * stride] } else { u8::MAX };
                let high = if at + away < n { before[i + away * stride] } else { u8::MAX };
                *nearest = (*nearest).min(low.min(high).max(away_byte));
            }
        }
    }
    radius
}

fn surface_mean(seen: &[f32], [nx, ny, nz]: [usize; 3], [x, y, z]: [usize; 3], radius: usize) -> f32 {
    let (mut sum, mut weights) = (0.0_f32, 0.0_f32);
    let span = |at: usize, n: usize| at.saturating_sub(radius)..=(at + radius).min(n - 1);
    for k in span(z, nz) {
        for j in span(y, ny) {
            let on_face = k.abs_diff(z) == radius || j.abs_diff(y) == radius;
            let mut add = |i: usize| {
                let value = seen[(k * ny + j) * nx + i];
                if !value.is_nan() {
                    let squared = i.abs_diff(x).pow(2) + j.abs_diff(y).pow(2) + k.abs_diff(z).pow(2);
                    let weight = 1.0 / (squared as f32).sqrt();
                    sum += weight * value;
                    weights += weight;
                }
            };
            if on_face {
                span(x, nx).for_each(add);
            } else {
                if x >= radius {
                    add(x - radius);
                }
                if x + radius < nx {
                    add(x + radius);
                }
            }
        }
    }
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 3] = [11, 9, 7];

    /// Tries one cube after the other, and reads every voxel of it.
    fn plain(seen: &[f32], [nx, ny, nz]: [usize; 3], at: [usize; 3], reach: usize) -> f32 {
        for radius in 1..=reach {
            let (mut sum, mut weights) = (0.0, 0.0);
            for (i, value) in seen.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
                let p = [i % nx, i / nx % ny, i / (nx * ny)];
                let away = [0, 1, 2].map(|a| p[a].abs_diff(at[a]));
                if away.iter().all(|d| *d <= radius) {
                    let weight = 1.0 / (away.iter().map(|d| d * d).sum::<usize>() as f32).sqrt();
                    sum += weight * value;
                    weights += weight;
                }
            }
            if weights > 0.0 {
                return sum / weights;
            }
        }
        assert!(nz > 0);
        f32::NAN
    }

    #[test]
    fn filled_holes_match_exhaustive_search_and_seen_voxels_stay() {
        let voxels: usize = SIZE.iter().product();
        for (sparse, reach) in [(2, 1), (37, 2), (151, 3), (401, 12)] {
            let seen: Vec<f32> =
                (0..voxels).map(|i| if i * 7919 % sparse == 1 { i as f32 * 0.37 } else { f32::NAN }).collect();
            let mut filled = seen.clone();
            fill_holes(&mut filled, SIZE, reach);
            for i in 0..voxels {
                let at = [i % SIZE[0], i / SIZE[0] % SIZE[1], i / (SIZE[0] * SIZE[1])];
                let expected = if seen[i].is_nan() { plain(&seen, SIZE, at, reach) } else { seen[i] };
                let same = filled[i].is_nan() && expected.is_nan();
                assert!(same || (filled[i] - expected).abs() <= 1e-4 * expected.abs(), "{sparse} {at:?}");
            }
        }
    }

    #[test]
    fn unseen_volume_stays_unseen() {
        let mut nothing = vec![f32::NAN; 27];
        fill_holes(&mut nothing, [3; 3], 5);
        assert!(nothing.iter().all(|v| v.is_nan()));
    }
}

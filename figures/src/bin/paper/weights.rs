//! The arm's reconstruction in two stages with weights on a plane of voxels, compared with the
//! equations in three dimensions; f64. Lengths are in voxels.
//!
//! Slices are perpendicular to the x-y plane: image axis u is parallel to z, v to y, and slice i
//! is at x = `at[i]`. The one-dimensional region filters along u once per slice; the
//! two-dimensional one spreads columns over x and y. One weight per column is exact if all its
//! voxels receive the same weight.

use reconstruct::kernel::{AxisKernel, KernelError, Method, Support};

/// Voxels along x, y, z.
pub(crate) const SIZE: [usize; 3] = [14, 14, 28];
/// Samples per voxel along u and v.
pub(crate) const FINE: usize = 2;
/// Positions of the slices.
pub(crate) const AT: [f64; 12] = [0.2, 1.4, 2.1, 3.3, 4.6, 5.5, 6.9, 7.6, 8.8, 10.1, 11.2, 12.6];

/// σ of the kernel along each axis.
pub(crate) const SIGMA: f64 = 1.2;

/// Data region of the slices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Coverage {
    /// All samples.
    Full,
    /// Slices see the lower and the upper two thirds of u in turn.
    Parts,
    /// A sector that opens along v.
    Fan,
}

impl Coverage {
    pub(crate) fn holds(self, slice: usize, u: f64, v: f64) -> bool {
        let [_, ny, nz] = SIZE.map(|n| n as f64);
        match self {
            Self::Full => true,
            Self::Parts if slice.is_multiple_of(2) => u < nz * 2.0 / 3.0,
            Self::Parts => u > nz / 3.0,
            Self::Fan => (u - 0.5 * (nz - 1.0)).abs() < 3.0 + 0.5 * nz * v / ny,
        }
    }
}

/// Returns the scanned value: a bright blob on a background that is never dark.
pub(crate) fn scene([x, y, z]: [f64; 3]) -> f64 {
    let distance = ((x - 6.0) / 3.0).powi(2) + ((y - 8.0) / 4.0).powi(2) + ((z - 16.0) / 5.0).powi(2);
    60.0 + 120.0 * (-0.5 * distance).exp()
}

/// Weighted means by the three ways, z fastest, then y; `None` if the three-dimensional weight
/// is zero.
pub(crate) struct Means {
    /// All samples to all voxels, one weight per voxel.
    pub(crate) direct: Vec<Option<f64>>,
    /// In two stages, one weight per voxel.
    pub(crate) staged: Vec<Option<f64>>,
    /// In two stages, one weight per column.
    pub(crate) column: Vec<Option<f64>>,
}

/// Returns the kernel at E_e = .01: in the plane, and across it, truncated as in the paper.
fn kernels() -> Result<[AxisKernel; 2], KernelError> {
    let (method, end) = (Method::GaussianTruncated, Support::Energy(0.01));
    Ok([method.in_plane(SIGMA, end, 1.0 / FINE as f64)?, AxisKernel::new(method, SIGMA, end)?])
}

pub(crate) fn means(coverage: Coverage) -> Result<Means, KernelError> {
    let [g, across] = kernels()?;
    let [nx, ny, nz] = SIZE;
    let [us, vs] = [nz * FINE, ny * FINE].map(|n| (0..n).map(|i| i as f64 / FINE as f64 - 0.25).collect::<Vec<_>>());
    let certain = |i: usize, u: f64, v: f64| if coverage.holds(i, u, v) { 1.0 } else { 0.0 };
    let n = nx * ny * nz;
    let [mut r, mut w, mut staged_r, mut staged_w, mut column_r] = std::array::from_fn(|_| vec![0.0; n]);
    let mut column_w = vec![0.0; nx * ny];
    // The band of the first region: kernel along u, rows scaled to sum 1.
    let band: Vec<Vec<f64>> = (0..nz)
        .map(|z| {
            let row: Vec<f64> = us.iter().map(|u| g.weight(z as f64 - u)).collect();
            let sum: f64 = row.iter().sum();
            row.into_iter().map(|k| k / sum).collect()
        })
        .collect();
    for (i, at) in AT.iter().enumerate() {
        let picture: Vec<Vec<f64>> = us.iter().map(|u| vs.iter().map(|v| scene([*at, *v, *u])).collect()).collect();
        // First region: a column of z for every v, of values and of certainty.
        let filter = |f: &dyn Fn(usize, usize) -> f64| -> Vec<Vec<f64>> {
            (0..vs.len())
                .map(|v| band.iter().map(|row| row.iter().enumerate().map(|(u, k)| k * f(u, v)).sum()).collect())
                .collect()
        };
        let values = filter(&|u, v| certain(i, us[u], vs[v]) * picture[u][v]);
        let certainty = filter(&|u, v| certain(i, us[u], vs[v]));
        for (x, y) in (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y))) {
            let gn = across.weight(x as f64 - at);
            let first = (x * ny + y) * nz;
            for (v, place) in vs.iter().enumerate() {
                let k = gn * g.weight(y as f64 - place);
                if k == 0.0 {
                    continue;
                }
                column_w[x * ny + y] += k;
                for z in 0..nz {
                    staged_r[first + z] += k * values[v][z];
                    staged_w[first + z] += k * certainty[v][z];
                    column_r[first + z] += k * values[v][z];
                    for (u, along) in us.iter().enumerate() {
                        let k = k * g.weight(z as f64 - along) * certain(i, *along, *place);
                        r[first + z] += k * picture[u][v];
                        w[first + z] += k;
                    }
                }
            }
        }
    }
    let divide = |r: &[f64], w: &dyn Fn(usize) -> f64, seen: &[f64]| -> Vec<Option<f64>> {
        (0..n).map(|k| (seen[k] > 0.0).then(|| r[k] / w(k))).collect()
    };
    Ok(Means {
        direct: divide(&r, &|k| w[k], &w),
        staged: divide(&staged_r, &|k| staged_w[k], &w),
        column: divide(&column_r, &|k| column_w[k / nz], &w),
    })
}

/// Returns the largest relative difference where both have a value.
pub(crate) fn apart(a: &[Option<f64>], b: &[Option<f64>]) -> f64 {
    a.iter().zip(b).filter_map(|(a, b)| Some(((*a)? / (*b)? - 1.0).abs())).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_stages_equal_3d_sum_column_weight_needs_full_coverage() {
        for coverage in [Coverage::Full, Coverage::Parts, Coverage::Fan] {
            let found = means(coverage).unwrap();
            assert!(apart(&found.staged, &found.direct) < 1e-12, "{coverage:?}");
            let column = apart(&found.column, &found.direct);
            assert_eq!(column < 1e-12, coverage == Coverage::Full, "{coverage:?}: {column}");
            assert!(found.direct.iter().flatten().all(|v| (59.9..181.0).contains(v)));
        }
    }
}

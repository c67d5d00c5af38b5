//! Largest permitted errors, scan by scan.
//!
//! Errors do not depend on the machine: the scans are seeded, and arithmetic has the same bits
//! everywhere. A limit is twice the largest error of its contestants in a run with `--quick`. The
//! factor leaves room for the further voxel sizes of a whole run, and for changes of a kernel's
//! support. A mistake, such as half a pixel's shift or a wrong weight, exceeds it.

use reconstruct::kernel::Method;

use crate::baselines::Drop;
use crate::contestant::{Contestant, DEFAULT_VOXEL_MM, Path, USUAL};

/// Permitted deviations from the default's equations in f64, grey levels rms, by scan. The columns
/// are those of [`column()`].
const FROM_DEFAULT: [(&str, [f64; 7]); 14] = [
    ("blobs-freehand", [0.4, 0.62, 2.2, 3.8, 3.7, 3.3, 1.9]),
    ("sphere-jittered", [2.2, 3.2, 6.8, 11.0, 19.0, 19.0, 9.7]),
    ("zone-plate-sparse", [3.5, 9.3, 5.9, 20.0, 24.0, 32.0, 3.5]),
    ("waves-parallel", [3.0, 4.1, 6.4, 9.4, 26.0, 26.0, 22.0]),
    ("edge-fan", [0.9, 2.2, 3.2, 7.1, 19.0, 19.0, 11.0]),
    ("wires-freehand", [0.56, 0.72, 3.3, 4.5, 4.6, 3.8, 1.7]),
    ("sheet-jittered", [2.0, 2.4, 4.6, 6.6, 13.0, 12.0, 3.2]),
    ("marschner-lobb", [1.4, 1.8, 3.8, 5.0, 3.5, 2.8, 1.6]),
    ("speckle-freehand", [2.2, 2.7, 8.0, 11.0, 20.0, 20.0, 7.4]),
    ("ramp-jittered", [0.18, 0.27, 2.2, 3.7, 2.2, 1.7, 0.52]),
    ("constant-arm", [0.18, 0.22, 2.2, 3.6, 2.1, 1.6, 0.56]),
    ("blobs-crossing", [0.34, 0.49, 1.6, 2.8, 3.5, 2.9, 1.9]),
    ("sphere-tracker-small", [2.1, 3.3, 6.5, 10.0, 20.0, 20.0, 8.9]),
    ("sphere-tracker-large", [1.8, 3.8, 5.8, 12.0, 26.0, 25.0, 1.8]),
];

/// Returns the column of a contestant: the default's kernel and voxels; other kernels of its width;
/// linear; nearest; the two splats; `--sigma auto`.
fn column(contestant: &Contestant) -> usize {
    match contestant.path {
        Path::Kernel(method, energies)
            if method == Method::default() && energies == USUAL && contestant.voxel_mm == DEFAULT_VOXEL_MM =>
        {
            0
        }
        Path::Kernel(Method::Linear, _) => 2,
        Path::Kernel(Method::Nearest, _) => 3,
        Path::Kernel(..) | Path::FirstMoment(_) | Path::Corrected(_) | Path::BruteForce => 1,
        Path::Splat(Drop::Nearest | Drop::NearestInBytes) => 4,
        Path::Splat(Drop::Trilinear) => 5,
        Path::AutoSigma => 6,
    }
}

/// Returns the permitted deviation of a contestant from the default's equations over a scan, grey
/// levels rms.
///
/// # Errors
/// If the scan has no limits yet.
pub(crate) fn from_default(scan: &str, contestant: &Contestant) -> Result<f64, String> {
    let found = FROM_DEFAULT.iter().find(|(id, _)| *id == scan);
    let (_, limits) = found.ok_or_else(|| format!("the scan {scan} has no limits in limits.rs"))?;
    Ok(limits[column(contestant)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::plans;

    #[test]
    fn every_scan_has_limits_and_default_the_smallest() {
        for plan in plans() {
            let limit = |contestant: &Contestant| from_default(plan.id, contestant).expect("limits");
            let default = limit(&Contestant::default_configuration(plan.is_planar()));
            for path in [Path::Kernel(Method::Linear, USUAL), Path::Splat(Drop::Trilinear), Path::AutoSigma] {
                assert!(default <= limit(&Contestant::new(path, DEFAULT_VOXEL_MM)), "{}", plan.id);
            }
        }
        assert!(from_default("none", &Contestant::default_configuration(false)).is_err());
    }
}

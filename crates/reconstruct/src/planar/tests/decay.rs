//! Tests of decay on the planar path: as on the general one, one column at a time.

use glam::DQuat;

use sonoweave_core::slice::Slice;
use volume::Voxels;
use volume::brick_volume::SEEN;

use super::{full, grid_around, reconstructed, refusing, settings, sweep, voxels};
use crate::{Compounding, Decay, PathReconstructor, Reconstructor, Settings, Simd};

const MODES: [Decay; 3] = [
    Decay::Exponential { rate_per_s: 0.7 },
    Decay::DeadTime { rate_per_s: 0.7, wait_s: 1.5 },
    Decay::PaperLiteral { rate_per_s: 0.7, wait_s: 0.25 },
];

/// A planar sweep to and fro at uneven times: in quick succession, after pauses, out of order.
fn slices() -> Vec<Slice> {
    let at_s = [0.0, 0.03, 0.5, 2.0, 1.9, 4.0, 64.0, 64.1, 68.0, 69.7];
    let mut slices = sweep(DQuat::IDENTITY, 0.05, 10);
    for (slice, s) in slices.iter_mut().zip(at_s) {
        slice.time_ns = (s * 1e9) as i64;
    }
    slices
}

fn fading(decay: Decay) -> Settings {
    Settings { compounding: Compounding::Decay(decay), max_weight: 1e6, ..settings() }
}

/// Number of voxels well seen by either volume, and of those whose values differ by more than a
/// hundredth of the range.
fn differing(a: &dyn Voxels, b: &dyn Voxels, settings: &Settings) -> (usize, usize) {
    let (grid, low) = grid_around(a, settings);
    let (mut seen, mut differ) = (0, 0);
    for (_, voxel) in voxels(&grid, low) {
        let ((r0, w0), (r1, w1)) = (a.voxel(voxel), b.voxel(voxel));
        if w0.min(w1) > 10.0 * SEEN {
            seen += 1;
            differ += usize::from((r0 / w0 - r1 / w1).abs() > 2.55);
        }
    }
    (seen, differ)
}

#[test]
fn fading_matches_general_path() {
    for decay in MODES {
        let planar = reconstructed(&fading(decay), refusing(), &full(), &slices());
        let mut general = Reconstructor::new(planar.settings().clone(), full()).unwrap();
        for slice in slices() {
            general.insert(&slice).unwrap();
        }
        assert_eq!(planar.work().times_backwards, general.work().times_backwards);
        let (seen, differ) = differing(planar.volume(), general.volume(), planar.settings());
        // At the edge of a slice's support, columns are accepted here and voxels there.
        assert!(seen > 5000 && differ * 100 < seen, "{decay:?}: {differ} of {seen}");
        // Without decay the volume differs.
        let plain = reconstructed(&settings(), refusing(), &full(), &slices());
        let (_, differ) = differing(planar.volume(), plain.volume(), planar.settings());
        assert!(differ * 10 > seen, "{decay:?}: {differ} of {seen}");
    }
}

#[test]
fn simd_and_threads_give_same_bits() {
    for decay in MODES {
        let run = |simd, threads| {
            let settings = Settings { simd, threads, max_weight: 1.5, ..fading(decay) };
            super::bits(reconstructed(&settings, refusing(), &full(), &slices()).volume())
        };
        let reference = run(Simd::Portable, 1);
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            for threads in [1, 2, 7] {
                assert!(run(simd, threads) == reference, "{decay:?}: {} with {threads} threads", simd.name());
            }
        }
    }
}

#[test]
fn upgrade_keeps_ages() {
    for decay in MODES {
        let slices = slices();
        // Once entirely on the planar path, once with the second half on the general one.
        let planar = reconstructed(&fading(decay), refusing(), &full(), &slices);
        let half = reconstructed(&fading(decay), refusing(), &full(), &slices[..6]);
        let mut upgraded = half.upgraded().unwrap();
        let (seen, differ) = differing(half.volume(), upgraded.volume(), half.settings());
        assert!(seen > 3000 && differ == 0, "{decay:?}: taking over changes no value");
        for slice in &slices[6..] {
            upgraded.insert(slice).unwrap();
        }
        let (seen, differ) = differing(planar.volume(), upgraded.volume(), planar.settings());
        assert!(seen > 5000 && differ * 100 < seen, "{decay:?}: {differ} of {seen}");
    }
}

#[test]
fn columns_dated_only_with_decay() {
    let bytes = |settings: &Settings| {
        let r = reconstructed(settings, refusing(), &full(), &slices());
        r.volume().bytes() as f64 / r.volume().voxels() as f64
    };
    let (plain, dated) = (bytes(&settings()), bytes(&fading(MODES[1])));
    // 8 bytes per column.
    let depth = reconstructed(&settings(), refusing(), &full(), &slices()).volume().depth() as f64;
    assert!((dated - plain - 8.0 / depth).abs() < 0.1, "{dated} {plain}");
    let path_reconstructor = PathReconstructor::planar(fading(MODES[1]), refusing(), full()).unwrap();
    assert_eq!(path_reconstructor.path().name(), "planar");
}

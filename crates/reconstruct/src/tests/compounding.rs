//! Tests of selecting compounding: against the equations, in any order.

use phantom::scene::Blobs;
use volume::Voxels;

use super::super::kernel::AxisKernel;
use super::*;

/// Slices of a freehand scan, every other one with a dark patch, so that the brightest is not
/// the latest.
fn slices() -> Vec<Slice> {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), 8, 6.0, Depth::U8);
    (0..scan.frames()).map(|i| scan.slice(i)).collect()
}

fn reconstructed<'a>(compounding: Compounding, slices: impl IntoIterator<Item = &'a Slice>) -> Reconstructor {
    let mut r = Reconstructor::new(Settings { compounding, ..settings() }, fan()).unwrap();
    for slice in slices {
        r.insert(slice).unwrap();
    }
    r
}

/// Every brick in the order of the lattice, with its bits.
fn ordered_bits(r: &Reconstructor) -> Vec<(BrickIndex, Vec<u32>)> {
    let mut bricks = bits(r.volume());
    bricks.sort_by_key(|(at, _)| *at);
    bricks
}

#[test]
fn selecting_compounding_matches_equations() {
    for compounding in [Compounding::Maximum, Compounding::Latest] {
        let slices = slices();
        let fast = reconstructed(compounding, &slices);
        let (grid, low) = grid_around(fast.volume(), 0.5);
        let kernels: [AxisKernel; 3] = *fast.kernels().unwrap();
        // σ 1 mm: its half width at half maximum exceeds half a voxel.
        assert!((kernels[2].support_mm - 1.177_41).abs() < 1e-5 && kernels[2].weight(1.17) == 1.0);
        let mut slow = Reference::compounding(grid, compounding);
        for slice in &slices {
            slow.insert(slice, &fan(), &kernels);
        }
        let deviation = fast.decimation().unwrap().1;
        let (mut seen, mut differ) = (0, 0);
        for (i, voxel) in voxels(&grid, low) {
            let (r, w) = fast.volume().voxel(voxel);
            if f64::from(w) != slow.w[i] {
                differ += 1;
                continue;
            }
            if w > 0.0 {
                seen += 1;
                // A voxel at the end of a slice's support may fall to either side and then
                // shows another slice.
                differ += i32::from((f64::from(r) - slow.r[i]).abs() > 5.0 * 2.0 * deviation * 255.0);
            }
        }
        assert!(seen > 5000 && differ * 500 < seen, "{compounding:?}: {differ} of {seen}");
    }
}

#[test]
fn arrival_order_irrelevant_for_distinct_times() {
    let slices = slices();
    for compounding in [Compounding::Maximum, Compounding::Latest] {
        let in_order = ordered_bits(&reconstructed(compounding, &slices));
        assert!(
            ordered_bits(&reconstructed(compounding, slices.iter().rev())) == in_order,
            "{compounding:?}: backwards"
        );
        let shuffled = [3, 0, 7, 2, 6, 1, 5, 4].map(|i| &slices[i]);
        assert!(ordered_bits(&reconstructed(compounding, shuffled)) == in_order, "{compounding:?}: shuffled");
    }
    // Among slices at one time the last to arrive is kept.
    let mut tied = slices.clone();
    tied.iter_mut().for_each(|s| s.time_ns = -7);
    let kept = ordered_bits(&reconstructed(Compounding::Latest, &tied));
    assert!(kept == ordered_bits(&reconstructed(Compounding::Latest, &slices)));
    assert!(kept != ordered_bits(&reconstructed(Compounding::Latest, tied.iter().rev())));
}

#[test]
fn maximum_touches_only_raised_voxels() {
    let grey = |value| scan(Scene::Constant(value), 1, 0.0, Depth::U8).slice(0);
    let mut r = reconstructed(Compounding::Maximum, [&grey(100.0)]);
    let before = bits(r.volume());
    let dark = r.insert(&grey(99.0)).unwrap();
    assert_eq!((dark.voxels, dark.bricks.len()), (0, 0));
    assert!(bits(r.volume()) == before);
    let bright = r.insert(&grey(101.0)).unwrap();
    assert_eq!(bright.bricks.len(), r.volume().len());
    for (_, brick) in r.volume().iter() {
        assert!(brick.r.iter().zip(&brick.w).all(|(r, w)| (*r, *w) == (101.0, 1.0) || (*r, *w) == (0.0, 0.0)));
    }
}

#[test]
fn times_out_of_range_refused_without_change() {
    let slices = slices();
    let mut r = reconstructed(Compounding::Latest, &slices[..2]);
    let before = bits(r.volume());
    let far = Slice { time_ns: slices[0].time_ns + 60 * 3_600_000_000_000, ..slices[2].clone() };
    assert_eq!(r.insert(&far), Err(Refused::OutOfTime));
    assert!(bits(r.volume()) == before);
    assert!(r.insert(&slices[2]).is_ok());
    assert!(r.volume().bytes() >= 12 * 512 * r.volume().len() as u64, "times are counted as memory");
}

#[test]
fn selected_slice_has_no_gap_with_coarse_voxels() {
    let scan = scan(Scene::Constant(50.0), 1, 0.0, Depth::U8);
    let settings = Settings {
        compounding: Compounding::Maximum,
        sigma_mm: [Some(0.5), Some(0.5), Some(0.1)],
        ..Settings::new(DVec3::splat(1.0))
    };
    let mut r = Reconstructor::new(settings, Mask::full(72, 60)).unwrap();
    r.insert(&scan.slice(0)).unwrap();
    // 18 × 15 mm of image: at least one voxel in each column through it.
    let columns: std::collections::BTreeSet<_> =
        values(&r, |p| p.x.abs() < 7.0 && p.y.abs() < 5.0).into_iter().map(|(p, _)| [p.x as i64, p.y as i64]).collect();
    assert_eq!(columns.len(), 13 * 9);
}

//! Tests of weights of whole slices: sums, bits, parts, and refusals.

mod shadows;

use phantom::scene::Blobs;
use volume::brick::BrickBox;

use super::*;
use crate::{Decay, GapWeights};

fn slices() -> Vec<Slice> {
    scan(Scene::Blobs(Blobs::draw(3)), 16, 6.0, Depth::U8).slices(0..16)
}

fn weighted(settings: Settings, weight: impl Fn(usize) -> f32) -> Reconstructor {
    let mut r = Reconstructor::new(settings, fan()).unwrap();
    for (i, slice) in slices().iter().enumerate() {
        r.insert_weighted(slice, weight(i)).unwrap();
    }
    r
}

fn sums(r: &Reconstructor) -> Vec<([i64; 3], f32, f32)> {
    let (grid, low) = grid_around(r.volume(), 0.5);
    let of = |(_, at)| {
        let (r, w) = r.volume().voxel(at);
        (at, r, w)
    };
    voxels(&grid, low).map(of).collect()
}

#[test]
fn weights_multiply_all_sums() {
    let [whole, half] = [1.0, 0.5].map(|weight| weighted(settings(), |_| weight));
    for ((at, r, w), (_, half_r, half_w)) in sums(&whole).into_iter().zip(sums(&half)) {
        // A power of two changes no digit, but of the smallest numbers.
        assert!(half_w * 2.0 == w && (half_r * 2.0 - r).abs() <= 1e-30, "{at:?}: {r} {half_r}");
    }
    let slices = slices();
    let unlike = weighted(settings(), |i| if i % 2 == 0 { 1.75 } else { 0.25 });
    let (grid, low) = grid_around(unlike.volume(), 0.5);
    let mut expected = vec![[0.0; 2]; voxels(&grid, low).count()];
    for (i, slice) in slices.iter().enumerate() {
        let mut alone = Reconstructor::new(settings(), fan()).unwrap();
        alone.insert(slice).unwrap();
        for (sum, (_, at)) in expected.iter_mut().zip(voxels(&grid, low)) {
            let (r, w) = alone.volume().voxel(at);
            let weight = if i % 2 == 0 { 1.75 } else { 0.25 };
            *sum = [sum[0] + weight * f64::from(r), sum[1] + weight * f64::from(w)];
        }
    }
    let mut compared = 0;
    for (expected, (at, r, w)) in expected.into_iter().zip(sums(&unlike)) {
        compared += usize::from(w > SEEN);
        for (expected, found) in expected.into_iter().zip([r, w]) {
            assert!((f64::from(found) - expected).abs() <= 1e-5 * expected.abs() + 1e-6, "{at:?}: {found} {expected}");
        }
    }
    assert!(compared > 1000, "{compared}");
}

#[test]
fn weighted_slices_have_same_bits_in_parts_and_by_any_threads() {
    let decay = Compounding::Decay(Decay::Exponential { rate_per_s: 0.7 });
    for compounding in [Compounding::Mean, decay] {
        let weight = |i: usize| 0.3 + 0.1 * i as f32;
        let settings = Settings { compounding, ..settings() };
        let whole = weighted(settings.clone(), weight);
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
            let other = weighted(Settings { simd, threads: 2, ..settings.clone() }, weight);
            assert!(bits(other.volume()) == bits(whole.volume()), "{compounding}, {simd:?}");
        }
        let mut planner =
            Reconstructor::new(Settings { region: Some(BrickBox::EMPTY), ..settings.clone() }, fan()).unwrap();
        let mut part = Reconstructor::new(settings, fan()).unwrap();
        for (i, slice) in slices().iter().enumerate() {
            planner.insert_weighted(slice, weight(i)).unwrap();
            part.insert_decided(slice, &planner.last().unwrap().decision).unwrap();
        }
        assert!(bits(part.volume()) == bits(whole.volume()), "{compounding}");
    }
}

#[test]
fn weights_by_gaps_are_refused_where_one_slice_is_selected() {
    for compounding in [Compounding::Maximum, Compounding::Latest] {
        let settings = Settings { gap_weights: true, compounding, ..settings() };
        let error = Reconstructor::new(settings, fan()).err().unwrap();
        assert!(error.to_string().contains(compounding.name()), "{error}");
    }
    let settings = Settings { gap_weights: true, ..settings() };
    assert_eq!(settings.beyond_planar().as_deref(), Some("gap weights"));
    assert!(Settings { gap_weights: false, ..settings.clone() }.weights_by_gaps().is_none());
    // By default σ across the plane is 1 mm.
    let (mut own, mut of_1_mm) = (settings.weights_by_gaps().unwrap(), GapWeights::new(1.0));
    for slice in slices() {
        let next = |gaps: &mut GapWeights| gaps.next(slice.world_from_image, [72, 60]);
        assert_eq!(next(&mut own), next(&mut of_1_mm));
    }
}

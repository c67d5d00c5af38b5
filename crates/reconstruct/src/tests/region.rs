//! Tests of reconstruction in parts of the lattice, each from the slices that meet it: the same
//! bits and the same work as the whole, whatever depends on the slices before.

use phantom::scene::Blobs;
use volume::Voxels;
use volume::brick::{BrickBox, VOXELS};

use super::*;
use crate::{Decay, Entered, RepeatError, Work};

const COMPOUNDINGS: [Compounding; 6] = [
    Compounding::Mean,
    Compounding::Maximum,
    Compounding::Latest,
    Compounding::Decay(Decay::Exponential { rate_per_s: 0.7 }),
    Compounding::Decay(Decay::DeadTime { rate_per_s: 0.7, wait_s: 0.2 }),
    Compounding::Decay(Decay::PaperLiteral { rate_per_s: 0.7, wait_s: 0.1 }),
];
/// Cuts along x, y and z into 1, 2, 3, 8 and 27 parts.
const CUTS: [[i32; 3]; 5] = [[1, 1, 1], [2, 1, 1], [1, 1, 3], [2, 2, 2], [3, 3, 3]];

/// A sweep to and fro, ten slices a second.
fn sweep() -> Vec<Slice> {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), 24, 6.0, Depth::U8);
    let order = (0..24).chain([5, 20, 11]);
    (0..).zip(order).map(|(at, i)| Slice { time_ns: at * 100_000_000, ..scan.slice(i) }).collect()
}

/// Another sweep across the first.
fn crossing() -> Vec<Slice> {
    let turn = DAffine3::from_rotation_y(1.2);
    let across = sweep().into_iter().step_by(2).map(|slice| {
        let pose = Transform::from_affine(turn * slice.world_from_image.affine());
        Slice { world_from_image: pose, time_ns: slice.time_ns + 3_000_000_000, ..slice }
    });
    sweep().into_iter().chain(across).collect()
}

/// Slices at the two ends in turn, each repeated at once, too; some cannot be used.
fn turns() -> Vec<Slice> {
    let slices = sweep();
    let [first, last] = [&slices[0], &slices[23]];
    let small = Image::new(2, 2, Pixels::U8(Arc::from([0; 4])));
    let mut turns: Vec<Slice> = (0..4).flat_map(|_| [first, first, last, last]).cloned().collect();
    turns.insert(5, Slice { image: small, ..first.clone() });
    turns.insert(9, Slice { world_from_image: Transform::from_affine(DAffine3::ZERO), ..first.clone() });
    (0..).zip(&mut turns).for_each(|(at, slice)| slice.time_ns = at * 50_000_000);
    turns
}

/// Slices whose pixel size grows by a fraction from each to the next.
fn drifting(fraction: f64) -> Vec<Slice> {
    let scaled = |(i, slice): (i32, Slice)| {
        let scale = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0).map(|x| x * fraction + 1.0).powf(f64::from(i)));
        let pose = slice.world_from_image.affine();
        Slice { world_from_image: Transform::from_affine(pose * scale), ..slice }
    };
    (0..).zip(sweep()).map(scaled).collect()
}

/// Times that run backwards, by less and by more than a clock's correction.
fn backwards() -> Vec<Slice> {
    let mut slices = sweep();
    slices[7].time_ns -= 1_500_000_000;
    slices[12].time_ns -= 30_000_000_000;
    slices[18].time_ns += 90_000_000_000;
    slices
}

fn reconstructor(compounding: Compounding, max_weight: f64, region: Option<BrickBox>) -> Reconstructor {
    Reconstructor::new(Settings { compounding, max_weight, region, ..settings() }, fan()).unwrap()
}

/// The slices that enter, by their places, with what is needed to insert them elsewhere.
fn entered(r: &mut Reconstructor, slices: &[Slice]) -> Vec<(usize, Entered)> {
    let insert = |(at, slice)| r.insert(slice).is_ok().then(|| (at, r.last().unwrap()));
    slices.iter().enumerate().filter_map(insert).collect()
}

/// Cuts the box around all bricks into parts.
fn parts(volume: &BrickVolume, cuts: [i32; 3]) -> Vec<BrickBox> {
    let ends = |end: fn(i32, i32) -> i32| {
        volume.blocks().reduce(|a, b| [0, 1, 2].map(|i| end(a[i], b[i]))).expect("something was inserted")
    };
    let (low, high) = (ends(i32::min), ends(i32::max));
    let cut = |a: usize, i: i32| low[a] + (high[a] + 1 - low[a]) * i / cuts[a];
    let [nx, ny, nz] = cuts;
    let places = (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
    let part = |at: [i32; 3]| BrickBox {
        low: [0, 1, 2].map(|a| cut(a, at[a])),
        high: [0, 1, 2].map(|a| cut(a, at[a] + 1) - 1),
    };
    places.map(part).collect()
}

/// Sums and what a reader gets, of every brick.
type Content = Vec<(BrickIndex, Vec<u32>, Vec<u32>)>;

fn content(volume: &BrickVolume) -> Content {
    let read = |at: BrickIndex| {
        let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
        volume.block(at, &mut r, &mut w);
        r.iter().chain(&w).map(|x| x.to_bits()).collect()
    };
    bits(volume).into_iter().map(|(at, sums)| (at, sums, read(at))).collect()
}

/// Reconstructs in parts and as a whole, and compares. Returns the slices left out of a part,
/// over all parts.
fn compare(name: &str, slices: &[Slice], compounding: Compounding, max_weight: f64) -> u64 {
    let mut whole = reconstructor(compounding, max_weight, None);
    let of_whole = entered(&mut whole, slices);
    let mut planner = reconstructor(compounding, max_weight, Some(BrickBox::EMPTY));
    assert_eq!(entered(&mut planner, slices), of_whole, "{name}, {compounding}: the plan");
    assert_eq!(planner.work(), Work { slices: whole.work().slices, ..clocks(&whole) }, "a plan inserts nothing");
    assert!(planner.volume().is_empty());
    let mut expected = content(whole.volume());
    expected.sort();
    let mut left_out = 0;
    for cuts in CUTS {
        let (mut found, mut work) = (Content::new(), clocks(&whole));
        work.slices = whole.work().slices;
        let mut inserted = 0;
        for region in parts(whole.volume(), cuts) {
            let mut part = reconstructor(compounding, max_weight, Some(region));
            for (at, Entered { decision, bricks }) in &of_whole {
                if bricks.within(&region).is_empty() {
                    left_out += 1;
                } else {
                    part.insert_decided(&slices[*at], decision).unwrap();
                    inserted += 1;
                }
            }
            found.extend(content(part.volume()));
            let of_part = part.work();
            work.bricks_touched += of_part.bricks_touched;
            work.bricks_considered += of_part.bricks_considered;
            work.voxels_updated += of_part.voxels_updated;
            work.voxels_sampled += of_part.voxels_sampled;
            work.weights_clamped += of_part.weights_clamped;
            work.filter.pixels += of_part.filter.pixels;
        }
        found.sort();
        assert!(found == expected, "{name}, {compounding}, {cuts:?}: other bits");
        // A slice is filtered once for each part that it meets.
        let whole = whole.work();
        assert_eq!(work.filter.pixels * whole.slices, whole.filter.pixels * inserted, "{name}, {cuts:?}");
        // The whole also considers bricks that nothing changes, outside all parts.
        assert!(work.bricks_considered <= whole.bricks_considered, "{name}, {compounding}, {cuts:?}");
        (work.filter, work.bricks_considered) = (whole.filter, whole.bricks_considered);
        assert_eq!(work, whole, "{name}, {compounding}, {cuts:?}");
    }
    left_out
}

/// The work of a reconstruction that depends on times alone.
fn clocks(r: &Reconstructor) -> Work {
    let Work { times_backwards, times_absurd, .. } = r.work();
    Work { times_backwards, times_absurd, ..Work::default() }
}

#[test]
fn parts_have_bits_and_work_of_whole() {
    for compounding in COMPOUNDINGS {
        for (name, slices) in [("freehand", sweep()), ("crossing", crossing()), ("backwards", backwards())] {
            assert!(compare(name, &slices, compounding, 256.0) > 20, "{name}: no slice is left out of a part");
        }
    }
}

#[test]
fn repeats_admitted_by_whole_enter_each_part() {
    for compounding in COMPOUNDINGS {
        let slices = turns();
        let entered = entered(&mut reconstructor(compounding, 256.0, None), &slices).len();
        assert_eq!(entered, 8, "repeats and unusable slices are refused");
        compare("turns", &slices, compounding, 256.0);
    }
}

#[test]
fn kernels_in_force_are_those_of_whole() {
    for fraction in [4e-4, 1e-9] {
        for compounding in [Compounding::Mean, Compounding::Latest] {
            compare("drifting", &drifting(fraction), compounding, 256.0);
        }
    }
    let mut r = reconstructor(Compounding::Mean, 256.0, None);
    let slices = drifting(4e-4);
    let sizes: Vec<[u64; 2]> =
        entered(&mut r, &slices).iter().map(|(_, entered)| entered.decision.pixel_mm.map(f64::to_bits)).collect();
    let changes = sizes.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!((5..=15).contains(&changes), "kernels stay for two slices or so, and changed {changes} times");
}

#[test]
fn clamped_weights_are_those_of_whole() {
    for compounding in COMPOUNDINGS {
        compare("clamped", &crossing(), compounding, 3.0);
    }
    let mut r = reconstructor(Compounding::Mean, 3.0, None);
    entered(&mut r, &crossing());
    assert!(r.work().weights_clamped > 1000, "{}", r.work().weights_clamped);
}

#[test]
fn decision_of_other_kernels_is_refused() {
    let slices = sweep();
    let mut whole = reconstructor(Compounding::Mean, 256.0, None);
    let decided = entered(&mut whole, &slices);
    let (at, Entered { mut decision, .. }) = decided[0];
    let slice = &slices[at];
    decision.kernels ^= 1;
    let mut part = reconstructor(Compounding::Mean, 256.0, None);
    assert_eq!(part.insert_decided(slice, &decision), Err(RepeatError::OtherKernels));
    assert!(part.volume().is_empty() && part.work() == Work::default());
    // Other settings have other kernels.
    let other = Settings { sigma_mm: [None, None, Some(1.01)], ..settings() };
    let mut other = Reconstructor::new(other, fan()).unwrap();
    assert_eq!(other.insert_decided(slice, &decided[0].1.decision), Err(RepeatError::OtherKernels));
}

#[test]
fn planar_path_refuses_part_of_volume() {
    let settings = Settings { region: Some(BrickBox::EMPTY), ..settings() };
    assert_eq!(settings.beyond_planar().as_deref(), Some("a part of the volume"));
}

#[test]
fn copy_continues_with_same_bits_and_leaves_original() {
    for compounding in COMPOUNDINGS {
        let slices = crossing();
        let (before, after) = slices.split_at(20);
        let mut whole = reconstructor(compounding, 256.0, None);
        entered(&mut whole, before);
        let at_copy = content(whole.volume());
        let mut copy = whole.copy().unwrap();
        entered(&mut copy, after);
        assert_eq!(content(whole.volume()), at_copy, "{compounding}: the original has changed");
        entered(&mut whole, after);
        assert_eq!(content(copy.volume()), content(whole.volume()), "{compounding}");
        assert_eq!(copy.work(), whole.work(), "{compounding}");
    }
}

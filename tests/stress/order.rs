//! Tests of properties that may not matter: the order of the slices, the number of threads, the
//! instruction set.

use mask::Mask;
use reconstruct::{Settings, Simd};
use sonoweave_core::region::Fan;
use sonoweave_core::slice::Slice;
use volume::Voxels;

use crate::figures::{Length, Sheet, Test};
use crate::insertion::{Probe, half_mm, noise, reconstruct_all, state, turned, weighted};

pub(crate) fn tests(length: Length) -> Vec<Test> {
    let slices = length.of(24, 200);
    vec![
        Test::new(
            "04",
            format!("{slices} slices in any order: r and w within 4·n·2⁻²⁴; in the same order: the same bits"),
            permutations,
        ),
        Test::new("05", "1, 2 and 7 threads: the same bits, the same bricks in the same order", threads),
        Test::new("06", "every instruction set: the same bits", instructions),
    ]
}

fn noisy(count: u32) -> (Vec<Slice>, Mask) {
    let probe = Probe::oblique([40, 32], 0.3);
    let slices = (0..count).map(|i| probe.put(&noise(probe.size, i), 0.25 * f64::from(i % 24))).collect();
    (slices, probe.mask())
}

fn permutations(sheet: &mut Sheet) {
    let count = sheet.length.of(24, 200);
    let (slices, mask) = noisy(count);
    // No weight comes near the clamp, which is a moving average and not a sum.
    let settings = Settings { max_weight: 1e6, ..half_mm() };
    let first = reconstruct_all(settings.clone(), &mask, &slices);
    let again = reconstruct_all(settings.clone(), &mask, &slices);
    sheet.equal("bits of the same order", state(again.volume()), state(first.volume()));
    let n = slices.len();
    let orders: [Vec<usize>; 3] = [
        (0..n).rev().collect(),
        (0..n).map(|i| (i * 7 + 3) % n).collect(),
        (0..n).filter(|i| i % 2 == 0).chain((0..n).filter(|i| i % 2 == 1)).collect(),
    ];
    let (mut worst_r, mut worst_w, mut compared) = (0.0_f64, 0.0_f64, 0);
    for order in &orders {
        assert_eq!(order.iter().collect::<std::collections::BTreeSet<_>>().len(), n, "a permutation");
        let other = reconstruct_all(settings.clone(), &mask, order.iter().map(|i| &slices[*i]));
        for voxel in weighted(&first) {
            let [(r0, w0), (r1, w1)] = [&first, &other].map(|r| r.volume().voxel(voxel.index));
            // The measure for r is the sum of magnitudes; the images hold nothing below 0.
            let relative = |a: f32, b: f32| f64::from((a - b).abs()) / f64::from(a.abs()).max(1e-3);
            worst_r = worst_r.max(relative(r0, r1) * f64::from(u8::from(w0 > 0.01)));
            worst_w = worst_w.max(relative(w0, w1));
            compared += 1;
        }
    }
    let bound = 4.0 * f64::from(count) * 2.0_f64.powi(-24);
    sheet.above("voxels compared", f64::from(compared), 10_000.0);
    sheet.at_most("numerators, relative difference", worst_r, bound);
    sheet.at_most("weights, relative difference", worst_w, bound);
}

/// Everything that could depend on the threads: a fan, clamped weights, bricks that share
/// borders.
fn outcome(simd: Simd, threads: usize) -> (u64, Vec<reconstruct::Touched>, reconstruct::Work) {
    let fan = Mask::fan(72, 60, &Fan::new([36.0, -20.0], [25.0, 76.0], [-25.0, 25.0]).unwrap());
    let settings = Settings { simd, threads, max_weight: 1.5, ..half_mm() };
    let mut r = reconstruct::Reconstructor::new(settings, fan).unwrap();
    let touched = (0..10)
        .map(|i| {
            let tilt = 0.05 * f64::from(i);
            let probe = Probe { axes: turned(0.3 + tilt, 0.5 - tilt, tilt), ..Probe::straight([72, 60], 0.25) };
            r.insert(&probe.put(&noise([72, 60], i), 0.4 * f64::from(i))).unwrap()
        })
        .collect();
    (state(r.volume()), touched, r.work())
}

fn threads(sheet: &mut Sheet) {
    let alone = outcome(Simd::detect(), 1);
    sheet.above("weights clamped", alone.2.weights_clamped as f64, 0.0);
    for threads in [2, 7] {
        sheet.holds(
            &format!("{threads} threads: bits, bricks and work of one"),
            outcome(Simd::detect(), threads) == alone,
        );
    }
}

/// Whether insertion by this instruction set gives the bits of the portable one.
pub(crate) fn has_bits_of_portable(simd: Simd) -> bool {
    outcome(simd, 1) == outcome(Simd::Portable, 1)
}

fn instructions(sheet: &mut Sheet) {
    for simd in Simd::ALL {
        if simd.is_available() {
            sheet.holds(&format!("{}: bits of portable", simd.name()), has_bits_of_portable(simd));
        } else {
            sheet.record(simd.name(), "this machine lacks it");
        }
    }
}

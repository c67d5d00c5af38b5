//! Tests of compounding that selects one slice per voxel: the brightest, or the latest.

use mask::Mask;
use reconstruct::{Compounding, Reconstructor, Refused, Settings, Simd, Touched, Work};
use sonoweave_core::region::Fan;
use sonoweave_core::slice::Slice;
use volume::Voxels;
use volume::brick_volume::SEEN;

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, constant, content, half_mm, held, noise, state, turned};

const BOTH: [Compounding; 2] = [Compounding::Maximum, Compounding::Latest];

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("04", "maximum and latest, slices in any order: the same bits", orders),
        Test::new("05", "maximum and latest, 1, 2 and 7 threads: the same bits and work", threads),
        Test::new("06", "maximum and latest, every instruction set: the same bits", instructions),
        Test::new("12", "maximum and latest, a kernel far narrower than the voxel: no gap in the picture", narrow),
        Test::new("18", "maximum and latest, a constant in a fan: the constant to a rounding, up to the border", fan),
        Test::new(
            "18",
            "maximum is never darker, latest is the last: pictures whose brightness falls and rises",
            values,
        ),
        Test::new(
            "22",
            "latest: times alike, backwards, before the first, at epoch scale; out of reach refused",
            times,
        ),
    ]
}

fn settings(compounding: Compounding) -> Settings {
    Settings { compounding, ..half_mm() }
}

fn sector() -> Mask {
    Mask::fan(72, 60, &Fan::new([36.0, -20.0], [25.0, 76.0], [-25.0, 25.0]).unwrap())
}

/// Intersecting slices, a thirtieth of a second apart.
fn slices() -> Vec<Slice> {
    (0..12_u32)
        .map(|i| {
            let tilt = 0.05 * f64::from(i);
            let probe = Probe { axes: turned(0.3 + tilt, 0.5 - tilt, tilt), ..Probe::straight([72, 60], 0.25) };
            let slice = probe.put(&noise([72, 60], i), 0.3 * f64::from(i % 5));
            Slice { time_ns: i64::from(i) * 33_333_333, ..slice }
        })
        .collect()
}

fn reconstructed<'a>(settings: Settings, slices: impl IntoIterator<Item = &'a Slice>) -> Reconstructor {
    let mut r = Reconstructor::new(settings, sector()).unwrap();
    slices.into_iter().for_each(|slice| drop(r.insert(slice).unwrap()));
    r
}

fn orders(sheet: &mut Sheet) {
    let slices = slices();
    let n = slices.len();
    let orders: [Vec<usize>; 3] = [
        (0..n).rev().collect(),
        (0..n).map(|i| (i * 7 + 3) % n).collect(),
        (0..n).filter(|i| i % 2 == 1).chain((0..n).filter(|i| i % 2 == 0)).collect(),
    ];
    for compounding in BOTH {
        for method in METHODS {
            let settings = Settings { method, ..settings(compounding) };
            let first = content(reconstructed(settings.clone(), &slices).volume());
            for (k, order) in orders.iter().enumerate() {
                let other = content(reconstructed(settings.clone(), order.iter().map(|i| &slices[*i])).volume());
                let what = format!("{}, {}, permutation {k}: bits", compounding.name(), method.name());
                sheet.holds(&what, other == first);
            }
        }
    }
}

fn outcome(compounding: Compounding, simd: Simd, threads: usize) -> (u64, Vec<Touched>, Work) {
    let mut r = Reconstructor::new(Settings { simd, threads, ..settings(compounding) }, sector()).unwrap();
    let touched = slices().iter().map(|slice| r.insert(slice).unwrap()).collect();
    (state(r.volume()), touched, r.work())
}

fn threads(sheet: &mut Sheet) {
    for compounding in BOTH {
        let alone = outcome(compounding, Simd::detect(), 1);
        for threads in [2, 7] {
            let same = outcome(compounding, Simd::detect(), threads) == alone;
            sheet.holds(&format!("{}, {threads} threads: bits, bricks and work of one", compounding.name()), same);
        }
    }
}

fn instructions(sheet: &mut Sheet) {
    for compounding in BOTH {
        let portable = outcome(compounding, Simd::Portable, 1);
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
            let same = outcome(compounding, simd, 1) == portable;
            sheet.holds(&format!("{}, {}: bits of portable", compounding.name(), simd.name()), same);
        }
    }
}

/// A slice between two planes of voxels: it must reach half a voxel, and at most one plane on
/// either side.
fn narrow(sheet: &mut Sheet) {
    for compounding in BOTH {
        for along in [0.0, 0.1, 0.25, 0.4] {
            let probe = Probe::straight([41, 41], 0.25);
            let narrow = Settings { sigma_mm: [None, None, Some(0.01)], ..settings(compounding) };
            let mut r = Reconstructor::new(narrow, probe.mask()).unwrap();
            r.insert(&probe.put(&noise(probe.size, 3), along)).unwrap();
            let voxels = held(r.volume());
            let inside = voxels.iter().filter(|(i, _, _)| i[0].abs() <= 9 && i[1].abs() <= 9);
            let lines: std::collections::BTreeSet<_> = inside.map(|(i, _, _)| [i[0], i[1]]).collect();
            let what = format!("{}, {along} mm from a plane of voxels", compounding.name());
            sheet.equal(&format!("{what}: lines of voxels across it, of 19²"), lines.len(), 361);
            let farthest = voxels.iter().map(|(i, _, _)| (0.5 * i[2] as f64 - along).abs()).fold(0.0, f64::max);
            sheet.at_most(&format!("{what}: distance of the farthest voxel, mm"), farthest, 0.2501);
        }
    }
}

fn fan(sheet: &mut Sheet) {
    let inside = sector();
    for compounding in BOTH {
        for method in METHODS {
            let mut r = Reconstructor::new(Settings { method, ..settings(compounding) }, sector()).unwrap();
            let probe = Probe::oblique([72, 60], 0.25);
            for i in 0..6_u8 {
                let outside = f32::from(i) * 1e6;
                let picture =
                    crate::insertion::image([72, 60], |u, v| if inside.contains(u, v) { 77.3 } else { outside });
                r.insert(&probe.put(&picture, 0.3 * f64::from(i))).unwrap();
            }
            let voxels = held(r.volume());
            let off = voxels.iter().map(|(_, r, _)| (r / 77.3 - 1.0).abs()).fold(0.0, f32::max);
            let what = format!("{}, {}", compounding.name(), method.name());
            sheet.above(&format!("{what}: voxels seen"), voxels.len() as f64, 4_000.0);
            sheet.at_most(&format!("{what}: largest difference in 2⁻²³"), f64::from(off / f32::EPSILON), 4.0);
            sheet.holds(&format!("{what}: every weight is 1"), voxels.iter().all(|(_, _, w)| *w == 1.0 && *w > SEEN));
        }
    }
}

fn values(sheet: &mut Sheet) {
    let probe = Probe::straight([21, 21], 0.5);
    let greys = [100.0_f32, 60.0, 140.0, 20.0, 90.0];
    for (compounding, expected) in
        [(Compounding::Maximum, [100.0, 100.0, 140.0, 140.0, 140.0]), (Compounding::Latest, greys)]
    {
        let mut r = Reconstructor::new(settings(compounding), probe.mask()).unwrap();
        for ((grey, expected), i) in greys.into_iter().zip(expected).zip(0_i64..) {
            let slice = probe.put(&constant(probe.size, grey), 0.0);
            r.insert(&Slice { time_ns: i * 1_000_000, ..slice }).unwrap();
            let all = held(r.volume());
            let wrong = all.iter().filter(|(_, r, w)| (*r, *w) != (expected, 1.0)).count();
            let what = format!("{}, slice {i}: voxels of {} that are not {expected}", compounding.name(), all.len());
            sheet.equal(&what, wrong, 0);
        }
    }
}

fn times(sheet: &mut Sheet) {
    let second = 1_000_000_000_i64;
    let hour = 3600 * second;
    let epoch = 1_763_700_000 * second;
    let probe = Probe::straight([21, 21], 0.5);
    let put = |k: usize, time_ns: i64| {
        let slice = probe.put(&constant(probe.size, k as f32 + 1.0), 1e-9 * (k % 7) as f64);
        Slice { time_ns, ..slice }
    };
    let shown = |r: &Reconstructor| r.volume().voxel([0; 3]).0;
    for first in [0, epoch, -epoch] {
        // Times after the first, and the image shown after each: that of the latest time, among
        // equal times the last.
        let steps: [(i64, f32); 8] = [
            (0, 1.0),
            (-second, 1.0),
            (-59 * hour, 1.0),
            (0, 4.0),
            (second, 5.0),
            (second / 2, 5.0),
            (59 * hour, 7.0),
            (58 * hour, 7.0),
        ];
        let mut r = Reconstructor::new(settings(Compounding::Latest), probe.mask()).unwrap();
        for (k, (after, expected)) in steps.into_iter().enumerate() {
            let result = r.insert(&put(k, first + after));
            let what = format!("first at {first} ns, {after} ns after it");
            sheet.holds(&format!("{what}: enters"), result.is_ok());
            sheet.equal(&format!("{what}: picture shown"), shown(&r), expected);
        }
        let before = state(r.volume());
        for after in [60 * hour, -60 * hour] {
            let result = r.insert(&put(99, first + after));
            sheet.equal(&format!("first at {first} ns, {after} ns after it"), result.err(), Some(Refused::OutOfTime));
            sheet.equal("state after it", state(r.volume()), before);
        }
        // For the decay's clock, a time far behind is a clock set back, after which 0 h is
        // ahead again.
        sheet.equal("counted as backwards", r.work().times_backwards, 4);
    }
    // The order of a hundred frames at 30 Hz is that of their stamps, in any order of arrival.
    let mut r = Reconstructor::new(settings(Compounding::Latest), probe.mask()).unwrap();
    for k in (0..100).map(|i| (i * 37 + 50) % 100) {
        r.insert(&put(k, epoch + k as i64 * 33_333_333)).unwrap();
    }
    sheet.equal("picture shown of a hundred, shuffled", shown(&r), 100.0);
}

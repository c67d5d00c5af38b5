//! Tests of the planar path against the equations, the general path, and itself.

use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};

use mask::Mask;
use reconstruct::kernel::{Method, Support};
use reconstruct::planar::{OnDeparture, PlanarReconstructor, PlanarSettings, reference as equations};
use reconstruct::reference::Reference;
use reconstruct::{Path, PathReconstructor, Reconstructor, Settings, Simd, Touched, Work};
use sonoweave_core::frames::Transform;
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::Slice;
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use crate::figures::{Length, Sheet, Test};
use crate::insertion::{Probe, WIDE, constant, content, half_mm, held, noise, posed, reconstructor};

pub(crate) const SIZE: [u32; 2] = [44, 36];

pub(crate) fn tests(length: Length) -> Vec<Test> {
    let slices = length.of("2·10⁴", "10⁶");
    let ordered = length.of(24, 200);
    vec![
        Test::new(
            "01",
            format!("planar, {slices} slices of a constant, default W_max: |r/w − c| ≤ 1e-5 c"),
            clamped_constant,
        ),
        Test::new("03", "planar, dwell on a step: 99 % after 4.6 W_max/g frames", step),
        Test::new(
            "04",
            format!("planar, {ordered} slices in any order: within 4·n·2⁻²⁴; in the same order: the same bits"),
            permutations,
        ),
        Test::new("05", "planar, 1, 2 and 7 threads: the same bits and work", threads),
        Test::new("06", "planar, every instruction set: the same bits", instructions),
        Test::new(
            "13",
            "planar, slab that ends on planes of columns: the planes are in, for every instruction set",
            ends_on_planes,
        ),
        Test::new("16", "planar, world 1e3 and 1e6 mm away: the origin's values within 1e-6", far_away),
        Test::new("18", "planar, a constant is constant up to the border: within 4·2⁻²³ c", border),
        Test::new(
            "29",
            "planar path and separable f64 sums: within 1e-5 of the range, every kernel, any arm",
            brute_force,
        ),
        Test::new(
            "29",
            "2D weights and 3D weights: alike within the deviation that the general path states",
            both_paths,
        ),
    ]
}

/// An arm's sweep that shifts and turns, in a world turned by `base`.
pub(crate) fn sweep(base: DQuat, count: u32) -> Vec<Slice> {
    (0..count)
        .map(|i| {
            let at = f64::from(i % 24);
            let turn = DMat3::from_rotation_z(0.03 * at);
            let arm = Probe::arm(SIZE, 0.4);
            let centre = DVec3::new(1.3 + 0.11 * at, 0.31 * at, 0.13);
            let pose = Probe { axes: turn * arm.axes, centre, ..arm }.pose(0.0);
            posed(&noise(SIZE, i), DAffine3::from_quat(base) * pose)
        })
        .collect()
}

pub(crate) fn settings() -> Settings {
    Settings { sigma_mm: [None, None, Some(0.8)], ..half_mm() }
}

pub(crate) fn refusing() -> PlanarSettings {
    PlanarSettings { on_departure: OnDeparture::Refuse, ..PlanarSettings::default() }
}

pub(crate) fn full() -> Mask {
    Mask::full(SIZE[0], SIZE[1])
}

pub(crate) fn reconstructed<'a>(
    settings: Settings,
    mask: Mask,
    slices: impl IntoIterator<Item = &'a Slice>,
) -> PlanarReconstructor {
    let mut r = PlanarReconstructor::new(settings, refusing(), mask).unwrap();
    for slice in slices {
        r.insert(slice).unwrap();
    }
    r
}

pub(crate) fn moved(slice: &Slice, by: DAffine3) -> Slice {
    Slice { world_from_image: Transform::from_affine(by * slice.world_from_image.affine()), ..slice.clone() }
}

/// Returns the largest |r/w − c| / c of seen voxels, and their number.
fn off_constant(volume: &dyn Voxels, c: f32) -> (f64, usize) {
    let seen: Vec<f64> = held(volume)
        .into_iter()
        .filter(|(_, _, w)| *w > SEEN)
        .map(|(_, r, w)| (f64::from(r) / f64::from(w) / f64::from(c) - 1.0).abs())
        .collect();
    (seen.iter().copied().fold(0.0, f64::max), seen.len())
}

fn clamped_constant(sheet: &mut Sheet) {
    let probe = Probe::arm([6, 6], 0.5);
    let picture = constant(probe.size, 77.3);
    let mut r = reconstructor(Path::Planar, half_mm(), probe.mask());
    for i in 0..sheet.length.of(20_000_u32, 1_000_000) {
        // Trembling of the hand: no two weights of a column are alike.
        let x = f64::from(i.wrapping_mul(2_654_435_761) >> 8) / f64::from(1 << 24) - 0.5;
        r.insert(&probe.put(&picture, 4.0 * x)).unwrap();
    }
    let (worst, seen) = off_constant(r.volume(), 77.3);
    sheet.above("voxels seen", seen as f64, 100.0);
    sheet.above("weights clamped", r.work().weights_clamped as f64, 0.0);
    sheet.at_most("largest |r/w − c| / c", worst, 1e-5);
}

fn step(sheet: &mut Sheet) {
    let probe = Probe::arm([9, 9], 0.5);
    let put = |grey, i: u32| probe.put(&constant(probe.size, grey), 1e-5 * f64::from(i % 16));
    let mut r = reconstructor(Path::Planar, half_mm(), probe.mask());
    for i in 0..4_000 {
        r.insert(&put(10.0, i)).unwrap();
    }
    let middle = |r: &PathReconstructor| {
        let (sum, weight) = r.volume().voxel([0; 3]);
        f64::from(sum) / f64::from(weight)
    };
    let mut count = 0;
    while middle(&r) < 10.0 + 0.99 * 190.0 && count < 10_000 {
        r.insert(&put(200.0, count)).unwrap();
        count += 1;
    }
    let expected = 100.0_f64.ln() * 256.0;
    sheet.near("slices to 99 % of the step, W_max = 256", f64::from(count), expected, 0.01 * expected);
}

fn permutations(sheet: &mut Sheet) {
    let count = sheet.length.of(24, 200);
    let slices = sweep(DQuat::from_rotation_y(0.4), count);
    let settings = Settings { max_weight: 1e6, ..settings() };
    let first = reconstructed(settings.clone(), full(), &slices);
    // The lattice is the first slice's, so the other orders start with it as well.
    let orders: [Vec<usize>; 2] = [
        std::iter::once(0).chain((1..slices.len()).rev()).collect(),
        (0..slices.len()).map(|i| i * 7 % slices.len()).collect(),
    ];
    let again = reconstructed(settings.clone(), full(), &slices);
    sheet.equal("bits of the same order", content(again.volume()), content(first.volume()));
    let (mut worst_r, mut worst_w, mut compared) = (0.0_f64, 0.0_f64, 0);
    for order in &orders {
        assert_eq!(order.iter().collect::<std::collections::BTreeSet<_>>().len(), slices.len(), "a permutation");
        let other = reconstructed(settings.clone(), full(), order.iter().map(|i| &slices[*i]));
        for (index, r, w) in held(first.volume()) {
            let (s, v) = other.volume().voxel(index);
            let relative = |a: f32, b: f32| f64::from((a - b).abs()) / f64::from(a.abs()).max(1e-3);
            worst_r = worst_r.max(relative(r, s) * f64::from(u8::from(w > 0.01)));
            worst_w = worst_w.max(relative(w, v));
            compared += 1;
        }
    }
    let bound = 4.0 * f64::from(count) * 2.0_f64.powi(-24);
    sheet.above("voxels compared", f64::from(compared), 10_000.0);
    sheet.at_most("numerators, relative difference", worst_r, bound);
    sheet.at_most("weights, relative difference", worst_w, bound);
}

fn outcome(simd: Simd, threads: usize) -> (u64, Vec<Touched>, Work) {
    let mut r = PlanarReconstructor::new(
        Settings { simd, threads, max_weight: 1.5, ..settings() },
        refusing(),
        Mask::rect(SIZE[0], SIZE[1], ClipRect::new(3, 2, 37, 31).unwrap()),
    )
    .unwrap();
    let touched = sweep(DQuat::from_rotation_x(0.3), 12).iter().map(|slice| r.insert(slice).unwrap()).collect();
    (content(r.volume()), touched, r.work())
}

fn threads(sheet: &mut Sheet) {
    let alone = outcome(Simd::detect(), 1);
    sheet.above("weights clamped", alone.2.weights_clamped as f64, 0.0);
    for threads in [2, 7] {
        sheet.holds(
            &format!("{threads} threads: bits, tiles and work of one"),
            outcome(Simd::detect(), threads) == alone,
        );
    }
}

fn instructions(sheet: &mut Sheet) {
    let portable = outcome(Simd::Portable, 1);
    for simd in Simd::ALL {
        match simd.is_available() {
            true => sheet.holds(&format!("{}: bits of portable", simd.name()), outcome(simd, 1) == portable),
            false => sheet.record(simd.name(), "this machine lacks it"),
        }
    }
}

fn ends_on_planes(sheet: &mut Sheet) {
    let settings = |simd| Settings {
        sigma_mm: [Some(0.4), Some(0.4), Some(1.0)],
        support: [Some(Support::Peak((-2.0_f64).exp())); 2],
        method: Method::GaussianTruncated,
        simd,
        ..half_mm()
    };
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    for (name, v) in [("y", x), ("−y", -x), ("−x", y), ("x", -y)] {
        let probe = Probe { axes: DMat3::from_cols(z, v, z.cross(v)), ..Probe::straight([41, 33], 0.25) };
        let slice = probe.put(&noise(probe.size, 5), 0.0);
        let columns = |simd| {
            let mut r = reconstructor(Path::Planar, settings(simd), probe.mask());
            r.insert(&slice).unwrap();
            held(r.volume()).into_iter().map(|(index, _, _)| index).collect::<std::collections::BTreeSet<_>>()
        };
        let reached = columns(Simd::Portable);
        let normal = probe.axes.z_axis;
        let along = |voxel: &[i64; 3]| DVec3::from_array(voxel.map(|i| i as f64)).dot(normal) as i64;
        let planes: std::collections::BTreeSet<i64> = reached.iter().map(along).collect();
        sheet.equal(&format!("normal {name}: planes of columns reached"), planes, (-4..=4).collect());
        for simd in [Simd::Avx2, Simd::Avx512].into_iter().filter(|s| s.is_available()) {
            sheet.holds(&format!("normal {name}: voxels of {}", simd.name()), columns(simd) == reached);
        }
    }
}

fn far_away(sheet: &mut Sheet) {
    // Grey levels that change over millimetres, like those of a scan.
    let smooth = |p: DVec3| 128.0 + 40.0 * (0.8 * p.x + 0.3 * p.z).sin() + 30.0 * (0.7 * p.y - 0.2 * p.x).cos();
    let arm = Probe { axes: DMat3::from_rotation_z(0.4) * Probe::arm(SIZE, 0.4).axes, ..Probe::arm(SIZE, 0.4) };
    let slices: Vec<Slice> = (0..8).map(|i| arm.scan(0.4 * f64::from(i), smooth)).collect();
    let run = |distance: f64| {
        let mut r = reconstructor(Path::Planar, settings(), full());
        for slice in &slices {
            r.insert(&moved(slice, DAffine3::from_translation(DVec3::splat(distance)))).unwrap();
        }
        r
    };
    let origin = run(0.0);
    for distance in [1e3, 1e6] {
        let there = run(distance);
        let shift = (distance / 0.5) as i64;
        let (mut worst, mut count) = (0.0_f64, 0);
        for (index, r, w) in held(origin.volume()).into_iter().filter(|(_, _, w)| *w > 0.05) {
            let (s, v) = there.volume().voxel(index.map(|i| i + shift));
            let off = f64::from(s / v - r / w).abs();
            // A missing voxel counts as a difference.
            worst = if off.is_finite() { worst.max(off) } else { f64::INFINITY };
            count += 1;
        }
        sheet.above(&format!("{distance} mm: voxels compared"), f64::from(count), 5_000.0);
        sheet.at_most(&format!("{distance} mm: largest difference / 255"), worst / 255.0, 1e-6);
    }
}

fn border(sheet: &mut Sheet) {
    for grey in [77.3_f32, 0.1, 255.0] {
        // Pixels beyond the clip rectangle may have any value.
        let clip = ClipRect::new(4, 3, 33, 29).unwrap();
        let mask = Mask::rect(SIZE[0], SIZE[1], clip);
        let picture = |i: u32| {
            crate::insertion::image(SIZE, |u, v| if mask.contains(u, v) { grey } else { f32::from(i as u8) * 1e6 })
        };
        let slices: Vec<Slice> =
            (0..).zip(sweep(DQuat::IDENTITY, 10)).map(|(i, slice)| Slice { image: picture(i), ..slice }).collect();
        let (worst, seen) = off_constant(reconstructed(settings(), mask.clone(), &slices).volume(), grey);
        sheet.above(&format!("grey {grey}: voxels seen"), seen as f64, 5_000.0);
        sheet.at_most(&format!("grey {grey}: largest |r/w − c| / c in 2⁻²³"), worst / f64::from(f32::EPSILON), 4.0);
    }
}

/// The lattice around the seen voxels, and the lattice index of its first voxel.
fn grid_around(r: &PlanarReconstructor) -> (Grid, [i64; 3]) {
    let (low, high) = r.volume().seen_bounds().expect("something was seen");
    let low = low.map(|x| x - 4);
    let size = [0, 1, 2].map(|a| (high[a] + 5 - low[a]) as u64);
    let origin = r.world_from_lattice().point(DVec3::from_array(low.map(|x| x as f64)));
    (Grid { origin, spacing: r.settings().spacing_mm, direction: r.settings().lattice_direction, size }, low)
}

/// At the very end of the support, or at the threshold of a fifth of the kernel, a voxel may
/// fall either way for one slice of many; its weight then differs.
fn brute_force(sheet: &mut Sheet) {
    let anywhere = DQuat::from_euler(EulerRot::YXZ, 0.7, -0.4, 0.3);
    for method in WIDE {
        for (name, base, mask) in [
            ("any arm", anywhere, full()),
            ("clipped", DQuat::IDENTITY, Mask::rect(SIZE[0], SIZE[1], ClipRect::new(5, 3, 30, 28).unwrap())),
        ] {
            let slices = sweep(base, 9);
            let uneven = Settings { method, spacing_mm: DVec3::new(0.5, 0.6, 0.45), ..settings() };
            let r = reconstructed(uneven, mask.clone(), &slices);
            let (grid, low) = grid_around(&r);
            let mut slow = Reference::new(grid);
            for slice in &slices {
                equations::insert(&mut slow, slice, &mask, r.kernels().unwrap());
            }
            let most = slow.w.iter().copied().fold(0.0, f64::max);
            let [nx, ny, _] = grid.size.map(|n| n as i64);
            let (mut numerator, mut value, mut compared, mut differ) = (0.0_f64, 0.0_f64, 0_u32, 0_u32);
            for (i, (slow_r, slow_w)) in (0_i64..).zip(slow.r.iter().zip(&slow.w)) {
                let (r, w) = r.volume().voxel([low[0] + i % nx, low[1] + i / nx % ny, low[2] + i / (nx * ny)]);
                if (f64::from(w) - slow_w).abs() > 1e-5 * most {
                    differ += 1;
                    continue;
                }
                numerator = numerator.max((f64::from(r) - slow_r).abs() / (255.0 * most));
                if *slow_w > 0.05 {
                    value = value.max((f64::from(r) / f64::from(w) - slow_r / slow_w).abs() / 255.0);
                    compared += 1;
                }
            }
            let what = format!("{}, {name}", method.name());
            sheet.above(&format!("{what}: voxels compared"), f64::from(compared), 5_000.0);
            sheet.at_most(&format!("{what}: numerators"), numerator, 1e-5);
            sheet.at_most(&format!("{what}: values"), value, 1e-5);
            sheet.at_most(
                &format!("{what}: share of voxels whose weight differs"),
                f64::from(differ) / f64::from(compared),
                1e-3,
            );
        }
    }
}

/// Returns the number of voxels where both paths got the same slices, the fraction where they
/// did not, and the worst difference of values.
fn compared(a: &dyn Voxels, b: &dyn Voxels, deviation: f64) -> (u32, f64, f64) {
    let (mut same, mut differ, mut worst) = (0_u32, 0_u32, 0.0_f64);
    for (index, r, w) in held(a) {
        let (s, v) = b.voxel(index);
        if f64::from((w - v).abs()) > 1e-3 + 2.0 * deviation * f64::from(w.max(v)) {
            differ += 1;
        } else if w > 0.05 {
            same += 1;
            worst = worst.max(f64::from((r / w - s / v).abs()));
        }
    }
    (same, f64::from(differ) / f64::from(same), worst)
}

fn both_paths(sheet: &mut Sheet) {
    for method in WIDE {
        let slices = sweep(DQuat::from_rotation_y(0.9), 12);
        let planar = reconstructed(Settings { method, ..settings() }, full(), &slices);
        let mut general = Reconstructor::new(planar.settings().clone(), full()).unwrap();
        for slice in &slices {
            general.insert(slice).unwrap();
        }
        let deviation = general.decimation().unwrap().1;
        let what = method.name();
        for (name, (same, differ, worst)) in [
            ("planar to general", compared(planar.volume(), general.volume(), deviation)),
            ("general to planar", compared(general.volume(), planar.volume(), deviation)),
        ] {
            sheet.above(&format!("{what}, {name}: voxels of the same weight"), f64::from(same), 10_000.0);
            // In the images' corners the planar path tests each axis for a fifth, the general
            // one their product.
            sheet.at_most(&format!("{what}, {name}: share of voxels of another weight"), differ, 0.02);
            // Numerator and weight may both deviate, and the weight at a border is a fifth.
            sheet.at_most(&format!("{what}, {name}: largest difference"), worst, 5.0 * 2.0 * deviation * 255.0);
        }
    }
}

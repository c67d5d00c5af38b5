//! The planar path: against the equations, the general path, itself, and what it cannot hold.

use calibration::frames::Transform;
use calibration::region::{ClipRect, Fan};
use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};
use sonoweave::mask::Mask;
use sonoweave::reconstruct::kernel::{Method, Support};
use sonoweave::reconstruct::planar::{
    Departure, OnDeparture, PlanarReconstructor, PlanarSettings, reference as equations,
};
use sonoweave::reconstruct::reference::Reference;
use sonoweave::reconstruct::{
    Compounding, Decay, Path, Reconstructor, Refused, Settings, SettingsError, Simd, Touched, Weaver, Work,
};
use sonoweave::slice::{Image, Slice};
use sonoweave::volume::sparse::SEEN;
use sonoweave::volume::{Grid, Voxels};

use crate::figures::{Length, Sheet, Test};
use crate::weaving::{Probe, WIDE, constant, content, half_mm, held, noise, on_the_world_s_axes, posed, weaver};

const SIZE: [u32; 2] = [44, 36];

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
        Test::new("21", "planar, slices that cannot be used: refused, every bit and counter as before", refused),
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
        Test::new("29", "a fan, a hole, a corner cut off: refused, or the general path from the beginning", masks),
        Test::new(
            "29",
            "poses out of the plane: refused without a trace, or the general path with every bit there was",
            departures,
        ),
        Test::new("29", "ages go with the voxels: what was old before the upgrade fades after it", upgraded_ages),
        Test::new("36", "planar, memory limit: kept to the tile, a typed refusal, every bit as before", limit),
        Test::new("36", "planar, columns 2·10⁹ voxels apart: memory by what was scanned", far_apart),
    ]
}

/// An arm's sweep that shifts and turns, in a world turned by `base`.
fn sweep(base: DQuat, count: u32) -> Vec<Slice> {
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

fn settings() -> Settings {
    Settings { sigma_mm: [None, None, Some(0.8)], ..half_mm() }
}

fn refusing() -> PlanarSettings {
    PlanarSettings { on_departure: OnDeparture::Refuse, ..PlanarSettings::default() }
}

fn full() -> Mask {
    Mask::full(SIZE[0], SIZE[1])
}

fn woven<'a>(settings: Settings, mask: Mask, slices: impl IntoIterator<Item = &'a Slice>) -> PlanarReconstructor {
    let mut r = PlanarReconstructor::new(settings, refusing(), mask).unwrap();
    for slice in slices {
        r.insert(slice).unwrap();
    }
    r
}

fn moved(slice: &Slice, by: DAffine3) -> Slice {
    Slice { world_from_image: Transform::from_affine(by * slice.world_from_image.affine()), ..slice.clone() }
}

/// Largest |r/w − c| / c of what counts as seen, and how many voxels that are.
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
    let mut r = weaver(Path::Planar, half_mm(), probe.mask());
    for i in 0..sheet.length.of(20_000_u32, 1_000_000) {
        // A hand's trembling: no two weights of a column are alike.
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
    let mut r = weaver(Path::Planar, half_mm(), probe.mask());
    for i in 0..4_000 {
        r.insert(&put(10.0, i)).unwrap();
    }
    let middle = |r: &Weaver| {
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
    let first = woven(settings.clone(), full(), &slices);
    // The lattice is the first slice's, so that the others start with it as well.
    let orders: [Vec<usize>; 2] = [
        std::iter::once(0).chain((1..slices.len()).rev()).collect(),
        (0..slices.len()).map(|i| i * 7 % slices.len()).collect(),
    ];
    let again = woven(settings.clone(), full(), &slices);
    sheet.equal("bits of the same order", content(again.volume()), content(first.volume()));
    let (mut worst_r, mut worst_w, mut compared) = (0.0_f64, 0.0_f64, 0);
    for order in &orders {
        assert_eq!(order.iter().collect::<std::collections::BTreeSet<_>>().len(), slices.len(), "a permutation");
        let other = woven(settings.clone(), full(), order.iter().map(|i| &slices[*i]));
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
        support: Some(Support::Peak((-2.0_f64).exp())),
        method: Method::GaussianTruncated,
        simd,
        ..half_mm()
    };
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    for (name, v) in [("y", x), ("−y", -x), ("−x", y), ("x", -y)] {
        let probe = Probe { axes: DMat3::from_cols(z, v, z.cross(v)), ..Probe::straight([41, 33], 0.25) };
        let slice = probe.put(&noise(probe.size, 5), 0.0);
        let columns = |simd| {
            let mut r = weaver(Path::Planar, settings(simd), probe.mask());
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
        let mut r = weaver(Path::Planar, settings(), full());
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
            // A voxel that is lost is a difference.
            worst = if off.is_finite() { worst.max(off) } else { f64::INFINITY };
            count += 1;
        }
        sheet.above(&format!("{distance} mm: voxels compared"), f64::from(count), 5_000.0);
        sheet.at_most(&format!("{distance} mm: largest difference / 255"), worst / 255.0, 1e-6);
    }
}

fn border(sheet: &mut Sheet) {
    for grey in [77.3_f32, 0.1, 255.0] {
        // Beyond the clip rectangle may stand what will.
        let clip = ClipRect::new(4, 3, 33, 29).unwrap();
        let mask = Mask::rect(SIZE[0], SIZE[1], clip);
        let picture = |i: u32| {
            crate::weaving::image(SIZE, |u, v| if mask.contains(u, v) { grey } else { f32::from(i as u8) * 1e6 })
        };
        let slices: Vec<Slice> =
            (0..).zip(sweep(DQuat::IDENTITY, 10)).map(|(i, slice)| Slice { image: picture(i), ..slice }).collect();
        let (worst, seen) = off_constant(woven(settings(), mask.clone(), &slices).volume(), grey);
        sheet.above(&format!("grey {grey}: voxels seen"), seen as f64, 5_000.0);
        sheet.at_most(&format!("grey {grey}: largest |r/w − c| / c in 2⁻²³"), worst / f64::from(f32::EPSILON), 4.0);
    }
}

type Expected = fn(&Refused) -> bool;

/// A slice spoilt in the ways that only the plane forbids.
fn out_of_plane(slice: &Slice) -> Vec<(&'static str, Slice)> {
    let pose = slice.world_from_image.affine();
    let [u, v, n] = [pose.matrix3.x_axis, pose.matrix3.y_axis, pose.matrix3.z_axis].map(DVec3::normalize);
    let turned = |axis, angle| DAffine3 { matrix3: DMat3::from_axis_angle(axis, angle) * pose.matrix3, ..pose };
    let with = |pose: DAffine3| Slice { world_from_image: Transform::from_affine(pose), ..slice.clone() };
    vec![
        // A quarter of a voxel is 0.125 mm.
        ("0.13 mm along u", with(DAffine3 { translation: pose.translation + u * 0.13, ..pose })),
        ("turned by 0.02 about v", with(turned(v, 0.02))),
        ("turned by 0.02 about n", with(turned(n, 0.02))),
        (
            "u the wrong way round",
            with(DAffine3 { matrix3: DMat3::from_cols(-pose.matrix3.x_axis, pose.matrix3.y_axis, n), ..pose }),
        ),
        (
            "pixels 2 % wider",
            with(DAffine3 { matrix3: DMat3::from_cols(pose.matrix3.x_axis * 1.02, pose.matrix3.y_axis, n), ..pose }),
        ),
    ]
}

fn refused(sheet: &mut Sheet) {
    let slices = sweep(DQuat::from_rotation_x(1.0), 3);
    let good = &slices[1];
    let pose = good.world_from_image.affine();
    let with = |pose: DAffine3| Slice { world_from_image: Transform::from_affine(pose), ..good.clone() };
    let at = |translation: DVec3| with(DAffine3 { translation, ..pose });
    let columns = |u: DVec3, v: DVec3| with(DAffine3 { matrix3: DMat3::from_cols(u, v, pose.matrix3.z_axis), ..pose });
    let [u, v] = [pose.matrix3.x_axis, pose.matrix3.y_axis];
    let degenerate: Expected = |e| matches!(e, Refused::Degenerate);
    let mut cases: Vec<(&str, Slice, Expected)> = vec![
        ("position NaN", at(DVec3::NAN), degenerate),
        ("position infinite", at(DVec3::new(0.0, f64::INFINITY, 0.0)), degenerate),
        ("direction NaN", columns(DVec3::NAN, v), degenerate),
        ("u of no length", columns(DVec3::ZERO, v), degenerate),
        ("v along u", columns(u, u * 2.0), degenerate),
        // So far out f64 no longer tells whether it is in the plane.
        ("10¹² mm along v", at(pose.translation + v.normalize() * 1e12), |e| {
            matches!(e, Refused::OutOfRange | Refused::Departure(_))
        }),
        ("another size", Slice { image: Image::new(2, 2, noise([2, 2], 1).pixels().clone()), ..good.clone() }, |e| {
            matches!(e, Refused::Size { .. })
        }),
        ("the same again", slices[0].clone(), |e| matches!(e, Refused::Repeated)),
    ];
    let departure: Expected = |e| matches!(e, Refused::Departure(Departure::Pose { .. }));
    cases.extend(out_of_plane(good).into_iter().map(|(name, slice)| (name, slice, departure)));
    let mut r = woven(settings(), full(), &slices[..1]);
    let (before, work) = (content(r.volume()), r.work());
    for (name, slice, expected) in cases {
        let result = r.insert(&slice);
        let answer = result.as_ref().map_or_else(ToString::to_string, |t| format!("{} voxels changed", t.voxels));
        sheet.record(&format!("{name}: answer"), answer);
        sheet.holds(&format!("{name}: refused for its reason"), result.is_err_and(|e| expected(&e)));
        sheet.holds(&format!("{name}: state and work"), content(r.volume()) == before && r.work() == work);
    }
    sheet.holds(
        "0.12 mm along u is within the tolerance",
        r.insert(&at(pose.translation + u.normalize() * 0.12)).is_ok(),
    );
    sheet.holds("a good slice still enters", r.insert(&slices[2]).is_ok());
}

/// The lattice around what was seen, and the lattice index of its first voxel.
fn grid_around(r: &PlanarReconstructor) -> (Grid, [i64; 3]) {
    let (low, high) = r.volume().seen_bounds().expect("something was seen");
    let low = low.map(|x| x - 4);
    let size = [0, 1, 2].map(|a| (high[a] + 5 - low[a]) as u64);
    let origin = r.world_from_lattice().point(DVec3::from_array(low.map(|x| x as f64)));
    (Grid { origin, spacing: r.settings().spacing_mm, direction: r.settings().lattice_direction, size }, low)
}

/// A voxel at the very end of the support, or of a fifth of the kernel, may fall either way for one slice of many; its weight then differs.
fn brute_force(sheet: &mut Sheet) {
    let anywhere = DQuat::from_euler(EulerRot::YXZ, 0.7, -0.4, 0.3);
    for method in WIDE {
        for (name, base, mask) in [
            ("any arm", anywhere, full()),
            ("clipped", DQuat::IDENTITY, Mask::rect(SIZE[0], SIZE[1], ClipRect::new(5, 3, 30, 28).unwrap())),
        ] {
            let slices = sweep(base, 9);
            let uneven = Settings { method, spacing_mm: DVec3::new(0.5, 0.6, 0.45), ..settings() };
            let r = woven(uneven, mask.clone(), &slices);
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

/// Where both paths got the same slices, worst difference of values; and the share of voxels where they did not.
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
        let planar = woven(Settings { method, ..settings() }, full(), &slices);
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
            // In the pictures' corners, where each axis is asked for a fifth here and their product there.
            sheet.at_most(&format!("{what}, {name}: share of voxels of another weight"), differ, 0.02);
            // Numerator and weight may both deviate, and the weight at a border is a fifth.
            sheet.at_most(&format!("{what}, {name}: largest difference"), worst, 5.0 * 2.0 * deviation * 255.0);
        }
    }
}

fn masks(sheet: &mut Sheet) {
    let [width, height] = SIZE;
    for (name, mask) in [
        ("fan", Mask::fan(width, height, &Fan::new([22.0, -10.0], [12.0, 44.0], [-25.0, 25.0]).unwrap())),
        ("one pixel missing", Mask::from_fn(width, height, |u, v| (u, v) != (20, 20))),
        ("a corner missing", Mask::from_fn(width, height, |u, v| u + v > 2)),
        ("covered in part along u", Mask::from_fn(width, height, |u, v| u < 30 || v < 20)),
    ] {
        let refused = Weaver::planar(settings(), refusing(), mask.clone()).err();
        let by_type = matches!(refused, Some(SettingsError::Planar(Departure::Mask { .. })));
        sheet.holds(&format!("{name}: refused by type"), by_type);
        let mut upgraded = Weaver::planar(settings(), PlanarSettings::default(), mask.clone()).unwrap();
        sheet.equal(&format!("{name}: path, where it may choose"), upgraded.path(), Path::General);
        let mut general = Weaver::general(settings(), mask).unwrap();
        for slice in &sweep(DQuat::IDENTITY, 4) {
            upgraded.insert(slice).unwrap();
            general.insert(slice).unwrap();
        }
        let same = content(upgraded.volume()) == content(general.volume());
        sheet.holds(&format!("{name}: the general path's bits"), same);
    }
    let [none, all] =
        [|_, _| false, |_, _| true].map(|of| Weaver::planar(settings(), refusing(), Mask::from_fn(width, height, of)));
    sheet.equal("an empty mask", none.err(), Some(SettingsError::EmptyMask));
    sheet.holds("a rectangle is none of these", all.is_ok());
}

fn departures(sheet: &mut Sheet) {
    let slices = sweep(DQuat::IDENTITY, 6);
    // Far beside the others, so that what was there must stay as it is.
    let beside = DAffine3::from_translation(DVec3::new(0.0, 200.0, 0.0));
    for (name, spoilt) in out_of_plane(&moved(&slices[3], beside)) {
        for on_departure in [OnDeparture::Refuse, OnDeparture::Upgrade] {
            let planar = on_the_world_s_axes(on_departure);
            let mut r = Weaver::planar(settings(), planar, full()).unwrap();
            slices.iter().for_each(|slice| drop(r.insert(slice).unwrap()));
            let (before, work) = (held(r.volume()), r.work());
            let result = r.insert(&spoilt);
            if on_departure == OnDeparture::Refuse {
                sheet.holds(&format!("{name}, refused: for its reason"), matches!(result, Err(Refused::Departure(_))));
                let as_before = r.path() == Path::Planar && held(r.volume()) == before && r.work() == work;
                sheet.holds(&format!("{name}, refused: path, state and work as before"), as_before);
            } else {
                sheet
                    .holds(&format!("{name}, upgraded: it enters"), result.is_ok_and(|touched| touched.voxels > 1_000));
                sheet.equal(
                    &format!("{name}, upgraded: path and slices"),
                    (r.path(), r.work().slices),
                    (Path::General, 7),
                );
                let lost = before.iter().filter(|(index, s, v)| {
                    let (r, w) = r.volume().voxel(*index);
                    (r.to_bits(), w.to_bits()) != (s.to_bits(), v.to_bits())
                });
                sheet.equal(&format!("{name}, upgraded: voxels of {} that lost a bit", before.len()), lost.count(), 0);
                sheet.holds(&format!("{name}, upgraded: the next slice enters"), r.insert(&slices[2]).is_ok());
            }
        }
    }
}

fn upgraded_ages(sheet: &mut Sheet) {
    let arm = Probe::arm([24, 24], 0.5);
    let grey = |grey, along, seconds: f64| {
        let slice = arm.put(&constant(arm.size, grey), along);
        Slice { time_ns: (seconds * 1e9) as i64, ..slice }
    };
    for decay in [Decay::DeadTime { rate_per_s: 1.0, wait_s: 2.0 }, Decay::Exponential { rate_per_s: 1.0 }] {
        let compounding = Compounding::Decay(decay);
        let planar = on_the_world_s_axes(OnDeparture::Upgrade);
        let mut r = Weaver::planar(Settings { compounding, ..half_mm() }, planar, arm.mask()).unwrap();
        r.insert(&grey(0.0, 0.0, 0.0)).unwrap();
        let tilted = DAffine3::from_translation(DVec3::Y * 50.0) * DAffine3::from_rotation_x(0.1);
        r.insert(&moved(&grey(0.0, 0.0, 9.9), tilted)).unwrap();
        sheet.equal(&format!("{}: path after a tilted slice", decay.name()), r.path(), Path::General);
        r.insert(&grey(100.0, 0.0, 10.0)).unwrap();
        let (sum, weight) = r.volume().voxel([0; 3]);
        let old = 1.0 - f64::from(sum) / f64::from(weight) / 100.0;
        let factor = decay.factor(10.0);
        sheet.near(
            &format!("{}: old content after 10 s", decay.name()),
            old,
            factor / (1.0 + factor),
            0.01 * factor + 1e-6,
        );
    }
}

fn limit(sheet: &mut Sheet) {
    let arm = Probe::arm([48, 40], 0.25);
    let slices = [0.0, 3.0, 40.0].map(|along| arm.put(&noise(arm.size, 1), along));
    let free = |count: usize| {
        let mut r = PlanarReconstructor::new(half_mm(), refusing(), arm.mask()).unwrap();
        slices[..count].iter().for_each(|slice| drop(r.insert(slice).unwrap()));
        let volume = r.volume();
        // Columns of whole vectors, and a weight each.
        (volume.tiles() as u64, 64 * 4 * (volume.depth().next_multiple_of(16) as u64 + 1))
    };
    let [(one, tile), (two, _), (three, _)] = [1, 2, 3].map(free);
    for (name, room, entered) in [
        ("exactly enough for all", three * tile, 3),
        ("a byte less", three * tile - 1, 2),
        ("exactly enough for two", two * tile, 2),
        ("a tile less than for two", (two - 1) * tile, 1),
        ("a tile less than for one", (one - 1) * tile, 0),
    ] {
        let mut r =
            PlanarReconstructor::new(Settings { memory_bytes: room, ..half_mm() }, refusing(), arm.mask()).unwrap();
        let (mut taken, mut clean) = (0, true);
        for slice in &slices {
            let (before, work) = (content(r.volume()), r.work());
            match r.insert(slice) {
                Ok(_) => taken += 1,
                Err(Refused::Memory { needed, limit_bytes }) => {
                    clean &= needed > 0 && limit_bytes == room && content(r.volume()) == before && r.work() == work;
                    break;
                }
                Err(other) => panic!("{other}"),
            }
        }
        sheet.equal(&format!("{name}: slices that entered"), taken, entered);
        sheet.holds(&format!("{name}: refused by type, state and counters as before"), clean);
        sheet.holds(&format!("{name}: within the limit"), r.volume().tiles() as u64 * tile <= room);
    }
}

fn far_apart(sheet: &mut Sheet) {
    let arm = Probe::arm([9, 9], 0.5);
    let picture = noise(arm.size, 4);
    let mut r = weaver(Path::Planar, half_mm(), arm.mask());
    let near = r.insert(&arm.put(&picture, 0.0)).unwrap();
    let reach = 1e9;
    for [x, y] in [[reach, reach], [reach, -reach], [-reach, reach], [-reach, -reach]] {
        let there = Probe { centre: DVec3::new(x, y, 0.0), ..arm };
        let touched = r.insert(&there.put(&picture, 0.0)).unwrap();
        sheet.equal(&format!("({x:e}, {y:e}) mm: voxels, as many as at the origin"), touched.voxels, near.voxels);
        let middle = there.centre.to_array().map(|x| (x / 0.5) as i64);
        let (here, origin) = (r.volume().voxel(middle), r.volume().voxel([0; 3]));
        sheet.at_most(
            &format!("({x:e}, {y:e}) mm: its middle is the origin's, off by"),
            f64::from((here.0 - origin.0).abs()),
            1e-3,
        );
        let wrapped = [middle[0] + (1 << 35), middle[1], middle[2]];
        sheet.equal(
            &format!("({x:e}, {y:e}) mm: 2³⁵ voxels on there is nothing"),
            r.volume().voxel(wrapped),
            (0.0, 0.0),
        );
    }
    let before = content(r.volume());
    let beyond = Probe { centre: DVec3::Y * 1.08e9, ..arm };
    sheet.equal("beyond the lattice", r.insert(&beyond.put(&picture, 0.0)).err(), Some(Refused::OutOfRange));
    sheet.equal("state after it", content(r.volume()), before);
    sheet.at_most("bytes held", r.volume().bytes() as f64, 5.0 * 4.0 * 64.0 * 17.0 * 4.0 + 4096.0);
}

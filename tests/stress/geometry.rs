//! Tests of planes that meet the lattice in awkward ways, and of worlds far from their origin.

use std::collections::BTreeSet;
use volume::Voxels;

use glam::{Affine3A, DAffine3, DMat3, DVec3, Mat3A, Vec3, Vec3A};

use reconstruct::kernel::{Method, Support};
use reconstruct::reference::{Reference, in_plane};
use reconstruct::{Reconstructor, Settings, Simd};
use sonoweave_core::slice::Slice;

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, compare, grid_around, half_mm, noise, reconstruct_all, seen, turned, weighted};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "13",
            "slab that ends on voxel planes: the planes are in, for every instruction set and the equations",
            ends_on_planes,
        ),
        Test::new("13", "every kernel, ending on voxel planes: the same voxels on every instruction set", every_end),
        Test::new("14", "normals along an axis, 1e-12 off, (1,1,1)/√3: no voxel missing, none too many", normals),
        Test::new("14", "a normal 1e-12 off an axis gives the axis' values", continuous),
        Test::new(
            "16",
            "world 1e3 and 1e6 mm away: the origin's values within 1e-6; an f32 composition fails it",
            far_away,
        ),
    ]
}

/// A kernel that ends, with a step, exactly four voxels from the slice.
fn four_voxels() -> Settings {
    Settings {
        sigma_mm: [Some(0.4), Some(0.4), Some(1.0)],
        support: [Some(Support::Peak((-2.0_f64).exp())); 2],
        method: Method::GaussianTruncated,
        ..half_mm()
    }
}

fn ends_on_planes(sheet: &mut Sheet) {
    let size = [41, 33];
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    // Exact directions and positions, so that |q| = 2 exactly where a plane of voxels ends the
    // slab.
    for (name, axes) in [
        ("z", DMat3::from_cols(x, y, z)),
        ("−z", DMat3::from_cols(y, x, -z)),
        ("x", DMat3::from_cols(y, z, x)),
        ("−x", DMat3::from_cols(z, y, -x)),
        ("y", DMat3::from_cols(z, x, y)),
        ("−y", DMat3::from_cols(x, z, -y)),
    ] {
        let probe = Probe { axes, ..Probe::straight(size, 0.25) };
        let slice = probe.put(&noise(size, 5), 0.0);
        let settings = |simd| Settings { simd, ..four_voxels() };
        let set = |r: &Reconstructor| weighted(r).map(|voxel| voxel.index).collect::<BTreeSet<_>>();
        let portable = reconstruct_all(settings(Simd::Portable), &probe.mask(), [&slice]);
        let reached = set(&portable);
        let along = |voxel: &[i64; 3]| DVec3::from_array(voxel.map(|i| i as f64)).dot(axes.z_axis) as i64;
        let planes: BTreeSet<i64> = reached.iter().map(along).collect();
        sheet.equal(&format!("normal {name}: voxel planes reached"), planes, (-4..=4).collect());
        for simd in [Simd::Avx2, Simd::Avx512].into_iter().filter(|s| s.is_available()) {
            let same = set(&reconstruct_all(settings(simd), &probe.mask(), [&slice])) == reached;
            sheet.holds(&format!("normal {name}: voxels of {}", simd.name()), same);
        }
        let (grid, low) = grid_around(&portable);
        let mut equations = Reference::new(grid);
        equations.insert(&slice, &probe.mask(), portable.kernels().unwrap());
        let [nx, ny, _] = grid.size.map(|n| n as i64);
        let theirs: BTreeSet<[i64; 3]> = (0..)
            .zip(&equations.w)
            .filter(|(_, w)| **w > 0.0)
            .map(|(i, _)| [low[0] + i % nx, low[1] + i / nx % ny, low[2] + i / (nx * ny)])
            .collect();
        let differ = theirs.symmetric_difference(&reached).count();
        sheet.equal(&format!("normal {name}: voxels that only one of the equations and the fast path has"), differ, 0);
    }
}

/// Kernels that vanish at their end may leave 0 or a rounding error there; those that end with
/// a step may not lose it.
fn every_end(sheet: &mut Sheet) {
    let probe = Probe::straight([41, 33], 0.25);
    let slice = probe.put(&noise(probe.size, 5), 0.0);
    for method in METHODS {
        // Own end of each kernel, in σ; 1e-15 more than the four voxels, since √3 is not exact
        // in f64.
        let (reach, support) = match method {
            Method::BSpline3 => (12.0_f64.sqrt(), None),
            Method::Nearest => (3.0_f64.sqrt(), None),
            _ => (2.0, Some(Support::Peak((-2.0_f64).exp()))),
        };
        let sigma = 2.0 * (1.0 + 1e-15) / reach;
        let sigma = if support.is_some() { 1.0 } else { sigma };
        let set = |simd| {
            let sigma_mm = [Some(0.4), Some(0.4), Some(sigma)];
            let r = reconstruct_all(
                Settings { method, simd, sigma_mm, support: [support; 2], ..half_mm() },
                &probe.mask(),
                [&slice],
            );
            weighted(&r).map(|voxel| (voxel.index, voxel.weight.to_bits())).collect::<BTreeSet<_>>()
        };
        let reached = set(Simd::Portable);
        let weight =
            |z: i64| reached.iter().filter(|(i, _)| i[2] == z).map(|(_, w)| f32::from_bits(*w)).fold(0.0, f32::max);
        let what = method.name();
        let steps = matches!(method, Method::GaussianTruncated | Method::Gaussian4 | Method::Nearest);
        for z in [-4, 4] {
            match steps {
                true => sheet.above(&format!("{what}: weight at plane {z}"), f64::from(weight(z)), 0.1),
                false => sheet.at_most(&format!("{what}: weight at plane {z}"), f64::from(weight(z)), 1e-6),
            }
        }
        let farthest = reached.iter().map(|(i, _)| i[2].abs()).max();
        sheet.holds(&format!("{what}: planes −3 to 3 are reached"), (-3..=3).all(|z| weight(z) > 1e-3));
        sheet.holds(&format!("{what}: none beyond ±4"), farthest.is_some_and(|z| z <= 4));
        for simd in [Simd::Avx2, Simd::Avx512].into_iter().filter(|s| s.is_available()) {
            sheet.holds(&format!("{what}: voxels and weights of {}", simd.name()), set(simd) == reached);
        }
    }
}

fn normals(sheet: &mut Sheet) {
    // An odd number of pixels: along the axes a voxel has one nearest pixel and not two.
    let size = [49, 41];
    let diagonal = {
        let n = DVec3::ONE.normalize();
        let u = n.any_orthonormal_vector();
        DMat3::from_cols(u, n.cross(u), n)
    };
    for (name, axes) in [
        ("(0,0,1)", DMat3::IDENTITY),
        ("1e-12 off (0,0,1)", turned(1e-12, -1e-12, 0.0)),
        ("1e-6 off (0,0,1)", turned(1e-6, -1e-6, 0.0)),
        ("(1,0,0)", turned(0.0, std::f64::consts::FRAC_PI_2, 0.0)),
        ("1e-12 off (1,0,0)", turned(1e-12, std::f64::consts::FRAC_PI_2 - 1e-12, 0.0)),
        ("(1,1,1)/√3", diagonal),
        ("no direction of the lattice", turned(0.7, -0.4, 0.3)),
    ] {
        // Includes supports that end on planes of voxels.
        let kernels = METHODS.map(|method| (method.name(), Settings { method, ..half_mm() }));
        for (kernel, settings) in kernels.into_iter().chain([("four voxels", four_voxels())]) {
            let probe = Probe { axes, ..Probe::straight(size, 0.25) };
            let slice = probe.put(&noise(size, 3), 0.0);
            let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
            let touched = r.insert(&slice).unwrap();
            let c = compare(&r, &slice, &probe.mask(), 1e-5);
            let what = format!("normal {name}, kernel {kernel}");
            sheet.above(&format!("{what}: voxels"), c.both as f64, 3_000.0);
            sheet.equal(&format!("{what}: missing and surplus"), (c.missing, c.surplus), (0, 0));
            // At the least certainty the deviation counts five times.
            let limit = 5.0 * 2.0 * r.decimation().unwrap().1 * 255.0;
            sheet.at_most(&format!("{what}: largest difference from the equations"), c.worst, limit);
            let ratio = r.work().bricks_considered as f64 / touched.bricks.len() as f64;
            sheet.at_most(&format!("{what}: bricks looked at / bricks touched"), ratio, 3.0);
        }
    }
}

fn continuous(sheet: &mut Sheet) {
    let size = [48, 40];
    let run = |axes: DMat3| {
        let probe = Probe { axes, ..Probe::straight(size, 0.25) };
        let slices: Vec<Slice> = (0..6).map(|i| probe.put(&noise(size, i), 0.3 * f64::from(i))).collect();
        reconstruct_all(half_mm(), &probe.mask(), &slices)
    };
    let axis = run(DMat3::IDENTITY);
    let off = run(turned(1e-12, -1e-12, 1e-12));
    let (worst, count) = difference(&axis, &off, [0; 3]);
    sheet.above("voxels compared", count as f64, 5_000.0);
    sheet.at_most("largest difference / 255", worst / 255.0, 1e-6);
}

/// Returns the largest difference of values that both volumes hold, the second's lattice
/// shifted by `shift` voxels, and their number.
fn difference(a: &Reconstructor, b: &Reconstructor, shift: [i64; 3]) -> (f64, usize) {
    let (mut worst, mut count) = (0.0_f64, 0);
    for voxel in seen(a).iter().filter(|voxel| voxel.weight > 0.05) {
        let (r, w) = b.volume().voxel([0, 1, 2].map(|i| voxel.index[i] + shift[i]));
        let value = if w > 0.0 { f64::from(r) / f64::from(w) } else { f64::NAN };
        // A missing voxel counts as a difference.
        worst = if value.is_finite() { worst.max((value - voxel.value).abs()) } else { f64::INFINITY };
        count += 1;
    }
    (worst, count)
}

/// Grey levels of about 70 around 128 that change over millimetres, like those of a scan.
fn smooth(p: DVec3) -> f64 {
    128.0 + 40.0 * (0.8 * p.x + 0.3 * p.z).sin() + 30.0 * (0.7 * p.y - 0.2 * p.x).cos()
}

fn far_away(sheet: &mut Sheet) {
    let near = Probe::oblique([48, 40], 0.25);
    let slices: Vec<Slice> = (0..8).map(|i| near.scan(0.4 * f64::from(i), smooth)).collect();
    let moved = |slice: &Slice, by: f64| {
        let pose = slice.world_from_image.affine();
        let pose = DAffine3 { translation: pose.translation + DVec3::splat(by), ..pose };
        crate::insertion::posed(&slice.image, pose)
    };
    let origin = reconstruct_all(half_mm(), &near.mask(), &slices);
    for distance in [1e3, 1e6] {
        let far: Vec<Slice> = slices.iter().map(|slice| moved(slice, distance)).collect();
        let there = reconstruct_all(half_mm(), &near.mask(), &far);
        let shift = (distance / 0.5) as i64;
        let (worst, count) = difference(&origin, &there, [shift; 3]);
        sheet.above(&format!("{distance} mm: voxels compared"), count as f64, 5_000.0);
        sheet.at_most(&format!("{distance} mm: largest difference / 255"), worst / 255.0, 1e-6);

        // The same voxels of the first slice by transforms composed in f32.
        let kernels = origin.kernels().unwrap();
        let world_from_image = far[0].world_from_image.affine();
        let (m, t) = (world_from_image.matrix3, world_from_image.translation);
        let single = |v: DVec3| Vec3A::from(v.as_vec3());
        let world_from_image = Affine3A {
            matrix3: Mat3A::from_cols(single(m.x_axis), single(m.y_axis), single(m.z_axis)),
            translation: single(t),
        };
        let world_from_lattice = Affine3A::from_scale(Vec3::splat(0.5));
        let image_from_lattice = world_from_image.inverse() * world_from_lattice;
        let exact = slices[0].world_from_image.affine().inverse();
        let mut composed = 0.0_f64;
        for voxel in seen(&origin).iter().step_by(97) {
            let here = exact.transform_point3(voxel.at);
            if here.z.abs() > 1.0 || here.x.min(here.y) < 8.0 || here.x > 39.0 || here.y > 31.0 {
                continue;
            }
            let index = voxel.index.map(|i| (i + shift) as f32);
            let there = image_from_lattice.transform_point3(Vec3::from_array(index));
            let value = |u: f64, v: f64| {
                let (value, certainty) = in_plane(&slices[0], &near.mask(), kernels, [0.25; 2], [u, v]);
                if certainty > 0.2 { value / certainty } else { 0.0 }
            };
            let error = value(here.x, here.y) - value(f64::from(there.x), f64::from(there.y));
            composed = composed.max(error.abs());
        }
        sheet.above(&format!("{distance} mm: the same, composed in f32"), composed / 255.0, 1e-6);
    }
}

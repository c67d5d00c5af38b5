//! Tests of the fast path against the equations, closed forms and itself.

mod compounding;
mod decay;
mod order;
mod region;
mod threads;
mod weights;

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};

use mask::Mask;
use phantom::{Motion, Scan, ScanSettings, Scene, scan::Depth, scene::Sphere};
use sonoweave_core::frames::Transform;
use sonoweave_core::region::{ClipRect, Fan};
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::{BrickVolume, Grid, Voxels, brick::BrickIndex, brick_volume::SEEN};

use super::kernel::{Method, Support};
use super::{Compounding, Reconstructor, Refused, Settings, Simd, reference::Reference};

/// A small freehand scan of a scene: 72×60 pixels of 0.25 mm.
fn scan(scene: Scene, frames: u32, noise_sd: f64, depth: Depth) -> Scan {
    scan_of_pixels(0.25, scene, frames, noise_sd, depth)
}

fn scan_of_pixels(pixel_mm: f64, scene: Scene, frames: u32, noise_sd: f64, depth: Depth) -> Scan {
    Scan::new(ScanSettings {
        scene,
        motion: Motion::Freehand,
        frames,
        gap_mm: 0.4,
        image_size: [72, 60],
        pixel_mm: [pixel_mm; 2],
        noise_sd,
        depth,
        fan: None,
        seed: 7,
        ..ScanSettings::default()
    })
    .unwrap()
}

fn fan() -> Mask {
    Mask::fan(72, 60, &Fan::new([36.0, -20.0], [25.0, 76.0], [-25.0, 25.0]).unwrap())
}

fn settings() -> Settings {
    Settings::new(DVec3::splat(0.5))
}

/// All bricks, bit by bit.
fn bits(volume: &BrickVolume) -> Vec<(BrickIndex, Vec<u32>)> {
    volume.iter().map(|(at, brick)| (at, brick.r.iter().chain(&brick.w).map(|x| x.to_bits()).collect())).collect()
}

/// The grid of all bricks, one brick wider than the seen voxels.
fn grid_around(volume: &BrickVolume, spacing: f64) -> (Grid, [i64; 3]) {
    let (low, high) = volume.seen_bounds().expect("something was seen");
    let low = low.map(|x| x - 4);
    let size = [0, 1, 2].map(|a| (high[a] + 4 - low[a] + 1) as u64);
    let origin = DVec3::from_array(low.map(|x| x as f64)) * spacing;
    (Grid { origin, spacing: DVec3::splat(spacing), direction: DMat3::IDENTITY, size }, low)
}

/// Voxels of a grid with their lattice indices.
fn voxels(grid: &Grid, low: [i64; 3]) -> impl Iterator<Item = (usize, [i64; 3])> {
    let [nx, ny, nz] = grid.size.map(|n| n as usize);
    (0..nx * ny * nz)
        .map(move |i| (i, [low[0] + (i % nx) as i64, low[1] + (i / nx % ny) as i64, low[2] + (i / nx / ny) as i64]))
}

#[test]
fn fast_path_matches_equations_within_deviation() {
    // One node per pixel, several pixels per node, several nodes per pixel.
    let cases = [
        (Method::Gaussian, 0.25, [1.0; 2]),
        (Method::GaussianTruncated, 0.25, [1.0; 2]),
        (Method::Gaussian, 0.08, [3.0; 2]),
        (Method::Gaussian, 0.7, [1.0 / 3.0; 2]),
        (Method::BSpline3, 0.25, [0.5; 2]),
        (Method::BSpline3, 0.08, [2.0; 2]),
        (Method::Linear, 0.25, [1.0; 2]),
        (Method::Linear, 0.7, [1.0; 2]),
        (Method::Nearest, 0.25, [1.0; 2]),
    ];
    for (method, pixel_mm, step) in cases {
        let blobs = Scene::Blobs(phantom::scene::Blobs::draw(3));
        let scan = scan_of_pixels(pixel_mm, blobs, 6, 6.0, Depth::U8);
        let mut fast = Reconstructor::new(Settings { method, ..settings() }, fan()).unwrap();
        for i in 0..scan.frames() {
            fast.insert(&scan.slice(i)).unwrap();
        }
        let (grid, low) = grid_around(fast.volume(), 0.5);
        let mut slow = Reference::new(grid);
        for i in 0..scan.frames() {
            slow.insert(&scan.slice(i), &fan(), fast.kernels().unwrap());
        }
        let (steps, deviation) = fast.decimation().unwrap();
        assert!(deviation <= 0.002 && steps == step, "{method:?} {pixel_mm}: {steps:?} {deviation}");
        let (mut seen, mut differ) = (0, 0);
        for (i, voxel) in voxels(&grid, low) {
            let (r, w) = fast.volume().voxel(voxel);
            // Either may omit a voxel at the edge of the support or of the certainty.
            if (f64::from(w) - slow.w[i]).abs() > 1e-3 + 2.0 * deviation * slow.w[i] {
                differ += 1;
                continue;
            }
            assert!((f64::from(r) - slow.r[i]).abs() <= 1.1 * deviation * 255.0 * 4.0 + 1e-3, "{voxel:?}");
            if let Some(value) = slow.value(i).filter(|_| slow.w[i] > 0.05 && w > SEEN) {
                seen += 1;
                let error = (f64::from(r / w) - value).abs();
                // At the threshold the weight is a fifth: five times the relative error.
                assert!(error <= 5.0 * 2.0 * deviation * 255.0, "{voxel:?}: {error}");
            }
        }
        assert!(seen > 500, "{seen}");
        assert!(differ * 100 < seen, "{differ} of {seen} voxels are seen by one of the two only");
    }
}

/// Worst distance of the seen voxels' values from a constant, in ulp of the constant.
fn worst_ulp(volume: &BrickVolume, constant: f32) -> (f32, usize) {
    let ulp = f32::from_bits(constant.to_bits() + 1) - constant;
    let mut seen = 0;
    let mut worst = 0.0_f32;
    for (_, brick) in volume.iter() {
        for (r, w) in brick.r.iter().zip(&brick.w).filter(|(_, w)| **w > SEEN) {
            seen += 1;
            worst = worst.max((r / w - constant).abs() / ulp);
        }
    }
    (worst, seen)
}

#[test]
fn constant_stays_constant_to_border_of_fan() {
    // Full mantissas as f32, integers as u8, one just below a power of two. The bound on added
    // rounding errors is 4√n·2⁻²⁴; for four slices four units do.
    let values = [(77.3, Depth::F32), (200.0, Depth::U8), (255.0, Depth::U8), (0.1, Depth::F32)];
    for (slices, constant, depth) in [4, 10].into_iter().flat_map(|n| values.map(|(c, d)| (n, c, d))) {
        for mask in [fan(), Mask::full(72, 60)] {
            let mut r = Reconstructor::new(settings(), mask).unwrap();
            let scan = scan(Scene::Constant(constant), slices, 0.0, depth);
            for i in 0..scan.frames() {
                r.insert(&scan.slice(i)).unwrap();
            }
            let constant = constant as f32;
            let (worst, seen) = worst_ulp(r.volume(), constant);
            let ulp = f32::from_bits(constant.to_bits() + 1) - constant;
            let sums = 4.0 * (slices as f32).sqrt() * 2.0_f32.powi(-24) * constant / ulp;
            assert!(seen > 7_000, "{seen}");
            assert!(worst <= if slices > 4 { sums } else { 4.0 }, "{constant}, {slices} slices: {worst} ulp");
        }
    }
}

#[test]
fn constant_over_many_slices_within_rounding() {
    let mut r = Reconstructor::new(Settings { max_weight: 1e6, ..settings() }, fan()).unwrap();
    let scan = scan(Scene::Constant(77.3), 2, 0.0, Depth::F32);
    let n = 400;
    for i in 0..n {
        // Nearly the same pose, so that every voxel adds all of them.
        let mut slice = scan.slice(0);
        let shift = DAffine3::from_translation(DVec3::splat(1e-4 * f64::from(i)));
        slice.world_from_image = Transform::from_affine(shift * slice.world_from_image.affine());
        r.insert(&slice).unwrap();
    }
    let (worst, seen) = worst_ulp(r.volume(), 77.3);
    let relative = worst * (f32::from_bits(77.3_f32.to_bits() + 1) - 77.3) / 77.3;
    assert!(seen > 5_000);
    assert!(relative <= 4.0 * (n as f32).sqrt() * 2.0_f32.powi(-24), "{relative}");
}

/// 24 mm of parallel f32 slices across the scene, in voxels of 0.5 mm.
fn parallel(scene: Scene, gap_mm: f64, sigma: [f64; 3], support: [Option<Support>; 2]) -> Reconstructor {
    let scan = Scan::new(ScanSettings {
        scene,
        motion: Motion::Parallel,
        frames: (24.0 / gap_mm) as u32,
        gap_mm,
        image_size: [120, 120],
        pixel_mm: [0.2, 0.2],
        noise_sd: 0.0,
        depth: Depth::F32,
        fan: None,
        ..ScanSettings::default()
    })
    .unwrap();
    let settings = Settings { sigma_mm: sigma.map(Some), support, ..settings() };
    let mut r = Reconstructor::new(settings, Mask::full(120, 120)).unwrap();
    for i in 0..scan.frames() {
        r.insert(&scan.slice(i)).unwrap();
    }
    r
}

/// Seen voxels whose world position satisfies a test, with their values.
fn values(r: &Reconstructor, within: impl Fn(DVec3) -> bool) -> Vec<(DVec3, f64)> {
    let (grid, low) = grid_around(r.volume(), r.settings().spacing_mm.x);
    voxels(&grid, low)
        .filter_map(|(_, voxel)| {
            let (value, weight) = r.volume().voxel(voxel);
            let at = r.world_from_lattice().point(DVec3::from_array(voxel.map(|x| x as f64)));
            (weight > SEEN && within(at)).then(|| (at, f64::from(value / weight)))
        })
        .collect()
}

#[test]
fn ramp_reproduced_without_shift() {
    let scene = Scene::standard_ramp();
    let r = parallel(scene.clone(), 0.3, [0.4, 0.4, 0.5], [None; 2]);
    let inside = values(&r, |p| p.abs().max_element() < 8.0);
    assert!(inside.len() > 20_000);
    let bias = inside.iter().map(|(p, value)| value - scene.value(*p)).sum::<f64>() / inside.len() as f64;
    let slope = (scene.value(DVec3::X) - scene.value(DVec3::ZERO))
        .abs()
        .max((scene.value(DVec3::Y) - scene.value(DVec3::ZERO)).abs());
    let worst = inside.iter().map(|(p, value)| (value - scene.value(*p)).abs()).fold(0.0, f64::max);
    // Half a pixel (0.1 mm) would show as a tenth of the slope per mm, thirty times this.
    assert!(bias.abs() < 0.003 * slope && worst < 0.05 * slope, "bias {bias}, worst {worst}, slope {slope} per mm");
}

#[test]
fn blobs_blurred_by_effective_kernel() {
    let mut blobs = phantom::scene::Blobs::draw(5);
    blobs.sphere = None;
    let scene = Scene::Blobs(blobs);
    let r = parallel(scene.clone(), 0.3, [0.5, 0.7, 0.9], [None; 2]);
    let kernels = r.kernels().unwrap();
    let frame = Scan::new(ScanSettings { motion: Motion::Parallel, frames: 3, ..ScanSettings::default() }).unwrap();
    let axes = frame.world_from_image(1).affine().matrix3;
    let columns = [axes.x_axis.normalize(), axes.y_axis.normalize(), axes.x_axis.cross(axes.y_axis).normalize()];
    let turn = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let variances = DVec3::from_array(kernels.map(|k| k.sigma_effective_mm().powi(2)));
    let covariance = turn * DMat3::from_diagonal(variances) * turn.transpose();
    let inside = values(&r, |p| p.abs().max_element() < 8.0);
    let range = inside.iter().fold((f64::MAX, f64::MIN), |(l, h), (_, v)| (l.min(*v), h.max(*v)));
    let worst =
        inside.iter().map(|(p, value)| (value - scene.blurred(*p, &covariance).unwrap()).abs()).fold(0.0, f64::max);
    let sharp = inside.iter().map(|(p, value)| (value - scene.value(*p)).abs()).fold(0.0, f64::max);
    let size = range.1 - range.0;
    assert!(worst < 0.01 * size, "{worst} of {size}");
    assert!(sharp > 3.0 * worst, "the test must tell blurred from sharp: {sharp} against {worst}");
}

#[test]
fn sphere_matches_closed_form_for_isotropic_kernel() {
    // A hard edge would test the sampling of a step by the pixels of 0.2 mm.
    let Scene::Sphere(sphere) = Scene::standard_sphere() else { unreachable!() };
    let scene = Scene::Sphere(Sphere { centre: DVec3::new(0.3, -0.2, 0.1), radius: 6.0, edge_sigma: 0.3, ..sphere });
    // The energy criterion makes the supports in and off the plane equal.
    let r = parallel(scene.clone(), 0.2, [0.8; 3], [Some(Support::Energy(1e-4)); 2]);
    let sigma = r.kernels().unwrap()[0].sigma_effective_mm();
    let covariance = DMat3::from_diagonal(DVec3::splat(sigma * sigma));
    let step = (scene.value(DVec3::ZERO) - scene.value(DVec3::splat(11.0))).abs();
    let inside = values(&r, |p| p.abs().max_element() < 8.0);
    let worst = inside.iter().map(|(p, v)| (v - scene.blurred(*p, &covariance).unwrap()).abs()).fold(0.0, f64::max);
    assert!(worst < 0.01 * step, "{worst} of {step}");
}

#[test]
fn repeated_image_at_same_pose_adds_nothing() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(1)), 3, 6.0, Depth::U8);
    let mut r = Reconstructor::new(settings(), fan()).unwrap();
    r.insert(&scan.slice(0)).unwrap();
    let (before, work) = (bits(r.volume()), r.work());
    let mut again = scan.slice(0);
    again.time_ns += 33_000_000;
    assert_eq!(r.insert(&again), Err(Refused::Repeated));
    assert!(bits(r.volume()) == before && r.work() == work, "no voxel changed and no work was done");
    // Changes outside the scanner's image do not count; inside, one grey level does.
    let changed = |inside: bool| {
        let (data, (width, height)) = (fan(), (again.image.width(), again.image.height()));
        let bounds = data.bounds().unwrap();
        let mut pixels: Vec<u8> = match again.image.pixels() {
            Pixels::U8(pixels) => pixels.to_vec(),
            _ => unreachable!("a scan of 8 bits"),
        };
        let at = match inside {
            true => (0..width * height).find(|at| data.contains(at % width, at / width)).unwrap(),
            false => (0..width * bounds.y).next().unwrap(),
        };
        pixels[at as usize] ^= 1;
        Slice { image: Image::new(width, height, Pixels::U8(pixels.into())), ..again.clone() }
    };
    assert_eq!(r.insert(&changed(false)), Err(Refused::Repeated));
    assert!(r.insert(&changed(true)).is_ok());
    // New pixels at the same pose, or the same pixels at a new pose, count as new.
    let mut other = scan.slice(1);
    other.world_from_image = again.world_from_image;
    assert!(r.insert(&other).is_ok());
}

#[test]
fn refused_slices_change_nothing() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(1)), 3, 6.0, Depth::U8);
    let mut r = Reconstructor::new(settings(), fan()).unwrap();
    r.insert(&scan.slice(0)).unwrap();
    let (before, work) = (bits(r.volume()), r.work());
    let good = scan.slice(1);
    let posed = |affine: DAffine3| Slice { world_from_image: Transform::from_affine(affine), ..good.clone() };
    let pose = good.world_from_image.affine();
    let flat = DMat3::from_cols(pose.matrix3.x_axis, pose.matrix3.x_axis * 2.0, pose.matrix3.z_axis);
    let small = Image::new(2, 2, Pixels::U8(Arc::from([1_u8, 2, 3, 4])));
    type Expected = fn(&Refused) -> bool;
    let cases: [(Slice, Expected); 5] = [
        (Slice { image: small, ..good.clone() }, |e| matches!(e, Refused::Size { found: [2, 2], expected: [72, 60] })),
        (posed(DAffine3 { translation: DVec3::new(f64::NAN, 0.0, 0.0), ..pose }), |e| matches!(e, Refused::Degenerate)),
        (posed(DAffine3 { matrix3: flat, ..pose }), |e| matches!(e, Refused::Degenerate)),
        (posed(DAffine3 { translation: DVec3::splat(1e12), ..pose }), |e| matches!(e, Refused::OutOfRange)),
        (posed(DAffine3::from_scale(DVec3::splat(1e-3)) * pose), |e| matches!(e, Refused::Settings(_))),
    ];
    for (slice, expected) in cases {
        let error = r.insert(&slice).unwrap_err();
        assert!(expected(&error), "{error}");
        assert!(bits(r.volume()) == before && r.work() == work, "{error}");
    }
    assert!(r.insert(&good).is_ok(), "a good slice still enters");
}

#[test]
fn memory_limit_kept_and_named() {
    let scan = scan(Scene::Constant(9.0), 3, 0.0, Depth::U8);
    let mut r = Reconstructor::new(Settings { memory_bytes: 10 * 4096, ..settings() }, fan()).unwrap();
    assert!(r.insert(&scan.slice(0)).is_err_and(|e| e.to_string().contains("40960 bytes")));
    assert!(r.volume().is_empty());
    let fine = Settings { memory_bytes: 1 << 20, ..Settings::new(DVec3::splat(1e-3)) };
    let mut r = Reconstructor::new(Settings { sigma_mm: [Some(0.3); 3], ..fine }, fan()).unwrap();
    assert!(matches!(r.insert(&scan.slice(0)), Err(Refused::Memory { .. })));
    assert!(r.volume().is_empty());
}

#[test]
fn memory_follows_scanned_region() {
    let scan = scan(Scene::Constant(9.0), 40, 0.0, Depth::U8);
    let mut r = Reconstructor::new(settings(), fan()).unwrap();
    for i in 0..scan.frames() {
        let mut slice = scan.slice(i);
        // Every other slice a kilometre away.
        let far = DAffine3::from_translation(DVec3::splat(if i % 2 == 0 { 0.0 } else { 1e6 }));
        slice.world_from_image = Transform::from_affine(far * slice.world_from_image.affine());
        r.insert(&slice).unwrap();
    }
    let voxels = r.volume().len() as u64 * 512;
    assert!(r.volume().bytes() <= 12 * voxels, "{} bytes for {voxels} voxels", r.volume().bytes());
    let empty = r.volume().iter().filter(|(_, brick)| brick.w.iter().all(|w| *w == 0.0)).count();
    assert_eq!(empty, 0, "a brick is made for a voxel that gains weight, and for no other reason");
}

#[test]
fn far_away_world_changes_only_indices() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(2)), 4, 6.0, Depth::U8);
    let run = |shift: f64| {
        let mut r = Reconstructor::new(settings(), fan()).unwrap();
        for i in 0..scan.frames() {
            let mut slice = scan.slice(i);
            let moved = DAffine3::from_translation(DVec3::splat(shift)) * slice.world_from_image.affine();
            slice.world_from_image = Transform::from_affine(moved);
            r.insert(&slice).unwrap();
        }
        r
    };
    let near = run(0.0);
    for shift in [1024.0, 1_048_576.0] {
        let far = run(shift);
        let offset = (shift / 0.5) as i64;
        let mut worst = 0.0_f32;
        let (grid, low) = grid_around(near.volume(), 0.5);
        for (_, voxel) in voxels(&grid, low) {
            let (r0, w0) = near.volume().voxel(voxel);
            let (r1, w1) = far.volume().voxel(voxel.map(|x| x + offset));
            if w0 > 0.05 && w1 > 0.05 {
                worst = worst.max((r0 / w0 - r1 / w1).abs());
            }
        }
        // Rounding of the poses themselves: 1e6 mm leaves 1e-10 mm.
        assert!(worst < 1e-2, "{worst} at {shift} mm");
    }
}

#[test]
fn clamped_weight_lets_mean_move() {
    let mut r = Reconstructor::new(Settings { max_weight: 8.0, ..settings() }, fan()).unwrap();
    let dark = scan(Scene::Constant(10.0), 1, 0.0, Depth::U8).slice(0);
    let bright = scan(Scene::Constant(200.0), 1, 0.0, Depth::U8).slice(0);
    let shifted = |slice: &Slice, i: i32| Slice {
        world_from_image: Transform::from_affine(
            DAffine3::from_translation(DVec3::splat(1e-6 * f64::from(i))) * slice.world_from_image.affine(),
        ),
        ..slice.clone()
    };
    for i in 0..40 {
        r.insert(&shifted(&dark, i)).unwrap();
    }
    let clamped = r.work().weights_clamped;
    assert!(clamped > 0);
    for i in 0..60 {
        r.insert(&shifted(&bright, -i)).unwrap();
    }
    let heaviest = r.volume().iter().flat_map(|(_, b)| b.w).fold(0.0, f32::max);
    let most = (8.0 * r.kernels().unwrap()[2].peak()) as f32;
    assert_eq!(heaviest, most);
    // In the slice's plane each insert weighs almost 1 of 8: sixty leave e⁻⁷ of the old value.
    let brightest =
        r.volume().iter().flat_map(|(_, b)| b.r.into_iter().zip(b.w)).map(|(r, w)| r / w).fold(0.0, f32::max);
    assert!(brightest > 199.5, "{brightest}");
}

#[test]
fn masked_pixels_and_untouched_bricks_are_free() {
    let scan = scan(Scene::Constant(50.0), 1, 0.0, Depth::U8);
    let run = |mask: Mask| {
        let mut r = Reconstructor::new(settings(), mask).unwrap();
        let touched = r.insert(&scan.slice(0)).unwrap();
        (r.work(), touched, r.volume().len())
    };
    let (whole, _, bricks) = run(Mask::full(72, 60));
    let (boxed, touched, boxed_bricks) = run(Mask::rect(72, 60, ClipRect::new(30, 25, 12, 10).unwrap()));
    assert_eq!((whole.filter.pixels, boxed.filter.pixels), (72 * 60, 120));
    assert!(boxed.filter.taps * 5 < whole.filter.taps, "{boxed:?} against {whole:?}");
    assert!(boxed_bricks * 4 < bricks && boxed.bricks_considered * 4 < whole.bricks_considered);
    assert_eq!(touched.bricks.len(), boxed_bricks, "bricks made, bricks touched");
    assert_eq!(touched.voxels, boxed.voxels_updated);
    // A slab 5 mm thick in voxels of 0.5 mm: tiles at its faces are sampled in part only.
    assert!(whole.voxels_sampled < 2 * whole.voxels_updated, "{whole:?}");
    // 18 × 15 mm of image, each border grown by 0.84 σ, 2 × 2.576 mm thick.
    let expected = (18.0 + 2.0 * 0.316) * (15.0 + 2.0 * 0.316) * 2.0 * 2.576 / 0.125;
    assert!((whole.voxels_updated as f64 / expected - 1.0).abs() < 0.03, "{} against {expected}", whole.voxels_updated);
}

#[test]
fn touched_bricks_are_those_that_changed() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(1)), 5, 6.0, Depth::U8);
    let mut r = Reconstructor::new(settings(), fan()).unwrap();
    let mut before = bits(r.volume());
    for i in 0..scan.frames() {
        let touched = r.insert(&scan.slice(i)).unwrap();
        let after = bits(r.volume());
        let mut changed: Vec<_> =
            after.iter().enumerate().filter(|(k, brick)| before.get(*k) != Some(brick)).map(|(_, b)| b.0).collect();
        changed.sort_by_key(|[x, y, z]| [*z, *y, *x]);
        assert_eq!(touched.bricks, changed, "slice {i}");
        before = after;
    }
}

#[test]
fn slabs_at_any_angle_lose_no_voxel() {
    let image = Image::new(40, 40, Pixels::U8(Arc::from(vec![100_u8; 1600])));
    let mut counts = Vec::new();
    for (turn, tilt) in [(0.0, 0.0), (0.0, 1e-12), (0.3, 0.7), (1.1, 0.2), (0.615_479_7, std::f64::consts::FRAC_PI_4)] {
        let rotation = DQuat::from_euler(EulerRot::YXZ, turn, tilt, 0.0);
        let centre =
            DAffine3::from_translation(DVec3::new(-5.0, -5.0, 0.0)) * DAffine3::from_scale(DVec3::new(0.25, 0.25, 1.0));
        let slice = Slice {
            image: image.clone(),
            time_ns: 0,
            world_from_image: Transform::from_affine(DAffine3::from_quat(rotation) * centre),
        };
        // A support of exactly four voxels puts whole planes of voxels on its end.
        let settings = Settings {
            sigma_mm: [Some(0.4), Some(0.4), Some(1.0)],
            support: [Some(Support::Peak((-2.0_f64).exp())); 2],
            method: Method::GaussianTruncated,
            ..settings()
        };
        let mut r = Reconstructor::new(settings, Mask::full(40, 40)).unwrap();
        let touched = r.insert(&slice).unwrap();
        let (grid, _) = grid_around(r.volume(), 0.5);
        // Between the counts for a slab slightly thinner and slightly thicker.
        let [least, most] = [1.0 - 1e-5, 1.0 + 1e-5].map(|hair| {
            let mut kernels = *r.kernels().unwrap();
            kernels[2].support_mm *= hair;
            let mut reference = Reference::new(grid);
            reference.insert(&slice, &Mask::full(40, 40), &kernels);
            reference.w.iter().filter(|w| **w > 0.0).count() as f64
        });
        counts.push(touched.voxels);
        // A voxel at the threshold of certainty may fall either way.
        let voxels = touched.voxels as f64;
        assert!(voxels >= 0.995 * least && voxels <= 1.005 * most, "{turn} {tilt}: {voxels} not in {least}..{most}");
    }
    // If the pose is exact, f32 keeps |q| = 2 exactly: the support includes its end.
    assert_eq!(counts[0], counts[1]);
    assert_eq!(counts[0] % 9, 0, "nine planes of voxels, −4 to 4, in {}", counts[0]);
}

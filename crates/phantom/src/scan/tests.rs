//! Painted frames, their noise, and the records of a tracker.

use super::*;

fn small(change: impl FnOnce(&mut ScanSettings)) -> Scan {
    let mut settings =
        ScanSettings { frames: 12, image_size: [90, 70], pixel_mm: [0.5, 0.6], ..ScanSettings::default() };
    change(&mut settings);
    Scan::new(settings).unwrap()
}

fn values(slice: &Slice) -> Vec<f64> {
    match slice.image.pixels() {
        Pixels::U8(p) => p.iter().map(|x| f64::from(*x)).collect(),
        Pixels::U16(p) => p.iter().map(|x| f64::from(*x)).collect(),
        Pixels::F32(p) => p.iter().map(|x| f64::from(*x)).collect(),
    }
}

#[test]
fn ramp_pixel_equals_scene_at_its_centre() {
    let scan = small(|s| (s.scene, s.noise_sd, s.depth) = (Scene::standard_ramp(), 0.0, Depth::F32));
    let Scene::Ramp(ramp) = scan.settings().scene else { panic!("a ramp") };
    for frame in [0, 7] {
        let slice = scan.slice(frame);
        let grey = values(&slice);
        for (i, j) in [(0, 0), (89, 0), (0, 69), (41, 23)] {
            // The middle of the image is pixel (44.5, 34.5); its pose is the trajectory's.
            let mm = DVec3::new((i as f64 - 44.5) * 0.5, (j as f64 - 34.5) * 0.6, 0.0);
            let world = scan.trajectory.world_from_picture(frame).point(mm);
            let expected = ramp.at_origin + ramp.gradient.dot(world);
            assert!((grey[j * 90 + i] - expected).abs() < 1e-5);
            let posed = slice.world_from_image.point(DVec3::new(i as f64, j as f64, 0.0));
            assert!(posed.distance(world) < 1e-12);
        }
    }
}

#[test]
fn noise_has_its_deviation_and_no_correlation() {
    let scan = small(|s| {
        (s.scene, s.noise_sd, s.depth) = (Scene::Constant(100.0), 6.0, Depth::F32);
        (s.image_size, s.frames) = ([400, 300], 2);
    });
    let [a, b] = [0, 1].map(|f| values(&scan.slice(f)).iter().map(|x| x - 100.0).collect::<Vec<_>>());
    let mean_product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>() / x.len() as f64;
    // 120 000 samples: a correlation's standard error is 0.0029, a deviation's 0.2 %.
    assert!((mean_product(&a, &a).sqrt() / 6.0 - 1.0).abs() < 0.01);
    assert!(a.iter().sum::<f64>().abs() / 120_000.0 < 0.09);
    for (what, product) in [
        ("neighbours in u", mean_product(&a[..119_999], &a[1..])),
        ("neighbours in v", mean_product(&a[..119_600], &a[400..])),
        ("frames", mean_product(&a, &b)),
    ] {
        assert!((product / 36.0).abs() < 0.0145, "{what}: {product}");
    }
}

#[test]
fn rounding_is_to_nearest_and_clips() {
    for (grey, expected) in [(99.5, 100.0), (99.49, 99.0), (-3.0, 0.0), (300.0, 255.0)] {
        let scan = small(|s| (s.scene, s.noise_sd) = (Scene::Constant(grey), 0.0));
        assert!(values(&scan.slice(0)).iter().all(|x| *x == expected), "{grey}");
    }
}

#[test]
fn frames_depend_on_seed_but_not_on_order_or_threads() {
    let scan = small(|_| ());
    let reference: Vec<Slice> = (0..12).map(|f| scan.slice(f)).collect();
    let backwards: Vec<Slice> = (0..12).rev().map(|f| scan.slice(f)).collect();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let all = pool.install(|| scan.slices(0..12));
        for (frame, slice) in all.iter().enumerate() {
            assert!(slice.image.pixels().same_bits(reference[frame].image.pixels()));
            assert!(slice.image.pixels().same_bits(backwards[11 - frame].image.pixels()));
            assert_eq!(slice.world_from_image, reference[frame].world_from_image);
        }
    }
    let other = small(|s| s.seed = 2);
    assert!(!other.slice(3).image.pixels().same_bits(reference[3].image.pixels()));
    assert_ne!(other.world_from_image(3), scan.world_from_image(3));
    assert_ne!(Blobs::draw(1), Blobs::draw(2));
}

#[test]
fn standard_scan_digest_is_unchanged() {
    // Digest of one small frame: it changes with the draws or an elementary function, on any
    // machine.
    use sha2::Digest;
    let Pixels::U8(pixels) = small(|_| ()).slice(5).image.pixels().clone() else { panic!("8 bits") };
    let digest: String = sha2::Sha256::digest(&pixels).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(&digest[..16], "07a487165329c465");
}

#[test]
fn recorded_transforms_combine_to_slice_pose() {
    let scan = small(|s| (s.first_ns, s.interval_ns) = (5_000_000_000, 50_000_000));
    let mut references = Vec::new();
    for frame in 0..12 {
        let tracked = scan.tracked(frame);
        let tracker_from_probe = Transform::<Tracker, Probe>::from_rows(&tracked.probe_to_tracker).unwrap();
        let tracker_from_world = Transform::<Tracker, World>::from_rows(&tracked.reference_to_tracker).unwrap();
        let combined = tracker_from_world.inverse() * tracker_from_probe * scan.probe_from_image();
        for (a, b) in combined.to_rows().iter().zip(tracked.image_to_reference) {
            assert!((a - b).abs() < 1e-10, "{a} {b}");
        }
        for rigid in [tracker_from_probe.affine().matrix3, tracker_from_world.affine().matrix3] {
            let gram = rigid.transpose() * rigid - DMat3::IDENTITY;
            assert!(gram.to_cols_array().iter().all(|x| x.abs() < 1e-13));
        }
        assert_eq!(tracked.image_to_reference, scan.slice(frame).world_from_image.to_rows());
        assert!((tracked.timestamp_s - (5.0 + 0.05 * f64::from(frame))).abs() < 1e-9);
        references.push(tracked.reference_to_tracker);
    }
    assert_ne!(references[0], references[11], "the patient breathes");
}

#[test]
fn fan_keeps_sector_and_noise() {
    let fan = convex_fan([90, 70]).unwrap();
    let (masked, whole) = (small(|s| s.fan = Some(fan)), small(|_| ()));
    let mask = masked.mask();
    assert!(whole.mask().is_full());
    let (a, b) = (values(&masked.slice(2)), values(&whole.slice(2)));
    for k in 0..a.len() {
        let data = mask.contains((k % 90) as u32, (k / 90) as u32);
        assert_eq!(a[k], if data { b[k] } else { 0.0 });
        let x = (k % 90) as f64 - 44.5;
        let y = (k / 90) as f64 + 14.0;
        let expected = x.atan2(y).to_degrees().abs() <= 35.0 && (18.2..=83.0).contains(&x.hypot(y));
        assert_eq!(data, expected, "pixel {k}");
    }
    let share = mask.area() as f64 / a.len() as f64;
    assert!((0.3..0.9).contains(&share), "{share}");
}

#[test]
fn invalid_scan_settings_are_refused() {
    let refuse = |change: fn(&mut ScanSettings)| {
        let mut settings = ScanSettings::default();
        change(&mut settings);
        Scan::new(settings).unwrap_err().to_string()
    };
    for error in [
        refuse(|s| s.image_size = [0, 10]),
        refuse(|s| s.image_size = [u32::MAX, u32::MAX]),
        refuse(|s| s.pixel_mm = [0.1, f64::INFINITY]),
        refuse(|s| s.noise_sd = -1.0),
        refuse(|s| s.frames = 0),
        refuse(|s| s.fan = Some(Fan::new([0.0, -900.0], [3.0, 9.0], [-30.0, 30.0]).unwrap())),
    ] {
        assert!(error.len() > 30, "{error}");
    }
    assert!(convex_fan([9, 1]).is_err(), "a line has no room for an arc");
}

#[test]
fn tracker_noise_has_stated_deviation_and_moves_no_pixel() {
    let noise = TrackerNoise { position_mm: 0.5, rotation_degrees: 0.5 };
    let (noisy, clean) = (
        small(|s| (s.tracker_noise, s.frames, s.gap_mm) = (noise, 4000, 0.01)),
        small(|s| (s.frames, s.gap_mm) = (4000, 0.01)),
    );
    let (mut shifts, mut turns, mut sums) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    let middle = DVec3::new(44.5, 34.5, 0.0);
    for frame in 0..4000 {
        let (recorded, truth) = (noisy.world_from_image(frame), noisy.true_world_from_image(frame));
        assert_eq!(truth, clean.true_world_from_image(frame));
        assert_eq!(truth, clean.world_from_image(frame));
        let shift = recorded.point(middle) - truth.point(middle);
        let turn =
            (noisy.trajectory.world_from_picture(frame).inverse() * noisy.recorded_world_from_picture(frame)).affine();
        let m = turn.matrix3;
        // The antisymmetric part: sin of the angle about each axis.
        let about = 0.5 * DVec3::new(m.y_axis.z - m.z_axis.y, m.z_axis.x - m.x_axis.z, m.x_axis.y - m.y_axis.x);
        let gram = m.transpose() * m - DMat3::IDENTITY;
        assert!(gram.to_cols_array().iter().all(|x| x.abs() < 1e-13));
        (shifts, turns, sums) = (shifts + shift * shift, turns + about * about, sums + shift);
    }
    let root = |sums: DVec3| (sums / 4000.0).map(f64::sqrt);
    // A deviation's standard error is 1.1 %.
    assert!((root(shifts) / 0.5 - 1.0).abs().max_element() < 0.05, "{}", root(shifts));
    assert!((root(turns) / 0.5_f64.to_radians() - 1.0).abs().max_element() < 0.05, "{}", root(turns));
    assert!((sums / 4000.0).abs().max_element() < 0.04);
    assert!(noisy.slice(7).image.pixels().same_bits(clean.slice(7).image.pixels()));
    assert_eq!(noisy.slice(7).world_from_image, noisy.world_from_image(7));
    assert_ne!(noisy.slice(7).world_from_image, clean.slice(7).world_from_image);
    assert_eq!(noisy.tracked(7).image_to_reference, noisy.world_from_image(7).to_rows());
    assert_eq!(noisy.grid(DVec3::ONE, 0.0), clean.grid(DVec3::ONE, 0.0));
    for position_mm in [-0.1, f64::NAN, 11.0] {
        let settings = ScanSettings { tracker_noise: TrackerNoise { position_mm, ..noise }, ..ScanSettings::default() };
        assert!(Scan::new(settings).unwrap_err().to_string().contains("tracker's noise"));
    }
}

#[test]
fn moving_scene_is_painted_at_frame_time() {
    use crate::scene::Pulsating;
    let scan = small(|s| {
        (s.scene, s.motion, s.noise_sd) = (Scene::Pulsating(Pulsating::standard()), Motion::Dwell { frames: 11 }, 0.0);
        (s.interval_ns, s.pixel_mm) = (250_000_000, [0.5; 2]);
    });
    for (frame, radius) in [(0, 10.0_f64), (1, 12.0), (2, 10.0), (3, 8.0), (4, 10.0)] {
        let inside = values(&scan.slice(frame)).iter().filter(|v| **v == 180.0).count() as f64;
        let area = std::f64::consts::PI * radius * radius / 0.25;
        assert!((inside / area - 1.0).abs() < 0.02, "{frame}: {inside} {area}");
    }
}

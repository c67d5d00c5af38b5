//! Tests of decay: against the equations and its own laws, and the shift of a sweep in each
//! mode.

use phantom::scene::{Blobs, Ramp};
use volume::Voxels;

use super::super::decay::LEAST_TOUCH;
use super::*;
use crate::Decay;

const SECOND: i64 = 1_000_000_000;

const MODES: [Decay; 3] = [
    Decay::Exponential { rate_per_s: 0.7 },
    Decay::DeadTime { rate_per_s: 0.7, wait_s: 1.5 },
    Decay::PaperLiteral { rate_per_s: 0.7, wait_s: 0.25 },
];

fn reconstructor(decay: Decay, change: impl FnOnce(&mut Settings)) -> Reconstructor {
    let mut settings = Settings { compounding: Compounding::Decay(decay), ..settings() };
    change(&mut settings);
    Reconstructor::new(settings, fan()).unwrap()
}

/// Slices of a freehand scan at uneven times: close together, after pauses of seconds and
/// minutes, and out of order.
fn slices() -> Vec<Slice> {
    let scan = scan(Scene::Blobs(Blobs::draw(3)), 10, 6.0, Depth::U8);
    let at_s = [0.0, 0.03, 0.5, 2.0, 1.9, 4.0, 64.0, 64.1, 68.0, 69.7];
    let timed = |(i, s): (u32, f64)| Slice { time_ns: (s * 1e9) as i64, ..scan.slice(i) };
    (0..).zip(at_s).map(timed).collect()
}

#[test]
fn every_mode_matches_equations() {
    for decay in MODES {
        // No clamp, since the equations have none.
        let mut fast = reconstructor(decay, |s| s.max_weight = 1e6);
        let slices = slices();
        for slice in &slices {
            fast.insert(slice).unwrap();
        }
        assert_eq!((fast.work().times_backwards, fast.work().times_absurd), (1, 0));
        let (grid, low) = grid_around(fast.volume(), 0.5);
        let mut slow = Reference::compounding(grid, Compounding::Decay(decay));
        for slice in &slices {
            slow.insert(slice, &fan(), fast.kernels().unwrap());
        }
        let deviation = fast.decimation().unwrap().1;
        let (mut seen, mut differ) = (0, 0);
        for (i, voxel) in voxels(&grid, low) {
            let (r, w) = fast.volume().voxel(voxel);
            let Some(value) = slow.value(i).filter(|_| w > SEEN) else {
                differ += i32::from(slow.value(i).is_some() != (w > SEEN));
                continue;
            };
            seen += 1;
            // Ages are rounded to ticks of 1/(2048·a). One slice that counts or does not, at
            // the edge of its support, changes more.
            let error = (f64::from(r / w) - value).abs();
            differ += i32::from(error > 255.0 * (10.0 * deviation + 1e-3));
        }
        assert!(seen > 5000 && differ * 100 < seen, "{decay:?}: {differ} of {seen}");
    }
}

#[test]
fn simd_and_threads_give_same_bits() {
    for decay in MODES {
        let run = |simd, threads| {
            let mut r = reconstructor(decay, |s| (s.simd, s.threads, s.max_weight) = (simd, threads, 1.5));
            let touched: Vec<_> = slices().iter().map(|s| r.insert(s).unwrap()).collect();
            (touched, bits(r.volume()), r.work())
        };
        let reference = run(Simd::Portable, 1);
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            for threads in [1, 2, 7] {
                assert!(run(simd, threads) == reference, "{decay:?}: {} with {threads} threads", simd.name());
            }
        }
    }
}

#[test]
fn nothing_decays_within_wait() {
    let slices = slices();
    let mut plain = Reconstructor::new(settings(), fan()).unwrap();
    let mut waiting = reconstructor(Decay::DeadTime { rate_per_s: 5.0, wait_s: 70.0 }, |_| ());
    for slice in &slices {
        plain.insert(slice).unwrap();
        waiting.insert(slice).unwrap();
    }
    let (grid, low) = grid_around(plain.volume(), 0.5);
    let mut compared = 0;
    for (_, voxel) in voxels(&grid, low) {
        let ((r0, w0), (r1, w1)) = (plain.volume().voxel(voxel), waiting.volume().voxel(voxel));
        // At most ten touches below the least are omitted.
        assert!(w1 <= w0 * (1.0 + 1e-6) && w0 - w1 <= 10.0 * LEAST_TOUCH, "{voxel:?}: {w0} {w1}");
        if w0 == w1 {
            assert_eq!(r0, r1);
            compared += 1;
        }
    }
    assert!(compared > 5000, "{compared}");
}

/// An image of one grey level at a time; the pose moves minutely, so that no image repeats.
fn touch(grey: f32, time_ns: i64, turn: u32) -> Slice {
    let image = Image::new(72, 60, Pixels::F32(Arc::from(vec![grey; 72 * 60])));
    let place = DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(0.25, 0.25, 1.0)),
        translation: DVec3::new(-9.0, -7.5, 1e-12 * f64::from(turn)),
    };
    Slice { image, time_ns, world_from_image: Transform::from_affine(place) }
}

#[test]
fn fading_independent_of_number_of_touches() {
    // Black touches add nothing to the numerator: it remains the first slice's, times all
    // factors.
    for (rate, span_s) in [(0.9, 10.0), (3.0, 30.0)] {
        for touches in [1_u32, 2, 10, 300, 1000] {
            let mut r = reconstructor(Decay::Exponential { rate_per_s: rate }, |_| ());
            r.insert(&touch(200.0, 0, 0)).unwrap();
            let before = f64::from(r.volume().voxel([0, 0, 0]).0);
            for k in 1..=touches {
                let time = span_s * f64::from(k) / f64::from(touches);
                r.insert(&touch(0.0, (time * 1e9).round() as i64, k)).unwrap();
            }
            let left = f64::from(r.volume().voxel([0, 0, 0]).0) / before;
            let expected = (-rate * span_s).exp();
            // At 90 times the rate nothing measurable remains; it must then stay zero and
            // finite.
            let error = (left / expected - 1.0).abs();
            assert!(error < 1e-5 || (expected < 1e-30 && left < 1e-12), "{rate} {touches}: {left} for {expected}");
        }
    }
}

#[test]
fn moving_forward_decay_base_keeps_mean() {
    // One brick lies under the slice for 100 s at a = 1/s, so its base moves twice; a voxel at
    // its far side is touched only at the beginning.
    let mut r = reconstructor(Decay::Exponential { rate_per_s: 1.0 }, |_| ());
    let tilted = |k: u32| {
        let mut slice = touch(40.0, i64::from(k) * SECOND, k);
        if k == 0 {
            slice.image = Image::new(72, 60, Pixels::F32(Arc::from(vec![171.0; 72 * 60])));
        } else {
            let lifted = DAffine3::from_translation(DVec3::Z * 3.5) * slice.world_from_image.affine();
            slice.world_from_image = Transform::from_affine(lifted);
        }
        slice
    };
    r.insert(&tilted(0)).unwrap();
    // Later slices reach down to 3.5 − 2.576 mm: voxels up to 0.5 mm, in the same bricks, have
    // only the first slice.
    for k in 1..=100 {
        r.insert(&tilted(k)).unwrap();
        let (low, high) = (r.volume().voxel([1, 1, 1]), r.volume().voxel([1, 1, 7]));
        assert!((low.0 / low.1 - 171.0).abs() < 171.0 * 1e-6 && low.1 > SEEN, "{low:?} after {k} s");
        assert!((high.0 / high.1 - 40.0).abs() < 40.0 * 1e-6 && high.1 > SEEN, "{high:?} after {k} s");
    }
}

#[test]
fn late_visit_replaces_older_values() {
    // The probe returns; the object has changed meanwhile.
    for (decay, bound) in [
        (Decay::DeadTime { rate_per_s: 1.0, wait_s: 2.0 }, (-(10.0_f64 - 2.0)).exp()),
        (Decay::Exponential { rate_per_s: 1.0 }, (-10.0_f64).exp()),
    ] {
        let mut r = reconstructor(decay, |_| ());
        r.insert(&touch(0.0, 0, 0)).unwrap();
        r.insert(&touch(100.0, 10 * SECOND, 1)).unwrap();
        for z in -4..=4 {
            let (sum, weight) = r.volume().voxel([0, 0, z]);
            let old = 1.0 - f64::from(sum / weight) / 100.0;
            assert!(old <= 1.005 * bound && old >= 0.9 * bound / (1.0 + bound), "{decay:?}: {old} against {bound}");
        }
    }
    // After a year nothing remains, and nothing is subnormal.
    let mut r = reconstructor(Decay::DeadTime { rate_per_s: 1e-3, wait_s: 2.0 }, |_| ());
    for k in 0..400_u32 {
        r.insert(&touch(100.0 * (k % 2) as f32, i64::from(k) * 86_000 * SECOND, k)).unwrap();
        for (_, brick) in r.volume().iter() {
            assert!(brick.r.iter().chain(&brick.w).all(|x| *x == 0.0 || x.is_normal()));
        }
    }
    let (sum, weight) = r.volume().voxel([0, 0, 0]);
    assert!((sum / weight - 100.0).abs() < 1e-4, "{sum} {weight}");
}

#[test]
fn no_time_step_ever_amplifies() {
    let mut times = vec![0, 0, -SECOND, 5, i64::MAX, i64::MIN, 0, 1_763_700_000 * SECOND, 3, i64::MAX - 1];
    times.extend((0..20).map(|k| (k * 7919 % 13) * SECOND / 10));
    for decay in MODES {
        let mut r = reconstructor(decay, |_| ());
        for (k, time) in (0..).zip(&times) {
            r.insert(&touch(100.0, *time, k)).unwrap();
            for (_, brick) in r.volume().iter() {
                for (sum, weight) in brick.r.iter().zip(&brick.w).filter(|(_, w)| **w > 0.0) {
                    assert!((sum / weight - 100.0).abs() < 1e-3, "{decay:?} after {time}: {sum} / {weight}");
                }
            }
            // At most one slice's weight is added, for any time step.
            let weight = r.volume().voxel([0, 0, 0]).1;
            assert!(weight.is_finite() && weight <= 1.001 * (k + 1) as f32, "{decay:?} after {time}: {weight}");
        }
        assert!(r.work().times_backwards >= 8 && r.work().times_absurd >= 4, "{:?}", r.work());
    }
    // A clock that is set back does not stop time.
    let mut r = reconstructor(Decay::Exponential { rate_per_s: 1.0 }, |_| ());
    for (k, time) in (0..).zip([100, 101, 7, 17]) {
        r.insert(&touch(if k == 0 { 100.0 } else { 0.0 }, time * SECOND, k)).unwrap();
    }
    let left = r.volume().voxel([0, 0, 0]).0 / 100.0 / r.kernels().unwrap()[2].peak() as f32;
    assert!((left / (-11.0_f32).exp() - 1.0).abs() < 1e-4, "{left}: one second before it was set and ten after");
}

/// Mean shift of a ramp along a sweep, as a distance along the sweep, in σ.
fn shift(decay: Option<Decay>, speed_mm_s: f64) -> f64 {
    let gap_mm = 0.1;
    let slope = 2.0;
    let scene = Scene::Ramp(Ramp { at_origin: 128.0, gradient: DVec3::Z * slope });
    let scan = Scan::new(ScanSettings {
        scene: scene.clone(),
        motion: Motion::Parallel,
        frames: 200,
        gap_mm,
        image_size: [24, 24],
        pixel_mm: [0.25, 0.25],
        noise_sd: 0.0,
        depth: Depth::F32,
        interval_ns: (gap_mm / speed_mm_s * 1e9) as i64,
        ..ScanSettings::default()
    })
    .unwrap();
    let compounding = decay.map_or(Compounding::Mean, Compounding::Decay);
    let settings = Settings { compounding, method: Method::GaussianTruncated, ..settings() };
    let mut r = Reconstructor::new(settings, Mask::full(24, 24)).unwrap();
    for i in 0..scan.frames() {
        r.insert(&scan.slice(i)).unwrap();
    }
    let inside = values(&r, |p| p.x.abs() < 1.0 && p.y.abs() < 1.0 && p.z.abs() < 5.0);
    let towards = scan.world_from_image(1).affine().translation.z - scan.world_from_image(0).affine().translation.z;
    inside.iter().map(|(p, value)| (value - scene.value(*p)) / slope).sum::<f64>() / inside.len() as f64
        * towards.signum()
}

#[test]
fn each_mode_has_expected_sweep_shift() {
    // σ is 1 mm. At v = 10 mm/s the support, 5.15 mm, passes in 0.52 s.
    let speed = 10.0;
    assert!(shift(None, speed).abs() < 2e-3);
    for rate_per_s in [1.0, 3.0] {
        let found = shift(Some(Decay::Exponential { rate_per_s }), speed);
        // a·σ²/v, for the kernel as it is cut.
        let expected = rate_per_s * 0.9617_f64.powi(2) / speed;
        assert!((found / expected - 1.0).abs() < 0.2, "rate {rate_per_s}: {found} against {expected}");
    }
    for rate_per_s in [1.0, 10.0, 100.0] {
        let found = shift(Some(Decay::DeadTime { rate_per_s, wait_s: 0.55 }), speed);
        assert!(found.abs() < 0.02, "rate {rate_per_s}: {found}");
    }
    // The printed formula keeps the first sample: the front of the support, two σ before the
    // voxel.
    let literal = shift(Some(Decay::PaperLiteral { rate_per_s: 0.01, wait_s: 0.0 }), speed);
    assert!((-2.6..-1.9).contains(&literal), "{literal}");
}

#[test]
fn ages_cost_two_bytes_per_voxel_if_used() {
    let bytes = |compounding| {
        let mut r = Reconstructor::new(Settings { compounding, ..settings() }, fan()).unwrap();
        slices().iter().for_each(|s| {
            r.insert(s).unwrap();
        });
        r.volume().bytes() as f64 / (512 * r.volume().len()) as f64
    };
    let plain = bytes(Compounding::Mean);
    assert!((bytes(Compounding::Decay(MODES[0])) - plain).abs() < 0.1);
    assert!((bytes(Compounding::Decay(MODES[1])) - plain - 2.0).abs() < 0.1);
}

#[test]
fn invalid_decays_refused_by_name() {
    for (decay, text) in [
        (Decay::Exponential { rate_per_s: 0.0 }, "rate"),
        (Decay::DeadTime { rate_per_s: f64::NAN, wait_s: 1.0 }, "rate"),
        (Decay::DeadTime { rate_per_s: 1.0, wait_s: -1.0 }, "wait"),
        (Decay::PaperLiteral { rate_per_s: 1.0, wait_s: f64::INFINITY }, "wait"),
    ] {
        let settings = Settings { compounding: Compounding::Decay(decay), ..settings() };
        let Err(error) = Reconstructor::new(settings, fan()) else { panic!("{decay:?} was accepted") };
        assert!(error.to_string().contains(text), "{error}");
    }
}

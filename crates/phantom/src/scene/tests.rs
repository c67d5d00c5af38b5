//! Closed forms against brute force, and drawn scenes against their descriptions.

use glam::DQuat;

use super::*;
use crate::tests::quadrature::brute;

fn covariance(axes: DMat3, sigma: DVec3) -> DMat3 {
    axes * DMat3::from_diagonal(sigma * sigma) * axes.transpose()
}

fn turned() -> DMat3 {
    DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.5, -0.3, 0.8))
}

const PLACES: [DVec3; 4] =
    [DVec3::ZERO, DVec3::new(2.0, 1.0, -1.0), DVec3::new(-7.0, 6.0, 3.0), DVec3::new(0.5, -9.5, 2.0)];

#[test]
fn smooth_scenes_under_anisotropic_blur_match_brute_force() {
    let blobs = Blobs {
        background: 60.0,
        sphere: None,
        blobs: vec![
            Blob { centre: DVec3::new(1.0, 0.5, -0.5), sigma: 1.2, amplitude: 110.0 },
            Blob { centre: DVec3::new(-6.0, 6.0, 2.0), sigma: 3.0, amplitude: -70.0 },
        ],
    };
    let soft_plane = Plane { normal: turned().y_axis, offset: 1.0, below: 30.0, above: 200.0, edge_sigma: 0.5 };
    let sigma = DVec3::new(0.4, 0.9, 1.6);
    for scene in [Scene::Blobs(blobs), Scene::standard_ramp(), Scene::Constant(42.0), Scene::Plane(soft_plane)] {
        for place in PLACES {
            let closed = scene.blurred(place, &covariance(turned(), sigma)).unwrap();
            let brute = brute(&scene, place, turned(), sigma, 40);
            assert!((closed - brute).abs() < 1e-4, "{scene:?} at {place}: {closed} {brute}");
        }
    }
}

#[test]
fn spheres_under_isotropic_blur_match_brute_force() {
    let soft =
        Sphere { centre: DVec3::new(0.5, -0.5, 1.0), radius: 8.0, inside: 180.0, outside: 60.0, edge_sigma: 0.9 };
    for scene in [Scene::Sphere(soft), Scene::Blobs(Blobs::draw(3))] {
        for place in PLACES {
            let closed = scene.blurred(place, &covariance(turned(), DVec3::splat(1.1))).unwrap();
            let brute = brute(&scene, place, turned(), DVec3::splat(1.1), 40);
            assert!((closed - brute).abs() < 1e-4, "{place}: {closed} {brute}");
            let softened = scene.softened(1.1).unwrap().value(place);
            assert!((closed - softened).abs() < 1e-9, "{closed} {softened}");
        }
    }
    // The hard edge makes the midpoint rule coarse: 120³ jumps of the integrand.
    let hard = Scene::standard_sphere();
    for place in [DVec3::new(9.0, 1.0, 0.0), DVec3::new(0.0, 10.5, 0.0)] {
        let closed = hard.blurred(place, &covariance(turned(), DVec3::splat(2.0))).unwrap();
        let brute = brute(&hard, place, turned(), DVec3::splat(2.0), 120);
        assert!((closed - brute).abs() < 0.05, "{place}: {closed} {brute}");
    }
    assert_eq!(hard.blurred(DVec3::ZERO, &DMat3::from_diagonal(DVec3::new(1.0, 1.0, 2.0))), None);
}

#[test]
fn sphere_profile_is_smooth_and_halves_at_predicted_radius() {
    let sphere = Sphere { centre: DVec3::ZERO, radius: 10.0, inside: 1.0, outside: 0.0, edge_sigma: 1.0 };
    // Half level at R − σ²/R, to next order.
    assert!((sphere.at_distance(10.0 - 0.1) - 0.5).abs() < 1e-3);
    // Wide blur: series and difference of exponentials agree at y = R r/σ² = 0.5.
    let wide = Sphere { edge_sigma: 12.0, ..sphere };
    let meet = 0.5 * 144.0 / 10.0;
    assert!((wide.at_distance(meet - 1e-9) - wide.at_distance(meet)).abs() < 1e-9);
    let brute = brute(
        &Scene::Sphere(Sphere { edge_sigma: 1.0, ..wide }),
        DVec3::ZERO,
        DMat3::IDENTITY,
        DVec3::splat(143_f64.sqrt()),
        120,
    );
    assert!((wide.at_distance(0.0) - brute).abs() < 1e-5, "{} {brute}", wide.at_distance(0.0));
}

#[test]
fn edges_without_softness_are_steps() {
    let hard = Scene::standard_sphere();
    assert_eq!(hard.value(DVec3::new(9.999, 0.0, 0.0)), 180.0);
    assert_eq!(hard.value(DVec3::new(0.0, 10.001, 0.0)), 60.0);
    let plane = Plane { normal: DVec3::Z, offset: 2.0, below: 10.0, above: 20.0, edge_sigma: 0.0 };
    assert_eq!(Scene::Plane(plane).value(DVec3::new(5.0, 5.0, 1.999)), 10.0);
    assert_eq!(Scene::Plane(plane).value(DVec3::new(5.0, 5.0, 2.001)), 20.0);
    // 10–90 % rise of 2.563 σ, no shift.
    let blurred = |z| Scene::Plane(plane).blurred(DVec3::new(0.0, 0.0, 2.0 + z), &DMat3::IDENTITY).unwrap();
    assert!((blurred(-1.2816) - 11.0).abs() < 1e-3 && (blurred(1.2816) - 19.0).abs() < 1e-3);
    assert!((blurred(0.0) - 15.0).abs() < 1e-12);
}

#[test]
fn drawn_blobs_match_description_and_leave_room_for_noise() {
    for seed in 0..8 {
        let blobs = Blobs::draw(seed);
        assert_eq!(blobs.blobs.len(), 60);
        for blob in &blobs.blobs {
            assert!(blob.centre.abs().max_element() <= 25.0);
            assert!((1.2..5.0).contains(&blob.sigma) && (-70.0..110.0).contains(&blob.amplitude));
        }
        let sphere = blobs.sphere.unwrap();
        assert!(sphere.centre.abs().max_element() + sphere.radius <= 25.0);
        let scene = Scene::Blobs(blobs);
        for k in 0..40 * 40 * 40 {
            let at = |n: i32| f64::from(n % 40) * 1.5 - 29.25;
            let value = scene.value(DVec3::new(at(k), at(k / 40), at(k / 1600)));
            assert!((10.0..=245.0).contains(&value), "seed {seed}: {value}");
        }
    }
}

fn new_smooth_scenes() -> Vec<Scene> {
    let direction = DVec3::new(1.0, -2.0, 3.0);
    // Wider than the standard wires, so that the midpoint rule resolves them.
    let wires = Wires {
        wires: Wires::standard().wires.into_iter().map(|w| Wire { sigma: 0.7, ..w }).collect(),
        background: 40.0,
    };
    vec![
        Scene::ZonePlate(ZonePlate::standard()),
        Scene::ZonePlate(ZonePlate { centre: DVec3::new(3.0, -1.0, 2.0), chirp: -0.3, ..ZonePlate::standard() }),
        Scene::Waves(Waves::standard()),
        Scene::Waves(Waves::single(DVec3::new(0.1, -0.15, 0.05))),
        Scene::Wires(wires),
        Scene::ThinSheet(ThinSheet { offset: 0.5, sigma: 0.6, ..ThinSheet::standard(direction) }),
    ]
}

#[test]
fn oscillations_wires_and_sheets_blurred_match_brute_force() {
    // On a shell, beside it, on a wire, near others.
    let places = [DVec3::ZERO, DVec3::new(2.0, 1.0, -1.0), DVec3::new(-5.0, 6.5, -3.2), DVec3::new(0.5, -8.4, -5.0)];
    for sigma in [DVec3::new(0.4, 0.9, 1.6), DVec3::new(0.36, 0.36, 0.85)] {
        for scene in new_smooth_scenes() {
            for place in places {
                let closed = scene.blurred(place, &covariance(turned(), sigma)).unwrap();
                let brute = brute(&scene, place, turned(), sigma, 60);
                assert!((closed - brute).abs() < 1e-3, "{scene:?} at {place}: {closed} {brute}");
            }
        }
    }
}

#[test]
fn softened_scene_equals_isotropic_blur_and_composes() {
    let mut scenes = new_smooth_scenes();
    scenes.extend([
        Scene::Plane(Plane::standard(DVec3::ONE)),
        Scene::standard_sphere(),
        Scene::Pulsating(Pulsating::standard()),
    ]);
    for scene in scenes {
        let twice = scene.softened(0.6).unwrap().softened(0.8).unwrap();
        for place in PLACES {
            let closed = scene.blurred(place, &DMat3::IDENTITY).unwrap();
            for softened in [scene.softened(1.0).unwrap().value(place), twice.value(place)] {
                assert!((closed - softened).abs() < 1e-9, "{scene:?}: {closed} {softened}");
            }
        }
    }
}

#[test]
fn wave_amplitude_falls_by_kernel_along_its_direction() {
    let sigma = DVec3::new(0.3, 0.6, 1.1);
    let covariance = covariance(DMat3::IDENTITY, sigma);
    for axis in 0..3 {
        let mut frequency = DVec3::ZERO;
        frequency[axis] = 0.2;
        let scene = Scene::Waves(Waves::single(frequency));
        let left = scene.blurred(DVec3::ZERO, &covariance).unwrap() - 128.0;
        let expected = 80.0 * (-2.0 * (std::f64::consts::PI * sigma[axis] * 0.2).powi(2)).exp();
        assert!((left - expected).abs() < 1e-10, "axis {axis}: {left} {expected}");
    }
}

#[test]
fn zone_plate_strong_blur_uses_correct_root() {
    // 2kλ = 9 turns every pivot by 84°, together beyond half a turn: the determinant's
    // principal root has the wrong sign there.
    let plate = Scene::ZonePlate(ZonePlate { chirp: 1.125, ..ZonePlate::standard() });
    let closed = plate.blurred(DVec3::new(0.2, 0.1, 0.0), &covariance(turned(), DVec3::splat(2.0))).unwrap();
    let brute = brute(&plate, DVec3::new(0.2, 0.1, 0.0), turned(), DVec3::splat(2.0), 240);
    assert!((closed - brute).abs() < 1e-3 && (closed - 128.0).abs() > 0.5, "{closed} {brute}");
}

#[test]
fn blurred_sphere_and_edge_match_theory() {
    // Half level at R − σ²/R; the volume inside it is 2.99 % too small at R = 10 σ.
    let sphere = Sphere { centre: DVec3::ZERO, radius: 10.0, inside: 1.0, outside: 0.0, edge_sigma: 1.0 };
    let (mut low, mut high) = (9.0, 10.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if sphere.at_distance(middle) > 0.5 { low = middle } else { high = middle }
    }
    let volume = (low / 10.0_f64).powi(3) - 1.0;
    assert!((low - 9.9).abs() < 2e-3 && (volume + 0.0299).abs() < 5e-5, "{low} {volume}");
    // An oblique edge: no shift, a 10–90 % rise of 2.563 σ of the kernel along its normal.
    let axes = turned();
    let plane = Scene::Plane(Plane::standard(axes.z_axis + 0.5 * axes.x_axis));
    let Scene::Plane(Plane { normal, .. }) = plane else { panic!("a plane") };
    let kernel = covariance(axes, DVec3::new(0.4, 0.4, 1.0));
    let sigma = normal.dot(kernel * normal).sqrt();
    let at = |mm: f64| plane.blurred(normal * mm, &kernel).unwrap();
    assert!((at(0.0) - 120.0).abs() < 1e-12);
    assert!((at(-0.5 * 2.5631 * sigma) - 72.0).abs() < 1e-2 && (at(0.5 * 2.5631 * sigma) - 168.0).abs() < 1e-2);
}

#[test]
fn marschner_lobb_function_has_published_values() {
    let scene = Scene::MarschnerLobb(MarschnerLobb::standard());
    // Rings: crests at integer 6 cos(πr/2), troughs halfway between.
    let trough = (11.0_f64 / 12.0).acos() * std::f64::consts::FRAC_2_PI;
    for (r, z, part) in [
        (0.0, 0.0, 0.6),
        (0.0, 1.0, 0.2),
        (0.0, -1.0, 1.0),
        (1.0, 1.0, 0.2),
        (2.0 / 3.0, 0.0, 0.6),
        (trough, 0.0, 0.4),
        (trough, 1.0, 0.0),
        (0.0, 1.0 / 3.0, 0.4),
    ] {
        for turn in [0.0_f64, 0.4, 2.0] {
            let place = DVec3::new(r * turn.cos(), r * turn.sin(), z) * 20.0;
            assert!((scene.value(place) - (40.0 + 176.0 * part)).abs() < 1e-9, "{r} {z}");
        }
    }
    assert_eq!((scene.softened(1.0), scene.blurred(DVec3::ZERO, &DMat3::IDENTITY)), (None, None));
}

#[test]
fn speckle_is_rayleigh_with_stated_correlation() {
    let speckle = Speckle::draw(1, 0.6);
    let scene = Scene::Speckle(speckle.clone());
    let amplitude = |place: DVec3| (scene.value(place) - speckle.floor) / speckle.scale;
    // Places at least two pitches apart, at all phases of the lattice.
    let places: Vec<DVec3> = (0..40 * 40 * 40)
        .map(|k| DVec3::new(f64::from(k % 40), f64::from(k / 40 % 40), f64::from(k / 1600)) * 1.317 - 26.0)
        .collect();
    let n = places.len() as f64;
    let values: Vec<f64> = places.iter().map(|p| amplitude(*p)).collect();
    let mean = values.iter().sum::<f64>() / n;
    let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    // 64 000 nearly independent places: the standard errors are 0.2 % and 0.3 %.
    assert!((mean / std::f64::consts::FRAC_PI_2.sqrt() - 1.0).abs() < 0.01, "{mean}");
    assert!((mean / deviation - 1.913).abs() < 0.025, "{}", mean / deviation);
    // Rayleigh's distribution, not only its moments: P(A > 2) = e^{−2}.
    let above = values.iter().filter(|v| **v > 2.0).count() as f64 / n;
    assert!((above - (-2.0_f64).exp()).abs() < 0.006, "{above}");
    // The intensity's correlation is the square of the field's: a quarter at one pitch.
    let shifted: Vec<f64> = places.iter().map(|p| amplitude(*p + DVec3::new(0.6, 0.0, 0.0)).powi(2)).collect();
    let products: f64 = values.iter().zip(&shifted).map(|(a, b)| (a * a - 2.0) * (b - 2.0)).sum::<f64>() / n / 4.0;
    assert!((products - 0.25).abs() < 0.03, "{products}");
    // The same bits in any order, and repeatedly; others for another seed; a period of 128
    // pitches.
    let again = Scene::Speckle(Speckle::draw(1, 0.6));
    assert!(places.iter().zip(&values).rev().all(|(p, v)| (again.value(*p) - speckle.floor) / speckle.scale == *v));
    assert_ne!(Speckle::draw(2, 0.6), speckle);
    let far = scene.value(DVec3::new(1.0, 2.0, 3.0) + 0.6 * 128.0 * DVec3::new(1.0, -2.0, 5.0));
    assert!((far - scene.value(DVec3::new(1.0, 2.0, 3.0))).abs() < 1e-9);
}

#[test]
fn pulsating_sphere_follows_its_period() {
    let scene = Scene::Pulsating(Pulsating::standard());
    let day = 86_400_000_000_000;
    for (time_ns, radius) in
        [(0, 10.0), (250_000_000, 12.0), (750_000_000, 8.0), (day + 250_000_000, 12.0), (-250_000_000, 8.0)]
    {
        let Scene::Sphere(sphere) = scene.at_time(time_ns) else { panic!("a sphere") };
        assert!((sphere.radius - radius).abs() < 1e-12, "{time_ns}: {}", sphere.radius);
    }
    assert_eq!(scene.at_time(0).at_time(5), scene.at_time(0));
    assert_eq!((scene.value(DVec3::X * 9.99), scene.value(DVec3::X * 10.01)), (180.0, 60.0));
    assert!(scene.moves() && !scene.at_time(0).moves());
}

#[test]
fn standard_scenes_leave_room_for_noise() {
    let direction = DVec3::new(1.0, 2.0, 3.0);
    let scenes = [
        Scene::Plane(Plane::standard(direction)),
        Scene::ZonePlate(ZonePlate::standard()),
        Scene::Waves(Waves::standard()),
        Scene::Waves(Waves::single(direction)),
        Scene::Wires(Wires::standard()),
        Scene::ThinSheet(ThinSheet::standard(direction)),
        Scene::MarschnerLobb(MarschnerLobb::standard()),
        Scene::Speckle(Speckle::draw(1, Speckle::STANDARD_PITCH_MM)),
    ];
    for scene in scenes {
        for k in 0..100 * 100 * 100 {
            let at = |n: i32| f64::from(n % 100) * 0.6 - 29.7;
            let value = scene.value(DVec3::new(at(k), at(k / 100), at(k / 10_000)));
            // Three deviations of the standard noise.
            assert!((18.0..=237.0).contains(&value), "{scene:?}: {value}");
        }
    }
}

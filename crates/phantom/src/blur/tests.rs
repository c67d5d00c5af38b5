//! Scenes under kernels, against closed forms and plain sums in f64.

use glam::DQuat;

use super::*;
use crate::scene::{MarschnerLobb, Speckle, Sphere};
use crate::tests::quadrature::brute;
use crate::{Motion, ScanSettings};

fn scan(motion: Motion, scene: Scene) -> Scan {
    let settings = ScanSettings {
        scene,
        motion,
        frames: 30,
        gap_mm: 0.6,
        image_size: [48, 40],
        pixel_mm: [0.5; 2],
        ..ScanSettings::default()
    };
    Scan::new(settings).unwrap()
}

fn kernel() -> EffectiveKernel {
    EffectiveKernel::new([0.36, 0.36, 0.85]).unwrap()
}

fn turned() -> DMat3 {
    DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.5, -0.3, 0.8))
}

fn turned_covariance(sigma: [f64; 3]) -> DMat3 {
    let squared = DVec3::from_array(sigma) * DVec3::from_array(sigma);
    turned() * DMat3::from_diagonal(squared) * turned().transpose()
}

/// Returns a grid of one voxel at a point.
fn point_grid(at: DVec3) -> Grid {
    Grid { origin: at, spacing: DVec3::ONE, direction: DMat3::IDENTITY, size: [1; 3] }
}

fn at_point(scene: &Scene, sigma: [f64; 3], at: DVec3) -> f64 {
    let kernel = EffectiveKernel::new(sigma).unwrap();
    let values = sample(scene, &kernel, &Covariances::Same(turned_covariance(sigma)), &point_grid(at)).unwrap();
    f64::from(values[0])
}

#[test]
fn default_kernel_equals_reconstructors() {
    use mask::Mask;
    use reconstruct::{Reconstructor, Settings};
    for (spacing, pixel) in [(DVec3::splat(0.5), 0.1), (DVec3::new(0.3, 0.4, 0.6), 0.25), (DVec3::splat(0.2), 0.5)] {
        let settings =
            ScanSettings { pixel_mm: [pixel; 2], image_size: [64, 60], frames: 1, ..ScanSettings::default() };
        let scan = Scan::new(settings).unwrap();
        let mut reconstructor = Reconstructor::new(Settings::new(spacing), Mask::full(64, 60)).unwrap();
        reconstructor.insert(&scan.slice(0)).unwrap();
        let used = reconstructor.kernels().unwrap().map(|kernel| kernel.sigma_effective_mm());
        assert_eq!(EffectiveKernel::of_defaults(spacing, [pixel; 2]).unwrap().sigma_mm(), used);
    }
    assert!(EffectiveKernel::new([0.3, 0.0, 1.0]).is_err() && EffectiveKernel::new([0.3, 0.3, f64::NAN]).is_err());
}

#[test]
fn spheres_under_anisotropic_kernels_match_brute_force() {
    let sphere = |edge_sigma| {
        Scene::Sphere(Sphere {
            centre: DVec3::new(0.5, -0.5, 1.0),
            radius: 4.0,
            inside: 180.0,
            outside: 60.0,
            edge_sigma,
        })
    };
    let places =
        [DVec3::new(4.2, 0.3, 0.6), DVec3::new(2.0, 2.5, 2.5), DVec3::new(0.5, -0.5, 1.0), DVec3::new(-1.0, -3.0, 3.6)];
    for sigma in [[0.5, 0.5, 1.0], [1.0, 0.6, 0.5], [0.5, 0.55, 0.52], [0.4, 0.4, 2.5]] {
        for place in places {
            // A soft edge allows a sharp comparison.
            let (ours, brute) = (
                at_point(&sphere(0.7), sigma, place),
                brute(&sphere(0.7), place, turned(), DVec3::from_array(sigma), 48),
            );
            assert!((ours - brute).abs() < 1.2e-3, "{sigma:?} at {place}: {ours} {brute}");
        }
    }
    // The hard edge makes the midpoint rule coarse.
    let (ours, brute) = (
        at_point(&sphere(0.0), [0.5, 0.5, 1.0], places[0]),
        brute(&sphere(0.0), places[0], turned(), DVec3::new(0.5, 0.5, 1.0), 160),
    );
    assert!((ours - brute).abs() < 0.03, "{ours} {brute}");
    // An isotropic kernel has a closed form.
    let closed = sphere(0.0).blurred(places[0], &DMat3::from_diagonal(DVec3::splat(0.25))).unwrap();
    assert!((at_point(&sphere(0.0), [0.5; 3], places[0]) - closed).abs() < 1e-3);
}

#[test]
fn rings_and_speckle_on_the_lattice_match_brute_force() {
    let rings = Scene::MarschnerLobb(MarschnerLobb::standard());
    let speckle = Scene::Speckle(Speckle::draw(3, 0.6));
    let places = [[12.0, 9.0, 3.0], [0.1, 0.2, -0.3], [-3.3, 17.0, 8.0], [5.0, -7.1, 2.2]].map(DVec3::from_array);
    for sigma in [[0.36, 0.36, 0.85], [0.9, 0.7, 0.5], [0.2, 0.25, 0.3], [1.5, 1.5, 1.5]] {
        let mut squares = 0.0;
        for place in places {
            let (ours, plain) =
                (at_point(&rings, sigma, place), brute(&rings, place, turned(), DVec3::from_array(sigma), 40));
            assert!((ours - plain).abs() < 1e-3, "rings, {sigma:?} at {place}: {ours} {plain}");
            let (ours, plain) =
                (at_point(&speckle, sigma, place), brute(&speckle, place, turned(), DVec3::from_array(sigma), 100));
            assert!((ours - plain).abs() < 0.05, "speckle, {sigma:?} at {place}: {ours} {plain}");
            squares += (ours - plain).powi(2);
        }
        assert!(squares / 4.0 < 0.02 * 0.02, "{sigma:?}: {squares}");
    }
}

#[test]
fn parallel_sweep_kernel_lies_along_world_axes() {
    let scan = scan(Motion::Parallel, Scene::Blobs(Blobs { sphere: None, ..Blobs::draw(4) }));
    let grid = scan.grid(DVec3::splat(1.5), 0.0).unwrap();
    let values = sample_under(&scan, &kernel(), &grid, 0).unwrap();
    let covariance = DMat3::from_diagonal(DVec3::new(0.36 * 0.36, 0.36 * 0.36, 0.85 * 0.85));
    let expected = truth::sample_blurred(&scan.settings().scene, &grid, &covariance).unwrap().unwrap();
    assert!(values.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn tilted_slices_rotate_kernel() {
    for motion in [Motion::Fan { axis_distance_mm: 25.0 }, Motion::Freehand, Motion::Crossing] {
        let scan = scan(motion, Scene::Constant(0.0));
        let covariances = Covariances::of(&scan, &kernel());
        let grid = scan.grid(DVec3::splat(2.0), 0.0).unwrap();
        let mut compared = 0;
        for z in 0..grid.size[2] {
            let nearby = covariances.near_layer(&grid, z);
            for k in 0..grid.size[0] * grid.size[1] {
                let world = voxel_centre(&grid, k, z);
                // Direct sum over all slices.
                let (mut sum, mut weights) = (DMat3::ZERO, 0.0);
                for frame in 0..scan.frames() {
                    let image = scan.true_world_from_image(frame);
                    let foot = image.inverse().point(world);
                    let inside = (-0.5..=47.5).contains(&foot.x) && (-0.5..=39.5).contains(&foot.y);
                    if inside && foot.z.abs() <= 4.0 * 0.85 {
                        let weight = (-0.5 * (foot.z / 0.85).powi(2)).exp();
                        let rotation = image.affine().matrix3 * DMat3::from_diagonal(DVec3::new(2.0, 2.0, 1.0));
                        let diagonal = DMat3::from_diagonal(DVec3::new(0.36 * 0.36, 0.36 * 0.36, 0.85 * 0.85));
                        sum += weight * (rotation * diagonal * rotation.transpose());
                        weights += weight;
                    }
                }
                if weights > 0.0 {
                    compared += 1;
                    let difference = nearby.at(world) - sum * (1.0 / weights);
                    assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-12), "{motion:?} at {world}");
                }
            }
        }
        assert!(compared > 500, "{motion:?}: {compared}");
    }
    let still = Covariances::of(&scan(Motion::Dwell { frames: 9 }, Scene::Constant(0.0)), &kernel());
    assert!(matches!(still, Covariances::Same(_)));
}

#[test]
fn scenes_under_rotating_kernel_are_thread_count_independent() {
    use crate::scene::{Plane, Pulsating, ThinSheet, Waves, Wires, ZonePlate};
    for scene in [
        Scene::Constant(90.0),
        Scene::standard_ramp(),
        Scene::Blobs(Blobs::draw(2)),
        Scene::standard_sphere(),
        Scene::Plane(Plane::standard(DVec3::ONE)),
        Scene::ZonePlate(ZonePlate::standard()),
        Scene::Waves(Waves::standard()),
        Scene::Wires(Wires::standard()),
        Scene::ThinSheet(ThinSheet::standard(DVec3::ONE)),
        Scene::MarschnerLobb(MarschnerLobb::standard()),
        Scene::Speckle(Speckle::draw(1, 0.6)),
        Scene::Pulsating(Pulsating::standard()),
    ] {
        let scan = scan(Motion::Freehand, scene);
        let grid = scan.grid(DVec3::splat(3.0), 0.0).unwrap();
        let [one, three] = [1, 3].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sample_under(&scan, &kernel(), &grid, 250_000_000)).unwrap()
        });
        assert!(one.iter().zip(&three).all(|(a, b)| a.to_bits() == b.to_bits()));
        let sharp = truth::sample(&scan.settings().scene.at_time(250_000_000), &grid).unwrap();
        let range = |values: &[f32]| values.iter().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        let ((low, high), (_, _)) = (range(&one), range(&sharp));
        assert!(low > 0.0 && high < 256.0, "{:?}: {low} {high}", scan.settings().scene);
    }
}

#[test]
fn kernel_too_thin_for_memory_is_refused() {
    let scan = scan(Motion::Freehand, Scene::MarschnerLobb(MarschnerLobb::standard()));
    let grid = scan.grid(DVec3::splat(0.5), 0.0).unwrap();
    let thin = EffectiveKernel::new([0.001, 0.3, 1.0]).unwrap();
    assert!(sample_under(&scan, &thin, &grid, 0).unwrap_err().to_string().contains("smallest σ"));
}

use std::f64::consts::PI;

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::closed::Topology;
use crate::compensation::{Compensation, compensate};
use crate::error::SurfaceError;
use crate::measure::volume_mm3;

/// Edge of the voxels, mm.
const SPACING: f64 = 0.5;

/// Value of a ball of 255 blurred by a Gaussian, at a distance from its centre, mm.
fn blurred_ball(radius: f64, sigma: f64, r: f64) -> f64 {
    let root = std::f64::consts::SQRT_2 * sigma;
    let (near, far) = ((radius - r) / root, (radius + r) / root);
    let tails = (-near * near).exp() - (-far * far).exp();
    let edge = sigma / (r.max(1e-9) * (2.0 * PI).sqrt()) * tails;
    255.0 * ((libm::erf(near) + libm::erf(far)) / 2.0 - edge)
}

/// Values of a cube of voxels around the origin.
struct Cube {
    half: i64,
    values: Vec<f32>,
}

impl Cube {
    fn new(half_mm: f64, value: impl Fn(DVec3) -> f64) -> Self {
        let half = (half_mm / SPACING).ceil() as i64;
        let along = || -half..=half;
        let voxels = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z])));
        Self { half, values: voxels.map(|v| value(DVec3::from_array(v.map(|n| n as f64 * SPACING))) as f32).collect() }
    }

    fn add_noise(&mut self, sigma: f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for value in &mut self.values {
            let (u, v): (f64, f64) = (rng.random_range(1e-12..1.0), rng.random());
            *value += (sigma * (-2.0 * u.ln()).sqrt() * (2.0 * PI * v).cos()) as f32;
        }
    }

    fn index(&self, voxel: [i64; 3]) -> usize {
        let [x, y, z] = voxel.map(|at| (at + self.half) as usize);
        let edge = 2 * self.half as usize + 1;
        (z * edge + y) * edge + x
    }

    fn field(&self) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync + '_> {
        Field { low: [-self.half; 3], high: [self.half; 3], value: |voxel| Some(self.values[self.index(voxel)]) }
    }

    /// Returns the errors of the volume before and after, %.
    fn errors(&self, sigma: f64, truth: f64) -> ([f64; 2], Compensation) {
        let field = self.field();
        let (mesh, _) = half_level(&field, lattice(SPACING));
        let topology = Topology::of(&mesh);
        let (compensated, outcome) = compensate(&mesh, &field, lattice(SPACING), sigma * sigma).unwrap();
        let error = |mesh: &Mesh| 100.0 * (volume_mm3(mesh, &topology).unwrap() / truth - 1.0);
        ([error(&mesh), error(&compensated)], outcome)
    }
}

fn sphere(radius: f64, sigma: f64) -> Cube {
    let centre = DVec3::new(0.13, 0.21, -0.08);
    Cube::new(radius + 5.0, |p| blurred_ball(radius, sigma, p.distance(centre)))
}

fn sphere_volume(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius.powi(3)
}

#[test]
fn blurred_sphere_has_volume_within_tenth_percent() {
    // The lattice alone takes 0.24 % of the volume before the compensation.
    for (sigma, before) in [(0.5, -0.75 - 0.24), (1.0, -2.99 - 0.24)] {
        let ([uncompensated, compensated], outcome) = sphere(10.0, sigma).errors(sigma, sphere_volume(10.0));
        assert!((uncompensated - before).abs() < 0.02, "{uncompensated}");
        assert!(compensated.abs() < 0.02, "{compensated}");
        assert_eq!((outcome.too_curved, outcome.undetermined), (0, 0));
    }
}

#[test]
fn small_blurred_sphere_keeps_an_error_of_second_order() {
    let ([uncompensated, compensated], _) = sphere(5.0, 1.0).errors(1.0, sphere_volume(5.0));
    assert!((uncompensated + 12.78).abs() < 0.05 && compensated.abs() < 0.25, "{uncompensated} {compensated}");
}

#[test]
fn noisy_sphere_has_volume_within_tenth_percent() {
    for sigma in [0.5, 1.0] {
        let mut cube = sphere(10.0, sigma);
        cube.add_noise(6.0);
        let ([uncompensated, compensated], _) = cube.errors(sigma, sphere_volume(10.0));
        assert!(compensated.abs() < 0.1, "{uncompensated} {compensated}");
    }
}

#[test]
fn dark_sphere_grows_as_well() {
    let mut cube = sphere(10.0, 1.0);
    cube.values.iter_mut().for_each(|value| *value = 255.0 - *value);
    let ([uncompensated, compensated], _) = cube.errors(1.0, -sphere_volume(10.0));
    assert!(uncompensated < -3.0 && compensated.abs() < 0.02, "{uncompensated} {compensated}");
}

/// Blurs values by a Gaussian along each axis in turn.
fn blur(cube: &Cube, sigma_mm: f64) -> Cube {
    let sigma = sigma_mm / SPACING;
    let reach = (6.0 * sigma).ceil() as i64;
    let taps: Vec<f64> = (-reach..=reach).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let mut values: Vec<f64> = cube.values.iter().map(|value| f64::from(*value)).collect();
    let edge = 2 * cube.half as usize + 1;
    for stride in [1, edge, edge * edge] {
        let blurred = |i: usize| {
            let at = (i / stride % edge) as i64;
            let near = (-reach..=reach).zip(&taps).filter(|(d, _)| (0..edge as i64).contains(&(at + d)));
            near.map(|(d, tap)| values[(i as i64 + d * stride as i64) as usize] * tap).sum::<f64>() / sum
        };
        values = (0..values.len()).map(blurred).collect();
    }
    Cube { half: cube.half, values: values.into_iter().map(|value| value as f32).collect() }
}

#[test]
fn blurred_ellipsoid_has_volume_within_tenth_percent() {
    let half_axes = DVec3::new(6.0, 9.0, 14.0);
    let turn = DQuat::from_axis_angle(DVec3::new(2.0, 1.0, 2.0) / 3.0, 0.6);
    // Each voxel is the share of 4³ places in the ellipsoid: a blur of its own, 1/12 of its edge².
    let place = |i: usize| (i as f64 - 1.5) / 4.0 * SPACING;
    let share = |p: DVec3| {
        let within = |i: usize| {
            let at = turn * (p + DVec3::new(place(i % 4), place(i / 4 % 4), place(i / 16)));
            (at / half_axes).length_squared() < 1.0
        };
        255.0 * (0..64).filter(|i| within(*i)).count() as f64 / 64.0
    };
    let sharp = Cube::new(20.0, share);
    for sigma in [0.5, 1.0_f64] {
        let cube = blur(&sharp, (sigma * sigma - SPACING * SPACING / 12.0).sqrt());
        let ([uncompensated, compensated], _) = cube.errors(sigma, 4.0 / 3.0 * PI * half_axes.element_product());
        assert!(uncompensated < -1.0 && compensated.abs() < 0.1, "{uncompensated} {compensated}");
    }
}

#[test]
fn sharply_curved_vertices_stay_and_are_counted() {
    let cube = sphere(2.5, 1.0);
    let field = cube.field();
    let (mesh, _) = half_level(&field, lattice(SPACING));
    let (compensated, outcome) = compensate(&mesh, &field, lattice(SPACING), 1.0).unwrap();
    assert_eq!(outcome, Compensation { too_curved: mesh.vertices.len() as u64, ..Compensation::default() });
    assert_eq!(compensated, mesh);
}

#[test]
fn unseen_voxels_do_not_bend_a_plane() {
    let plane = |voxel: [i64; 3]| (voxel[0] + voxel[1] <= 20).then(|| 127.5 + 20.0 * (voxel[2] as f32 - 10.3));
    let field = Field { low: [0; 3], high: [20; 3], value: plane };
    let (mesh, _) = half_level(&field, turned_lattice());
    let (compensated, outcome) = compensate(&mesh, &field, turned_lattice(), 0.25).unwrap();
    assert_eq!((outcome.moved, outcome.too_curved), (mesh.vertices.len() as u64, 0));
    let moved = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
    let farthest = mesh.vertices.iter().zip(&compensated.vertices).map(moved).fold(0.0, f32::max);
    assert!(farthest < 1e-3, "{farthest}");
}

#[test]
fn vertices_at_the_end_of_coverage_are_compensated() {
    let cube = sphere(10.0, 1.0);
    let whole = cube.field();
    let half = Field { low: whole.low, high: [whole.high[0], whole.high[1], 4], value: |voxel| (whole.value)(voxel) };
    let (mesh, _) = half_level(&half, lattice(SPACING));
    let (compensated, outcome) = compensate(&mesh, &half, lattice(SPACING), 1.0).unwrap();
    assert_eq!(outcome.moved, mesh.vertices.len() as u64);
    let centre = DVec3::new(0.13, 0.21, -0.08);
    let error = |vertex: &[f32; 3]| DVec3::from_array(vertex.map(f64::from)).distance(centre) - 10.0;
    // The blur took 0.1 mm. Smoothing from one side gives back half of it at the end of coverage.
    let farthest =
        |vertices: &mut dyn Iterator<Item = &[f32; 3]>| vertices.map(error).fold(0.0, |far: f64, e| far.max(e.abs()));
    assert!(farthest(&mut compensated.vertices.iter()) < 0.065);
    // 3 mm away from it is beyond the smoothing's reach for all but a share of 0.001.
    let is_inner = |vertex: &&[f32; 3]| f64::from(vertex[2]) < 2.0 - 3.0;
    assert!(farthest(&mut compensated.vertices.iter().filter(is_inner)) < 0.008);
}

#[test]
fn impossible_blurs_are_refused() {
    let cube = sphere(2.5, 1.0);
    let try_blur = |mm2: f64| compensate(&Mesh::default(), &cube.field(), lattice(SPACING), mm2).unwrap_err();
    assert!(matches!(try_blur(f64::NAN), SurfaceError::Blur { .. }));
    assert_eq!(try_blur(-1.0), SurfaceError::Blur { blur_mm2: -1.0 });
    assert_eq!(try_blur(25.0), SurfaceError::WideBlur { sigma_mm: 5.0, voxels: 40, most: 32 });
}

//! Bodies between contours: their volumes, by the surface and by planimetry.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2};

use surface::measure::volume_mm3;
use surface::{Topology, extract};

use super::contours::{Text, circle, read};
use super::*;
use crate::body::{Body, Lattice};
use crate::contours::Contours;
use crate::cubic::weights;
use crate::error::SegmentError;
use crate::planimetry::{cubic_mm3, straight_mm3};
use crate::polygon;

/// Returns the volume by the surface, which must be one closed body.
fn volume(contours: &Contours) -> f64 {
    let lattice = Lattice::around(contours, None).unwrap();
    let field = Body::new(contours).field(&lattice, LIMIT).unwrap();
    let (mesh, _) = extract(&field, 0.0, lattice.world_from_lattice(), LIMIT).unwrap();
    let topology = Topology::of(&mesh);
    assert_eq!((topology.is_closed(), topology.components, topology.euler_number()), (true, 1, 2));
    volume_mm3(&mesh, &topology).unwrap()
}

/// Returns the contour of the ball of radius 1 that a map stretches, on a plane at a point with a
/// perpendicular, mm.
fn slice(map: DMat3, centre: DVec3, point: DVec3, normal: DVec3) -> Text {
    // In the ball's own space, the plane is one with this perpendicular.
    let own = (map.transpose() * normal).normalize();
    let height = own.dot(map.inverse() * (point - centre));
    let [a, b] = [own.any_orthonormal_vector(), own.cross(own.any_orthonormal_vector())];
    let radius = (1.0 - height * height).sqrt();
    let axes = [normal.any_orthonormal_vector(), normal.cross(normal.any_orthonormal_vector())];
    let points = circle(DVec2::ZERO, radius, 16).into_iter().map(|p| {
        let p = centre + map * (own * height + a * p.x + b * p.y) - point;
        DVec2::new(p.dot(axes[0]), p.dot(axes[1]))
    });
    Text { origin: point, axes, points: points.collect() }
}

fn near(found: f64, expected: f64, share: f64) {
    assert!((found / expected - 1.0).abs() < share, "{found} for {expected}: {}", found / expected - 1.0);
}

#[test]
fn ten_contours_of_ball_have_its_volume() {
    let ball = DMat3::from_diagonal(DVec3::splat(10.0));
    let heights = (0..10).map(|n| 9.7 * (f64::from(n) / 4.5 - 1.0));
    let contours: Vec<Text> = heights.map(|z| slice(ball, DVec3::ZERO, DVec3::Z * z, DVec3::Z)).collect();
    let contours = read(&contours);
    let truth = 4.0 / 3.0 * PI * 1000.0;
    near(volume(&contours), truth, 0.01);
    near(cubic_mm3(&contours), truth, 0.01);
    // Areas that are straight between the contours lose more, and cones have smaller areas still.
    assert!(straight_mm3(&contours) < 0.99 * truth);
    assert_eq!(Body::new(&contours).moved(), 0);
}

#[test]
fn fanned_planes_of_ball_have_its_volume() {
    // Planes about the x-axis, 40 mm before the ball's centre, as a probe that is tilted has them.
    let centre = DVec3::new(3.0, 0.0, 40.0);
    let ball = DMat3::from_diagonal(DVec3::splat(10.0));
    let widest = (10.0_f64 / 40.0).asin();
    let angles = (0..10).map(|n| 0.97 * widest * (f64::from(n) / 4.5 - 1.0));
    let contours: Vec<Text> = angles
        .map(|angle| {
            let turn = DQuat::from_rotation_x(-angle);
            slice(ball, centre, turn * DVec3::Z * 40.0, turn * DVec3::Y)
        })
        .collect();
    let contours = read(&contours);
    let truth = 4.0 / 3.0 * PI * 1000.0;
    near(volume(&contours), truth, 0.015);
    near(cubic_mm3(&contours), truth, 0.015);
}

#[test]
fn slanted_ellipsoid_has_its_volume() {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(2.0, 1.0, 2.0) / 3.0, 0.6));
    let map = turn * DMat3::from_diagonal(DVec3::new(14.0, 9.0, 6.0));
    let centre = DVec3::new(100.0, -50.0, 20.0);
    // The plane along z touches the ellipsoid at this height.
    let highest = (map.transpose() * DVec3::Z).length();
    let heights = (0..12).map(|n| 0.97 * highest * (f64::from(n) / 5.5 - 1.0));
    let contours: Vec<Text> = heights.map(|z| slice(map, centre, centre + DVec3::Z * z, DVec3::Z)).collect();
    let contours = read(&contours);
    let truth = 4.0 / 3.0 * PI * 14.0 * 9.0 * 6.0;
    near(volume(&contours), truth, 0.01);
    near(cubic_mm3(&contours), truth, 0.01);
}

#[test]
fn contours_that_move_far_are_joined_along_their_discs() {
    // Circles of radius 5 mm that move by 9 mm across 4 mm: without the shift, they hardly meet.
    let at = |n: i32| Text::level(4.0 * f64::from(n), circle(DVec2::new(9.0 * f64::from(n), 0.0), 5.0, 16));
    let contours = read(&(0..5).map(at).collect::<Vec<_>>());
    assert_eq!(Body::new(&contours).moved(), 4);
    let truth = PI * 25.0 * 16.0;
    near(volume(&contours), truth, 0.02);
    near(cubic_mm3(&contours), truth, 0.01);
}

#[test]
fn two_contours_make_a_straight_body_with_flat_ends() {
    let contours =
        read(&[Text::level(0.0, circle(DVec2::ZERO, 10.0, 16)), Text::level(20.0, circle(DVec2::ZERO, 6.0, 16))]);
    let body = Body::new(&contours);
    assert!((body.distance(DVec3::new(0.0, 0.0, 0.5)) - 0.5).abs() < 1e-9);
    assert!((body.distance(DVec3::new(0.0, 0.0, 20.5)) + 0.5).abs() < 1e-9);
    assert!(body.distance(DVec3::new(8.0, 0.0, 10.0)).abs() < 0.01);
    near(volume(&contours), PI * 20.0 * (100.0 + 60.0 + 36.0) / 3.0, 0.01);
}

#[test]
fn body_has_same_bits_for_any_threads() {
    let contours = read(&[
        Text::level(0.0, circle(DVec2::ZERO, 10.0, 7)),
        Text::level(9.0, circle(DVec2::X, 6.0, 5)),
        Text::level(13.0, circle(DVec2::X * 8.0, 6.0, 5)),
    ]);
    let lattice = Lattice::around(&contours, Some(0.7)).unwrap();
    let bits = |threads| {
        let field = on(threads, || Body::new(&contours).field(&lattice, LIMIT).unwrap());
        field.in_order().iter().map(|value| value.to_bits()).collect::<Vec<_>>()
    };
    let first = bits(1);
    assert!([2, 5].into_iter().all(|threads| bits(threads) == first));
}

#[test]
fn impossible_voxels_are_refused() {
    let contours = read(&[0.0, 9.0].map(|z| Text::level(z, circle(DVec2::ZERO, 10.0, 7))));
    let around = |mm| Lattice::around(&contours, Some(mm));
    for mm in [0.0, -1.0, f64::NAN] {
        assert!(matches!(around(mm), Err(SegmentError::Setting { setting: "the spacing", .. })), "{mm}");
    }
    assert!(matches!(around(1e-5), Err(SegmentError::Wide { .. })));
    let lattice = around(1.0).unwrap();
    let found = Body::new(&contours).field(&lattice, lattice.bytes() - 1);
    let expected = SegmentError::Memory { needed_bytes: lattice.bytes(), limit_bytes: lattice.bytes() - 1 };
    assert_eq!(found, Err(expected));
    assert!(Body::new(&contours).field(&lattice, lattice.bytes()).is_ok());
}

#[test]
fn distance_to_polygon_is_exact() {
    // An L: its inner corner, its outside, and its edges.
    let l = [(0.0, 0.0), (6.0, 0.0), (6.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)].map(|(x, y)| DVec2::new(x, y));
    for (x, y, expected) in [
        (1.0, 1.0, 1.0),
        (3.0, 3.0, -1.0),
        (1.0, 5.5, 0.5),
        (9.0, 6.0, -5.0),
        (-3.0, -4.0, -5.0),
        (4.0, 0.0, 0.0),
        (1.5, 1.5, 0.5_f64.sqrt()),
    ] {
        let found = polygon::distance(&l, DVec2::new(x, y));
        assert!((found - expected).abs() < 1e-12, "{x} {y}: {found}");
    }
    let (area, centroid) = polygon::area(&l);
    assert!((area - 20.0).abs() < 1e-12 && centroid.distance(DVec2::splat(2.2)) < 1e-12, "{area} {centroid}");
    // The disc touches the outer edges and the inner corner.
    let radius = 2.0 * 2.0_f64.sqrt() / (1.0 + 2.0_f64.sqrt());
    let (centre, found) = polygon::largest_disc(&l);
    assert!((found - radius).abs() < 1e-3 && centre.distance(DVec2::splat(radius)) < 0.01, "{centre} {found}");
}

#[test]
fn cubic_between_unequal_steps_follows_parabolas() {
    let parabola = |x: f64| 3.0 - 2.0 * x + 0.5 * x * x;
    for (before, after) in [(Some(2.0), Some(0.5)), (Some(1.5), None), (None, Some(3.0))] {
        let places = [-before.unwrap_or(0.0), 0.0, 1.2, 1.2 + after.unwrap_or(0.0)];
        let values = glam::DVec4::from_array(places.map(parabola));
        for t in [0.0, 0.3, 0.9, 1.0] {
            let [value, derivative] = weights(before, 1.2, after, t).map(|weights| weights.dot(values));
            assert!((value - parabola(1.2 * t)).abs() < 1e-12, "{before:?} {after:?} {t}");
            assert!((derivative - (1.2 * t - 2.0)).abs() < 1e-12, "{before:?} {after:?} {t}");
        }
    }
    let [value, derivative] = weights(None, 2.0, None, 0.25);
    assert_eq!((value.to_array(), derivative.to_array()), ([0.0, 0.75, 0.25, 0.0], [0.0, -0.5, 0.5, 0.0]));
}

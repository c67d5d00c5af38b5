//! Files of contours: what they hold, and what is refused.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

use glam::DVec2;

use super::*;
use crate::contours::Contours;
use crate::planimetry::{cubic_mm3, straight_mm3};

/// The text of one contour.
pub(super) struct Text {
    pub(super) origin: DVec3,
    pub(super) axes: [DVec3; 2],
    pub(super) points: Vec<DVec2>,
}

impl Text {
    /// A contour on a plane of constant z.
    pub(super) fn level(z: f64, points: Vec<DVec2>) -> Self {
        Self { origin: DVec3::Z * z, axes: [DVec3::X, DVec3::Y], points }
    }
}

/// Returns points on a circle.
pub(super) fn circle(centre: DVec2, radius: f64, points: usize) -> Vec<DVec2> {
    let angle = |n: usize| 2.0 * PI * n as f64 / points as f64;
    (0..points).map(|n| centre + radius * DVec2::from_angle(angle(n))).collect()
}

/// Returns a file's text.
fn text(contours: &[Text]) -> String {
    let mut text = "format = \"sonoweave-contours\"\nversion = 1\nframe = \"Reference\"\n".to_owned();
    for Text { origin, axes: [across, along], points } in contours {
        let points: Vec<[f64; 2]> = points.iter().map(|p| p.to_array()).collect();
        let [origin, across, along] = [origin, across, along].map(|v| v.to_array());
        writeln!(text, "[[contour]]\norigin = {origin:?}\nacross = {across:?}\nalong = {along:?}\npoints = {points:?}")
            .unwrap();
    }
    text
}

pub(super) fn read(contours: &[Text]) -> Contours {
    Contours::parse(Path::new("c.toml"), &text(contours)).unwrap()
}

fn refused(contours: &[Text]) -> String {
    Contours::parse(Path::new("c.toml"), &text(contours)).unwrap_err().to_string()
}

fn round(z: f64) -> Text {
    Text::level(z, circle(DVec2::ZERO, 5.0, 12))
}

#[test]
fn file_has_its_contours_frame_and_areas() {
    let contours = read(&[round(0.0), round(4.0)]);
    assert_eq!((contours.list().len(), contours.frame()), (2, "Reference"));
    let [low, high] = contours.bounds();
    assert!((low - DVec3::new(-5.0, -5.0, 0.0)).length() < 0.02 && (high - DVec3::new(5.0, 5.0, 4.0)).length() < 0.02);
    for contour in contours.list() {
        let area = contour.area();
        assert!(area.x == 0.0 && area.y == 0.0 && (area.z / (25.0 * PI) - 1.0).abs() < 4e-3, "{area}");
        assert!(contour.centroid().truncate().length() < 1e-9);
        let (centre, radius) = contour.disc();
        assert!(centre.truncate().length() < 0.05 && (radius / 5.0 - 1.0).abs() < 4e-3, "{centre} {radius}");
    }
}

#[test]
fn curve_passes_its_points_whatever_their_order() {
    let mut points = vec![DVec2::new(0.0, 0.0), DVec2::new(9.0, 1.0), DVec2::new(8.0, 7.0), DVec2::new(1.0, 3.0)];
    let first = read(&[Text::level(0.0, points.clone()), Text::level(1.0, points.clone())]);
    let corners: Vec<DVec3> = first.list()[0].corners().collect();
    assert!(points.iter().all(|p| corners.iter().any(|corner| corner.truncate().distance(*p) < 1e-12)));
    points.reverse();
    let other = read(&[Text::level(0.0, points.clone()), Text::level(1.0, points)]);
    assert!((first.list()[0].area() - other.list()[0].area()).length() < 1e-9);
}

#[test]
fn planimetry_is_exact_for_prism_and_paraboloid() {
    // A slanted prism: its volume is that of the area times the height.
    let slanted: Vec<Text> =
        (0..4).map(|n| Text::level(3.0 * f64::from(n), circle(DVec2::new(2.0 * f64::from(n), 0.0), 5.0, 12))).collect();
    let slanted = read(&slanted);
    let area = slanted.list()[0].area().z;
    assert!((straight_mm3(&slanted) / (9.0 * area) - 1.0).abs() < 1e-12);
    assert!((cubic_mm3(&slanted) / (9.0 * area) - 1.0).abs() < 1e-12);
    // The area of a ball's slices is quadratic, which cubics follow and straight lines do not.
    let slices: Vec<Text> = [-8.0_f64, -5.0, 0.0, 2.0, 7.0]
        .into_iter()
        .map(|z| Text::level(z, circle(DVec2::ZERO, (100.0 - z * z).sqrt(), 12)))
        .collect();
    let slices = read(&slices);
    let ratio = slices.list()[2].area().z / (100.0 * PI);
    let truth = ratio * PI * (100.0 * 15.0 - (343.0 + 512.0) / 3.0);
    assert!((cubic_mm3(&slices) / truth - 1.0).abs() < 1e-9, "{}", cubic_mm3(&slices) / truth);
    assert!(straight_mm3(&slices) / truth < 0.98);
}

#[test]
fn contours_without_body_are_refused_by_number() {
    let two = |second: Text| refused(&[round(0.0), second]);
    let pair = |points: Vec<DVec2>| two(Text::level(4.0, points));
    let eight = [(0.0, 0.0), (5.0, 5.0), (5.0, 0.0), (0.0, 5.0)].map(|(x, y)| DVec2::new(x, y)).to_vec();
    let mut twice = circle(DVec2::ZERO, 5.0, 6);
    twice.insert(2, twice[1]);
    let tilted = Text { axes: [DVec3::X, DVec3::new(0.0, 1.0, 1.0)], ..round(2.0) };
    let skewed = Text { axes: [DVec3::X, DVec3::new(0.5, 1.0, 0.0)], ..round(2.0) };
    for (found, says) in [
        (refused(&[round(0.0)]), "the number of contours must be 2 or more, not 1"),
        (pair(circle(DVec2::ZERO, 5.0, 2)), "points of contour 2 must be 3 to 1000, not 2"),
        (pair(circle(DVec2::ZERO, 5.0, 1001)), "points of contour 2 must be 3 to 1000, not 1001"),
        (pair(eight), "contour 2 crosses itself"),
        (pair([0.0, 1.0, 3.0].map(DVec2::splat).to_vec()), "contour 2 crosses itself"),
        (pair(twice), "point 3 of contour 2 lies at the place of the point before it"),
        (two(skewed), "across and along of contour 2"),
        (two(Text { axes: [DVec3::ZERO, DVec3::Y], ..round(2.0) }), "across and along of contour 2"),
        (two(tilted), "the planes of contours 1 and 2 cross inside of a contour"),
        (two(round(0.0)), "contour 2 does not lie after contour 1"),
        (refused(&[round(0.0), round(4.0), round(2.0)]), "contour 3 does not lie after contour 2"),
        (refused(&[round(4.0), round(0.0), round(6.0)]), "contour 3 does not lie after contour 2"),
        (two(Text { origin: DVec3::Z * 1e7, ..round(0.0) }), "origin (line 10): must hold numbers from -1000000"),
        (two(Text { origin: DVec3::new(0.0, 0.0, f64::INFINITY), ..round(0.0) }), "is not a finite number"),
    ] {
        assert!(found.contains(says) && found.starts_with("c.toml: "), "{found:?} for {says:?}");
    }
    for (from, to, says) in [
        ("sonoweave-contours", "sonoweave-crop", "must be \"sonoweave-contours\" for contours"),
        ("version = 1", "version = 2", "this program reads version 1, not 2"),
        ("along", "allong", "unknown key; did you mean along?"),
        ("points", "# points", "points (line 4): is missing"),
    ] {
        let text = text(&[round(0.0), round(4.0)]).replace(from, to);
        let found = Contours::parse(Path::new("c.toml"), &text).unwrap_err().to_string();
        assert!(found.contains(says), "{found:?} for {says:?}");
    }
}

use glam::{DAffine3, DMat3, DVec3};
use image::{Rgb, RgbImage};

use render::RenderRegion;
use render::camera::View;
use sonoweave_core::frames::Transform;
use sonoweave_core::region::ClipRect;

use super::cube::faces;
use super::ink::Ink;
use super::scale::Bar;
use super::slice::{PROBE, SLICE, SliceMarks};
use super::*;

/// 40 × 30 × 20 voxels of 1 mm about the origin.
fn stage() -> RenderRegion {
    let lattice = DAffine3::from_translation(DVec3::new(-19.5, -14.5, -9.5));
    RenderRegion::new(Transform::from_affine(lattice), [0; 3], [39, 29, 19]).unwrap()
}

fn camera(view: View, size: [u32; 2]) -> Camera {
    Camera::new(&view, size, 1.0, &stage()).unwrap()
}

fn front() -> View {
    View::default()
}

fn sum(picture: &RgbImage) -> f64 {
    picture.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / 255.0
}

#[test]
fn ink_covers_lines_and_areas_without_seams() {
    let size = [60, 50];
    let mut picture = RgbImage::new(60, 50);
    let mut ink = Ink::new(size);
    ink.line([[10.3, 20.0], [40.3, 20.0]], 2.0, [1.0; 2]);
    ink.lay(&mut picture, Rgb([255; 3]), 1.0);
    // 30 × 2 pixels and round ends, which are sampled at pixels: within a few percent.
    let area = 60.0 + std::f64::consts::PI;
    assert!((sum(&picture) - area).abs() < 0.04 * area, "{} {area}", sum(&picture));
    assert_eq!([picture.get_pixel(25, 20).0[0], picture.get_pixel(25, 22).0[0]], [255, 0]);
    // The coverage of a slanted line matches its length, and it runs from dim to bright.
    let mut picture = RgbImage::new(60, 50);
    let mut ink = Ink::new(size);
    ink.line([[5.0, 5.0], [45.0, 35.0]], 1.5, [0.0, 1.0]);
    ink.lay(&mut picture, Rgb([255; 3]), 1.0);
    assert!((sum(&picture) - 0.5 * 75.0).abs() < 2.5, "{}", sum(&picture));
    assert!(picture.get_pixel(9, 8).0[0] < picture.get_pixel(41, 32).0[0]);
    // Two triangles that touch are a rectangle without seam or overlap.
    let mut picture = RgbImage::from_pixel(60, 50, Rgb([100; 3]));
    let mut ink = Ink::new(size);
    let [a, b, c, d] = [[10.0, 10.0], [40.0, 12.0], [40.0, 30.0], [10.0, 30.0]];
    ink.area(&[a, b, c]);
    ink.area(&[a, c, d]);
    ink.lay(&mut picture, Rgb([200; 3]), 0.5);
    assert!((14..29).all(|y| (12..39).all(|x| picture.get_pixel(x, y).0 == [150; 3])));
    assert_eq!(picture.get_pixel(5, 5).0, [100; 3]);
    // Shapes outside the picture, or at invalid places, draw nothing.
    let mut ink = Ink::new(size);
    ink.line([[-90.0, -9.0], [-50.0, -9.0]], 3.0, [1.0; 2]);
    ink.line([[f64::NAN, 3.0], [9.0, 9.0]], 3.0, [1.0; 2]);
    ink.area(&[[100.0, 100.0], [120.0, 100.0], [120.0, 130.0]]);
    ink.area(&[]);
    assert_eq!(ink.covered(), 0);
}

fn marks<'a>(affine: DAffine3, seen: &'a dyn Fn(DVec3) -> f32) -> SliceMarks<'a> {
    SliceMarks { world_from_image: Transform::from_affine(affine), data: ClipRect::new(2, 3, 16, 12).unwrap(), seen }
}

/// Pixels of a hue: far closer to `colour` than to grey.
fn places(picture: &RgbImage, colour: Rgb<u8>) -> Vec<[f64; 2]> {
    let near = |p: &Rgb<u8>| p.0.iter().zip(colour.0).all(|(a, b)| a.abs_diff(b) < 24);
    picture.enumerate_pixels().filter(|(.., p)| near(p)).map(|(x, y, _)| [f64::from(x), f64::from(y)]).collect()
}

#[test]
fn slice_outline_and_probe_match_geometry() {
    // From the front the picture's right is +x and its down −z. Pixels of 1.5 mm: u along +x, v
    // along −z; the slice's data begins at (2, 3).
    let affine = DAffine3 {
        matrix3: DMat3::from_cols(DVec3::X * 1.5, DVec3::NEG_Z, DVec3::Y),
        translation: DVec3::new(-14.0, 0.0, 9.0),
    };
    for view in [front(), View { perspective: Some(30.0), ..front() }] {
        let camera = camera(view, [400, 300]);
        let clear = |_: DVec3| 1.0;
        let marks = marks(affine, &clear);
        let mut picture = RgbImage::new(400, 300);
        assert!(marks.outline(&mut picture, &camera) > 0);
        let lit = places(&picture, SLICE);
        let bound = |k: usize, f: fn(f64, f64) -> f64| lit.iter().map(|p| p[k]).reduce(f).unwrap();
        let project = |u: f64, v: f64| camera.project_world(affine.transform_point3(DVec3::new(u, v, 0.0))).unwrap();
        let (first, last) = (project(1.5, 2.5), project(17.5, 14.5));
        for k in 0..2 {
            assert!((bound(k, f64::min) - first[k]).abs() <= 1.0 && (bound(k, f64::max) - last[k]).abs() <= 1.0);
        }
        let mut picture = RgbImage::new(400, 300);
        assert!(marks.probe(&mut picture, &camera) > 0);
        let lit = places(&picture, PROBE);
        assert!(lit.len() > 40 && lit.iter().all(|p| p[1] <= first[1] + 1.0), "above the edge v = 0");
        let middle = lit.iter().map(|p| p[0]).sum::<f64>() / lit.len() as f64;
        assert!((middle - 0.5 * (first[0] + last[0])).abs() < 0.05 * (last[0] - first[0]), "{middle}");
    }
}

#[test]
fn hidden_lines_are_dim_and_none_behind_eye() {
    let affine = DAffine3 {
        matrix3: DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        translation: DVec3::new(-10.0, 0.0, 9.0),
    };
    let camera = camera(front(), [200, 200]);
    let bright = |seen: &dyn Fn(DVec3) -> f32| {
        let mut picture = RgbImage::new(200, 200);
        marks(affine, seen).outline(&mut picture, &camera);
        let half = |range: std::ops::Range<u32>| {
            picture.enumerate_pixels().filter(|(x, ..)| range.contains(x)).map(|(.., p)| f64::from(p.0[0])).sum::<f64>()
        };
        [half(0..100), half(100..200)]
    };
    let [left, right] = bright(&|_| 1.0);
    // All positions to the right of the origin are hidden.
    let [open, hidden] = bright(&|at| if at.x < 0.0 { 1.0 } else { 0.0 });
    assert!(
        (open / left - 1.0).abs() < 0.05 && (0.15..0.4).contains(&(hidden / right)),
        "{left} {right} {open} {hidden}"
    );
    // A slice behind a perspective view's eye.
    let eye = super::tests::camera(View { perspective: Some(60.0), ..front() }, [200, 200]);
    let behind = DAffine3 { translation: DVec3::new(0.0, -500.0, 0.0), ..affine };
    let mut picture = RgbImage::new(200, 200);
    let clear = |_: DVec3| 1.0;
    assert_eq!(marks(behind, &clear).outline(&mut picture, &eye), 0);
    assert_eq!(marks(behind, &clear).probe(&mut picture, &eye), 0);
    assert!(picture.pixels().all(|p| p.0 == [0; 3]));
}

#[test]
fn scale_bar_length_matches_its_label() {
    for size in [[400, 300], [512, 512], [150, 640]] {
        let camera = camera(front(), size);
        let bar = Bar::new(&camera, stage().centre_mm()).unwrap();
        let [a, b] = [0.0, bar.mm].map(|x| camera.project_world(DVec3::new(x, 0.0, 0.0)).unwrap()[0]);
        assert!((b - a - bar.px).abs() < 1e-6 && bar.px <= 0.25 * f64::from(size[0]), "{bar:?}");
        assert!(2.5 * bar.px > 0.25 * f64::from(size[0]) * (1.0 - 1e-9), "the next round number is too long");
        assert_eq!(bar.label, format!("{} mm", bar.mm));
        let mut picture = RgbImage::from_pixel(size[0], size[1], Rgb([90; 3]));
        assert!(bar.draw(&mut picture, &camera));
        let row = size[1] - 14;
        let lit = (0..size[0]).filter(|x| picture.get_pixel(*x, row).0[0] > 200).count() as f64;
        assert!((lit - bar.px).abs() <= 3.0, "{lit} {bar:?}");
    }
    // In perspective the bar is correct at the middle's depth, and its label gives this.
    let camera = camera(View { perspective: Some(50.0), ..front() }, [512, 512]);
    let bar = Bar::new(&camera, DVec3::ZERO).unwrap();
    assert!(bar.label.ends_with(" mm at the middle"));
    let far = Bar::new(&camera, DVec3::Y * 10.0).unwrap();
    assert!(far.px / far.mm < bar.px / bar.mm);
    // A picture without room stays unchanged.
    let tiny = super::tests::camera(front(), [20, 20]);
    let mut picture = RgbImage::new(20, 20);
    assert!(!Bar::new(&tiny, DVec3::ZERO).unwrap().draw(&mut picture, &tiny));
    assert!(picture.pixels().all(|p| p.0 == [0; 3]) && cube::draw(&mut picture, &tiny).is_empty());
}

#[test]
fn cube_shows_faces_towards_viewer() {
    let names = |azimuth: f64, elevation: f64| {
        let mut names: Vec<_> = faces(&View { azimuth, elevation, ..front() }.axes()).iter().map(|f| f.name).collect();
        names.sort_unstable();
        names
    };
    // Azimuth 0 looks along +y: the face towards the viewer is −Y; 90 along −x: +X.
    assert_eq!(names(0.0, 0.0), ["-Y"]);
    assert_eq!(names(90.0, 0.0), ["+X"]);
    assert_eq!(names(0.0, 90.0), ["+Z"]);
    assert_eq!(names(30.0, 20.0), ["+X", "+Z", "-Y"]);
    assert_eq!(names(210.0, -20.0), ["+Y", "-X", "-Z"]);
    // No name is upside down, at any roll of the picture.
    for roll in 0..24 {
        let axes = View {
            azimuth: 40.0,
            elevation: 60.0,
            roll: 15.0 * f64::from(roll),
            perspective: None,
            turns: false,
            ..View::default()
        }
        .axes();
        for face in faces(&axes) {
            assert!(face.up.dot(face.normal) == 0.0 && face.up.dot(axes.up) > 0.2, "{roll}: {face:?}");
        }
    }
    // Red is to the right of green, blue above both: the positions of x, y, z from that
    // viewpoint.
    let camera = camera(View { azimuth: 40.0, elevation: 30.0, ..front() }, [400, 400]);
    let mut picture = RgbImage::new(400, 400);
    assert_eq!(cube::draw(&mut picture, &camera).len(), 3);
    let middle = |channel: usize| {
        let of: Vec<_> = picture
            .enumerate_pixels()
            .filter(|(.., p)| (0..3).all(|c| c == channel || p.0[channel] > p.0[c].saturating_add(30)))
            .map(|(x, y, _)| [f64::from(x), f64::from(y)])
            .collect();
        assert!(of.len() > 100, "{channel}: {}", of.len());
        [0, 1].map(|k| of.iter().map(|p| p[k]).sum::<f64>() / of.len() as f64)
    };
    let [red, green, blue] = [0, 1, 2].map(middle);
    assert!(
        red[0] > green[0] + 10.0 && blue[1] < red[1] - 10.0 && blue[1] < green[1] - 10.0,
        "{red:?} {green:?} {blue:?}"
    );
    // The cube stays in its corner.
    assert!(picture.enumerate_pixels().all(|(x, y, p)| p.0 == [0; 3] || (x > 280 && y > 280)));
}

//! Orientation cube: it turns with the view, and each face is named after the axis that points
//! out of it.
//!
//! The frame is the tracker's or the reference's, not the patient's: axes are named by their
//! letter and sign. The cube uses parallel projection, in perspective views too.

use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};

use render::camera::{Axes, Camera};

use super::ink::Ink;
use crate::lettering;

/// Edge of the cube: a share of the picture's smaller side, within limits in pixels.
const SHARE: f64 = 0.1;
const LEAST: f64 = 22.0;
const MOST: f64 = 72.0;
/// Distance from the picture's edges, pixels.
const MARGIN: f64 = 10.0;
/// Faces viewed at a smaller cosine than this have no name.
const FLAT: f64 = 0.2;
/// Colours of the faces across x, y, z before lighting.
const FACES: [[f64; 3]; 3] = [[214.0, 96.0, 84.0], [98.0, 176.0, 92.0], [92.0, 138.0, 224.0]];
const EDGE: Rgb<u8> = Rgb([16, 16, 20]);
const LETTERS: Rgb<u8> = Rgb([250, 250, 250]);

/// A face of the cube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Face {
    /// Its name: the axis that points out of it.
    pub name: &'static str,
    /// Outward normal, in the world.
    pub normal: DVec3,
    /// Upward direction of its name.
    pub up: DVec3,
    /// Cosine of the viewing angle: 1 frontal, 0 edge on.
    pub faces: f64,
    axis: usize,
}

/// Returns the visible faces, up to three.
pub fn faces(axes: &Axes) -> Vec<Face> {
    let names = [["+X", "-X"], ["+Y", "-Y"], ["+Z", "-Z"]];
    let world = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut seen = Vec::new();
    for axis in 0..3 {
        for (name, normal) in names[axis].into_iter().zip([world[axis], -world[axis]]) {
            let faces = -normal.dot(axes.forward);
            // Rounding would draw a face viewed edge on as a line.
            if faces > 1e-6 {
                // The axis closest to the picture's upward direction is up for the name.
                let (one, other) = (world[(axis + 2) % 3], world[(axis + 1) % 3]);
                let upright = |a: DVec3, b: DVec3| if b.dot(axes.up) > a.dot(axes.up) + 1e-9 { b } else { a };
                let up = [-one, other, -other].into_iter().fold(one, upright);
                seen.push(Face { name, normal, up, faces, axis });
            }
        }
    }
    seen
}

/// Draws the cube at the picture's lower right. Returns the names of its visible faces, or none
/// if there is no room.
pub fn draw(picture: &mut RgbImage, camera: &Camera) -> Vec<&'static str> {
    let size = camera.size();
    let [width, height] = size.map(f64::from);
    let half = 0.5 * (SHARE * width.min(height)).clamp(LEAST, MOST);
    let radius = half * 3.0_f64.sqrt();
    if width.min(height) < 2.0 * (radius + MARGIN) {
        return Vec::new();
    }
    let middle = DVec2::new(width - MARGIN - radius, height - MARGIN - radius);
    let axes = camera.axes();
    let place = |at: DVec3| (middle + DVec2::new(at.dot(axes.right), -at.dot(axes.up)) * half).to_array();
    let faces = faces(&axes);
    let mut edges = Ink::new(size);
    for face in &faces {
        let right = face.up.cross(face.normal);
        let at = |x: f64, y: f64| place(face.normal + right * x + face.up * y);
        let corners = [at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)];
        let light = 0.42 + 0.58 * face.faces;
        let colour = FACES[face.axis].map(|c| (c * light).round().clamp(0.0, 255.0) as u8);
        let mut area = Ink::new(size);
        area.area(&corners);
        area.lay(picture, Rgb(colour), 1.0);
        for (n, from) in corners.iter().enumerate() {
            edges.line([*from, corners[(n + 1) % 4]], 1.4, [1.0; 2]);
        }
    }
    edges.lay(picture, EDGE, 1.0);
    for face in faces.iter().filter(|face| face.faces > FLAT) {
        letter(picture, face, &place);
    }
    faces.iter().map(|face| face.name).collect()
}

/// Draws a face's name in the plane of the face.
fn letter(picture: &mut RgbImage, face: &Face, place: &impl Fn(DVec3) -> [f64; 2]) {
    let right = face.up.cross(face.normal);
    let (wide, tall) = (f64::from(lettering::width(face.name, 1)), f64::from(lettering::height(1)));
    // The name takes two thirds of the face.
    let dot = 1.36 / wide;
    let at =
        |x: f64, y: f64| place(face.normal + right * (dot * (x - 0.5 * wide)) - face.up * (dot * (y - 0.5 * tall)));
    let mut ink = Ink::new([picture.width(), picture.height()]);
    lettering::dots(face.name, |x, y| {
        let (x, y) = (f64::from(x), f64::from(y));
        ink.area(&[at(x, y), at(x + 1.0, y), at(x + 1.0, y + 1.0), at(x, y + 1.0)]);
    });
    ink.lay(picture, LETTERS, 1.0);
}

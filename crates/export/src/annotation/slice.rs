//! The current slice and its probe in a picture.
//!
//! The slice is the outline of its data rectangle. The probe is above the edge v = 0, which is
//! the transducer's position in MF orientation. Parts behind tissue are dimmer, by the picture's
//! transmittance in front of them.

use glam::DVec3;
use image::{Rgb, RgbImage};

use render::camera::Camera;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::region::ClipRect;

use super::SHADE;
use super::ink::Ink;

/// Colour of the slice's outline: a yellow distinct from all grey levels.
pub const SLICE: Rgb<u8> = Rgb([255, 206, 64]);
/// Colour of the probe.
pub const PROBE: Rgb<u8> = Rgb([120, 214, 255]);

/// Parts of a line, each with its own occlusion.
const PARTS: u32 = 64;
/// Remaining opacity of a completely hidden line.
const HIDDEN: f32 = 0.25;
/// Opacity of the probe's body where nothing hides it.
const BODY: f32 = 0.4;
/// The probe's half width, as a share of the slice's width.
const PROBE_SIZE: f64 = 0.12;

/// The probe's outline about its middle, in units of its half width: to the right, and away from
/// the slice.
const OUTLINE: [[f64; 2]; 16] = [
    [-1.0, 0.0],
    [-1.0, 0.35],
    [-0.9, 0.6],
    [-0.6, 0.85],
    [-0.46, 1.15],
    [-0.42, 2.2],
    [-0.34, 2.4],
    [-0.12, 2.5],
    [0.12, 2.5],
    [0.34, 2.4],
    [0.42, 2.2],
    [0.46, 1.15],
    [0.6, 0.85],
    [0.9, 0.6],
    [1.0, 0.35],
    [1.0, 0.0],
];
/// Its cable.
const CABLE: [[f64; 2]; 4] = [[0.0, 2.5], [0.02, 2.8], [0.1, 3.1], [0.28, 3.4]];

/// Drawn properties of a slice.
#[derive(Clone, Copy)]
pub struct SliceMarks<'a> {
    /// Pixels to world mm.
    pub world_from_image: Transform<World, ImageFrame>,
    /// The rectangle of its data pixels.
    pub data: ClipRect,
    /// Visibility of a world position, 0 to 1: the transmittance of the picture in front of it.
    pub seen: &'a dyn Fn(DVec3) -> f32,
}

impl SliceMarks<'_> {
    /// Returns the corners of the data rectangle, half a pixel beyond the outermost centres, in
    /// order from the first pixel's; world mm.
    pub fn corners(&self) -> [DVec3; 4] {
        let (u0, v0) = (f64::from(self.data.x) - 0.5, f64::from(self.data.y) - 0.5);
        let (u1, v1) = (u0 + f64::from(self.data.width), v0 + f64::from(self.data.height));
        [[u0, v0], [u1, v0], [u1, v1], [u0, v1]].map(|[u, v]| self.world_from_image.point(DVec3::new(u, v, 0.0)))
    }

    /// Draws the slice's outline; returns the number of covered pixels.
    pub fn outline(&self, picture: &mut RgbImage, camera: &Camera) -> u64 {
        let [a, b, c, d] = self.corners();
        self.lines(picture, camera, &[a, b, c, d, a], 1.6, SLICE)
    }

    /// Draws the probe above the middle of the slice's upper edge; returns the number of covered
    /// pixels.
    pub fn probe(&self, picture: &mut RgbImage, camera: &Camera) -> u64 {
        let [a, b, _, d] = self.corners();
        let middle = 0.5 * (a + b);
        let half = (b - a) * PROBE_SIZE;
        let away = (a - d).normalize_or_zero() * half.length();
        let place = |[x, y]: [f64; 2]| middle + half * x + away * y;
        let mut outline: Vec<DVec3> = OUTLINE.map(place).to_vec();
        let body: Option<Vec<[f64; 2]>> = outline.iter().map(|at| camera.project_world(*at)).collect();
        if let Some(body) = body {
            let mut ink = Ink::new(camera.size());
            ink.area(&body);
            ink.lay(picture, PROBE, BODY * (self.seen)(middle + away));
        }
        outline.push(place(OUTLINE[0]));
        let covered = self.lines(picture, camera, &outline, 1.6, PROBE);
        covered + self.lines(picture, camera, &CABLE.map(place), 1.6, PROBE)
    }

    /// Draws lines from place to place.
    fn lines(&self, picture: &mut RgbImage, camera: &Camera, places: &[DVec3], width: f64, colour: Rgb<u8>) -> u64 {
        let size = camera.size();
        let (mut ink, mut shade) = (Ink::new(size), Ink::new(size));
        let whole: f64 = places.windows(2).map(|w| (w[1] - w[0]).length()).sum();
        for pair in places.windows(2) {
            // Short lines have few parts, so that a curve costs no more than an edge.
            let share = (pair[1] - pair[0]).length() / whole.max(f64::MIN_POSITIVE);
            let parts = ((share * f64::from(PARTS * 4)).ceil() as u32).clamp(1, PARTS);
            let mut before: Option<([f64; 2], f32)> = None;
            for n in 0..=parts {
                let at = pair[0].lerp(pair[1], f64::from(n) / f64::from(parts));
                // There is nothing to draw beside and behind a perspective view's eye.
                let here = camera.project_world(at).map(|pixel| (pixel, HIDDEN + (1.0 - HIDDEN) * (self.seen)(at)));
                if let (Some((from, dim)), Some((to, bright))) = (before, here) {
                    ink.line([from, to], width, [dim, bright]);
                    shade.line([from, to], width + 2.0, [dim, bright]);
                }
                before = here;
            }
        }
        shade.lay(picture, SHADE, 0.55);
        ink.lay(picture, colour, 1.0);
        shade.covered()
    }
}

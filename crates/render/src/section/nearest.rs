//! Samples of the slices themselves in a plane: each pixel shows the nearest slice's image
//! directly, without a volume.

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::slice::{Image, Pixels, Slice};

use super::Sampled;
use super::plane::Section;

/// Work done for planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct NearestWork {
    /// Slices inserted.
    pub slices: u64,
    /// Slices out of reach of every pixel.
    pub slices_beside: u64,
    /// Pixels times slices.
    pub pixels: u64,
    /// Pixels whose distance was computed. The others lie beside the slice's image or out of
    /// reach, as computed per row.
    pub pixels_considered: u64,
    /// Pixels that took a slice's grey level.
    pub pixels_taken: u64,
}

impl std::ops::AddAssign for NearestWork {
    fn add_assign(&mut self, other: Self) {
        self.slices += other.slices;
        self.slices_beside += other.slices_beside;
        self.pixels += other.pixels;
        self.pixels_considered += other.pixels_considered;
        self.pixels_taken += other.pixels_taken;
    }
}

/// A pixel's nearest slice so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Distance of the slice's plane, mm; infinite if there is none.
    pub distance_mm: f64,
    /// Number of its frame; 0 if there is none.
    pub item: u64,
    /// Its image there, interpolated between the data pixels about the foot of the
    /// perpendicular.
    pub sampled: Sampled,
}

/// A section that collects the nearest slices; insert them oldest first.
#[derive(Debug, Clone)]
pub struct NearestSlices {
    section: Section,
    pixels: Vec<Nearest>,
    work: NearestWork,
}

/// Returns the transform from the world to slice coordinates: u, v (pixels) of the foot of the
/// perpendicular, and the distance from the plane (mm); `None` for a degenerate slice plane.
pub fn slice_from_world(world_from_image: Transform<World, ImageFrame>) -> Option<DAffine3> {
    let affine = world_from_image.affine();
    let (u, v) = (affine.matrix3.x_axis, affine.matrix3.y_axis);
    let normal = u.cross(v).try_normalize()?;
    let slice = DAffine3 { matrix3: DMat3::from_cols(u, v, normal), translation: affine.translation };
    let inverse = slice.inverse();
    inverse.is_finite().then_some(inverse)
}

/// Interpolates the image bilinearly at a place (pixels) between those of the four nearest
/// pixels that are data.
pub(super) fn between(image: &Image, mask: &Mask, u: f64, v: f64) -> Sampled {
    let (fu, fv) = (u.floor(), v.floor());
    let (mut sum, mut shares) = (0.0, 0.0);
    for corner in 0..4_u32 {
        let (du, dv) = (corner & 1, corner >> 1);
        let (pu, pv) = (fu + f64::from(du), fv + f64::from(dv));
        let share = if du == 1 { u - fu } else { 1.0 - (u - fu) } * if dv == 1 { v - fv } else { 1.0 - (v - fv) };
        if share == 0.0 || pu < 0.0 || pv < 0.0 || pu >= f64::from(image.width()) || pv >= f64::from(image.height()) {
            continue;
        }
        // Whole numbers within the image.
        let (pu, pv) = (pu as u32, pv as u32);
        let at = pv as usize * image.width() as usize + pu as usize;
        let value = match image.pixels() {
            Pixels::U8(p) => f64::from(p[at]),
            Pixels::U16(p) => f64::from(p[at]),
            Pixels::F32(p) => f64::from(p[at]),
        };
        if mask.contains(pu, pv) && value.is_finite() {
            sum += share * value;
            shares += share;
        }
    }
    Sampled::of(sum, shares, shares)
}

impl NearestSlices {
    /// Creates a section without slices.
    pub fn new(section: Section) -> Self {
        let none = Nearest { distance_mm: f64::INFINITY, item: 0, sampled: Sampled::UNSEEN };
        Self { pixels: vec![none; section.pixels()], section, work: NearestWork::default() }
    }

    /// Inserts another slice. A pixel takes it if its data is nearer than all earlier slices and
    /// not beyond `reach_mm`. At equal distance the older slice stays.
    pub fn insert(&mut self, item: u64, slice: &Slice, mask: &Mask, reach_mm: f64) {
        self.work.slices += 1;
        self.work.pixels += self.pixels.len() as u64;
        let considered = self.work.pixels_considered;
        if let Some(to_slice) = slice_from_world(slice.world_from_image) {
            let [width, height] = [slice.image.width(), slice.image.height()].map(f64::from);
            let bounds = [[-0.5, width - 0.5], [-0.5, height - 0.5], [-reach_mm, reach_mm]];
            for j in 0..self.section.size[1] {
                self.row(j, item, slice, mask, &to_slice, bounds);
            }
        }
        self.work.slices_beside += u64::from(self.work.pixels_considered == considered);
    }

    fn row(&mut self, j: u32, item: u64, slice: &Slice, mask: &Mask, to_slice: &DAffine3, bounds: [[f64; 2]; 3]) {
        let base = to_slice.transform_point3(self.section.at(0, j));
        let step = to_slice.transform_vector3(self.section.right);
        let mut range = [0, self.section.size[0]];
        for (a, [low, high]) in bounds.into_iter().enumerate() {
            range = Section::between(range, base[a], step[a], low, high);
        }
        self.work.pixels_considered += u64::from(range[1] - range[0]);
        let [_, _, [_, reach_mm]] = bounds;
        for i in range[0]..range[1] {
            let at: DVec3 = to_slice.transform_point3(self.section.at(i, j));
            let distance_mm = at.z.abs();
            let nearest = &mut self.pixels[j as usize * self.section.size[0] as usize + i as usize];
            if distance_mm > reach_mm || distance_mm >= nearest.distance_mm {
                continue;
            }
            let sampled = between(&slice.image, mask, at.x, at.y);
            if sampled.is_seen() {
                *nearest = Nearest { distance_mm, item, sampled };
                self.work.pixels_taken += 1;
            }
        }
    }

    /// Returns the section.
    pub fn section(&self) -> &Section {
        &self.section
    }

    /// Returns each pixel's nearest slice, row by row.
    pub fn nearest(&self) -> &[Nearest] {
        &self.pixels
    }

    /// Returns the samples, row by row.
    pub fn sampled(&self) -> Vec<Sampled> {
        self.pixels.iter().map(|nearest| nearest.sampled).collect()
    }

    /// Returns the work done so far.
    pub fn work(&self) -> NearestWork {
        self.work
    }
}

//! Synthetic slices, and access to a reconstructor's results.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use mask::Mask;
use reconstruct::kernel::{AxisKernel, Method};
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::reference::in_plane;
use reconstruct::{Path, PathReconstructor, Reconstructor, Settings};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::brick_volume::SEEN;
use volume::{BrickVolume, Grid, Voxels};

/// The kernels' methods. New methods are tested by adding them here.
pub(crate) const METHODS: [Method; 6] = Method::ALL;
/// Kernels that blur as their variance says. That of the fourth order has none, and lobes.
pub(crate) const BLURRING: [Method; 5] =
    [Method::Gaussian, Method::GaussianTruncated, Method::BSpline3, Method::Linear, Method::Nearest];
/// Methods whose in-plane kernel has the requested σ, and not the pixels'.
pub(crate) const WIDE: [Method; 3] = [Method::Gaussian, Method::GaussianTruncated, Method::BSpline3];
/// Both insertion paths.
pub(crate) const PATHS: [Path; 2] = [Path::General, Path::Planar];

/// Fraction of the in-plane kernel that must lie on data.
const LEAST_CERTAINTY: f64 = 0.2;

pub(crate) fn image(size: [u32; 2], grey: impl Fn(u32, u32) -> f32) -> Image {
    let [width, height] = size;
    let pixels: Vec<f32> = (0..width * height).map(|i| grey(i % width, i / width)).collect();
    Image::new(width, height, Pixels::F32(Arc::from(pixels)))
}

pub(crate) fn constant(size: [u32; 2], grey: f32) -> Image {
    image(size, |_, _| grey)
}

/// Noise from 0 to 255 that is the same on every machine.
pub(crate) fn noise(size: [u32; 2], seed: u32) -> Image {
    image(size, |u, v| {
        let mut x = (seed << 20) ^ (v << 10) ^ u;
        for _ in 0..3 {
            x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
            x ^= x >> 12;
        }
        (x >> 8) as f32 / (1 << 24) as f32 * 255.0
    })
}

/// A probe held in a fixed direction: images whose middles lie on a line along their normal.
#[derive(Clone, Copy)]
pub(crate) struct Probe {
    pub(crate) size: [u32; 2],
    pub(crate) pixel_mm: f64,
    /// Columns: directions of u, v and the normal in the world.
    pub(crate) axes: DMat3,
    /// World position of the middle of the image at 0 mm.
    pub(crate) centre: DVec3,
}

impl Probe {
    /// Returns a probe along the world's axes, about its origin.
    pub(crate) fn straight(size: [u32; 2], pixel_mm: f64) -> Self {
        Self { size, pixel_mm, axes: DMat3::IDENTITY, centre: DVec3::ZERO }
    }

    /// Returns a probe at angles that no lattice has.
    pub(crate) fn oblique(size: [u32; 2], pixel_mm: f64) -> Self {
        Self { axes: turned(0.7, -0.4, 0.3), ..Self::straight(size, pixel_mm) }
    }

    /// Returns a probe as held by an arm: u along the world's z, v along x, slices side by side
    /// along y.
    pub(crate) fn arm(size: [u32; 2], pixel_mm: f64) -> Self {
        Self { axes: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y), ..Self::straight(size, pixel_mm) }
    }

    /// Maps pixels to the world, `along` mm along the normal.
    pub(crate) fn pose(&self, along: f64) -> DAffine3 {
        let [u, v, n] = [self.axes.x_axis * self.pixel_mm, self.axes.y_axis * self.pixel_mm, self.axes.z_axis];
        let middle = self.size.map(|n| 0.5 * (f64::from(n) - 1.0));
        DAffine3 {
            matrix3: DMat3::from_cols(u, v, n),
            translation: self.centre + n * along - u * middle[0] - v * middle[1],
        }
    }

    /// Returns an image as a slice, `along` mm along the normal.
    pub(crate) fn put(&self, image: &Image, along: f64) -> Slice {
        posed(image, self.pose(along))
    }

    /// Returns the slice of a scene at that position; in f32, so that nothing is rounded to
    /// integer grey levels.
    pub(crate) fn scan(&self, along: f64, scene: impl Fn(DVec3) -> f64) -> Slice {
        let pose = self.pose(along);
        let at = |u: u32, v: u32| pose.transform_point3(DVec3::new(f64::from(u), f64::from(v), 0.0));
        posed(&image(self.size, |u, v| scene(at(u, v)) as f32), pose)
    }

    pub(crate) fn mask(&self) -> Mask {
        Mask::full(self.size[0], self.size[1])
    }
}

/// Directions turned by three angles, rad.
pub(crate) fn turned(x: f64, y: f64, z: f64) -> DMat3 {
    DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, x, y, z))
}

pub(crate) fn posed(image: &Image, pose: DAffine3) -> Slice {
    Slice { image: image.clone(), time_ns: 0, world_from_image: Transform::from_affine(pose) }
}

/// Positions from `-reach` to `reach`, `gap` apart, one of them 0.
pub(crate) fn positions(reach: f64, gap: f64) -> impl Iterator<Item = f64> {
    let n = (reach / gap) as i32;
    (-n..=n).map(move |i| f64::from(i) * gap)
}

pub(crate) fn reconstruct_all<'a>(
    settings: Settings,
    mask: &Mask,
    slices: impl IntoIterator<Item = &'a Slice>,
) -> Reconstructor {
    let mut reconstructor = Reconstructor::new(settings, mask.clone()).unwrap();
    for slice in slices {
        reconstructor.insert(slice).unwrap();
    }
    reconstructor
}

/// Returns a reconstructor on one of the paths. The planar one uses the world's axes and
/// refuses slices that leave the plane.
pub(crate) fn reconstructor(path: Path, settings: Settings, mask: Mask) -> PathReconstructor {
    match path {
        Path::General => PathReconstructor::general(settings, mask),
        Path::Planar => PathReconstructor::planar(settings, on_the_world_s_axes(OnDeparture::Refuse), mask),
    }
    .unwrap()
}

pub(crate) fn on_the_world_s_axes(on_departure: OnDeparture) -> PlanarSettings {
    PlanarSettings { direction: Some(DMat3::IDENTITY), on_departure, ..PlanarSettings::default() }
}

/// Voxels of 0.5 mm.
pub(crate) fn half_mm() -> Settings {
    Settings::new(DVec3::splat(0.5))
}

/// A voxel with weight.
pub(crate) struct Voxel {
    pub(crate) index: [i64; 3],
    /// Position in the world, mm.
    pub(crate) at: DVec3,
    pub(crate) value: f64,
    pub(crate) weight: f32,
}

/// Returns the seen voxels.
pub(crate) fn seen(reconstructor: &Reconstructor) -> Vec<Voxel> {
    weighted(reconstructor).filter(|voxel| voxel.weight > SEEN).collect()
}

/// Returns the voxels of any weight.
pub(crate) fn weighted(reconstructor: &Reconstructor) -> impl Iterator<Item = Voxel> + '_ {
    let world_from_lattice = reconstructor.world_from_lattice();
    reconstructor.volume().iter().flat_map(move |(place, brick)| {
        (0..brick.w.len()).filter(|i| brick.w[*i] > 0.0).map(move |i| {
            let inside = volume::brick::voxel_at(i);
            let index: [i64; 3] = std::array::from_fn(|a| i64::from(place[a]) * 8 + inside[a] as i64);
            Voxel {
                index,
                at: world_from_lattice.point(DVec3::from_array(index.map(|x| x as f64))),
                value: f64::from(brick.r[i]) / f64::from(brick.w[i]),
                weight: brick.w[i],
            }
        })
    })
}

/// Returns the voxels of any weight in a volume of either kind, in the order of the lattice:
/// index, numerator, weight.
pub(crate) fn held(volume: &dyn Voxels) -> Vec<([i64; 3], f32, f32)> {
    let mut blocks: Vec<_> = volume.blocks().collect();
    blocks.sort_unstable();
    let (mut r, mut w) = ([0.0; 8], [0.0; 8]);
    let mut voxels = Vec::new();
    for block in blocks {
        let [x, y, z] = block.map(|i| i64::from(i) * 8);
        for i in 0..64 {
            let start = [x, y + i % 8, z + i / 8];
            volume.row(start, &mut r, &mut w);
            let row = (0_i64..).zip(r.iter().zip(&w)).filter(|(_, (_, w))| **w > 0.0);
            voxels.extend(row.map(|(k, (r, w))| ([start[0] + k, start[1], start[2]], *r, *w)));
        }
    }
    voxels
}

/// Hashes the content of a volume of either kind, to the bit, independent of the order in which
/// its parts were created.
pub(crate) fn content(volume: &dyn Voxels) -> u64 {
    let mut hasher = DefaultHasher::new();
    for (index, r, w) in held(volume) {
        (index, r.to_bits(), w.to_bits()).hash(&mut hasher);
    }
    hasher.finish()
}

/// Hashes every bit of a volume, and the order of its bricks.
pub(crate) fn state(volume: &BrickVolume) -> u64 {
    let mut hasher = DefaultHasher::new();
    for (place, brick) in volume.iter() {
        place.hash(&mut hasher);
        brick.r.iter().chain(&brick.w).for_each(|x| x.to_bits().hash(&mut hasher));
    }
    hasher.finish()
}

/// Returns the largest distance of the seen voxels from a constant, relative to it, and their
/// number.
pub(crate) fn off_constant(reconstructor: &Reconstructor, constant: f32) -> (f64, usize) {
    let seen = seen(reconstructor);
    let c = f64::from(constant);
    let worst = seen.iter().map(|voxel| (voxel.value / c - 1.0).abs()).fold(0.0, f64::max);
    (worst, seen.len())
}

/// Returns the lattice around the seen voxels, a few voxels wider, and the lattice index of its
/// first voxel.
pub(crate) fn grid_around(reconstructor: &Reconstructor) -> (Grid, [i64; 3]) {
    let (low, high) = reconstructor.volume().seen_bounds().expect("something was seen");
    let low = low.map(|x| x - 4);
    let size = [0, 1, 2].map(|a| (high[a] + 4 - low[a] + 1) as u64);
    let origin = reconstructor.world_from_lattice().point(DVec3::from_array(low.map(|x| x as f64)));
    (Grid { origin, spacing: reconstructor.settings().spacing_mm, direction: DMat3::IDENTITY, size }, low)
}

/// Comparison of one slice's result with the equations, voxel by voxel.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Comparison {
    /// Voxels that both have.
    pub(crate) both: u64,
    /// Voxels that should have been reached but were not.
    pub(crate) missing: u64,
    /// Voxels that should not have been reached but were.
    pub(crate) surplus: u64,
    /// Largest difference of values.
    pub(crate) worst: f64,
}

/// Compares a volume of one slice with the equations. Voxels within `hair` (relative) of the
/// support's end, or within the filter's deviation of the least certainty, may be reached or
/// not.
pub(crate) fn compare(reconstructor: &Reconstructor, slice: &Slice, mask: &Mask, hair: f64) -> Comparison {
    let kernels: &[AxisKernel; 3] = reconstructor.kernels().unwrap();
    let pose = slice.world_from_image.affine();
    let [u, v] = [pose.matrix3.x_axis, pose.matrix3.y_axis];
    let plane = DAffine3 { matrix3: DMat3::from_cols(u, v, u.cross(v).normalize()), translation: pose.translation };
    let image_from_world = plane.inverse();
    let (grid, low) = grid_around(reconstructor);
    let [nx, ny, nz] = grid.size.map(|n| n as i64);
    let deviation = reconstructor.decimation().unwrap().1;
    let mut result = Comparison::default();
    for i in 0..nx * ny * nz {
        let voxel = [low[0] + i % nx, low[1] + i / nx % ny, low[2] + i / (nx * ny)];
        let world = reconstructor.world_from_lattice().point(DVec3::from_array(voxel.map(|x| x as f64)));
        let at = image_from_world.transform_point3(world);
        let end = at.z.abs() / kernels[2].support_mm;
        let (value, certainty) = if end > 1.0 + hair {
            (0.0, 0.0)
        } else {
            in_plane(slice, mask, kernels, [u.length(), v.length()], [at.x, at.y])
        };
        let (r, w) = reconstructor.volume().voxel(voxel);
        let must = end <= 1.0 - hair && certainty >= LEAST_CERTAINTY + deviation && kernels[2].weight(at.z) > 1e-6;
        let may = end <= 1.0 + hair && certainty >= LEAST_CERTAINTY - deviation;
        result.missing += u64::from(must && w == 0.0);
        result.surplus += u64::from(!may && w > 0.0);
        if may && w > SEEN {
            result.both += 1;
            result.worst = result.worst.max((f64::from(r / w) - value / certainty).abs());
        }
    }
    result
}

//! A volume's header, and the place that it gives the voxels.

use glam::{DMat3, DVec3};

use formats::image::VolumeHeader;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::reading::PixelType;

use super::Grid;
use super::lattice::{Canonical, canonical};

/// Header field with the box that the slices' data reaches: first and last voxel, both
/// inclusive, as indices from the file's first voxel.
pub const SLICES_BOX_FIELD: &str = "SonoweaveSlicesBox";
/// Header field with the slices' mean directions of u (to the right in the image) and v (away
/// from the probe): six numbers, world frame.
pub const SLICE_AXES_FIELD: &str = "SonoweaveSliceAxes";
/// Header field with the values of black and white in the scanner's image.
pub const RANGE_FIELD: &str = "SonoweaveRange";

/// Grey range if nothing specifies one.
const GREY_LEVELS: [f32; 2] = [0.0, 255.0];
/// A box farther from the file's voxels than this is ignored, in voxels.
const FARTHEST: i64 = 1 << 30;

/// Header of a volume whose voxels have the indices of the [canonical](super::lattice) lattice.
#[derive(Debug, Clone)]
pub struct PlacedHeader {
    header: VolumeHeader,
    canonical: Canonical,
    slices_box: Option<[[i64; 3]; 2]>,
}

impl PlacedHeader {
    /// Places the voxels of a header.
    pub fn new(header: VolumeHeader) -> Self {
        let canonical = canonical(grid(&header).world_from_volume());
        Self { canonical, slices_box: slices_box(&header), header }
    }

    /// The header.
    pub fn header(&self) -> &VolumeHeader {
        &self.header
    }

    /// Converts a voxel's index in the file to its canonical index.
    pub fn index(&self, voxel: [i64; 3]) -> [i64; 3] {
        self.canonical.index(voxel)
    }

    /// A voxel's canonical index minus its index in the file.
    pub fn offset(&self) -> [i64; 3] {
        self.canonical.offset
    }

    /// The grid of the file's voxels, by their indices in the file.
    pub fn grid(&self) -> Grid {
        grid(&self.header)
    }

    /// Maps canonical voxel indices to world mm.
    pub fn world_from_lattice(&self) -> Transform<World, Volume> {
        self.canonical.world_from_lattice
    }

    /// First and last voxel of the box to view, by canonical index: the slices' box if the file
    /// has one, else the whole file.
    pub fn bounds(&self) -> [[i64; 3]; 2] {
        let all = [[0; 3], self.header.size.map(|n| i64::from(n) - 1)];
        self.slices_box.unwrap_or(all).map(|voxel| self.canonical.index(voxel))
    }

    /// The slices' mean directions of u and v in the world, each of length 1, if the file has
    /// them.
    pub fn slice_axes(&self) -> Option<[DVec3; 2]> {
        let [ux, uy, uz, vx, vy, vz] = field::<f64, 6>(&self.header, SLICE_AXES_FIELD)?;
        let (u, v) = (DVec3::new(ux, uy, uz), DVec3::new(vx, vy, vz));
        // The file's numbers are used unchanged, so that the view is the same as in replay,
        // which computes them from the poses.
        let sane = [u, v].iter().all(|axis| (axis.length() - 1.0).abs() < 1e-6) && u.dot(v).abs() < 1e-6;
        sane.then_some([u, v])
    }

    /// Values of black and white that the file gives, or its scalar type; `None` if they are the
    /// smallest and the largest value.
    pub fn range(&self) -> Option<[f32; 2]> {
        if let Some([low, high]) = field::<f32, 2>(&self.header, RANGE_FIELD)
            && low < high
            && low.is_finite()
            && high.is_finite()
        {
            return Some([low, high]);
        }
        let ours = self.header.fields.iter().any(|(name, _)| name.starts_with("Sonoweave"));
        match self.header.pixel {
            PixelType::U8 => Some(GREY_LEVELS),
            PixelType::U16 => Some([0.0, f32::from(u16::MAX)]),
            PixelType::F32 if ours => Some(GREY_LEVELS),
            _ => None,
        }
    }

    /// Values of black and white, given the smallest and the largest value seen.
    pub fn range_of(&self, extremes: Option<[f32; 2]>) -> [f32; 2] {
        self.range().unwrap_or(match extremes {
            Some([low, high]) if low < high => [low, high],
            Some([low, _]) => [low, low + 1.0],
            None => GREY_LEVELS,
        })
    }
}

/// Parses a header field of N numbers; `None` if it is anything else.
pub fn field<T: std::str::FromStr, const N: usize>(header: &VolumeHeader, name: &str) -> Option<[T; N]> {
    let (_, text) = header.fields.iter().find(|(field, _)| field == name)?;
    let numbers: Vec<T> = text.split_whitespace().map(|word| word.parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}

/// Returns the box of [`SLICES_BOX_FIELD`], if it is valid and near the file's voxels. A
/// program that cropped or scaled the volume may have kept the field.
pub fn slices_box(header: &VolumeHeader) -> Option<[[i64; 3]; 2]> {
    let [lx, ly, lz, hx, hy, hz] = field::<i64, 6>(header, SLICES_BOX_FIELD)?;
    let (low, high) = ([lx, ly, lz], [hx, hy, hz]);
    let size = header.size.map(i64::from);
    let sane = (0..3).all(|a| low[a] <= high[a] && low[a] < size[a] && high[a] >= 0);
    (sane && low.iter().chain(&high).all(|x| x.abs() < FARTHEST)).then_some([low, high])
}

/// Returns the grid of a file's voxels.
pub(crate) fn grid(header: &VolumeHeader) -> Grid {
    let [x, y, z] = header.axes.map(DVec3::from_array);
    Grid {
        origin: DVec3::from_array(header.origin),
        spacing: DVec3::from_array(header.spacing),
        direction: DMat3::from_cols(x, y, z),
        size: header.size.map(u64::from),
    }
}

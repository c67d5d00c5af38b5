//! The difference of two volumes, voxel by voxel, where both were seen.
//!
//! Volumes on one lattice are subtracted directly, even if their boxes differ. Otherwise, if
//! the caller allows it, the second is interpolated (trilinearly) at the voxels of the first;
//! this smooths. An interpolated value exists only if every contributing voxel was seen, since
//! unseen is not black.

use glam::DVec3;

use formats::image::VolumeHeader;

use super::dense::DenseVolume;
use super::grid::Grid;
use super::read::Values;

/// Largest distance at which two lattices count as one, voxels.
const SAME_LATTICE: f64 = 1e-3;
/// A position within this distance of a voxel's centre, in voxels, uses that voxel only.
const ON_VOXEL: f64 = 1e-6;

/// Reasons for which volumes cannot be subtracted voxel by voxel.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Apart {
    /// Several values a voxel.
    #[error("volumes of several channels are not compared; give volumes of one")]
    Channels,
    /// A volume without a position in space.
    #[error(
        "one is a NIfTI that does not say where it lies (the codes of sform and qform are 0); give the file it was made of"
    )]
    Placeless,
    /// Different lattices: the property that differs.
    #[error("{0}")]
    Lattices(String),
    /// One lattice, but no common voxel.
    #[error("they do not overlap; give two volumes of one place")]
    Disjoint,
}

/// The overlap of two volumes on one lattice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overlap {
    /// First common voxel, by index in either volume.
    pub first: [[u32; 3]; 2],
    /// Common voxels along x, y, z.
    pub size: [u32; 3],
}

impl Overlap {
    /// Computes the overlap of two volumes from their headers.
    ///
    /// # Errors
    /// [`Apart`]: different lattices, or no voxel in common.
    pub fn of(a: &VolumeHeader, b: &VolumeHeader) -> Result<Self, Apart> {
        if !(a.placed && b.placed) {
            return Err(Apart::Placeless);
        }
        if a.channels != 1 || b.channels != 1 {
            return Err(Apart::Channels);
        }
        let three = |values: [f64; 3]| values.map(|v| v.to_string()).join("×");
        let mut this = Self { first: [[0; 3]; 2], size: [0; 3] };
        for axis in 0..3 {
            let (along, spacing) = (a.axes[axis], a.spacing[axis]);
            let longest = f64::from(a.size[axis].max(b.size[axis]));
            if (b.spacing[axis] / spacing - 1.0).abs() * longest > SAME_LATTICE {
                let differ = format!("their spacings differ, {} and {} mm", three(a.spacing), three(b.spacing));
                return Err(Apart::Lattices(differ));
            }
            let turned = (0..3).map(|k| (along[k] - b.axes[axis][k]).abs()).fold(0.0, f64::max);
            if turned * longest > SAME_LATTICE {
                return Err(Apart::Lattices(
                    "their axes have different directions, as those of a planar scan and of the world: reconstruct both by the general path"
                        .into(),
                ));
            }
            let shift = (0..3).map(|k| (b.origin[k] - a.origin[k]) * along[k]).sum::<f64>() / spacing;
            if (shift - shift.round()).abs() > SAME_LATTICE || shift.abs() > 1e9 {
                return Err(Apart::Lattices(format!(
                    "their lattices are {:.3} of a voxel apart along axis {axis}; reconstruct with the origin of the other",
                    shift - shift.round()
                )));
            }
            let shift = shift.round() as i64;
            let first = shift.max(0);
            let last = i64::from(a.size[axis]).min(shift + i64::from(b.size[axis]));
            let whole = |n: i64| u32::try_from(n).map_err(|_| Apart::Disjoint);
            this.first[0][axis] = whole(first)?;
            this.first[1][axis] = whole(first - shift)?;
            this.size[axis] = whole(last - first)?;
        }
        if this.size.contains(&0) { Err(Apart::Disjoint) } else { Ok(this) }
    }
}

/// Sums over pairs of values, in their order.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sums {
    /// Number of pairs.
    pub n: u64,
    /// Sum of the first values.
    pub a: f64,
    /// Sum of the second values.
    pub b: f64,
    aa: f64,
    bb: f64,
    ab: f64,
    /// Sum of the squared differences.
    pub squares: f64,
    /// The largest absolute difference; NaN if any was NaN.
    pub max: f64,
}

impl Sums {
    /// Adds a pair.
    pub fn add(&mut self, a: f64, b: f64) {
        let difference = a - b;
        self.n += 1;
        self.a += a;
        self.b += b;
        self.aa += a * a;
        self.bb += b * b;
        self.ab += a * b;
        self.squares += difference * difference;
        // `f64::max` would drop a NaN.
        self.max = if difference.is_nan() || self.max.is_nan() { f64::NAN } else { self.max.max(difference.abs()) };
    }

    /// Root of the mean squared difference.
    pub fn rmse(&self) -> f64 {
        (self.squares / self.n as f64).sqrt()
    }

    /// Mean of the first values less the second.
    pub fn bias(&self) -> f64 {
        (self.a - self.b) / self.n as f64
    }

    /// Pearson's correlation; `None` if one of the two does not vary.
    pub fn correlation(&self) -> Option<f64> {
        let n = self.n as f64;
        let variances = (self.aa - self.a * self.a / n) * (self.bb - self.b * self.b / n);
        let correlation = (self.ab - self.a * self.b / n) / variances.sqrt();
        correlation.is_finite().then_some(correlation)
    }
}

/// The first volume less the second, on the first one's lattice and in its box.
pub struct Difference {
    /// Grid of the first volume.
    pub grid: Grid,
    /// First less second, x fastest; NaN unless both were seen.
    pub values: Vec<f32>,
    /// Whether the second volume was interpolated.
    pub resampled: bool,
    /// Voxels of the first volume's box that were seen in the first only.
    pub only_first: u64,
    /// Voxels seen in the second only: anywhere in the second on one lattice, else at the first
    /// one's voxels.
    pub only_second: u64,
    /// Voxels of the first volume's box that were seen in neither.
    pub neither: u64,
    /// Sums over voxels seen in both.
    pub sums: Sums,
    /// Voxel of the first volume with the largest difference, by its index in the file.
    pub worst: Option<[u64; 3]>,
}

impl Difference {
    /// Bytes that the difference takes for this first volume.
    pub fn bytes(first: &VolumeHeader) -> u64 {
        first.size.iter().fold(size_of::<f32>() as u64, |bytes, n| bytes.saturating_mul(u64::from(*n)))
    }

    /// Subtracts two volumes on one lattice; with `may_resample`, on any lattices.
    ///
    /// # Errors
    /// [`Apart`]: different lattices without permission to resample, or no voxel in common.
    pub fn of(first: &DenseVolume, second: &DenseVolume, may_resample: bool) -> Result<Self, Apart> {
        let second_at = match Overlap::of(first.header(), second.header()) {
            Ok(overlap) => Second::Shifted(std::array::from_fn(|a| {
                i64::from(overlap.first[1][a]) - i64::from(overlap.first[0][a])
            })),
            Err(Apart::Lattices(_)) if may_resample => Second::Resampled,
            Err(apart) => return Err(apart),
        };
        let grid = first.grid();
        let [nx, ny, nz] = grid.size;
        let mut this = Self {
            grid,
            values: Vec::with_capacity((nx * ny * nz) as usize),
            resampled: matches!(second_at, Second::Resampled),
            only_first: 0,
            only_second: 0,
            neither: 0,
            sums: Sums::default(),
            worst: None,
        };
        let row = || (vec![0.0_f32; nx as usize], vec![0.0_f32; nx as usize]);
        let ((mut a, mut wa), (mut b, mut wb)) = (row(), row());
        let sampler = Sampler::new(&grid, second);
        let mut most = -1.0;
        for z in 0..nz {
            for y in 0..ny {
                first.values(first.index([0, y as i64, z as i64]), &mut a, &mut wa);
                match second_at {
                    Second::Shifted(by) => {
                        let voxel = [by[0], y as i64 + by[1], z as i64 + by[2]];
                        second.values(second.index(voxel), &mut b, &mut wb);
                    }
                    Second::Resampled => sampler.row([y, z], &mut b, &mut wb),
                }
                for (x, (a, b)) in a.iter().zip(&b).enumerate() {
                    let difference = match (wa[x] > 0.0, wb[x] > 0.0) {
                        (true, true) => {
                            this.sums.add(f64::from(*a), f64::from(*b));
                            a - b
                        }
                        (sees_first, sees_second) => {
                            this.only_first += u64::from(sees_first);
                            this.only_second += u64::from(sees_second);
                            this.neither += u64::from(!sees_first && !sees_second);
                            f32::NAN
                        }
                    };
                    if difference.abs() > most {
                        (most, this.worst) = (difference.abs(), Some([x as u64, y, z]));
                    }
                    this.values.push(difference);
                }
            }
        }
        if !this.resampled {
            // Includes voxels beyond the first one's box.
            this.only_second = second.seen() - this.sums.n;
        }
        Ok(this)
    }

    /// Returns the difference at a voxel of the first volume, by its index in the file; `None`
    /// unless both were seen.
    pub fn at(&self, [x, y, z]: [u64; 3]) -> Option<f32> {
        let [nx, ny, _] = self.grid.size;
        Some(self.values[((z * ny + y) * nx + x) as usize]).filter(|value| !value.is_nan())
    }
}

/// Position of the first volume's voxels in the second.
enum Second {
    /// At the voxel's own index plus this.
    Shifted([i64; 3]),
    /// Between voxels.
    Resampled,
}

/// Interpolates a volume at the positions of another lattice.
struct Sampler<'a> {
    volume: &'a DenseVolume,
    /// Maps indices of the lattice to indices in the volume's file.
    to_volume: glam::DAffine3,
}

impl<'a> Sampler<'a> {
    fn new(lattice: &Grid, volume: &'a DenseVolume) -> Self {
        let to_index = volume.grid().world_from_volume().affine().inverse();
        Self { volume, to_volume: to_index * lattice.world_from_volume().affine() }
    }

    fn row(&self, [y, z]: [u64; 2], values: &mut [f32], weights: &mut [f32]) {
        for (x, (value, weight)) in values.iter_mut().zip(weights).enumerate() {
            let at = self.to_volume.transform_point3(DVec3::new(x as f64, y as f64, z as f64));
            (*value, *weight) = self.at(at).map_or((0.0, 0.0), |value| (value, 1.0));
        }
    }

    fn at(&self, at: DVec3) -> Option<f32> {
        if !at.is_finite() || at.abs().max_element() > 1e9 {
            return None;
        }
        let mut first = [0_i64; 3];
        let mut parts = [0.0; 3];
        for axis in 0..3 {
            let nearest = at[axis].round();
            let place = if (at[axis] - nearest).abs() < ON_VOXEL { nearest } else { at[axis] };
            (first[axis], parts[axis]) = (place.floor() as i64, place - place.floor());
        }
        let mut sum = 0.0;
        for corner in 0..4_usize {
            let [dy, dz] = [corner & 1, corner >> 1];
            let part = [[1.0 - parts[1], parts[1]][dy], [1.0 - parts[2], parts[2]][dz]];
            let along = part[0] * part[1];
            if along == 0.0 {
                continue;
            }
            let (mut value, mut weight) = ([0.0; 2], [0.0; 2]);
            let voxel = [first[0], first[1] + dy as i64, first[2] + dz as i64];
            self.volume.values(self.volume.index(voxel), &mut value, &mut weight);
            for (x, part) in [1.0 - parts[0], parts[0]].into_iter().enumerate() {
                if part > 0.0 {
                    if weight[x] <= 0.0 {
                        return None;
                    }
                    sum += along * part * f64::from(value[x]);
                }
            }
        }
        Some(sum as f32)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::path::{Path, PathBuf};

    use formats::image::write::VolumeWriter;
    use sonoweave_core::reading::PixelType;

    use super::*;

    fn header(size: [u32; 3], origin: [f64; 3]) -> VolumeHeader {
        VolumeHeader { origin, spacing: [0.5; 3], ..VolumeHeader::new(size, PixelType::F32) }
    }

    /// Writes a file of a function of world mm; NaN is unseen.
    fn file(folder: &Path, name: &str, header: &VolumeHeader, value: impl Fn(DVec3) -> f64) -> PathBuf {
        let path = folder.join(name);
        let mut writer = VolumeWriter::create(&path, header).unwrap();
        let [nx, ny, nz] = header.size;
        for i in 0..nx * ny * nz {
            let index = DVec3::new(f64::from(i % nx), f64::from(i / nx % ny), f64::from(i / (nx * ny)));
            let steps = index * DVec3::from_array(header.spacing);
            let at = (0..3)
                .fold(DVec3::from_array(header.origin), |at, a| at + DVec3::from_array(header.axes[a]) * steps[a]);
            writer.write_all(&(value(at) as f32).to_ne_bytes()).unwrap();
        }
        writer.finish().unwrap();
        path
    }

    fn open(path: &Path) -> DenseVolume {
        DenseVolume::open(path, None, 1 << 30).unwrap()
    }

    #[test]
    fn lattices_overlap_by_whole_voxels_or_refused() {
        let a = header([10, 10, 10], [0.0; 3]);
        let overlap = Overlap::of(&a, &header([10, 4, 20], [1.0, -1.0, -2.5])).unwrap();
        assert_eq!((overlap.first, overlap.size), ([[2, 0, 0], [0, 2, 5]], [8, 2, 10]));
        let fails = |b: &VolumeHeader, text: &str| {
            let why = Overlap::of(&a, b).err().unwrap().to_string();
            assert!(why.contains(text), "{why}");
        };
        fails(&header([10, 10, 10], [0.1, 0.0, 0.0]), "0.200 of a voxel apart along axis 0");
        fails(&header([10, 10, 10], [5.0, 0.0, 0.0]), "do not overlap");
        fails(&header([10, 10, 10], [-50.0, 0.0, 0.0]), "do not overlap");
        fails(&VolumeHeader { spacing: [0.5, 0.5, 0.6], ..a.clone() }, "spacings differ");
        fails(&VolumeHeader { axes: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], ..a.clone() }, "directions");
        fails(&VolumeHeader { channels: 3, ..a.clone() }, "several channels");
    }

    #[test]
    fn sums_of_known_numbers() {
        let mut sums = Sums::default();
        for (a, b) in [(1.0, 2.0), (2.0, 4.0), (3.0, 6.0)] {
            sums.add(a, b);
        }
        assert_eq!((sums.n, sums.squares, sums.max, sums.bias()), (3, 14.0, 3.0, -2.0));
        assert!((sums.correlation().unwrap() - 1.0).abs() < 1e-12);
        sums.add(f64::NAN, 1.0);
        sums.add(1.0, 1.0);
        assert!(sums.squares.is_nan() && sums.max.is_nan() && sums.correlation().is_none());
    }

    #[test]
    fn same_lattice_subtracted_where_both_seen() {
        let folder = tempfile::tempdir().unwrap();
        let ramp = |at: DVec3| 10.0 * at.x + at.y;
        let a = open(&file(folder.path(), "a.mha", &header([8, 6, 4], [0.0; 3]), |at| {
            if at.z < 0.4 { f64::NAN } else { ramp(at) }
        }));
        let b = open(&file(folder.path(), "b.mha", &header([8, 6, 4], [1.0, 0.0, -0.5]), |at| {
            if at.x > 2.9 { f64::NAN } else { ramp(at) + if at.y == 0.0 { 3.0 } else { -1.0 } }
        }));
        let d = Difference::of(&a, &b, false).unwrap();
        // Common x 1.0 to 2.5, four voxels; all y; z 0.5 and 1.0.
        assert_eq!((d.sums.n, d.resampled), (4 * 6 * 2, false));
        assert_eq!((d.only_first, d.only_second), (8 * 6 * 3 - 48, 4 * 6 * 4 - 48));
        assert_eq!(d.neither, 4 * 6);
        assert!((d.sums.bias() - (-3.0 + 5.0) / 6.0).abs() < 1e-6 && (d.sums.max - 3.0).abs() < 1e-5);
        assert_eq!((d.worst, d.at([2, 0, 1]), d.at([2, 0, 0])), (Some([2, 0, 1]), Some(-3.0), None));
        assert_eq!(d.at([5, 5, 2]), Some(1.0));
    }

    #[test]
    fn other_lattice_interpolated_if_allowed() {
        let folder = tempfile::tempdir().unwrap();
        let linear = |at: DVec3| 3.0 * at.x - 2.0 * at.y + 0.5 * at.z + 40.0;
        let a = open(&file(folder.path(), "a.mha", &header([8, 8, 8], [0.0; 3]), linear));
        let turned = VolumeHeader {
            // Rotated about z by a right angle and by the angle whose tangent is 3/4, and
            // finer.
            axes: [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]],
            spacing: [0.3, 0.4, 0.7],
            ..header([40, 40, 20], [0.6, -6.0, -2.05])
        };
        let b = open(&file(folder.path(), "b.mha", &turned, linear));
        assert!(matches!(Difference::of(&a, &b, false), Err(Apart::Lattices(_))));
        let d = Difference::of(&a, &b, true).unwrap();
        assert!(d.resampled && d.sums.n > 300, "{}", d.sums.n);
        // Linear functions are interpolated exactly.
        assert!(d.sums.max < 1e-4, "{}", d.sums.max);
        assert_eq!(d.sums.n + d.only_first + d.only_second + d.neither, 512);
        // Between an unseen voxel and its neighbour there is no value; exactly at the neighbour
        // there is.
        let holed = open(&file(folder.path(), "h.mha", &header([8, 8, 8], [0.25, 0.0, 0.0]), |at| {
            if at.distance(DVec3::new(1.75, 1.5, 1.5)) < 1e-9 { f64::NAN } else { linear(at) }
        }));
        let d = Difference::of(&a, &holed, true).unwrap();
        let hidden = (0..512_u64).map(|i| [i % 8, i / 8 % 8, i / 64]).filter(|v| v[0] > 0 && d.at(*v).is_none());
        assert_eq!(hidden.collect::<Vec<_>>(), [[3, 3, 3], [4, 3, 3]]);
        assert_eq!((d.only_first, d.sums.n), (64 + 2, 512 - 66));
    }
}

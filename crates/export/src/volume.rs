//! Writes a volume to a MetaImage file: values, and weights in a second file on request.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use reconstruct::Settings;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::reading::PixelType;
use volume::brick::{EDGE, VOXELS};
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use super::ExportError;
use super::fill::FILLED;

/// Largest number of voxels in a dense file: a stray pose must not fill the disk.
pub const MOST_VOXELS: u64 = 1 << 34;

/// Scalar type of the written values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scalar {
    /// 8 bit unsigned.
    U8,
    /// 16 bit unsigned.
    U16,
    /// Single precision.
    F32,
}

impl Scalar {
    /// Returns the name on the command line and in statistics.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::U16 => "u16",
            Self::F32 => "f32",
        }
    }

    /// Returns the bytes of a value.
    pub fn bytes(self) -> u64 {
        self.pixel().bytes() as u64
    }

    /// Returns the scalar type in a file.
    pub fn pixel(self) -> PixelType {
        match self {
            Self::U8 => PixelType::U8,
            Self::U16 => PixelType::U16,
            Self::F32 => PixelType::F32,
        }
    }

    /// Returns the value that the upper end of a window is mapped to.
    pub fn top(self) -> f32 {
        self.most().unwrap_or(1.0)
    }

    /// Returns the largest value of an integer type.
    fn most(self) -> Option<f32> {
        match self {
            Self::U8 => Some(255.0),
            Self::U16 => Some(65535.0),
            Self::F32 => None,
        }
    }
}

/// Settings for writing values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Encoding {
    /// Scalar type.
    pub scalar: Scalar,
    /// Grey values that become 0 and the type's largest value (for f32: 0 and 1); `None` writes
    /// them unchanged.
    pub window: Option<[f32; 2]>,
    /// Value written for unseen voxels.
    pub unseen: f32,
}

impl Encoding {
    /// Returns a seen voxel's written value, still as a number.
    fn value(&self, value: f32) -> f32 {
        let top = self.scalar.top();
        let scaled = self.window.map_or(value, |[low, high]| (value - low) / (high - low) * top);
        match self.scalar.most() {
            Some(most) => scaled.round_ties_even().clamp(0.0, most),
            None => scaled,
        }
    }

    /// Returns the written number for a numerator and its weight: the value of a seen or filled
    /// voxel, else the unseen value.
    pub fn written(&self, r: f32, w: f32) -> f32 {
        if w > SEEN || w == FILLED { self.value(r / w) } else { self.unseen }
    }

    /// Writes the values of numerators and weights, in native byte order.
    fn write(&self, r: &[f32], w: &[f32], bytes: &mut [u8]) {
        let values = r.iter().zip(w).map(|(r, w)| self.written(*r, *w));
        match self.scalar {
            Scalar::U8 => bytes.iter_mut().zip(values).for_each(|(byte, value)| *byte = value as u8),
            Scalar::U16 => numbers(bytes, values.map(|value| (value as u16).to_ne_bytes())),
            Scalar::F32 => numbers(bytes, values.map(f32::to_ne_bytes)),
        }
    }
}

/// Writes numbers one after the other.
fn numbers<const N: usize>(bytes: &mut [u8], numbers: impl Iterator<Item = [u8; N]>) {
    bytes.as_chunks_mut::<N>().0.iter_mut().zip(numbers).for_each(|(place, number)| *place = number);
}

/// A dense box of voxels: its position on the lattice, and in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseBox {
    /// Lattice index of its first voxel.
    pub first: [i64; 3],
    /// The same box in the world.
    pub grid: Grid,
}

impl DenseBox {
    /// Creates a box of `size` voxels from `first` on, in a volume reconstructed with these
    /// settings.
    pub fn new(
        first: [i64; 3],
        size: [u64; 3],
        world_from_lattice: Transform<World, Volume>,
        settings: &Settings,
    ) -> Self {
        let origin = world_from_lattice.point(DVec3::from_array(first.map(|x| x as f64)));
        Self { first, grid: Grid { origin, spacing: settings.spacing_mm, direction: settings.lattice_direction, size } }
    }

    /// Returns the lattice indices of its first and last voxel.
    pub fn ends(&self) -> [[i64; 3]; 2] {
        [self.first, [0, 1, 2].map(|a| self.first[a] + self.grid.size[a] as i64 - 1)]
    }

    /// Creates the smallest box around all seen voxels, given their lowest and highest indices.
    pub fn around(
        [low, high]: [[i64; 3]; 2],
        world_from_lattice: Transform<World, Volume>,
        settings: &Settings,
    ) -> Self {
        Self::new(low, [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64), world_from_lattice, settings)
    }
}

/// Writes values that [`write_values_of`] extracted from a volume, whole or not at all. `fields` go
/// into the header.
///
/// # Errors
/// The errors of [`write_values`].
pub fn write_taken(
    space: &DenseBox,
    scalar: Scalar,
    values: &[u8],
    path: &Path,
    fields: &[(String, String)],
) -> Result<(), ExportError> {
    let mut file = VolumeWriter::create(path, &header(space, scalar.pixel(), fields)?)?;
    file.write_all(values).map_err(|source| ExportError::Write { path: path.to_owned(), source })?;
    Ok(file.finish()?)
}

fn header(space: &DenseBox, pixel: PixelType, fields: &[(String, String)]) -> Result<VolumeHeader, ExportError> {
    let grid = &space.grid;
    let too_large = || ExportError::VolumeTooLarge { size: grid.size, most: MOST_VOXELS };
    if grid.voxels().is_none_or(|n| n > MOST_VOXELS) {
        return Err(too_large());
    }
    let mut size = [0; 3];
    for (to, from) in size.iter_mut().zip(grid.size) {
        *to = u32::try_from(from).map_err(|_| too_large())?;
    }
    Ok(VolumeHeader {
        spacing: grid.spacing.to_array(),
        origin: grid.origin.to_array(),
        axes: [grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis].map(|a| a.to_array()),
        fields: fields.to_vec(),
        ..VolumeHeader::new(size, pixel)
    })
}

/// Rows of some planes of a box. The planes lie in one layer of the volume's blocks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Indices of the rows along y, in the box.
    rows: Range<u64>,
    /// Indices of the planes along z, in the box.
    planes: Range<u64>,
}

impl DenseBox {
    /// Returns parts of the box in the order of a file: all rows of some planes before the next
    /// planes. A part has one row of blocks, or as many more as `most` voxels hold. All parts
    /// together read each block of a volume once.
    pub fn parts(&self, most: u64) -> impl Iterator<Item = Part> + use<> {
        let ([nx, ny, nz], [_, y0, z0]) = (self.grid.size, self.first);
        let rows_of_blocks = most / (nx.max(1) * (EDGE * EDGE) as u64);
        pieces(z0, nz, 1).flat_map(move |planes| {
            pieces(y0, ny, rows_of_blocks.max(1)).map(move |rows| Part { rows, planes: planes.clone() })
        })
    }

    /// Returns the place of a part's planes in a file of `bytes_each` a voxel.
    fn bytes_of(&self, part: &Part, bytes_each: u64) -> Range<usize> {
        let [nx, ny, _] = self.grid.size;
        let at = |plane: u64| (plane * nx * ny * bytes_each) as usize;
        at(part.planes.start)..at(part.planes.end)
    }
}

/// Returns ranges of `count` indices, the first of which is `first` on the lattice. Each begins
/// where a block does, and has some blocks; the first and the last may be shorter.
fn pieces(first: i64, count: u64, blocks: u64) -> impl Iterator<Item = Range<u64>> {
    let edge = EDGE as u64;
    let begun = first.rem_euclid(EDGE as i64) as u64;
    let at = move |piece: u64| (piece * blocks * edge).saturating_sub(begun).min(count);
    (0..(begun + count).div_ceil(blocks * edge)).map(move |piece| at(piece)..at(piece + 1))
}

/// Writes a part into the bytes of its planes, by `write(numerators, weights, bytes)` for voxels
/// along x. A volume of columns would be read slowly row by row: each voxel of a row lies in
/// another column.
fn write_part(
    volume: &dyn Voxels,
    space: &DenseBox,
    part: &Part,
    bytes_each: u64,
    bytes: &mut [u8],
    write: impl Fn(&[f32], &[f32], &mut [u8]),
) {
    let ([nx, ny, _], [x0, y0, z0]) = (space.grid.size, space.first);
    let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
    let block_of = |first: i64, index: u64| (first + index as i64).div_euclid(EDGE as i64);
    let inside = |first: i64, index: u64| (first + index as i64).rem_euclid(EDGE as i64) as usize;
    for ys in pieces(y0 + part.rows.start as i64, part.rows.end - part.rows.start, 1) {
        let ys = ys.start + part.rows.start..ys.end + part.rows.start;
        for xs in pieces(x0, nx, 1) {
            let block = [block_of(x0, xs.start), block_of(y0, ys.start), block_of(z0, part.planes.start)];
            match block.map(i32::try_from) {
                [Ok(x), Ok(y), Ok(z)] => volume.block([x, y, z], &mut r, &mut w),
                // Beyond what volumes hold.
                _ => (r, w) = ([0.0; VOXELS], [0.0; VOXELS]),
            }
            for z in part.planes.clone() {
                for y in ys.clone() {
                    let line = (inside(z0, z) * EDGE + inside(y0, y)) * EDGE + inside(x0, xs.start);
                    let voxels = line..line + (xs.end - xs.start) as usize;
                    let at = ((z - part.planes.start) * ny + y) * nx;
                    let place = ((at + xs.start) * bytes_each) as usize..((at + xs.end) * bytes_each) as usize;
                    write(&r[voxels.clone()], &w[voxels], &mut bytes[place]);
                }
            }
        }
    }
}

/// Writes a part of a box into the values of the whole box, x fastest, in native byte order.
pub fn write_values_of(volume: &dyn Voxels, space: &DenseBox, encoding: &Encoding, part: &Part, values: &mut [u8]) {
    let each = encoding.scalar.bytes();
    let bytes = &mut values[space.bytes_of(part, each)];
    write_part(volume, space, part, each, bytes, |r, w, bytes| encoding.write(r, w, bytes));
}

/// Writes a part of a box into the weights of the whole box, like [`write_values_of`].
pub fn write_weights_of(volume: &dyn Voxels, space: &DenseBox, part: &Part, weights: &mut [u8]) {
    let each = Scalar::F32.bytes();
    let bytes = &mut weights[space.bytes_of(part, each)];
    write_part(volume, space, part, each, bytes, write_weight_bytes);
}

/// Returns the written weight: 0 for unseen voxels, and [`FILLED`] for filled ones.
fn written_weight(w: f32) -> f32 {
    if w > SEEN || w == FILLED { w } else { 0.0 }
}

/// Returns values and weights of the voxels of a box as they are written, x fastest, both as
/// numbers. The box has `size` voxels along x, y and z from lattice index `first` on, at which a
/// block begins. Outside of `bounds`, which are the lowest and the highest lattice index, voxels
/// are unseen.
pub fn written_box(
    volume: &dyn Voxels,
    first: [i64; 3],
    size: [usize; 3],
    bounds: [[i64; 3]; 2],
    encoding: &Encoding,
) -> (Vec<f32>, Vec<f32>) {
    let [nx, ny, nz] = size;
    let (mut values, mut weights) = (vec![encoding.unseen; nx * ny * nz], vec![0.0; nx * ny * nz]);
    let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
    // Indices in the box of a block's voxels that are kept, along an axis.
    let kept = |axis: usize, block: usize| {
        let [low, high] = bounds.map(|bound| bound[axis] - first[axis]);
        let end = ((block + EDGE).min(size[axis]) as i64).min(high + 1);
        let start = (block as i64).max(low).min(end);
        start.max(0) as usize..end.max(0) as usize
    };
    for z0 in (0..nz).step_by(EDGE) {
        for y0 in (0..ny).step_by(EDGE) {
            for x0 in (0..nx).step_by(EDGE) {
                let start = [first[0] + x0 as i64, first[1] + y0 as i64, first[2] + z0 as i64];
                volume.block(start.map(|voxel| (voxel / EDGE as i64) as i32), &mut r, &mut w);
                let xs = kept(0, x0);
                for z in kept(2, z0) {
                    for y in kept(1, y0) {
                        let (line, row) = (((z - z0) * EDGE + y - y0) * EDGE, (z * ny + y) * nx);
                        for x in xs.clone() {
                            let (r, w) = (r[line + x - x0], w[line + x - x0]);
                            values[row + x] = encoding.written(r, w);
                            weights[row + x] = written_weight(w);
                        }
                    }
                }
            }
        }
    }
    (values, weights)
}

/// Writes weights.
fn write_weight_bytes(_: &[f32], w: &[f32], bytes: &mut [u8]) {
    numbers(bytes, w.iter().map(|w| written_weight(*w).to_ne_bytes()));
}

/// Writes a box of voxels to a file, by `write(numerators, weights, bytes)`.
fn write_file(
    volume: &dyn Voxels,
    space: &DenseBox,
    path: &Path,
    header: &VolumeHeader,
    write: impl Fn(&[f32], &[f32], &mut [u8]),
) -> Result<(), ExportError> {
    let mut file = VolumeWriter::create(path, header)?;
    let mut bytes = Vec::new();
    for part in space.parts(u64::MAX) {
        let each = header.pixel.bytes() as u64;
        bytes.resize(space.bytes_of(&part, each).len(), 0);
        write_part(volume, space, &part, each, &mut bytes, &write);
        file.write_all(&bytes).map_err(|source| ExportError::Write { path: path.to_owned(), source })?;
    }
    Ok(file.finish()?)
}

/// Writes the values of a box of voxels, whole or not at all. `fields` go into the header.
///
/// # Errors
/// [`ExportError`] when the box is too large or the file cannot be written; then no file is
/// left.
pub fn write_values(
    volume: &dyn Voxels,
    space: &DenseBox,
    path: &Path,
    encoding: &Encoding,
    fields: &[(String, String)],
) -> Result<(), ExportError> {
    let header = header(space, encoding.scalar.pixel(), fields)?;
    write_file(volume, space, path, &header, |r, w, bytes| encoding.write(r, w, bytes))
}

/// Writes the weights of a box of voxels as f32: 0 for unseen voxels, and [`FILLED`] for filled
/// ones.
///
/// # Errors
/// The errors of [`write_values`].
pub fn write_weights(
    volume: &dyn Voxels,
    space: &DenseBox,
    path: &Path,
    fields: &[(String, String)],
) -> Result<(), ExportError> {
    let header = header(space, PixelType::F32, fields)?;
    write_file(volume, space, path, &header, write_weight_bytes)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use glam::DMat3;
    use volume::brick::BrickIndex;

    use super::*;

    fn encoding(scalar: Scalar, window: Option<[f32; 2]>) -> Encoding {
        Encoding { scalar, window, unseen: 0.0 }
    }

    #[test]
    fn integers_are_rounded_and_clamped() {
        let plain = encoding(Scalar::U8, None);
        assert_eq!([99.4, 99.6, -0.2, 255.4].map(|v| plain.value(v)), [99.0, 100.0, 0.0, 255.0]);
    }

    #[test]
    fn window_ends_map_to_type_ends() {
        for (scalar, top) in [(Scalar::U8, 255.0), (Scalar::U16, 65535.0), (Scalar::F32, 1.0)] {
            let e = encoding(scalar, Some([-100.0, 300.0]));
            assert_eq!([-100.0, 300.0].map(|v| e.value(v)), [0.0, top], "{scalar:?}");
        }
        let e = encoding(Scalar::U16, Some([0.0, 2.0]));
        assert_eq!([-5.0, 1.0, 7.0].map(|v| e.value(v)), [0.0, 32768.0, 65535.0]);
    }

    /// Every voxel has another value; counts the blocks that are read.
    #[derive(Default)]
    struct Pattern(AtomicUsize);

    impl Voxels for Pattern {
        fn voxel(&self, [x, y, z]: [i64; 3]) -> (f32, f32) {
            let weight = 1.0 + (x.rem_euclid(3)) as f32;
            (weight * (x + 100 * y + 10_000 * z) as f32, if y % 5 == 0 { 0.0 } else { weight })
        }

        fn row(&self, [x, y, z]: [i64; 3], r: &mut [f32], w: &mut [f32]) {
            self.0.fetch_add(1, Ordering::Relaxed);
            for (x, (r, w)) in (x..).zip(r.iter_mut().zip(w)) {
                (*r, *w) = self.voxel([x, y, z]);
            }
        }

        fn seen_bounds(&self) -> Option<([i64; 3], [i64; 3])> {
            None
        }

        fn blocks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
            Box::new(std::iter::empty())
        }

        fn bytes(&self) -> u64 {
            0
        }
    }

    #[test]
    fn parts_of_any_size_give_each_voxel_and_read_each_block_once() {
        let encoding = Encoding { unseen: -1.0, ..encoding(Scalar::F32, None) };
        for (first, size, blocks, parts) in
            [([-3, 5, -9], [21, 19, 13], 4 * 3 * 3, [9, 6, 3]), ([8, -16, 0], [8, 16, 1], 2, [2, 1, 1])]
        {
            let grid = Grid { origin: DVec3::ZERO, spacing: DVec3::ONE, direction: DMat3::IDENTITY, size };
            let space = DenseBox { first, grid };
            let voxels =
                (0..size[2]).flat_map(|z| (0..size[1]).flat_map(move |y| (0..size[0]).map(move |x| [x, y, z])));
            let at = |voxel: [u64; 3]| Pattern::default().voxel([0, 1, 2].map(|a| first[a] + voxel[a] as i64));
            let expected: Vec<(f32, f32)> = voxels.map(at).collect();
            for (most, parts) in [0, 3000, u64::MAX].into_iter().zip(parts) {
                assert_eq!(space.parts(most).count(), parts, "{most}");
                let (pattern, count) = (Pattern::default(), size.iter().product::<u64>() as usize);
                let (mut values, mut weights) = (vec![0xff; 4 * count], vec![0xff; 4 * count]);
                for part in space.parts(most) {
                    write_values_of(&pattern, &space, &encoding, &part, &mut values);
                    write_weights_of(&pattern, &space, &part, &mut weights);
                }
                let floats = |bytes: &[u8]| -> Vec<f32> {
                    bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect()
                };
                assert_eq!(floats(&weights), expected.iter().map(|(_, w)| *w).collect::<Vec<_>>());
                assert_eq!(floats(&values), expected.iter().map(|(r, w)| encoding.written(*r, *w)).collect::<Vec<_>>());
                // The values' blocks, and the weights': each of 64 rows.
                assert_eq!(pattern.0.into_inner(), 2 * 64 * blocks, "{most}");
            }
        }
    }
}

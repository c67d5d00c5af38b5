//! Writes a volume to a MetaImage file: values, and weights in a second file on request.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use glam::DVec3;

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use reconstruct::Settings;
use sonoweave_core::frames::{Transform, Volume, World};
use sonoweave_core::reading::PixelType;
use volume::brick_volume::SEEN;
use volume::{Grid, Voxels};

use super::ExportError;
use super::fill::FILLED;

/// Largest number of voxels in a dense file: a stray pose must not fill the disk.
pub const MOST_VOXELS: u64 = 1 << 34;

/// Scalar type of the written values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
#[derive(Debug, Clone, Copy, PartialEq)]
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

    fn push(&self, value: f32, bytes: &mut Vec<u8>) {
        match self.scalar {
            Scalar::U8 => bytes.push(value as u8),
            Scalar::U16 => bytes.extend((value as u16).to_ne_bytes()),
            Scalar::F32 => bytes.extend(value.to_ne_bytes()),
        }
    }
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

    /// Creates the smallest box around all seen voxels, given their lowest and highest indices.
    pub fn around(
        [low, high]: [[i64; 3]; 2],
        world_from_lattice: Transform<World, Volume>,
        settings: &Settings,
    ) -> Self {
        Self::new(low, [0, 1, 2].map(|a| (high[a] - low[a] + 1) as u64), world_from_lattice, settings)
    }
}

/// Writes values that [`planes`] extracted from a volume, whole or not at all. `fields` go into
/// the header.
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

/// Writes rows of a box, made by `row(numerators, weights, bytes)`.
fn write_rows(
    volume: &dyn Voxels,
    space: &DenseBox,
    path: &Path,
    header: &VolumeHeader,
    mut row: impl FnMut(&[f32], &[f32], &mut Vec<u8>),
) -> Result<(), ExportError> {
    let mut file = VolumeWriter::create(path, header)?;
    let mut bytes = Vec::new();
    for z in 0..space.grid.size[2] {
        bytes.clear();
        rows_of(volume, space, z..z + 1, |r, w| row(r, w, &mut bytes));
        file.write_all(&bytes).map_err(|source| ExportError::Write { path: path.to_owned(), source })?;
    }
    Ok(file.finish()?)
}

/// Passes the rows of some planes of a box, numerators and weights, to `row` in order.
fn rows_of(volume: &dyn Voxels, space: &DenseBox, planes: Range<u64>, mut row: impl FnMut(&[f32], &[f32])) {
    let [nx, ny, _] = space.grid.size;
    let (mut r, mut w) = (vec![0.0; nx as usize], vec![0.0; nx as usize]);
    let [x0, y0, z0] = space.first;
    for z in planes {
        for y in 0..ny {
            volume.row([x0, y0 + y as i64, z0 + z as i64], &mut r, &mut w);
            row(&r, &w);
        }
    }
}

/// Appends the values of some planes of a box, x fastest, in native byte order.
pub fn planes(volume: &dyn Voxels, space: &DenseBox, encoding: &Encoding, planes: Range<u64>, bytes: &mut Vec<u8>) {
    rows_of(volume, space, planes, |r, w| {
        for (r, w) in r.iter().zip(w) {
            encoding.push(encoding.written(*r, *w), bytes);
        }
    });
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
    write_rows(volume, space, path, &header, |r, w, bytes| {
        for (r, w) in r.iter().zip(w) {
            encoding.push(encoding.written(*r, *w), bytes);
        }
    })
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
    write_rows(volume, space, path, &header, |_, w, bytes| push_weights(w, bytes))
}

fn push_weights(weights: &[f32], bytes: &mut Vec<u8>) {
    for w in weights {
        bytes.extend(if *w > SEEN || *w == FILLED { *w } else { 0.0 }.to_ne_bytes());
    }
}

/// Appends the weights of some planes of a box, x fastest, in native byte order, like
/// [`write_weights`].
pub fn planes_of_weights(volume: &dyn Voxels, space: &DenseBox, planes: Range<u64>, bytes: &mut Vec<u8>) {
    rows_of(volume, space, planes, |_, w| push_weights(w, bytes));
}

#[cfg(test)]
mod tests {
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
}

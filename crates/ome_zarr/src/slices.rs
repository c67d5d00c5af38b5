//! A level of a volume slice by slice, as other volume files are read.

use std::sync::Arc;

use formats::image::{VolumeHeader, VolumeSlices};
use sonoweave_core::reading::PixelType;
use volume::Grid;
use volume::dense::SLICES_BOX_FIELD;

use crate::array::Element;
use crate::error::OmeZarrError;
use crate::reader::OmeZarr;

/// Memory for the slices that are read at once, bytes: those of a layer of chunks, if they fit.
const SLAB_BYTES: u64 = 256 << 20;

/// Reads the values or the weights of a level, slice by slice along z.
pub struct SliceReader {
    volume: Arc<OmeZarr>,
    level: usize,
    header: VolumeHeader,
    is_weights: bool,
    /// Slices to be read at once, those read, and the first of them.
    at_once: u64,
    slab: Vec<f32>,
    first: u64,
    /// The next slice.
    next: u64,
    bytes: Vec<u8>,
}

impl SliceReader {
    /// Reads the values of a level. Integers of up to 16 bits keep their type; others become
    /// single precision.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such level, or its size exceeds 32 bits.
    pub fn values(volume: &Arc<OmeZarr>, level: usize) -> Result<Self, OmeZarrError> {
        let pixel = pixel(volume.level(level)?.values.element);
        Self::new(volume, level, pixel, false)
    }

    /// Reads the weights of a level: 0 for unseen voxels. Without weights in the volume, seen
    /// voxels have weight 1.
    ///
    /// # Errors
    /// Same as [`Self::values`].
    pub fn weights(volume: &Arc<OmeZarr>, level: usize) -> Result<Self, OmeZarrError> {
        Self::new(volume, level, PixelType::F32, true)
    }

    fn new(volume: &Arc<OmeZarr>, level: usize, pixel: PixelType, is_weights: bool) -> Result<Self, OmeZarrError> {
        let of = volume.level(level)?;
        let (header, size) = (header(volume, level, pixel)?, of.grid.size);
        // Values and weights are read together.
        let slice_bytes = 2 * size_of::<f32>() as u64 * size[0] * size[1];
        let at_once = (SLAB_BYTES / slice_bytes.max(1)).clamp(1, of.values.chunk[0]);
        let (slab, bytes) = (Vec::new(), Vec::new());
        Ok(Self { volume: Arc::clone(volume), level, header, is_weights, at_once, slab, first: 0, next: 0, bytes })
    }

    /// Reads the layer of slices that holds the next one.
    fn read(&mut self) -> Result<(), OmeZarrError> {
        let [nx, ny, nz] = self.header.size.map(u64::from);
        self.first = self.next;
        let count = self.at_once.min(nz - self.first);
        let mut start = self.volume.first(self.level)?;
        start[2] += self.first as i64;
        let (values, weights) = self.volume.read(self.level, start, [nx, ny, count])?;
        self.slab = if self.is_weights { weights } else { values };
        Ok(())
    }
}

impl VolumeSlices for SliceReader {
    fn header(&self) -> &VolumeHeader {
        &self.header
    }

    fn next_slice(&mut self) -> Result<Option<&[u8]>, formats::Error> {
        let [nx, ny, nz] = self.header.size.map(u64::from);
        if self.next == nz {
            return Ok(None);
        }
        let slice = (nx * ny) as usize;
        if self.next == self.first + (self.slab.len() / slice) as u64 {
            self.read().map_err(|error| formats::Error::Volume(Box::new(error)))?;
        }
        let values = self.slab[(self.next - self.first) as usize * slice..][..slice].iter();
        self.bytes.clear();
        match self.header.pixel {
            PixelType::U8 => self.bytes.extend(values.map(|value| *value as u8)),
            PixelType::U16 => self.bytes.extend(values.flat_map(|value| (*value as u16).to_ne_bytes())),
            PixelType::I16 => self.bytes.extend(values.flat_map(|value| (*value as i16).to_ne_bytes())),
            _ => self.bytes.extend(values.flat_map(|value| value.to_ne_bytes())),
        }
        self.next += 1;
        Ok(Some(&self.bytes))
    }
}

/// Returns the scalar type as which a level's values are read.
pub(crate) fn pixel(element: Element) -> PixelType {
    match element {
        Element::U8 => PixelType::U8,
        Element::U16 => PixelType::U16,
        Element::I16 => PixelType::I16,
        _ => PixelType::F32,
    }
}

/// Returns the header of a level.
///
/// # Errors
/// [`OmeZarrError`] when there is no such level, or its size exceeds 32 bits.
pub(crate) fn header(volume: &OmeZarr, level: usize, pixel: PixelType) -> Result<VolumeHeader, OmeZarrError> {
    let of = volume.level(level)?;
    let Grid { origin, spacing, direction, size } = of.grid;
    let [x, y, z] = size.map(|n| u32::try_from(n).ok());
    let (Some(x), Some(y), Some(z)) = (x, y, z) else {
        return Err(OmeZarrError::Memory { path: volume.path().into(), level, size });
    };
    Ok(VolumeHeader {
        spacing: spacing.to_array(),
        origin: origin.to_array(),
        axes: [direction.x_axis, direction.y_axis, direction.z_axis].map(|axis| axis.to_array()),
        fields: fields(volume, level, of.first),
        ..VolumeHeader::new([x, y, z], pixel)
    })
}

/// Returns the volume's fields, with the slices' box by the level's own indices.
fn fields(volume: &OmeZarr, level: usize, first: [i64; 3]) -> Vec<(String, String)> {
    let mut fields = volume.fields().to_vec();
    let Some(bounds) = volume.slices_box() else {
        fields.retain(|(name, _)| name != SLICES_BOX_FIELD || level == 0);
        return fields;
    };
    let corner = |corner: [i64; 3]| {
        std::array::from_fn::<_, 3, _>(|a| (corner[a].div_euclid(1 << level) - first[a]).to_string()).join(" ")
    };
    let own = bounds.map(corner).join(" ");
    match fields.iter_mut().find(|(name, _)| name == SLICES_BOX_FIELD) {
        Some((_, text)) => *text = own,
        None => fields.push((SLICES_BOX_FIELD.into(), own)),
    }
    fields
}

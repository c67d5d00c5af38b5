//! IMAGE: pixels, and their placement.
//!
//! The matrix's columns are the steps from a voxel to its neighbours along the three axes, mm.
//! Its fourth column is the position of the image's **middle**: of index (n − 1)/2 along each
//! axis, as in OpenIGTLinkIO, 3D Slicer and pyigtl. The length of a slice's third column is the
//! slice thickness, or 1.

use std::sync::Arc;

use sonoweave_core::reading::PixelType;

use super::cursor::{Cursor, Fault, Trouble};
use super::pose::Matrix;
use super::unwritable::Unwritable;

/// Bytes before the pixels.
const FIELDS: usize = 72;
/// Version of the image fields.
const VERSION: u16 = 1;

/// Directions of the coordinate axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Coordinates {
    /// Right, anterior, superior: the frame of TRANSFORM messages and of 3D Slicer.
    Ras = 1,
    /// Left, posterior, superior: the frame of ITK's files.
    Lps = 2,
}

/// An image, or a box of voxels from one.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Channels, interleaved; at least 1.
    pub channels: u8,
    /// Scalar type; not 64-bit integers, which the protocol lacks.
    pub pixel: PixelType,
    /// Whether the pixels are little-endian.
    pub little_endian: bool,
    /// Coordinate system of the matrix.
    pub coordinates: Coordinates,
    /// Voxels of the whole image, first axis fastest.
    pub size: [u16; 3],
    /// Placement of the whole image; see the module documentation.
    pub matrix: Matrix,
    /// First voxel of the transmitted box.
    pub first: [u16; 3],
    /// Voxels of the transmitted box.
    pub part: [u16; 3],
    /// Pixels of the box, as on the wire.
    pub pixels: Arc<[u8]>,
}

fn code(pixel: PixelType) -> Option<u8> {
    Some(match pixel {
        PixelType::I8 => 2,
        PixelType::U8 => 3,
        PixelType::I16 => 4,
        PixelType::U16 => 5,
        PixelType::I32 => 6,
        PixelType::U32 => 7,
        PixelType::F32 => 10,
        PixelType::F64 => 11,
        PixelType::U64 | PixelType::I64 => return None,
    })
}

fn pixel(code: u8) -> Option<PixelType> {
    Some(match code {
        2 => PixelType::I8,
        3 => PixelType::U8,
        4 => PixelType::I16,
        5 => PixelType::U16,
        6 => PixelType::I32,
        7 => PixelType::U32,
        10 => PixelType::F32,
        11 => PixelType::F64,
        _ => return None,
    })
}

impl Image {
    /// Creates a whole image of native byte order. `place` maps an index (a voxel's middle) to
    /// mm: 4×4, row major, column vectors.
    pub fn whole(
        size: [u16; 3],
        (pixel, channels): (PixelType, u8),
        pixels: Arc<[u8]>,
        place: &[f64; 16],
        coordinates: Coordinates,
    ) -> Self {
        let mut middle = *place;
        for row in 0..3 {
            middle[4 * row + 3] +=
                (0..3).map(|axis| place[4 * row + axis] * (f64::from(size[axis]) - 1.0) / 2.0).sum::<f64>();
        }
        let little_endian = cfg!(target_endian = "little");
        let matrix = Matrix::of(&middle);
        Self { channels, pixel, little_endian, coordinates, size, matrix, first: [0; 3], part: size, pixels }
    }

    /// Returns the matrix from an index of the whole image (a voxel's middle) to mm: 4×4, row
    /// major, column vectors.
    pub fn place(&self) -> [f64; 16] {
        let mut place = self.matrix.rows();
        for row in 0..3 {
            place[4 * row + 3] -=
                (0..3).map(|axis| place[4 * row + axis] * (f64::from(self.size[axis]) - 1.0) / 2.0).sum::<f64>();
        }
        place
    }

    /// Returns whether the box is the whole image.
    pub fn is_whole(&self) -> bool {
        self.part == self.size
    }

    /// Returns the pixels in native byte order.
    pub fn native(&self) -> Arc<[u8]> {
        let bytes = self.pixel.bytes();
        if bytes == 1 || self.little_endian == cfg!(target_endian = "little") {
            return Arc::clone(&self.pixels);
        }
        let mut turned: Arc<[u8]> = Arc::from(&*self.pixels);
        if let Some(pixels) = Arc::get_mut(&mut turned) {
            pixels.chunks_exact_mut(bytes).for_each(<[u8]>::reverse);
        }
        turned
    }

    /// Returns the bytes that the fields require; cannot overflow, because the fields are small.
    fn promised(&self) -> u64 {
        let voxels: u64 = self.part.iter().map(|n| u64::from(*n)).product();
        voxels * u64::from(self.channels) * self.pixel.bytes() as u64
    }

    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let wrong = |fields: &Cursor<'_>, back: usize, problem: String| {
            Err(Trouble { fault: Fault::Field, offset: fields.offset() - back, problem })
        };
        let version = fields.u16("the image's version")?;
        if version != VERSION {
            return wrong(&fields, 2, format!("the image's version is {version}, not {VERSION}"));
        }
        let channels = fields.u8("the number of channels")?;
        if channels == 0 {
            return wrong(&fields, 1, "an image needs at least one channel".into());
        }
        let scalar = fields.u8("the scalar type")?;
        let Some(pixel) = pixel(scalar) else {
            let problem = format!("the scalar type is {scalar}; it must be 2 to 7, 10 or 11");
            return wrong(&fields, 1, problem);
        };
        let endian = fields.u8("the byte order")?;
        if !matches!(endian, 1 | 2) {
            return wrong(&fields, 1, format!("the byte order is {endian}; it must be 1 (big) or 2 (little)"));
        }
        let coordinates = match fields.u8("the coordinates")? {
            1 => Coordinates::Ras,
            2 => Coordinates::Lps,
            other => return wrong(&fields, 1, format!("the coordinates are {other}; they must be 1 (RAS) or 2 (LPS)")),
        };
        let mut three = |field: &str| Ok::<_, Trouble>([fields.u16(field)?, fields.u16(field)?, fields.u16(field)?]);
        let size = three("the size")?;
        let matrix = Matrix::read(&mut fields)?;
        let mut three = |field: &str| Ok::<_, Trouble>([fields.u16(field)?, fields.u16(field)?, fields.u16(field)?]);
        let (first, part) = (three("the box's first voxel")?, three("the box's size")?);
        for axis in 0..3 {
            if u32::from(first[axis]) + u32::from(part[axis]) > u32::from(size[axis]) {
                let problem = format!("a box of {part:?} voxels from {first:?} is not within {size:?}");
                return wrong(&fields, 12, problem);
            }
        }
        let little_endian = endian == 2;
        let pixels: Arc<[u8]> = Arc::from([]);
        let mut image = Self { channels, pixel, little_endian, coordinates, size, matrix, first, part, pixels };
        let promised = image.promised();
        if promised != fields.left() as u64 {
            let problem = format!("{part:?} voxels take {promised} bytes, but there are {}", fields.left());
            return fields.trouble(Fault::Length, problem);
        }
        image.pixels = fields.slice("the pixels", fields.left())?.into();
        Ok(image)
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), Unwritable> {
        let scalar = code(self.pixel).ok_or(Unwritable::PixelType(self.pixel))?;
        let within =
            (0..3).all(|axis| u32::from(self.first[axis]) + u32::from(self.part[axis]) <= u32::from(self.size[axis]));
        if self.channels == 0 || !within || self.promised() != self.pixels.len() as u64 {
            let Self { channels, pixel, size, first, part, .. } = *self;
            return Err(Unwritable::Part { bytes: self.pixels.len(), first, part, size, channels, pixel });
        }
        out.reserve(FIELDS + self.pixels.len());
        out.extend_from_slice(&VERSION.to_be_bytes());
        out.extend_from_slice(&[self.channels, scalar, 1 + u8::from(self.little_endian), self.coordinates as u8]);
        for number in self.size {
            out.extend_from_slice(&number.to_be_bytes());
        }
        self.matrix.write(out);
        for number in self.first.iter().chain(&self.part) {
            out.extend_from_slice(&number.to_be_bytes());
        }
        out.extend_from_slice(&self.pixels);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_placement_converts_between_first_voxel_and_middle() {
        let place = [0.0, -0.75, 0.0, 10.0, 0.5, 0.0, 0.0, -20.0, 0.0, 0.0, 2.0, 30.0, 0.0, 0.0, 0.0, 1.0];
        let image = Image::whole([5, 3, 2], (PixelType::U8, 1), Arc::from([0; 30]), &place, Coordinates::Ras);
        // Two steps of the first axis, one of the second, half of the third.
        assert_eq!(image.matrix.0[9..], [9.25, -19.0, 31.0]);
        assert_eq!(image.place(), place);
        assert!(image.is_whole());
    }

    #[test]
    fn pixels_of_other_byte_order_are_swapped() {
        let mut image =
            Image::whole([2, 1, 1], (PixelType::U16, 1), Arc::from([1, 2, 3, 4]), &[0.0; 16], Coordinates::Lps);
        assert_eq!(*image.native(), [1, 2, 3, 4]);
        image.little_endian = !image.little_endian;
        assert_eq!(*image.native(), [2, 1, 4, 3]);
    }
}

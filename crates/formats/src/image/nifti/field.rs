//! Byte offsets of the fields in a NIfTI-1 header, and the voxel types.

use sonoweave_core::reading::PixelType;

/// Length of the header, bytes.
pub(super) const HEADER: usize = 348;
/// Bytes before the first extension: the header, and four that flag extensions.
pub(super) const EXTENSIONS: usize = HEADER + 4;
pub(super) const DIM: usize = 40;
pub(super) const DATATYPE: usize = 70;
pub(super) const BITPIX: usize = 72;
pub(super) const PIXDIM: usize = 76;
pub(super) const VOX_OFFSET: usize = 108;
pub(super) const SCL_SLOPE: usize = 112;
pub(super) const SCL_INTER: usize = 116;
pub(super) const UNITS: usize = 123;
pub(super) const DESCRIP: usize = 148;
pub(super) const QFORM_CODE: usize = 252;
pub(super) const SFORM_CODE: usize = 254;
pub(super) const QUATERN: usize = 256;
pub(super) const QOFFSET: usize = 268;
pub(super) const SROW: usize = 280;
pub(super) const MAGIC: usize = 344;
/// Magic of a file that holds both header and data.
pub(super) const ONE_FILE: &[u8; 4] = b"n+1\0";
/// Code of an extension that holds text for people.
pub(super) const COMMENT: i32 = 6;

/// Codes of voxel types, with scalar type and channels.
pub(super) const TYPES: [(i16, PixelType, u32); 12] = [
    (2, PixelType::U8, 1),
    (4, PixelType::I16, 1),
    (8, PixelType::I32, 1),
    (16, PixelType::F32, 1),
    (64, PixelType::F64, 1),
    (128, PixelType::U8, 3),
    (256, PixelType::I8, 1),
    (512, PixelType::U16, 1),
    (768, PixelType::U32, 1),
    (1024, PixelType::I64, 1),
    (1280, PixelType::U64, 1),
    (2304, PixelType::U8, 4),
];

/// Header bytes, read in the file's byte order.
pub(super) struct Bytes<'a> {
    pub(super) bytes: &'a [u8],
    /// Whether the file's byte order is the machine's own.
    pub(super) native: bool,
}

impl Bytes<'_> {
    fn at<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut word = [0; N];
        if let Some(bytes) = self.bytes.get(at..at + N) {
            word.copy_from_slice(bytes);
        }
        if !self.native {
            word.reverse();
        }
        word
    }

    pub(super) fn i16(&self, at: usize) -> i16 {
        i16::from_ne_bytes(self.at(at))
    }

    pub(super) fn i32(&self, at: usize) -> i32 {
        i32::from_ne_bytes(self.at(at))
    }

    pub(super) fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_ne_bytes(self.at(at)))
    }

    pub(super) fn f32s<const N: usize>(&self, at: usize) -> [f64; N] {
        std::array::from_fn(|n| self.f32(at + 4 * n))
    }
}

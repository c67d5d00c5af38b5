//! Writes the bytes before the voxels of a NIfTI-1 file.

use crate::Unwritable;
use crate::image::nifti::affine;
use crate::image::nifti::field::{
    BITPIX, COMMENT, DATATYPE, DESCRIP, DIM, EXTENSIONS, HEADER, MAGIC, ONE_FILE, PIXDIM, QFORM_CODE, QOFFSET, QUATERN,
    SCL_SLOPE, SFORM_CODE, SROW, TYPES, UNITS, VOX_OFFSET,
};
use crate::image::place::Place;
use crate::image::volume_header::VolumeHeader;

/// Code of scanner coordinates: the position is in the coordinates of the measuring device. It
/// is the only code that names neither another image nor an atlas.
const BY_THE_SCANNER: i16 = 1;
/// Unit code: lengths are in mm.
const MM: u8 = 2;
/// Largest offset in bytes; single precision represents it exactly.
const FARTHEST: usize = 1 << 24;
/// Description of a world without anatomical orientation.
const NOT_ANATOMICAL: &[u8] = b"mm, not anatomical";

/// Returns the header, with `fields` (lines) in an extension.
pub(crate) fn header(volume: &VolumeHeader, fields: &str) -> Result<Vec<u8>, Unwritable> {
    let mut bytes = vec![0; EXTENSIONS];
    let mut put = |at: usize, word: &[u8]| bytes[at..at + word.len()].copy_from_slice(word);
    put(0, &(HEADER as i32).to_ne_bytes());
    let mut dims = [1_i16; 8];
    dims[0] = 3;
    for (to, from) in dims[1..4].iter_mut().zip(volume.size) {
        *to = i16::try_from(from).map_err(|_| Unwritable::NiftiSize(from))?;
    }
    for (n, dim) in dims.iter().enumerate() {
        put(DIM + 2 * n, &dim.to_ne_bytes());
    }
    let known = TYPES.into_iter().find(|(_, pixel, channels)| (*pixel, *channels) == (volume.pixel, volume.channels));
    let unknown = Unwritable::NiftiType { channels: volume.channels, pixel: volume.pixel };
    let (code, ..) = known.ok_or(unknown)?;
    put(DATATYPE, &code.to_ne_bytes());
    put(BITPIX, &((8 * volume.pixel.bytes()) as i16 * volume.channels as i16).to_ne_bytes());
    let place = affine::write(&Place { spacing: volume.spacing, origin: volume.origin, axes: volume.axes });
    let single = |v: f64| (v as f32).to_ne_bytes();
    let sign = place.quaternion.map_or(1.0, |(_, sign)| sign);
    for (n, v) in [sign].into_iter().chain(volume.spacing).enumerate() {
        put(PIXDIM + 4 * n, &single(v));
    }
    put(SCL_SLOPE, &single(1.0));
    put(UNITS, &[MM]);
    if !volume.fields.iter().any(|(name, value)| name == "AnatomicalOrientation" && !value.contains('?')) {
        put(DESCRIP, NOT_ANATOMICAL);
    }
    if volume.placed {
        put(SFORM_CODE, &BY_THE_SCANNER.to_ne_bytes());
        for (n, v) in place.rows.as_flattened().iter().enumerate() {
            put(SROW + 4 * n, &single(*v));
        }
        if let Some((quaternion, _)) = place.quaternion {
            put(QFORM_CODE, &BY_THE_SCANNER.to_ne_bytes());
            for (n, v) in quaternion.into_iter().enumerate() {
                put(QUATERN + 4 * n, &single(v));
            }
            for (n, v) in place.origin.into_iter().enumerate() {
                put(QOFFSET + 4 * n, &single(v));
            }
        }
    }
    put(MAGIC, ONE_FILE);
    if !fields.is_empty() {
        put(HEADER, &[1]);
        // Extensions have a length that is a multiple of 16 bytes.
        let size = (8 + fields.len()).next_multiple_of(16);
        bytes.extend((size as i32).to_ne_bytes());
        bytes.extend(COMMENT.to_ne_bytes());
        bytes.extend(fields.as_bytes());
        bytes.resize(EXTENSIONS + size, 0);
    }
    if bytes.len() > FARTHEST {
        return Err(Unwritable::NiftiFields(fields.len()));
    }
    let begins = (bytes.len() as f32).to_ne_bytes();
    bytes[VOX_OFFSET..VOX_OFFSET + 4].copy_from_slice(&begins);
    Ok(bytes)
}

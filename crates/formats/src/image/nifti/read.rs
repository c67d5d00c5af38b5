//! Reads a NIfTI-1 file's header, and finds the beginning of its voxels.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::image::fault::{Fault, Field};
use crate::image::layout::{Claims, Content, DataPlace, Encoding, Layout, ListAxis, Skip};
use crate::image::nifti::affine;
use crate::image::nifti::field::{
    Bytes, COMMENT, DATATYPE, DIM, EXTENSIONS, HEADER, MAGIC, ONE_FILE, SCL_INTER, SCL_SLOPE, TYPES, VOX_OFFSET,
};
use crate::image::place::Place;
use crate::image::scaling::Scaling;
use crate::image::volume_header::VolumeHeader;
use crate::{Error, Limits};

/// A volume with its header; the reader is at the beginning of the data, compressed or not.
pub(crate) struct Opened {
    pub(crate) reader: BufReader<File>,
    pub(crate) header: VolumeHeader,
    pub(crate) layout: Layout,
    pub(crate) scaling: Option<Scaling>,
}

/// Returns whether a file begins like a NIfTI file or a gzip file.
pub(crate) fn is_nifti(begins: &[u8]) -> bool {
    let size = (HEADER as i32).to_le_bytes();
    begins.starts_with(b"\x1f\x8b") || begins.starts_with(&size) || begins.starts_with(&(HEADER as i32).to_be_bytes())
}

/// Reads the header of a file of `file_bytes`, for which [`is_nifti`] is true.
pub(crate) fn open(
    mut reader: BufReader<File>,
    file_bytes: u64,
    path: &Path,
    compressed: bool,
    limits: &Limits,
) -> Result<Opened, Error> {
    let failed = |source| Error::Io { path: path.to_owned(), doing: "reading the header", source };
    let mut before = Vec::new();
    let mut take = |before: &mut Vec<u8>, until: u64| {
        let missing = until - before.len() as u64;
        before.try_reserve(missing as usize).map_err(std::io::Error::other)?;
        if compressed {
            // Restarts at the beginning: the header is small, and decoders read ahead.
            reader.rewind()?;
            before.clear();
            MultiGzDecoder::new(&mut reader).take(until).read_to_end(before)
        } else {
            (&mut reader).take(missing).read_to_end(before)
        }
    };
    take(&mut before, EXTENSIONS as u64).map_err(failed)?;
    let begin = begin(&before).map_err(|fault| fault.at(path))?;
    if begin.vox_offset > limits.header_bytes {
        let limit = u128::from(limits.header_bytes);
        let what = "the header's size in bytes".into();
        let advice = "raise the header limit if the file is trusted, or remove its extensions";
        return Err(Fault::Limit { what, value: u128::from(begin.vox_offset), limit, advice }.at(path));
    }
    take(&mut before, begin.vox_offset).map_err(failed)?;
    let read = || -> Result<(VolumeHeader, Layout, Option<Scaling>), Fault> {
        let header = Bytes { bytes: &before, native: begin.native };
        if (before.len() as u64) < begin.vox_offset {
            return Err(field("vox_offset", VOX_OFFSET).fault(format!(
                "is {}, but the file ends after {} bytes; copy it again",
                begin.vox_offset,
                before.len()
            )));
        }
        let (mut volume, layout) = describe(&header, &begin, compressed, file_bytes, limits)?;
        let place = affine::read(&header)?;
        volume.placed = place.is_some();
        let Place { spacing, origin, axes } = place.unwrap_or(Place::PLAIN);
        (volume.spacing, volume.origin, volume.axes) = (spacing, origin, axes);
        volume.fields = fields(&header);
        let scaling = scaling(&header)?;
        if scaling.is_some() {
            volume.pixel = Scaling::PIXEL;
        }
        Ok((volume, layout, scaling))
    };
    let (header, layout, scaling) = read().map_err(|fault| fault.at(path))?;
    reader.seek(SeekFrom::Start(layout.data_at)).map_err(failed)?;
    Ok(Opened { reader, header, layout, scaling })
}

/// Values needed to read further.
struct Begin {
    native: bool,
    vox_offset: u64,
}

fn field(name: &str, at: usize) -> Field {
    Field { name: name.into(), value: "".into(), offset: at as u64 }
}

fn begin(bytes: &[u8]) -> Result<Begin, Fault> {
    let native = bytes.starts_with(&(HEADER as i32).to_ne_bytes());
    let header = Bytes { bytes, native };
    if bytes.len() < EXTENSIONS || header.i32(0) != HEADER as i32 {
        return Err(field("sizeof_hdr", 0).fault(format!(
            "is not {HEADER}, or the file ends in its header; this is not a NIfTI-1 volume, or a damaged one"
        )));
    }
    if bytes[MAGIC..MAGIC + 4] != *ONE_FILE {
        return Err(field("magic", MAGIC)
            .fault("is not n+1; only NIfTI-1 volumes of one file (.nii, .nii.gz) are supported: write one"));
    }
    let vox_offset = header.f32(VOX_OFFSET);
    if !(vox_offset >= EXTENSIONS as f64 && vox_offset.fract() == 0.0 && vox_offset < 1e18) {
        return Err(field("vox_offset", VOX_OFFSET)
            .fault(format!("is {vox_offset}; voxels begin at a whole number of bytes from {EXTENSIONS} on")));
    }
    Ok(Begin { native, vox_offset: vox_offset as u64 })
}

fn describe(
    header: &Bytes<'_>,
    begin: &Begin,
    compressed: bool,
    file_bytes: u64,
    limits: &Limits,
) -> Result<(VolumeHeader, Layout), Fault> {
    let dims: [i16; 8] = std::array::from_fn(|n| header.i16(DIM + 2 * n));
    let shown = dims.map(|n| n.to_string()).join(" ");
    let shape = Field { value: shown.as_str().into(), ..field("dim", DIM) };
    let count = match dims[0] {
        count @ 3..=7 => count as usize,
        _ => return Err(shape.fault(format!("is {shown:?}: a volume has 3 axes"))),
    };
    if let Some(bad) = dims[1..=count].iter().find(|n| **n < 1) {
        return Err(shape.fault(format!("is {shown:?}: an axis cannot have {bad} voxels; the header is damaged")));
    }
    if dims[4..=count].iter().any(|n| *n != 1) {
        return Err(shape.fault(format!(
            "is {shown:?}: several volumes, or several values a voxel, are not supported; extract one"
        )));
    }
    let code = header.i16(DATATYPE);
    let Some((_, pixel, channels)) = TYPES.into_iter().find(|(known, ..)| *known == code) else {
        return Err(field("datatype", DATATYPE).fault(format!(
            "is {code}, which is not a supported type; use 2 (uint8) to 1280 (uint64), 128 (RGB) or 2304 (RGBA)"
        )));
    };
    let [nx, ny, nz] = [1, 2, 3].map(|n| dims[n] as u64);
    let offset = Field { value: begin.vox_offset.to_string().into(), ..field("vox_offset", VOX_OFFSET) };
    let claims = Claims {
        content: Content::Volume,
        shape: &shape,
        size: [nx, ny],
        layers: nz,
        channels,
        pixel,
        big_endian: begin.native == cfg!(target_endian = "big"),
        encoding: if compressed { Encoding::Gzip } else { Encoding::Raw },
        list: ListAxis::Last,
        data: DataPlace { file: None, skip_lines: 0, skip: Skip::Bytes(&offset, begin.vox_offset) },
        stated: None,
    };
    let layout = Layout::new(&claims, 0, file_bytes, limits)?;
    let size = [nx, ny, nz].map(|n| n as u32);
    Ok((VolumeHeader { channels, compressed, ..VolumeHeader::new(size, pixel) }, layout))
}

/// Reads the scaling of stored values.
fn scaling(header: &Bytes<'_>) -> Result<Option<Scaling>, Fault> {
    let (slope, offset) = (header.f32(SCL_SLOPE), header.f32(SCL_INTER));
    // A slope of 0 means no scaling.
    if slope == 0.0 || (slope, offset) == (1.0, 0.0) {
        return Ok(None);
    }
    if slope.is_nan() && offset.is_nan() {
        return Ok(None);
    }
    if !(slope.is_finite() && offset.is_finite()) {
        return Err(
            field("scl_slope", SCL_SLOPE).fault(format!("scales values by {slope} and {offset}, which are not finite"))
        );
    }
    Ok(Some(Scaling { slope, offset }))
}

/// Reads the fields from text extensions, one per line; other extensions are ignored.
fn fields(header: &Bytes<'_>) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let bytes = header.bytes;
    let mut at = if bytes[HEADER] == 0 { bytes.len() } else { EXTENSIONS };
    while at + 8 <= bytes.len() {
        let (size, code) = (header.i32(at), header.i32(at + 4));
        let Some(end) = usize::try_from(size).ok().filter(|size| *size >= 8).and_then(|size| at.checked_add(size))
        else {
            break;
        };
        if let (COMMENT, Some(text)) = (code, bytes.get(at + 8..end)) {
            let text = String::from_utf8_lossy(text);
            let lines = text.trim_end_matches('\0').lines().filter_map(|line| line.split_once(" = "));
            found.extend(lines.map(|(name, value)| (name.to_owned(), value.to_owned())));
        }
        at = end;
    }
    found
}

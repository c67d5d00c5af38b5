//! Opens a DICOM file, and checks everything before its pixels.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use dicom_object::{FileMetaTable, InMemDicomObject};
use dicom_transfer_syntax_registry::entries::{EXPLICIT_VR_LITTLE_ENDIAN, IMPLICIT_VR_LITTLE_ENDIAN};
use dicom_transfer_syntax_registry::{TransferSyntax, TransferSyntaxIndex as _, TransferSyntaxRegistry};

use super::attributes::Attributes;
use super::walk::{Extent, PixelElement, name, walk};
use super::{frames, pixels, planes};
use crate::image::data::open_file;
use crate::image::fault::Fault;
use crate::image::layout::{Content, Layout};
use crate::image::sequence::Sequence;
use crate::image::volume_header::VolumeHeader;
use crate::{Error, Limits};

/// Position of the four letters that begin a file.
const MAGIC: usize = 128;
/// Position of the first attribute after them.
const META: u64 = 132;
/// Bytes of the first attribute, the length of the others of its group.
const LENGTH: u64 = 12;
/// Largest length of the file's meta information, bytes.
const LONGEST_META: u64 = 1 << 16;

/// Header of an image, by its class.
pub(crate) enum Header {
    Sequence(Sequence),
    Volume(VolumeHeader),
}

/// An opened image; the reader is at the first pixel.
pub(crate) struct Opened {
    pub(crate) reader: BufReader<File>,
    pub(crate) header: Header,
    pub(crate) layout: Layout,
}

/// Returns whether a file begins like a DICOM file.
pub(crate) fn is_dicom(begins: &[u8]) -> bool {
    begins.get(MAGIC..MAGIC + 4) == Some(b"DICM")
}

/// Opens an image; `None` if the file is no DICOM file.
///
/// # Errors
/// [`Error`] when it cannot be read, is damaged, exceeds the limits, or is of a kind that is not
/// read.
pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Option<Opened>, Error> {
    let failed = |source| Error::Io { path: path.to_owned(), doing: "reading the header", source };
    let (mut reader, file_bytes) = open_file(path)?;
    if !is_dicom(reader.fill_buf().map_err(failed)?) {
        return Ok(None);
    }
    let (syntax, begins) = match transfer_syntax(&mut reader, file_bytes).map_err(failed)? {
        Ok(found) => found,
        Err(fault) => return Err(fault.at(path)),
    };
    let extent = Extent { from: begins, until: file_bytes, limit: limits.header_bytes };
    reader.seek(SeekFrom::Start(begins)).map_err(failed)?;
    let element = match walk(&mut reader, &syntax, extent) {
        Ok(Some(element)) => element,
        Ok(None) => {
            let problem = "is missing: the file has no pixels, or is cut short; copy it again";
            return Err(Fault::field(name(tags::PIXEL_DATA), file_bytes, problem).at(path));
        }
        Err(fault) => return Err(fault.at(path)),
    };
    let until = element.at - header_bytes(&syntax, &element);
    reader.seek(SeekFrom::Start(begins)).map_err(failed)?;
    let mut bytes = Vec::new();
    reader.by_ref().take(until.saturating_sub(begins)).read_to_end(&mut bytes).map_err(failed)?;
    let (header, layout) =
        describe(&bytes, &syntax, begins, element, file_bytes, limits).map_err(|fault| fault.at(path))?;
    reader.seek(SeekFrom::Start(layout.data_at)).map_err(failed)?;
    Ok(Some(Opened { reader, header, layout }))
}

/// Returns the bytes of an element's tag, type and length.
fn header_bytes(syntax: &TransferSyntax, element: &PixelElement) -> u64 {
    let is_explicit = syntax.uid() == uids::EXPLICIT_VR_LITTLE_ENDIAN;
    if is_explicit && matches!(element.vr, VR::OB | VR::OW | VR::UN) { 12 } else { 8 }
}

/// Returns the transfer syntax, and the position of the data set.
fn transfer_syntax(
    reader: &mut (impl Read + Seek),
    file_bytes: u64,
) -> std::io::Result<Result<(TransferSyntax, u64), Fault>> {
    let mut first = [0; LENGTH as usize];
    reader.seek(SeekFrom::Start(META))?;
    let damaged = |at| Fault::field("FileMetaInformation", at, "is damaged or cut short; copy the file again");
    if file_bytes < META + LENGTH {
        return Ok(Err(damaged(META)));
    }
    reader.read_exact(&mut first)?;
    let [.., a, b, c, d] = first;
    let length = u64::from(u32::from_le_bytes([a, b, c, d]));
    let begins = META + LENGTH + length;
    if first[..8] != *b"\x02\0\0\0UL\x04\0" || length > LONGEST_META || begins > file_bytes {
        return Ok(Err(damaged(META)));
    }
    let mut bytes = b"DICM".to_vec();
    bytes.extend_from_slice(&first);
    reader.by_ref().take(length).read_to_end(&mut bytes)?;
    let explicit = EXPLICIT_VR_LITTLE_ENDIAN.erased();
    let extent = Extent { from: META, until: begins, limit: begins };
    if let Err(fault) = walk(&bytes[4..], &explicit, extent) {
        return Ok(Err(fault));
    }
    let Ok(table) = FileMetaTable::from_reader(&*bytes) else { return Ok(Err(damaged(META))) };
    let uid = table.transfer_syntax();
    Ok(match uid {
        uids::EXPLICIT_VR_LITTLE_ENDIAN => Ok((explicit, begins)),
        uids::IMPLICIT_VR_LITTLE_ENDIAN => Ok((IMPLICIT_VR_LITTLE_ENDIAN.erased(), begins)),
        _ => {
            let known = TransferSyntaxRegistry.get(uid).map_or("unknown", |syntax| syntax.name());
            let problem = format!(
                "is {uid} ({known}), which is not read; store the file uncompressed, as by `gdcmconv --raw IN.dcm OUT.dcm`"
            );
            Err(Fault::field(name(tags::TRANSFER_SYNTAX_UID), META, problem))
        }
    })
}

fn describe(
    bytes: &[u8],
    syntax: &TransferSyntax,
    begins: u64,
    element: PixelElement,
    file_bytes: u64,
    limits: &Limits,
) -> Result<(Header, Layout), Fault> {
    let damaged = |_| Fault::field("data set", begins, "is damaged; copy the file again");
    let object = InMemDicomObject::read_dataset_with_ts(bytes, syntax).map_err(damaged)?;
    let attributes = Attributes::new(&object, begins);
    let content = pixels::content(&attributes)?;
    let layout = pixels::layout(&attributes, content, element, file_bytes, limits)?;
    let header = match content {
        Content::Sequence => Header::Sequence(frames::sequence(&attributes, &layout)?),
        Content::Volume => {
            pixels::check_scale(&attributes)?;
            Header::Volume(planes::header(&attributes, &layout)?)
        }
    };
    Ok((header, layout))
}

//! Reads the description of the pixel data from MetaImage fields: size, type and packing.

use sonoweave_core::reading::PixelType;

use crate::image::fault::{Fault, Field};
use crate::image::header::Header;
use crate::image::layout::{Claims, Content, DataPlace, Encoding, ListAxis, Skip};
use crate::image::numbers::whole;

pub(super) fn claims(header: &Header) -> Result<Claims<'_>, Fault> {
    if let Some(object) = header.get("ObjectType").filter(|field| &*field.value != "Image") {
        return Err(object.fault(format!("is {:?}; only Image is supported", &*object.value)));
    }
    let (shape, axes, size, layers) = dimensions(header)?;
    let zlib = header.get("CompressedData").map_or(Ok(false), truth)?;
    let encoding = encoding(header, zlib)?;
    let stated = match header.get("CompressedDataSize").filter(|_| zlib) {
        Some(field) => Some((field, whole(&field.value).map_err(|problem| field.fault(problem))?)),
        None => None,
    };
    Ok(Claims {
        content: content(header, axes)?,
        shape,
        size,
        layers,
        channels: channels(header)?,
        pixel: pixel_type(header.required("ElementType")?, !size.contains(&0))?,
        big_endian: big_endian(header)?,
        encoding,
        list: ListAxis::Last,
        data: data_place(header, encoding)?,
        stated,
    })
}

/// `BinaryData = False` means numbers as text, which are not compressed.
fn encoding(header: &Header, zlib: bool) -> Result<Encoding, Fault> {
    let Some(field) = header.get("BinaryData") else { return Ok(if zlib { Encoding::Zlib } else { Encoding::Raw }) };
    match (truth(field)?, zlib) {
        (true, true) => Ok(Encoding::Zlib),
        (true, false) => Ok(Encoding::Raw),
        (false, false) => Ok(Encoding::Text),
        (false, true) => {
            Err(field.fault("is False, which means numbers as text, but CompressedData is True; correct the wrong one"))
        }
    }
}

fn data_place(header: &Header, encoding: Encoding) -> Result<DataPlace<'_>, Fault> {
    let field = header.required("ElementDataFile")?;
    let file = (!field.value.eq_ignore_ascii_case("LOCAL")).then_some(field);
    if let Some(field) = file.filter(|field| field.value.starts_with("LIST") || field.value.contains('%')) {
        return Err(field.fault(format!(
            "is {:?}: data in several files are not supported; write one file (ITK does, as .mha)",
            &*field.value
        )));
    }
    let skip = match header.get("HeaderSize") {
        None => Skip::None,
        Some(size) if &*size.value == "0" => Skip::None,
        Some(size) if file.is_none() || encoding == Encoding::Zlib => {
            return Err(size.fault(
                "skips bytes before the data, which is supported only for uncompressed data in a separate file",
            ));
        }
        Some(size) if &*size.value == "-1" && encoding == Encoding::Text => {
            return Err(
                size.fault("is -1 (the data are the file's last bytes), which is not supported for numbers as text")
            );
        }
        Some(size) if &*size.value == "-1" => Skip::ToTheLast,
        Some(size) => Skip::Bytes(size, whole(&size.value).map_err(|problem| size.fault(problem))?),
    };
    Ok(DataPlace { file, skip_lines: 0, skip })
}

/// Returns `DimSize`, the number of axes, the pixels along the first two, and the number of
/// layers (1 if the file has no axis for them).
fn dimensions(header: &Header) -> Result<(&Field, usize, [u64; 2], u64), Fault> {
    let ndims = header.required("NDims")?;
    let axes = match &*ndims.value {
        "2" => 2,
        "3" => 3,
        "4" => {
            return Err(ndims.fault(
                "is 4: sequences of volumes are not supported; only images (2), and lists of images or volumes (3)",
            ));
        }
        other => return Err(ndims.fault(format!("is {other:?}; it must be 2 or 3"))),
    };
    let dims = header.required("DimSize")?;
    let size = dims
        .value
        .split_whitespace()
        .map(whole)
        .take(axes + 1)
        .collect::<Result<Vec<u64>, _>>()
        .map_err(|problem| dims.fault(problem))?;
    match *size {
        [x, y] if axes == 2 => Ok((dims, axes, [x, y], 1)),
        [x, y, layers] if axes == 3 => Ok((dims, axes, [x, y], layers)),
        _ => Err(dims.fault(format!("is {:?}, but NDims requires exactly {axes} whole numbers", &*dims.value))),
    }
}

/// `Kinds` decides. Older files have none; per-frame fields then mark a sequence.
fn content(header: &Header, axes: usize) -> Result<Content, Fault> {
    let Some(field) = header.get("Kinds") else {
        let sequence = axes == 2 || !header.frames.is_empty();
        return Ok(if sequence { Content::Sequence } else { Content::Volume });
    };
    let kinds: Vec<&str> = field.value.split_whitespace().take(axes + 1).collect();
    if kinds.len() != axes {
        return Err(field.fault(format!("is {:?}, but NDims requires exactly {axes} words", &*field.value)));
    }
    match kinds.iter().position(|kind| kind.eq_ignore_ascii_case("list")) {
        None if axes == 2 => Ok(Content::Sequence),
        None => Ok(Content::Volume),
        Some(2) => Ok(Content::Sequence),
        Some(_) => Err(field.fault(format!("is {:?}: the list must be the last of three axes", &*field.value))),
    }
}

fn channels(header: &Header) -> Result<u32, Fault> {
    let Some(field) = header.get("ElementNumberOfChannels") else { return Ok(1) };
    match whole(&field.value) {
        Ok(channels @ 1..=4) => Ok(channels as u32),
        Ok(_) => Err(field.fault(format!("is {}; images have 1 to 4 channels", &*field.value))),
        Err(problem) => Err(field.fault(problem)),
    }
}

fn big_endian(header: &Header) -> Result<bool, Fault> {
    let binary = header.get("BinaryDataByteOrderMSB").map(truth).transpose()?;
    let Some(field) = header.get("ElementByteOrderMSB") else { return Ok(binary.unwrap_or(false)) };
    let element = truth(field)?;
    if binary.is_some_and(|binary| binary != element) {
        return Err(field.fault("contradicts BinaryDataByteOrderMSB; remove the wrong one"));
    }
    Ok(element)
}

/// MetaIO's `LONG` has 4 bytes on every machine; 8 are `LONG_LONG`.
fn pixel_type(field: &Field, images: bool) -> Result<PixelType, Fault> {
    let name = field.value.strip_prefix("MET_").unwrap_or("");
    Ok(match name.strip_suffix("_ARRAY").unwrap_or(name) {
        "UCHAR" => PixelType::U8,
        "CHAR" => PixelType::I8,
        "USHORT" => PixelType::U16,
        "SHORT" => PixelType::I16,
        "UINT" | "ULONG" => PixelType::U32,
        "INT" | "LONG" => PixelType::I32,
        "ULONG_LONG" => PixelType::U64,
        "LONG_LONG" => PixelType::I64,
        "FLOAT" => PixelType::F32,
        "DOUBLE" => PixelType::F64,
        _ if !images => PixelType::U8,
        _ => {
            return Err(field.fault(format!(
                "is {:?}, which is not a supported pixel type; use MET_UCHAR to MET_DOUBLE",
                &*field.value
            )));
        }
    })
}

/// Parses a truth value: MetaImage writes `True` and `False`; other writers use `1`, `0` and
/// other cases.
fn truth(field: &Field) -> Result<bool, Fault> {
    match field.value.as_bytes() {
        [b'T' | b't' | b'1', ..] => Ok(true),
        [b'F' | b'f' | b'0', ..] => Ok(false),
        _ => Err(field.fault(format!("is {:?}; write True or False", &*field.value))),
    }
}

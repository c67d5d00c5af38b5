//! Reads the description of the pixel data from NRRD fields: axes, size, type and packing.

use sonoweave_core::reading::PixelType;

use crate::image::fault::{Fault, Field};
use crate::image::header::Header;
use crate::image::layout::{Claims, Content, DataPlace, Encoding, ListAxis, Skip};
use crate::image::numbers::whole;

/// Limit on the number of axes. Files of this project and of Slicer have five at most:
/// channels, three of space, a list.
const MOST_AXES: u64 = 16;

/// Field with the name of the data file.
pub(super) const DATA_FILE: &str = "data file";

pub(super) fn claims(header: &Header) -> Result<Claims<'_>, Fault> {
    let shape = header.required("sizes")?;
    let axes = axes(header, shape)?;
    let images = !axes.size.contains(&0);
    let pixel = pixel_type(header.required("type")?, images)?;
    let encoding = match header.get("encoding") {
        Some(field) => encoding(field)?,
        None if images => {
            return Err(header.required("encoding").err().unwrap_or_else(|| shape.fault("needs an encoding")));
        }
        None => Encoding::Raw,
    };
    Ok(Claims {
        content: axes.content,
        shape,
        size: axes.size,
        layers: axes.layers,
        channels: axes.channels,
        pixel,
        big_endian: big_endian(header, images && pixel.bytes() > 1 && encoding != Encoding::Text)?,
        encoding,
        list: axes.list,
        stated: None,
        data: DataPlace {
            file: header.get(DATA_FILE),
            skip_lines: skip(header, "line skip")?.map_or(0, |(_, lines)| lines),
            skip: skip_bytes(header, encoding)?,
        },
    })
}

/// Meaning of the axes.
struct Axes {
    content: Content,
    size: [u64; 2],
    layers: u64,
    channels: u32,
    list: ListAxis,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Domain,
    List,
    Channel,
}

fn axes(header: &Header, shape: &Field) -> Result<Axes, Fault> {
    let dimension = header.required("dimension")?;
    let count = match whole(&dimension.value) {
        Ok(count @ 1..=MOST_AXES) => count as usize,
        Ok(_) => return Err(dimension.fault(format!("is {}; it must be from 1 to {MOST_AXES}", &*dimension.value))),
        Err(problem) => return Err(dimension.fault(problem)),
    };
    let sizes = shape.value.split_whitespace().map(whole).take(count + 1);
    let mut sizes = sizes.collect::<Result<Vec<u64>, _>>().map_err(|problem| shape.fault(problem))?;
    if sizes.len() != count {
        return Err(
            shape.fault(format!("is {:?}, but dimension requires exactly {count} whole numbers", &*shape.value))
        );
    }
    let kinds_field = header.kinds();
    let mut kinds = match kinds_field {
        Some(field) => kinds(field, count)?,
        // Without kinds, per-frame fields mark a sequence; the frames lie along the last axis.
        None if count == 3 && !header.frames.is_empty() => vec![Kind::Domain, Kind::Domain, Kind::List],
        None => vec![Kind::Domain; count],
    };
    let of_kinds = kinds_field.unwrap_or(shape);
    let channels = if kinds[0] == Kind::Channel {
        kinds.remove(0);
        match sizes.remove(0) {
            channels @ 1..=4 => channels as u32,
            other => return Err(shape.fault(format!("promises {other} channels; images have 1 to 4"))),
        }
    } else {
        1
    };
    if kinds.contains(&Kind::Channel) {
        return Err(of_kinds.fault(format!("is {:?}: channels must be the first axis", &*of_kinds.value)));
    }
    let lists = kinds.iter().filter(|kind| **kind == Kind::List).count();
    let (list, layers, domains) = match kinds.iter().position(|kind| *kind == Kind::List) {
        Some(_) if lists > 1 => {
            return Err(of_kinds.fault(format!("is {:?}: only one axis can be the list of frames", &*of_kinds.value)));
        }
        Some(at) if at + 1 == kinds.len() => (ListAxis::Last, sizes.pop(), sizes),
        Some(0) => (ListAxis::First, Some(sizes.remove(0)), sizes),
        Some(_) => {
            return Err(of_kinds.fault(format!(
                "is {:?}: the list of frames lies between the axes of the image; it must be the last axis, or the first",
                &*of_kinds.value
            )));
        }
        None => (ListAxis::Last, None, sizes),
    };
    let (content, size, layers) = match (&domains[..], layers) {
        ([x, y], layers) | ([x, y, 1], layers @ Some(_)) => (Content::Sequence, [*x, *y], layers.unwrap_or(1)),
        ([x, y, z], None) => (Content::Volume, [*x, *y], *z),
        ([_, _, _], Some(_)) => {
            return Err(shape.fault(
                "is that of a sequence of volumes, which is not supported; only images, and lists of images or volumes",
            ));
        }
        (domains, _) => {
            return Err(shape.fault(format!("has {} axes in space; an image has 2 and a volume 3", domains.len())));
        }
    };
    Ok(Axes { content, size, layers, channels, list })
}

fn kinds(field: &Field, count: usize) -> Result<Vec<Kind>, Fault> {
    let words: Vec<&str> = field.value.split_whitespace().take(count + 1).collect();
    if words.len() != count {
        return Err(field.fault(format!("is {:?}, but dimension requires exactly {count} words", &*field.value)));
    }
    let kind = |word: &&str| match word.to_ascii_lowercase().as_str() {
        "domain" | "space" | "???" | "none" => Ok(Kind::Domain),
        "list" | "time" => Ok(Kind::List),
        "vector" | "point" | "covariant-vector" | "normal" | "scalar" | "stub" | "complex" | "2-vector" | "3-color"
        | "rgb-color" | "hsv-color" | "xyz-color" | "4-color" | "rgba-color" | "3-vector" | "3-gradient"
        | "3-normal" | "4-vector" => Ok(Kind::Channel),
        _ => Err(field.fault(format!(
            "names an axis {word:?}, which images do not have; use domain, space, list, time, vector or a colour"
        ))),
    };
    words.iter().map(kind).collect()
}

/// Accepts all of NRRD's type names.
fn pixel_type(field: &Field, images: bool) -> Result<PixelType, Fault> {
    Ok(match field.value.to_ascii_lowercase().as_str() {
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => PixelType::U8,
        "signed char" | "int8" | "int8_t" => PixelType::I8,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => PixelType::U16,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => PixelType::I16,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => PixelType::U32,
        "int" | "signed int" | "int32" | "int32_t" => PixelType::I32,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => PixelType::U64,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => PixelType::I64,
        "float" => PixelType::F32,
        "double" => PixelType::F64,
        _ if !images => PixelType::U8,
        other => {
            return Err(field.fault(format!("is {other:?}, which is not a supported pixel type; use uint8 to double")));
        }
    })
}

fn encoding(field: &Field) -> Result<Encoding, Fault> {
    match field.value.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gzip" | "gz" => Ok(Encoding::Gzip),
        "ascii" | "text" | "txt" => Ok(Encoding::Text),
        "bzip2" | "bz2" => Err(field.fault("is bzip2, which is not supported; write the file with gzip or raw")),
        "hex" => Err(field.fault("is hex, which is not supported; write the file with gzip, raw or ascii")),
        other => Err(field.fault(format!("is {other:?}, which is not an encoding; use raw, gzip or ascii"))),
    }
}

fn big_endian(header: &Header, matters: bool) -> Result<bool, Fault> {
    let Some(field) = header.get("endian") else {
        return if matters { header.required("endian").map(|_| false) } else { Ok(false) };
    };
    match field.value.to_ascii_lowercase().as_str() {
        "little" => Ok(false),
        "big" => Ok(true),
        other => Err(field.fault(format!("is {other:?}; write little or big"))),
    }
}

fn skip<'a>(header: &'a Header, name: &str) -> Result<Option<(&'a Field, u64)>, Fault> {
    let Some(field) = header.get(name) else { return Ok(None) };
    whole(&field.value).map(|n| Some((field, n))).map_err(|problem| field.fault(problem))
}

fn skip_bytes<'a>(header: &'a Header, encoding: Encoding) -> Result<Skip<'a>, Fault> {
    match header.get("byte skip") {
        Some(field) if &*field.value == "-1" => {
            if encoding == Encoding::Raw {
                return Ok(Skip::ToTheLast);
            }
            Err(field.fault("is -1 (the data are the file's last bytes), which is supported for raw data only"))
        }
        _ => Ok(match skip(header, "byte skip")? {
            None | Some((_, 0)) => Skip::None,
            Some((field, bytes)) => Skip::Bytes(field, bytes),
        }),
    }
}

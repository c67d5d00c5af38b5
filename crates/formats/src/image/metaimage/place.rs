//! Reads the position of a MetaImage volume in space.

use crate::image::fault::Fault;
use crate::image::header::Header;
use crate::image::numbers::{finite, number};
use crate::image::place::Place;

/// Fields that describe storage and position of the pixels.
pub(super) const STRUCTURE: [&str; 23] = [
    "ObjectType",
    "NDims",
    "BinaryData",
    "BinaryDataByteOrderMSB",
    "ElementByteOrderMSB",
    "CompressedData",
    "CompressedDataSize",
    "CompressionLevel",
    "HeaderSize",
    "TransformMatrix",
    "Rotation",
    "Orientation",
    "Offset",
    "Position",
    "Origin",
    "CenterOfRotation",
    "ElementSpacing",
    "ElementSize",
    "DimSize",
    "Kinds",
    "ElementNumberOfChannels",
    "ElementType",
    "ElementDataFile",
];

pub(super) fn place(header: &Header) -> Result<Place, Fault> {
    let spacing = of(header, &["ElementSpacing", "ElementSize"])?.unwrap_or([1.0; 3]);
    if let Some(field) = header.get("ElementSpacing").or_else(|| header.get("ElementSize"))
        && spacing.iter().any(|&mm| mm <= 0.0)
    {
        return Err(field.fault(format!("is {:?}; a spacing must be positive", &*field.value)));
    }
    let matrix = of(header, &["TransformMatrix", "Rotation", "Orientation"])?;
    let axes = matrix.map(|m: [f64; 9]| [[m[0], m[1], m[2]], [m[3], m[4], m[5]], [m[6], m[7], m[8]]]);
    let origin = of(header, &["Offset", "Position", "Origin"])?.unwrap_or([0.0; 3]);
    Ok(Place { spacing, origin, axes: axes.unwrap_or(Place::PLAIN.axes) })
}

/// Reads the spacing of a sequence's pixels, mm, and the value for its frame axis.
pub(super) fn spacing(header: &Header) -> Option<[f64; 3]> {
    let field = header.get("ElementSpacing").or_else(|| header.get("ElementSize"))?;
    let mut numbers = field.value.split_whitespace().map(number);
    let [x, y] = [numbers.next()??, numbers.next()??];
    Some([x, y, numbers.next().unwrap_or(Some(1.0))?])
}

/// Reads the first present of several synonymous fields, as finite numbers.
fn of<const N: usize>(header: &Header, names: &[&str]) -> Result<Option<[f64; N]>, Fault> {
    let Some(field) = names.iter().find_map(|name| header.get(name)) else { return Ok(None) };
    finite(&field.value).map(Some).map_err(|problem| field.fault(problem))
}

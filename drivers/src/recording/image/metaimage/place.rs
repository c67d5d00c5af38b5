//! Where a MetaImage volume lies in space.

use crate::recording::image::header::{Fault, Header};
use crate::recording::image::numbers::{finite, number};
use crate::recording::image::volume::Place;

/// Fields that say how the pixels are stored and where they lie.
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

/// How far a sequence's pixels are apart, and its frames.
pub(super) fn spacing(header: &Header) -> Option<[f64; 3]> {
    let field = header.get("ElementSpacing").or_else(|| header.get("ElementSize"))?;
    let mut numbers = field.value.split_whitespace().map(number);
    let [x, y] = [numbers.next()??, numbers.next()??];
    Some([x, y, numbers.next().unwrap_or(Some(1.0))?])
}

/// The first of the fields that mean the same, as finite numbers.
fn of<const N: usize>(header: &Header, names: &[&str]) -> Result<Option<[f64; N]>, Fault> {
    let Some(field) = names.iter().find_map(|name| header.get(name)) else { return Ok(None) };
    finite(&field.value).map(Some).map_err(|problem| field.fault(problem))
}

//! Writes MetaImage headers.

use sonoweave_core::reading::PixelType;

use crate::Unwritable;
use crate::image::metaimage::grammar::GRAMMAR;
use crate::image::numbers::list;
use crate::image::sequence::{IMAGE_TYPE, ORIENTATION};
use crate::image::sequence_header::SequenceHeader;
use crate::image::spacing;
use crate::image::volume_header::VolumeHeader;
use crate::image::write::header::{SIZE_DIGITS, Style, Text, taken};

static STYLE: Style =
    Style { grammar: &GRAMMAR, separator: " = ", reserved: '=', image_status: "ImageStatus", escape: str::to_owned };

/// Returns the header of a sequence; `data_file` names the file of its pixels, if they do not
/// follow the header.
pub(crate) fn sequence(header: &SequenceHeader, compressed: bool, data_file: Option<&str>) -> Result<Text, Unwritable> {
    let (spacing, fields) = spacing::split(&header.fields)?;
    let mut text = begin(compressed);
    text.line("TransformMatrix", "1 0 0 0 1 0 0 0 1");
    text.line("Offset", "0 0 0");
    text.line("ElementSpacing", &list(&spacing));
    text.line("DimSize", &format!("{} {} {}", header.size[0], header.size[1], header.items.len()));
    text.line("Kinds", "domain domain list");
    let SequenceHeader { orientation, image_type, .. } = header;
    text.pictures([(ORIENTATION, orientation), (IMAGE_TYPE, image_type)])?;
    text.extra(&fields, &taken(orientation, image_type))?;
    for (frame, item) in (0..).zip(&header.items) {
        text.item(frame, item)?;
    }
    end(&mut text, header.channels, header.pixel, data_file);
    Ok(text)
}

/// Returns the header of a volume.
pub(crate) fn volume(header: &VolumeHeader, data_file: Option<&str>) -> Result<Text, Unwritable> {
    let mut text = begin(header.compressed);
    // MetaIO's matrix is the transpose of ITK's direction: each triple is the direction of an
    // index axis.
    text.line("TransformMatrix", &list(header.axes.as_flattened()));
    text.line("Offset", &list(&header.origin));
    text.line("CenterOfRotation", "0 0 0");
    if !header.fields.iter().any(|(name, _)| name == "AnatomicalOrientation") {
        text.line("AnatomicalOrientation", "???");
    }
    text.line("ElementSpacing", &list(&header.spacing));
    text.line("DimSize", &format!("{} {} {}", header.size[0], header.size[1], header.size[2]));
    text.line("Kinds", "domain domain domain");
    text.extra(&header.fields, &[])?;
    end(&mut text, header.channels, header.pixel, data_file);
    Ok(text)
}

/// Returns only the further fields, one line each.
pub(crate) fn fields(fields: &[(String, String)]) -> Result<String, Unwritable> {
    let mut text = Text::new(&STYLE);
    text.extra(fields, &[])?;
    Ok(text.text)
}

fn begin(compressed: bool) -> Text {
    let mut text = Text::new(&STYLE);
    let truth = |yes| if yes { "True" } else { "False" };
    text.line("ObjectType", "Image");
    text.line("NDims", "3");
    text.line("BinaryData", "True");
    text.line("BinaryDataByteOrderMSB", truth(cfg!(target_endian = "big")));
    text.line("CompressedData", truth(compressed));
    if compressed {
        text.line("CompressedDataSize", &" ".repeat(SIZE_DIGITS));
        text.size_at = Some((text.text.len() - SIZE_DIGITS - 1) as u64);
    }
    text
}

fn end(text: &mut Text, channels: u32, pixel: PixelType, data_file: Option<&str>) {
    text.line("ElementNumberOfChannels", &channels.to_string());
    text.line("ElementType", element_type(pixel));
    text.line("ElementDataFile", data_file.unwrap_or("LOCAL"));
}

/// Returns the type name that [`claims`](crate::image::metaimage::claims) reads back.
pub(crate) const fn element_type(pixel: PixelType) -> &'static str {
    match pixel {
        PixelType::U8 => "MET_UCHAR",
        PixelType::I8 => "MET_CHAR",
        PixelType::U16 => "MET_USHORT",
        PixelType::I16 => "MET_SHORT",
        PixelType::U32 => "MET_UINT",
        PixelType::I32 => "MET_INT",
        PixelType::U64 => "MET_ULONG_LONG",
        PixelType::I64 => "MET_LONG_LONG",
        PixelType::F32 => "MET_FLOAT",
        PixelType::F64 => "MET_DOUBLE",
    }
}

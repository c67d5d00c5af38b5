//! Classes of images, and the shape and type of their pixels.

use dicom_core::{Tag, VR};
use dicom_dictionary_std::{tags, uids};

use sonoweave_core::reading::PixelType;

use super::attributes::Attributes;
use super::walk::PixelElement;
use crate::Limits;
use crate::image::fault::{Fault, Field};
use crate::image::layout::{Claims, Content, DataPlace, Encoding, Layout, ListAxis, Skip};

/// Classes that are read, with their content.
const CLASSES: [(&str, Content); 3] = [
    (uids::ULTRASOUND_MULTI_FRAME_IMAGE_STORAGE, Content::Sequence),
    // The retired class of 1993, which old scanners write.
    ("1.2.840.10008.5.1.4.1.1.3", Content::Sequence),
    (uids::ENHANCED_US_VOLUME_STORAGE, Content::Volume),
];

/// Returns the content of an image by its class.
///
/// # Errors
/// [`Fault`] for other classes.
pub(super) fn content(attributes: &Attributes<'_>) -> Result<Content, Fault> {
    let class = attributes.text(tags::SOP_CLASS_UID).unwrap_or_default();
    if let Some((_, content)) = CLASSES.iter().find(|(uid, _)| *uid == class) {
        return Ok(*content);
    }
    let problem = format!(
        "is {class:?}: only ultrasound multi-frame images and enhanced ultrasound volumes are read; give one of these"
    );
    Err(attributes.fault(tags::SOP_CLASS_UID, problem))
}

/// Returns the layout of the pixels, in a file of `file_bytes`.
///
/// # Errors
/// [`Fault`] for pixels that are not plain grey or RGB values, and for impossible claims.
pub(super) fn layout(
    attributes: &Attributes<'_>,
    content: Content,
    element: PixelElement,
    file_bytes: u64,
    limits: &Limits,
) -> Result<Layout, Fault> {
    let (rows, columns) = (attributes.needed(tags::ROWS)?, attributes.needed(tags::COLUMNS)?);
    let frames = attributes.whole(tags::NUMBER_OF_FRAMES)?.unwrap_or(1);
    let (channels, pixel) = (channels(attributes)?, pixel(attributes)?);
    if !matches!(element.vr, VR::OB | VR::OW) {
        return Err(
            attributes.fault(tags::PIXEL_DATA, "holds no pixels but values; the file is damaged: copy it again")
        );
    }
    let shape =
        Field {
            name: "NumberOfFrames".into(), value: format!("{columns}×{rows}×{frames}").into(), offset: element.at
        };
    if rows == 0 || columns == 0 {
        return Err(shape.fault(format!("of {} pixels: an image has no pixel; export it again", shape.value)));
    }
    let claims = Claims {
        content,
        shape: &shape,
        size: [columns, rows],
        layers: frames,
        channels,
        pixel,
        big_endian: false,
        encoding: Encoding::Raw,
        list: ListAxis::Last,
        data: DataPlace { file: None, skip_lines: 0, skip: Skip::None },
        stated: None,
    };
    let promised = [rows, columns, frames, u64::from(channels), pixel.bytes() as u64]
        .map(u128::from)
        .into_iter()
        .fold(1, u128::saturating_mul);
    let held = element.bytes.min(file_bytes.saturating_sub(element.at));
    // DICOM pads an odd length by a byte.
    let padding = u64::from(u128::from(held) == promised + 1 && promised % 2 == 1);
    Layout::new(&claims, element.at, held - padding, limits)
}

/// Returns the values per pixel: grey or red, green and blue.
fn channels(attributes: &Attributes<'_>) -> Result<u32, Fault> {
    let tag = tags::PHOTOMETRIC_INTERPRETATION;
    let colours = attributes.text(tag).unwrap_or_default();
    let samples = attributes.needed(tags::SAMPLES_PER_PIXEL)?;
    match (&*colours, samples) {
        ("MONOCHROME2", 1) => Ok(1),
        ("RGB", 3) => match attributes.whole(tags::PLANAR_CONFIGURATION)?.unwrap_or(0) {
            0 => Ok(3),
            _ => {
                let problem = "has the colours in separate planes, which are not read; store them by pixel, as by \
                               `gdcmconv --planar-configuration 0`";
                Err(attributes.fault(tags::PLANAR_CONFIGURATION, problem))
            }
        },
        _ => {
            let problem = format!(
                "is {colours:?} with {samples} values a pixel; only MONOCHROME2 and RGB are read: convert it to one of these"
            );
            Err(attributes.fault(tag, problem))
        }
    }
}

/// Returns the type of the values.
fn pixel(attributes: &Attributes<'_>) -> Result<PixelType, Fault> {
    let [allocated, stored, signed] = [tags::BITS_ALLOCATED, tags::BITS_STORED, tags::PIXEL_REPRESENTATION];
    let bits = attributes.needed(allocated)?;
    let is_signed = attributes.whole(signed)?.unwrap_or(0) == 1;
    let used = attributes.whole(stored)?.unwrap_or(bits);
    let high = attributes.whole(tags::HIGH_BIT)?.unwrap_or(used.saturating_sub(1));
    // Signed values of fewer bits than a byte's multiple have no sign in their upper bits.
    if used == 0 || used > bits || high + 1 != used || (is_signed && used != bits) {
        let problem = format!("is {used} of {bits} bits; only whole values in the lowest bits are read: convert it");
        return Err(attributes.fault(stored, problem));
    }
    match (bits, is_signed) {
        (8, false) => Ok(PixelType::U8),
        (8, true) => Ok(PixelType::I8),
        (16, false) => Ok(PixelType::U16),
        (16, true) => Ok(PixelType::I16),
        _ => Err(attributes.fault(allocated, format!("is {bits}; only 8 and 16 bits a value are read: convert it"))),
    }
}

/// Checks that stored values are the values meant.
///
/// # Errors
/// [`Fault`] if they are to be scaled.
pub(super) fn check_scale(attributes: &Attributes<'_>) -> Result<(), Fault> {
    let transformation = attributes.group(0, tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE).unwrap_or(*attributes);
    let plain: [(Tag, f64); 2] = [(tags::RESCALE_INTERCEPT, 0.0), (tags::RESCALE_SLOPE, 1.0)];
    for (tag, value) in plain {
        if let Some([found]) = transformation.array::<1>(tag)?
            && found != value
        {
            return Err(
                attributes.fault(tag, format!("is {found}; only values stored as such are read: export them so"))
            );
        }
    }
    Ok(())
}

//! What the fields of the whole file say of its pixel data: how many, of which type, packed how, and whether that can be true.

use super::header::{Fault, Field, Header, truth, whole};
use crate::reading::PixelType;
use crate::recording::Limits;

/// No deflate stream expands further: its shortest code for the longest copy (258 bytes) takes two bits.
const DEFLATE_RATIO: u128 = 1032;

/// What the third axis is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Frames one after the other in time (or a single frame).
    Sequence,
    /// A volume in space.
    Volume,
}

/// Shape and packing of the pixel data, checked against the limits and the file's length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Layout {
    pub(crate) content: Content,
    /// Pixels along the first and second axis; both 0 in a file without images.
    pub(crate) size: [u32; 2],
    /// Frames or slices.
    pub(crate) layers: u64,
    /// `U8` where the file has no images and names no usable type.
    pub(crate) pixel: PixelType,
    pub(crate) channels: u32,
    /// Bytes of one frame or slice, decompressed; 0 without images.
    pub(crate) layer_bytes: usize,
    pub(crate) big_endian: bool,
    pub(crate) zlib: bool,
    /// Where the data begins in the file, bytes.
    pub(crate) data_at: u64,
    /// How much data the file holds, bytes as stored.
    pub(crate) data_bytes: u64,
}

impl Layout {
    /// Interprets `header` of a file of `file_bytes`. Nothing is allocated for pixels here: what cannot be true is refused first.
    pub(crate) fn new(header: &Header, file_bytes: u64, limits: &Limits) -> Result<Self, Fault> {
        if let Some(object) = header.get("ObjectType").filter(|field| &*field.value != "Image") {
            return Err(object.fault(format!("is {:?}; only Image is read", &*object.value)));
        }
        let data_file = header.required("ElementDataFile")?;
        if !data_file.value.eq_ignore_ascii_case("LOCAL") {
            return Err(data_file.fault(format!(
                "is {:?}: pixel data in a file of its own is not read; write header and data into one file (LOCAL)",
                &*data_file.value
            )));
        }
        let (dims, axes, size, layers) = dimensions(header)?;
        let content = content(header, axes)?;
        let images = size[0] != 0 && size[1] != 0;
        if !images && (size[0] != 0 || size[1] != 0) {
            return Err(
                dims.fault(format!("is {:?}: one axis of the image is empty; either both are or none", &*dims.value))
            );
        }
        if layers == 0 {
            return Err(dims.fault("promises no frames at all; the recording holds nothing to read"));
        }
        if layers > limits.items {
            return Err(Fault::Limit {
                what: format!("field DimSize (byte {}): the number of frames", dims.offset),
                value: u128::from(layers),
                limit: u128::from(limits.items),
                advice: "raise the frame limit if the file is trusted, or split the recording",
            });
        }
        let channels = channels(header)?;
        let pixel = pixel_type(header.required("ElementType")?, images)?;
        let layer =
            (u128::from(size[0]) * u128::from(size[1])).saturating_mul(u128::from(channels) * pixel.bytes() as u128);
        let too_large = || Fault::Limit {
            what: format!("field DimSize (byte {}): the size of one frame in bytes", dims.offset),
            value: layer,
            limit: u128::from(limits.frame_bytes),
            advice: "check that DimSize and ElementType are what they should be, or crop the frames",
        };
        if layer > u128::from(limits.frame_bytes) {
            return Err(too_large());
        }
        let axis = |n: u64| u32::try_from(n).map_err(|_| too_large());
        let layout = Self {
            content,
            size: [axis(size[0])?, axis(size[1])?],
            layers,
            pixel,
            channels,
            layer_bytes: usize::try_from(layer).map_err(|_| too_large())?,
            big_endian: big_endian(header)?,
            zlib: header.get("CompressedData").map_or(Ok(false), truth)?,
            data_at: header.end,
            data_bytes: file_bytes.saturating_sub(header.end),
        };
        layout.check_packing(header)?;
        if images {
            layout.check_length(header, dims)?;
        }
        Ok(layout)
    }

    /// Whether the file holds pixels.
    pub(crate) fn has_images(&self) -> bool {
        self.layer_bytes != 0
    }

    fn check_packing(&self, header: &Header) -> Result<(), Fault> {
        if let Some(field) = header.get("BinaryData")
            && !truth(field)?
        {
            return Err(
                field.fault("is False: pixels written as text are not read; write the file with BinaryData = True")
            );
        }
        if let Some(field) = header.get("HeaderSize").filter(|field| &*field.value != "0") {
            return Err(field.fault("asks to skip bytes before the data; only data right behind the header is read"));
        }
        Ok(())
    }

    /// Files without images may carry a byte or so a sample behind the header (PLUS writes them); there is nothing to misread in it, so it is not
    /// checked.
    fn check_length(&self, header: &Header, dims: &Field) -> Result<(), Fault> {
        let promised = self.layer_bytes as u128 * u128::from(self.layers);
        let held = u128::from(self.data_bytes);
        if !self.zlib {
            return match promised.cmp(&held) {
                std::cmp::Ordering::Equal => Ok(()),
                std::cmp::Ordering::Greater => Err(dims.fault(format!(
                    "promises {promised} bytes of pixels, but the file holds {held} behind its header: it is cut short or the header is wrong; copy or record it again"
                ))),
                std::cmp::Ordering::Less => Err(dims.fault(format!(
                    "promises {promised} bytes of pixels, but the file holds {held} behind its header: data after the last frame; correct DimSize or remove them"
                ))),
            };
        }
        if let Some(field) = header.get("CompressedDataSize") {
            let stated = whole(&field.value).map_err(|problem| field.fault(problem))?;
            if stated != self.data_bytes {
                let how =
                    if stated > self.data_bytes { "it is cut short" } else { "data follow the compressed stream" };
                return Err(field.fault(format!(
                    "promises {stated} bytes of compressed pixels, but the file holds {held} behind its header: {how}; copy or record it again"
                )));
            }
        }
        if promised > held * DEFLATE_RATIO {
            return Err(dims.fault(format!(
                "promises {promised} bytes of pixels, more than the {held} compressed bytes in the file can hold: it is cut short or the header is wrong"
            )));
        }
        Ok(())
    }
}

/// `DimSize`, the number of axes, pixels along the first two, and the number of layers (1 if the file has no axis for them).
fn dimensions(header: &Header) -> Result<(&Field, usize, [u64; 2], u64), Fault> {
    let ndims = header.required("NDims")?;
    let axes = match &*ndims.value {
        "2" => 2,
        "3" => 3,
        "4" => {
            return Err(ndims.fault(
                "is 4: a sequence of volumes is not read; only images (2) and lists of images or volumes (3) are",
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
        .collect::<Result<Vec<u64>, String>>()
        .map_err(|problem| dims.fault(problem))?;
    match *size {
        [x, y] if axes == 2 => Ok((dims, axes, [x, y], 1)),
        [x, y, layers] if axes == 3 => Ok((dims, axes, [x, y], layers)),
        _ => Err(dims.fault(format!("is {:?}, but NDims asks for exactly {axes} whole numbers", &*dims.value))),
    }
}

/// `Kinds` decides; older files have none, and of these a sequence is known by its per-frame fields.
fn content(header: &Header, axes: usize) -> Result<Content, Fault> {
    let Some(field) = header.get("Kinds") else {
        let sequence = axes == 2 || !header.frames.is_empty();
        return Ok(if sequence { Content::Sequence } else { Content::Volume });
    };
    let kinds: Vec<&str> = field.value.split_whitespace().take(axes + 1).collect();
    if kinds.len() != axes {
        return Err(field.fault(format!("is {:?}, but NDims asks for exactly {axes} words", &*field.value)));
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
                "is {:?}, which is no pixel type that is read; use MET_UCHAR to MET_DOUBLE",
                &*field.value
            )));
        }
    })
}

/// The name that [`pixel_type`] reads back.
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

#[cfg(test)]
mod tests {
    use super::super::header::Parser;
    use super::*;

    fn layout(lines: &str, data_bytes: u64) -> Result<Layout, Fault> {
        let mut parser = Parser::new(Limits::default());
        for line in lines.split_inclusive('\n') {
            parser.line(line.as_bytes())?;
        }
        parser.line(b"ElementDataFile = LOCAL\n")?;
        let header = parser.finish()?;
        let end = header.end;
        Layout::new(&header, end + data_bytes, &Limits::default())
    }

    const IMAGES: &str = "NDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\nKinds = domain domain list\n";

    #[test]
    fn shape_and_packing_are_read() {
        let got = layout(&format!("{IMAGES}ElementNumberOfChannels = 3\nElementByteOrderMSB = 1\n"), 144).unwrap();
        assert_eq!((got.content, got.size, got.layers), (Content::Sequence, [4, 3], 2));
        assert_eq!((got.pixel, got.channels, got.layer_bytes, got.big_endian), (PixelType::I16, 3, 72, true));
        assert!(!got.zlib && got.has_images());
        let padded = "NDims = 2\nDimSize = 4                   3  \nElementType = MET_FLOAT_ARRAY\n";
        let got = layout(padded, 48).unwrap();
        assert_eq!((got.content, got.size, got.layers, got.pixel), (Content::Sequence, [4, 3], 1, PixelType::F32));
    }

    #[test]
    fn every_type_is_known_by_its_own_name() {
        use PixelType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        for pixel in [U8, I8, U16, I16, U32, I32, U64, I64, F32, F64] {
            let lines = format!("NDims = 2\nDimSize = 1 1\nElementType = {}\n", element_type(pixel));
            assert_eq!(layout(&lines, pixel.bytes() as u64).unwrap().pixel, pixel);
        }
        let long = layout("NDims = 2\nDimSize = 1 1\nElementType = MET_ULONG\n", 4).unwrap();
        assert_eq!(long.pixel, U32);
    }

    #[test]
    fn kinds_tell_lists_from_volumes_and_without_them_the_frame_fields_do() {
        let bare = "NDims = 3\nDimSize = 1 1 1\nElementType = MET_UCHAR\n";
        let of = |more: &str| layout(&format!("{bare}{more}"), 1).unwrap().content;
        assert_eq!(of(""), Content::Volume);
        assert_eq!(of("Seq_Frame0000_Timestamp = 1\n"), Content::Sequence);
        assert_eq!(of("Kinds = domain domain domain\nSeq_Frame0000_ImageStatus = OK\n"), Content::Volume);
        assert_eq!(of("Kinds = domain   domain LIST\n"), Content::Sequence);
    }

    #[test]
    fn a_file_without_images_needs_no_type_and_may_carry_bytes_behind_its_header() {
        let lines = "NDims = 3\nDimSize = 0 0 5\nElementType = MET_OTHER\nKinds = domain domain list\n";
        for bytes in [0, 5, 7] {
            let got = layout(lines, bytes).unwrap();
            assert_eq!((got.size, got.layers, got.has_images()), ([0, 0], 5, false));
        }
    }

    #[test]
    fn what_cannot_be_true_is_refused_by_field_and_offset() {
        let at = |needle: &str, lines: &str| lines.find(needle).map_or(lines.len() + 24, |at| at) as u64;
        let with = |from: &str, to: &str| IMAGES.replace(from, to);
        let cases = [
            (with("NDims = 3\n", ""), 48, "NDims", "is missing"),
            (with("NDims = 3", "NDims = 4"), 48, "NDims", "sequence of volumes"),
            (with("NDims = 3", "NDims = 1"), 48, "NDims", "must be 2 or 3"),
            (with("4 3 2", "4 3"), 48, "DimSize", "exactly 3 whole numbers"),
            (with("4 3 2", "4 3 2 1"), 48, "DimSize", "exactly 3 whole numbers"),
            (with("4 3 2", "4 -3 2"), 48, "DimSize", "-3 is negative"),
            (with("4 3 2", "4 3.0 2"), 48, "DimSize", "not a whole number"),
            (with("4 3 2", "4 3 99999999999999999999"), 48, "DimSize", "does not fit 64 bits"),
            (with("4 3 2", "4 3 0"), 48, "DimSize", "no frames"),
            (with("4 3 2", "4 0 2"), 48, "DimSize", "one axis of the image is empty"),
            (with("4 3 2", "4 3 3"), 48, "DimSize", "promises 72 bytes of pixels, but the file holds 48"),
            (with("4 3 2", "4 3 1"), 48, "DimSize", "data after the last frame"),
            (with("MET_SHORT", "MET_OTHER"), 48, "ElementType", "no pixel type"),
            (with("MET_SHORT", "short"), 48, "ElementType", "no pixel type"),
            (with("domain list", "list domain"), 48, "Kinds", "must be the last"),
            (with("domain list", "list"), 48, "Kinds", "exactly 3 words"),
            (format!("{IMAGES}ElementNumberOfChannels = 5\n"), 48, "ElementNumberOfChannels", "1 to 4"),
            (format!("{IMAGES}ElementNumberOfChannels = 0\n"), 48, "ElementNumberOfChannels", "1 to 4"),
            (format!("{IMAGES}BinaryData = False\n"), 48, "BinaryData", "text"),
            (format!("{IMAGES}BinaryData = perhaps\n"), 48, "BinaryData", "neither True nor False"),
            (format!("{IMAGES}HeaderSize = -1\n"), 48, "HeaderSize", "skip bytes"),
            (format!("{IMAGES}ObjectType = Tube\n"), 48, "ObjectType", "only Image"),
            (
                format!("{IMAGES}BinaryDataByteOrderMSB = True\nElementByteOrderMSB = False\n"),
                48,
                "ElementByteOrderMSB",
                "contradicts",
            ),
            (
                format!("{IMAGES}CompressedData = True\nCompressedDataSize = 49\n"),
                48,
                "CompressedDataSize",
                "cut short",
            ),
            (
                format!("{IMAGES}CompressedData = True\nCompressedDataSize = 47\n"),
                48,
                "CompressedDataSize",
                "data follow",
            ),
            (
                with("4 3 2", "4 3 200000") + "CompressedData = True\n",
                48,
                "DimSize",
                "more than the 48 compressed bytes in the file can hold",
            ),
        ];
        for (lines, bytes, field, says) in cases {
            let expected = at(&format!("{field} ="), &lines);
            match layout(&lines, bytes).expect_err(says) {
                Fault::Field { field: f, offset, problem } => {
                    assert_eq!((f.as_str(), offset), (field, expected), "{problem}");
                    assert!(problem.contains(says), "{problem:?} does not say {says:?}");
                }
                limit @ Fault::Limit { .. } => panic!("{limit:?}"),
            }
        }
        let detached = {
            let mut parser = Parser::new(Limits::default());
            parser.line(b"ElementDataFile = image.raw\n").unwrap();
            Layout::new(&parser.finish().unwrap(), 100, &Limits::default()).unwrap_err()
        };
        assert!(
            matches!(&detached, Fault::Field { problem, offset: 0, .. } if problem.contains("file of its own")),
            "{detached:?}"
        );
    }

    #[test]
    fn limits_are_asked_before_anything_else() {
        let voxels = layout(&IMAGES.replace("4 3 2", "1000000 1000000 1000"), 48).unwrap_err();
        let says = |fault: &Fault, text: &str| matches!(fault, Fault::Limit { what, .. } if what.contains(text));
        assert!(says(&voxels, "field DimSize (byte 10): the size of one frame"), "{voxels:?}");
        let widest = layout(&IMAGES.replace("4 3 2", "18446744073709551615 18446744073709551615 1"), 48).unwrap_err();
        assert!(says(&widest, "the size of one frame"), "{widest:?}");
        let frames = layout(&IMAGES.replace("4 3 2", "4 3 1000000000000000"), 48).unwrap_err();
        assert!(says(&frames, "the number of frames"), "{frames:?}");
    }
}

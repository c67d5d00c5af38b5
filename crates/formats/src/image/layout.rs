//! Shape, type and packing of a file's pixel data, and whether they are possible.

use sonoweave_core::reading::PixelType;

use crate::Limits;
use crate::image::fault::{Fault, Field};

/// Largest expansion of a deflate stream: its shortest code for the longest copy (258 bytes)
/// takes two bits.
const DEFLATE_RATIO: u128 = 1032;

/// Meaning of the last axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Frames in temporal order (or a single frame).
    Sequence,
    /// A volume in space.
    Volume,
}

/// Encoding of the scalars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Raw,
    Zlib,
    /// One or more members.
    Gzip,
    /// Numbers as text, separated by whitespace.
    Text,
}

/// Axis that counts the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ListAxis {
    /// The slowest axis: frame after frame.
    Last,
    /// The fastest axis (after the channels): the first pixel of all frames, then the second of
    /// all frames.
    First,
}

/// Data to skip before the pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Skip<'a> {
    None,
    /// Number of decompressed bytes, with the field that gives it.
    Bytes(&'a Field, u64),
    /// All but the number of bytes that the pixels need.
    ToTheLast,
}

/// Location of the data.
#[derive(Debug, Clone, Copy)]
pub(crate) struct DataPlace<'a> {
    /// The field that names a separate data file, if there is one.
    pub(crate) file: Option<&'a Field>,
    /// Lines to skip before the data, as stored.
    pub(crate) skip_lines: u64,
    pub(crate) skip: Skip<'a>,
}

/// A header's description of its pixel data, not yet checked against the limits or the file.
#[derive(Debug)]
pub(crate) struct Claims<'a> {
    pub(crate) content: Content,
    /// The field that gives the shape.
    pub(crate) shape: &'a Field,
    /// Pixels along the first and second axis; both 0 in a file without images.
    pub(crate) size: [u64; 2],
    /// Number of frames or slices.
    pub(crate) layers: u64,
    pub(crate) channels: u32,
    pub(crate) pixel: PixelType,
    pub(crate) big_endian: bool,
    pub(crate) encoding: Encoding,
    pub(crate) list: ListAxis,
    pub(crate) data: DataPlace<'a>,
    /// Length of the compressed data, with the field that gives it.
    pub(crate) stated: Option<(&'a Field, u64)>,
}

/// Shape and packing of the pixel data, checked against the limits and the file's length.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Sequence or volume.
    pub content: Content,
    /// The field that gives the shape.
    pub(crate) shape: Field,
    /// Pixels along the first and second axis; both 0 in a file without images.
    pub size: [u32; 2],
    /// Number of frames or slices.
    pub layers: u64,
    /// `U8` if the file has no images and names no usable type.
    pub pixel: PixelType,
    /// Values per pixel.
    pub channels: u32,
    /// Bytes of one frame or slice, decompressed; 0 without images.
    pub layer_bytes: usize,
    pub(crate) big_endian: bool,
    pub(crate) encoding: Encoding,
    /// Position of the list among the axes.
    pub list: ListAxis,
    /// Name of a separate data file, if there is one.
    pub(crate) data_file: Option<Box<str>>,
    /// Decompressed bytes before the first pixel.
    pub(crate) skip_bytes: u64,
    /// Position of the data in its file, bytes.
    pub data_at: u64,
    /// Length of the data in the file, bytes as stored.
    pub(crate) data_bytes: u64,
}

/// Returns whether the kinds of a file's axes include a list of frames.
pub(crate) fn names_list(kinds: &str) -> bool {
    kinds.split_whitespace().any(|kind| kind.eq_ignore_ascii_case("list") || kind.eq_ignore_ascii_case("time"))
}

impl Layout {
    /// Checks `claims` of a file with `data_bytes` of data at `data_at`. Allocates nothing for
    /// pixels: impossible claims are refused first.
    pub(crate) fn new(claims: &Claims<'_>, data_at: u64, data_bytes: u64, limits: &Limits) -> Result<Self, Fault> {
        let Claims { shape, size, layers, channels, .. } = *claims;
        let images = !size.contains(&0);
        if !images && size != [0, 0] {
            return Err(shape.fault(format!("is {:?}: only one axis of the image is empty; correct it", &*shape.value)));
        }
        if layers == 0 {
            return Err(shape.fault("promises no frames; the recording is empty"));
        }
        let named = |what: &str| format!("field {} (byte {}): {what}", shape.name, shape.offset);
        if layers > limits.items {
            return Err(Fault::Limit {
                what: named("the number of frames"),
                value: u128::from(layers),
                limit: u128::from(limits.items),
                advice: "raise the frame limit if the file is trusted, or split the recording",
            });
        }
        let layer = (u128::from(size[0]) * u128::from(size[1]))
            .saturating_mul(u128::from(channels) * claims.pixel.bytes() as u128);
        let too_large = || Fault::Limit {
            what: named("the size of one frame in bytes"),
            value: layer,
            limit: u128::from(limits.frame_bytes),
            advice: "check the sizes and the type, or crop the frames",
        };
        if layer > u128::from(limits.frame_bytes) {
            return Err(too_large());
        }
        let axis = |n: u64| u32::try_from(n).map_err(|_| too_large());
        let mut layout = Self {
            content: claims.content,
            shape: shape.clone(),
            size: [axis(size[0])?, axis(size[1])?],
            layers,
            pixel: claims.pixel,
            channels,
            layer_bytes: usize::try_from(layer).map_err(|_| too_large())?,
            big_endian: claims.big_endian,
            encoding: claims.encoding,
            list: if layers == 1 { ListAxis::Last } else { claims.list },
            data_file: claims.data.file.map(|field| field.value.clone()),
            skip_bytes: 0,
            data_at,
            data_bytes,
        };
        if layout.list == ListAxis::First && layout.promised() > u128::from(limits.transposed_bytes) {
            return Err(Fault::Limit {
                what: named(
                    "the list of frames is the first axis, so that all must be in memory at once; their size in bytes",
                ),
                value: layout.promised(),
                limit: u128::from(limits.transposed_bytes),
                advice: "write the file with the list as its last axis, or crop it",
            });
        }
        if images {
            layout.skip(claims.data.skip)?;
            layout.check_length(claims.stated)?;
        }
        Ok(layout)
    }

    /// Creates the layout of a sequence to be written, with the values needed to interpret its
    /// frames' fields.
    pub(crate) fn to_be_written(layers: u64, images: bool) -> Self {
        Self {
            content: Content::Sequence,
            shape: Field { name: "DimSize".into(), value: "".into(), offset: 0 },
            size: [u32::from(images); 2],
            layers,
            pixel: PixelType::U8,
            channels: 1,
            layer_bytes: usize::from(images),
            big_endian: false,
            encoding: Encoding::Raw,
            list: ListAxis::Last,
            data_file: None,
            skip_bytes: 0,
            data_at: 0,
            data_bytes: 0,
        }
    }

    /// Returns whether the file holds pixels.
    pub fn has_images(&self) -> bool {
        self.layer_bytes != 0
    }

    /// Returns the number of bytes of all pixels.
    pub(crate) fn promised(&self) -> u128 {
        self.layer_bytes as u128 * u128::from(self.layers)
    }

    /// Describes the data file and its number of bytes, for messages.
    fn held(&self) -> String {
        match &self.data_file {
            Some(name) => format!("its data file {name} holds {}", self.data_bytes),
            None => format!("the file holds {} after its header", self.data_bytes),
        }
    }

    /// Skips the data before the pixels.
    fn skip(&mut self, skip: Skip<'_>) -> Result<(), Fault> {
        let over = match skip {
            Skip::None => 0,
            Skip::Bytes(field, bytes) if self.encoding == Encoding::Raw => {
                if bytes > self.data_bytes {
                    return Err(field.fault(format!("skips {bytes} bytes, but {}; correct it", self.held())));
                }
                bytes
            }
            Skip::Bytes(_, bytes) => {
                self.skip_bytes = bytes;
                0
            }
            // The length check reports a file that is too short.
            Skip::ToTheLast => u64::try_from(self.promised()).map_or(0, |bytes| self.data_bytes.saturating_sub(bytes)),
        };
        self.data_at += over;
        self.data_bytes -= over;
        Ok(())
    }

    /// Checks the length of the data. Files without images are not checked: PLUS writes a byte
    /// or so per sample after the header, which is not read.
    fn check_length(&self, stated: Option<(&Field, u64)>) -> Result<(), Fault> {
        let promised = self.promised();
        let held = u128::from(self.data_bytes);
        let (shape, holds) = (&self.shape, self.held());
        if self.encoding == Encoding::Raw {
            return match promised.cmp(&held) {
                std::cmp::Ordering::Equal => Ok(()),
                std::cmp::Ordering::Greater => Err(shape.fault(format!(
                    "promises {promised} bytes of pixels, but {holds}: it is cut short or the header is wrong; copy or record it again"
                ))),
                std::cmp::Ordering::Less => Err(shape.fault(format!(
                    "promises {promised} bytes of pixels, but {holds}: data follow the last frame; correct {} or remove them",
                    shape.name
                ))),
            };
        }
        if let Some((field, stated)) = stated
            && stated != self.data_bytes
        {
            let how = if stated > self.data_bytes { "it is cut short" } else { "data follow the compressed stream" };
            return Err(field.fault(format!(
                "promises {stated} bytes of compressed pixels, but {holds}: {how}; copy or record it again"
            )));
        }
        let most = match self.encoding {
            // One digit and one space per number, without a space after the last.
            Encoding::Text => held.div_ceil(2) * self.pixel.bytes() as u128,
            _ => held * DEFLATE_RATIO,
        };
        if promised + u128::from(self.skip_bytes) > most {
            let packed = if self.encoding == Encoding::Text { "" } else { "compressed " };
            return Err(shape.fault(format!(
                "promises {promised} bytes of pixels, more than the {held} {packed}bytes of data in the file can hold: it is cut short or the header is wrong"
            )));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::header::Parser;
    use super::super::metaimage::grammar::GRAMMAR;
    use super::super::metaimage::write::element_type;
    use super::*;

    fn layout(lines: &str, data_bytes: u64) -> Result<Layout, Fault> {
        let mut parser = Parser::new(&GRAMMAR, Limits::default());
        for line in lines.split_inclusive('\n') {
            parser.line(line.as_bytes())?;
        }
        parser.line(b"ElementDataFile = LOCAL\n")?;
        let header = parser.finish()?;
        let claims = (header.grammar.claims)(&header)?;
        Layout::new(&claims, header.end, data_bytes, &Limits::default())
    }

    const IMAGES: &str = "NDims = 3\nDimSize = 4 3 2\nElementType = MET_SHORT\nKinds = domain domain list\n";

    #[test]
    fn layout_reads_shape_and_packing() {
        let got = layout(&format!("{IMAGES}ElementNumberOfChannels = 3\nElementByteOrderMSB = 1\n"), 144).unwrap();
        assert_eq!((got.content, got.size, got.layers), (Content::Sequence, [4, 3], 2));
        assert_eq!((got.pixel, got.channels, got.layer_bytes, got.big_endian), (PixelType::I16, 3, 72, true));
        assert!(got.encoding == Encoding::Raw && got.has_images());
        let padded = "NDims = 2\nDimSize = 4                   3  \nElementType = MET_FLOAT_ARRAY\n";
        let got = layout(padded, 48).unwrap();
        assert_eq!((got.content, got.size, got.layers, got.pixel), (Content::Sequence, [4, 3], 1, PixelType::F32));
    }

    #[test]
    fn element_type_names_roundtrip() {
        for pixel in PixelType::ALL {
            let lines = format!("NDims = 2\nDimSize = 1 1\nElementType = {}\n", element_type(pixel));
            assert_eq!(layout(&lines, pixel.bytes() as u64).unwrap().pixel, pixel);
        }
        let long = layout("NDims = 2\nDimSize = 1 1\nElementType = MET_ULONG\n", 4).unwrap();
        assert_eq!(long.pixel, PixelType::U32);
    }

    #[test]
    fn content_follows_kinds_then_frame_fields() {
        let bare = "NDims = 3\nDimSize = 1 1 1\nElementType = MET_UCHAR\n";
        let of = |more: &str| layout(&format!("{bare}{more}"), 1).unwrap().content;
        assert_eq!(of(""), Content::Volume);
        assert_eq!(of("Seq_Frame0000_Timestamp = 1\n"), Content::Sequence);
        assert_eq!(of("Kinds = domain domain domain\nSeq_Frame0000_ImageStatus = OK\n"), Content::Volume);
        assert_eq!(of("Kinds = domain   domain LIST\n"), Content::Sequence);
    }

    #[test]
    fn file_without_images_needs_no_type_and_no_exact_length() {
        let lines = "NDims = 3\nDimSize = 0 0 5\nElementType = MET_OTHER\nKinds = domain domain list\n";
        for bytes in [0, 5, 7] {
            let got = layout(lines, bytes).unwrap();
            assert_eq!((got.size, got.layers, got.has_images()), ([0, 0], 5, false));
        }
    }

    #[test]
    fn impossible_layout_is_refused_by_field_and_offset() {
        let at = |needle: &str, lines: &str| lines.find(needle).map_or(lines.len() + 24, |at| at) as u64;
        let with = |from: &str, to: &str| IMAGES.replace(from, to);
        let cases = [
            (with("NDims = 3\n", ""), 48, "NDims", "is missing"),
            (with("NDims = 3", "NDims = 4"), 48, "NDims", "sequences of volumes"),
            (with("NDims = 3", "NDims = 1"), 48, "NDims", "must be 2 or 3"),
            (with("4 3 2", "4 3"), 48, "DimSize", "exactly 3 whole numbers"),
            (with("4 3 2", "4 3 2 1"), 48, "DimSize", "exactly 3 whole numbers"),
            (with("4 3 2", "4 -3 2"), 48, "DimSize", "-3 is negative"),
            (with("4 3 2", "4 3.0 2"), 48, "DimSize", "not a whole number"),
            (with("4 3 2", "4 3 99999999999999999999"), 48, "DimSize", "does not fit 64 bits"),
            (with("4 3 2", "4 3 0"), 48, "DimSize", "no frames"),
            (with("4 3 2", "4 0 2"), 48, "DimSize", "one axis of the image is empty"),
            (with("4 3 2", "4 3 3"), 48, "DimSize", "promises 72 bytes of pixels, but the file holds 48"),
            (with("4 3 2", "4 3 1"), 48, "DimSize", "data follow the last frame"),
            (with("MET_SHORT", "MET_OTHER"), 48, "ElementType", "not a supported pixel type"),
            (with("MET_SHORT", "short"), 48, "ElementType", "not a supported pixel type"),
            (with("domain list", "list domain"), 48, "Kinds", "must be the last"),
            (with("domain list", "list"), 48, "Kinds", "exactly 3 words"),
            (format!("{IMAGES}ElementNumberOfChannels = 5\n"), 48, "ElementNumberOfChannels", "1 to 4"),
            (format!("{IMAGES}ElementNumberOfChannels = 0\n"), 48, "ElementNumberOfChannels", "1 to 4"),
            (format!("{IMAGES}BinaryData = False\n"), 46, "DimSize", "more than the 46 bytes of data"),
            (format!("{IMAGES}BinaryData = False\nCompressedData = True\n"), 48, "BinaryData", "numbers as text"),
            (format!("{IMAGES}BinaryData = perhaps\n"), 48, "BinaryData", "write True or False"),
            (format!("{IMAGES}HeaderSize = -1\n"), 48, "HeaderSize", "skips bytes"),
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
                "more than the 48 compressed bytes of data in the file can hold",
            ),
        ];
        for (lines, bytes, field, part) in cases {
            let expected = at(&format!("{field} ="), &lines);
            match layout(&lines, bytes).expect_err(part) {
                Fault::Field { field: f, offset, problem } => {
                    assert_eq!((f.as_str(), offset), (field, expected), "{problem}");
                    assert!(problem.contains(part), "{problem:?} does not contain {part:?}");
                }
                limit @ Fault::Limit { .. } => panic!("{limit:?}"),
            }
        }
    }

    #[test]
    fn limits_are_checked_first() {
        let voxels = layout(&IMAGES.replace("4 3 2", "1000000 1000000 1000"), 48).unwrap_err();
        let names = |fault: &Fault, text: &str| matches!(fault, Fault::Limit { what, .. } if what.contains(text));
        assert!(names(&voxels, "field DimSize (byte 10): the size of one frame"), "{voxels:?}");
        let widest = layout(&IMAGES.replace("4 3 2", "18446744073709551615 18446744073709551615 1"), 48).unwrap_err();
        assert!(names(&widest, "the size of one frame"), "{widest:?}");
        let frames = layout(&IMAGES.replace("4 3 2", "4 3 1000000000000000"), 48).unwrap_err();
        assert!(names(&frames, "the number of frames"), "{frames:?}");
    }
}

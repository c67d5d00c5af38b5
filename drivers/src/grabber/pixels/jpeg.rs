//! Motion JPEG: one JPEG image per frame, often without the Huffman tables, which are the same
//! for all frames.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::colour;
use super::format::Colour;
use super::refusal::Refusal;
use super::rows::Rows;

/// Decodes frames and reuses its buffers.
#[derive(Default)]
pub(super) struct Decoder {
    /// The frame with inserted tables.
    spliced: Vec<u8>,
    /// The whole decoded frame, if only some rows are wanted or in another order.
    whole: Vec<u8>,
}

/// The end marker of an image.
const END: [u8; 2] = [0xff, 0xd9];

/// Contents of the markers before the compressed data.
struct Head {
    /// Position of the scan's marker.
    scan: usize,
    has_tables: bool,
    components: u8,
    size: [u32; 2],
}

impl Decoder {
    /// Decodes a frame of `size` and copies its `rows` to `out`.
    pub(super) fn decode(
        &mut self,
        video: &[u8],
        size: [u32; 2],
        colour: Colour,
        rows: Rows,
        out: &mut [u8],
    ) -> Result<(), Refusal> {
        let head = head(video)?;
        if head.size != size {
            return refuse(format!(
                "it has {}×{} pixels instead of {}×{}",
                head.size[0], head.size[1], size[0], size[1]
            ));
        }
        // These two bytes cannot occur within compressed data, so they mark its end.
        let Some(end) = video[head.scan..].windows(2).rposition(|pair| pair == END) else {
            return refuse("its end is missing".into());
        };
        // The decoder invents missing data before an end marker, but reports them without one. So
        // it does not receive the marker. Shorter rows keep it, because they may have fewer bits
        // than the decoder reads ahead.
        let video = if size[0] < 64 { video } else { &video[..head.scan + end] };
        let video = if head.has_tables {
            video
        } else {
            self.spliced.clear();
            self.spliced.extend_from_slice(&video[..head.scan]);
            append_standard_tables(&mut self.spliced);
            self.spliced.extend_from_slice(&video[head.scan..]);
            &self.spliced
        };
        let (width, height) = (size[0] as usize, size[1] as usize);
        let grey = head.components == 1;
        let space = if grey || colour == Colour::Grey { ColorSpace::Luma } else { ColorSpace::RGB };
        let as_is = rows == Rows::WHOLE && (colour == Colour::Grey || !grey);
        if as_is {
            return pixels(video, size, space, out);
        }
        let stride = width * space.num_components();
        self.whole.resize(stride * height, 0);
        pixels(video, size, space, &mut self.whole)?;
        for (i, line) in out.chunks_exact_mut(width * colour.channels()).enumerate() {
            let row = &self.whole[rows.line(i, height) * stride..][..stride];
            if row.len() == line.len() {
                line.copy_from_slice(row);
            } else {
                colour::triple(row, line, |row, line| line.copy_from_slice(row));
            }
        }
        Ok(())
    }
}

fn pixels(video: &[u8], size: [u32; 2], space: ColorSpace, out: &mut [u8]) -> Result<(), Refusal> {
    // Strict: damaged data are refused, not invented.
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(size[0] as usize)
        .set_max_height(size[1] as usize)
        .jpeg_set_out_colorspace(space);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(video), options);
    decoder.decode_headers().or_else(|error| refuse(error.to_string()))?;
    if decoder.output_buffer_size() != Some(out.len()) {
        return refuse("its colours are of an unknown kind".into());
    }
    decoder.decode_into(out).or_else(|error| refuse(error.to_string()))
}

fn refuse<T>(problem: String) -> Result<T, Refusal> {
    Err(Refusal::Jpeg(problem.trim_end().to_owned()))
}

/// Reads the markers up to the first scan.
fn head(video: &[u8]) -> Result<Head, Refusal> {
    if !video.starts_with(&[0xff, 0xd8]) {
        return refuse("it does not begin like one".into());
    }
    let mut at = 2;
    let mut has_tables = false;
    let mut frame = None;
    loop {
        // A marker may follow any number of fill bytes.
        while video.get(at) == Some(&0xff) && video.get(at + 1) == Some(&0xff) {
            at += 1;
        }
        let Some(&[0xff, marker, high, low]) = video.get(at..).and_then(|rest| rest.first_chunk()) else {
            return refuse("it ends before its picture".into());
        };
        let Some(segment) = video.get(at + 4..at + 2 + usize::from(u16::from_be_bytes([high, low]))) else {
            return refuse("it ends before its picture".into());
        };
        match marker {
            0xda => {
                let Some((components, size)) = frame else {
                    return refuse("its picture comes before its size".into());
                };
                return Ok(Head { scan: at, has_tables, components, size });
            }
            0xc4 => has_tables = true,
            // Baseline, extended and progressive; other types are not decoded.
            0xc0..=0xc2 => {
                let Some(&[_, h1, h0, w1, w0, components]) = segment.first_chunk() else {
                    return refuse("its size is cut off".into());
                };
                let size = [u16::from_be_bytes([w1, w0]).into(), u16::from_be_bytes([h1, h0]).into()];
                frame = Some((components, size));
            }
            _ => {}
        }
        at += 4 + segment.len();
    }
}

/// ITU-T T.81, annex K.3: class and number, codes of each length from 1 to 16 bits, values.
const STANDARD_TABLES: [(u8, [u8; 16], &[u8]); 4] = [
    (0x00, [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]),
    (
        0x10,
        [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d],
        &[
            0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
            0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
            0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
            0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
            0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
            0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
            0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
            0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
            0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
        ],
    ),
    (0x01, [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]),
    (
        0x11,
        [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77],
        &[
            0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
            0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
            0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
            0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
            0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
            0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
            0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
            0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
            0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
        ],
    ),
];

fn append_standard_tables(out: &mut Vec<u8>) {
    for (class_and_number, lengths, values) in STANDARD_TABLES {
        // 2 bytes of length, the class and number, 16 lengths; at most 162 values.
        let length = (2 + 1 + lengths.len() + values.len()) as u16;
        out.extend_from_slice(&[0xff, 0xc4]);
        out.extend_from_slice(&length.to_be_bytes());
        out.push(class_and_number);
        out.extend_from_slice(&lengths);
        out.extend_from_slice(values);
    }
}

//! Encodes pixels as PNG and decodes them, losslessly and fast enough to leave the core to
//! other work.
//!
//! Other programs also show sessions, and all of them know PNG. Pixels are therefore stored
//! once, exactly, and in a displayable form. The filter Average subtracts from each pixel a
//! prediction by its left and upper neighbours; of an ultrasound image this leaves only noise.
//! The fixed code of `fdeflate` then codes the rest in one pass without a search. An image that
//! does not become smaller is stored uncompressed.
//!
//! Measured on one core of the build machine (2 cores shared, indicative), MB/s of plain pixels
//! and ratio. The 820×616 recordings are from an ultrasound scanner: the spine phantom; a
//! curvilinear probe in scan conversion; wires in water, mostly black. The painted ones are
//! 512×480 blobs with noise of σ 6 and speckle:
//!
//! | | spine | curvilinear | water tank | painted | speckle |
//! |---|---|---|---|---|---|
//! | zstd 1 of plain pixels | 472, 2.86 | 449, 1.75 | 2507, 86 | 952, 1.39 | 941, 1.19 |
//! | zstd −5 of plain pixels | 733, 2.32 | 1728, 1.44 | 3764, 67 | 4257, 1.00 | 4332, 1.00 |
//! | lz4 of plain pixels | 681, 2.32 | 1736, 1.43 | 3846, 55 | 4554, 1.00 | 5866, 1.00 |
//! | Sub, zstd 1 | 438, 3.79 | 654, 1.99 | 2186, 90 | 835, 1.52 | 907, 1.42 |
//! | Average, zstd 1 | 416, 3.80 | 668, 2.03 | 1887, 78 | 871, 1.59 | 873, 1.50 |
//! | Sub, fdeflate | 779, 3.59 | 778, 1.75 | 3360, 62 | 648, 1.32 | 642, 1.21 |
//! | **Average, fdeflate** | 726, 3.60 | 770, 1.77 | 2880, 55 | 650, 1.39 | 637, 1.29 |
//! | Up, zlib-rs 1 | 213, 2.41 | 118, 1.37 | 1774, 37 | 87, 0.97 | 78, 0.96 |
//!
//! zstd on filtered rows is smaller by a tenth, but it is written in C, and no other viewer
//! would undo the filter. zstd on plain pixels is no smaller. Chunks of a session are therefore
//! not compressed: the remaining data is small. 640×480 at 60 Hz are 18.4 MB/s: 3 % of a core.

use sonoweave_core::reading::PixelType;

/// Magic bytes of a PNG.
const MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// The filter of every row: subtracts from each byte the mean, rounded down, of the bytes to
/// the left and above.
const AVERAGE: u8 = 3;

/// Pixel layout in PNG terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    width: u32,
    height: u32,
    /// Bits per sample.
    depth: u8,
    /// PNG's colour type.
    colour: u8,
    /// Bytes per pixel, as used by the filter.
    pixel_bytes: usize,
    row_bytes: usize,
    /// Whether samples have two bytes, which PNG stores in the other byte order.
    swapped: bool,
}

impl Shape {
    /// Returns the layout of width × height pixels. Grey and colour pixels of 8 and 16 bits
    /// become such images; any other type becomes an image of its bytes, row by row. `None` if
    /// there are no pixels, or more than a PNG can hold.
    pub(super) fn of([width, height]: [u32; 2], channels: u32, pixel: PixelType) -> Option<Self> {
        let row_bytes = u64::from(width) * u64::from(channels) * pixel.bytes() as u64;
        let most = 1_u64 << 31;
        if row_bytes == 0 || height == 0 || row_bytes >= most || u64::from(height) >= most {
            return None;
        }
        let colour = match channels {
            1 => Some(0),
            2 => Some(4),
            3 => Some(2),
            4 => Some(6),
            _ => None,
        };
        let row_bytes = row_bytes as usize;
        let shape = |width, depth, colour, pixel_bytes| {
            let swapped = depth == 16 && cfg!(target_endian = "little");
            Some(Self { width, height, depth, colour, pixel_bytes, row_bytes, swapped })
        };
        match (pixel, colour) {
            (PixelType::U8, Some(colour)) => shape(width, 8, colour, channels as usize),
            (PixelType::U16, Some(colour)) => shape(width, 16, colour, 2 * channels as usize),
            _ => shape(row_bytes as u32, 8, 0, 1),
        }
    }

    /// Returns the number of bytes of the pixels.
    pub(super) fn bytes(&self) -> usize {
        self.row_bytes * self.height as usize
    }

    fn header(&self) -> [u8; 13] {
        let mut header = [0; 13];
        header[..4].copy_from_slice(&self.width.to_be_bytes());
        header[4..8].copy_from_slice(&self.height.to_be_bytes());
        (header[8], header[9]) = (self.depth, self.colour);
        header
    }
}

/// Encodes images, in reused memory.
#[derive(Debug, Default)]
pub(super) struct Encoder {
    filtered: Vec<u8>,
    swapped: Vec<u8>,
    picture: Vec<u8>,
}

impl Encoder {
    /// Encodes pixels stored row by row; `stride` is the distance between row beginnings,
    /// bytes.
    pub(super) fn encode(&mut self, shape: &Shape, pixels: &[u8], stride: usize) -> &[u8] {
        self.filter(shape, pixels, stride);
        let picture = &mut self.picture;
        picture.clear();
        picture.extend_from_slice(&MAGIC);
        chunk(picture, *b"IHDR", |data| data.extend_from_slice(&shape.header()));
        let filtered = &self.filtered;
        chunk(picture, *b"IDAT", |data| {
            let at = data.len();
            deflate(filtered, data);
            if data.len() - at > filtered.len() {
                data.truncate(at);
                store(filtered, data);
            }
        });
        chunk(picture, *b"IEND", |_| {});
        picture
    }

    fn filter(&mut self, shape: &Shape, pixels: &[u8], stride: usize) {
        let Self { filtered, swapped, .. } = self;
        filtered.clear();
        let (row_bytes, back) = (shape.row_bytes, shape.pixel_bytes);
        let mut above: &[u8] = &[];
        let rows = pixels.chunks(stride).take(shape.height as usize).map(|row| &row[..row_bytes]);
        if shape.swapped {
            swapped.clear();
            rows.for_each(|row| swapped.extend(row.as_chunks::<2>().0.iter().flat_map(|[a, b]| [*b, *a])));
            swapped.chunks_exact(row_bytes).for_each(|row| {
                average(row, above, back, filtered);
                above = row;
            });
        } else {
            rows.for_each(|row| {
                average(row, above, back, filtered);
                above = row;
            });
        }
    }
}

/// Filters one row; `above` is empty for the first row.
fn average(row: &[u8], above: &[u8], back: usize, filtered: &mut Vec<u8>) {
    filtered.push(AVERAGE);
    let half = |a: u8, b: u8| ((u16::from(a) + u16::from(b)) / 2) as u8;
    if above.is_empty() {
        filtered.extend_from_slice(&row[..back]);
        filtered.extend(row[back..].iter().zip(row).map(|(byte, left)| byte.wrapping_sub(left / 2)));
    } else {
        filtered.extend(row[..back].iter().zip(above).map(|(byte, up)| byte.wrapping_sub(up / 2)));
        let left_and_up = row.iter().zip(&above[back..]);
        filtered.extend(row[back..].iter().zip(left_and_up).map(|(b, (left, up))| b.wrapping_sub(half(*left, *up))));
    }
}

/// Reverses the filter in place.
fn undo(row: &mut [u8], above: &[u8], back: usize) {
    let half = |a: u8, b: u8| ((u16::from(a) + u16::from(b)) / 2) as u8;
    // Grey pixels: the left neighbour is the previous byte, kept in a register.
    if back == 1 {
        let mut left = 0;
        if above.is_empty() {
            for byte in row {
                left = byte.wrapping_add(left / 2);
                *byte = left;
            }
        } else {
            for (byte, up) in row.iter_mut().zip(above) {
                left = byte.wrapping_add(half(left, *up));
                *byte = left;
            }
        }
        return;
    }
    for n in 0..row.len() {
        let left = if n < back { 0 } else { row[n - back] };
        row[n] = row[n].wrapping_add(half(left, above.get(n).copied().unwrap_or(0)));
    }
}

/// Appends a PNG chunk.
fn chunk(to: &mut Vec<u8>, name: [u8; 4], fill: impl FnOnce(&mut Vec<u8>)) {
    let at = to.len();
    to.extend_from_slice(&[0; 4]);
    to.extend_from_slice(&name);
    fill(to);
    let length = (to.len() - at - 8) as u32;
    to[at..at + 4].copy_from_slice(&length.to_be_bytes());
    let sum = crc32fast::hash(&to[at + 4..]);
    to.extend_from_slice(&sum.to_be_bytes());
}

fn deflate(bytes: &[u8], to: &mut Vec<u8>) {
    // Writing to memory cannot fail.
    if let Ok(mut compressor) = fdeflate::Compressor::new(&mut *to)
        && compressor.write_data(bytes).is_ok()
    {
        let _ = compressor.finish();
    }
}

/// Appends the bytes uncompressed, in a valid deflate stream.
fn store(bytes: &[u8], to: &mut Vec<u8>) {
    let at = to.len() as u64;
    let mut to = std::io::Cursor::new(to);
    to.set_position(at);
    if let Ok(mut compressor) = fdeflate::StoredOnlyCompressor::new(to)
        && compressor.write_data(bytes).is_ok()
    {
        let _ = compressor.finish();
    }
}

/// Decodes images, in reused memory. Accepts only those that [`Encoder`] makes.
#[derive(Debug, Default)]
pub(super) struct Decoder {
    filtered: Vec<u8>,
}

impl Decoder {
    /// Decodes an image of that shape into rows of `to`, `stride` bytes apart. Writes only the
    /// image's own bytes; returns the fault of an invalid image.
    pub(super) fn decode(
        &mut self,
        shape: &Shape,
        picture: &[u8],
        to: &mut [u8],
        stride: usize,
    ) -> Result<(), &'static str> {
        let data = deflated(shape, picture)?;
        let filtered_bytes = shape.bytes() + shape.height as usize;
        self.filtered.clear();
        // One byte more, so that excess data is detected.
        self.filtered.resize(filtered_bytes + 1, 0);
        if inflate(data, &mut self.filtered)? != filtered_bytes {
            return Err("an image of another size than its header states");
        }
        let mut above: &[u8] = &[];
        let rows = self.filtered[..filtered_bytes].chunks_exact_mut(1 + shape.row_bytes);
        for (row, to) in rows.zip(to.chunks_mut(stride)) {
            let [filter, row @ ..] = row else { return Err("an image without rows") };
            if *filter != AVERAGE {
                return Err("an image of another program");
            }
            undo(row, above, shape.pixel_bytes);
            let to = to.get_mut(..row.len()).ok_or("an image larger than its frame")?;
            if shape.swapped {
                let pairs = row.as_chunks::<2>().0.iter().zip(to.as_chunks_mut::<2>().0);
                pairs.for_each(|([a, b], to)| *to = [*b, *a]);
            } else {
                to.copy_from_slice(row);
            }
            above = row;
        }
        Ok(())
    }
}

/// Returns the content of an image's single data chunk.
fn deflated<'a>(shape: &Shape, picture: &'a [u8]) -> Result<&'a [u8], &'static str> {
    const NO: &str = "an image of an unknown kind";
    let rest = picture.strip_prefix(&MAGIC).ok_or(NO)?;
    let (header, rest) = part(rest, *b"IHDR").ok_or(NO)?;
    if *header != shape.header() {
        return Err("an image of another size or kind than its message states");
    }
    let (data, rest) = part(rest, *b"IDAT").ok_or(NO)?;
    part(rest, *b"IEND").map(|_| data).ok_or(NO)
}

fn part(bytes: &[u8], name: [u8; 4]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<4>()?;
    let rest = rest.strip_prefix(&name)?;
    let (data, rest) = rest.split_at_checked(u32::from_be_bytes(*length) as usize)?;
    Some((data, rest.get(4..)?))
}

/// Inflates `data` into `to`; returns the number of bytes.
fn inflate(data: &[u8], to: &mut [u8]) -> Result<usize, &'static str> {
    const DAMAGED: &str = "a damaged image";
    let mut inflater = fdeflate::Decompressor::new();
    let (mut read, mut written) = (0, 0);
    while !inflater.is_done() {
        let (used, made) = inflater.read(&data[read..], to, written, true).map_err(|_| DAMAGED)?;
        (read, written) = (read + used, written + made);
        if (used, made) == (0, 0) && !inflater.is_done() {
            return Err(DAMAGED);
        }
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Decodes an image with another decoder: its samples, two-byte samples in PNG's byte
    /// order.
    fn by_another_hand(picture: &[u8]) -> Vec<u8> {
        let mut reader = png::Decoder::new(std::io::Cursor::new(picture)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        pixels.truncate(info.buffer_size());
        pixels
    }

    const TYPES: [PixelType; 5] = [PixelType::U8, PixelType::U16, PixelType::I16, PixelType::F32, PixelType::F64];

    proptest! {
        #[test]
        fn pixels_roundtrip_and_match_other_decoder(
            size in [1_u32..40, 1_u32..20], channels in 1_u32..6, kind in 0..TYPES.len(), apart in 0_usize..9,
            noise in prop::bool::ANY, seed: u64,
        ) {
            let shape = Shape::of(size, channels, TYPES[kind]).unwrap();
            let (row, rows) = (shape.row_bytes, size[1] as usize);
            let stride = row + apart;
            let mut random = fastrand::Rng::with_seed(seed);
            let pixels: Vec<u8> = (0..stride * rows).map(|n| if noise { random.u8(..) } else { (n / 7) as u8 }).collect();
            let mut encoder = Encoder::default();
            // Earlier content of the buffers must not matter.
            encoder.encode(&shape, &vec![1; stride * rows], stride);
            let picture = encoder.encode(&shape, &pixels, stride).to_vec();
            // No larger than uncompressed: 5 bytes per 65535, and PNG's own.
            prop_assert!(picture.len() <= shape.bytes() + rows + 5 * (shape.bytes() / 60_000 + 1) + 70);
            let mut again = vec![0xab; stride * rows];
            let mut decoder = Decoder::default();
            decoder.decode(&shape, &picture, &mut again, stride).unwrap();
            for (a, b) in again.chunks(stride).zip(pixels.chunks(stride)) {
                prop_assert_eq!(&a[..row], &b[..row]);
                prop_assert!(a[row..].iter().all(|byte| *byte == 0xab), "beyond the picture");
            }
            let mut plain: Vec<u8> = pixels.chunks(stride).flat_map(|line| line[..row].to_vec()).collect();
            if shape.swapped {
                plain.as_chunks_mut::<2>().0.iter_mut().for_each(|pair| pair.swap(0, 1));
            }
            prop_assert_eq!(by_another_hand(&picture), plain);
        }

        #[test]
        fn damaged_picture_is_refused_or_harmless(at: prop::sample::Index, with in 1_u8..=255) {
            let shape = Shape::of([16, 9], 1, PixelType::U8).unwrap();
            let pixels: Vec<u8> = (0..144).map(|n| (n * n / 50) as u8).collect();
            let mut encoder = Encoder::default();
            let mut picture = encoder.encode(&shape, &pixels, 16).to_vec();
            let mut again = vec![0; 144];
            let mut decoder = Decoder::default();
            for length in 0..picture.len() {
                prop_assert!(decoder.decode(&shape, &picture[..length], &mut again, 16).is_err());
            }
            let at = at.index(picture.len());
            picture[at] ^= with;
            if decoder.decode(&shape, &picture, &mut again, 16).is_ok() {
                prop_assert_eq!(again, pixels);
            }
        }
    }

    #[test]
    fn shape_of_no_or_too_many_pixels_is_none() {
        assert!(Shape::of([0, 5], 1, PixelType::U8).is_none() && Shape::of([5, 0], 1, PixelType::U8).is_none());
        assert!(Shape::of([5, 5], 0, PixelType::U8).is_none());
        assert!(Shape::of([1 << 30, 1], 4, PixelType::F64).is_none());
        assert!(Shape::of([1, u32::MAX], 1, PixelType::U8).is_none());
    }
}

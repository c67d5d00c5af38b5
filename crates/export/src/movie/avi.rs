//! Motion JPEG in AVI: a JPEG picture after the other, and their index at the end. Layout by
//! Microsoft's reference of AVI RIFF files; numbers are little endian.

use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::sync::Arc;

use image::RgbImage;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

use super::reel::Reel;

/// Quality of the JPEG pictures, of 100.
const QUALITY: u8 = 92;
/// Bytes before the first picture.
const HEADER: usize = 224;
/// Most bytes that all players read.
const MOST: usize = i32::MAX as usize;
/// Name of a picture's chunk: stream 0, compressed.
const PICTURE: &[u8; 4] = b"00dc";
/// The file has an index; in it, the picture can be decoded by itself.
const FLAG: u32 = 0x10;

/// Writes all pictures.
pub(super) fn write<W: Write + Seek>(
    to: &mut W,
    reel: Reel,
    pictures: impl Iterator<Item = Arc<RgbImage>>,
) -> io::Result<()> {
    let size = reel.size_of_16_bits()?;
    to.write_all(&[0; HEADER])?;
    let mut index: Vec<[u32; 2]> = Vec::new();
    // From the name of the list of pictures on, which offsets count from.
    let mut bytes = 4;
    for picture in pictures {
        let mut jpeg = Vec::new();
        let mut encoder = Encoder::new(&mut jpeg, QUALITY);
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        encoder.encode(picture.as_raw(), size[0], size[1], ColorType::Rgb).map_err(io::Error::other)?;
        index.push([bytes as u32, jpeg.len() as u32]);
        // Chunks begin at even offsets.
        jpeg.resize(jpeg.len().next_multiple_of(2), 0);
        bytes += 8 + jpeg.len();
        if HEADER + bytes + 8 + 16 * index.len() > MOST {
            return Err(io::Error::new(
                ErrorKind::FileTooLarge,
                "an AVI file holds 2 GB; make the movie shorter or its pictures smaller",
            ));
        }
        to.write_all(PICTURE)?;
        to.write_all(&index[index.len() - 1][1].to_le_bytes())?;
        to.write_all(&jpeg)?;
    }
    to.write_all(b"idx1")?;
    to.write_all(&(16 * index.len() as u32).to_le_bytes())?;
    for [at, length] in &index {
        to.write_all(PICTURE)?;
        [FLAG, *at, *length].iter().try_for_each(|number| to.write_all(&number.to_le_bytes()))?;
    }
    let largest = index.iter().map(|[_, length]| *length).max().unwrap_or_default();
    to.seek(SeekFrom::Start(0))?;
    to.write_all(&header(reel, index.len() as u32, bytes as u32, largest))?;
    to.flush()
}

/// Returns all that stands before the first picture: `bytes` of the list of pictures, and the bytes
/// of the largest one.
fn header(reel: Reel, pictures: u32, bytes: u32, largest: u32) -> Vec<u8> {
    let Reel { size: [width, height], rate } = reel;
    let hz = rate.hz();
    let mut stream = Vec::new();
    let format = [40, width, height, 1 | 24 << 16, u32::from_le_bytes(*b"MJPG"), 3 * width * height, 0, 0, 0, 0];
    let rectangle = [0, width | height << 16];
    stream.extend(chunk(
        b"strh",
        &[
            &words(&[u32::from_le_bytes(*b"vids"), u32::from_le_bytes(*b"MJPG"), 0, 0, 0]),
            &words(&[1000, rate.millihertz().get().into(), 0, pictures, largest, u32::MAX, 0]),
            &words(&rectangle),
        ],
    ));
    stream.extend(chunk(b"strf", &[&words(&format)]));
    let main = [
        (1e6 / hz).round() as u32,
        (f64::from(largest) * hz).ceil().min(f64::from(u32::MAX)) as u32,
        0,
        FLAG,
        pictures,
        0,
        1,
        largest,
        width,
        height,
        0,
        0,
        0,
        0,
    ];
    let all = [chunk(b"avih", &[&words(&main)]), chunk(b"LIST", &[b"strl", &stream])].concat();
    let all = [chunk(b"LIST", &[b"hdrl", &all]), [&b"LIST"[..], &bytes.to_le_bytes(), b"movi"].concat()].concat();
    let whole = 4 + all.len() as u32 + (bytes - 4) + 8 + 16 * pictures;
    [&b"RIFF"[..], &whole.to_le_bytes(), b"AVI ", &all].concat()
}

/// Returns a chunk of some parts.
fn chunk(name: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let parts = parts.concat();
    [&name[..], &(parts.len() as u32).to_le_bytes(), &parts].concat()
}

fn words(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

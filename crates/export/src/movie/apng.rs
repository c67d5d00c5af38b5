//! Animated PNG: every picture is exact. Only what differs from the picture before is stored.

use std::io::{self, Seek, SeekFrom, Write};
use std::sync::Arc;

use image::RgbImage;
use png::{BitDepth, ColorType, Encoder, EncodingError};

use super::changed::Area;
use super::reel::Reel;

/// Most pictures that the format can count.
const MOST: u32 = i32::MAX.cast_unsigned();
/// Place of the chunk that counts the pictures: behind the signature and the header's chunk.
const COUNT_AT: u64 = 8 + 25;
/// The name and the contents of that chunk.
const COUNT_NAME: &[u8; 4] = b"acTL";

/// Writes all pictures, to be shown again and again.
pub(super) fn write<W: Write + Seek>(
    to: &mut W,
    reel: Reel,
    pictures: impl Iterator<Item = Arc<RgbImage>>,
) -> io::Result<()> {
    let count = encode(to, reel, pictures).map_err(|error| match error {
        EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    })?;
    // The number of pictures stands before them, and is known only now.
    let mut chunk = [0; 12];
    chunk[..4].copy_from_slice(COUNT_NAME);
    chunk[4..8].copy_from_slice(&count.to_be_bytes());
    let sum = crc32fast::hash(&chunk);
    to.seek(SeekFrom::Start(COUNT_AT + 4))?;
    to.write_all(&chunk)?;
    to.write_all(&sum.to_be_bytes())?;
    to.flush()
}

fn encode<W: Write>(
    to: &mut W,
    reel: Reel,
    pictures: impl Iterator<Item = Arc<RgbImage>>,
) -> Result<u32, EncodingError> {
    let [width, height] = reel.size;
    let mut encoder = Encoder::new(to, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_animated(MOST, 0)?;
    encoder.set_frame_delay(1000, reel.rate.millihertz().get())?;
    let mut writer = encoder.write_header()?;
    let (mut count, mut before) = (0, None::<Arc<RgbImage>>);
    for picture in pictures {
        let area = Area::changed(before.as_deref(), &picture);
        writer.reset_frame_position()?;
        writer.set_frame_dimension(area.size[0], area.size[1])?;
        writer.set_frame_position(area.at[0], area.at[1])?;
        writer.write_image_data(&area.pixels(&picture))?;
        (count, before) = (count + 1, Some(picture));
    }
    writer.finish()?;
    Ok(count)
}

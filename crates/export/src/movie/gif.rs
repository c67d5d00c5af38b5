//! GIF: grey pictures are exact, others have the 256 colours that suit them best. Only what
//! differs from the picture before is stored.

use std::io::{self, Write};
use std::sync::Arc;

use gif::{DisposalMethod, Encoder, EncodingError, Frame, Repeat};
use image::RgbImage;

use super::changed::Area;
use super::reel::Reel;

/// Effort of the search for colours: 1 is the most careful, 30 the fastest.
const SPEED: i32 = 10;

/// Writes all pictures, to be shown again and again.
pub(super) fn write<W: Write>(to: &mut W, reel: Reel, pictures: impl Iterator<Item = Arc<RgbImage>>) -> io::Result<()> {
    let size = reel.size_of_16_bits()?;
    encode(to, reel, size, pictures).map_err(|error| match error {
        EncodingError::Io(error) => error,
        other => io::Error::other(other),
    })?;
    to.flush()
}

fn encode<W: Write>(
    to: &mut W,
    reel: Reel,
    [width, height]: [u16; 2],
    pictures: impl Iterator<Item = Arc<RgbImage>>,
) -> Result<(), EncodingError> {
    let greys: Vec<u8> = (0..=u8::MAX).flat_map(|grey| [grey; 3]).collect();
    let mut encoder = Encoder::new(to, width, height, &greys)?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before = None::<Arc<RgbImage>>;
    // Start of a picture, hundredths of a second. Durations are rounded so that they add up.
    let start = |number| reel.rate.start_ns(number).div_ceil(10_000_000);
    for (number, picture) in (0..).zip(pictures) {
        let area = Area::changed(before.as_deref(), &picture);
        let [columns, rows] = area.size.map(|n| n as u16);
        let pixels = area.pixels(&picture);
        let is_grey = pixels.chunks_exact(3).all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2]);
        let mut frame = if is_grey {
            let greys: Vec<u8> = pixels.chunks_exact(3).map(|pixel| pixel[0]).collect();
            Frame::from_indexed_pixels(columns, rows, greys, None)
        } else {
            Frame::from_rgb_speed(columns, rows, &pixels, SPEED)
        };
        [frame.left, frame.top] = area.at.map(|n| n as u16);
        frame.delay = (start(number + 1) - start(number)) as u16;
        frame.dispose = DisposalMethod::Keep;
        encoder.write_frame(&frame)?;
        before = Some(picture);
    }
    encoder.into_inner().map(drop)
}

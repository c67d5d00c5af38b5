//! The compositor of parts that share no memory: takes their messages, bytes, and composites the
//! picture from them.

use crate::RenderError;
use crate::camera::Camera;
use crate::classify::transfer::Transfer;
use crate::layers::{Channels, channels};
use crate::mode::Mode;
use crate::picture::Picture;
use crate::rays::composite::{Accumulated, Fold};
use crate::region::RenderRegion;
use crate::settings::RenderSettings;
use crate::work::RenderWork;

/// Composites the messages of the parts into the picture.
pub struct Compositor {
    size: [u32; 2],
    mode: Mode,
    transfer: Transfer,
    fold: Fold,
    image: Channels<Received<1>, Received<3>>,
}

/// Appends a block to a message.
pub(super) fn put<const C: usize>(bytes: &mut Vec<u8>, pixel: u32, number: u32, block: &Accumulated<C>) {
    bytes.extend(pixel.to_le_bytes());
    // Fewer than 2¹⁶ samples have fewer blocks.
    bytes.extend((number as u16).to_le_bytes());
    block.colour.iter().chain([&block.transmittance]).for_each(|x| bytes.extend(x.to_le_bytes()));
}

impl Compositor {
    /// Creates a picture without any message yet: all transparent.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings.
    pub fn new(settings: &RenderSettings, region: &RenderRegion) -> Result<Self, RenderError> {
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let fold = settings.fold(camera.samples())?;
        let (mode, transfer) = (settings.mode, settings.transfer.clone());
        let image = match mode.is_grey(&transfer) {
            true => Channels::Grey(Received::new(&camera, fold)),
            false => Channels::Colour(Received::new(&camera, fold)),
        };
        Ok(Self { size: settings.size, mode, transfer, fold, image })
    }

    /// Takes a part's message and composites the pixels concerned; returns their number.
    ///
    /// # Errors
    /// [`RenderError::Message`] for bytes that no part of this picture sends; the picture then
    /// stays unchanged.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<u64, RenderError> {
        channels!(&mut self.image, received => received.receive(bytes, self.fold))
    }

    /// Returns the current picture.
    pub fn picture(&self) -> Picture {
        let pixel = |colour, transmittance| self.mode.pixel(colour, transmittance, &self.transfer);
        let pixels = match &self.image {
            Channels::Grey(folded) => folded.pixels.iter().map(|p| pixel([p.colour[0]; 3], p.transmittance)).collect(),
            Channels::Colour(folded) => folded.pixels.iter().map(|p| pixel(p.colour, p.transmittance)).collect(),
        };
        Picture { size: self.size, pixels }
    }
}

/// The blocks of all rays, equally many a ray, nearest first; and the composited pixels.
struct Received<const C: usize> {
    each: usize,
    blocks: Vec<Accumulated<C>>,
    pixels: Vec<Accumulated<C>>,
}

impl<const C: usize> Received<C> {
    /// Bytes of a block.
    const BYTES: usize = 4 + 2 + 4 * (C + 1);

    fn new(camera: &Camera, fold: Fold) -> Self {
        let [width, height] = camera.size().map(|s| s as usize);
        let each = camera.samples().div_ceil(fold.arity) as usize;
        Self {
            each,
            blocks: vec![Accumulated::CLEAR; width * height * each],
            pixels: vec![Accumulated::CLEAR; width * height],
        }
    }

    fn receive(&mut self, bytes: &[u8], fold: Fold) -> Result<u64, RenderError> {
        let mut received = Vec::with_capacity(bytes.len() / Self::BYTES);
        for chunk in bytes.chunks(Self::BYTES) {
            let block =
                Self::read(chunk).filter(|(pixel, number, _)| *pixel < self.pixels.len() && *number < self.each);
            received.push(block.ok_or(RenderError::Message { bytes: bytes.len() })?);
        }
        let mut folded = 0;
        let mut last = None;
        for (pixel, number, block) in &received {
            self.blocks[pixel * self.each + number] = *block;
        }
        for (pixel, ..) in received {
            // A pixel's blocks are consecutive.
            if last.replace(pixel) == Some(pixel) {
                continue;
            }
            let mut all = Accumulated::CLEAR;
            let mut work = RenderWork::default();
            for block in &self.blocks[pixel * self.each..][..self.each] {
                if all.ends_behind(block, fold, &mut work) {
                    break;
                }
            }
            self.pixels[pixel] = all;
            folded += 1;
        }
        Ok(folded)
    }

    /// Returns the pixel, the number of the block, and the block.
    fn read(bytes: &[u8]) -> Option<(usize, usize, Accumulated<C>)> {
        let (pixel, rest) = bytes.split_first_chunk::<4>()?;
        let (number, rest) = rest.split_first_chunk::<2>()?;
        let mut values = rest.chunks(4).map(|x| x.try_into().ok().map(f32::from_le_bytes));
        let mut block = Accumulated::CLEAR;
        for colour in &mut block.colour {
            *colour = values.next()??;
        }
        block.transmittance = values.next()??;
        Some((u32::from_le_bytes(*pixel) as usize, usize::from(u16::from_le_bytes(*number)), block))
    }
}

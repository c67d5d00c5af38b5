//! The compositor of parts that share no memory: takes their messages, bytes, and composites the
//! picture from them.

use std::ops::Range;

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

/// Composites the messages of the parts into the picture, or into some rows of it.
pub struct Compositor {
    /// Pixels to the right, and rows.
    size: [u32; 2],
    camera: Camera,
    mode: Mode,
    transfer: Transfer,
    fold: Fold,
    image: Channels<Received<1>, Received<3>>,
}

/// Returns the bytes of a block of C channels in a message.
pub(super) const fn block_bytes(channels: usize) -> usize {
    4 + 2 + 4 * (channels + 1)
}

/// Returns the number of the pixel of a message's block, row by row; `None` for too few bytes.
pub fn pixel_of(block: &[u8]) -> Option<u32> {
    block.first_chunk().map(|pixel| u32::from_le_bytes(*pixel))
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
        Self::of_rows(settings, region, 0..settings.size[1])
    }

    /// Creates some rows of a picture, for the messages of parts of the same rows.
    ///
    /// # Errors
    /// [`RenderError`] for invalid settings, [`RenderError::Rows`] for no rows of the picture.
    pub fn of_rows(settings: &RenderSettings, region: &RenderRegion, rows: Range<u32>) -> Result<Self, RenderError> {
        let camera = Camera::new(&settings.view, settings.size, settings.step, region)?;
        let fold = settings.fold(camera.samples())?;
        check_rows(&rows, settings)?;
        let (mode, transfer) = (settings.mode, settings.transfer.clone());
        let image = match mode.is_grey(&transfer) {
            true => Channels::Grey(Received::new(&camera, fold, &rows)),
            false => Channels::Colour(Received::new(&camera, fold, &rows)),
        };
        Ok(Self { size: [settings.size[0], rows.end - rows.start], camera, mode, transfer, fold, image })
    }

    /// Returns the camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the samples of a block.
    pub fn arity(&self) -> u32 {
        self.fold.arity
    }

    /// Returns the bytes of a block in messages.
    pub fn block_bytes(&self) -> usize {
        match &self.image {
            Channels::Grey(_) => block_bytes(1),
            Channels::Colour(_) => block_bytes(3),
        }
    }

    /// Returns the memory in use, bytes.
    pub fn bytes(&self) -> u64 {
        channels!(&self.image, received => received.bytes())
    }

    /// Takes a part's message and composites the pixels concerned; returns their number.
    ///
    /// # Errors
    /// [`RenderError::Message`] for bytes that no part of this picture sends; the picture then
    /// stays unchanged.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<u64, RenderError> {
        channels!(&mut self.image, received => received.receive(bytes, self.fold))
    }

    /// Returns the current picture, or its rows.
    pub fn picture(&self) -> Picture {
        let pixel = |colour, transmittance| self.mode.pixel(colour, transmittance, &self.transfer);
        let pixels = match &self.image {
            Channels::Grey(folded) => folded.pixels.iter().map(|p| pixel([p.colour[0]; 3], p.transmittance)).collect(),
            Channels::Colour(folded) => folded.pixels.iter().map(|p| pixel(p.colour, p.transmittance)).collect(),
        };
        Picture { size: self.size, pixels }
    }
}

/// Refuses rows that a picture does not have.
pub(super) fn check_rows(rows: &Range<u32>, settings: &RenderSettings) -> Result<(), RenderError> {
    match rows.start < rows.end && rows.end <= settings.size[1] {
        true => Ok(()),
        false => Err(RenderError::Rows { first: rows.start, end: rows.end, height: settings.size[1] }),
    }
}

/// Returns the bytes of a compositor for each row of a picture: its blocks and its pixels.
pub(super) fn row_bytes<const C: usize>(camera: &Camera, fold: Fold) -> u64 {
    let each = u64::from(camera.samples().div_ceil(fold.arity));
    u64::from(camera.size()[0]) * (each + 1) * size_of::<Accumulated<C>>() as u64
}

/// The blocks of all rays, equally many a ray, nearest first; and the composited pixels.
struct Received<const C: usize> {
    /// Number of the first pixel in the picture.
    first: usize,
    each: usize,
    blocks: Vec<Accumulated<C>>,
    pixels: Vec<Accumulated<C>>,
}

impl<const C: usize> Received<C> {
    /// Bytes of a block.
    const BYTES: usize = block_bytes(C);

    fn new(camera: &Camera, fold: Fold, rows: &Range<u32>) -> Self {
        let width = camera.size()[0] as usize;
        let each = camera.samples().div_ceil(fold.arity) as usize;
        let pixels = width * rows.len();
        Self {
            first: width * rows.start as usize,
            each,
            blocks: vec![Accumulated::CLEAR; pixels * each],
            pixels: vec![Accumulated::CLEAR; pixels],
        }
    }

    fn bytes(&self) -> u64 {
        (size_of_val(&*self.blocks) + size_of_val(&*self.pixels)) as u64
    }

    fn receive(&mut self, bytes: &[u8], fold: Fold) -> Result<u64, RenderError> {
        let blocks = || bytes.chunks(Self::BYTES).map(|block| self.read(block));
        if blocks().any(|block| block.is_none()) {
            return Err(RenderError::Message { bytes: bytes.len() });
        }
        for block in bytes.chunks(Self::BYTES) {
            if let Some((pixel, number, block)) = self.read(block) {
                self.blocks[pixel * self.each + number] = block;
            }
        }
        let mut folded = 0;
        let mut last = None;
        for block in bytes.chunks(Self::BYTES) {
            // A pixel's blocks are consecutive.
            let Some((pixel, ..)) = self.read(block).filter(|(pixel, ..)| last.replace(*pixel) != Some(*pixel)) else {
                continue;
            };
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

    /// Returns the pixel, from the first of the rows on, the number of the block, and the block.
    fn read(&self, bytes: &[u8]) -> Option<(usize, usize, Accumulated<C>)> {
        let (pixel, rest) = bytes.split_first_chunk::<4>()?;
        let (number, rest) = rest.split_first_chunk::<2>()?;
        let mut values = rest.chunks(4).map(|x| x.try_into().ok().map(f32::from_le_bytes));
        let mut block = Accumulated::CLEAR;
        for colour in &mut block.colour {
            *colour = values.next()??;
        }
        block.transmittance = values.next()??;
        let pixel = (u32::from_le_bytes(*pixel) as usize).checked_sub(self.first)?;
        let number = usize::from(u16::from_le_bytes(*number));
        (pixel < self.pixels.len() && number < self.each).then_some((pixel, number, block))
    }
}

//! Pixels outside the scanner's picture, which hold names and dates on most scanners' screens.

use std::cell::Cell;
use std::path::Path;

use mask::{AutoMask, Clip, Mask, MaskFound, MaskShape};
use sonoweave_core::{Device, Next};
use sync::ingest::{Ingest, Sample};

use super::ConvertError;
use super::arrange::Arrangement;

/// Stored pixels that become black.
#[derive(Debug)]
pub struct Blackening {
    /// Indices of the stored pixels outside the picture.
    outside: Vec<u32>,
    /// Values that were not black, in all frames so far.
    changed: Cell<u64>,
}

impl Blackening {
    /// Returns the pixels outside a mask, of frames that are stored with this size and orientation.
    ///
    /// # Errors
    /// A sentence: an unknown orientation.
    pub fn new(mask: &Mask, size: [u32; 2], orientation: &str) -> Result<Self, String> {
        let mf = Arrangement::new(size, orientation, None, Some("MF"))?;
        let number = mf.size[0] * mf.size[1];
        let place = |n: u32| mf.stored(n);
        let outside = (0..number).filter(|n| !mask.contains(n % mf.size[0], n / mf.size[0])).map(place).collect();
        Ok(Self { outside, changed: Cell::new(0) })
    }

    /// Makes the pixels of a frame black, with `bytes` bytes a pixel.
    pub fn apply(&self, pixels: &mut [u8], bytes: usize) {
        let mut changed = 0;
        for at in &self.outside {
            let pixel = &mut pixels[*at as usize * bytes..][..bytes];
            changed += u64::from(pixel.iter().any(|byte| *byte != 0));
            pixel.fill(0);
        }
        self.changed.set(self.changed.get() + changed);
    }

    /// Returns the number of pixels of a frame that become black.
    pub fn in_a_frame(&self) -> u64 {
        self.outside.len() as u64
    }

    /// Returns the number of pixels that were not black.
    pub fn changed(&self) -> u64 {
        self.changed.get()
    }
}

/// Returns the mask of a recording's picture; the device was opened with images.
///
/// # Errors
/// [`ConvertError`] if the device cannot be read, the clip does not fit, or no picture is
/// recognised.
pub fn find(device: &mut dyn Device, path: &Path, size: [u32; 2], clip: Clip) -> Result<Mask, ConvertError> {
    let unfit = |why: String| ConvertError::Unfit { path: path.to_owned(), why };
    let [width, height] = size;
    match clip {
        Clip::None => return Ok(Mask::full(width, height)),
        Clip::Rect(rect) | Clip::RectOrAuto(rect) => {
            let inside = |from: u32, extent: u32, of: u32| from.checked_add(extent).is_some_and(|to| to <= of);
            if inside(rect.x, rect.width, width) && inside(rect.y, rect.height, height) {
                return Ok(Mask::rect(width, height, rect));
            }
            return Err(unfit(format!(
                "--clip {},{},{},{} is not within the frame of {width}×{height} pixels in MF orientation; give one that is",
                rect.x, rect.y, rect.width, rect.height
            )));
        }
        Clip::Auto => {}
    }
    let MaskFound { shape, recognised, reasons, .. } = search(device, AutoMask::new(width, height))?;
    // Only the shape counts: a mask of pixels that are not zero would keep the letters beside it.
    let mask = match shape {
        MaskShape::Rectangle(rect) if !rect.covers(width, height) => Some(Mask::rect(width, height, rect)),
        MaskShape::Fan(fan) => Some(Mask::fan(width, height, &fan)),
        _ => None,
    };
    mask.filter(|_| recognised).ok_or_else(|| {
        let why = reasons.first().map_or_else(String::new, |why| format!(" ({why})"));
        unfit(format!(
            "names beside the picture may remain, as its edge was not recognised{why}; give --clip X,Y,W,H around the \
            picture, or --clip none if no text lies beside it"
        ))
    })
}

fn search(device: &mut dyn Device, mut search: AutoMask) -> Result<MaskFound, ConvertError> {
    let mut ingest = Ingest::new();
    device.start()?;
    let found = loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(reading) => {
                if let Sample::Picture(picture) = ingest.take(reading)
                    && let Some(found) = search.push(&picture.image)
                {
                    break found;
                }
            }
            Next::Pending => {}
            Next::End => break search.finish(),
        }
    };
    device.stop()?;
    Ok(found)
}

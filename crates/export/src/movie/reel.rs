//! A movie's kind of file, rate and size.

use std::io;
use std::num::NonZeroU16;
use std::path::Path;

use crate::error::ExportError;

/// A movie's kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Animated PNG.
    Apng,
    /// GIF.
    Gif,
    /// Motion JPEG in AVI.
    Avi,
}

impl Format {
    /// Returns the kind that a file name asks for, if it is one of a movie.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "apng" => Some(Self::Apng),
            "gif" => Some(Self::Gif),
            "avi" => Some(Self::Avi),
            _ => None,
        }
    }

    /// Returns the highest rate, pictures a second. GIF counts hundredths of a second, and
    /// browsers slow down what is shown for a single one.
    fn most_hz(self) -> u16 {
        if self == Self::Gif { 50 } else { 60 }
    }
}

/// A rate of pictures, in thousandths of a picture a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate(NonZeroU16);

impl Rate {
    /// The lowest rate, pictures a second.
    const LEAST_HZ: f64 = 0.1;

    /// Returns a rate that a kind of file can have, rounded to a thousandth.
    ///
    /// # Errors
    /// [`ExportError::MovieRate`].
    pub fn new(hz: f64, format: Format) -> Result<Self, ExportError> {
        let most_hz = format.most_hz();
        if !(Self::LEAST_HZ..=f64::from(most_hz)).contains(&hz) {
            return Err(ExportError::MovieRate { hz, least_hz: Self::LEAST_HZ, most_hz });
        }
        Ok(Self(NonZeroU16::new((hz * 1e3).round() as u16).unwrap_or(NonZeroU16::MIN)))
    }

    /// Returns the rate, pictures a second.
    pub fn hz(self) -> f64 {
        f64::from(self.0.get()) / 1e3
    }

    /// Returns the rate, pictures in 1000 s.
    pub fn millihertz(self) -> NonZeroU16 {
        self.0
    }

    /// Returns the time at which a picture is first shown, ns after the movie's start.
    pub fn start_ns(self, picture: u64) -> u64 {
        (u128::from(picture) * 1_000_000_000_000 / u128::from(self.0.get())) as u64
    }
}

/// A movie's size and rate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reel {
    pub(super) size: [u32; 2],
    pub(super) rate: Rate,
}

impl Reel {
    /// Returns width and height for a kind of file that has 16 bits for each.
    pub(super) fn size_of_16_bits(self) -> io::Result<[u16; 2]> {
        let [width, height] = self.size.map(|n| u16::try_from(n).ok());
        let too_large =
            || io::Error::other("its pictures have more than 65535 pixels along an edge; make them smaller");
        Ok([width.ok_or_else(too_large)?, height.ok_or_else(too_large)?])
    }
}

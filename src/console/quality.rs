//! How good a page's pictures are: as they were made while its line carries them, and packed, then halved, while it does not.
//!
//! What decides is how long a page takes to answer a picture ([`Grade`]), of each kind for itself. What is packed is packed once for all pages that want it ([`Shelf`]), and
//! only for them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use jpeg_encoder::{ColorType, Encoder};
use tokio::time::Instant;

use super::counts::Counts;
use super::screen::{Pixmap, Shot};

/// An answer that takes longer comes over a slow line, or from a slow page.
const SLOW: Duration = Duration::from_millis(150);
/// One that takes less leaves room for more.
const FAST: Duration = Duration::from_millis(75);
/// So many slow ones in a row are no accident.
const ENOUGH: u32 = 3;
/// So many fast ones more than others are worth a try; twice as many after each try that failed.
const PATIENCE: u32 = 30;
const MOST_PATIENCE: u32 = 960;
/// So many fast ones make up for one that is slow, and for one that is neither.
const LATE: u32 = 10;
const MIDDLING: u32 = 2;
/// Packed pictures that are kept for other pages.
const KEPT: usize = 12;

/// How good a picture is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quality {
    /// As it was made.
    Whole,
    /// As a JPEG.
    Packed,
    /// As a JPEG of half as many pixels a side.
    Halved,
}

/// What a page gets of a kind, by how long it has taken to answer.
#[derive(Debug)]
pub(super) struct Grade {
    quality: Quality,
    slow: u32,
    fast: u32,
    patience: u32,
    /// Whether more was tried since it last became less.
    tried: bool,
    /// Whether the last answer came fast.
    is_fast: bool,
    /// Pictures on their way, and since when.
    sent: VecDeque<(u32, Instant)>,
}

impl Default for Grade {
    fn default() -> Self {
        let (quality, patience, sent) = (Quality::Whole, PATIENCE, VecDeque::new());
        Self { quality, slow: 0, fast: 0, patience, tried: false, is_fast: false, sent }
    }
}

impl Grade {
    pub(super) fn quality(&self) -> Quality {
        self.quality
    }

    /// As what a picture that was sent so may be sent once more, as nothing newer comes; `None` where it could be no better, or the page was slow to answer it.
    pub(super) fn better(&self, sent: Quality) -> Option<Quality> {
        match sent {
            Quality::Packed if self.is_fast => Some(Quality::Whole),
            Quality::Halved if self.is_fast => Some(Quality::Packed),
            _ => None,
        }
    }

    /// A picture goes to the page.
    pub(super) fn sent(&mut self, sequence: u32, now: Instant) {
        self.sent.push_back((sequence, now));
    }

    /// The page has answered it. What was sent before it and has no answer was left out.
    pub(super) fn answered(&mut self, sequence: u32, now: Instant) {
        let Some(at) = self.sent.iter().position(|(sent, _)| *sent == sequence) else { return };
        let since = self.sent[at].1;
        self.sent.drain(..=at);
        self.took(now.saturating_duration_since(since));
    }

    /// No answer has come for so long that none is waited for.
    pub(super) fn forgiven(&mut self) {
        (0..self.sent.len()).for_each(|_| self.took(Duration::MAX));
        self.sent.clear();
    }

    fn took(&mut self, time: Duration) {
        self.is_fast = time < FAST;
        self.slow = if time > SLOW { self.slow + 1 } else { 0 };
        // One that is late now and then does not undo what many have shown.
        self.fast = if time < FAST {
            self.fast + 1
        } else {
            self.fast.saturating_sub(if time > SLOW { LATE } else { MIDDLING })
        };
        if self.slow >= ENOUGH && self.quality != Quality::Halved {
            self.quality = if self.quality == Quality::Whole { Quality::Packed } else { Quality::Halved };
            if std::mem::take(&mut self.tried) {
                self.patience = (self.patience * 2).min(MOST_PATIENCE);
            }
            (self.slow, self.fast) = (0, 0);
        } else if self.fast >= self.patience {
            self.fast = 0;
            match self.quality {
                // It has gone well for long.
                Quality::Whole => (self.patience, self.tried) = (PATIENCE, false),
                Quality::Packed => (self.quality, self.tried) = (Quality::Whole, true),
                Quality::Halved => (self.quality, self.tried) = (Quality::Packed, true),
            }
        }
    }
}

/// A picture, packed.
#[derive(Debug)]
struct Kept {
    of: (u8, u32, Quality),
    bytes: Arc<[u8]>,
}

/// The newest pictures that were packed.
#[derive(Debug, Default)]
pub(super) struct Shelf(Mutex<VecDeque<Kept>>);

impl Shelf {
    /// A picture's JPEG; `None` where it goes as it is.
    pub(super) fn packed(&self, shot: &Shot, quality: Quality, counts: &Counts) -> Option<Arc<[u8]>> {
        if quality == Quality::Whole {
            return None;
        }
        let of = (shot.kind as u8, shot.sequence, quality);
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = kept.iter().find(|kept| kept.of == of) {
            return Some(Arc::clone(&kept.bytes));
        }
        let bytes: Arc<[u8]> = jpeg(shot, quality)?.into();
        Counts::add(&counts.pictures_packed);
        if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(Kept { of, bytes: Arc::clone(&bytes) });
        Some(bytes)
    }
}

/// Nothing for what is larger than a JPEG can be.
fn jpeg(shot: &Shot, quality: Quality) -> Option<Vec<u8>> {
    let (pixels, colour, channels) = match &shot.pixels {
        Pixmap::Grey(pixels) => (pixels, ColorType::Luma, 1),
        Pixmap::Colour(pixels) => (pixels, ColorType::Rgb, 3),
    };
    let mut bytes = Vec::new();
    let encode = |bytes: &mut Vec<u8>, pixels: &[u8], [width, height]: [u32; 2], percent| {
        let [width, height] = [u16::try_from(width).ok()?, u16::try_from(height).ok()?];
        Encoder::new(bytes, percent).encode(pixels, width, height, colour).ok()
    };
    match quality {
        Quality::Whole => return None,
        Quality::Packed => encode(&mut bytes, pixels, shot.size, 80)?,
        Quality::Halved => {
            let (pixels, size) = halved(pixels, shot.size, channels);
            encode(&mut bytes, &pixels, size, 60)?;
        }
    }
    Some(bytes)
}

/// Four pixels become one, their mean. A last row or column without another is left out, unless it is the only one.
fn halved(pixels: &[u8], [width, height]: [u32; 2], channels: usize) -> (Vec<u8>, [u32; 2]) {
    let size = [width, height].map(|side| (side / 2).max(1));
    let row = width as usize * channels;
    let [right, down] = [(width > 1, channels), (height > 1, row)].map(|(there, step)| if there { step } else { 0 });
    let mut half = Vec::with_capacity(size[0] as usize * size[1] as usize * channels);
    for y in 0..size[1] as usize {
        for x in 0..size[0] as usize {
            for channel in 0..channels {
                let at = 2 * y * row + 2 * x * channels + channel;
                let sum: u16 = [0, right, down, right + down].iter().map(|step| u16::from(pixels[at + step])).sum();
                half.push(((sum + 2) / 4) as u8);
            }
        }
    }
    (half, size)
}

#[cfg(test)]
mod tests {
    use zune_jpeg::JpegDecoder;
    use zune_jpeg::zune_core::bytestream::ZCursor;
    use zune_jpeg::zune_core::colorspace::ColorSpace;
    use zune_jpeg::zune_core::options::DecoderOptions;

    use super::super::screen::Kind;
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    #[test]
    fn a_line_that_is_slow_for_long_gets_less_and_one_that_is_fast_for_long_more() {
        let mut grade = Grade::default();
        let mut taking = |count: u32, ms| {
            (0..count).for_each(|_| grade.took(MS(ms)));
            grade.quality()
        };
        // One that is late now and then, and one that is neither fast nor slow, stay what they are.
        for _ in 0..50 {
            assert_eq!([taking(2, 200), taking(1, 100)], [Quality::Whole; 2]);
        }
        assert_eq!([taking(2, 151), taking(1, 151)], [Quality::Whole, Quality::Packed]);
        assert_eq!([taking(100, 150), taking(100, 75)], [Quality::Packed; 2], "in between");
        assert_eq!([taking(29, 20), taking(1, 20)], [Quality::Packed, Quality::Whole]);
        assert_eq!(
            [taking(3, 900), taking(3, 900), taking(99, 900)],
            [Quality::Packed, Quality::Halved, Quality::Halved]
        );
        // Twice as many: it was not as good as it had seemed.
        assert_eq!([taking(59, 20), taking(1, 20)], [Quality::Halved, Quality::Packed]);
        // One in twenty is late, and one in ten is neither.
        for _ in 0..60 {
            assert_ne!([taking(17, 20), taking(2, 100), taking(1, 160)], [Quality::Halved; 3]);
        }
        assert_eq!(taking(0, 0), Quality::Whole);
        // After a long time it counts as at the beginning.
        taking(120, 20);
        assert_eq!([taking(3, 200), taking(29, 20), taking(1, 20)], [Quality::Packed, Quality::Packed, Quality::Whole]);
        for _ in 0..20 {
            (0..3).for_each(|_| grade.took(MS(500)));
            (grade.quality, grade.tried) = (Quality::Whole, true);
        }
        assert_eq!(grade.patience, MOST_PATIENCE);
    }

    #[test]
    fn answers_belong_to_their_pictures_and_what_is_never_answered_was_slow() {
        let begun = Instant::now();
        let mut grade = Grade::default();
        for n in 0..10 {
            grade.sent(2 * n, begun);
            grade.sent(2 * n + 1, begun + MS(100));
            grade.answered(99, begun + MS(999));
            // The first of them was left out.
            grade.answered(2 * n + 1, begun + MS(200));
            grade.answered(2 * n, begun + MS(999));
        }
        assert_eq!((grade.quality(), grade.sent.len()), (Quality::Whole, 0));
        for n in 0..2 {
            grade.sent(100 + n, begun);
            grade.sent(200 + n, begun);
            grade.forgiven();
        }
        assert_eq!((grade.quality(), grade.sent.len()), (Quality::Packed, 0));
    }

    fn shot(sequence: u32, pixels: Pixmap, size: [u32; 2]) -> Shot {
        Shot { kind: Kind::View, sequence, size, pixels, item: 0, captured_ms: None, refining: false, words: None }
    }

    #[test]
    fn a_picture_is_packed_once_and_shows_the_same() {
        let (shelf, counts) = (Shelf::default(), Counts::default());
        let size = [64, 48];
        let ramp = |channels: usize| -> Arc<[u8]> {
            (0..64 * 48 * channels).map(|n| (n / channels % 64 * 3 + n / channels / 64) as u8).collect()
        };
        for (pixels, channels) in [(Pixmap::Grey(ramp(1)), 1), (Pixmap::Colour(ramp(3)), 3)] {
            let shot = shot(channels as u32, pixels, size);
            assert!(shelf.packed(&shot, Quality::Whole, &counts).is_none());
            for (quality, [width, height], step) in [(Quality::Packed, [64, 48], 1), (Quality::Halved, [32, 24], 2)] {
                let bytes = shelf.packed(&shot, quality, &counts).unwrap();
                assert!(bytes.len() < 64 * 48 * channels / 2, "{}", bytes.len());
                assert!(
                    Arc::ptr_eq(&bytes, &shelf.packed(&shot, quality, &counts).unwrap()),
                    "another page's is the same"
                );
                let space = if channels == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
                let options = DecoderOptions::default().jpeg_set_out_colorspace(space);
                let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&bytes[..]), options);
                let seen = decoder.decode().unwrap();
                assert_eq!((decoder.dimensions(), seen.len()), (Some((width, height)), width * height * channels));
                let of = ramp(channels);
                let off = |n: usize| {
                    let (at, channel) = (n / channels, n % channels);
                    let there = of[(at / width * step * 64 + at % width * step) * channels + channel];
                    f64::from(seen[n].abs_diff(there))
                };
                let mean = (0..seen.len()).map(off).sum::<f64>() / seen.len() as f64;
                assert!(mean < 3.0, "{quality:?}: {mean}");
            }
        }
        assert_eq!(Counts::of(&counts.pictures_packed), 4);
        // Memory is bounded, and what no JPEG can be goes as it is.
        for n in 10..90 {
            shelf.packed(&shot(n, Pixmap::Grey(ramp(1)), size), Quality::Packed, &counts);
        }
        assert_eq!(shelf.0.lock().unwrap().len(), KEPT);
        let wide = shot(1, Pixmap::Grey(vec![0; 70_000].into()), [70_000, 1]);
        assert!(shelf.packed(&wide, Quality::Packed, &counts).is_none());
        let (one, size) = halved(&[10, 20, 30, 40, 50, 60], [3, 2], 1);
        assert_eq!((one, size), (vec![30], [1, 1]));
        assert_eq!(halved(&[7, 9], [1, 2], 1), (vec![8], [1, 1]));
    }
}

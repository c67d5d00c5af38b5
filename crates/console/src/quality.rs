//! Picture quality per page: lossless while the connection keeps up, else JPEG, then JPEG at
//! half size.
//!
//! The quality depends on the transmission time of a picture and its answer ([`Grade`]),
//! separately for each kind. The page reports how long it had the picture itself: decoding a
//! JPEG does not help a page that draws slowly. A JPEG is encoded once for all pages that need
//! it ([`EncodeCache`]). A fixed quality would take lossless pictures from fast connections, and
//! half size from slow ones.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use jpeg_encoder::{ColorType, Encoder};
use tokio::time::Instant;

use super::counts::Counts;
use super::encoded_frame::{EncodedFrame, Pixmap};

/// An answer with a longer transmission time is slow.
const SLOW: Duration = Duration::from_millis(150);
/// An answer with a shorter transmission time is fast.
const FAST: Duration = Duration::from_millis(75);
/// Slow answers in a row, spread over LONG, before quality drops. A stalled machine delays
/// everything on its way only once.
const ENOUGH: u32 = 3;
const LONG: Duration = Duration::from_secs(1);
/// Surplus of fast answers before a higher quality is tried; doubled after each failed trial.
const PATIENCE: u32 = 30;
const MOST_PATIENCE: u32 = 960;
/// Fast answers that make up for a slow one, and for one that is neither slow nor fast.
const LATE: u32 = 10;
const MIDDLING: u32 = 2;
/// Wait before a picture sent at reduced quality is sent again at a higher one, if no newer one
/// follows.
const STILL: Duration = Duration::from_secs(1);
/// A higher quality takes up to this many times as long. No newer picture has come for as long,
/// so most likely none has to wait for it.
const MORE: u32 = 16;
/// Over a slow connection the picture is sent again unchanged after this time, to measure the
/// connection. The time doubles after each slow answer.
const REPEAT_AFTER: Duration = Duration::from_secs(4);
const MOST_REPEATS: u32 = 4;
/// Encoded pictures kept for other pages.
const KEPT: usize = 12;

/// Quality of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quality {
    /// Lossless.
    Whole,
    /// JPEG.
    Packed,
    /// JPEG with half as many pixels a side.
    Halved,
}

/// Chooses a page's quality for one kind of picture from its answer times.
#[derive(Debug)]
pub(super) struct Grade {
    quality: Quality,
    /// Slow answers in a row, and the time of the first of them.
    slow: u32,
    slow_since: Instant,
    fast: u32,
    patience: u32,
    /// Whether a higher quality was tried since the last reduction.
    tried: bool,
    /// Transmission time of the last answer.
    last: Duration,
    /// Slow answers to repeated sendings of the last picture.
    repeats: u32,
    /// Pictures not yet answered.
    sent: VecDeque<Sent>,
}

/// A picture not yet answered.
#[derive(Debug)]
struct Sent {
    sequence: u32,
    since: Instant,
    /// Whether the picture was sent again. Its time describes the connection, not the time new
    /// ones take.
    again: bool,
}

impl Default for Grade {
    fn default() -> Self {
        Self {
            quality: Quality::Whole,
            slow: 0,
            slow_since: Instant::now(),
            fast: 0,
            patience: PATIENCE,
            tried: false,
            last: Duration::ZERO,
            repeats: 0,
            sent: VecDeque::new(),
        }
    }
}

impl Grade {
    pub(super) fn quality(&self) -> Quality {
        self.quality
    }

    /// Returns the quality and the wait for sending an answered picture again, if nothing newer
    /// comes; `None` if it was lossless.
    pub(super) fn again(&self, sent: Quality) -> Option<(Quality, Duration)> {
        let better = match sent {
            Quality::Whole => return None,
            Quality::Packed => Quality::Whole,
            Quality::Halved => Quality::Packed,
        };
        Some(if self.last <= SLOW {
            (better, STILL.max(self.last * MORE))
        } else {
            (sent, REPEAT_AFTER * (1 << self.repeats.min(MOST_REPEATS)))
        })
    }

    /// Records that a picture is sent to the page, for the first time or again.
    pub(super) fn sent(&mut self, sequence: u32, since: Instant, again: bool) {
        if !again {
            self.repeats = 0;
        }
        self.sent.push_back(Sent { sequence, since, again });
    }

    /// Records the page's answer, and the time for which the page had the picture. Unanswered
    /// pictures sent before it were left out.
    pub(super) fn answered(&mut self, sequence: u32, now: Instant, had: Duration) {
        let Some(at) = self.sent.iter().position(|sent| sent.sequence == sequence) else { return };
        let Sent { since, again, .. } = self.sent[at];
        self.sent.drain(..=at);
        self.took(now.saturating_duration_since(since).saturating_sub(had), now, again);
    }

    /// Gives up waiting for answers, after a long silence.
    pub(super) fn forgiven(&mut self, now: Instant) {
        for sent in std::mem::take(&mut self.sent) {
            self.took(Duration::MAX, now, sent.again);
        }
    }

    fn took(&mut self, time: Duration, now: Instant, again: bool) {
        self.last = time;
        if again {
            self.repeats = self.repeats.saturating_add(u32::from(time > SLOW));
            return;
        }
        if time <= SLOW {
            self.slow = 0;
        } else {
            if self.slow == 0 {
                self.slow_since = now;
            }
            self.slow += 1;
        }
        // An occasional late answer does not cancel the evidence of many fast ones.
        self.fast = if time < FAST {
            self.fast + 1
        } else {
            self.fast.saturating_sub(if time > SLOW { LATE } else { MIDDLING })
        };
        let is_slow = self.slow >= ENOUGH && now.saturating_duration_since(self.slow_since) >= LONG;
        if is_slow && self.quality != Quality::Halved {
            self.quality = if self.quality == Quality::Whole { Quality::Packed } else { Quality::Halved };
            if std::mem::take(&mut self.tried) {
                self.patience = (self.patience * 2).min(MOST_PATIENCE);
            }
            (self.slow, self.fast) = (0, 0);
        } else if self.fast >= self.patience {
            self.fast = 0;
            match self.quality {
                // The connection has been fast for long.
                Quality::Whole => (self.patience, self.tried) = (PATIENCE, false),
                Quality::Packed => (self.quality, self.tried) = (Quality::Whole, true),
                Quality::Halved => (self.quality, self.tried) = (Quality::Packed, true),
            }
        }
    }
}

/// An encoded picture.
#[derive(Debug)]
struct Kept {
    of: (u8, u32, Quality),
    bytes: Arc<[u8]>,
}

/// Cache of the newest encoded pictures.
#[derive(Debug, Default)]
pub(super) struct EncodeCache(Mutex<VecDeque<Kept>>);

impl EncodeCache {
    /// Returns a picture's JPEG; `None` if it is sent lossless.
    pub(super) fn packed(&self, shot: &EncodedFrame, quality: Quality, counts: &Counts) -> Option<Arc<[u8]>> {
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

/// Encodes a picture; `None` if it is too large for a JPEG.
fn jpeg(shot: &EncodedFrame, quality: Quality) -> Option<Vec<u8>> {
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

/// Averages blocks of four pixels. An odd last row or column is dropped, unless it is the only
/// one.
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

    use super::super::encoded_frame::Kind;
    use super::*;

    const MS: fn(u64) -> Duration = Duration::from_millis;

    #[test]
    fn sustained_speed_changes_quality() {
        let (mut grade, mut now) = (Grade::default(), Instant::now());
        let mut taking = |count: u32, ms| {
            for _ in 0..count {
                now += MS(ms);
                grade.took(MS(ms), now, false);
            }
            grade.quality()
        };
        // Occasional late answers, and answers neither fast nor slow, do not change the
        // quality.
        for _ in 0..50 {
            assert_eq!([taking(2, 200), taking(1, 100)], [Quality::Whole; 2]);
        }
        // A stall: three answers were on their way, and are late at once.
        assert_eq!([taking(1, 900), taking(2, 160), taking(5, 20)], [Quality::Whole; 3]);
        // Slow answers, spread over more than a second.
        assert_eq!([taking(7, 160), taking(1, 160)], [Quality::Whole, Quality::Packed]);
        assert_eq!([taking(100, 150), taking(100, 75)], [Quality::Packed; 2], "in between");
        assert_eq!([taking(29, 20), taking(1, 20)], [Quality::Packed, Quality::Whole]);
        assert_eq!(
            [taking(3, 900), taking(3, 900), taking(99, 900)],
            [Quality::Packed, Quality::Halved, Quality::Halved]
        );
        // Twice as many are needed after the failed trial.
        assert_eq!([taking(59, 20), taking(1, 20)], [Quality::Halved, Quality::Packed]);
        // One in twenty is late, and one in ten is neither slow nor fast.
        for _ in 0..60 {
            assert_ne!([taking(17, 20), taking(2, 100), taking(1, 160)], [Quality::Halved; 3]);
        }
        assert_eq!(taking(0, 0), Quality::Whole);
        // After a long fast period the initial patience holds again.
        taking(120, 20);
        assert_eq!([taking(6, 200), taking(29, 20), taking(1, 20)], [Quality::Packed, Quality::Packed, Quality::Whole]);
        for _ in 0..20 {
            for _ in 0..3 {
                now += MS(500);
                grade.took(MS(500), now, false);
            }
            (grade.quality, grade.tried) = (Quality::Whole, true);
        }
        assert_eq!(grade.patience, MOST_PATIENCE);
    }

    #[test]
    fn answers_match_pictures_and_missing_answers_count_as_slow() {
        let begun = Instant::now();
        let mut grade = Grade::default();
        for n in 0..10 {
            grade.sent(2 * n, begun, false);
            grade.sent(2 * n + 1, begun + MS(100), false);
            grade.answered(99, begun + MS(999), Duration::ZERO);
            // The first of them was left out.
            grade.answered(2 * n + 1, begun + MS(200), Duration::ZERO);
            grade.answered(2 * n, begun + MS(999), Duration::ZERO);
        }
        assert_eq!((grade.quality(), grade.sent.len()), (Quality::Whole, 0));
        // Pictures that the page had for long do not make the connection slow. Nor do
        // exaggerated times.
        for n in 0..10 {
            grade.sent(50 + n, begun, false);
            grade.answered(50 + n, begun + MS(900), if n % 2 == 0 { MS(850) } else { Duration::MAX });
        }
        assert_eq!(grade.quality(), Quality::Whole);
        for n in 0..2 {
            grade.sent(100 + n, begun, false);
            grade.sent(200 + n, begun, false);
            grade.forgiven(begun + MS(2000 * u64::from(n)));
        }
        assert_eq!((grade.quality(), grade.sent.len()), (Quality::Packed, 0));
    }

    #[test]
    fn static_picture_is_resent_better_and_slow_line_probed_rarely() {
        let begun = Instant::now();
        let mut grade = Grade::default();
        assert_eq!(grade.again(Quality::Whole), None);
        for (ms, wait) in [(0, 1000), (62, 1000), (100, 1600), (150, 2400)] {
            grade.took(MS(ms), begun, false);
            assert_eq!(grade.again(Quality::Packed), Some((Quality::Whole, MS(wait))));
            assert_eq!(grade.again(Quality::Halved), Some((Quality::Packed, MS(wait))));
        }
        // Answers to repeated pictures do not change the quality of new ones.
        grade.took(MS(151), begun, false);
        for wait in [4, 8, 16, 32, 64, 64, 64] {
            assert_eq!(grade.again(Quality::Packed), Some((Quality::Packed, MS(1000 * wait))));
            grade.sent(1, begun, true);
            assert_eq!(grade.again(Quality::Packed), Some((Quality::Packed, MS(1000 * wait))), "not answered yet");
            grade.answered(1, begun + MS(151), Duration::ZERO);
        }
        assert_eq!(grade.quality(), Quality::Whole);
        grade.forgiven(begun + MS(9000));
        assert_eq!((grade.quality(), grade.sent.len()), (Quality::Whole, 0));
        grade.sent(1, begun, true);
        grade.answered(1, begun + MS(20), MS(10));
        assert_eq!(grade.again(Quality::Packed), Some((Quality::Whole, MS(1000))), "it is slow no more");
        grade.sent(2, begun, false);
        grade.answered(2, begun + MS(200), MS(10));
        assert_eq!(
            grade.again(Quality::Packed),
            Some((Quality::Packed, MS(4000))),
            "another picture is asked about anew"
        );
    }

    fn shot(sequence: u32, pixels: Pixmap, size: [u32; 2]) -> EncodedFrame {
        EncodedFrame {
            kind: Kind::View,
            sequence,
            size,
            pixels,
            item: 0,
            captured_ms: None,
            refining: false,
            words: None,
        }
    }

    #[test]
    fn picture_is_encoded_once_and_decodes_alike() {
        let (jpeg_cache, counts) = (EncodeCache::default(), Counts::default());
        let size = [64, 48];
        let ramp = |channels: usize| -> Arc<[u8]> {
            (0..64 * 48 * channels).map(|n| (n / channels % 64 * 3 + n / channels / 64) as u8).collect()
        };
        for (pixels, channels) in [(Pixmap::Grey(ramp(1)), 1), (Pixmap::Colour(ramp(3)), 3)] {
            let shot = shot(channels as u32, pixels, size);
            assert!(jpeg_cache.packed(&shot, Quality::Whole, &counts).is_none());
            for (quality, [width, height], step) in [(Quality::Packed, [64, 48], 1), (Quality::Halved, [32, 24], 2)] {
                let bytes = jpeg_cache.packed(&shot, quality, &counts).unwrap();
                assert!(bytes.len() < 64 * 48 * channels / 2, "{}", bytes.len());
                assert!(
                    Arc::ptr_eq(&bytes, &jpeg_cache.packed(&shot, quality, &counts).unwrap()),
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
        // Memory is bounded, and a picture too large for a JPEG is sent lossless.
        for n in 10..90 {
            jpeg_cache.packed(&shot(n, Pixmap::Grey(ramp(1)), size), Quality::Packed, &counts);
        }
        assert_eq!(jpeg_cache.0.lock().unwrap().len(), KEPT);
        let wide = shot(1, Pixmap::Grey(vec![0; 70_000].into()), [70_000, 1]);
        assert!(jpeg_cache.packed(&wide, Quality::Packed, &counts).is_none());
        let (one, size) = halved(&[10, 20, 30, 40, 50, 60], [3, 2], 1);
        assert_eq!((one, size), (vec![30], [1, 1]));
        assert_eq!(halved(&[7, 9], [1, 2], 1), (vec![8], [1, 1]));
    }
}

//! Detects probe contact: whether echoes return from the depth of the image.
//!
//! Without gel between skin and probe, the air at the probe's face reflects the sound. The image
//! then has some bright bands right below the face, at the same depth over its whole width.
//! Beyond them is only the receiver's noise, which amplification can make bright. With contact
//! there are echoes beyond. One of two criteria distinguishes them from noise, at any gain:
//!
//! - *Outliers at their depth.* Along a row of the far field the noise has one level and a
//!   Rayleigh distribution: the strongest of some thousand samples is 11 dB above the median. A
//!   boundary, a wire or a bone is more than that above. A sample more than [`OUT`] grey levels
//!   above its row's median (19 dB of a range of 60 dB, 13 dB of one of 40 dB) is an echo. At
//!   least [`LEAST_OUT`] such samples are required, so that a speck of interference does not
//!   count.
//! - *Bright depth.* Speckle of a uniform tissue has the same distribution as noise, but fills
//!   near field and depth alike. The near field's mean must be at least [`BRIGHT`], which a band
//!   at the face does not reach. The mean of the depth must be at least [`DARK`] and
//!   [`AS_BRIGHT`] of it.
//!
//! The near field is the first quarter of the data's rows. No earlier images are used, because
//! contact may have been missing from the beginning. An empty water tank looks like air, and so
//! does tissue that absorbs everything; the advice describes the finding, and a remedy. If bands
//! fill the near field and the gain makes the noise a quarter as bright, a loss of contact is
//! not detected. Simulated images of a thigh, of speckle and of air are distinguished from 12 dB
//! too little gain to 12 dB too much.
//!
//! At most ten images a second are evaluated, each at most at [`ROWS`] × [`COLUMNS`] pixels.

use serde::Serialize;

use mask::Mask;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::slice::{Image, Pixels};

/// Largest number of sampled rows of an image.
pub const ROWS: usize = 128;
/// Largest number of samples of a row.
pub const COLUMNS: usize = 160;
/// Grey levels above the row's median at which a sample counts as an outlier.
pub const OUT: u8 = 80;
/// Smallest number of outliers that count as an echo.
pub const LEAST_OUT: u32 = 4;
/// Smallest mean of the near field, grey levels.
pub const BRIGHT: f64 = 60.0;
/// Smallest mean of the depth, as a share of the near field's.
pub const AS_BRIGHT: f64 = 0.25;
/// Smallest mean of the depth, grey levels.
pub const DARK: f64 = 24.0;
/// Interval between evaluations, ns.
const EVERY_NS: i64 = 100 * MS;
/// Time without echoes after which lost contact is reported, ns; short interruptions are
/// ignored.
const LOST_NS: i64 = 700 * MS;
/// Age at which an image no longer counts, ns.
const STALE_NS: i64 = 2 * SECOND;

/// Contact state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Contact {
    /// No images arrive.
    Unknown,
    /// Echoes return from the depth.
    There,
    /// No echoes have returned for a while.
    Lost,
}

/// Evaluation of an image's depth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Depth {
    /// Mean grey level of the near field, and of the depth beyond.
    pub means: [f64; 2],
    /// Outliers of their rows in the depth.
    pub out: u32,
}

impl Depth {
    /// Evaluates an image and its data.
    pub fn of(image: &Image, mask: &Mask) -> Self {
        let Some(bounds) = mask.bounds() else { return Self::default() };
        let (rows, columns) = (bounds.height as usize, bounds.width as usize);
        let (down, along) = (rows.div_ceil(ROWS).max(1), columns.div_ceil(COLUMNS).max(1));
        let near_end = bounds.y + bounds.height / 4;
        let (mut sums, mut counts, mut out) = ([0.0; 2], [0_u32; 2], 0);
        for v in (bounds.y..bounds.y + bounds.height).step_by(down) {
            let mut levels = [0_u32; 256];
            let mut count = 0;
            for span in mask.row(v) {
                let first = span.start.next_multiple_of(along as u32);
                for u in (first..span.end).step_by(along) {
                    levels[usize::from(grey(image, u, v))] += 1;
                    count += 1;
                }
            }
            let is_far = usize::from(v >= near_end);
            sums[is_far] += levels.iter().enumerate().map(|(level, n)| level as f64 * f64::from(*n)).sum::<f64>();
            counts[is_far] += count;
            if is_far == 1 {
                let mut below = 0;
                let median = levels.iter().position(|n| {
                    below += n;
                    2 * below >= count
                });
                let first_out = median.unwrap_or(0) + usize::from(OUT) + 1;
                out += levels.get(first_out..).map_or(0, |above| above.iter().sum::<u32>());
            }
        }
        let mean = |which: usize| sums[which] / f64::from(counts[which].max(1));
        Self { means: [mean(0), mean(1)], out }
    }

    /// Returns whether echoes return from the depth.
    pub fn answers(&self) -> bool {
        let [near, far] = self.means;
        self.out >= LEAST_OUT || (near >= BRIGHT && far >= DARK && far >= AS_BRIGHT * near)
    }
}

fn grey(image: &Image, u: u32, v: u32) -> u8 {
    let at = v as usize * image.width() as usize + u as usize;
    match image.pixels() {
        Pixels::U8(grey) => grey[at],
        Pixels::U16(grey) => (grey[at] >> 8) as u8,
        // The cast saturates.
        Pixels::F32(grey) => grey[at] as u8,
    }
}

/// Contact history of recent images.
#[derive(Debug, Default)]
pub struct Coupling {
    inspected_ns: Option<i64>,
    answered_ns: Option<i64>,
    silent_since_ns: Option<i64>,
    pictures: u64,
}

impl Coupling {
    /// Returns whether an image of this time is to be evaluated.
    pub fn is_due(&self, captured_ns: i64) -> bool {
        self.inspected_ns.is_none_or(|inspected| !(0..EVERY_NS).contains(&(captured_ns - inspected)))
    }

    /// Evaluates an image.
    pub fn inspect(&mut self, image: &Image, mask: &Mask, captured_ns: i64) {
        self.pictures += 1;
        self.inspected_ns = Some(captured_ns);
        if Depth::of(image, mask).answers() {
            (self.answered_ns, self.silent_since_ns) = (Some(captured_ns), None);
        } else {
            self.silent_since_ns.get_or_insert(captured_ns);
        }
    }

    /// Returns the number of evaluated images.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Returns the contact state at a time, ns.
    pub fn contact(&self, now_ns: i64) -> Contact {
        match (self.inspected_ns, self.silent_since_ns) {
            (Some(inspected), _) if now_ns - inspected > STALE_NS => Contact::Unknown,
            (Some(inspected), Some(since)) if inspected - since >= LOST_NS => Contact::Lost,
            (Some(_), _) if self.answered_ns.is_some() => Contact::There,
            _ => Contact::Unknown,
        }
    }
}

//! Whether the probe has contact: whether anything comes back from the depth of the picture.
//!
//! Without gel between skin and probe sound is sent back by the air at its face: the picture has some bright bands right below the face, which lie at the same depth over its whole
//! width, and beyond them only the receiver's noise, that amplification may make bright. With contact there are echoes beyond. By one of these they are told from noise, whatever
//! the gain is:
//!
//! - *Something stands out of its depth.* Along a row of the far field the noise has one level and Rayleigh's law: of some thousand samples the strongest is 11 dB above the median. A
//!   wall, a wire or a bone is more than that above. What stands [`OUT`] grey levels above its row's median (19 dB of a range of 60 dB, 13 dB of one of 40 dB) is an echo; there
//!   must be [`LEAST_OUT`] samples of it, so that a speck of interference is none.
//! - *The depth is bright.* Speckle of a uniform tissue has the same law as noise, but it fills near field and depth alike: the near field's mean is at least [`BRIGHT`], which a band at
//!   the face does not make, and that of the depth at least [`DARK`] and [`AS_BRIGHT`] of it.
//!
//! The near field is the first quarter of the data's rows. Nothing of this compares with what was seen before: there may have been no contact from the beginning. A tank of water
//! with nothing in it looks like air, and so does tissue that swallows all; the advice says what is seen, and what to try. Where bands fill the near field and the gain makes the noise
//! a quarter as bright, a loss of contact is not noticed. Painted pictures of a thigh, of speckle and of air are told apart from 12 dB too little gain to 12 dB too much.
//!
//! At most ten pictures a second are looked at, and of each [`ROWS`] × [`COLUMNS`] pixels at most.

use drivers::clock::{MS, SECOND};
use serde::Serialize;

use crate::mask::Mask;
use crate::slice::{Image, Pixels};

/// Samples of a picture at most, along v and u.
pub const ROWS: usize = 128;
/// Samples of a row at most.
pub const COLUMNS: usize = 160;
/// Grey levels above the median of the row.
pub const OUT: u8 = 80;
/// So many samples must be that far above.
pub const LEAST_OUT: u32 = 4;
/// The near field's mean, grey levels,
pub const BRIGHT: f64 = 60.0;
/// that of the depth as part of it,
pub const AS_BRIGHT: f64 = 0.25;
/// and what that must be at least, grey levels.
pub const DARK: f64 = 24.0;
/// Between two looks, ns.
const EVERY_NS: i64 = 100 * MS;
/// For how long nothing must have come back before that is told, ns: an empty moment passes by.
const LOST_NS: i64 = 700 * MS;
/// Pictures that are older tell nothing.
const STALE_NS: i64 = 2 * SECOND;

/// Whether there is contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Contact {
    /// No pictures come.
    Unknown,
    /// Echoes come back from the depth.
    There,
    /// None have for a while.
    Lost,
}

/// What a picture shows of its depth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Depth {
    /// Mean grey level of the near field, and of what lies beyond.
    pub means: [f64; 2],
    /// Samples beyond it that stand out of their rows.
    pub out: u32,
}

impl Depth {
    /// Of a picture and its data.
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

    /// Whether anything comes back.
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
        // The cast clips.
        Pixels::F32(grey) => grey[at] as u8,
    }
}

/// What pictures have shown of late.
#[derive(Debug, Default)]
pub struct Coupling {
    looked_ns: Option<i64>,
    answered_ns: Option<i64>,
    silent_since_ns: Option<i64>,
    pictures: u64,
}

impl Coupling {
    /// Whether a picture of this time is to be looked at.
    pub fn is_due(&self, captured_ns: i64) -> bool {
        self.looked_ns.is_none_or(|looked| !(0..EVERY_NS).contains(&(captured_ns - looked)))
    }

    /// Looks at a picture.
    pub fn look(&mut self, image: &Image, mask: &Mask, captured_ns: i64) {
        self.pictures += 1;
        self.looked_ns = Some(captured_ns);
        if Depth::of(image, mask).answers() {
            (self.answered_ns, self.silent_since_ns) = (Some(captured_ns), None);
        } else {
            self.silent_since_ns.get_or_insert(captured_ns);
        }
    }

    /// Pictures that were looked at.
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Whether there is contact at a time, ns.
    pub fn contact(&self, now_ns: i64) -> Contact {
        match (self.looked_ns, self.silent_since_ns) {
            (Some(looked), _) if now_ns - looked > STALE_NS => Contact::Unknown,
            (Some(looked), Some(since)) if looked - since >= LOST_NS => Contact::Lost,
            (Some(_), _) if self.answered_ns.is_some() => Contact::There,
            _ => Contact::Unknown,
        }
    }
}

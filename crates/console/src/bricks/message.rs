//! Bricks as bytes: a message of the stream.
//!
//! Its header is that of pictures (`stream`), with kind 7. The number of bricks is in place of the
//! pixels to the right. In place of the pixels down is the number of bricks that the page never had
//! and still waits for. Each brick is then a record, little-endian:
//!
//! | at | type | content |
//! |---|---|---|
//! | 0, 2, 4 | i16 | lattice index of its first voxel along x, y, z, divided by 8 |
//! | 6 | u8 | 1 if nothing of it was seen: the record ends after the header |
//! | 7, 8 | u8 | high bytes of the smallest and the largest value of its seen voxels |
//! | 9 | u8 | 0 |
//! | 10 | u16×2 | value and weight of each of 8³ voxels, x fastest, high bytes first |
//!
//! A value is a share of the grey values from black to white, in 65280ths: its high byte is that of
//! a picture. Rounded to that byte alone, gradients of even tissue would vanish. A weight is 0 for
//! an unseen voxel, else it has 4096 steps a doubling: gradients are means by weight. Its
//! fractions of a doubling are linear, like those of a floating-point number.

use pipeline::session::BrickCopy;
use volume::brick::{BrickIndex, VOXELS};

/// The message's kind in the stream.
pub(crate) const KIND: u8 = 7;
/// Length of the stream's header.
const HEADER: usize = 40;
/// Length of a record's own header.
const RECORD: usize = 10;
/// Length of a brick's voxels.
pub(super) const BYTES: usize = 4 * VOXELS;
/// Values of white: 255 in the high byte.
const WHITE: f32 = 65_280.0;
/// Most bricks of a message: 128 KiB. Words of the session do not wait behind more.
pub(super) const MOST: usize = ((128 << 10) - HEADER) / (RECORD + BYTES);
/// Bits of an f32's fraction beyond those of a weight: twelve remain.
const ROUNDED: u32 = 11;
/// Weights begin above this, the bits of 2⁻⁹; the largest is 128. Smaller and larger ones, which
/// a voxel seldom has, count as those.
const LEAST: u32 = (127 - 9) << 12;

/// A message under construction.
pub(super) struct Message {
    bytes: Vec<u8>,
    count: u32,
}

impl Message {
    pub(super) fn new() -> Self {
        Self { bytes: vec![0; HEADER], count: 0 }
    }

    /// Adds a brick: grey values, of which `black` and `white` are displayed as such.
    pub(super) fn add(&mut self, brick: BrickIndex, copy: &BrickCopy, [black, white]: [f32; 2]) {
        self.count += 1;
        for index in brick {
            // `fits` holds.
            self.bytes.extend((index as i16).to_le_bytes());
        }
        let scale = WHITE / (white - black);
        let value = |grey: f32| ((grey - black) * scale).round().clamp(0.0, WHITE) as u16;
        let head = self.bytes.len();
        self.bytes.extend([1, 0, 0, 0]);
        let (mut least, mut most) = (u8::MAX, 0);
        let mut voxels = [0; BYTES];
        for ((voxel, grey), weight) in voxels.chunks_exact_mut(4).zip(&copy.value).zip(&copy.weight) {
            if *weight > 0.0 {
                let [high, low] = value(*grey).to_be_bytes();
                let [heavy, light] = weight_code(*weight).to_be_bytes();
                voxel.copy_from_slice(&[high, low, heavy, light]);
                (least, most) = (least.min(high), most.max(high));
            }
        }
        if least <= most {
            self.bytes[head..].copy_from_slice(&[0, least, most, 0]);
            self.bytes.extend(voxels);
        }
    }

    /// Returns the message's bytes.
    pub(super) fn finish(mut self, missing: usize, sequence: u32, sent_ms: f64) -> Vec<u8> {
        let missing = u32::try_from(missing).unwrap_or(u32::MAX);
        self.bytes[0] = KIND;
        for (at, number) in [(4, self.count), (8, missing), (12, sequence)] {
            self.bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        }
        for (at, time) in [(16, f64::NAN), (24, sent_ms)] {
            self.bytes[at..at + 8].copy_from_slice(&time.to_le_bytes());
        }
        self.bytes
    }
}

/// Returns whether a record can hold a brick's index.
pub(super) fn fits(brick: BrickIndex) -> bool {
    brick.iter().all(|index| i16::try_from(*index).is_ok())
}

/// Returns a weight above 0 in 4096 steps a doubling, from 1.
pub(super) fn weight_code(weight: f32) -> u16 {
    let rounded = (weight.to_bits() + (1 << (ROUNDED - 1))) >> ROUNDED;
    rounded.saturating_sub(LEAST).clamp(1, 65_535) as u16
}

/// Returns whether nothing of a brick was seen.
pub(super) fn is_empty(copy: &BrickCopy) -> bool {
    copy.weight.iter().all(|weight| *weight <= 0.0)
}

//! Blocks: a sample of 27 bytes without zeros (COBS), ended by a zero.
//!
//! | byte | field |
//! |---|---|
//! | 0 | type, 1 |
//! | 1 | joints, 3 |
//! | 2 | flags, 16 bits |
//! | 4 | number, 32 bits |
//! | 8 | time in µs, 32 bits |
//! | 12 | counts, three times 32 bits |
//! | 24 | buttons |
//! | 25 | CRC-16/CCITT-FALSE over bytes 0 to 24 |
//!
//! This module decodes COBS itself, without the crate `cobs`. The length of a block is known, so
//! the decoder tests whether a block begins at this byte, instead of searching for the next zero.
//! A lost byte then costs one block and never two. Tests compare the two.

use super::record::{AXES, Framing, Record, Sample, flag};
use crate::framing::{Parsed, Refusal};

/// Bytes before their zeros are replaced.
const PLAIN: usize = 27;
/// Bytes on the wire: a code in front, a zero behind.
const WIRE: usize = PLAIN + 2;
/// Bytes under the checksum.
const SUMMED: usize = PLAIN - 2;

/// Minimum of the first code: the first two bytes are not zero.
pub(super) const FEWEST_CODE: u8 = 3;
/// Maximum of the first code, when no byte is zero.
pub(super) const MOST_CODE: u8 = 28;

const TYPE: u8 = 1;

/// Contribution of each value of each byte to the checksum. The checksum is linear and its length
/// is fixed, so no byte depends on the one before it.
static SUMS: [[u16; 256]; SUMMED] = sums();
/// Checksum of zeros.
const SUM_OF_ZEROS: u16 = shifted(0xffff, 8 * SUMMED);

/// Returns the register after `bits` further zero bits.
const fn shifted(mut register: u16, bits: usize) -> u16 {
    let mut bit = 0;
    while bit < bits {
        register = register << 1 ^ if register & 0x8000 != 0 { 0x1021 } else { 0 };
        bit += 1;
    }
    register
}

const fn sums() -> [[u16; 256]; SUMMED] {
    let mut sums = [[0; 256]; SUMMED];
    let mut byte = SUMMED;
    while byte > 0 {
        byte -= 1;
        let mut value = 0;
        while value < 256 {
            sums[byte][value] = match byte == SUMMED - 1 {
                true => shifted((value as u16) << 8, 8),
                false => shifted(sums[byte + 1][value], 8),
            };
            value += 1;
        }
    }
    sums
}

#[inline]
fn checksum(summed: &[u8; SUMMED]) -> u16 {
    SUMS.iter().zip(summed).fold(SUM_OF_ZEROS, |sum, (sums, &byte)| sum ^ sums[usize::from(byte)])
}

#[inline]
pub(super) fn parse(window: &[u8]) -> Parsed<Record<'_>> {
    let Some(block) = window.first_chunk::<WIRE>() else {
        return judge_beginning(window);
    };
    if block[1] != TYPE || block[2] != AXES as u8 {
        return Parsed::skip_byte(Refusal::Header);
    }
    let [code, plain @ .., 0] = block else {
        return Parsed::skip_byte(Refusal::Length);
    };
    // A code gives the position of the next zero, and the next code replaces that zero.
    let mut plain: [u8; PLAIN] = *plain;
    let mut at = usize::from(*code) - 1;
    let mut holes = false;
    while let Some(byte) = plain.get_mut(at) {
        let code = usize::from(*byte);
        *byte = 0;
        if code == 0 {
            holes = true;
            break;
        }
        at += code;
    }
    if holes || at != PLAIN {
        return Parsed::skip_byte(Refusal::Length);
    }
    let [_, _, f0, f1, s0, s1, s2, s3, t0, t1, t2, t3, counts @ .., buttons, c0, c1] = plain;
    let (summed, _) = plain.split_first_chunk::<SUMMED>().unwrap_or((&[0; SUMMED], &[]));
    if checksum(summed) != u16::from_le_bytes([c0, c1]) {
        return Parsed::skip_byte(Refusal::Checksum);
    }
    let flags = u16::from_le_bytes([f0, f1]);
    // COBS output contains no zero.
    if flags & !flag::KNOWN != 0 || block[1..=PLAIN].contains(&0) {
        return Parsed::skip_byte(Refusal::Field);
    }
    let counts: &[u8; 4 * AXES] = &counts;
    let (words, _) = counts.as_chunks::<4>();
    let sample = Sample {
        seq: u32::from_le_bytes([s0, s1, s2, s3]),
        t_us: u32::from_le_bytes([t0, t1, t2, t3]),
        counts: [words[0], words[1], words[2]].map(i32::from_le_bytes),
        flags,
        buttons,
        framing: Framing::Blocks,
    };
    Parsed::Record { length: WIRE, record: Record::Sample(sample) }
}

/// Judges a window shorter than a block; bytes that cannot begin a block are not held back.
#[cold]
fn judge_beginning(window: &[u8]) -> Parsed<Record<'_>> {
    match window {
        [_, kind, ..] if *kind != TYPE => Parsed::skip_byte(Refusal::Header),
        [_, _, axes, ..] if *axes != AXES as u8 => Parsed::skip_byte(Refusal::Header),
        _ => Parsed::Short,
    }
}

pub(super) fn write(sample: &Sample, to: &mut Vec<u8>) {
    let mut summed = [0; SUMMED];
    summed[0] = TYPE;
    summed[1] = AXES as u8;
    summed[2..4].copy_from_slice(&sample.flags.to_le_bytes());
    summed[4..8].copy_from_slice(&sample.seq.to_le_bytes());
    summed[8..12].copy_from_slice(&sample.t_us.to_le_bytes());
    summed[12..24].copy_from_slice(sample.counts.map(i32::to_le_bytes).as_flattened());
    summed[24] = sample.buttons;
    let [low, high] = checksum(&summed).to_le_bytes();
    let plain = summed.into_iter().chain([low, high]);
    // A code before each run without zeros (at most 27 bytes) gives the distance to the next
    // zero.
    let mut code = to.len();
    to.push(1);
    for byte in plain {
        if byte == 0 {
            code = to.len();
            to.push(1);
        } else {
            to.push(byte);
            to[code] += 1;
        }
    }
    to.push(0);
}

//! Reads the items of one record, as binary numbers.

use super::limits::FARTHEST;
use super::list::{Item, Layout};
use super::pose::{Header, Pose};
use crate::framing::Refusal;

/// Reads the items of a record, in the order of the output list.
#[inline]
pub(super) fn read(header: Header, body: &[u8], layout: &Layout) -> Result<Pose, Refusal> {
    let mut pose = Pose::empty(header);
    let mut rest = body;
    for item in layout.items() {
        match item {
            Item::Space => exactly(&mut rest, *b" ")?,
            Item::CrLf => exactly(&mut rest, *b"\r\n")?,
            Item::Position | Item::PositionExtended => pose.position = Some(within(header, &mut rest, FARTHEST)?),
            Item::Euler | Item::EulerExtended => pose.euler_deg = Some(within(header, &mut rest, 360.0)?),
            Item::Cosines => {
                pose.cosines = Some([unit(header, &mut rest)?, unit(header, &mut rest)?, unit(header, &mut rest)?]);
            }
            Item::Quaternion => pose.quaternion_wxyz = Some(unit(header, &mut rest)?),
            Item::Timestamp => pose.timestamp_ms = Some(u32::from_le_bytes(array(&mut rest)?)),
            Item::FrameCount => pose.frame_count = Some(u32::from_le_bytes(array(&mut rest)?)),
            Item::Stylus => pose.stylus = Some(i32::from_le_bytes(array(&mut rest)?)),
            Item::Distortion => pose.distortion = Some(i32::from_le_bytes(array(&mut rest)?)),
            Item::ExternalSync => pose.external_sync = Some(i32::from_le_bytes(array(&mut rest)?)),
        }
    }
    Ok(pose)
}

#[inline(always)]
fn array<const N: usize>(rest: &mut &[u8]) -> Result<[u8; N], Refusal> {
    let (first, after) = rest.split_first_chunk().ok_or(Refusal::Length)?;
    *rest = after;
    Ok(*first)
}

#[inline(always)]
fn exactly<const N: usize>(rest: &mut &[u8], what: [u8; N]) -> Result<(), Refusal> {
    if array(rest)? == what { Ok(()) } else { Err(Refusal::Field) }
}

#[inline(always)]
fn numbers<const N: usize>(rest: &mut &[u8]) -> Result<[f32; N], Refusal> {
    let mut values = [0.0; N];
    for value in &mut values {
        *value = f32::from_le_bytes(array(rest)?);
    }
    Ok(values)
}

#[inline(always)]
fn within(header: Header, rest: &mut &[u8], limit: f32) -> Result<[f32; 3], Refusal> {
    let values = numbers(rest)?;
    // This form also refuses NaN.
    let good = values.iter().all(|value| value.abs() < limit);
    if good || !header.is_well() { Ok(values) } else { Err(Refusal::Range) }
}

/// Reads a vector of length 1, within 2 %.
#[inline(always)]
fn unit<const N: usize>(header: Header, rest: &mut &[u8]) -> Result<[f32; N], Refusal> {
    let values = numbers(rest)?;
    let square = values.iter().fold(0.0, |sum, &value| sum + f64::from(value) * f64::from(value));
    let good = (0.98 * 0.98..=1.02 * 1.02).contains(&square);
    if good || !header.is_well() { Ok(values) } else { Err(Refusal::Range) }
}

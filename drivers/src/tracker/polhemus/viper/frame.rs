//! Frames: their preamble, size and checksum, and the measurements in one.

use crc::{CRC_16_ARC, Crc, Table};

/// Sixteen tables, for sixteen bytes a step; otherwise the checksum would dominate the decoding
/// time.
pub(super) static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_ARC);

/// Largest size that a frame may state, in bytes.
pub const LONGEST_SIZE: usize = 1024;
/// Maximum number of sensors in a frame.
pub const MOST_SENSORS: usize = 16;

/// Bytes of preamble and size.
pub(super) const HEADER: usize = 8;
/// Bytes of the CRC.
pub(super) const TRAILER: usize = 4;
/// Bytes of a measurement frame before its sensors.
pub(super) const FRAME_HEADER: usize = 16;
/// Bytes of a sensor in a measurement frame.
pub(super) const SENSOR: usize = 32;

/// Measurements of all sensors at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame<'a> {
    /// Number of the sensor electronics unit.
    pub unit: u32,
    /// Frame number, which counts lost frames too; wraps at 2³².
    pub frame_count: u32,
    /// Whether accelerations are sent beside the poses.
    pub accelerations: bool,
    /// Result of the built-in test, 0 for no error.
    pub test: u8,
    sensors: &'a [[u8; SENSOR]],
}

impl<'a> Frame<'a> {
    /// Returns the measurements of the sensors.
    pub fn sensors(&self) -> impl ExactSizeIterator<Item = Sensor> + use<'a> {
        let accelerations = self.accelerations;
        self.sensors.iter().map(move |bytes| Sensor::read(bytes, accelerations))
    }
}

/// Unit of positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PositionUnit {
    /// Inches.
    Inches,
    /// Feet.
    Feet,
    /// Centimetres.
    Centimetres,
    /// Metres.
    Metres,
}

/// Representation of orientations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum OrientationUnit {
    /// Azimuth, elevation, roll in degrees, and 0.
    EulerDegrees,
    /// Azimuth, elevation, roll in radians, and 0.
    EulerRadians,
    /// Quaternion w, x, y, z.
    Quaternion,
    /// The remaining value of the two bits, which the header does not define.
    Unknown,
}

/// A measurement of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Sensor number, from 0.
    pub sensor: u8,
    /// Whether it is a virtual sensor.
    pub is_virtual: bool,
    /// Unit of `position`.
    pub position_unit: PositionUnit,
    /// Representation of `orientation`.
    pub orientation_unit: OrientationUnit,
    /// State of the stylus' two buttons.
    pub buttons: u8,
    /// Distortion level.
    pub distortion: u8,
    /// Bits of unknown meaning.
    pub auxiliary: u16,
    /// Position x, y, z.
    pub position: [f32; 3],
    /// Orientation; multiples of 2⁻¹⁵ if accelerations are sent.
    pub orientation: [f32; 4],
    /// Acceleration in multiples of 2⁻¹⁵, if it is sent; its unit is not documented.
    pub acceleration: Option<[f32; 4]>,
}

impl Sensor {
    #[inline]
    fn read(bytes: &[u8; SENSOR], accelerations: bool) -> Self {
        let (words, _) = bytes.as_chunks::<4>();
        let info = u32::from_le_bytes(words[0]);
        let single = |index: usize| f32::from_le_bytes(words[index]);
        // Multiples of 2⁻¹⁵: exact in `f32`.
        let half = |index: usize| {
            let [a, b, c, d] = words[index];
            [i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d])].map(|counts| f32::from(counts) / 32_768.0)
        };
        let halves = |index: usize| {
            let ([a, b], [c, d]) = (half(index), half(index + 1));
            [a, b, c, d]
        };
        Self {
            sensor: (info & 0x7f) as u8,
            is_virtual: info >> 7 & 1 != 0,
            position_unit: PositionUnit::from_bits(info >> 8),
            orientation_unit: OrientationUnit::from_bits(info >> 10),
            buttons: (info >> 12 & 3) as u8,
            distortion: (info >> 14 & 0xff) as u8,
            auxiliary: (info >> 22) as u16,
            position: [single(1), single(2), single(3)],
            orientation: if accelerations { halves(4) } else { [single(4), single(5), single(6), single(7)] },
            acceleration: accelerations.then(|| halves(6)),
        }
    }
}

impl PositionUnit {
    const fn from_bits(bits: u32) -> Self {
        match bits & 3 {
            0 => Self::Inches,
            1 => Self::Feet,
            2 => Self::Centimetres,
            _ => Self::Metres,
        }
    }
}

impl OrientationUnit {
    const fn from_bits(bits: u32) -> Self {
        match bits & 3 {
            0 => Self::EulerDegrees,
            1 => Self::EulerRadians,
            2 => Self::Quaternion,
            _ => Self::Unknown,
        }
    }
}

/// Reads a frame of measurements from its body.
#[inline]
pub(super) fn frame(body: &[u8]) -> Option<Frame<'_>> {
    let (words, _) = body.as_chunks::<4>();
    let &[unit, frame_count, info, count, ..] = words else {
        return None;
    };
    let (sensors, rest) = body[FRAME_HEADER..].as_chunks::<SENSOR>();
    let info = u32::from_le_bytes(info);
    let counted = u32::from_le_bytes(count) as usize == sensors.len() && rest.is_empty();
    // Two values of the four mode bits are known.
    (counted && info & 0xf <= 1).then(|| Frame {
        unit: u32::from_le_bytes(unit),
        frame_count: u32::from_le_bytes(frame_count),
        accelerations: info & 0xf == 1,
        test: (info >> 4 & 0xf) as u8,
        sensors,
    })
}

/// Appends a frame around the body that `body` appends.
pub(super) fn framed(preamble: &[u8; 4], to: &mut Vec<u8>, body: impl FnOnce(&mut Vec<u8>)) {
    let start = to.len();
    to.extend(preamble);
    to.extend([0; 4]);
    body(to);
    // Bodies have at most 1020 bytes.
    let size = (to.len() - start - 8 + TRAILER) as u32;
    to[start + 4..start + 8].copy_from_slice(&size.to_le_bytes());
    let sum = CRC.checksum(&to[start..]);
    to.extend(u32::from(sum).to_le_bytes());
}

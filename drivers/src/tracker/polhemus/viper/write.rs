//! Writes frames as a unit does, for virtual units and tests.

use super::command::Reply;
use super::frame::{Frame, SENSOR, Sensor, framed};

/// A frame of measurements to write.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameToWrite<'a> {
    /// Number of the sensor electronics unit.
    pub unit: u32,
    /// Frame number.
    pub frame_count: u32,
    /// Whether accelerations are sent; orientations are then written in multiples of 2⁻¹⁵.
    pub accelerations: bool,
    /// Result of the built-in test, 0 to 15.
    pub test: u8,
    /// The sensors, at most [`crate::tracker::polhemus::viper::MOST_SENSORS`].
    pub sensors: &'a [Sensor],
}

impl FrameToWrite<'_> {
    /// Appends the frame.
    pub fn write(&self, to: &mut Vec<u8>) {
        framed(b"VPRP", to, |to| {
            let info = u32::from(self.accelerations) | u32::from(self.test & 0xf) << 4;
            // At most 16 sensors.
            for word in [self.unit, self.frame_count, info, self.sensors.len() as u32] {
                to.extend(word.to_le_bytes());
            }
            self.sensors.iter().for_each(|sensor| to.extend(sensor.bytes(self.accelerations)));
        });
    }
}

impl Frame<'_> {
    /// Appends the frame as it was read.
    pub fn write(&self, to: &mut Vec<u8>) {
        let sensors: Vec<Sensor> = self.sensors().collect();
        let &Self { unit, frame_count, accelerations, test, .. } = self;
        FrameToWrite { unit, frame_count, accelerations, test, sensors: &sensors }.write(to);
    }
}

impl Sensor {
    fn bytes(&self, accelerations: bool) -> [u8; SENSOR] {
        let info = u32::from(self.sensor & 0x7f)
            | u32::from(self.is_virtual) << 7
            | (self.position_unit as u32) << 8
            | (self.orientation_unit as u32) << 10
            | u32::from(self.buttons & 3) << 12
            | u32::from(self.distortion) << 14
            | u32::from(self.auxiliary & 0x3ff) << 22;
        let mut bytes = [0; SENSOR];
        bytes[..4].copy_from_slice(&info.to_le_bytes());
        let mut singles = |from: usize, values: &[f32]| {
            for (index, value) in values.iter().enumerate() {
                bytes[from + 4 * index..from + 4 * index + 4].copy_from_slice(&value.to_le_bytes());
            }
        };
        singles(4, &self.position);
        if !accelerations {
            singles(16, &self.orientation);
            return bytes;
        }
        for (index, value) in self.orientation.iter().chain(&self.acceleration.unwrap_or_default()).enumerate() {
            // The cast saturates: 1 becomes 1 − 2⁻¹⁵.
            let counts = (value * 32_768.0).round() as i16;
            bytes[16 + 2 * index..18 + 2 * index].copy_from_slice(&counts.to_le_bytes());
        }
        bytes
    }
}

impl Reply<'_> {
    /// Appends the frame.
    pub fn write(&self, to: &mut Vec<u8>) {
        framed(b"VPRC", to, |to| {
            for word in [self.unit, self.command, self.action, self.arguments[0], self.arguments[1]] {
                to.extend(word.to_le_bytes());
            }
            to.extend(self.payload);
        });
    }
}

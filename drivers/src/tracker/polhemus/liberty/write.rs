//! Writes frames as a unit does, for virtual units and tests.

use super::list::{Item, Layout};
use super::{Header, Pose, Reply};

impl Header {
    fn write(&self, body: usize, to: &mut Vec<u8>) {
        to.extend(self.tag.bytes());
        to.extend([self.station, self.command, self.error, 0]);
        // Bodies have at most 1000 bytes.
        to.extend((body as u16).to_le_bytes());
    }
}

impl Pose {
    /// Appends the frame in this layout; missing fields are written as 0.
    pub fn write(&self, layout: &Layout, to: &mut Vec<u8>) {
        self.header.write(layout.body(), to);
        let singles = |values: &[f32], to: &mut Vec<u8>| values.iter().for_each(|value| to.extend(value.to_le_bytes()));
        for item in layout.items() {
            match item {
                Item::Space => to.push(b' '),
                Item::CrLf => to.extend(b"\r\n"),
                Item::Position | Item::PositionExtended => singles(&self.position.unwrap_or_default(), to),
                Item::Euler | Item::EulerExtended => singles(&self.euler_deg.unwrap_or_default(), to),
                Item::Cosines => singles(self.cosines.unwrap_or_default().as_flattened(), to),
                Item::Quaternion => singles(&self.quaternion_wxyz.unwrap_or_default(), to),
                Item::Timestamp => to.extend(self.timestamp_ms.unwrap_or_default().to_le_bytes()),
                Item::FrameCount => to.extend(self.frame_count.unwrap_or_default().to_le_bytes()),
                Item::Stylus => to.extend(self.stylus.unwrap_or_default().to_le_bytes()),
                Item::Distortion => to.extend(self.distortion.unwrap_or_default().to_le_bytes()),
                Item::ExternalSync => to.extend(self.external_sync.unwrap_or_default().to_le_bytes()),
            }
        }
    }
}

impl Reply<'_> {
    /// Appends the frame; its body may have at most [`LONGEST_BODY`](super::LONGEST_BODY) bytes.
    pub fn write(&self, to: &mut Vec<u8>) {
        self.header.write(self.body.len(), to);
        to.extend(self.body);
    }
}

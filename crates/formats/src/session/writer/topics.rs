//! The topics of a session being written: one per device and kind of reading, created when
//! first needed.

use std::collections::BTreeMap;
use std::fmt;

use mcap::McapError;
use mcap::write::PrivateRecordOptions;

use crate::session::CHANNELS;
use crate::session::about::RecordedDevice;
use crate::session::message::Crop;
use crate::session::proto::Fields;
use crate::session::schema::Schema;
use crate::session::write_buffer::Tail;

/// A device being written.
pub(super) struct Device {
    pub(super) recorded: RecordedDevice,
    pub(super) crop: Option<Crop>,
    /// Channel of its description.
    pub(super) about: u16,
    /// Channels of its readings.
    pub(super) channels: Vec<(Kind, u16)>,
}

/// A kind of reading that has a topic of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Image,
    Raw,
    Counts,
    Transform,
    /// Poses of a station.
    Pose(u8),
}

impl fmt::Display for Kind {
    /// Writes the topic's name behind that of the device.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Image => f.write_str("image"),
            Self::Raw => f.write_str("raw"),
            Self::Counts => f.write_str("counts"),
            Self::Transform => f.write_str("transform"),
            Self::Pose(station) => write!(f, "pose/{station}"),
        }
    }
}

/// A topic of the file.
pub(super) struct Channel {
    pub(super) topic: String,
    /// Number of the next message. Lost messages are counted, so that a reader detects the gap.
    pub(super) sequence: u32,
}

/// The topics of the file.
#[derive(Default)]
pub(super) struct Topics {
    /// Indexed by their numbers in the file, which begin at 1.
    channels: Vec<Channel>,
    /// The table of channels, encoded.
    table: Vec<u8>,
}

impl Topics {
    /// Returns a channel by its number.
    pub(super) fn get(&self, channel: u16) -> &Channel {
        &self.channels[usize::from(channel) - 1]
    }

    /// Returns a channel by its number, to be changed.
    pub(super) fn get_mut(&mut self, channel: u16) -> &mut Channel {
        &mut self.channels[usize::from(channel) - 1]
    }

    /// Returns the number of the channel with a topic.
    pub(super) fn find(&self, topic: &str) -> Option<u16> {
        self.channels.iter().position(|channel| channel.topic == topic).map(|at| (at + 1) as u16)
    }

    /// Creates a channel, and writes its description and the new table to the file.
    pub(super) fn add(
        &mut self,
        file: &mut mcap::Writer<Tail>,
        topic: String,
        schema: &'static Schema,
    ) -> Result<u16, McapError> {
        let schema_id = file.add_schema(schema.name, "protobuf", &schema.descriptors())?;
        let id = file.add_channel(schema_id, &topic, "protobuf", &BTreeMap::new())?;
        Fields::to(&mut self.table).message(1, |out| {
            out.uint(1, id.into());
            out.text(2, &topic);
            out.text(3, schema.name);
        });
        debug_assert_eq!(usize::from(id), self.channels.len() + 1, "channels are numbered from 1");
        self.channels.push(Channel { topic, sequence: 0 });
        self.write_table(file)?;
        Ok(id)
    }

    /// Writes the table of channels into the chunk.
    pub(super) fn write_table(&self, file: &mut mcap::Writer<Tail>) -> Result<(), McapError> {
        file.write_private_record(CHANNELS, &self.table, PrivateRecordOptions::IncludeInChunks.into())
    }
}

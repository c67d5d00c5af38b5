//! The topics of a session being written: one per device and kind of reading, created when
//! first needed.

use std::collections::BTreeMap;

use mcap::write::PrivateRecordOptions;

use sonoweave_core::reading::Reading;

use crate::Error;
use crate::session::CHANNELS;
use crate::session::about::RecordedDevice;
use crate::session::message::{self, Crop};
use crate::session::proto::Fields;
use crate::session::schema::{self, Schema};
use crate::session::writer::{SessionWriter, Source, refused};

/// A device being written.
pub(super) struct Device {
    pub(super) recorded: RecordedDevice,
    pub(super) crop: Option<Crop>,
    pub(super) about: u16,
    /// Channels by kind of reading; poses by station.
    pub(super) frames: Option<u16>,
    pub(super) raw: Option<u16>,
    pub(super) counts: Option<u16>,
    pub(super) transforms: Option<u16>,
    pub(super) poses: Vec<(u8, u16)>,
}

/// A topic of the file.
pub(super) struct Channel {
    pub(super) topic: String,
    /// Number of the next message. Lost messages are counted, so that a reader detects the gap.
    pub(super) sequence: u32,
}

impl SessionWriter {
    /// Writes the table of channels into the chunk.
    pub(super) fn tell_channels(&mut self) -> Result<(), Error> {
        let inside = PrivateRecordOptions::IncludeInChunks.into();
        self.file.write_private_record(CHANNELS, &self.table, inside).map_err(|error| refused(&self.path, error))
    }

    /// Creates a channel and writes its description to the file.
    pub(super) fn channel(&mut self, topic: String, schema: &'static Schema) -> Result<u16, Error> {
        self.begin()?;
        let made = self
            .file
            .add_schema(schema.name, "protobuf", &schema.descriptors())
            .and_then(|id| self.file.add_channel(id, &topic, "protobuf", &BTreeMap::new()));
        let id = made.map_err(|error| refused(&self.path, error))?;
        Fields::to(&mut self.table).message(1, |out| {
            out.uint(1, id.into());
            out.text(2, &topic);
            out.text(3, schema.name);
        });
        debug_assert_eq!(usize::from(id), self.channels.len() + 1, "channels are numbered from 1");
        self.channels.push(Channel { topic, sequence: 0 });
        self.tell_channels()?;
        Ok(id)
    }

    /// Returns the channel of a device's reading, created for the first one.
    pub(super) fn channel_of(&mut self, Source(at): Source, reading: &Reading) -> Result<u16, Error> {
        let device = &self.devices[at];
        let known = match reading {
            Reading::Frame(_) => device.frames,
            Reading::Raw(_) => device.raw,
            Reading::Counts(_) => device.counts,
            Reading::NamedTransform(_) => device.transforms,
            Reading::Pose(pose) => {
                device.poses.iter().find(|(station, _)| *station == pose.station).map(|(_, channel)| *channel)
            }
            Reading::Recorded(note) => return self.note_channel(&note.topic.clone()),
        };
        if let Some(channel) = known {
            return Ok(channel);
        }
        let name = &device.recorded.name;
        let topic = match reading {
            Reading::Frame(_) => format!("/{name}/image"),
            Reading::Raw(_) => format!("/{name}/raw"),
            Reading::Counts(_) => format!("/{name}/counts"),
            Reading::NamedTransform(_) => format!("/{name}/transform"),
            Reading::Pose(pose) => format!("/{name}/pose/{}", pose.station),
            Reading::Recorded(_) => String::new(),
        };
        let channel = self.channel(topic, message::schema_of(reading))?;
        let device = &mut self.devices[at];
        match reading {
            Reading::Frame(_) => device.frames = Some(channel),
            Reading::Raw(_) => device.raw = Some(channel),
            Reading::Counts(_) => device.counts = Some(channel),
            Reading::NamedTransform(_) => device.transforms = Some(channel),
            Reading::Pose(pose) => device.poses.push((pose.station, channel)),
            Reading::Recorded(_) => {}
        }
        Ok(channel)
    }

    /// Returns the channel of notes of this kind.
    pub(super) fn note_channel(&mut self, kind: &str) -> Result<u16, Error> {
        if let Some(channel) = self.notes.get(kind) {
            return Ok(*channel);
        }
        let channel = self.channel(format!("/note/{kind}"), &schema::NOTE)?;
        self.notes.insert(kind.to_owned(), channel);
        Ok(channel)
    }
}

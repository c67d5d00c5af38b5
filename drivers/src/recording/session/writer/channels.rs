//! The topics of a session that is written: one for each kind of reading of each device, made when they are needed.

use std::collections::BTreeMap;

use mcap::write::PrivateRecordOptions;

use super::{SessionWriter, Source, misuse};
use crate::Error;
use crate::reading::Reading;
use crate::recording::session::CHANNELS;
use crate::recording::session::about::RecordedDevice;
use crate::recording::session::message::{self, Crop};
use crate::recording::session::proto::Fields;
use crate::recording::session::schema::{self, Schema};

/// A device that is written.
pub(super) struct Device {
    pub(super) recorded: RecordedDevice,
    pub(super) crop: Option<Crop>,
    pub(super) about: u16,
    /// Channels by what they are of; poses by their station.
    pub(super) frames: Option<u16>,
    pub(super) raw: Option<u16>,
    pub(super) counts: Option<u16>,
    pub(super) transforms: Option<u16>,
    pub(super) poses: Vec<(u8, u16)>,
}

/// A topic of the file.
pub(super) struct Channel {
    pub(super) topic: String,
    /// Number of the next message: those that were lost are counted, so that a reader sees that they are missing.
    pub(super) sequence: u32,
}

impl SessionWriter {
    /// Says within the chunk which channels there are.
    pub(super) fn tell_channels(&mut self) -> Result<(), Error> {
        let inside = PrivateRecordOptions::IncludeInChunks.into();
        self.file.write_private_record(CHANNELS, &self.table, inside).map_err(|error| misuse(&self.path, &error))
    }

    /// A new channel, with which the file says what it is.
    pub(super) fn channel(&mut self, topic: String, schema: &'static Schema) -> Result<u16, Error> {
        self.begin()?;
        let made = self
            .file
            .add_schema(schema.name, "protobuf", &schema.descriptors())
            .and_then(|id| self.file.add_channel(id, &topic, "protobuf", &BTreeMap::new()));
        let id = made.map_err(|error| misuse(&self.path, &error))?;
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

    /// The channel of a device's reading, made when there is the first.
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

    /// That of notes of a kind.
    pub(super) fn note_channel(&mut self, kind: &str) -> Result<u16, Error> {
        if let Some(channel) = self.notes.get(kind) {
            return Ok(*channel);
        }
        let channel = self.channel(format!("/note/{kind}"), &schema::NOTE)?;
        self.notes.insert(kind.to_owned(), channel);
        Ok(channel)
    }
}

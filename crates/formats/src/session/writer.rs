//! Writes a session live.

mod chunks;
mod disk_full;
mod options;
mod topics;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};

use sonoweave_core::Description;
use sonoweave_core::reading::{Reading, Recorded, Stamp};

use crate::session::about::{About, RecordedDevice};
use crate::session::account::{Account, Losing, Rate, Room};
use crate::session::message::{self, Crop};
use crate::session::picture::Encoder;
use crate::session::schema::{self, Schema};
use crate::session::syncing::{SyncRequests, Syncer};
use crate::session::write_buffer::{Store, Tail, WriteBuffer};
use crate::session::{LineProtocol, PROFILE, place};
use crate::{Error, Unwritable};
pub use options::WriterOptions;
use topics::{Device, Kind, Topics};

/// Handle of a device in the session being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Source(usize);

/// An open session file.
///
/// Everything is written in the order in which it is handed over. In the steady state a message
/// allocates nothing here. It is encoded in a reused buffer, and the crate `mcap` copies it
/// into the chunk, which stays in memory until complete. The crate allocates an index per
/// channel and a checksum buffer for each chunk.
///
/// Dropped without [`Self::finish`], it writes as much as possible and logs errors only.
pub struct SessionWriter {
    path: PathBuf,
    options: WriterOptions,
    /// Declared before `tail`, because it writes to it when dropped.
    file: mcap::Writer<Tail>,
    tail: Tail,
    devices: Vec<Device>,
    notes: HashMap<String, u16>,
    topics: Topics,
    session: u16,
    losses: u16,
    encoder: Encoder,
    message: Vec<u8>,
    chunk_ns: Option<i64>,
    /// Number of messages in the open chunk, and in complete chunks not on the disk.
    begun: u64,
    waiting: VecDeque<u64>,
    syncs: SyncRequests,
    last_ns: i64,
    retry_ns: i64,
    losing: Losing,
    rate: Rate,
    account: Account,
    items: u64,
    finished: bool,
}

impl SessionWriter {
    /// Creates a new file in a folder; creates the folder if missing.
    ///
    /// # Errors
    /// [`Error::Io`] when the folder or the file cannot be created, or its beginning cannot be
    /// written. At most an empty file remains.
    pub fn create(folder: &Path, options: WriterOptions) -> Result<Self, Error> {
        let about = About::now(&options.program);
        let (file, path) = place::create(folder, about.realtime_ns)?;
        Self::on(Box::new(file), &path, about, options)
    }

    /// Writes to the given empty store, with the given clock readings. The path is used in
    /// messages.
    ///
    /// # Errors
    /// [`Error::Io`] when the beginning cannot be written.
    pub fn on(store: Box<dyn Store>, path: &Path, about: About, options: WriterOptions) -> Result<Self, Error> {
        let data = store.data_sync().map_err(|source| Error::Io {
            path: path.to_owned(),
            doing: "opening the session's file a second time, to sync it",
            source,
        })?;
        let syncs = SyncRequests::new(data, options.chunk_ns);
        let tail = Tail::of(WriteBuffer::new(store, 2 * options.chunk_bytes));
        let file = mcap::WriteOptions::new()
            .compression(None)
            .chunk_size(None)
            .profile(PROFILE)
            .library(options.program.clone())
            .create(tail.clone())
            .map_err(|error| refused(path, error))?;
        let mut writer = Self {
            path: path.to_owned(),
            options,
            file,
            tail,
            devices: Vec::new(),
            notes: HashMap::new(),
            topics: Topics::default(),
            session: 0,
            losses: 0,
            encoder: Encoder::default(),
            message: Vec::new(),
            chunk_ns: None,
            begun: 0,
            waiting: VecDeque::new(),
            syncs,
            last_ns: about.monotonic_ns,
            retry_ns: i64::MIN,
            losing: Losing::default(),
            rate: Rate::default(),
            account: Account::default(),
            items: 0,
            finished: false,
        };
        let metadata = BTreeMap::from([
            ("clock".to_owned(), "CLOCK_MONOTONIC, ns".to_owned()),
            ("program".to_owned(), about.program.clone()),
            ("realtime_offset_ns".to_owned(), about.offset_ns().to_string()),
            ("version".to_owned(), schema::VERSION.to_string()),
        ]);
        let metadata = Metadata { name: PROFILE.to_owned(), metadata };
        writer.file.write_metadata(&metadata).map_err(|error| refused(path, error))?;
        writer.session = writer.channel("/session".into(), &schema::SESSION)?;
        writer.losses = writer.channel("/losses".into(), &schema::LOSS)?;
        let at_ns = about.monotonic_ns;
        about.write(&mut writer.message);
        writer.put(writer.session, at_ns, at_ns)?;
        // A session without its beginning is unreadable, so the beginning goes to the disk
        // first.
        writer.close()?;
        writer.commit(at_ns)?;
        writer.request_sync(at_ns);
        Ok(writer)
    }

    /// Returns the file's path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Announces a device under a unique name: the protocol of its lines, its description, and
    /// the part of its frames to keep (without `crop`, all).
    ///
    /// # Errors
    /// [`Unwritable::DeviceName`] for a name that is taken, empty, or has a slash.
    pub fn device(
        &mut self,
        name: &str,
        line_protocol: Option<LineProtocol>,
        description: &Description,
        crop: Option<Crop>,
    ) -> Result<Source, Error> {
        let is_taken = self.devices.iter().any(|device| device.recorded.name == name);
        if is_taken || name.is_empty() || name.contains('/') || ["session", "losses", "note"].contains(&name) {
            return Err(Error::Unwritable { path: self.path.clone(), source: Unwritable::DeviceName(name.to_owned()) });
        }
        let about = self.channel(format!("/{name}/about"), &schema::DEVICE)?;
        let recorded = RecordedDevice { name: name.to_owned(), line_protocol, description: description.clone() };
        self.devices.push(Device { recorded, crop, about, channels: Vec::new() });
        let source = Source(self.devices.len() - 1);
        self.announce(source)?;
        Ok(source)
    }

    /// Sets the part of a device's frames that is kept from now on; without `crop`, all of each
    /// frame.
    pub fn crop(&mut self, source: Source, crop: Option<Crop>) {
        self.devices[source.0].crop = crop;
    }

    /// Updates a device's description; writes it only if it has changed.
    ///
    /// # Errors
    /// The errors of [`Self::write`].
    pub fn describe(&mut self, source: Source, description: &Description) -> Result<(), Error> {
        let device = &mut self.devices[source.0];
        if device.recorded.description == *description {
            return Ok(());
        }
        device.recorded.description.clone_from(description);
        self.announce(source)
    }

    fn announce(&mut self, Source(at): Source) -> Result<(), Error> {
        self.message.clear();
        self.devices[at].recorded.write(&mut self.message);
        self.put(self.devices[at].about, self.last_ns, self.last_ns)
    }

    /// Writes a device's reading, handed over at host time `at_ns`.
    ///
    /// # Errors
    /// [`Error::Io`] each time that writing begins to fail. The session is intact up to there,
    /// and the writer keeps trying. It counts losses meanwhile ([`Self::account`]) and records
    /// them in the session as soon as possible. [`Unwritable::Mcap`] for more channels than a file
    /// can have.
    pub fn write(&mut self, source: Source, reading: &Reading, at_ns: i64) -> Result<(), Error> {
        let channel = self.channel_of(source, reading)?;
        let (is_frame, size) = match reading {
            Reading::Frame(frame) => (true, frame.pixels.len()),
            Reading::Raw(raw) => (false, raw.bytes.len()),
            _ => (false, 0),
        };
        let due = self.advance(at_ns);
        if self.has_room(is_frame) {
            self.message.clear();
            message::write(reading, self.devices[source.0].crop, &mut self.encoder, &mut self.message);
            self.put(channel, at_ns, reading.stamp().host_ns.unwrap_or(at_ns))?;
        } else {
            self.lose(channel, size, at_ns);
        }
        due
    }

    /// Writes a note of the session: a clock map, a decision, settings, the calibration. Its
    /// text is JSON; notes are numbered in order.
    ///
    /// # Errors
    /// The errors of [`Self::write`].
    pub fn note(&mut self, kind: &str, json: &str, at_ns: i64) -> Result<(), Error> {
        self.write_note((kind, json, at_ns), at_ns, false)
    }

    /// Writes a note about earlier messages. It keeps its own time, but follows the previous
    /// message and has that message's `log_time`. The `log_time` of readings therefore stays
    /// the exact hand-over time, even with notes in between.
    ///
    /// # Errors
    /// The errors of [`Self::write`].
    pub fn note_behind(&mut self, kind: &str, json: &str, at_ns: i64) -> Result<(), Error> {
        self.write_note((kind, json, at_ns), self.last_ns, false)
    }

    /// Writes a note like [`Self::note_behind`], even if the memory for waiting messages is full:
    /// one of the last notes before [`Self::finish`], which no later note can make good.
    ///
    /// # Errors
    /// The errors of [`Self::write`].
    pub fn last_note(&mut self, kind: &str, json: &str, at_ns: i64) -> Result<(), Error> {
        self.write_note((kind, json, at_ns), self.last_ns, true)
    }

    fn write_note(&mut self, (kind, json, own_ns): (&str, &str, i64), at_ns: i64, is_last: bool) -> Result<(), Error> {
        let stamp = Stamp { item: self.items, host_ns: Some(own_ns), ..Stamp::default() };
        self.items += 1;
        let channel = self.note_channel(kind)?;
        let due = self.advance(at_ns);
        if is_last || self.has_room(false) {
            self.message.clear();
            let note = Reading::Recorded(Recorded { stamp, topic: kind.to_owned(), text: json.to_owned() });
            message::write(&note, None, &mut self.encoder, &mut self.message);
            self.put(channel, at_ns, own_ns)?;
        } else {
            self.lose(channel, json.len(), at_ns);
        }
        due
    }

    /// Closes due chunks and retries failed writes. Call it periodically while nothing is
    /// written.
    ///
    /// # Errors
    /// The errors of [`Self::write`].
    pub fn tick(&mut self, now_ns: i64) -> Result<(), Error> {
        self.advance(now_ns)
    }

    /// Returns the outcome counts of all messages.
    pub fn account(&self) -> Account {
        let buffer = self.tail.buffer();
        let mut account = Account {
            file_bytes: buffer.stored(),
            held_bytes: buffer.len() as u64,
            synced_bytes: self.syncs.synced(),
            unsynced_since_ns: self.syncs.unsynced_since_ns(),
            ..self.account.clone()
        };
        if account.trouble.is_empty() {
            self.syncs.trouble().clone_into(&mut account.trouble);
        }
        account
    }

    /// Returns the part that syncs written data. A thread of its own should run it.
    pub fn syncer(&self) -> Syncer {
        self.syncs.syncer()
    }

    /// Returns the free space on the disk; `None` if unknown.
    pub fn room(&self) -> Option<Room> {
        let free_bytes = self.tail.buffer().free_bytes()?;
        Some(Room { free_bytes, bytes_per_s: self.rate.bytes_per_s() })
    }

    /// Ends the session. On return, everything is on the disk, including an index.
    ///
    /// # Errors
    /// [`Error::Io`] when it is not. The file is still valid up to its last whole chunk.
    pub fn finish(mut self, now_ns: i64) -> Result<Account, Error> {
        // Records both clocks again, which shows changes of the wall clock.
        self.close_with(&About::now(&self.options.program), now_ns)?;
        self.end(now_ns)?;
        Ok(self.account())
    }

    fn close_with(&mut self, about: &About, now_ns: i64) -> Result<(), Error> {
        self.message.clear();
        about.write(&mut self.message);
        self.put(self.session, now_ns, now_ns)
    }

    /// Ends a copied session without changes.
    pub(super) fn finish_copy(mut self) -> Result<Account, Error> {
        self.end(self.last_ns)?;
        Ok(self.account())
    }

    /// Copies a message of another session unchanged; messages must come in the order of their
    /// times.
    pub(super) fn copy(
        &mut self,
        topic: &str,
        schema: &'static Schema,
        header: &MessageHeader,
        message: &[u8],
    ) -> Result<(), Error> {
        let channel = match self.topics.find(topic) {
            Some(known) => known,
            None => self.channel(topic.to_owned(), schema)?,
        };
        let [log_ns, stamp_ns] = [header.log_time, header.publish_time].map(|ns| i64::try_from(ns).unwrap_or(i64::MAX));
        self.advance(log_ns)?;
        self.topics.get_mut(channel).sequence = header.sequence;
        self.message.clear();
        self.message.extend_from_slice(message);
        self.put(channel, log_ns, stamp_ns)
    }

    fn end(&mut self, now_ns: i64) -> Result<(), Error> {
        self.finished = true;
        self.write_losses(now_ns)?;
        self.file.finish().map_err(|error| refused(&self.path, error))?;
        // The index and the end of the file.
        self.whole();
        let mut buffer = self.tail.buffer();
        let done = buffer.commit();
        let stored = buffer.stored();
        drop(buffer);
        self.count_stored();
        done.and_then(|()| self.syncs.finish(stored)).map_err(|source| {
            self.failed("ending the session (it is whole up to its last chunk, without an index)", source)
        })
    }

    /// Writes the encoded message.
    fn put(&mut self, channel: u16, at_ns: i64, stamp_ns: i64) -> Result<(), Error> {
        let at_ns = at_ns.max(self.last_ns);
        self.last_ns = at_ns;
        self.begin()?;
        let known = self.topics.get_mut(channel);
        let sequence = known.sequence;
        known.sequence = sequence.wrapping_add(1);
        let [log_time, publish_time] = [at_ns, stamp_ns].map(|ns| u64::try_from(ns).unwrap_or(0));
        let header = MessageHeader { channel_id: channel, sequence, log_time, publish_time };
        self.account.messages += 1;
        self.begun += 1;
        self.syncs.message(at_ns);
        self.file.write_to_known_channel(&header, &self.message).map_err(|error| refused(&self.path, error))
    }

    /// Begins a chunk, unless one is open. It starts with the channel table, so that it is
    /// readable without earlier chunks.
    fn begin(&mut self) -> Result<(), Error> {
        if self.chunk_ns.is_some() {
            return Ok(());
        }
        self.chunk_ns = Some(self.last_ns);
        self.topics.write_table(&mut self.file).map_err(|error| refused(&self.path, error))
    }

    /// Creates a channel and writes its description to the file.
    fn channel(&mut self, topic: String, schema: &'static Schema) -> Result<u16, Error> {
        self.begin()?;
        self.topics.add(&mut self.file, topic, schema).map_err(|error| refused(&self.path, error))
    }

    /// Returns the channel of a device's reading, created for the first one.
    fn channel_of(&mut self, Source(at): Source, reading: &Reading) -> Result<u16, Error> {
        let kind = match reading {
            Reading::Frame(_) => Kind::Image,
            Reading::Raw(_) => Kind::Raw,
            Reading::Counts(_) => Kind::Counts,
            Reading::NamedTransform(_) => Kind::Transform,
            Reading::Pose(pose) => Kind::Pose(pose.station),
            Reading::Recorded(note) => return self.note_channel(&note.topic),
        };
        let device = &self.devices[at];
        if let Some((_, channel)) = device.channels.iter().find(|(known, _)| *known == kind) {
            return Ok(*channel);
        }
        let topic = format!("/{}/{kind}", device.recorded.name);
        let channel = self.channel(topic, message::schema_of(reading))?;
        self.devices[at].channels.push((kind, channel));
        Ok(channel)
    }

    /// Returns the channel of notes of this kind.
    fn note_channel(&mut self, kind: &str) -> Result<u16, Error> {
        if let Some(channel) = self.notes.get(kind) {
            return Ok(*channel);
        }
        let channel = self.channel(format!("/note/{kind}"), &schema::NOTE)?;
        self.notes.insert(kind.to_owned(), channel);
        Ok(channel)
    }
}

impl Drop for SessionWriter {
    fn drop(&mut self) {
        if !self.finished
            && let Err(error) = self.end(self.last_ns)
        {
            tracing::error!("{error}");
        }
    }
}

fn refused(path: &Path, error: mcap::McapError) -> Error {
    Error::Unwritable { path: path.to_owned(), source: Unwritable::Mcap(error) }
}

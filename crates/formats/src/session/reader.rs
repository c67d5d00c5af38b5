//! Reads a session's messages in written order, which is the order of their times.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Record, op};

use crate::session::about::{About, Loss, RecordedDevice};
use crate::session::proto::{Malformed, Reader as Fields};
use crate::session::schema::{self, Schema};
use crate::session::walk::{Damage, Piece, Walker};
use crate::session::{CHANNELS, PROFILE, record};
use crate::{Error, Limits, NoSession};

/// A topic of a session.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Topic name: `/DEVICE/image`, `/note/KIND`.
    pub topic: String,
    /// Schema name of its messages.
    pub schema: String,
    /// Its schema, if this version knows it.
    pub known: Option<&'static Schema>,
    /// Number of messages read.
    pub messages: u64,
    /// Messages that were written or lost, judged by their numbers, but not read: they were
    /// damaged, or never reached the disk.
    pub missing: u64,
    next: Option<u32>,
}

impl Channel {
    /// Returns the channel's device; `None` for the session's own topics.
    pub fn device(&self) -> Option<&str> {
        let (first, rest) = self.topic.strip_prefix('/')?.split_once('/')?;
        (first != "note" && !rest.is_empty()).then_some(first)
    }

    /// Returns the expected number of the next message.
    pub(super) fn next_number(&self) -> u32 {
        self.next.unwrap_or(0)
    }

    /// Records a message's number. Decreasing numbers are not counted.
    fn count(&mut self, sequence: u32) {
        self.messages += 1;
        let ahead = sequence.wrapping_sub(self.next.unwrap_or(0));
        if ahead < 1 << 31 {
            self.missing += u64::from(ahead);
            self.next = Some(sequence.wrapping_add(1));
        }
    }
}

/// A message as stored in the file.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    /// Channel of the message.
    pub channel: &'a Channel,
    pub(super) header: MessageHeader,
    /// Content, encoded by its schema.
    pub bytes: &'a [u8],
}

impl Message<'_> {
    /// Returns the time it was handed to the writer: CLOCK_MONOTONIC, ns.
    pub fn log_ns(&self) -> i64 {
        i64::try_from(self.header.log_time).unwrap_or(i64::MAX)
    }

    /// Returns the content's own stamp, of reception or measurement: CLOCK_MONOTONIC, ns.
    pub fn stamp_ns(&self) -> i64 {
        i64::try_from(self.header.publish_time).unwrap_or(i64::MAX)
    }

    /// Returns the session's description, if this message holds it.
    pub fn about(&self) -> Option<About> {
        self.is(&schema::SESSION).then(|| About::read(self.bytes).ok()).flatten()
    }

    /// Returns a device's description, if this message holds one.
    pub fn device(&self) -> Option<RecordedDevice> {
        self.is(&schema::DEVICE).then(|| RecordedDevice::read(self.bytes).ok()).flatten()
    }

    /// Returns the recorded losses, if this message holds them.
    pub fn loss(&self) -> Option<Loss> {
        self.is(&schema::LOSS).then(|| Loss::read(self.bytes).ok()).flatten()
    }

    /// Returns whether the message is a frame.
    pub fn is_frame(&self) -> bool {
        self.is(&schema::FRAME)
    }

    fn is(&self, one: &Schema) -> bool {
        self.channel.schema == one.name
    }

    /// Returns its number within its topic, including lost messages.
    pub fn sequence(&self) -> u32 {
        self.header.sequence
    }
}

/// Next item of a session file.
#[derive(Debug)]
pub enum Event<'a> {
    /// A message.
    Message(Message<'a>),
    /// A part of the file that cannot be read. Later parts can.
    Damage(Damage),
}

/// State of a file's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// Regular: no written data is missing after it.
    Finished,
    /// The writing program was killed: data not on the disk is missing.
    BrokenOff,
}

/// An open session file. Memory: one chunk.
pub struct SessionReader<R = BufReader<File>> {
    path: PathBuf,
    walker: Walker<R>,
    about: About,
    channels: HashMap<u16, Channel>,
    schemas: HashMap<u16, String>,
    /// Position of the chunk in the file, and of its next record in the chunk.
    chunk: u64,
    at: usize,
    in_chunk: bool,
    /// Damage to report before the next piece.
    damage: Option<Damage>,
    /// Damage found when the file was opened.
    first: Vec<Damage>,
    ending: Option<Ending>,
}

impl SessionReader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be read, [`Error::NoSession`] when it is no session.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self, Error> {
        let failed = |source| Error::Io { path: path.to_owned(), doing: "opening the session", source };
        let file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        Self::of(BufReader::new(file), length, path, limits)
    }
}

impl<R: Read + Seek> SessionReader<R> {
    /// Reads from any seekable source of that length. The path is used in messages.
    ///
    /// # Errors
    /// The errors of [`SessionReader::open`].
    pub fn of(file: R, length: u64, path: &Path, limits: &Limits) -> Result<Self, Error> {
        // A chunk ends after the frame that exceeds its size.
        let walker = Walker::new(file, length, limits.frame_bytes.saturating_add(limits.frame_bytes / 8 + (16 << 20)));
        let mut reader = Self {
            path: path.to_owned(),
            walker,
            about: About::default(),
            channels: HashMap::new(),
            schemas: HashMap::new(),
            chunk: 0,
            at: 0,
            in_chunk: false,
            damage: None,
            first: Vec::new(),
            ending: None,
        };
        reader.begin()?;
        Ok(reader)
    }

    /// Checks that the file's first chunk holds the session's description.
    fn begin(&mut self) -> Result<(), Error> {
        loop {
            match self.piece()? {
                Piece::Damage(damage) => self.first.push(damage),
                Piece::Chunk { at, times } => {
                    self.enter(at, times);
                    if self.channels.values().any(|channel| channel.schema == schema::SESSION.name) {
                        self.first.reverse();
                        return Ok(());
                    }
                    return Err(self.refused(NoSession::Undescribed));
                }
                Piece::End { .. } => {
                    return Err(self.refused(match &self.walker.header {
                        Some([profile, library]) if profile != PROFILE => {
                            NoSession::Foreign { profile: profile.clone(), library: library.clone() }
                        }
                        Some(_) => NoSession::Empty,
                        None => NoSession::NoChunk,
                    }));
                }
            }
        }
    }

    fn refused(&self, source: NoSession) -> Error {
        Error::NoSession { path: self.path.clone(), source }
    }

    /// Returns the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the session's description; all zeros if its beginning is lost.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// Returns the topics found so far, by name.
    pub fn channels(&self) -> Vec<&Channel> {
        let mut channels: Vec<&Channel> = self.channels.values().collect();
        channels.sort_by(|a, b| a.topic.cmp(&b.topic));
        channels
    }

    /// Returns the state of the file's end, once everything was read.
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// Returns the position of the last message's chunk, bytes from the beginning of the file.
    pub(super) fn chunk(&self) -> u64 {
        self.chunk
    }

    /// Continues at a chunk that was read before. The message counts of the topics continue.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read.
    pub(super) fn return_to(&mut self, chunk: u64) -> Result<(), Error> {
        (self.in_chunk, self.damage, self.ending) = (false, None, None);
        self.first.clear();
        let Self { walker, path, .. } = self;
        walker.return_to(chunk).map_err(|source| Error::Io { path: path.clone(), doing: "reading the session", source })
    }

    fn piece(&mut self) -> Result<Piece, Error> {
        let Self { walker, path, .. } = self;
        walker.next().map_err(|source| Error::Io { path: path.clone(), doing: "reading the session", source })
    }

    /// Scans the records of a chunk with a valid checksum: collects its topics, and checks its
    /// stated times.
    fn enter(&mut self, at: u64, times: [u64; 2]) {
        (self.chunk, self.at, self.in_chunk) = (at, 0, true);
        let records = self.walker.records();
        let (mut rest, mut met) = (records, [u64::MAX, 0]);
        let mut is_sound = true;
        while let Some((kind, body, after)) = record(rest) {
            rest = after;
            match kind {
                op::SCHEMA | op::CHANNEL => match record::parse(kind, body) {
                    Some(Record::Schema { header, .. }) => drop(self.schemas.insert(header.id, header.name)),
                    // A channel whose schema was in a lost chunk is in the table that follows.
                    Some(Record::Channel(channel)) => {
                        if let Some(schema) = self.schemas.get(&channel.schema_id) {
                            add(&mut self.channels, channel.id, &channel.topic, schema);
                        }
                    }
                    _ => is_sound = false,
                },
                CHANNELS => is_sound &= add_table(&mut self.channels, body).is_ok(),
                op::MESSAGE => match message(body) {
                    Some((header, bytes)) => {
                        met = [met[0].min(header.log_time), met[1].max(header.log_time)];
                        let channel = self.channels.get(&header.channel_id);
                        is_sound &= channel.is_some();
                        if self.about == About::default()
                            && channel.is_some_and(|channel| channel.schema == schema::SESSION.name)
                        {
                            self.about = About::read(bytes).unwrap_or_default();
                        }
                    }
                    None => is_sound = false,
                },
                _ => is_sound = false,
            }
        }
        let until = at + 49 + records.len() as u64;
        if !rest.is_empty() || !is_sound {
            let what = "a chunk with unknown records, or of another program";
            self.damage = Some(Damage { from: at, until, what, is_loss: true });
        } else if met[0] <= met[1] && met != times {
            let what = "a chunk whose header has other times than its messages; no message is concerned";
            self.damage = Some(Damage { from: at, until, what, is_loss: false });
        }
    }

    /// Returns the next message, or an unreadable part; `None` at the end.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read.
    pub fn next_event(&mut self) -> Result<Option<Event<'_>>, Error> {
        let (header, at) = loop {
            if let Some(damage) = self.first.pop().or_else(|| self.damage.take()) {
                return Ok(Some(Event::Damage(damage)));
            }
            if self.in_chunk {
                if let Some(found) = self.message() {
                    break found;
                }
                self.in_chunk = false;
            }
            match self.piece()? {
                Piece::Chunk { at, times } => self.enter(at, times),
                Piece::Damage(damage) => return Ok(Some(Event::Damage(damage))),
                Piece::End { finished } => {
                    self.ending = Some(if finished { Ending::Finished } else { Ending::BrokenOff });
                    return Ok(None);
                }
            }
        };
        let (channel, bytes) = (self.channels.get(&header.channel_id), &self.walker.records()[at]);
        Ok(channel.map(|channel| Event::Message(Message { channel, header, bytes })))
    }

    /// Returns the chunk's next message with a known channel, and its position.
    fn message(&mut self) -> Option<(MessageHeader, std::ops::Range<usize>)> {
        loop {
            let (kind, body, _) = record(&self.walker.records()[self.at..])?;
            let found = if kind == op::MESSAGE { message(body) } else { None };
            let length = found.map(|(_, bytes)| bytes.len());
            self.at += 9 + body.len();
            if let (Some((header, _)), Some(length)) = (found, length)
                && let Some(channel) = self.channels.get_mut(&header.channel_id)
            {
                channel.count(header.sequence);
                return Some((header, self.at - length..self.at));
            }
        }
    }
}

/// Splits off the first record: its kind, its content, and the rest.
fn record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (kind, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (body, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    Some((*kind, body, rest))
}

fn message(body: &[u8]) -> Option<(MessageHeader, &[u8])> {
    let (channel_id, rest) = body.split_first_chunk()?;
    let (sequence, rest) = rest.split_first_chunk()?;
    let (log_time, rest) = rest.split_first_chunk()?;
    let (publish_time, bytes) = rest.split_first_chunk()?;
    let header = MessageHeader {
        channel_id: u16::from_le_bytes(*channel_id),
        sequence: u32::from_le_bytes(*sequence),
        log_time: u64::from_le_bytes(*log_time),
        publish_time: u64::from_le_bytes(*publish_time),
    };
    Some((header, bytes))
}

fn add(channels: &mut HashMap<u16, Channel>, id: u16, topic: &str, schema: &str) {
    channels.entry(id).or_insert_with(|| Channel {
        topic: topic.to_owned(),
        schema: schema.to_owned(),
        known: Schema::of(schema),
        messages: 0,
        missing: 0,
        next: None,
    });
}

/// Reads the table of channels at the beginning of a chunk.
fn add_table(channels: &mut HashMap<u16, Channel>, body: &[u8]) -> Result<(), Malformed> {
    for entry in Fields(body) {
        let (mut id, mut topic, mut schema) = (0, "", "");
        for field in Fields(entry?.1.bytes()?) {
            match field? {
                (1, value) => id = value.small()?,
                (2, value) => topic = value.text()?,
                (3, value) => schema = value.text()?,
                _ => {}
            }
        }
        add(channels, id, topic, schema);
    }
    Ok(())
}

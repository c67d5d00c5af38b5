//! Reads a session's file record by record, also after damage.
//!
//! A chunk is accepted only if its lengths agree with each other and its checksum matches.
//! After an invalid record, the next chunk is searched byte by byte. The bytes in between are
//! reported as damage; nothing is skipped silently. At the end the checksums of the whole file
//! are compared, too.

use std::io::{self, Read, Seek, SeekFrom};

use mcap::records::{Record, op};

use crate::session::{PROFILE, record};

/// Size of a record's number and length, bytes.
const HEAD: u64 = 9;
/// Size of a chunk's header, bytes: two times, size, checksum, the (empty) name of a
/// compression, size.
const CHUNK_HEAD: usize = 40;
/// Size of the last record and the end, bytes: number and length, two positions and a checksum,
/// magic.
const FOOT: u64 = HEAD + 20 + 8;
/// Bytes searched at a time.
const WINDOW: usize = 64 << 10;
/// Largest record that is no chunk, bytes: the index of a chunk of a million messages.
const MOST_OTHER: u64 = 16 << 20;

/// A damaged part of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Damage {
    /// First damaged byte.
    pub from: u64,
    /// End, exclusive.
    pub until: u64,
    /// Kind of damage.
    pub what: &'static str,
    /// Whether messages may be missing because of the damage.
    pub is_loss: bool,
}

/// Next piece of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Piece {
    /// A whole chunk: its records are in [`Walker::records`].
    Chunk {
        /// Position of the chunk.
        at: u64,
        /// First and last time of its messages, as stated in its header.
        times: [u64; 2],
    },
    /// A damaged part.
    Damage(Damage),
    /// The end of the file.
    End {
        /// Whether the file was finished with its index, so that no written data is missing.
        finished: bool,
    },
}

/// Result of reading a record.
enum Step {
    Piece(Piece),
    /// A record without relevance for a reader.
    Other,
    /// Invalid: the next chunk must be searched.
    Lost(&'static str),
    /// Invalid, but with a known end.
    Bad(&'static str, u64),
}

/// A file, and the reading position.
pub(super) struct Walker<R> {
    file: R,
    length: u64,
    position: u64,
    most_bytes: u64,
    buffer: Vec<u8>,
    sum: crc32fast::Hasher,
    /// Nothing was damaged so far, so that the checksum of the whole file can be compared.
    is_whole: bool,
    /// Begin and kind of unfinished damage.
    damage: Option<(u64, &'static str)>,
    begun: bool,
    ended: Option<bool>,
    /// Profile and library of the writer, from the file's first record.
    pub(super) header: Option<[String; 2]>,
}

fn number(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_le_bytes)
}

fn short(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..at + 4).and_then(|bytes| bytes.try_into().ok()).map_or(0, u32::from_le_bytes)
}

/// Returns the length of a chunk's record if `bytes` is a valid beginning of one: number,
/// length, header.
fn begins_chunk(bytes: &[u8]) -> Option<u64> {
    let (length, inner) = (number(bytes, 1), bytes.get(9..9 + CHUNK_HEAD)?);
    let size = length.checked_sub(CHUNK_HEAD as u64)?;
    // The size limit exceeds any file, and cannot overflow when added to a position.
    let agrees = bytes[0] == op::CHUNK
        && size < 1 << 48
        && number(inner, 16) == size
        && number(inner, 32) == size
        && short(inner, 28) == 0
        && number(inner, 0) <= number(inner, 8);
    agrees.then(|| HEAD + length)
}

impl<R: Read + Seek> Walker<R> {
    /// Starts at the beginning of a file of that length; no chunk is larger than `most_bytes`.
    pub(super) fn new(file: R, length: u64, most_bytes: u64) -> Self {
        Self {
            file,
            length,
            position: 0,
            most_bytes,
            buffer: Vec::new(),
            sum: crc32fast::Hasher::new(),
            is_whole: true,
            damage: None,
            begun: false,
            ended: None,
            header: None,
        }
    }

    /// Returns the records of the last chunk.
    pub(super) fn records(&self) -> &[u8] {
        self.buffer.get(CHUNK_HEAD..).unwrap_or(&[])
    }

    /// Returns the next piece.
    pub(super) fn next(&mut self) -> io::Result<Piece> {
        if let Some(finished) = self.ended {
            return Ok(Piece::End { finished });
        }
        if !self.begun {
            self.begun = true;
            let mut magic = [0; 8];
            let there = self.length.min(8) as usize;
            self.file.read_exact(&mut magic[..there])?;
            self.sum.update(&magic[..there]);
            self.position = there as u64;
            if magic != mcap::MAGIC {
                self.begin_damage(0, "the beginning of an MCAP file is missing");
                self.position = 0;
                self.find_chunk(0)?;
            }
        }
        loop {
            let at = self.position;
            // A chunk or the end of the file completes the damage before it.
            let step =
                if self.position >= self.length { Step::Piece(Piece::End { finished: false }) } else { self.step()? };
            match step {
                Step::Other => {}
                Step::Lost(what) => {
                    self.begin_damage(at, what);
                    self.find_chunk(at + 1)?;
                }
                Step::Bad(what, until) => {
                    self.begin_damage(at, what);
                    self.go_to(until)?;
                }
                Step::Piece(piece) => {
                    if let Piece::End { finished } = piece {
                        self.ended = Some(finished);
                    }
                    let Some((from, what)) = self.damage.take() else { return Ok(piece) };
                    // The piece is returned again after the damage.
                    self.position = at;
                    if self.ended.is_none() {
                        self.go_to(at)?;
                    }
                    return Ok(Piece::Damage(Damage { from, until: at, what, is_loss: true }));
                }
            }
        }
    }

    /// Continues at the beginning of an earlier chunk. Disables the checksum of the whole file,
    /// which needs each byte exactly once.
    pub(super) fn return_to(&mut self, chunk: u64) -> io::Result<()> {
        (self.begun, self.is_whole, self.damage, self.ended) = (true, false, None, None);
        self.go_to(chunk)
    }

    fn begin_damage(&mut self, at: u64, what: &'static str) {
        self.is_whole = false;
        self.damage.get_or_insert((at, what));
    }

    fn go_to(&mut self, place: u64) -> io::Result<()> {
        self.position = place;
        self.file.seek(SeekFrom::Start(place)).map(drop)
    }

    /// Reads this many bytes and appends them to the buffer.
    fn fill(&mut self, bytes: u64) -> io::Result<()> {
        let before = self.buffer.len();
        self.buffer.resize(before + bytes as usize, 0);
        self.file.read_exact(&mut self.buffer[before..])?;
        self.position += bytes;
        Ok(())
    }

    /// Reads one record.
    fn step(&mut self) -> io::Result<Step> {
        let at = self.position;
        let left = self.length - at;
        if left < HEAD {
            return Ok(Step::Lost("an incomplete record"));
        }
        self.buffer.clear();
        self.fill(HEAD)?;
        let (kind, length) = (self.buffer[0], number(&self.buffer, 1));
        if length > left - HEAD {
            return Ok(Step::Lost(if kind == op::CHUNK { "an incomplete chunk" } else { "bytes that are no record" }));
        }
        match kind {
            op::CHUNK if length > self.most_bytes => Ok(Step::Lost("a chunk larger than the limit")),
            op::CHUNK => self.chunk(at, length),
            op::DATA_END if length == 4 => self.end(at),
            op::HEADER | op::METADATA | op::MESSAGE_INDEX if length <= MOST_OTHER => {
                let head: [u8; 9] = self.buffer[..].try_into().unwrap_or_default();
                self.buffer.clear();
                self.fill(length)?;
                if !self.is_sound(at, kind) {
                    return Ok(Step::Lost("a record that sessions do not have"));
                }
                self.sum.update(&head);
                self.sum.update(&self.buffer);
                Ok(Step::Other)
            }
            _ => Ok(Step::Lost("a record that sessions do not have")),
        }
    }

    /// Returns whether a record other than a chunk is valid.
    fn is_sound(&mut self, at: u64, kind: u8) -> bool {
        let body = &self.buffer[..];
        if kind == op::MESSAGE_INDEX {
            return body.len() >= 6 && u64::from(short(body, 2)) == body.len() as u64 - 6;
        }
        match record::parse(kind, body) {
            Some(Record::Header(header)) if at == 8 => {
                let length = 8 + header.profile.len() + header.library.len();
                let is_ours = header.profile == PROFILE && length == body.len();
                self.header = Some([header.profile, header.library]);
                is_ours
            }
            Some(Record::Metadata(metadata)) => {
                let entries = metadata.metadata.iter().map(|(name, text)| 8 + name.len() + text.len());
                let length = 8 + metadata.name.len() + entries.sum::<usize>();
                metadata.name == PROFILE && length == body.len()
            }
            _ => false,
        }
    }

    fn chunk(&mut self, at: u64, length: u64) -> io::Result<Step> {
        if length < CHUNK_HEAD as u64 {
            return Ok(Step::Lost("a chunk without a header"));
        }
        self.fill(CHUNK_HEAD as u64)?;
        if begins_chunk(&self.buffer).is_none() {
            return Ok(Step::Lost("a chunk with a contradictory header, or of another program"));
        }
        let head: [u8; 9] = self.buffer[..9].try_into().unwrap_or_default();
        self.buffer.drain(..9);
        self.fill(length - CHUNK_HEAD as u64)?;
        let stored = short(&self.buffer, 24);
        if crc32fast::hash(self.records()) != stored {
            return Ok(Step::Bad("a chunk with a wrong checksum", self.position));
        }
        self.sum.update(&head);
        self.sum.update(&self.buffer);
        Ok(Step::Piece(Piece::Chunk { at, times: [number(&self.buffer, 0), number(&self.buffer, 8)] }))
    }

    /// Reads the end of the data: an index of the records follows, of which only the checksum
    /// is checked.
    fn end(&mut self, at: u64) -> io::Result<Step> {
        self.buffer.clear();
        self.fill(4)?;
        let stored = short(&self.buffer, 0);
        let data_fits = !self.is_whole || stored == self.sum.clone().finalize();
        let mut left = self.length - self.position;
        if left < FOOT {
            return Ok(Step::Lost("an incomplete index"));
        }
        let mut sum = crc32fast::Hasher::new();
        // Everything but the checksum and the magic after it.
        left -= 12;
        while left > 0 {
            self.buffer.clear();
            self.fill(left.min(WINDOW as u64))?;
            sum.update(&self.buffer);
            left -= self.buffer.len() as u64;
        }
        self.buffer.clear();
        self.fill(12)?;
        let fits = short(&self.buffer, 0) == sum.finalize() && self.buffer[4..] == *mcap::MAGIC;
        if data_fits && fits {
            return Ok(Step::Piece(Piece::End { finished: true }));
        }
        self.ended = Some(true);
        let what = match data_fits {
            true => "a damaged index; no message is affected",
            false => "a damaged index between chunks; no message is affected",
        };
        let from = if data_fits { at } else { 0 };
        Ok(Step::Piece(Piece::Damage(Damage { from, until: self.length, what, is_loss: false })))
    }

    /// Moves to the next position where a chunk may begin, or to the end.
    fn find_chunk(&mut self, from: u64) -> io::Result<()> {
        self.go_to(from)?;
        let least = HEAD as usize + CHUNK_HEAD;
        loop {
            let at = self.position;
            let window = (self.length - at).min(WINDOW as u64);
            if window < least as u64 {
                return self.go_to(self.length);
            }
            self.buffer.clear();
            self.fill(window)?;
            let places = 0..=self.buffer.len() - least;
            let is_one = |place: &usize| {
                let length = begins_chunk(&self.buffer[*place..]);
                length.is_some_and(|length| {
                    length <= self.most_bytes + HEAD && at + *place as u64 + length <= self.length
                })
            };
            if let Some(place) = places.into_iter().find(is_one) {
                return self.go_to(at + place as u64);
            }
            // A chunk may begin in the last bytes of this window.
            self.go_to(at + (self.buffer.len() - least + 1) as u64)?;
        }
    }
}

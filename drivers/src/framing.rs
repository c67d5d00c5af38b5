//! Splits a byte stream, received in arbitrary pieces, into records with their positions in the
//! stream.
//!
//! A wire format implements [`Format`], which examines the bytes in front of it and has no side
//! effects. A [`Decoder`] passes it the stream in the pieces that the transport delivers. The
//! decoder keeps incomplete records and counts skipped bytes. This module uses no clock and no
//! transport. Each record carries its position in the stream; a driver that knows each byte's
//! arrival time derives the time of the record's first byte.
//!
//! The same bytes give the same records, positions and counts, however they are divided. The
//! decoder allocates only when it is created; it buffers at most two windows of its format.

use std::ops::Range;

/// Examines the bytes at the front of a stream.
///
/// The result for a window must not change when more bytes follow it, unless it was
/// [`Parsed::Short`]. A window of [`window`](Self::window) bytes is never short. The state must
/// not change on a short window.
pub trait Format: 'static {
    /// Content of a record; may borrow from the bytes read, and from the format, which keeps
    /// the last record's values.
    type Record<'a>;

    /// Returns the largest number of bytes needed to judge the record at a position.
    fn window(&self) -> usize;

    /// Returns the resynchronisation length, bytes. After garbage, every record that ends later
    /// than this many good bytes is found, and nothing else.
    fn lock_bytes(&self) -> usize;

    /// Judges the record that begins at the first byte of `window`, which is not empty.
    fn parse<'a>(&'a mut self, window: &'a [u8]) -> Parsed<Self::Record<'a>>;

    /// Notifies the format that the stream was interrupted: state learnt from earlier bytes is
    /// no longer valid.
    fn interrupted(&mut self) {}
}

/// Result of judging the front of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Parsed<R> {
    /// A complete record.
    Record {
        /// Its length in bytes, at least 1.
        length: usize,
        /// Its content.
        record: R,
    },
    /// Possibly a record: more bytes are needed.
    Short,
    /// No record: the first `bytes` bytes belong to none.
    Skip {
        /// Number of bytes to skip, at least 1.
        bytes: usize,
        /// Reason.
        why: Refusal,
    },
}

impl<R> Parsed<R> {
    /// Skips one byte: no record begins with it, but the next byte may begin one.
    pub const fn skip_byte(why: Refusal) -> Self {
        Self::Skip { bytes: 1, why }
    }

    /// Converts the record and keeps everything else.
    #[inline]
    pub fn map<S>(self, change: impl FnOnce(R) -> S) -> Parsed<S> {
        match self {
            Self::Record { length, record } => Parsed::Record { length, record: change(record) },
            Self::Short => Parsed::Short,
            Self::Skip { bytes, why } => Parsed::Skip { bytes, why },
        }
    }
}

/// Reason why bytes were not accepted as a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// No record of this format begins with such a byte. Counted in bytes only.
    Noise,
    /// A header that the device cannot have sent: an unknown station, type or tag.
    Header,
    /// A length that contradicts the settings, or a missing end.
    Length,
    /// A field that cannot be parsed.
    Field,
    /// Values beyond the device's range, or an invalid orientation.
    Range,
    /// A wrong checksum.
    Checksum,
    /// Well-formed, but not followed by a second record while the decoder was synchronising.
    Unconfirmed,
}

impl Refusal {
    /// All reasons.
    pub const ALL: [Self; 7] =
        [Self::Noise, Self::Header, Self::Length, Self::Field, Self::Range, Self::Checksum, Self::Unconfirmed];
}

/// Counts of data that a decoder could not use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Bytes that belong to no record.
    pub bytes_skipped: u64,
    refused: [u64; Refusal::ALL.len()],
}

impl Losses {
    /// Returns how many candidate records were refused for this reason. Always 0 for
    /// [`Refusal::Noise`].
    pub fn refused(&self, why: Refusal) -> u64 {
        self.refused[why as usize]
    }

    /// Returns how many candidate records were refused.
    pub fn refusals(&self) -> u64 {
        self.refused.iter().sum()
    }

    fn count(&mut self, bytes: usize, why: Refusal) {
        self.bytes_skipped += bytes as u64;
        if why != Refusal::Noise {
            self.refused[why as usize] += 1;
        }
    }
}

/// Reads records of one format from a stream.
#[derive(Debug)]
pub struct Decoder<F> {
    format: F,
    window: usize,
    /// Bytes of the stream not yet judged; fewer than two windows.
    held: Vec<u8>,
    /// Position in the stream of the first byte not yet judged.
    position: u64,
    losses: Losses,
}

impl<F: Format> Decoder<F> {
    /// Creates a decoder at the beginning of its stream.
    pub fn new(format: F) -> Self {
        let window = format.window();
        Self { format, window, held: Vec::with_capacity(2 * window), position: 0, losses: Losses::default() }
    }

    /// Takes the next bytes of the stream and passes each record to `found`. The range is the
    /// record's position, in bytes from the beginning of the stream, end exclusive.
    pub fn feed(&mut self, bytes: &[u8], found: &mut impl FnMut(F::Record<'_>, Range<u64>)) {
        let mut fresh = bytes;
        if !self.held.is_empty() {
            // A record that begins in the held bytes may end in the fresh ones, within one
            // window.
            let held = self.held.len();
            let joined = fresh.len().min(2 * self.window - held);
            self.held.extend_from_slice(&fresh[..joined]);
            let judged =
                judge(&mut self.format, self.window, &self.held, held, &mut self.position, &mut self.losses, found);
            if judged < held {
                self.held.copy_within(judged.., 0);
                self.held.truncate(self.held.len() - judged);
                return;
            }
            fresh = &fresh[judged - held..];
            self.held.clear();
        }
        let judged =
            judge(&mut self.format, self.window, fresh, fresh.len(), &mut self.position, &mut self.losses, found);
        self.held.extend_from_slice(&fresh[judged..]);
    }

    /// Returns the losses since the decoder was created.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Returns the position in the stream of the next byte to be fed.
    pub fn position(&self) -> u64 {
        self.position + self.held.len() as u64
    }

    /// Returns the number of bytes that wait for more.
    pub fn pending(&self) -> usize {
        self.held.len()
    }

    /// See [`Format::lock_bytes`].
    pub fn lock_bytes(&self) -> usize {
        self.format.lock_bytes()
    }

    /// Returns the format, with the state it has learnt.
    pub fn format(&self) -> &F {
        &self.format
    }

    /// Handles an interrupted stream (silence, a reopened port): pending bytes are discarded
    /// and counted.
    pub fn interrupt(&mut self) {
        if !self.held.is_empty() {
            self.losses.count(self.held.len(), Refusal::Length);
            self.position += self.held.len() as u64;
            self.held.clear();
        }
        self.format.interrupted();
    }

    /// Changes the format from here on, after the device received other settings; positions and
    /// counts continue.
    pub fn reformat(&mut self, format: F) {
        self.interrupt();
        self.window = format.window();
        self.format = format;
        self.held.reserve(2 * self.window);
    }
}

/// Judges records that begin in the first `begin_before` of `bytes`; returns how many bytes are
/// done with.
#[inline]
fn judge<F: Format>(
    format: &mut F,
    window: usize,
    bytes: &[u8],
    begin_before: usize,
    position: &mut u64,
    losses: &mut Losses,
    found: &mut impl FnMut(F::Record<'_>, Range<u64>),
) -> usize {
    let mut at = 0;
    while at < begin_before {
        let done = match format.parse(&bytes[at..]) {
            Parsed::Record { length, record } => {
                let from = *position + at as u64;
                found(record, from..from + length as u64);
                length
            }
            Parsed::Skip { bytes: skipped, why } => {
                losses.count(skipped, why);
                skipped
            }
            Parsed::Short => {
                debug_assert!(bytes.len() - at < window, "a whole window of {window} bytes was too short to judge");
                if bytes.len() - at < window {
                    break;
                }
                losses.count(1, Refusal::Length);
                1
            }
        };
        debug_assert!((1..=bytes.len() - at).contains(&done), "{done} of {} bytes", bytes.len() - at);
        at += done.max(1);
    }
    *position += at as u64;
    at
}

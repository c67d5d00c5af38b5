//! From a stream of bytes, cut anywhere, to records with their place in the stream.
//!
//! A wire format is a [`Format`]: a pure judge of the bytes in front of it. A [`Decoder`] gives it the stream in whatever pieces the transport
//! delivers, holds back what is not yet a whole record, and counts what had to be skipped. There is no clock and no transport here: a record
//! comes with its position in the stream, from which a driver that knows when which byte arrived derives the time of its first byte.
//!
//! The same bytes give the same records, positions and counts however they are cut. Nothing is allocated after a decoder was made, and what it
//! holds never exceeds two windows of its format.

use std::ops::Range;

/// Judges bytes at the front of a stream.
///
/// The answer to a window must not change when more bytes follow it, unless it was [`Look::Short`]; and a window of [`window`](Self::window)
/// bytes is never short. On a short window the state must stay as it was.
pub trait Format: 'static {
    /// What a record says; may borrow from the bytes it was read from, and from the format where the numbers of the last record stay.
    type Record<'a>;

    /// As many bytes as it can take at most to judge what begins at a byte.
    fn window(&self) -> usize;

    /// When garbage is followed by good bytes, every record that ends later than this many good bytes is found, and nothing else.
    fn lock_bytes(&self) -> usize;

    /// Judges what begins at the first byte of `window`, which is not empty.
    fn look<'a>(&'a mut self, window: &'a [u8]) -> Look<Self::Record<'a>>;

    /// The stream broke off: what was learnt from the bytes before it no longer holds.
    fn interrupted(&mut self) {}
}

/// What begins at the front of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Look<R> {
    /// A whole record.
    Record {
        /// Its bytes, at least 1.
        length: usize,
        /// What it says.
        record: R,
    },
    /// Perhaps a record: more bytes will tell.
    Short,
    /// No record: so many bytes, at least 1, belong to none.
    Skip {
        /// How many.
        bytes: usize,
        /// Why.
        why: Refusal,
    },
}

impl<R> Look<R> {
    /// No record begins with this byte: the next may be the first of one.
    pub const fn skip_byte(why: Refusal) -> Self {
        Self::Skip { bytes: 1, why }
    }

    /// The same of a record made from this one.
    #[inline]
    pub fn map<S>(self, change: impl FnOnce(R) -> S) -> Look<S> {
        match self {
            Self::Record { length, record } => Look::Record { length, record: change(record) },
            Self::Short => Look::Short,
            Self::Skip { bytes, why } => Look::Skip { bytes, why },
        }
    }
}

/// Why bytes were not taken as a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// No record of this format begins with such a byte. Counted in bytes only.
    Noise,
    /// A header that the device cannot have sent: an unknown station, type or tag.
    Header,
    /// A length other than the one that the settings lead to, or no end where there has to be one.
    Length,
    /// A field that does not read as what it should be.
    Field,
    /// Numbers beyond what the device can measure, or an orientation that is none.
    Range,
    /// A checksum that does not fit.
    Checksum,
    /// Well-formed, but not followed by a second record, while the decoder was still looking for the beginning of one.
    Unconfirmed,
}

impl Refusal {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Noise, Self::Header, Self::Length, Self::Field, Self::Range, Self::Checksum, Self::Unconfirmed];
}

/// What a decoder could not use.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Bytes that belong to no record.
    pub bytes_skipped: u64,
    refused: [u64; Refusal::ALL.len()],
}

impl Losses {
    /// How many times what began like a record was refused for this reason. Always 0 for [`Refusal::Noise`].
    pub fn refused(&self, why: Refusal) -> u64 {
        self.refused[why as usize]
    }

    /// How many times what began like a record was refused.
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
    /// Bytes of the stream that are not judged yet; fewer than two windows.
    held: Vec<u8>,
    /// Position in the stream of the first byte that is not judged yet.
    position: u64,
    losses: Losses,
}

impl<F: Format> Decoder<F> {
    /// A decoder at the beginning of its stream.
    pub fn new(format: F) -> Self {
        let window = format.window();
        Self { format, window, held: Vec::with_capacity(2 * window), position: 0, losses: Losses::default() }
    }

    /// Takes the next bytes of the stream and gives each record found, with the positions, counted in bytes from the beginning of the
    /// stream, of its first byte and of the one behind its last.
    pub fn feed(&mut self, bytes: &[u8], found: &mut impl FnMut(F::Record<'_>, Range<u64>)) {
        let mut fresh = bytes;
        if !self.held.is_empty() {
            // What begins in the bytes held may end in the fresh ones, within a window.
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

    /// What could not be used since the decoder was made.
    pub fn losses(&self) -> Losses {
        self.losses
    }

    /// Position in the stream of the next byte to be fed.
    pub fn position(&self) -> u64 {
        self.position + self.held.len() as u64
    }

    /// Bytes that wait for more.
    pub fn pending(&self) -> usize {
        self.held.len()
    }

    /// See [`Format::lock_bytes`].
    pub fn lock_bytes(&self) -> usize {
        self.format.lock_bytes()
    }

    /// The format, as it was given and with what it has learnt.
    pub fn format(&self) -> &F {
        &self.format
    }

    /// The stream broke off (silence, a port opened again): bytes that waited for more are given up and counted.
    pub fn interrupt(&mut self) {
        if !self.held.is_empty() {
            self.losses.count(self.held.len(), Refusal::Length);
            self.position += self.held.len() as u64;
            self.held.clear();
        }
        self.format.interrupted();
    }

    /// From here on the stream has another format (the device was given other settings): positions and counts go on.
    pub fn reformat(&mut self, format: F) {
        self.interrupt();
        self.window = format.window();
        self.format = format;
        self.held.reserve(2 * self.window);
    }
}

/// Judges what begins in the first `begin_before` of `bytes`; returns how many bytes are done with.
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
        let done = match format.look(&bytes[at..]) {
            Look::Record { length, record } => {
                let from = *position + at as u64;
                found(record, from..from + length as u64);
                length
            }
            Look::Skip { bytes: skipped, why } => {
                losses.count(skipped, why);
                skipped
            }
            Look::Short => {
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

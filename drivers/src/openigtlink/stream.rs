//! Splits a byte stream into messages.
//!
//! TCP loses nothing, so a stream is either synchronised or its sender is faulty. A damaged or
//! invalid message is refused, and the next one is read after it: its header gives the position.
//! A header that no message has ([`Fault::Header`]), or one with an excessive size, breaks the
//! stream. Nothing after it can be recognised as a beginning, so the reader closes the
//! connection.

use std::ops::Range;

use super::cursor::{Fault, Trouble};
use super::header::{CHECK_SENDER, HEADER, Header, checksum};
use super::message::Message;

/// Size limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Maximum bytes of a body that is read; a larger one is skipped without storing it.
    pub body: u64,
    /// Maximum bytes of a body that is skipped; a larger size breaks the stream.
    pub passed: u64,
}

impl Default for Limits {
    /// Returns the limits for images: reads up to 256 MiB, skips up to 4 GiB.
    fn default() -> Self {
        Self { body: 1 << 28, passed: 1 << 32 }
    }
}

impl Limits {
    /// Limits for requests and commands: reads up to 64 KiB; skips an image of up to 256 MiB.
    pub const SMALL: Self = Self { body: 1 << 16, passed: 1 << 28 };
}

/// A refused message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{kind} of {device:?} at byte {at} of the stream, byte {offset} of the message: {problem}")]
pub struct Refused {
    /// Position of the message's first byte in the stream.
    pub at: u64,
    /// Position of the error in the message, bytes.
    pub offset: usize,
    /// Type name, or `a message`.
    pub kind: String,
    /// Device name of the sender, if known.
    pub device: String,
    /// Kind of error.
    pub fault: Fault,
    /// The problem and the remedy.
    pub problem: String,
}

/// Result of reading a stream.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A message, and its range of bytes in the stream.
    Message(Box<Message>, Range<u64>),
    /// A refused message.
    Refused(Refused),
}

#[derive(Debug, Clone)]
enum Stage {
    /// A header, with this many bytes received.
    Header(usize),
    /// A body that is read.
    Body(Header),
    /// A body with this many bytes left to skip.
    Passing(Header, u64),
    Broken(Refused),
}

/// Reads messages from a stream.
#[derive(Debug, Clone)]
pub struct Decoder {
    limits: Limits,
    stage: Stage,
    header: [u8; HEADER],
    /// Body read so far: never more than was received, nor than the limit.
    body: Vec<u8>,
    /// Bytes of the stream before the current message.
    at: u64,
    skipped: u64,
    refused: u64,
}

/// A larger body buffer is freed after its message, bytes.
const KEPT: usize = 1 << 24;

impl Decoder {
    /// Creates a decoder at the beginning of a stream.
    pub fn new(limits: Limits) -> Self {
        Self { limits, stage: Stage::Header(0), header: [0; HEADER], body: Vec::new(), at: 0, skipped: 0, refused: 0 }
    }

    /// Returns the bytes of refused messages, and those behind a header that broke the stream.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Returns the number of refused messages.
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// Returns the bytes that wait for more; a skipped body has none.
    pub fn pending(&self) -> usize {
        match &self.stage {
            Stage::Header(here) => *here,
            Stage::Body(_) => HEADER + self.body.len(),
            Stage::Passing(..) => HEADER,
            Stage::Broken(_) => 0,
        }
    }

    /// Takes the next bytes of the stream and passes the events to `found`, in order.
    ///
    /// # Errors
    /// The reason why the stream is broken, now or earlier: it gives no more events and must be
    /// closed.
    pub fn feed(&mut self, mut bytes: &[u8], found: &mut impl FnMut(Event)) -> Result<(), Refused> {
        loop {
            match &mut self.stage {
                Stage::Broken(why) => {
                    self.skipped += bytes.len() as u64;
                    return Err(why.clone());
                }
                Stage::Header(here) => {
                    let taken = bytes.len().min(HEADER - *here);
                    self.header[*here..*here + taken].copy_from_slice(&bytes[..taken]);
                    *here += taken;
                    bytes = &bytes[taken..];
                    if *here < HEADER {
                        return Ok(());
                    }
                    self.begin(found);
                }
                Stage::Body(header) => {
                    let header = *header;
                    // At most the limit, which is already checked.
                    let left = header.body as usize - self.body.len();
                    let taken = bytes.len().min(left);
                    if taken == left && self.body.is_empty() {
                        self.finish(&header, &bytes[..taken], found);
                    } else {
                        self.body.extend_from_slice(&bytes[..taken]);
                        if taken < left {
                            return Ok(());
                        }
                        let mut body = std::mem::take(&mut self.body);
                        self.finish(&header, &body, found);
                        body.clear();
                        if body.capacity() <= KEPT {
                            self.body = body;
                        }
                    }
                    bytes = &bytes[taken..];
                }
                Stage::Passing(header, left) => {
                    let taken = (bytes.len() as u64).min(*left);
                    *left -= taken;
                    // At most the available bytes.
                    bytes = &bytes[taken as usize..];
                    if *left > 0 {
                        return Ok(());
                    }
                    let header = *header;
                    self.stage = Stage::Header(0);
                    self.at += HEADER as u64 + header.body;
                }
            }
        }
    }

    /// Handles a complete header.
    fn begin(&mut self, found: &mut impl FnMut(Event)) {
        match Header::read(&self.header) {
            Err(trouble) => self.break_off(None, trouble),
            Ok(header) if header.body > self.limits.passed => {
                let (bytes, most) = (header.body, self.limits.passed);
                let problem = format!("the body's size is {bytes}, more than the limit of {most}; {CHECK_SENDER}");
                self.break_off(Some(&header), Trouble { fault: Fault::Header, offset: 42, problem });
            }
            Ok(header) if header.body > self.limits.body => {
                let (bytes, most) = (header.body, self.limits.body);
                let problem = format!("the body's size is {bytes}, more than the limit of {most}; send less");
                let trouble = Trouble { fault: Fault::TooLarge, offset: 42, problem };
                let refused = self.refuse(Some(&header), trouble, HEADER as u64 + header.body);
                found(Event::Refused(refused));
                self.stage = Stage::Passing(header, header.body);
            }
            Ok(header) => self.stage = Stage::Body(header),
        }
    }

    /// Handles a complete body.
    fn finish(&mut self, header: &Header, body: &[u8], found: &mut impl FnMut(Event)) {
        let length = (HEADER + body.len()) as u64;
        let made = checksum(body);
        let read = if made == header.checksum {
            Message::read(header, body)
        } else {
            let stated = header.checksum;
            let problem = format!("the checksum is {stated:016x}, but the body has {made:016x}; send it again");
            Err(Trouble { fault: Fault::Checksum, offset: 50, problem })
        };
        found(match read {
            Ok(message) => Event::Message(Box::new(message), self.at..self.at + length),
            Err(trouble) => Event::Refused(self.refuse(Some(header), trouble, length)),
        });
        self.at += length;
        self.stage = Stage::Header(0);
    }

    fn refuse(&mut self, header: Option<&Header>, trouble: Trouble, length: u64) -> Refused {
        self.refused += 1;
        self.skipped += length;
        Refused {
            at: self.at,
            offset: trouble.offset,
            kind: header.map_or_else(|| "a message".into(), |header| header.kind.to_string()),
            device: header.map_or_else(String::new, |header| header.device.to_string()),
            fault: trouble.fault,
            problem: trouble.problem,
        }
    }

    fn break_off(&mut self, header: Option<&Header>, trouble: Trouble) {
        let why = self.refuse(header, trouble, HEADER as u64);
        self.stage = Stage::Broken(why);
    }
}

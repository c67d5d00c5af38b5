//! From a stream to messages.
//!
//! TCP loses nothing, so that a stream is either in step or its sender is no good. A message that is damaged or makes no sense is refused and the next one is read behind
//! it: its header says where. A header that no message has ([`Fault::Header`]), or that says more than can be waited for, breaks the stream: nothing behind it can be
//! trusted to be the beginning of anything, and whoever reads it closes the connection.

use std::ops::Range;

use super::cursor::{Fault, Trouble};
use super::header::{HEADER, Header, checksum};
use super::message::Message;

/// How much is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of a body that is read; a larger one is passed over, and held nowhere.
    pub body: u64,
    /// Bytes of a body that is passed over; one that says more breaks the stream.
    pub passed: u64,
}

impl Default for Limits {
    /// For images: 256 MiB; 4 GiB are passed over.
    fn default() -> Self {
        Self { body: 1 << 28, passed: 1 << 32 }
    }
}

impl Limits {
    /// For questions and commands: 64 KiB; an image of 256 MiB is passed over.
    pub const SMALL: Self = Self { body: 1 << 16, passed: 1 << 28 };
}

/// A message that was not taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{kind} of {device:?} at byte {at} of the stream, byte {offset} of the message: {problem}")]
pub struct Refused {
    /// The message's first byte in the stream.
    pub at: u64,
    /// From there.
    pub offset: usize,
    /// The type's name, or `a message`.
    pub kind: String,
    /// Whose it is, as far as that is known.
    pub device: String,
    /// What kind of wrong.
    pub fault: Fault,
    /// What, and what to do.
    pub problem: String,
}

/// What a stream brings.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A message, and its bytes in the stream.
    Message(Box<Message>, Range<u64>),
    /// One that was not taken.
    Refused(Refused),
}

#[derive(Debug, Clone)]
enum Stage {
    /// A header, of which so many bytes are here.
    Header(usize),
    /// A body that is read.
    Body(Header),
    /// A body of which so many bytes are still to be passed over.
    Passing(Header, u64),
    Broken(Refused),
}

/// Reads messages from a stream.
#[derive(Debug, Clone)]
pub struct Decoder {
    limits: Limits,
    stage: Stage,
    header: [u8; HEADER],
    /// Of the body that is read: never more than came, nor than the limit.
    body: Vec<u8>,
    /// Bytes of the stream before the message that is read.
    at: u64,
    skipped: u64,
    refused: u64,
}

/// A body's buffer larger than this is given back after its message.
const KEPT: usize = 1 << 24;

impl Decoder {
    /// At the beginning of a stream.
    pub fn new(limits: Limits) -> Self {
        Self { limits, stage: Stage::Header(0), header: [0; HEADER], body: Vec::new(), at: 0, skipped: 0, refused: 0 }
    }

    /// Bytes of messages that were not taken, and those behind a header that broke the stream.
    pub const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Messages that were not taken.
    pub const fn refused(&self) -> u64 {
        self.refused
    }

    /// Bytes that wait for more; of a body that is passed over none.
    pub fn pending(&self) -> usize {
        match &self.stage {
            Stage::Header(here) => *here,
            Stage::Body(_) => HEADER + self.body.len(),
            Stage::Passing(..) => HEADER,
            Stage::Broken(_) => 0,
        }
    }

    /// Takes the next bytes of the stream and gives what is found, in order.
    ///
    /// # Errors
    /// What broke the stream, now or earlier: it brings nothing more, and is to be closed.
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
                    // No more than the limit, which was looked at.
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
                    // No more than there are.
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

    /// A header is here.
    fn begin(&mut self, found: &mut impl FnMut(Event)) {
        match Header::read(&self.header) {
            Err(trouble) => self.break_off(None, trouble),
            Ok(header) if header.body > self.limits.passed => {
                let problem = format!(
                    "the body's size is {}, and no more than {} can be; is this OpenIGTLink at all?",
                    header.body, self.limits.passed
                );
                self.break_off(Some(&header), Trouble { fault: Fault::Header, offset: 42, problem });
            }
            Ok(header) if header.body > self.limits.body => {
                let problem = format!(
                    "a body of {} bytes is more than the {} that are taken; send less",
                    header.body, self.limits.body
                );
                let trouble = Trouble { fault: Fault::TooLarge, offset: 42, problem };
                let refused = self.refuse(Some(&header), trouble, HEADER as u64 + header.body);
                found(Event::Refused(refused));
                self.stage = Stage::Passing(header, header.body);
            }
            Ok(header) => self.stage = Stage::Body(header),
        }
    }

    /// A body is here.
    fn finish(&mut self, header: &Header, body: &[u8], found: &mut impl FnMut(Event)) {
        let length = (HEADER + body.len()) as u64;
        let made = checksum(body);
        let read = if made == header.checksum {
            Message::read(header, body)
        } else {
            let problem = format!(
                "the checksum is {:016x}, and that of what came is {made:016x}; it was damaged on its way: send it again",
                header.checksum
            );
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

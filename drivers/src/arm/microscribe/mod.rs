//! MicroScribe-3D and the Immersion boxes before it: samples of encoders, and what is asked for before.
//!
//! | | |
//! |---|---|
//! | Clock | a timer of 14 bits, if samples are asked for with it |
//! | Tick | not documented |
//! | Wrap | 2¹⁴ ticks |
//! | Instant | not documented; the device samples when it is asked, so the time of asking is the better clock |
//!
//! Encoders have 14 bits and count from where the arm was when it was switched on: it has to rest in its home position then. A joint's angle
//! is its count · 2π / (its maximum + 1).
//!
//! In a sample no byte but the first has bit 7 set. Answers to questions of configuration are bytes of any value, led by the question itself; a
//! device never sends both at once, so that each has a format of its own: [`Samples`] and [`Answers`].

pub(super) mod unit;

pub use unit::Unit;

use crate::framing::{Format, Look, Refusal};

/// Most encoders of a device.
pub const MOST_ENCODERS: usize = 7;

/// Which family a device is of: they mean other numbers of encoders by the same request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// MicroScribe.
    MicroScribe,
    /// Immersion box.
    Box,
}

/// What a sample is to hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    byte: u8,
    encoders: usize,
}

impl Request {
    /// Of so many encoders (MicroScribe 5 to 7; box 2, 4 or 6), with the timer or without. `None` for a number that cannot be asked for.
    pub const fn new(family: Family, encoders: usize, timer: bool) -> Option<Self> {
        let code = match (family, encoders) {
            (Family::MicroScribe, 5) | (Family::Box, 2) => 0b01,
            (Family::MicroScribe, 7) | (Family::Box, 4) => 0b10,
            (Family::MicroScribe | Family::Box, 6) => 0b11,
            _ => return None,
        };
        Some(Self { byte: code | if timer { 0x20 } else { 0 }, encoders })
    }

    /// The byte to send for one sample.
    pub const fn byte(self) -> u8 {
        self.byte
    }

    const fn has_timer(self) -> bool {
        self.byte & 0x20 != 0
    }

    /// Bytes of a sample.
    pub const fn length(self) -> usize {
        2 + 2 * self.encoders + if self.has_timer() { 2 } else { 0 }
    }
}

/// What was sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Buttons and pedals, a bit each.
    pub buttons: u8,
    /// Ticks, if they were asked for; wrap at 2¹⁴.
    pub timer: Option<u16>,
    encoders: [u16; MOST_ENCODERS],
    count: usize,
}

impl Sample {
    /// A sample; of the encoders as many are taken as there can be.
    pub fn new(buttons: u8, timer: Option<u16>, encoders: &[u16]) -> Self {
        let mut sample =
            Self { buttons, timer, encoders: [0; MOST_ENCODERS], count: encoders.len().min(MOST_ENCODERS) };
        sample.encoders.iter_mut().zip(encoders).for_each(|(each, count)| *each = *count);
        sample
    }

    /// Counts of 14 bits, base first.
    pub fn encoders(&self) -> &[u16] {
        &self.encoders[..self.count]
    }

    /// Appends the sample as a device answers this request; encoders that it lacks are 0.
    pub fn write(&self, request: Request, to: &mut Vec<u8>) {
        to.extend([request.byte | 0x80, self.buttons & 0x7f]);
        let timer = request.has_timer().then(|| self.timer.unwrap_or(0));
        for value in timer.into_iter().chain(self.encoders[..request.encoders].iter().copied()) {
            to.extend([(value >> 7 & 0x7f) as u8, (value & 0x7f) as u8]);
        }
    }
}

/// Reads samples of one kind.
#[derive(Debug, Clone)]
pub struct Samples {
    request: Request,
}

impl Samples {
    /// Of a device that is asked by this request.
    pub fn new(request: Request) -> Self {
        Self { request }
    }
}

impl Format for Samples {
    type Record<'a> = Sample;

    fn window(&self) -> usize {
        self.request.length()
    }

    fn lock_bytes(&self) -> usize {
        3 * self.request.length()
    }

    #[inline]
    fn look(&mut self, window: &[u8]) -> Look<Sample> {
        if window[0] != self.request.byte | 0x80 {
            return Look::skip_byte(if window[0] < 0x80 { Refusal::Noise } else { Refusal::Header });
        }
        let length = self.request.length();
        let inside = &window[1..window.len().min(length)];
        if inside.iter().fold(0, |marks, byte| marks | byte) & 0x80 != 0 {
            // Cut off where the next begins.
            let before = inside.iter().position(|byte| byte & 0x80 != 0).unwrap_or(0);
            return Look::Skip { bytes: 1 + before, why: Refusal::Length };
        }
        let Some((buttons, values)) = inside.split_first().filter(|_| window.len() >= length) else {
            return Look::Short;
        };
        let (mut pairs, _) = values.as_chunks::<2>();
        let value = |[high, low]: [u8; 2]| u16::from(high) << 7 | u16::from(low);
        let mut sample =
            Sample { buttons: *buttons, timer: None, encoders: [0; MOST_ENCODERS], count: self.request.encoders };
        if self.request.has_timer() {
            sample.timer = pairs.first().copied().map(value);
            pairs = &pairs[1..];
        }
        sample.encoders.iter_mut().zip(pairs).for_each(|(each, pair)| *each = value(*pair));
        Look::Record { length, record: sample }
    }
}

/// Sent until the device notices the baud rate.
pub const WAKE: u8 = 0xc5;
/// Sent after it, and sent back by a device that listens.
pub const SIGNATURE: &[u8; 4] = b"IMMC";
/// Opens the session; the answer is the product's name.
pub const BEGIN: &[u8; 5] = b"BEGIN";

/// A question of configuration. The device sends its byte back, and the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Question {
    /// Parameters of the arm's links, led by their length.
    Parameters,
    /// Where the encoders are home. Firmware from 1996 on does not answer it any more.
    HomeReference,
    /// What the encoders count to.
    Maxima,
    /// Name of the product.
    Product,
    /// Its identification.
    Identity,
    /// Its model.
    Model,
    /// Its serial number.
    Serial,
    /// A comment.
    Comment,
    /// Name of the parameters' format.
    ParameterFormat,
    /// Version of the firmware.
    Version,
}

impl Question {
    /// The byte to send.
    pub const fn byte(self) -> u8 {
        match self {
            Self::Parameters => 0xc0,
            Self::HomeReference => 0xc1,
            Self::Maxima => 0xc6,
            Self::Product => 0xc8,
            Self::Identity => 0xc9,
            Self::Model => 0xca,
            Self::Serial => 0xcb,
            Self::Comment => 0xcc,
            Self::ParameterFormat => 0xcd,
            Self::Version => 0xce,
        }
    }
}

/// A command of configuration: the device sends its byte back and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Command {
    /// The encoders show from now on what they show at home, which is right in the rest position only. (0xC3 is another matter: it writes what they show at home to the
    /// device's memory, for good, and wants a password.)
    Home,
    /// Another baud rate, by its code: 0x00 115200, 0x01 57600, 0x02 28800, 0x03 14400, 0x10 38400, 0x11 19200, 0x12 9600.
    Baud(u8),
    /// Ends the session.
    End,
}

impl Command {
    /// The bytes to send.
    pub fn bytes(self) -> Vec<u8> {
        match self {
            Self::Home => vec![0xc2],
            Self::Baud(code) => vec![0xc4, code],
            Self::End => vec![0xc5],
        }
    }
}

/// What is waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Awaited {
    /// The [signature](SIGNATURE) sent back.
    Signature,
    /// The product's name after [`BEGIN`].
    ProductName,
    /// The answer to a question.
    Answer(Question),
    /// A command's byte sent back.
    Echo(Command),
}

/// Longest text.
const LONGEST_TEXT: usize = 128;

/// Reads answers while a session is set up: what is [awaited](Awaited), and nothing else. A record is what the answer holds, without echo, length or final zero.
#[derive(Debug, Clone)]
pub struct Answers {
    awaited: Awaited,
}

impl Answers {
    /// Of a device that is about to answer this.
    pub fn to(awaited: Awaited) -> Self {
        Self { awaited }
    }
}

impl Format for Answers {
    type Record<'a> = &'a [u8];

    fn window(&self) -> usize {
        // An echo, and the longest of text and parameters with their length.
        2 + 255
    }

    fn lock_bytes(&self) -> usize {
        2 * self.window()
    }

    fn look<'a>(&mut self, window: &'a [u8]) -> Look<&'a [u8]> {
        let echo = match self.awaited {
            Awaited::Signature => {
                return match window.iter().zip(SIGNATURE).all(|(byte, letter)| byte == letter) {
                    false => Look::skip_byte(Refusal::Noise),
                    true if window.len() < SIGNATURE.len() => Look::Short,
                    true => Look::Record { length: SIGNATURE.len(), record: &window[..SIGNATURE.len()] },
                };
            }
            Awaited::ProductName => return text(window, 0),
            Awaited::Answer(question) => question.byte(),
            Awaited::Echo(command) => match command {
                Command::Home => 0xc2,
                Command::Baud(_) => 0xc4,
                Command::End => 0xc5,
            },
        };
        if window[0] != echo {
            return Look::skip_byte(Refusal::Noise);
        }
        let range = match self.awaited {
            Awaited::Answer(Question::Parameters) => match window.get(1) {
                Some(&length) => 2..2 + usize::from(length),
                None => return Look::Short,
            },
            Awaited::Answer(Question::HomeReference) => 1..13,
            Awaited::Answer(Question::Maxima) => 1..25,
            Awaited::Answer(_) => return text(window, 1),
            _ => 1..1,
        };
        let length = range.end;
        window.get(range).map_or(Look::Short, |record| Look::Record { length, record })
    }
}

/// Printable characters after so many bytes, and the zero that ends them.
fn text(window: &[u8], from: usize) -> Look<&[u8]> {
    let inside = &window[from..window.len().min(from + LONGEST_TEXT)];
    match inside.iter().position(|byte| !(0x20..0x7f).contains(byte)) {
        None if inside.len() < LONGEST_TEXT => Look::Short,
        Some(end) if inside[end] == 0 && end > 0 => Look::Record { length: from + end + 1, record: &inside[..end] },
        None => Look::skip_byte(Refusal::Length),
        Some(_) => Look::skip_byte(Refusal::Field),
    }
}

/// The arm's links as the format `DH0.5` has them, base first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Links {
    /// Twists; a count is π/32768.
    pub alpha_counts: [i16; 6],
    /// Lengths in thousandths of an inch.
    pub a_mils: [i16; 6],
    /// Offsets in thousandths of an inch.
    pub d_mils: [i16; 6],
}

impl Links {
    /// From the answer to [`Question::Parameters`]: 36 bytes, high byte first.
    pub fn read(answer: &[u8]) -> Option<Self> {
        let (values, rest) = answer.as_chunks::<2>();
        let values: [i16; 18] =
            values.iter().map(|&value| i16::from_be_bytes(value)).collect::<Vec<_>>().try_into().ok()?;
        let six = |from: usize| values[from..from + 6].try_into().ok();
        rest.is_empty().then_some(())?;
        Some(Self { alpha_counts: six(0)?, a_mils: six(6)?, d_mils: six(12)? })
    }
}

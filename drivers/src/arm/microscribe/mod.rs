//! MicroScribe-3D and the Immersion boxes before it: encoder samples and configuration questions.
//!
//! | | |
//! |---|---|
//! | Clock | a timer of 14 bits, if samples are requested with it |
//! | Tick | not documented |
//! | Wrap | 2¹⁴ ticks |
//! | Instant | not documented; the device samples on request, so the time of the request is the better clock |
//!
//! Encoders have 14 bits and count from the position of the arm at power-on: it must rest in its
//! home position then. The angle of a joint is its count · 2π / (its maximum + 1).
//!
//! In a sample only the first byte has bit 7 set. Answers to configuration questions are bytes of
//! any value, preceded by the question itself. A device never sends both at once, so each has its
//! own format: [`Samples`] and [`Answers`].

pub(super) mod unit;

pub use unit::Unit;

use crate::framing::{Format, Parsed, Refusal};

/// Maximum number of encoders of a device.
pub const MOST_ENCODERS: usize = 7;

/// Family of a device: the same request means different numbers of encoders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// MicroScribe.
    MicroScribe,
    /// Immersion box.
    Box,
}

/// The contents of a sample, as requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    byte: u8,
    encoders: usize,
}

impl Request {
    /// Creates a request for `encoders` encoders (MicroScribe 5 to 7; box 2, 4 or 6), with or
    /// without the timer. Returns `None` for an impossible number.
    pub const fn new(family: Family, encoders: usize, timer: bool) -> Option<Self> {
        let code = match (family, encoders) {
            (Family::MicroScribe, 5) | (Family::Box, 2) => 0b01,
            (Family::MicroScribe, 7) | (Family::Box, 4) => 0b10,
            (Family::MicroScribe | Family::Box, 6) => 0b11,
            _ => return None,
        };
        Some(Self { byte: code | if timer { 0x20 } else { 0 }, encoders })
    }

    /// Returns the byte that requests one sample.
    pub const fn byte(self) -> u8 {
        self.byte
    }

    const fn has_timer(self) -> bool {
        self.byte & 0x20 != 0
    }

    /// Returns the bytes of a sample.
    pub const fn length(self) -> usize {
        2 + 2 * self.encoders + if self.has_timer() { 2 } else { 0 }
    }
}

/// A sample of the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Buttons and pedals, one bit each.
    pub buttons: u8,
    /// Timer ticks, if requested; wrap at 2¹⁴.
    pub timer: Option<u16>,
    encoders: [u16; MOST_ENCODERS],
    count: usize,
}

impl Sample {
    /// Creates a sample; excess encoders are ignored.
    pub fn new(buttons: u8, timer: Option<u16>, encoders: &[u16]) -> Self {
        let mut sample =
            Self { buttons, timer, encoders: [0; MOST_ENCODERS], count: encoders.len().min(MOST_ENCODERS) };
        sample.encoders.iter_mut().zip(encoders).for_each(|(each, count)| *each = *count);
        sample
    }

    /// Returns the counts of 14 bits, base first.
    pub fn encoders(&self) -> &[u16] {
        &self.encoders[..self.count]
    }

    /// Appends the sample as a device answers this request; missing encoders are 0.
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
    /// Creates a format for samples of this request.
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
    fn parse(&mut self, window: &[u8]) -> Parsed<Sample> {
        if window[0] != self.request.byte | 0x80 {
            return Parsed::skip_byte(if window[0] < 0x80 { Refusal::Noise } else { Refusal::Header });
        }
        let length = self.request.length();
        let inside = &window[1..window.len().min(length)];
        if inside.iter().fold(0, |marks, byte| marks | byte) & 0x80 != 0 {
            // The sample is truncated where the next begins.
            let before = inside.iter().position(|byte| byte & 0x80 != 0).unwrap_or(0);
            return Parsed::Skip { bytes: 1 + before, why: Refusal::Length };
        }
        let Some((buttons, values)) = inside.split_first().filter(|_| window.len() >= length) else {
            return Parsed::Short;
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
        Parsed::Record { length, record: sample }
    }
}

/// Wake-up byte, sent until the device detects the baud rate.
pub const WAKE: u8 = 0xc5;
/// Sent after [`WAKE`]; a listening device echoes it.
pub const SIGNATURE: &[u8; 4] = b"IMMC";
/// Opens the session; the answer is the product name.
pub const BEGIN: &[u8; 5] = b"BEGIN";

/// A configuration question. The device echoes its byte and sends the answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Question {
    /// Parameters of the arm's links, preceded by their length.
    Parameters,
    /// Home positions of the encoders. Firmware from 1996 on does not answer it.
    HomeReference,
    /// Maximum counts of the encoders.
    Maxima,
    /// Product name.
    Product,
    /// Product identification.
    Identity,
    /// Model.
    Model,
    /// Serial number.
    Serial,
    /// A comment.
    Comment,
    /// Name of the parameter format.
    ParameterFormat,
    /// Firmware version.
    Version,
}

impl Question {
    /// Returns the byte to send.
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

/// A configuration command: the device only echoes its byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Command {
    /// Sets the encoders to their values at home, which is right in the rest position only. (0xC3
    /// differs: it writes the home values permanently to the device's memory, and needs a
    /// password.)
    Home,
    /// Selects another baud rate by its code: 0x00 115200, 0x01 57600, 0x02 28800, 0x03 14400,
    /// 0x10 38400, 0x11 19200, 0x12 9600.
    Baud(u8),
    /// Ends the session.
    End,
}

impl Command {
    /// Returns the bytes to send.
    pub fn bytes(self) -> Vec<u8> {
        match self {
            Self::Home => vec![0xc2],
            Self::Baud(code) => vec![0xc4, code],
            Self::End => vec![0xc5],
        }
    }
}

/// The awaited answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Awaited {
    /// The echoed [signature](SIGNATURE).
    Signature,
    /// The product name after [`BEGIN`].
    ProductName,
    /// The answer to a question.
    Answer(Question),
    /// The echo of a command's byte.
    Echo(Command),
}

/// Longest text, in bytes.
const LONGEST_TEXT: usize = 128;

/// Reads answers during set-up: only the [awaited](Awaited) one. A record is the contents of the
/// answer, without echo, length or final zero.
#[derive(Debug, Clone)]
pub struct Answers {
    awaited: Awaited,
}

impl Answers {
    /// Creates a format for this answer.
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

    fn parse<'a>(&mut self, window: &'a [u8]) -> Parsed<&'a [u8]> {
        let echo = match self.awaited {
            Awaited::Signature => {
                return match window.iter().zip(SIGNATURE).all(|(byte, letter)| byte == letter) {
                    false => Parsed::skip_byte(Refusal::Noise),
                    true if window.len() < SIGNATURE.len() => Parsed::Short,
                    true => Parsed::Record { length: SIGNATURE.len(), record: &window[..SIGNATURE.len()] },
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
            return Parsed::skip_byte(Refusal::Noise);
        }
        let range = match self.awaited {
            Awaited::Answer(Question::Parameters) => match window.get(1) {
                Some(&length) => 2..2 + usize::from(length),
                None => return Parsed::Short,
            },
            Awaited::Answer(Question::HomeReference) => 1..13,
            Awaited::Answer(Question::Maxima) => 1..25,
            Awaited::Answer(_) => return text(window, 1),
            _ => 1..1,
        };
        let length = range.end;
        window.get(range).map_or(Parsed::Short, |record| Parsed::Record { length, record })
    }
}

/// Reads printable characters from byte `from`, and the zero that ends them.
fn text(window: &[u8], from: usize) -> Parsed<&[u8]> {
    let inside = &window[from..window.len().min(from + LONGEST_TEXT)];
    match inside.iter().position(|byte| !(0x20..0x7f).contains(byte)) {
        None if inside.len() < LONGEST_TEXT => Parsed::Short,
        Some(end) if inside[end] == 0 && end > 0 => Parsed::Record { length: from + end + 1, record: &inside[..end] },
        None => Parsed::skip_byte(Refusal::Length),
        Some(_) => Parsed::skip_byte(Refusal::Field),
    }
}

/// The arm's links in the format `DH0.5`, base first.
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
    /// Reads the answer to [`Question::Parameters`]: 36 bytes, high byte first.
    pub fn read(answer: &[u8]) -> Option<Self> {
        let (values, rest) = answer.as_chunks::<2>();
        let values: [i16; 18] =
            values.iter().map(|&value| i16::from_be_bytes(value)).collect::<Vec<_>>().try_into().ok()?;
        let six = |from: usize| values[from..from + 6].try_into().ok();
        rest.is_empty().then_some(())?;
        Some(Self { alpha_counts: six(0)?, a_mils: six(6)?, d_mils: six(12)? })
    }
}

//! Commands for the unit. Letters are case-sensitive; commands without parameters take no
//! carriage return.

use super::STATIONS;
use super::list::{Layout, Mode};

/// A command to the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// `P`: sends one record of each station in use.
    Poll,
    /// `C`: sends records continuously.
    Stream,
    /// `c`: stops continuous records.
    StopStream,
    /// `F` or `f`: selects text or binary.
    Mode(Mode),
    /// `u`: reports positions in cm.
    Centimetres,
    /// `U`: reports positions in inches.
    Inches,
    /// `S`: asks for the status.
    Status,
    /// `O s,…`: sets a station's output list; without a station, that of all stations (ISOTRAK,
    /// ISOTRAK II).
    OutputList(Option<u8>, Layout),
    /// `O s`: asks for a station's output list.
    AskOutputList(u8),
    /// `l s,…`: enables or disables a station.
    Station(u8, bool),
    /// `l s`: asks for the stations in use; without a station, in ISOTRAK II's form.
    AskStations(Option<u8>),
    /// `H s,x,y,z`: sets the zenith of the hemisphere that contains the sensor. All zeros make
    /// the unit follow the sensor from its present position.
    Hemisphere(u8, [f32; 3]),
    /// `R s`: clears the alignment.
    ResetAlignment(u8),
    /// `b s`: clears the boresight.
    ResetBoresight(u8),
    /// `I s,d`: sends records only after a movement of this distance; 0 for always.
    Increment(u8, f32),
    /// `x…`: sets the position filter: sensitivity, low, high, factor. 0,1,0,0 is no filter.
    PositionFilter([f32; 4]),
    /// `v…`: sets the attitude filter.
    AttitudeFilter([f32; 4]),
    /// `^Q`: resumes sending.
    Resume,
    /// `^S`: suspends sending.
    Suspend,
    /// `^Y`: restarts the unit, which takes 10 s (ISOTRAK 20 s).
    Reset,
    /// A carriage return alone: ends a command that another host left unfinished.
    EndLine,
}

/// Parameters that switch a filter off.
pub const NO_FILTER: [f32; 4] = [0.0, 1.0, 0.0, 0.0];

impl Command {
    /// Returns the bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        let text = match self {
            Self::Poll => "P".into(),
            Self::Stream => "C".into(),
            Self::StopStream => "c".into(),
            Self::Mode(Mode::Ascii) => "F".into(),
            Self::Mode(Mode::Binary) => "f".into(),
            Self::Centimetres => "u".into(),
            Self::Inches => "U".into(),
            Self::Status => "S".into(),
            Self::OutputList(station, layout) => {
                let codes = layout.entries().iter().map(|entry| entry.code());
                let fields: Vec<String> = station.iter().copied().chain(codes).map(|field| field.to_string()).collect();
                format!("O{}\r", fields.join(","))
            }
            Self::AskOutputList(station) => format!("O{station}\r"),
            Self::Station(station, on) => format!("l{station},{}\r", u8::from(*on)),
            Self::AskStations(station) => station.map_or_else(|| "l\r".into(), |station| format!("l{station}\r")),
            Self::Hemisphere(station, [x, y, z]) => format!("H{station},{x},{y},{z}\r"),
            Self::ResetAlignment(station) => format!("R{station}\r"),
            Self::ResetBoresight(station) => format!("b{station}\r"),
            Self::Increment(station, distance) => format!("I{station},{distance}\r"),
            Self::PositionFilter([f, low, high, factor]) => format!("x{f},{low},{high},{factor}\r"),
            Self::AttitudeFilter([f, low, high, factor]) => format!("v{f},{low},{high},{factor}\r"),
            Self::Resume => "\x11".into(),
            Self::Suspend => "\x13".into(),
            Self::Reset => "\x19".into(),
            Self::EndLine => "\r".into(),
        };
        text.into_bytes()
    }

    /// Reads the first command in bytes sent to a unit, and returns it with its length in bytes.
    /// Virtual units use this.
    ///
    /// Returns `None` while the line is unfinished. An unknown letter or unreadable parameters
    /// give a [`NotObeyed`] error with the number of bytes to skip.
    pub fn read(bytes: &[u8]) -> Option<(Result<Self, NotObeyed>, usize)> {
        let alone = match *bytes.first()? {
            b'P' => Self::Poll,
            b'C' => Self::Stream,
            b'c' => Self::StopStream,
            b'F' => Self::Mode(Mode::Ascii),
            b'f' => Self::Mode(Mode::Binary),
            b'u' => Self::Centimetres,
            b'U' => Self::Inches,
            b'S' => Self::Status,
            0x11 => Self::Resume,
            0x13 => Self::Suspend,
            0x19 => Self::Reset,
            b'\r' => Self::EndLine,
            b'T' | b'D' | b'd' | b'W' | 0x0b => return Some((Err(NotObeyed::Unknown), 1)),
            _ => {
                let end = bytes.iter().position(|&byte| byte == b'\r')?;
                return Some((Self::with_parameters(&bytes[..end]), end + 1));
            }
        };
        Some((Ok(alone), 1))
    }

    fn with_parameters(line: &[u8]) -> Result<Self, NotObeyed> {
        let (&letter, rest) = line.split_first().ok_or(NotObeyed::Unknown)?;
        let text = std::str::from_utf8(rest).map_err(|_| NotObeyed::NotNumeric)?;
        let mut numbers = Vec::new();
        for field in text.split(',').filter(|_| !text.is_empty()) {
            let number = field.trim().parse::<f32>().ok().filter(|number| number.is_finite());
            numbers.push(number.ok_or(NotObeyed::NotNumeric)?);
        }
        let station = |number: f32| {
            (1..=STATIONS as u8).find(|&station| f32::from(station) == number).ok_or(NotObeyed::OutOfRange)
        };
        match (letter, numbers.as_slice()) {
            (b'O', [only]) => Ok(Self::AskOutputList(station(*only)?)),
            (b'O', [first, codes @ ..]) => {
                let code = |&number: &f32| (0..=u8::MAX).find(|&code| f32::from(code) == number);
                let codes: Vec<u8> = codes.iter().map(code).collect::<Option<_>>().ok_or(NotObeyed::OutOfRange)?;
                // The mode does not matter here, except for items that exist in only one mode.
                let layout = Layout::new(Mode::Ascii, &codes).or_else(|_| Layout::new(Mode::Binary, &codes));
                Ok(Self::OutputList(Some(station(*first)?), layout.map_err(|_| NotObeyed::OutOfRange)?))
            }
            (b'l', []) => Ok(Self::AskStations(None)),
            (b'l', [first]) => Ok(Self::AskStations(Some(station(*first)?))),
            (b'l', [first, on]) if *on == 0.0 || *on == 1.0 => Ok(Self::Station(station(*first)?, *on == 1.0)),
            (b'H', &[first, x, y, z]) => Ok(Self::Hemisphere(station(first)?, [x, y, z])),
            (b'R', [first]) => Ok(Self::ResetAlignment(station(*first)?)),
            (b'b', [first]) => Ok(Self::ResetBoresight(station(*first)?)),
            (b'I', [first, distance]) => Ok(Self::Increment(station(*first)?, *distance)),
            (b'x', &[f, low, high, factor]) => Ok(Self::PositionFilter([f, low, high, factor])),
            (b'v', &[f, low, high, factor]) => Ok(Self::AttitudeFilter([f, low, high, factor])),
            (b'l', [_, _]) => Err(NotObeyed::OutOfRange),
            (b'O' | b'l' | b'H' | b'R' | b'b' | b'I' | b'x' | b'v', _) => Err(NotObeyed::MissingField),
            _ => Err(NotObeyed::Unknown),
        }
    }
}

/// Why a unit refuses a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotObeyed {
    /// A parameter is missing.
    MissingField,
    /// A parameter is not a number.
    NotNumeric,
    /// A parameter is out of the command's range.
    OutOfRange,
    /// The command does not exist.
    Unknown,
}

impl NotObeyed {
    /// Returns the number in the unit's error reply.
    pub const fn code(self) -> i32 {
        match self {
            Self::MissingField => -1,
            Self::NotNumeric => -2,
            Self::OutOfRange => -3,
            Self::Unknown => -99,
        }
    }
}

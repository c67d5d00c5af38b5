//! Commands for the unit. Letters may be in either case; every command but `P` ends in a carriage
//! return.

use super::limits::MOST_STATIONS;
use super::list::Layout;

/// `^U`, which asks for the active stations.
pub const ACTIVE_STATIONS: u8 = 0x15;

/// The stations that a command addresses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stations {
    /// Every station: `*`.
    All,
    /// One station, from 1.
    One(u8),
}

impl std::fmt::Display for Stations {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::All => f.write_str("*"),
            Self::One(station) => station.fmt(f),
        }
    }
}

/// Frame rates, in frames per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Rate {
    /// `R2`: 60.
    Hz60,
    /// `R3`: 120.
    Hz120,
    /// `R4`: 240.
    Hz240,
}

/// The counters that `Q` sets to 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Counter {
    /// Frame count and time.
    Both,
    /// The frame count.
    FrameCount,
    /// The time.
    Timestamp,
}

/// A command to the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// `P`: sends one frame of each station; ends [`Stream`](Self::Stream).
    Poll,
    /// `C`: sends frames continuously.
    Stream,
    /// `F`: selects binary or text.
    Binary(bool),
    /// `U`: reports positions in cm or in inches.
    Centimetres(bool),
    /// `U`: asks for the position unit.
    AskUnits,
    /// `R`: sets the frame rate.
    Rate(Rate),
    /// `O`: sets the output list.
    OutputList(Stations, Layout),
    /// `O`: asks for a station's output list.
    AskOutputList(u8),
    /// `Q`: sets counters to 0.
    Zero(Counter),
    /// `H`: sets the zenith of the hemisphere that contains the sensor. All zeros make the unit
    /// follow the sensor from its present position.
    Hemisphere(Stations, [f32; 3]),
    /// `^R`: clears the alignment, which would otherwise accumulate.
    ResetAlignment(Stations),
    /// `^B`: clears the boresight.
    ResetBoresight(Stations),
    /// `X`: sets the position filter; 0,1,0,0 is no filter.
    PositionFilter([f32; 4]),
    /// `Y`: sets the attitude filter; 0,1,0,0 is no filter.
    AttitudeFilter([f32; 4]),
    /// `@B`: whether the unit buffers frames before it sends them over USB. Buffering makes
    /// arrival times meaningless.
    UsbBuffer(bool),
    /// `^U0`: asks for the detected and the active stations.
    AskActiveStations,
    /// `^V`: asks for the unit's identity.
    WhoAreYou,
    /// `^E`: whether the unit echoes commands.
    Echo(bool),
    /// `^Y`: restarts the unit, which takes 10 s.
    Reset,
    /// A carriage return alone: ends a command that another host left unfinished.
    EndLine,
}

impl Command {
    /// Returns the bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        let text = match self {
            Self::Poll => return b"P".to_vec(),
            Self::Stream => "C".into(),
            Self::Binary(on) => format!("F{}", u8::from(*on)),
            Self::Centimetres(on) => format!("U{}", u8::from(*on)),
            Self::AskUnits => "U".into(),
            Self::Rate(Rate::Hz60) => "R2".into(),
            Self::Rate(Rate::Hz120) => "R3".into(),
            Self::Rate(Rate::Hz240) => "R4".into(),
            Self::OutputList(stations, layout) => {
                layout.items().iter().fold(format!("O{stations}"), |text, item| format!("{text},{}", item.code()))
            }
            Self::AskOutputList(station) => format!("O{station}"),
            Self::Zero(Counter::Both) => "Q0".into(),
            Self::Zero(Counter::FrameCount) => "Q1".into(),
            Self::Zero(Counter::Timestamp) => "Q2".into(),
            Self::Hemisphere(stations, [x, y, z]) => format!("H{stations},{x},{y},{z}"),
            Self::ResetAlignment(stations) => format!("\x12{stations}"),
            Self::ResetBoresight(stations) => format!("\x02{stations}"),
            Self::PositionFilter([f, low, high, factor]) => format!("X{f},{low},{high},{factor}"),
            Self::AttitudeFilter([f, low, high, factor]) => format!("Y{f},{low},{high},{factor}"),
            Self::UsbBuffer(on) => format!("@B{}", u8::from(*on)),
            Self::AskActiveStations => "\x150".into(),
            Self::WhoAreYou => "\x16".into(),
            Self::Echo(on) => format!("\x05{}", u8::from(*on)),
            Self::Reset => "\x19".into(),
            Self::EndLine => String::new(),
        };
        let mut bytes = text.into_bytes();
        bytes.push(b'\r');
        bytes
    }

    /// Reads the first command in bytes sent to a unit, and returns it with its length in bytes.
    /// Virtual units use this. Returns `None` while the line is unfinished, and no command for an
    /// unknown one or for unknown parameters.
    pub fn read(bytes: &[u8]) -> Option<(Option<Self>, usize)> {
        if bytes.first()?.eq_ignore_ascii_case(&b'P') {
            return Some((Some(Self::Poll), 1));
        }
        let end = bytes.iter().position(|&byte| byte == b'\r')?;
        Some((Self::of_line(&bytes[..end]), end + 1))
    }

    fn of_line(line: &[u8]) -> Option<Self> {
        let Some((&letter, rest)) = line.split_first() else {
            return Some(Self::EndLine);
        };
        let text = std::str::from_utf8(rest).ok()?.to_ascii_uppercase();
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let stations = || match fields.first()? {
            &"*" => Some(Stations::All),
            one => one.parse().ok().filter(|station| (1..=MOST_STATIONS).contains(station)).map(Stations::One),
        };
        let switch = |text: &str| match text {
            "0" => Some(false),
            "1" => Some(true),
            _ => None,
        };
        let number = |field: &&str| field.parse::<f32>().ok().filter(|number| number.is_finite());
        let numbers: Option<Vec<f32>> = fields.iter().map(number).collect();
        let four = || <[f32; 4]>::try_from(numbers.as_deref()?).ok();
        match letter.to_ascii_uppercase() {
            b'C' if text.is_empty() => Some(Self::Stream),
            b'F' => switch(&text).map(Self::Binary),
            b'U' if text.is_empty() => Some(Self::AskUnits),
            b'U' => switch(&text).map(Self::Centimetres),
            b'R' => match text.as_str() {
                "2" => Some(Self::Rate(Rate::Hz60)),
                "3" => Some(Self::Rate(Rate::Hz120)),
                "4" => Some(Self::Rate(Rate::Hz240)),
                _ => None,
            },
            b'O' if fields.len() == 1 => match stations()? {
                Stations::One(station) => Some(Self::AskOutputList(station)),
                Stations::All => None,
            },
            b'O' => {
                let codes: Option<Vec<u8>> = fields[1..].iter().map(|field| field.parse().ok()).collect();
                Some(Self::OutputList(stations()?, Layout::new(&codes?).ok()?))
            }
            b'Q' => match text.as_str() {
                "0" => Some(Self::Zero(Counter::Both)),
                "1" => Some(Self::Zero(Counter::FrameCount)),
                "2" => Some(Self::Zero(Counter::Timestamp)),
                _ => None,
            },
            b'H' => match &fields[1..] {
                [x, y, z] => Some(Self::Hemisphere(stations()?, [number(x)?, number(y)?, number(z)?])),
                _ => None,
            },
            0x12 => stations().map(Self::ResetAlignment),
            0x02 => stations().map(Self::ResetBoresight),
            b'X' => four().map(Self::PositionFilter),
            b'Y' => four().map(Self::AttitudeFilter),
            b'@' => switch(text.strip_prefix('B')?).map(Self::UsbBuffer),
            ACTIVE_STATIONS if text == "0" => Some(Self::AskActiveStations),
            0x16 => Some(Self::WhoAreYou),
            0x05 => switch(&text).map(Self::Echo),
            0x19 => Some(Self::Reset),
            _ => None,
        }
    }
}

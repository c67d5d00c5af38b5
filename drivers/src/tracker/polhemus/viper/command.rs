//! Commands and replies: both use the same frame, and the action distinguishes them.

use super::frame::{OrientationUnit, PositionUnit, framed};

/// Bytes of a reply before its payload.
pub(super) const REPLY_HEADER: usize = 20;

/// All sensors, or any unit.
pub const ALL: u32 = u32::MAX;

/// Numbers of the commands.
#[allow(missing_docs, reason = "the names are those of the manufacturer's header")]
pub mod code {
    pub const HEMISPHERE: u32 = 0;
    pub const FILTER: u32 = 1;
    pub const TIP_OFFSET: u32 = 2;
    pub const INCREMENT: u32 = 3;
    pub const BORESIGHT: u32 = 4;
    pub const FRAME_RATE: u32 = 6;
    pub const UNITS: u32 = 7;
    pub const SYNC_MODE: u32 = 9;
    pub const STATION_MAP: u32 = 10;
    pub const SERIAL_CONFIG: u32 = 14;
    pub const BUILT_IN_TEST: u32 = 17;
    pub const SINGLE_PNO: u32 = 18;
    pub const CONTINUOUS_PNO: u32 = 19;
    pub const WHO_AM_I: u32 = 20;
    pub const INITIALIZE: u32 = 21;
    pub const PERSIST: u32 = 22;
}

/// Action of a command, or its outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Action {
    /// Sets a value.
    Set,
    /// Asks for a value.
    Get,
    /// Sets the default; stops a stream.
    Reset,
    /// The unit obeyed; the reply carries the requested value.
    Ack,
    /// The unit did not obey; the reply carries a [`Nak`].
    Nak,
    /// The unit obeyed, with a warning.
    NakWarning,
}

impl Action {
    const ALL: [Self; 6] = [Self::Set, Self::Get, Self::Reset, Self::Ack, Self::Nak, Self::NakWarning];
}

/// A command frame, as sent or as answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply<'a> {
    /// Number of the sensor electronics unit; [`ALL`] in commands for any.
    pub unit: u32,
    /// Number of the command, from [`code`].
    pub command: u32,
    /// Number of the action; see [`action`](Self::action).
    pub action: u32,
    /// The command's two arguments; usually the sensor comes first, [`ALL`] for every sensor.
    pub arguments: [u32; 2],
    /// Further data.
    pub payload: &'a [u8],
}

/// Why the unit did not obey a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nak<'a> {
    /// 0: general; 1: not ready; 2: wrong command; 3: built-in test.
    pub code: u32,
    /// Text from the unit.
    pub text: &'a [u8],
}

impl<'a> Reply<'a> {
    pub(super) fn read(body: &'a [u8]) -> Option<Self> {
        let (head, payload) = body.split_first_chunk::<REPLY_HEADER>()?;
        let (words, _) = head.as_chunks::<4>();
        let word = |index: usize| u32::from_le_bytes(words[index]);
        let (unit, command, action, arguments) = (word(0), word(1), word(2), [word(3), word(4)]);
        Some(Self { unit, command, action, arguments, payload })
    }

    /// Returns the command's action or outcome.
    pub fn action(&self) -> Option<Action> {
        Action::ALL.get(usize::try_from(self.action).ok()?).copied()
    }

    /// Returns the reason for a refusal, or the warning.
    pub fn nak(&self) -> Option<Nak<'a>> {
        if !matches!(self.action()?, Action::Nak | Action::NakWarning) {
            return None;
        }
        let (code, rest) = self.payload.split_first_chunk::<4>()?;
        let text = rest.get(..128)?;
        let end = text.iter().position(|&byte| byte == 0).unwrap_or(text.len());
        Some(Nak { code: u32::from_le_bytes(*code), text: &text[..end] })
    }

    /// Appends a refusal's payload: code, 128 bytes of text, 12 of data.
    pub fn write_nak(code: u32, text: &str, to: &mut Vec<u8>) {
        to.extend(code.to_le_bytes());
        let mut field = [0; 140];
        field.iter_mut().zip(text.bytes().take(127)).for_each(|(byte, letter)| *byte = letter);
        to.extend(field);
    }
}

/// Strength of a filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FilterLevel {
    /// No filter, as a moving probe needs.
    None,
    /// Light filter.
    Light,
    /// Medium filter.
    Medium,
    /// Strong filter.
    Heavy,
}

/// Frame rates, in frames per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names are the rates")]
pub enum Rate {
    Hz30,
    Hz60,
    Hz120,
    Hz240,
    Hz480,
    Hz960,
}

/// A command to the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Asks for the unit's identity.
    WhoAmI,
    /// Sets the units of positions and orientations.
    Units(PositionUnit, OrientationUnit),
    /// Sets the frame rate.
    FrameRate(Rate),
    /// Sets the zenith of the hemisphere that contains a sensor; [`ALL`] for every sensor.
    Hemisphere {
        /// Sensor number.
        sensor: u32,
        /// Whether the unit follows the sensor from its present position.
        track: bool,
        /// The zenith.
        zenith: [f32; 3],
    },
    /// Sets the filters of position and orientation.
    Filter {
        /// Sensor number.
        sensor: u32,
        /// Strength of the filter.
        level: FilterLevel,
    },
    /// Sets all sensors to the default of the command with this number.
    Default(u32),
    /// Asks for the units of positions and orientations.
    AskUnits,
    /// Asks for the frame rate.
    AskFrameRate,
    /// Restarts the unit.
    Initialize,
    /// Asks for the connected sensors and sources.
    AskStationMap,
    /// Asks for one frame.
    Poll,
    /// Starts continuous frames.
    Stream {
        /// Whether accelerations are sent; orientations then have 16 bits.
        accelerations: bool,
        /// Whether the frame count starts at 0.
        restart_count: bool,
    },
    /// Stops continuous frames.
    StopStream,
}

impl Command {
    /// Returns the bytes to send.
    pub fn bytes(&self) -> Vec<u8> {
        const NOTHING: u32 = 0;
        let word = |value: u32| value.to_le_bytes().to_vec();
        let (command, action, arguments, payload) = match *self {
            Self::WhoAmI => (code::WHO_AM_I, Action::Get, [NOTHING; 2], Vec::new()),
            Self::Units(position, orientation) => {
                let payload = [word(position as u32), word(orientation as u32)].concat();
                (code::UNITS, Action::Set, [NOTHING; 2], payload)
            }
            Self::FrameRate(rate) => (code::FRAME_RATE, Action::Set, [NOTHING; 2], word(rate as u32)),
            Self::Hemisphere { sensor, track, zenith } => {
                let payload = [word(u32::from(track)), zenith.map(f32::to_le_bytes).concat()].concat();
                (code::HEMISPHERE, Action::Set, [sensor, NOTHING], payload)
            }
            Self::Filter { sensor, level } => {
                // Filters both position and orientation; the level determines the four
                // parameters.
                (code::FILTER, Action::Set, [sensor, 0], [word(level as u32), vec![0; 16]].concat())
            }
            Self::Default(command) => (command, Action::Reset, [ALL, NOTHING], Vec::new()),
            Self::AskUnits => (code::UNITS, Action::Get, [NOTHING; 2], Vec::new()),
            Self::AskFrameRate => (code::FRAME_RATE, Action::Get, [NOTHING; 2], Vec::new()),
            Self::Initialize => (code::INITIALIZE, Action::Set, [NOTHING; 2], Vec::new()),
            Self::AskStationMap => (code::STATION_MAP, Action::Get, [NOTHING; 2], Vec::new()),
            Self::Poll => (code::SINGLE_PNO, Action::Get, [NOTHING; 2], Vec::new()),
            Self::Stream { accelerations, restart_count } => {
                let count = if restart_count { 0 } else { u32::MAX };
                (code::CONTINUOUS_PNO, Action::Set, [NOTHING, u32::from(accelerations)], word(count))
            }
            Self::StopStream => (code::CONTINUOUS_PNO, Action::Reset, [NOTHING; 2], Vec::new()),
        };
        let mut bytes = Vec::new();
        framed(b"VPRC", &mut bytes, |to| {
            for word in [ALL, command, action as u32, arguments[0], arguments[1]] {
                to.extend(word.to_le_bytes());
            }
            to.extend(payload);
        });
        bytes
    }
}

//! A whole message: reads it from header and body, and writes it to bytes.

use super::cursor::{Cursor, Trouble};
use super::extended::{self, Datum, Text};
use super::fixed::Fixed;
use super::header::{HEADER, Header, TimeStamp, Version, checksum};
use super::image::Image;
use super::pose::{Matrix, Position, Tool};
use super::query::{Pace, Subject};
use super::unwritable::Unwritable;
use super::words::{self, Command, Status};

/// A message.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Version of the header.
    pub version: Version,
    /// Device name of the sender.
    pub device: Fixed<20>,
    /// Time of creation.
    pub time: TimeStamp,
    /// Message number; with header version 1 always 0, and not written.
    pub id: u32,
    /// Metadata; with header version 1 always empty, and not written.
    pub metadata: Vec<Datum>,
    /// Contents.
    pub content: Content,
}

/// Contents of a message.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Pixels and their placement.
    Image(Image),
    /// A transform from the frame at the beginning of the device name to the one at its end
    /// (`ProbeToTracker`).
    Transform(Matrix),
    /// The same as a quaternion.
    Position(Position),
    /// Poses of several tools at one time.
    Tools(Vec<Tool>),
    /// Status of the sender.
    Status(Status),
    /// A text.
    Text(Text),
    /// The types that the sender accepts.
    Capability(Vec<Fixed<12>>),
    /// A command.
    Command(Command),
    /// The answer to a command.
    Answer(Command),
    /// GET_: asks for one message.
    Get(Subject),
    /// STT_: asks for messages until they are stopped.
    Start(Subject, Option<Pace>),
    /// STP_: stops these messages.
    Stop(Subject),
    /// RTS_: acknowledges a request; 0 for success.
    Receipt(Subject, u8),
    /// An empty message of a type: the answer if the requested object is missing.
    Nothing(Fixed<12>),
    /// An unsupported type, or a request with parameters.
    Other(Fixed<12>, Vec<u8>),
}

/// Returns a type name, which is known to fit.
fn kind(name: &str) -> Fixed<12> {
    Fixed::new(name).unwrap_or(Fixed::EMPTY)
}

impl Content {
    /// Returns the type name.
    pub fn kind(&self) -> Fixed<12> {
        match self {
            Self::Image(_) => kind("IMAGE"),
            Self::Transform(_) => kind("TRANSFORM"),
            Self::Position(_) => kind("POSITION"),
            Self::Tools(_) => kind("TDATA"),
            Self::Status(_) => kind("STATUS"),
            Self::Text(_) => kind("STRING"),
            Self::Capability(_) => kind("CAPABILITY"),
            Self::Command(_) => kind("COMMAND"),
            Self::Answer(_) => kind("RTS_COMMAND"),
            Self::Get(of) => kind(&format!("GET_{}", of.0)),
            Self::Start(of, _) => kind(&format!("STT_{}", of.0)),
            Self::Stop(of) => kind(&format!("STP_{}", of.0)),
            Self::Receipt(of, _) => kind(&format!("RTS_{}", of.0)),
            Self::Nothing(kind) | Self::Other(kind, _) => *kind,
        }
    }

    fn read(kind: Fixed<12>, mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let is_empty = fields.left() == 0;
        match kind.as_str() {
            "TDATA" => return Tool::read_all(fields).map(Self::Tools),
            "CAPABILITY" => return words::read_types(fields).map(Self::Capability),
            "IMAGE" | "TRANSFORM" | "POSITION" | "STATUS" | "STRING" | "COMMAND" | "RTS_COMMAND" if is_empty => {
                return Ok(Self::Nothing(kind));
            }
            "IMAGE" => return Image::read(fields).map(Self::Image),
            "TRANSFORM" => {
                let matrix = Matrix::read(&mut fields)?;
                fields.end("the matrix")?;
                return Ok(Self::Transform(matrix));
            }
            "POSITION" => return Position::read(fields).map(Self::Position),
            "STATUS" => return Status::read(fields).map(Self::Status),
            "STRING" => return words::read_text(fields).map(Self::Text),
            "COMMAND" => return Command::read(fields).map(Self::Command),
            "RTS_COMMAND" => return Command::read(fields).map(Self::Answer),
            "STT_TDATA" if !is_empty => {
                return Pace::read(fields).map(|pace| Self::Start(Subject::of("TDATA"), Some(pace)));
            }
            _ => {}
        }
        let question = kind.as_str().split_at_checked(4).and_then(|(verb, of)| {
            let of = Subject(Fixed::new(of).ok()?);
            match (verb, fields.left()) {
                ("GET_", 0) => Some(Self::Get(of)),
                ("STT_", 0) => Some(Self::Start(of, None)),
                ("STP_", 0) => Some(Self::Stop(of)),
                ("RTS_", 1) => Some(Self::Receipt(of, fields.u8("the outcome").ok()?)),
                _ => None,
            }
        });
        match question {
            Some(question) => Ok(question),
            None => Ok(Self::Other(kind, fields.slice("the body", fields.left())?.to_vec())),
        }
    }

    fn write(&self, out: &mut Vec<u8>) -> Result<(), Unwritable> {
        match self {
            Self::Image(image) => image.write(out)?,
            Self::Transform(matrix) => matrix.write(out),
            Self::Position(position) => position.write(out),
            Self::Tools(tools) => tools.iter().for_each(|tool| tool.write(out)),
            Self::Status(status) => status.write(out),
            Self::Text(text) => words::write_text(text, out)?,
            Self::Capability(types) => types.iter().for_each(|name| out.extend_from_slice(name.bytes())),
            Self::Command(command) | Self::Answer(command) => command.write(out)?,
            Self::Start(_, Some(pace)) => pace.write(out),
            Self::Receipt(_, outcome) => out.push(*outcome),
            Self::Get(_) | Self::Start(_, None) | Self::Stop(_) | Self::Nothing(_) => {}
            Self::Other(_, body) => out.extend_from_slice(body),
        }
        Ok(())
    }
}

impl Message {
    /// Creates a message of header version 1, without number and metadata.
    pub fn new(device: Fixed<20>, time: TimeStamp, content: Content) -> Self {
        Self { version: Version::One, device, time, id: 0, metadata: Vec::new(), content }
    }

    /// Returns the metadata value with this name, as text.
    pub fn metadatum(&self, key: &str) -> Option<std::borrow::Cow<'_, str>> {
        self.metadata.iter().find(|datum| datum.key == key).map(|datum| datum.value.as_text())
    }

    /// Reads a message from a body whose checksum is already verified.
    pub(super) fn read(header: &Header, body: &[u8]) -> Result<Self, Trouble> {
        let Header { version, kind, device, time, .. } = *header;
        let (id, metadata, fields) = match version {
            Version::One => (0, Vec::new(), Cursor::new(body, HEADER)),
            Version::Two => {
                let parts = extended::read(body, HEADER)?;
                (parts.id, parts.metadata, parts.content)
            }
        };
        Ok(Self { version, device, time, id, metadata, content: Content::read(kind, fields)? })
    }

    /// Returns the message as bytes: header and body.
    ///
    /// # Errors
    /// [`Unwritable`] if a value does not fit its field.
    pub fn bytes(&self) -> Result<Vec<u8>, Unwritable> {
        let before = match self.version {
            Version::One => HEADER,
            Version::Two => HEADER + extended::EXTENDED,
        };
        let mut out = vec![0; before];
        self.content.write(&mut out)?;
        if self.version == Version::Two {
            extended::finish(&mut out, HEADER, self.id, &self.metadata)?;
        }
        let body = &out[HEADER..];
        let header = Header {
            version: self.version,
            kind: self.content.kind(),
            device: self.device,
            time: self.time,
            body: body.len() as u64,
            checksum: checksum(body),
        };
        out[..HEADER].copy_from_slice(&header.bytes());
        Ok(out)
    }
}

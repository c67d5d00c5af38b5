//! STATUS, STRING, CAPABILITY and COMMAND: texts and codes.

use super::cursor::{Cursor, Fault, Trouble};
use super::extended::Text;
use super::fixed::Fixed;
use super::unwritable::Unwritable;

/// Status of the sender.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// The protocol's code: see the constants.
    pub code: u16,
    /// The sender's own code.
    pub subcode: i64,
    /// Name of the error, such as `Error`.
    pub name: Fixed<20>,
    /// Message text.
    pub message: String,
}

impl Status {
    /// No error.
    pub const OK: u16 = 1;
    /// Unknown error.
    pub const UNKNOWN_ERROR: u16 = 2;
    /// The requested object was not found.
    pub const NOT_FOUND: u16 = 4;
    /// The data do not fit into a message.
    pub const OVERFLOW: u16 = 8;
    /// Checksum error.
    pub const CHECKSUM: u16 = 9;
    /// Unknown request.
    pub const UNKNOWN_INSTRUCTION: u16 = 12;
    /// Not yet ready.
    pub const NOT_READY: u16 = 13;

    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let code = fields.u16("the code")?;
        let subcode = fields.array("the subcode").map(i64::from_be_bytes)?;
        let name = fields.name("the error's name")?;
        let message = fields.slice("the message", fields.left())?;
        // The text may end with a zero.
        let end = message.iter().position(|byte| *byte == 0).unwrap_or(message.len());
        Ok(Self { code, subcode, name, message: String::from_utf8_lossy(&message[..end]).into_owned() })
    }

    /// Writes the status; its message ends with a zero, as in the reference library.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.code.to_be_bytes());
        out.extend_from_slice(&self.subcode.to_be_bytes());
        out.extend_from_slice(self.name.bytes());
        out.extend_from_slice(self.message.as_bytes());
        out.push(0);
    }
}

/// Reads a STRING.
pub(super) fn read_text(mut fields: Cursor<'_>) -> Result<Text, Trouble> {
    let encoding = fields.u16("the encoding")?;
    let length = usize::from(fields.u16("the length")?);
    let bytes = fields.slice("the text", length)?.to_vec();
    fields.end("the text")?;
    Ok(Text { encoding, bytes })
}

/// Writes a STRING.
pub(super) fn write_text(text: &Text, out: &mut Vec<u8>) -> Result<(), Unwritable> {
    let size = text.bytes.len();
    let length = u16::try_from(size).map_err(|_| Unwritable::TooMuch { what: "bytes of a STRING", size })?;
    out.extend_from_slice(&text.encoding.to_be_bytes());
    out.extend_from_slice(&length.to_be_bytes());
    out.extend_from_slice(&text.bytes);
    Ok(())
}

/// Reads a CAPABILITY: the types that the sender accepts.
pub(super) fn read_types(mut fields: Cursor<'_>) -> Result<Vec<Fixed<12>>, Trouble> {
    let bytes = fields.left();
    if !bytes.is_multiple_of(12) {
        let problem = format!("a type takes 12 bytes, and {bytes} is not a multiple of it");
        return fields.trouble(Fault::Length, problem);
    }
    let mut types = Vec::with_capacity(bytes / 12);
    while fields.left() > 0 {
        types.push(fields.name("the type")?);
    }
    Ok(types)
}

/// A command or its answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Command {
    /// The sender's number of the command; the answer has the same.
    pub id: u32,
    /// Name of the command; in an answer, the error.
    pub name: Fixed<128>,
    /// Parameters; other programs often send XML.
    pub text: Text,
}

impl Command {
    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let id = fields.u32("the command's number")?;
        let name = fields.name("the command's name")?;
        let encoding = fields.u16("the encoding")?;
        let length = fields.u32("the length")? as usize;
        let bytes = fields.slice("the command", length)?.to_vec();
        fields.end("the command")?;
        Ok(Self { id, name, text: Text { encoding, bytes } })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), Unwritable> {
        let size = self.text.bytes.len();
        let length = u32::try_from(size).map_err(|_| Unwritable::TooMuch { what: "bytes of a COMMAND", size })?;
        out.extend_from_slice(&self.id.to_be_bytes());
        out.extend_from_slice(self.name.bytes());
        out.extend_from_slice(&self.text.encoding.to_be_bytes());
        out.extend_from_slice(&length.to_be_bytes());
        out.extend_from_slice(&self.text.bytes);
        Ok(())
    }
}

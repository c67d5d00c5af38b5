//! STATUS, STRING, CAPABILITY and COMMAND: what is said.

use super::cursor::{Cursor, Fault, Trouble};
use super::extended::Text;
use super::fixed::Fixed;
use super::message::Unwritable;

/// How the sender is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// The protocol's code: see the constants.
    pub code: u16,
    /// The sender's own.
    pub subcode: i64,
    /// A word for it, such as `Error`.
    pub name: Fixed<20>,
    /// A sentence.
    pub message: String,
}

impl Status {
    /// All is well.
    pub const OK: u16 = 1;
    /// Something unknown is wrong.
    pub const UNKNOWN_ERROR: u16 = 2;
    /// What was asked for is not there.
    pub const NOT_FOUND: u16 = 4;
    /// It does not fit into a message.
    pub const OVERFLOW: u16 = 8;
    /// A checksum did not fit.
    pub const CHECKSUM: u16 = 9;
    /// What was asked for is not understood.
    pub const UNKNOWN_INSTRUCTION: u16 = 12;
    /// It is not yet ready.
    pub const NOT_READY: u16 = 13;

    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let code = fields.u16("the code")?;
        let subcode = fields.array("the subcode").map(i64::from_be_bytes)?;
        let name = fields.name("the error's name")?;
        let message = fields.slice("the message", fields.left())?;
        // Closed by a zero, or not.
        let end = message.iter().position(|byte| *byte == 0).unwrap_or(message.len());
        Ok(Self { code, subcode, name, message: String::from_utf8_lossy(&message[..end]).into_owned() })
    }

    /// The message closed by a zero, as the reference library does it.
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

/// Reads a CAPABILITY: types that the sender takes.
pub(super) fn read_types(mut fields: Cursor<'_>) -> Result<Vec<Fixed<12>>, Trouble> {
    let bytes = fields.left();
    if !bytes.is_multiple_of(12) {
        let problem = format!("a type takes 12 bytes, and {bytes} are no multiple of it");
        return fields.trouble(Fault::Length, problem);
    }
    let mut types = Vec::with_capacity(bytes / 12);
    while fields.left() > 0 {
        types.push(fields.name("the type")?);
    }
    Ok(types)
}

/// Something to be done, or what became of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Command {
    /// The sender's number for it; the answer has the same.
    pub id: u32,
    /// What; in an answer, what went wrong.
    pub name: Fixed<128>,
    /// With what; of other programs often XML.
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

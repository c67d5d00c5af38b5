//! Additions of protocol version 3: the message number, and metadata behind the content.

use super::cursor::{Cursor, Fault, Trouble};
use super::unwritable::Unwritable;

/// Bytes of the extended header when written; additional bytes of a longer one are skipped.
pub(super) const EXTENDED: usize = 12;
/// US-ASCII by its IANA number (MIBenum).
pub const ASCII: u16 = 3;
/// UTF-8 by its IANA number.
pub const UTF8: u16 = 106;

/// A text and its encoding.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Text {
    /// IANA number of the encoding (MIBenum).
    pub encoding: u16,
    /// Bytes on the wire.
    pub bytes: Vec<u8>,
}

impl Text {
    /// Encodes a text as ASCII if possible, else as UTF-8.
    pub fn new(text: &str) -> Self {
        Self { encoding: if text.is_ascii() { ASCII } else { UTF8 }, bytes: text.into() }
    }

    /// Returns the text. Other encodings than ASCII and UTF-8, and invalid bytes, are decoded as
    /// far as they are valid UTF-8.
    pub fn as_text(&self) -> std::borrow::Cow<'_, str> {
        String::from_utf8_lossy(&self.bytes)
    }
}

/// A metadata entry.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Datum {
    /// Name, UTF-8.
    pub key: String,
    /// Value.
    pub value: Text,
}

impl Datum {
    /// Creates an entry from two texts.
    pub fn new(key: &str, value: &str) -> Self {
        Self { key: key.into(), value: Text::new(value) }
    }
}

/// The parts of a body of header version 2 (protocol version 3).
pub(super) struct Parts<'a> {
    pub(super) id: u32,
    pub(super) content: Cursor<'a>,
    pub(super) metadata: Vec<Datum>,
}

/// Splits a body that begins at byte `offset` of the message.
pub(super) fn read(body: &[u8], offset: usize) -> Result<Parts<'_>, Trouble> {
    let mut fields = Cursor::new(body, offset);
    let size = usize::from(fields.u16("the extended header's size")?);
    if size < EXTENDED || size > body.len() {
        let problem = format!("the extended header's size is {size}, not {EXTENDED} to {}", body.len());
        return Err(Trouble { fault: Fault::Field, offset, problem });
    }
    let index_bytes = usize::from(fields.u16("the metadata's header's size")?);
    let data_bytes = fields.u32("the metadata's size")?;
    let id = fields.u32("the message's number")?;
    let behind = index_bytes as u64 + u64::from(data_bytes);
    let Some(content_bytes) = ((body.len() - size) as u64).checked_sub(behind) else {
        let left = body.len() - size;
        let problem = format!("the metadata take {behind} bytes, but {left} follow the extended header");
        return Err(Trouble { fault: Fault::Length, offset: offset + 2, problem });
    };
    // At most the length of the body.
    let content_end = size + content_bytes as usize;
    let content = Cursor::new(&body[size..content_end], offset + size);
    let index = Cursor::new(&body[content_end..content_end + index_bytes], offset + content_end);
    let data = Cursor::new(&body[content_end + index_bytes..], offset + content_end + index_bytes);
    Ok(Parts { id, content, metadata: read_metadata(index, data)? })
}

fn read_metadata(mut index: Cursor<'_>, mut data: Cursor<'_>) -> Result<Vec<Datum>, Trouble> {
    if index.left() == 0 && data.left() == 0 {
        return Ok(Vec::new());
    }
    let count = usize::from(index.u16("the number of metadata")?);
    if index.left() != 8 * count {
        let problem = format!("{count} metadata take {} bytes of header, but there are {}", 8 * count, index.left());
        return index.trouble(Fault::Length, problem);
    }
    let mut metadata = Vec::with_capacity(count);
    for _ in 0..count {
        let key_bytes = usize::from(index.u16("a metadatum's name's size")?);
        let encoding = index.u16("a metadatum's encoding")?;
        let value_bytes = index.u32("a metadatum's size")? as usize;
        let offset = data.offset();
        let key = data.slice("a metadatum's name", key_bytes)?;
        let Ok(key) = std::str::from_utf8(key) else {
            let problem = "a metadatum's name is not UTF-8".into();
            return Err(Trouble { fault: Fault::Field, offset, problem });
        };
        let bytes = data.slice("a metadatum", value_bytes)?.to_vec();
        metadata.push(Datum { key: key.into(), value: Text { encoding, bytes } });
    }
    data.end("the metadata")?;
    Ok(metadata)
}

/// Completes a body that begins at `start` of `out`, with space for the extended header and with
/// its content.
pub(super) fn finish(out: &mut Vec<u8>, start: usize, id: u32, metadata: &[Datum]) -> Result<(), Unwritable> {
    let too_much = |what: &'static str, size: usize| Unwritable::TooMuch { what, size };
    let count = u16::try_from(metadata.len()).map_err(|_| too_much("metadata", metadata.len()))?;
    let index_size = u16::try_from(2 + 8 * metadata.len()).map_err(|_| too_much("metadata", metadata.len()))?;
    let data_bytes: usize = metadata.iter().map(|datum| datum.key.len() + datum.value.bytes.len()).sum();
    let data_size = u32::try_from(data_bytes).map_err(|_| too_much("bytes of metadata", data_bytes))?;
    let extended = &mut out[start..start + EXTENDED];
    extended[..2].copy_from_slice(&(EXTENDED as u16).to_be_bytes());
    extended[2..4].copy_from_slice(&index_size.to_be_bytes());
    extended[4..8].copy_from_slice(&data_size.to_be_bytes());
    extended[8..].copy_from_slice(&id.to_be_bytes());
    out.extend_from_slice(&count.to_be_bytes());
    for Datum { key, value } in metadata {
        let key_size = u16::try_from(key.len()).map_err(|_| too_much("bytes of a metadatum's name", key.len()))?;
        out.extend_from_slice(&key_size.to_be_bytes());
        out.extend_from_slice(&value.encoding.to_be_bytes());
        // Less than their sum, which fits.
        out.extend_from_slice(&(value.bytes.len() as u32).to_be_bytes());
    }
    for Datum { key, value } in metadata {
        out.extend_from_slice(key.as_bytes());
        out.extend_from_slice(&value.bytes);
    }
    Ok(())
}

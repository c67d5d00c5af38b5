//! Limits on an XML text before it is parsed.
//!
//! The parser keeps nodes on the heap but compares every attribute of an element with its other
//! attributes. A hostile file could keep it busy for hours. The parser itself refuses document
//! types, and with them entities.

use std::path::Path;

use super::Error;

/// Largest nesting depth of elements. PLUS files need about ten.
const MAX_DEPTH: usize = 64;
/// Largest size of one tag with its attributes, bytes. The longest of PLUS hold a few hundred.
const MAX_TAG_BYTES: usize = 64 << 10;

/// Refuses texts that nest too deeply or hold a giant tag. Does not check whether the text is
/// XML.
pub(super) fn check_limits(path: &Path, text: &str) -> Result<(), Error> {
    let bytes = text.as_bytes();
    let refuse = |at: usize, problem: String| Error::Xml {
        path: path.to_owned(),
        line: u32::try_from(1 + bytes[..at].iter().filter(|&&b| b == b'\n').count()).unwrap_or(u32::MAX),
        problem,
    };
    let mut depth = 0_usize;
    let mut at = 0;
    while let Some(begin) = text[at..].find('<').map(|offset| at + offset) {
        let rest = &text[begin..];
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")]
            .iter()
            .find(|(open, _)| rest.starts_with(open))
            .map(|(open, close)| rest[open.len()..].find(close).map(|offset| open.len() + offset + close.len()));
        if let Some(length) = skipped {
            // If the end is missing, the parser reports the error.
            let Some(length) = length else { return Ok(()) };
            at = begin + length;
            continue;
        }
        let Some(length) = tag_length(rest.as_bytes()) else {
            return if rest.len() > MAX_TAG_BYTES {
                Err(refuse(begin, format!("a tag of more than {MAX_TAG_BYTES} bytes begins here; correct the file")))
            } else {
                Ok(())
            };
        };
        if rest.starts_with("</") {
            depth = depth.saturating_sub(1);
        } else if !rest[..length].ends_with("/>") {
            depth += 1;
            if depth > MAX_DEPTH {
                return Err(refuse(begin, format!("elements are nested more than {MAX_DEPTH} deep; correct the file")));
            }
        }
        at = begin + length;
    }
    Ok(())
}

/// Returns the length of the tag that begins here, to its `>` outside quotes; `None` when it is
/// not found within the limit.
fn tag_length(tag: &[u8]) -> Option<usize> {
    let mut quote = None;
    for (index, &byte) in tag.iter().take(MAX_TAG_BYTES).enumerate() {
        match (quote, byte) {
            (None, b'>') => return Some(index + 1),
            (None, b'"' | b'\'') => quote = Some(byte),
            (Some(q), b) if b == q => quote = None,
            _ => {}
        }
    }
    None
}

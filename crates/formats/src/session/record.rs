//! Parses records with the `mcap` crate, after a check of their lengths. The crate allocates a
//! text's stated length before comparing it with the record, so that four bytes may request 4
//! GiB. This check measures texts first; no record then needs more memory than it has bytes.

use mcap::records::{Record, op};

/// Leading parts of a record's body, in their order.
enum Part {
    Number(usize),
    /// Bytes after their 32-bit length.
    Text,
    /// Pairs of texts after their total length.
    Texts,
}

/// Parses a complete record, of those kinds in a session that hold texts.
pub(super) fn parse(kind: u8, body: &[u8]) -> Option<Record<'_>> {
    let parts: &[Part] = match kind {
        op::HEADER => &[Part::Text, Part::Text],
        op::METADATA => &[Part::Text, Part::Texts],
        op::SCHEMA => &[Part::Number(2), Part::Text, Part::Text, Part::Text],
        op::CHANNEL => &[Part::Number(2), Part::Number(2), Part::Text, Part::Text, Part::Texts],
        _ => return None,
    };
    fit(parts, body)?;
    mcap::parse_record(kind, body).ok()
}

/// Checks that all parts end within the bytes; `None` otherwise.
fn fit(parts: &[Part], body: &[u8]) -> Option<()> {
    let mut rest = body;
    for part in parts {
        match part {
            Part::Number(bytes) => rest = rest.get(*bytes..)?,
            Part::Text => drop(text(&mut rest)?),
            Part::Texts => {
                let mut pairs = text(&mut rest)?;
                while !pairs.is_empty() {
                    text(&mut pairs)?;
                    text(&mut pairs)?;
                }
            }
        }
    }
    Some(())
}

/// Splits off a text.
fn text<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (length, behind) = rest.split_first_chunk()?;
    let (text, behind) = behind.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *rest = behind;
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(texts: &[&str]) -> Vec<u8> {
        let each = |text: &&str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        texts.iter().flat_map(each).collect()
    }

    fn table(pairs: &[&str]) -> Vec<u8> {
        let pairs = texts(pairs);
        [&(pairs.len() as u32).to_le_bytes()[..], &pairs].concat()
    }

    #[test]
    fn cut_or_overlong_record_is_refused() {
        let bodies = [
            (op::HEADER, texts(&["sonoweave", "a test"])),
            (op::METADATA, [texts(&["sonoweave"]), table(&["a", "b", "cd", ""])].concat()),
            (op::SCHEMA, [vec![1, 0], texts(&["a.B", "protobuf", "data"])].concat()),
            (op::CHANNEL, [vec![1, 0, 2, 0], texts(&["/a", "protobuf"]), table(&["k", "v"])].concat()),
        ];
        for (kind, body) in bodies {
            assert!(parse(kind, &body).is_some(), "{kind}");
            for cut in 0..body.len() {
                assert!(parse(kind, &body[..cut]).is_none(), "{kind} of {cut} bytes");
            }
            // Any four bytes may be a length: changed to 2 GiB, it must end outside the record.
            let lengths = (0..=body.len() - 4).filter(|at| body[at + 1..at + 4] == [0; 3]).collect::<Vec<_>>();
            assert!(lengths.len() >= 2, "{kind}");
            for at in lengths.into_iter().filter(|at| kind != op::CHANNEL || *at >= 4) {
                let mut wrong = body.clone();
                wrong[at + 3] = 0x7f;
                assert!(parse(kind, &wrong).is_none(), "{kind} with a length of 2 GiB at {at}");
            }
        }
        assert!(parse(op::CHUNK, &[0; 64]).is_none(), "chunks are the walker's");
    }
}

//! Records as the `mcap` crate takes them apart. It makes room for a text before it looks whether the record is that long, so that four bytes may ask for 4 GiB: here texts
//! are measured first, and no record needs more memory than it has bytes.

use mcap::records::{Record, op};

/// What a record's body begins with, in its order.
enum Part {
    Number(usize),
    /// Bytes behind their length of 32 bits.
    Text,
    /// Pairs of texts behind the length of them all.
    Texts,
}

/// A record that is whole in its bytes; of those kinds that hold texts and that a session has.
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

/// `None` where a part ends behind the bytes.
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

/// Splits a text off.
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
    fn a_record_is_none_wherever_it_is_cut_and_whichever_length_is_too_large() {
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
            // Any four bytes that are a length: as one of 2 GiB it ends behind the record.
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

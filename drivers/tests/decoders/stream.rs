//! Feeds streams to decoders in pieces, and checks the guarantees of `drivers::framing`.

use std::fmt::Debug;
use std::ops::Range;

use proptest::prelude::*;

use drivers::framing::{Decoder, Format, Losses};

/// A record as text, with its position.
pub(crate) type Found = (String, Range<u64>);

/// Feeds a stream in pieces; their lengths are repeated until the stream ends.
pub(crate) fn decode<F: Format>(format: F, stream: &[u8], pieces: &[usize]) -> (Vec<Found>, Losses)
where
    for<'a> F::Record<'a>: Debug,
{
    let mut decoder = Decoder::new(format);
    let mut found = Vec::new();
    let mut rest = stream;
    let mut pieces = pieces.iter().cycle();
    while !rest.is_empty() {
        let (piece, after) = rest.split_at((*pieces.next().unwrap()).clamp(1, rest.len()));
        decoder.feed(piece, &mut |record, range| found.push((format!("{record:?}"), range)));
        rest = after;
    }
    let in_records: u64 = found.iter().map(|(_, range)| range.end - range.start).sum();
    let losses = decoder.losses();
    assert_eq!(decoder.position(), stream.len() as u64);
    assert_eq!(
        in_records + losses.bytes_skipped + decoder.pending() as u64,
        stream.len() as u64,
        "every byte is in a record, skipped, or waits"
    );
    assert!(found.windows(2).all(|pair| pair[0].1.end <= pair[1].1.start), "records in order, none within another");
    (found, losses)
}

/// Decodes the stream in one piece, and checks that single bytes and these pieces give the same
/// result.
pub(crate) fn decode_any_cut<F: Format + Clone>(format: &F, stream: &[u8], pieces: &[usize]) -> (Vec<Found>, Losses)
where
    for<'a> F::Record<'a>: Debug,
{
    let whole = decode(format.clone(), stream, &[usize::MAX]);
    assert_eq!(decode(format.clone(), stream, &[1]), whole, "byte by byte");
    assert_eq!(decode(format.clone(), stream, pieces), whole, "in pieces of {pieces:?}");
    whole
}

/// Feeds garbage followed by good records. Checks that those ending more than `lock_bytes`
/// later are found, and nothing else.
pub(crate) fn locks<F: Format + Clone>(format: &F, garbage: &[u8], good: &[Vec<u8>], pieces: &[usize])
where
    for<'a> F::Record<'a>: Debug,
{
    let lock = Decoder::new(format.clone()).lock_bytes() as u64;
    let stream = [garbage, &good.concat()].concat();
    let (found, _) = decode_any_cut(format, &stream, pieces);
    // The records' content and positions, without anything before them.
    let (clean, losses) = decode(format.clone(), &good.concat(), &[usize::MAX]);
    assert_eq!((clean.len(), losses.bytes_skipped), (good.len(), 0), "the good records are good");
    let late = |range: &Range<u64>| range.end > garbage.len() as u64 + lock;
    let shift = garbage.len() as u64;
    let expected: Vec<Found> = clean
        .into_iter()
        .map(|(record, range)| (record, range.start + shift..range.end + shift))
        .filter(|(_, range)| late(range))
        .collect();
    let found: Vec<Found> = found.into_iter().filter(|(_, range)| late(range)).collect();
    assert_eq!(found, expected);
}

/// Generates data that may precede good records: nothing, noise, text, and good records with
/// lost or changed bytes.
pub(crate) fn garbage(good: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    let stream = good.concat();
    let cut = {
        let stream = stream.clone();
        (0..=stream.len(), 0..=stream.len()).prop_map(move |(from, to)| stream[from.min(to)..from.max(to)].to_vec())
    };
    let hurt =
        prop::collection::vec((0..stream.len().max(1), any::<u8>(), any::<bool>()), 1..6).prop_map(move |hurts| {
            let mut stream = stream.clone();
            for (at, byte, lost) in hurts {
                match stream.get_mut(at) {
                    Some(_) if lost => drop(stream.remove(at)),
                    Some(there) => *there = byte,
                    None => {}
                }
            }
            stream
        });
    prop_oneof![
        Just(Vec::new()),
        prop::collection::vec(any::<u8>(), 0..300),
        "[ -~\r\n]{0,200}".prop_map(String::into_bytes),
        cut,
        hurt,
    ]
}

/// Generates the lengths of the pieces in which a stream arrives.
pub(crate) fn pieces() -> impl Strategy<Value = Vec<usize>> {
    prop_oneof![prop::collection::vec(1_usize..12, 1..8), prop::collection::vec(1_usize..600, 1..8)]
}

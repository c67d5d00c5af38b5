//! A pass over the elements' headers: finds the pixel data, and checks all lengths.
//!
//! The parser of dicom-rs allocates the length that an element claims. This pass compares each
//! with the file first, so that the parser later allocates no more than the header's bytes.

use std::io::Read;

use dicom_core::header::{HasLength as _, Header as _};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_parser::StatefulDecode as _;
use dicom_parser::dataset::LazyDataToken;
use dicom_parser::dataset::lazy_read::LazyDataSetReader;
use dicom_parser::stateful::decode::StatefulDecoder;
use dicom_transfer_syntax_registry::TransferSyntax;

use crate::image::fault::Fault;

/// Deepest nesting of sequences. The enhanced volume's functional groups need three; the parser
/// recurses, so that a hostile file could otherwise exhaust its stack.
const DEEPEST: usize = 16;

/// A begun part of the data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Sequence,
    Item,
}

/// Element of the pixel data that a walk has found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelElement {
    /// Position of the first pixel in the file.
    pub(super) at: u64,
    /// Length that the file claims, bytes.
    pub(super) bytes: u64,
    pub(super) vr: VR,
}

/// Part of a file that is walked over.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// Position of the reader in the file.
    pub(super) from: u64,
    /// Length of the file, or of the part.
    pub(super) until: u64,
    /// Largest permitted position of the pixel data.
    pub(super) limit: u64,
}

/// Walks up to the pixel data; `None` if there is none.
///
/// # Errors
/// [`Fault`] for lengths beyond the file, a header beyond its limit, nesting beyond [`DEEPEST`],
/// ends of parts that did not begin, and pixels in compressed fragments.
pub(super) fn walk(source: impl Read, syntax: &TransferSyntax, extent: Extent) -> Result<Option<PixelElement>, Fault> {
    let Extent { from, until, limit } = extent;
    let damaged = |at: u64| Fault::field("data set", at, "is damaged or cut short there; copy the file again");
    let decoder = StatefulDecoder::new_with_ts(source, syntax, from).map_err(|_| damaged(from))?;
    let mut reader = LazyDataSetReader::new(decoder);
    let (mut begun, mut reached) = (Vec::new(), from);
    while let Some(token) = reader.advance() {
        match token.map_err(|_| damaged(reached))? {
            LazyDataToken::LazyValue { header, decoder } => {
                let (at, bytes) = (decoder.position(), header.length().get());
                let Some(bytes) = bytes.map(u64::from) else { return Err(damaged(at)) };
                if header.tag() == tags::PIXEL_DATA && begun.is_empty() {
                    return Ok(Some(PixelElement { at, bytes, vr: header.vr() }));
                }
                reached = at.saturating_add(bytes);
                if reached > until {
                    let problem = format!("claims {bytes} bytes, but the file ends after {until}; copy the file again");
                    return Err(Fault::field(name(header.tag()), at, problem));
                }
                if reached > limit {
                    return Err(Fault::Limit {
                        what: "the size of the attributes before the pixels, in bytes,".into(),
                        value: u128::from(reached),
                        limit: u128::from(limit),
                        advice: "raise the header limit if the file is trusted, or remove its private elements",
                    });
                }
                decoder.skip_bytes(bytes as u32).map_err(|_| damaged(at))?;
            }
            LazyDataToken::SequenceStart { tag, .. } => {
                begun.push(Part::Sequence);
                if begun.iter().filter(|part| **part == Part::Sequence).count() > DEEPEST {
                    let problem = format!("is nested more than {DEEPEST} deep; the file is damaged: copy it again");
                    return Err(Fault::field(name(tag), reached, problem));
                }
            }
            LazyDataToken::ItemStart { .. } => begun.push(Part::Item),
            // The parser panics at an item after an end of what did not begin.
            LazyDataToken::ItemEnd if begun.pop() != Some(Part::Item) => return Err(damaged(reached)),
            LazyDataToken::SequenceEnd if begun.pop() != Some(Part::Sequence) => return Err(damaged(reached)),
            LazyDataToken::PixelSequenceStart => {
                let problem = "is in compressed fragments, which are not read; store it uncompressed, as by \
                               `gdcmconv --raw IN.dcm OUT.dcm`";
                return Err(Fault::field(name(tags::PIXEL_DATA), reached, problem));
            }
            _ => {}
        }
    }
    Ok(None)
}

/// Returns the name of an attribute, as errors give it: its keyword, else its number.
pub(super) fn name(tag: Tag) -> String {
    use dicom_core::dictionary::{DataDictionary as _, DataDictionaryEntry as _};
    let entry = dicom_dictionary_std::StandardDataDictionary.by_tag(tag);
    entry.map_or_else(|| format!("({:04x},{:04x})", tag.group(), tag.element()), |entry| entry.alias().to_owned())
}

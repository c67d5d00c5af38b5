//! Header fields with their byte offsets, for any grammar, and the lines that contain them. No
//! I/O.
//!
//! A grammar splits a line into name and value and finds the header's end. All else is the same
//! for every format: global fields, per-frame fields (`Seq_FrameNNNN_Name`), limits and error
//! checks.

use std::collections::HashMap;

use crate::Limits;
use crate::image::fault::{Fault, Field};
use crate::image::layout::Claims;
use crate::image::place::Place;

/// Longest header line, bytes. Without this bound, a binary file without line ends would be
/// read up to the header limit.
const LINE_BYTES: usize = 1 << 20;

/// Limit on different names of per-frame fields. Real files have about twenty; the bound keeps
/// the name table small for any file.
const FRAME_FIELD_NAMES: usize = 4096;

/// Limit on global fields. Real files have about twenty.
const GLOBAL_FIELDS: usize = 65_536;

/// Syntax of a format's header, and the meaning of its fields.
pub(crate) struct Grammar {
    /// The format's name, for messages.
    pub(crate) name: &'static str,
    /// Parses a line's trimmed text; returns true after the header's last line.
    pub(crate) line: fn(&mut Parser, &str) -> Result<bool, Fault>,
    /// Checks a header that ends with its file; returns the fault, or `None` if it is complete.
    pub(crate) truncated: fn(&Header) -> Option<Fault>,
    /// Returns the header's description of its pixel data.
    pub(crate) claims: fn(&Header) -> Result<Claims<'_>, Fault>,
    /// Returns the position of a volume in space.
    pub(crate) place: fn(&Header) -> Result<Place, Fault>,
    /// Returns a sequence's pixel spacing along the first and second axis, mm, and the value
    /// given for the frame axis. `None` if the file gives no readable spacing.
    pub(crate) spacing: fn(&Header) -> Option<[f64; 3]>,
    /// Returns the items' times, s, if they are given outside the items' fields.
    pub(crate) times: fn(&Header) -> Result<Option<Vec<f64>>, Fault>,
    /// Returns whether a field describes storage or position of the pixels, which the readers
    /// report separately.
    pub(crate) is_structure: fn(&str) -> bool,
}

/// A field of one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FrameField {
    pub(crate) frame: u64,
    /// Index into [`Header::names`].
    pub(crate) name: u32,
    pub(crate) value: Box<str>,
    pub(crate) offset: u64,
}

/// A complete header. Names are unique within the global fields and within each frame.
pub(crate) struct Header {
    pub(crate) grammar: &'static Grammar,
    /// In file order.
    pub(crate) global: Vec<Field>,
    /// Names of per-frame fields (the part after `Seq_FrameNNNN_`), in order of first
    /// appearance.
    pub(crate) names: Vec<Box<str>>,
    /// Sorted by frame; within a frame in file order.
    pub(crate) frames: Vec<FrameField>,
    /// End of the header and beginning of the data, bytes.
    pub(crate) end: u64,
}

impl Header {
    /// Returns the global field of that name.
    pub(crate) fn get(&self, name: &str) -> Option<&Field> {
        self.global.iter().find(|field| &*field.name == name)
    }

    /// Returns the global field of that name, or a fault if it is missing.
    pub(crate) fn required(&self, name: &str) -> Result<&Field, Fault> {
        self.get(name).ok_or_else(|| {
            Fault::field(name, self.end, "is missing from the header, which ends here; add it or write the file again")
        })
    }

    /// Returns the field with the kinds of the axes.
    pub(crate) fn kinds(&self) -> Option<&Field> {
        self.get("Kinds").or_else(|| self.get("kinds"))
    }

    /// Returns the global fields that the readers do not report otherwise, in file order.
    pub(crate) fn further_fields(&self) -> Vec<(String, String)> {
        let others = self.global.iter().filter(|field| !(self.grammar.is_structure)(&field.name));
        others.map(|field| (field.name.to_string(), field.value.to_string())).collect()
    }

    /// Returns a per-frame field's name as written in the file, except for leading zeros of the
    /// frame number.
    pub(crate) fn full_name(&self, field: &FrameField) -> String {
        full_name(field.frame, &self.names[field.name as usize])
    }

    /// Creates a fault of a per-frame field.
    pub(crate) fn frame_fault(&self, field: &FrameField, problem: impl ToString) -> Fault {
        Fault::field(self.full_name(field), field.offset, problem)
    }
}

/// Returns a per-frame field's name in the spelling of PLUS.
pub(crate) fn full_name(frame: u64, name: &str) -> String {
    format!("Seq_Frame{frame:04}_{name}")
}

/// Parses a header line by line.
pub(crate) struct Parser {
    limits: Limits,
    lines: u64,
    header: Header,
    ids: HashMap<Box<str>, u32>,
}

impl Parser {
    pub(crate) fn new(grammar: &'static Grammar, limits: Limits) -> Self {
        let header = Header { grammar, global: Vec::new(), names: Vec::new(), frames: Vec::new(), end: 0 };
        Self { limits, lines: 0, header, ids: HashMap::new() }
    }

    /// Returns the maximum length of the next line, bytes, including its end. A line reader
    /// needs one byte more at most.
    pub(crate) fn room(&self) -> usize {
        let left = self.limits.header_bytes.saturating_sub(self.header.end);
        usize::try_from(left).unwrap_or(usize::MAX).min(LINE_BYTES)
    }

    /// Returns the fault of a line longer than [`Parser::room`].
    fn overflow(&self) -> Fault {
        if self.room() == LINE_BYTES {
            self.unnamed(format!(
                "is longer than {LINE_BYTES} bytes; this is not a {} header, or a damaged one: check that the name fits the content",
                self.header.grammar.name
            ))
        } else {
            Fault::Limit {
                what: "the header's size in bytes".into(),
                value: u128::from(self.limits.header_bytes) + 1,
                limit: u128::from(self.limits.header_bytes),
                advice: "raise the header limit if the file is trusted, or split the recording",
            }
        }
    }

    /// Handles the end of a file whose header has no final line.
    pub(crate) fn file_ends(&self) -> Result<(), Fault> {
        (self.header.grammar.truncated)(&self.header).map_or(Ok(()), Err)
    }

    /// Creates a fault of the present line.
    pub(crate) fn unnamed(&self, problem: impl ToString) -> Fault {
        Fault::field(format!("line {}", self.lines + 1), self.header.end, problem)
    }

    /// Creates a fault of the present line, which does not look like one of this format.
    pub(crate) fn foreign(&self, what: &str) -> Fault {
        self.unnamed(format!(
            "{what}; this is not a {} header, or a damaged one: check the name, or copy the file again",
            self.header.grammar.name
        ))
    }

    /// Creates a fault of the named field in the present line.
    pub(crate) fn named(&self, name: &str, problem: impl ToString) -> Fault {
        Fault::field(name, self.header.end, problem)
    }

    /// Returns whether no line was parsed yet.
    pub(crate) fn is_first(&self) -> bool {
        self.lines == 0
    }

    /// Parses the next line, which includes its line end and is at most [`Parser::room`] long.
    /// Returns true after the last line.
    pub(crate) fn line(&mut self, line: &[u8]) -> Result<bool, Fault> {
        if line.len() > self.room() {
            return Err(self.overflow());
        }
        let text = text(line);
        let text = text.trim();
        if text.contains(|c: char| c.is_control() && c != '\t') {
            return Err(self.foreign("holds control characters"));
        }
        let last = (self.header.grammar.line)(self, text)?;
        self.header.end += line.len() as u64;
        self.lines += 1;
        Ok(last)
    }

    /// Adds a field of the present line: to a frame if its name says so, else to the global
    /// fields.
    pub(crate) fn field(&mut self, name: &str, value: &str) -> Result<(), Fault> {
        if let Some(rest) = name.strip_prefix("Seq_Frame") {
            let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let (number, of_frame) = rest.split_at(digits);
            let Some(of_frame) = of_frame.strip_prefix('_').filter(|name| !name.is_empty() && !number.is_empty())
            else {
                return Err(Fault::field(
                    name,
                    self.header.end,
                    "is not a valid name of a frame's field: it must be Seq_Frame, the frame's number, an underscore and a name",
                ));
            };
            return self.frame_field(name, number, of_frame, value);
        }
        if self.header.global.len() >= GLOBAL_FIELDS {
            return Err(self.unnamed(format!("exceeds the limit of {GLOBAL_FIELDS} fields; remove unused fields")));
        }
        self.header.global.push(Field { name: name.into(), value: value.into(), offset: self.header.end });
        Ok(())
    }

    /// Adds a field of frame `number`; `whole` is its name in the present line.
    pub(crate) fn frame_field(&mut self, whole: &str, number: &str, name: &str, value: &str) -> Result<(), Fault> {
        let offset = self.header.end;
        let frame: u64 =
            number.parse().map_err(|_| Fault::field(whole, offset, "has a frame number beyond 64 bits; correct it"))?;
        if frame >= self.limits.items {
            return Err(Fault::Limit {
                what: format!("field {whole} (byte {offset}): the number of frames"),
                value: u128::from(frame) + 1,
                limit: u128::from(self.limits.items),
                advice: "raise the frame limit if the file is trusted, or split the recording",
            });
        }
        let name = match self.ids.get(name) {
            Some(&id) => id,
            None => self.add_name(whole, name)?,
        };
        self.header.frames.push(FrameField { frame, name, value: value.into(), offset });
        Ok(())
    }

    fn add_name(&mut self, whole: &str, name: &str) -> Result<u32, Fault> {
        if self.header.names.len() >= FRAME_FIELD_NAMES {
            let problem =
                format!("exceeds the limit of {FRAME_FIELD_NAMES} names of frames' fields; use fewer different names");
            return Err(Fault::field(whole, self.header.end, problem));
        }
        let id = u32::try_from(self.header.names.len()).unwrap_or(u32::MAX);
        self.header.names.push(name.into());
        self.ids.insert(name.into(), id);
        Ok(id)
    }

    /// Sorts the fields by frame and refuses duplicates.
    pub(crate) fn finish(mut self) -> Result<Header, Fault> {
        let mut seen: HashMap<&str, u64> = HashMap::with_capacity(self.header.global.len());
        for field in &self.header.global {
            if let Some(first) = seen.insert(&field.name, field.offset) {
                return Err(field.fault(repeated(first)));
            }
        }
        self.header.frames.sort_by_key(|field| field.frame);
        // Sorted by name within a frame: a hostile frame with very many fields must not cost a
        // quadratic search.
        let mut by_name: Vec<&FrameField> = Vec::new();
        for fields in self.header.frames.chunk_by(|a, b| a.frame == b.frame) {
            by_name.clear();
            by_name.extend(fields);
            by_name.sort_by_key(|field| (field.name, field.offset));
            if let Some(pair) = by_name.windows(2).find(|pair| pair[0].name == pair[1].name) {
                return Err(self.header.frame_fault(pair[1], repeated(pair[0].offset)));
            }
        }
        Ok(self.header)
    }
}

fn repeated(first: u64) -> String {
    format!("repeats the field at byte {first}; remove one of them")
}

/// Decodes a line. Headers declare no encoding: the line is UTF-8 if valid, else Latin-1. This
/// loses no bytes, and no file is refused because of a comment.
fn text(line: &[u8]) -> String {
    match std::str::from_utf8(line) {
        Ok(text) => text.to_owned(),
        Err(_) => line.iter().map(|&byte| char::from(byte)).collect(),
    }
}

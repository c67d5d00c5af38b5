//! A header's fields with their byte offsets, whatever grammar they were written in, and the lines that they come from. Without I/O.
//!
//! A grammar says how a line is cut into name and value and where the header ends; all else is the same for every format: the fields of the whole file,
//! those of single frames (`Seq_FrameNNNN_Name`), limits, and what is refused.

use std::collections::HashMap;
use std::path::Path;

use super::layout::Claims;
use super::volume::Place;
use crate::Error;
use crate::recording::Limits;

/// A longer line is no header line: without this bound a binary file that holds no line end would be read up to the header limit.
const LINE_BYTES: usize = 1 << 20;

/// Different names of per-frame fields. Real files have some twenty; the bound keeps the table of names small whatever a file claims.
const FRAME_FIELD_NAMES: usize = 4096;

/// Fields that belong to the whole file. Real files have some twenty.
const GLOBAL_FIELDS: usize = 65_536;

/// How a format writes its header, and what its fields mean.
pub(crate) struct Grammar {
    /// The format's name, for sentences.
    pub(crate) name: &'static str,
    /// Takes a line's text without surrounding space; true when it was the header's last.
    pub(crate) line: fn(&mut Parser, &str) -> Result<bool, Fault>,
    /// What is wrong with a header that ends with its file; `None` if nothing is.
    pub(crate) truncated: fn(&Header) -> Option<Fault>,
    /// What the header says of its pixel data.
    pub(crate) claims: fn(&Header) -> Result<Claims<'_>, Fault>,
    /// Where a volume lies.
    pub(crate) place: fn(&Header) -> Result<Place, Fault>,
    /// How far a sequence's pixels are apart along the first and second axis, mm, and what the file says so of the frames; `None` where it says nothing that can be read.
    pub(crate) spacing: fn(&Header) -> Option<[f64; 3]>,
    /// The items' times, s, where something other than their fields says them.
    pub(crate) times: fn(&Header) -> Result<Option<Vec<f64>>, Fault>,
    /// Whether a field says how the pixels are stored and where they lie, which the readers say in other words.
    pub(crate) is_structure: fn(&str) -> bool,
}

/// What is wrong with a header, not yet tied to a file.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// A field is missing, malformed or contradicts another.
    Field { field: String, offset: u64, problem: String },
    /// A stated limit was exceeded.
    Limit { what: String, value: u128, limit: u128, advice: &'static str },
}

impl Fault {
    pub(crate) fn field(field: impl Into<String>, offset: u64, problem: impl Into<String>) -> Self {
        Self::Field { field: field.into(), offset, problem: problem.into() }
    }

    /// What is wrong, for who knows the file.
    pub(crate) fn sentence(self) -> String {
        match self {
            Self::Field { field, problem, .. } => format!("field {field}: {problem}"),
            Self::Limit { what, value, limit, advice } => format!("{what} is {value}, more than {limit}: {advice}"),
        }
    }

    /// Names the file.
    pub(crate) fn at(self, path: &Path) -> Error {
        let path = path.to_owned();
        match self {
            Self::Field { field, offset, problem } => Error::Header { path, field, offset, problem },
            Self::Limit { what, value, limit, advice } => Error::Limit { path, what, value, limit, advice },
        }
    }
}

/// A field of the whole file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Field {
    pub(crate) name: Box<str>,
    pub(crate) value: Box<str>,
    /// Where its line begins, bytes from the beginning of the file.
    pub(crate) offset: u64,
}

impl Field {
    /// A fault of this field.
    pub(crate) fn fault(&self, problem: impl Into<String>) -> Fault {
        Fault::field(&*self.name, self.offset, problem)
    }
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

/// A whole header. No two fields of the file, and no two of a frame, have the same name.
pub(crate) struct Header {
    pub(crate) grammar: &'static Grammar,
    /// In file order.
    pub(crate) global: Vec<Field>,
    /// Names of per-frame fields (the part behind `Seq_FrameNNNN_`), in order of first appearance.
    pub(crate) names: Vec<Box<str>>,
    /// By frame, within a frame in file order.
    pub(crate) frames: Vec<FrameField>,
    /// Where the header ends and the data begins, bytes.
    pub(crate) end: u64,
}

impl Header {
    /// The global field of that name.
    pub(crate) fn get(&self, name: &str) -> Option<&Field> {
        self.global.iter().find(|field| &*field.name == name)
    }

    /// The global field of that name, which must be there.
    pub(crate) fn required(&self, name: &str) -> Result<&Field, Fault> {
        self.get(name).ok_or_else(|| {
            Fault::field(name, self.end, "is missing from the header that ends here; add it or write the file again")
        })
    }

    /// The field that says what the axes are.
    pub(crate) fn kinds(&self) -> Option<&Field> {
        self.get("Kinds").or_else(|| self.get("kinds"))
    }

    /// Fields of the whole file that the readers do not say in other words, in file order.
    pub(crate) fn further_fields(&self) -> Vec<(String, String)> {
        let others = self.global.iter().filter(|field| !(self.grammar.is_structure)(&field.name));
        others.map(|field| (field.name.to_string(), field.value.to_string())).collect()
    }

    /// A per-frame field's name as written in the file, up to leading zeros of the frame number.
    pub(crate) fn full_name(&self, field: &FrameField) -> String {
        full_name(field.frame, &self.names[field.name as usize])
    }

    /// A fault of a per-frame field.
    pub(crate) fn frame_fault(&self, field: &FrameField, problem: impl Into<String>) -> Fault {
        Fault::field(self.full_name(field), field.offset, problem)
    }
}

/// A per-frame field's name as PLUS writes it.
pub(crate) fn full_name(frame: u64, name: &str) -> String {
    format!("Seq_Frame{frame:04}_{name}")
}

/// Takes a header line by line.
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

    /// Bytes that the next line may have, its end included. Who reads lines need not hold more than one byte beyond it.
    pub(crate) fn room(&self) -> usize {
        let left = self.limits.header_bytes.saturating_sub(self.header.end);
        usize::try_from(left).unwrap_or(usize::MAX).min(LINE_BYTES)
    }

    /// The fault of a line longer than [`Parser::room`].
    fn overflow(&self) -> Fault {
        if self.room() == LINE_BYTES {
            self.unnamed(format!(
                "is longer than {LINE_BYTES} bytes; this is no {} header, or it is damaged: check that the file is what its name says",
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

    /// The file ends, though no line was the header's last.
    pub(crate) fn file_ends(&self) -> Result<(), Fault> {
        (self.header.grammar.truncated)(&self.header).map_or(Ok(()), Err)
    }

    /// A fault of the line that is being taken.
    pub(crate) fn unnamed(&self, problem: impl Into<String>) -> Fault {
        Fault::field(format!("line {}", self.lines + 1), self.header.end, problem)
    }

    /// A fault of the line that is being taken, which does not look like one of this format.
    pub(crate) fn foreign(&self, what: &str) -> Fault {
        self.unnamed(format!("{what}; this is no {} header, or it is damaged", self.header.grammar.name))
    }

    /// A fault of the field of that name in the line that is being taken.
    pub(crate) fn named(&self, name: &str, problem: impl Into<String>) -> Fault {
        Fault::field(name, self.header.end, problem)
    }

    /// Whether no line was taken yet.
    pub(crate) fn is_first(&self) -> bool {
        self.lines == 0
    }

    /// Takes the next line, line end included and not longer than [`Parser::room`]; true when it was the last.
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

    /// A field of the line that is being taken: of a frame if its name says so, else of the whole file.
    pub(crate) fn field(&mut self, name: &str, value: &str) -> Result<(), Fault> {
        if let Some(rest) = name.strip_prefix("Seq_Frame") {
            let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let (number, of_frame) = rest.split_at(digits);
            let Some(of_frame) = of_frame.strip_prefix('_').filter(|name| !name.is_empty() && !number.is_empty())
            else {
                return Err(Fault::field(
                    name,
                    self.header.end,
                    "is no name of a frame's field: it must be Seq_Frame, the frame's number, an underscore and a name",
                ));
            };
            return self.frame_field(name, number, of_frame, value);
        }
        if self.header.global.len() >= GLOBAL_FIELDS {
            return Err(
                self.unnamed(format!("is one field more than {GLOBAL_FIELDS}; remove fields that nobody reads"))
            );
        }
        self.header.global.push(Field { name: name.into(), value: value.into(), offset: self.header.end });
        Ok(())
    }

    /// A field of frame `number` in the line that is being taken; `whole` is its name there.
    pub(crate) fn frame_field(&mut self, whole: &str, number: &str, name: &str, value: &str) -> Result<(), Fault> {
        let offset = self.header.end;
        let frame: u64 =
            number.parse().map_err(|_| Fault::field(whole, offset, "has a frame number beyond 64 bits"))?;
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
                format!("is one name of a frame's field more than {FRAME_FIELD_NAMES}; use fewer different names");
            return Err(Fault::field(whole, self.header.end, problem));
        }
        let id = u32::try_from(self.header.names.len()).unwrap_or(u32::MAX);
        self.header.names.push(name.into());
        self.ids.insert(name.into(), id);
        Ok(id)
    }

    /// Orders the fields by frame and refuses repeated ones.
    pub(crate) fn finish(mut self) -> Result<Header, Fault> {
        let mut seen: HashMap<&str, u64> = HashMap::with_capacity(self.header.global.len());
        for field in &self.header.global {
            if let Some(first) = seen.insert(&field.name, field.offset) {
                return Err(field.fault(repeated(first)));
            }
        }
        self.header.frames.sort_by_key(|field| field.frame);
        // Sorted by name within a frame: a hostile frame with very many fields must not cost a quadratic search.
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
    format!("is a repetition of the field of the same name at byte {first}; remove one of them")
}

/// Headers have no declared encoding: UTF-8 where it is valid, else each byte is the character of the same number (Latin-1), so that
/// nothing is lost and no file is refused for a comment.
fn text(line: &[u8]) -> String {
    match std::str::from_utf8(line) {
        Ok(text) => text.to_owned(),
        Err(_) => line.iter().map(|&byte| char::from(byte)).collect(),
    }
}

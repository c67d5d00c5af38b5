//! The grammar of MetaImage headers, without I/O: lines in, fields with their byte offsets out.
//!
//! A header is lines of `Name = value`, ended by `ElementDataFile`; pixel data begins behind that line. Sequence files add
//! `Seq_FrameNNNN_Name = value` for each frame.

use std::collections::HashMap;
use std::path::Path;

use crate::Error;
use crate::recording::Limits;

/// A longer line is no header line: without this bound a binary file that holds no line end would be read up to the header limit.
const LINE_BYTES: usize = 1 << 20;

/// Different names of per-frame fields. Real files have some twenty; the bound keeps the table of names small whatever a file claims.
const FRAME_FIELD_NAMES: usize = 4096;

/// Fields that belong to the whole file. Real files have some twenty.
const GLOBAL_FIELDS: usize = 65_536;

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
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Header {
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
#[derive(Debug)]
pub(crate) struct Parser {
    limits: Limits,
    lines: u64,
    header: Header,
    ids: HashMap<Box<str>, u32>,
}

impl Parser {
    pub(crate) fn new(limits: Limits) -> Self {
        Self { limits, lines: 0, header: Header::default(), ids: HashMap::new() }
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
                "is longer than {LINE_BYTES} bytes; this is no MetaImage header, or it is damaged: check that the file is what its name says"
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

    /// The fault of a file that ends before `ElementDataFile`.
    pub(crate) fn truncated(&self) -> Fault {
        Fault::field(
            "ElementDataFile",
            self.header.end,
            "was not reached: the file ends inside its header; copy or record it again",
        )
    }

    fn unnamed(&self, problem: impl Into<String>) -> Fault {
        Fault::field(format!("line {}", self.lines + 1), self.header.end, problem)
    }

    /// Takes the next line, line end included and not longer than [`Parser::room`]; true when it was the last.
    pub(crate) fn line(&mut self, line: &[u8]) -> Result<bool, Fault> {
        if line.len() > self.room() {
            return Err(self.overflow());
        }
        let offset = self.header.end;
        let text = text(line);
        let text = text.trim();
        if text.is_empty() {
            self.advance(line);
            return Ok(false);
        }
        if offset == 0 && text.starts_with("NRRD") {
            return Err(self.unnamed("is an NRRD file's; only MetaImage sequences are read: convert it to .igs.mha"));
        }
        if text.contains(|c: char| c.is_control() && c != '\t') {
            return Err(self.unnamed("holds control characters; this is no MetaImage header, or it is damaged"));
        }
        let Some((name, value)) = text.split_once('=') else {
            return Err(self.unnamed("has no `=`; this is no MetaImage header, or it is damaged"));
        };
        let (name, value) = (name.trim_end(), value.trim_start());
        if name.is_empty() {
            return Err(self.unnamed("has no name before its `=`; give it one or remove the line"));
        }
        if let Some(rest) = name.strip_prefix("Seq_Frame") {
            let field = self.frame_field(name, rest, value)?;
            self.header.frames.push(field);
        } else {
            if self.header.global.len() >= GLOBAL_FIELDS {
                return Err(
                    self.unnamed(format!("is one field more than {GLOBAL_FIELDS}; remove fields that nobody reads"))
                );
            }
            self.header.global.push(Field { name: name.into(), value: value.into(), offset });
        }
        self.advance(line);
        Ok(name == "ElementDataFile")
    }

    fn advance(&mut self, line: &[u8]) {
        self.header.end += line.len() as u64;
        self.lines += 1;
    }

    fn frame_field(&mut self, whole: &str, rest: &str, value: &str) -> Result<FrameField, Fault> {
        let offset = self.header.end;
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let (number, name) = rest.split_at(digits);
        let Some(name) = name.strip_prefix('_').filter(|name| !name.is_empty() && !number.is_empty()) else {
            return Err(Fault::field(
                whole,
                offset,
                "is no name of a frame's field: it must be Seq_Frame, the frame's number, an underscore and a name",
            ));
        };
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
        Ok(FrameField { frame, name, value: value.into(), offset })
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

/// A truth value: MetaImage writes `True` and `False`; `1`, `0` and other cases are met too.
pub(crate) fn truth(field: &Field) -> Result<bool, Fault> {
    match field.value.as_bytes() {
        [b'T' | b't' | b'1', ..] => Ok(true),
        [b'F' | b'f' | b'0', ..] => Ok(false),
        _ => Err(field.fault(format!("is {:?}, neither True nor False; write one of them", &*field.value))),
    }
}

/// A whole number that is not negative.
pub(crate) fn whole(text: &str) -> Result<u64, String> {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    match text.parse::<u64>() {
        Ok(number) => Ok(number),
        Err(_) if text.strip_prefix('-').is_some_and(digits) => {
            Err(format!("{text} is negative; it must be a whole number from 0 on"))
        }
        Err(_) if digits(text) => Err(format!("{text} does not fit 64 bits; the header is damaged")),
        Err(_) => Err(format!("{text:?} is not a whole number from 0 on; correct it")),
    }
}

/// Exactly `N` numbers. NaN and infinities are numbers here, in C's, MSVC's and Rust's spelling; who needs finite ones checks.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let mut numbers = [0.0; N];
    let mut count = 0;
    for token in text.split_whitespace() {
        let Some(value) = number(token) else {
            return Err(format!("{token:?}, number {} of {N}, is not a number; correct it", count + 1));
        };
        if let Some(slot) = numbers.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    if count == N {
        Ok(numbers)
    } else {
        Err(format!("holds {count} numbers, but must hold exactly {N}; the line is damaged or was edited"))
    }
}

/// A number in decimal notation.
pub(crate) fn number(token: &str) -> Option<f64> {
    token.parse().ok().or_else(|| {
        let magnitude = token.trim_start_matches(['+', '-']).to_ascii_lowercase();
        let negative = token.starts_with('-');
        if magnitude.starts_with("1.#inf") {
            Some(if negative { f64::NEG_INFINITY } else { f64::INFINITY })
        } else if magnitude.starts_with("1.#") || (magnitude.starts_with("nan(") && magnitude.ends_with(')')) {
            Some(f64::NAN)
        } else {
            None
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &[u8]) -> Result<Header, Fault> {
        let mut parser = Parser::new(Limits::default());
        for line in text.split_inclusive(|&b| b == b'\n') {
            if parser.line(line)? {
                return parser.finish();
            }
        }
        Err(parser.truncated())
    }

    fn problem(text: &[u8]) -> (String, u64, String) {
        match parse(text).unwrap_err() {
            Fault::Field { field, offset, problem } => (field, offset, problem),
            limit @ Fault::Limit { .. } => panic!("{limit:?}"),
        }
    }

    #[test]
    fn spacing_line_ends_and_order_do_not_matter_and_offsets_are_those_of_the_lines() {
        let header = parse(
            b"A=1\r\n\r\n  B  =  x = y \r\nSeq_Frame0001_T = 2\r\nSeq_Frame0_T=1\nElementDataFile = LOCAL\r\nDATA",
        )
        .unwrap();
        let global: Vec<_> = header.global.iter().map(|f| (&*f.name, &*f.value, f.offset)).collect();
        assert_eq!(global, [("A", "1", 0), ("B", "x = y", 7), ("ElementDataFile", "LOCAL", 59)]);
        let frames: Vec<_> = header.frames.iter().map(|f| (f.frame, f.name, &*f.value, f.offset)).collect();
        assert_eq!(frames, [(0, 0, "1", 44), (1, 0, "2", 23)]);
        assert_eq!(header.full_name(&header.frames[0]), "Seq_Frame0000_T");
        assert_eq!(header.end, 84);
    }

    #[test]
    fn text_that_is_not_utf8_is_kept_byte_by_byte() {
        let header = parse(b"Comment = \xb5m\nElementDataFile = LOCAL").unwrap();
        assert_eq!(&*header.global[0].value, "µm");
    }

    #[test]
    fn damaged_lines_are_named_with_their_offset() {
        let cases: [(&[u8], &str, u64, &str); 9] = [
            (b"A = 1\nB\n", "line 2", 6, "has no `=`"),
            (b"= 1\n", "line 1", 0, "no name before"),
            (b"A = 1\nB = \x01\n", "line 2", 6, "control characters"),
            (b"NRRD0004\n", "line 1", 0, "NRRD"),
            (b"Seq_Frame_T = 1\n", "Seq_Frame_T", 0, "no name of a frame's field"),
            (b"Seq_Frame0001_ = 1\n", "Seq_Frame0001_", 0, "no name of a frame's field"),
            (b"Seq_Frame99999999999999999999_T = 1\n", "Seq_Frame99999999999999999999_T", 0, "beyond 64 bits"),
            (b"A = 1\nA = 1\nElementDataFile = LOCAL\n", "A", 6, "repetition of the field of the same name at byte 0"),
            (
                b"Seq_Frame0_T = 1\nSeq_Frame00_T = 1\nElementDataFile = LOCAL\n",
                "Seq_Frame0000_T",
                17,
                "repetition of the field of the same name at byte 0",
            ),
        ];
        for (text, field, offset, says) in cases {
            let (f, o, p) = problem(text);
            assert_eq!((f.as_str(), o), (field, offset), "{p}");
            assert!(p.contains(says), "{p:?} does not say {says:?}");
        }
        assert_eq!(problem(b"A = 1\n").1, 6, "a header without its end is named where the file ends");
    }

    #[test]
    fn names_and_frame_numbers_are_bounded() {
        let mut parser = Parser::new(Limits { items: 10, ..Limits::default() });
        let fault = parser.line(b"Seq_Frame10_T = 1\n").unwrap_err();
        assert!(matches!(fault, Fault::Limit { value: 11, limit: 10, .. }), "{fault:?}");
        for name in 0..FRAME_FIELD_NAMES {
            parser.line(format!("Seq_Frame0_N{name} = 1\n").as_bytes()).unwrap();
        }
        assert!(parser.line(b"Seq_Frame0_One = 1\n").is_err());
    }

    #[test]
    fn numbers_are_counted_and_spelled_as_c_does() {
        assert_eq!(numbers::<3>(" 1  -2.5e-005 3 "), Ok([1.0, -2.5e-5, 3.0]));
        assert_eq!(numbers::<2>("-inf -1.#INF"), Ok([f64::NEG_INFINITY; 2]));
        for nan in ["nan", "-nan", "NaN", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
            assert!(numbers::<1>(nan).unwrap()[0].is_nan(), "{nan}");
        }
        assert!(numbers::<16>(&"1 ".repeat(15)).unwrap_err().contains("holds 15 numbers, but must hold exactly 16"));
        assert!(numbers::<2>("1 2 3").unwrap_err().contains("holds 3 numbers"));
        assert!(numbers::<2>("1 x").unwrap_err().contains("\"x\", number 2 of 2, is not a number"));
    }

    #[test]
    fn whole_numbers_say_why_they_are_not() {
        assert_eq!(whole("12"), Ok(12));
        assert!(whole("-3").unwrap_err().contains("negative"));
        assert!(whole("99999999999999999999").unwrap_err().contains("64 bits"));
        for odd in ["", "-", "1.5", "x", "é"] {
            assert!(whole(odd).unwrap_err().contains("not a whole number"), "{odd}");
        }
    }
}

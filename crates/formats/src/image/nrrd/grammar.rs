//! The grammar of NRRD headers: a version line, lines of `field: value` and `key:=value`,
//! comments, and a blank line before the data. If the data are in a separate file, the header
//! ends with the blank line or with its file.

use crate::image::fault::Fault;
use crate::image::header::{Grammar, Header, Parser};
use crate::image::nrrd::claims::DATA_FILE;
use crate::image::nrrd::{claims, index, place};
use crate::image::sequence::{IMAGE_TYPE, ORIENTATION};

pub(crate) static GRAMMAR: Grammar = Grammar {
    name: "NRRD",
    line,
    truncated,
    claims: claims::claims,
    place: place::place,
    spacing: place::spacing,
    times: index::times,
    is_structure,
};

/// Fields that describe storage and position of the pixels, in the stored spelling: lower case,
/// words separated.
const STRUCTURE: [&str; 29] = [
    "type",
    "dimension",
    "sizes",
    "kinds",
    "encoding",
    "endian",
    DATA_FILE,
    "line skip",
    "byte skip",
    "block size",
    "space",
    "space dimension",
    "space origin",
    "space directions",
    "space units",
    "measurement frame",
    "spacings",
    "thicknesses",
    "axis mins",
    "axis maxs",
    "centers",
    "labels",
    "units",
    "number",
    "min",
    "max",
    "old min",
    "old max",
    "DataNodeClassName",
];

/// Alternative spellings of fields.
const SYNONYMS: [(&str, &str); 12] = [
    ("datafile", DATA_FILE),
    ("lineskip", "line skip"),
    ("byteskip", "byte skip"),
    ("blocksize", "block size"),
    ("axismins", "axis mins"),
    ("axismaxs", "axis maxs"),
    ("centerings", "centers"),
    ("oldmin", "old min"),
    ("oldmax", "old max"),
    ("sampleunits", "sample units"),
    ("spaceunits", "space units"),
    ("spacedimension", "space dimension"),
];

/// Keys of PLUS that have another name in MetaImage.
pub(super) const KEYS: [(&str, &str); 2] =
    [("ultrasound image orientation", ORIENTATION), ("ultrasound image type", IMAGE_TYPE)];

fn is_structure(name: &str) -> bool {
    STRUCTURE.contains(&name)
        || index::is_index(name)
        || index::item(name).is_some()
        || KEYS.iter().any(|(key, _)| *key == name)
}

fn line(parser: &mut Parser, text: &str) -> Result<bool, Fault> {
    if parser.is_first() {
        return match text.strip_prefix("NRRD000") {
            Some("1" | "2" | "3" | "4" | "5") => Ok(false),
            _ => Err(parser.unnamed(format!(
                "is {text:?}; versions NRRD0001 to NRRD0005 are read: write the file with one of them"
            ))),
        };
    }
    if text.is_empty() {
        return Ok(true);
    }
    if text.starts_with('#') {
        return Ok(false);
    }
    let Some((name, value)) = text.split_once(':') else {
        return Err(parser.foreign("has no `:`"));
    };
    let (name, value) = match value.strip_prefix('=') {
        Some(value) => (unescaped(name), unescaped(value.trim_start())),
        None => (field_name(name.trim_end()), value.trim_start().to_owned()),
    };
    let name = name.trim_end();
    if name.is_empty() {
        return Err(parser.unnamed("has no name before its `:`; give it one or remove the line"));
    }
    // Checked here, because the lines after such a field are no header lines.
    if name == DATA_FILE && (value == "LIST" || value.starts_with("LIST ") || value.contains('%')) {
        return Err(parser.named(
            name,
            format!(
                "is {value:?}: data in several files are not supported; write one file (`unu save`, pynrrd and ITK do)"
            ),
        ));
    }
    if let Some((number, of_frame)) = index::item(name) {
        parser.frame_field(name, number, of_frame, &value)?;
    } else {
        let known = KEYS.iter().find(|(key, _)| *key == name);
        parser.field(known.map_or(name, |(_, ours)| ours), &value)?;
    }
    Ok(false)
}

/// Returns NRRD's own fields in one spelling; other names before a colon (PLUS writes fields
/// so) stay unchanged.
fn field_name(name: &str) -> String {
    let small = name.to_ascii_lowercase();
    if let Some((_, usual)) = SYNONYMS.iter().find(|(other, _)| *other == small) {
        return (*usual).to_owned();
    }
    if STRUCTURE.contains(&&*small) { small } else { name.to_owned() }
}

/// Replaces the escapes `\n` and `\\` in keys and values; other characters after a backslash
/// stay unchanged.
fn unescaped(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match (c, rest.peek()) {
            ('\\', Some('n')) => plain.push('\n'),
            ('\\', Some('\\')) => plain.push('\\'),
            _ => {
                plain.push(c);
                continue;
            }
        }
        rest.next();
    }
    plain
}

/// Inserts the escapes that [`unescaped`] replaces.
pub(super) fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('\n', "\\n")
}

fn truncated(header: &Header) -> Option<Fault> {
    let problem = "was not reached: the file ends inside its NRRD header; copy or record it again";
    header.get(DATA_FILE).is_none().then(|| Fault::field("blank line", header.end, problem))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Limits;

    fn parse(text: &str) -> Result<Header, Fault> {
        let mut parser = Parser::new(&GRAMMAR, Limits::default());
        for line in text.split_inclusive('\n') {
            if parser.line(line.as_bytes())? {
                return parser.finish();
            }
        }
        parser.file_ends()?;
        parser.finish()
    }

    #[test]
    fn fields_keys_and_comments_are_parsed_with_offsets() {
        let header = parse(
            "NRRD0005\r\n# a: b\r\nType: uchar\r\nbyteskip: -1\nultrasound image orientation:=MFA\nPath:=C:\\\\new\\n2\nOperator: B. März\n\
             Seq_Frame0001_A:=x: y:=z\naxis 3 item 2 B:=c\n\ndata",
        )
        .unwrap();
        let global: Vec<_> = header.global.iter().map(|f| (&*f.name, &*f.value, f.offset)).collect();
        assert_eq!(
            global,
            [
                ("type", "uchar", 18),
                ("byte skip", "-1", 31),
                (ORIENTATION, "MFA", 44),
                ("Path", "C:\\new\n2", 78),
                ("Operator", "B. März", 95)
            ]
        );
        let frames: Vec<_> =
            header.frames.iter().map(|f| (f.frame, &*header.names[f.name as usize], &*f.value)).collect();
        assert_eq!(frames, [(1, "A", "x: y:=z"), (2, "B", "c")]);
        assert_eq!(header.end, 159);
        assert_eq!(header.further_fields().len(), 3);
    }

    #[test]
    fn escaped_text_roundtrips() {
        for text in ["", "a", "\\", "\\n", "\n", "a\\\\n\nb\\", "C:\\temp"] {
            assert_eq!(unescaped(&escaped(text)), text);
        }
        assert_eq!(unescaped("C:\\temp"), "C:\\temp", "what is no escape is left as it is");
    }

    #[test]
    fn damaged_lines_are_refused_with_offset() {
        let cases = [
            ("NRRD0006\n", "line 1", 0, "NRRD0001 to NRRD0005"),
            ("NRRD0004\ntype\n", "line 2", 9, "has no `:`"),
            ("NRRD0004\n: x\n", "line 2", 9, "no name before"),
            ("NRRD0004\ntype: \u{1}\n", "line 2", 9, "control characters"),
            ("NRRD0004\ndata file: LIST\na.raw\n", "data file", 9, "several files"),
            ("NRRD0004\ndata file: a%03d.raw 1 2 1\n", "data file", 9, "several files"),
            ("NRRD0004\ntype: uchar\n", "blank line", 21, "was not reached"),
            ("NRRD0004\ntype: uchar\nTYPE: uchar\n\n", "type", 21, "repeats the field"),
            ("NRRD0004\naxis 0 item 99999999999999999999 A:=1\n\n", "axis 0 item 99999999999999999999 A", 9, "64 bits"),
        ];
        for (text, field, offset, expected) in cases {
            match parse(text).err().unwrap() {
                Fault::Field { field: f, offset: o, problem } => {
                    assert_eq!((f.as_str(), o), (field, offset), "{problem}");
                    assert!(problem.contains(expected), "{problem:?} does not contain {expected:?}");
                }
                limit @ Fault::Limit { .. } => panic!("{limit:?}"),
            }
        }
        assert!(parse("NRRD0004\ndata file: a.raw\n").is_ok(), "a header without data ends with its file");
    }
}

//! The grammar of MetaImage headers: lines of `Name = value`, ended by `ElementDataFile`. The
//! pixel data follow that line unless it names a file. Sequence files add
//! `Seq_FrameNNNN_Name = value` for each frame.

use crate::image::fault::Fault;
use crate::image::header::{Grammar, Header, Parser};
use crate::image::metaimage::claims::claims;
use crate::image::metaimage::place::{STRUCTURE, place, spacing};

pub(crate) static GRAMMAR: Grammar = Grammar {
    name: "MetaImage",
    line,
    truncated,
    claims,
    place,
    spacing,
    times: |_| Ok(None),
    is_structure: |name| STRUCTURE.contains(&name),
};

fn line(parser: &mut Parser, text: &str) -> Result<bool, Fault> {
    if text.is_empty() {
        return Ok(false);
    }
    let Some((name, value)) = text.split_once('=') else {
        return Err(parser.foreign("has no `=`"));
    };
    let (name, value) = (name.trim_end(), value.trim_start());
    if name.is_empty() {
        return Err(parser.unnamed("has no name before its `=`; give it one or remove the line"));
    }
    parser.field(name, value)?;
    Ok(name == "ElementDataFile")
}

fn truncated(header: &Header) -> Option<Fault> {
    Some(Fault::field(
        "ElementDataFile",
        header.end,
        "was not reached: the file ends inside its header; copy or record it again",
    ))
}

#[cfg(test)]
mod tests {
    use super::super::super::header::Header;
    use super::*;
    use crate::Limits;

    fn parse(text: &[u8]) -> Result<Header, Fault> {
        let mut parser = Parser::new(&GRAMMAR, Limits::default());
        for line in text.split_inclusive(|&b| b == b'\n') {
            if parser.line(line)? {
                return parser.finish();
            }
        }
        parser.file_ends()?;
        parser.finish()
    }

    fn problem(text: &[u8]) -> (String, u64, String) {
        match parse(text).err().unwrap() {
            Fault::Field { field, offset, problem } => (field, offset, problem),
            limit @ Fault::Limit { .. } => panic!("{limit:?}"),
        }
    }

    #[test]
    fn header_lines_parse_in_any_layout_with_offsets() {
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
    fn non_utf8_text_is_read_as_latin1() {
        let header = parse(b"Comment = \xb5m\nElementDataFile = LOCAL").unwrap();
        assert_eq!(&*header.global[0].value, "µm");
    }

    #[test]
    fn damaged_lines_are_refused_with_offset() {
        let cases: [(&[u8], &str, u64, &str); 8] = [
            (b"A = 1\nB\n", "line 2", 6, "has no `=`"),
            (b"= 1\n", "line 1", 0, "no name before"),
            (b"A = 1\nB = \x01\n", "line 2", 6, "control characters"),
            (b"Seq_Frame_T = 1\n", "Seq_Frame_T", 0, "not a valid name of a frame's field"),
            (b"Seq_Frame0001_ = 1\n", "Seq_Frame0001_", 0, "not a valid name of a frame's field"),
            (b"Seq_Frame99999999999999999999_T = 1\n", "Seq_Frame99999999999999999999_T", 0, "beyond 64 bits"),
            (b"A = 1\nA = 1\nElementDataFile = LOCAL\n", "A", 6, "repeats the field at byte 0"),
            (
                b"Seq_Frame0_T = 1\nSeq_Frame00_T = 1\nElementDataFile = LOCAL\n",
                "Seq_Frame0000_T",
                17,
                "repeats the field at byte 0",
            ),
        ];
        for (text, field, offset, expected) in cases {
            let (f, o, p) = problem(text);
            assert_eq!((f.as_str(), o), (field, offset), "{p}");
            assert!(p.contains(expected), "{p:?} does not contain {expected:?}");
        }
        assert_eq!(problem(b"A = 1\n").1, 6, "a header without its end is named where the file ends");
    }

    #[test]
    fn names_and_frame_numbers_are_limited() {
        let mut parser = Parser::new(&GRAMMAR, Limits { items: 10, ..Limits::default() });
        let fault = parser.line(b"Seq_Frame10_T = 1\n").unwrap_err();
        assert!(matches!(fault, Fault::Limit { value: 11, limit: 10, .. }), "{fault:?}");
        for name in 0..4096 {
            parser.line(format!("Seq_Frame0_N{name} = 1\n").as_bytes()).unwrap();
        }
        assert!(parser.line(b"Seq_Frame0_One = 1\n").is_err());
    }
}

//! Opens image files and checks their headers.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::image::data::{Data, open_file};
use crate::image::fault::Fault;
use crate::image::header::{Grammar, Header, Parser};
use crate::image::layout::{Content, Layout};
use crate::image::sequence::Sequence;
use crate::image::{dicom, metaimage, nifti, nrrd};
use crate::{Error, Limits, NoImage};

/// An opened file with a valid header `H`. The reader is at the beginning of the pixel data.
pub struct Opened<H = Sequence> {
    /// Reader, at the first pixel.
    pub reader: BufReader<File>,
    /// File of the reader; differs from the header's if the data have a file of their own.
    pub data_path: PathBuf,
    /// The parsed header.
    pub header: H,
    /// Position and meaning of the pixel data.
    pub layout: Layout,
}

/// Opens a sequence and checks its whole header.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Header`] when it is no sequence or its
/// header is invalid, [`Error::Limit`] when it exceeds the limits.
pub fn open_sequence(path: &Path, limits: &Limits) -> Result<Opened, Error> {
    if let Some(dicom::read::Opened { reader, header, layout }) = dicom::read::open(path, limits)? {
        let dicom::read::Header::Sequence(header) = header else {
            let problem = "makes this a volume; a sequence is an ultrasound multi-frame image";
            return Err(Fault::field("SOPClassUID", layout.data_at, problem).at(path));
        };
        return Ok(Opened { reader, data_path: path.to_owned(), header, layout });
    }
    let Opened { reader, data_path, header, layout } = open(path, limits)?;
    if layout.content == Content::Volume {
        let field = header.kinds().unwrap_or(&layout.shape);
        let problem = "makes this a volume; a sequence of frames has a last axis of kind list, or fields Seq_Frame…";
        return Err(field.fault(problem).at(path));
    }
    let header = Sequence::new(header, &layout).map_err(|fault| fault.at(path))?;
    Ok(Opened { reader, data_path, header, layout })
}

/// Opens an image file and checks the part of its header that describes the pixels.
pub(super) fn open(path: &Path, limits: &Limits) -> Result<Opened<Header>, Error> {
    let (mut reader, bytes) = open_file(path)?;
    let begins = reader.fill_buf().map_err(|source| Error::Io { path: path.to_owned(), doing: "opening", source })?;
    if nifti::read::is_nifti(begins) {
        let problem = "makes this a NIfTI volume (or a compressed file), not a sequence of frames; give a sequence";
        return Err(Fault::field("sizeof_hdr", 0, problem).at(path));
    }
    if let Some(source) = foreign(begins) {
        return Err(Error::NoImage { path: path.to_owned(), source });
    }
    let grammar = if begins.starts_with(b"NRRD") { &nrrd::grammar::GRAMMAR } else { &metaimage::grammar::GRAMMAR };
    let header = read_header(&mut reader, path, grammar, limits)?;
    let claims = (header.grammar.claims)(&header).map_err(|fault| fault.at(path))?;
    let mut data = Data { reader, path: path.to_owned(), at: header.end, bytes: bytes.saturating_sub(header.end) };
    if let Some(field) = claims.data.file {
        data = Data::beside(path, field)?;
    }
    data.skip_lines(claims.data.skip_lines)?;
    let layout = Layout::new(&claims, data.at, data.bytes, limits).map_err(|fault| fault.at(path))?;
    let Data { mut reader, path: data_path, .. } = data;
    match reader.seek(SeekFrom::Start(layout.data_at)) {
        Ok(_) => Ok(Opened { reader, data_path, header, layout }),
        Err(source) => Err(Error::Io { path: data_path, doing: "going to the first pixel", source }),
    }
}

/// Beginnings of files that are taken for images by mistake, and their kinds in words.
const KINDS: [(&[u8], &str); 4] = [
    (b"\x89MCAP", "a recorded session"),
    (b"\x89PNG", "a PNG picture"),
    (b"format = \"sonoweave-", "a configuration or calibration file"),
    (b"<", "an XML file"),
];

/// Returns the kind of a file whose first line is not a header's; `None` if it may be one. A header
/// that is only damaged is left to its parser, which names the place.
fn foreign(begins: &[u8]) -> Option<NoImage> {
    if begins.is_empty() {
        return Some(NoImage::Empty);
    }
    if let Some((_, kind)) = KINDS.iter().find(|(magic, _)| begins.starts_with(magic)) {
        return Some(NoImage::Foreign(kind));
    }
    let mut lines = begins.split_inclusive(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let first = lines.next().unwrap_or(begins);
    if begins.starts_with(b"NRRD") || first.contains(&b'=') {
        return None;
    }
    let is_text = first.utf8_chunks().all(|chunk| {
        let is_cut = chunk.invalid().is_empty() || !first.ends_with(b"\n");
        is_cut && !chunk.valid().contains(|c: char| c.is_control() && !c.is_whitespace())
    });
    Some(NoImage::Foreign(if is_text { "a text" } else { "binary data of another kind" }))
}

/// Opens a NIfTI volume; returns `None` if the file is no NIfTI file.
pub(super) fn open_nifti(path: &Path, limits: &Limits) -> Result<Option<nifti::read::Opened>, Error> {
    let (mut reader, bytes) = open_file(path)?;
    let begins = reader.fill_buf().map_err(|source| Error::Io { path: path.to_owned(), doing: "opening", source })?;
    if !nifti::read::is_nifti(begins) {
        return Ok(None);
    }
    let compressed = begins.starts_with(b"\x1f\x8b");
    nifti::read::open(reader, bytes, path, compressed, limits).map(Some)
}

fn read_header(
    reader: &mut impl BufRead,
    path: &Path,
    grammar: &'static Grammar,
    limits: &Limits,
) -> Result<Header, Error> {
    let mut parser = Parser::new(grammar, *limits);
    let mut line = Vec::new();
    loop {
        line.clear();
        let room = parser.room();
        let read = reader.by_ref().take(room as u64 + 1).read_until(b'\n', &mut line);
        read.map_err(|source| Error::Io { path: path.to_owned(), doing: "reading the header", source })?;
        if line.is_empty() {
            parser.file_ends().map_err(|fault| fault.at(path))?;
            return parser.finish().map_err(|fault| fault.at(path));
        }
        if parser.line(&line).map_err(|fault| fault.at(path))? {
            return parser.finish().map_err(|fault| fault.at(path));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;
    use crate::image::content;

    fn read(bytes: &[u8], header_bytes: u64) -> Result<Header, Error> {
        read_header(
            &mut &*bytes,
            Path::new("f.mha"),
            &metaimage::grammar::GRAMMAR,
            &Limits { header_bytes, ..Limits::default() },
        )
    }

    #[test]
    fn header_and_line_lengths_are_limited() {
        let text = b"A = 1\nElementDataFile = LOCAL\npixels";
        assert_eq!(read(text, 30).unwrap().end, 30);
        let error = read(text, 29).err().unwrap();
        assert!(matches!(error, Error::Limit { value: 30, limit: 29, .. }), "{error}");
        let endless = vec![b'x'; 3 << 20];
        let error = read(&endless, 256 << 20).err().unwrap();
        assert!(error.to_string().contains("line 1 (byte 0): is longer than 1048576 bytes"), "{error}");
    }

    #[test]
    fn truncated_header_is_refused_with_offset() {
        for text in [&b""[..], b"A = 1\n", b"A = 1\nB = 2"] {
            let error = read(text, 1000).err().unwrap();
            let expected = format!("f.mha: field ElementDataFile (byte {}): was not reached", text.len());
            assert!(error.to_string().starts_with(&expected), "{error}");
        }
    }

    #[test]
    fn irregular_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = content(folder.path(), &Limits::default()).unwrap_err();
        assert!(error.to_string().contains("not a regular file"), "{error}");
        let error = content(&folder.path().join("none.mha"), &Limits::default()).unwrap_err();
        assert!(matches!(&error, Error::Io { source, .. } if source.kind() == io::ErrorKind::NotFound), "{error}");
    }
}

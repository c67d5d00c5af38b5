//! MetaImage: tracked sequences as PLUS and 3D Slicer write them (`.igs.mha`, `.mha`), and volumes.
//!
//! In the order of the data: `header` (lines → fields), `layout` (what the pixel data is), `sequence` (what the per-frame
//! fields mean), `stream` (pixels, a frame at a time), `volume` (a volume, a slice at a time), [`write`](mod@write).
//! Reading needs memory for the header and one frame, whatever the file's length.

pub(crate) mod header;
pub(crate) mod layout;
pub(crate) mod sequence;
pub(crate) mod stream;
mod volume;
pub mod write;

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use header::{Header, Parser};
pub use layout::Content;
use layout::Layout;
use stream::Trouble;
pub use volume::{STRUCTURE, VolumeHeader, VolumeReader};

use super::Limits;
use crate::Error;

/// Large enough that reading raw frames is not bound by system calls.
pub(crate) const BUFFER: usize = 256 << 10;

/// An opened file whose header was read and found possible. The reader stands where the pixel data begins.
pub(crate) struct Opened {
    pub(crate) reader: BufReader<File>,
    pub(crate) header: Header,
    pub(crate) layout: Layout,
}

pub(crate) fn open(path: &Path, limits: &Limits) -> Result<Opened, Error> {
    let failed = |doing: &'static str| move |source: io::Error| Error::Io { path: path.to_owned(), doing, source };
    // Asked before opening: opening a pipe would wait for its other end.
    let metadata = fs::metadata(path).map_err(failed("opening"))?;
    if !metadata.is_file() {
        let source = io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file; give the recording's file");
        return Err(failed("opening")(source));
    }
    let mut reader = BufReader::with_capacity(BUFFER, File::open(path).map_err(failed("opening"))?);
    let header = read_header(&mut reader, path, limits)?;
    let layout = Layout::new(&header, metadata.len(), limits).map_err(|fault| fault.at(path))?;
    Ok(Opened { reader, header, layout })
}

fn read_header(reader: &mut impl BufRead, path: &Path, limits: &Limits) -> Result<Header, Error> {
    let mut parser = Parser::new(*limits);
    let mut line = Vec::new();
    loop {
        line.clear();
        let room = parser.room();
        let read = reader.by_ref().take(room as u64 + 1).read_until(b'\n', &mut line);
        read.map_err(|source| Error::Io { path: path.to_owned(), doing: "reading the header", source })?;
        if line.is_empty() {
            return Err(parser.truncated().at(path));
        }
        if parser.line(&line).map_err(|fault| fault.at(path))? {
            return parser.finish().map_err(|fault| fault.at(path));
        }
    }
}

/// Names the file of a trouble in its pixel data.
pub(crate) fn trouble_at(trouble: Trouble, path: &Path) -> Error {
    let path = path.to_owned();
    match trouble {
        Trouble::Io(source) => Error::Io { path, doing: "reading pixels", source },
        Trouble::Data { frame, offset, problem } => Error::Data { path, frame, offset, problem },
    }
}

/// Whether a MetaImage file is a sequence or a volume: by `Kinds` (its last axis is a `list` or not); without it, by its per-frame
/// fields. Only the header is read.
///
/// # Errors
/// [`Error`] when the file cannot be read, is no MetaImage, or its header cannot be true.
pub fn content(path: &Path, limits: &Limits) -> Result<Content, Error> {
    Ok(open(path, limits)?.layout.content)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8], header_bytes: u64) -> Result<Header, Error> {
        read_header(&mut &*bytes, Path::new("f.mha"), &Limits { header_bytes, ..Limits::default() })
    }

    #[test]
    fn a_header_is_bounded_by_its_limit_and_its_lines_by_theirs() {
        let text = b"A = 1\nElementDataFile = LOCAL\npixels";
        assert_eq!(read(text, 30).unwrap().end, 30);
        let error = read(text, 29).unwrap_err();
        assert!(matches!(error, Error::Limit { value: 30, limit: 29, .. }), "{error}");
        let endless = vec![b'x'; 3 << 20];
        let error = read(&endless, 256 << 20).unwrap_err();
        assert!(error.to_string().contains("line 1 (byte 0): is longer than 1048576 bytes"), "{error}");
    }

    #[test]
    fn a_file_that_ends_in_its_header_is_refused_where_it_ends() {
        for text in [&b""[..], b"A = 1\n", b"A = 1\nB = 2"] {
            let error = read(text, 1000).unwrap_err();
            let says = format!("f.mha: field ElementDataFile (byte {}): was not reached", text.len());
            assert!(error.to_string().starts_with(&says), "{error}");
        }
    }

    #[test]
    fn what_is_not_a_regular_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = content(folder.path(), &Limits::default()).unwrap_err();
        assert!(error.to_string().contains("not a regular file"), "{error}");
        let error = content(&folder.path().join("none.mha"), &Limits::default()).unwrap_err();
        assert!(matches!(&error, Error::Io { source, .. } if source.kind() == io::ErrorKind::NotFound), "{error}");
    }
}

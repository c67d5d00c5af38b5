//! Opens regular files, and the file of the pixel data if it is separate from the header.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

use crate::Error;
use crate::image::fault::Field;

/// Buffer size, bytes; large enough that system calls do not limit the reading of raw frames.
pub const BUFFER: usize = 256 << 10;

/// Length limit of a skipped line, bytes.
const LINE_BYTES: u64 = 1 << 20;

/// Opens a regular file; returns reader and length.
pub(super) fn open_file(path: &Path) -> Result<(BufReader<File>, u64), Error> {
    let failed = |source| Error::Io { path: path.to_owned(), doing: "opening", source };
    // Checked before opening: opening a pipe would wait for its other end.
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        let source = io::Error::new(io::ErrorKind::InvalidInput, "not a regular file; give the recording's file");
        return Err(failed(source));
    }
    Ok((BufReader::with_capacity(BUFFER, File::open(path).map_err(failed)?), metadata.len()))
}

/// An opened file of pixel data.
pub(super) struct Data {
    pub(super) reader: BufReader<File>,
    pub(super) path: PathBuf,
    /// Position of the data in the file, and the number of bytes from there on.
    pub(super) at: u64,
    pub(super) bytes: u64,
}

impl Data {
    /// Opens the file named by `field` of the header, beside the header or in a folder there.
    /// Other paths are refused, so that a foreign header cannot read other files of this
    /// machine.
    pub(super) fn beside(header: &Path, field: &Field) -> Result<Self, Error> {
        let name = Path::new(&*field.value);
        let inside = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
        if field.value.is_empty() || !inside {
            let problem = format!(
                "is {:?}; the data file must lie beside the header or in a folder there: move it and correct the name",
                &*field.value
            );
            return Err(field.fault(problem).at(header));
        }
        let folder = header.parent().unwrap_or(Path::new(""));
        let path = folder.join(name);
        match open_file(&path) {
            Ok((reader, bytes)) => Ok(Self { reader, path, at: 0, bytes }),
            Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
                let problem =
                    format!("names the data file {}, which does not exist; put it beside the header", path.display());
                Err(field.fault(problem).at(header))
            }
            Err(other) => Err(other),
        }
    }

    /// Skips lines before the data.
    pub(super) fn skip_lines(&mut self, lines: u64) -> Result<(), Error> {
        let mut line = Vec::new();
        for n in 0..lines {
            line.clear();
            let read = self.reader.by_ref().take(LINE_BYTES).read_until(b'\n', &mut line);
            read.map_err(|source| Error::Io { path: self.path.clone(), doing: "skipping lines", source })?;
            if line.last() != Some(&b'\n') {
                let problem = format!(
                    "the file ends in line {} of the {lines} to be skipped before the data; correct line skip",
                    n + 1
                );
                return Err(Error::Data { path: self.path.clone(), frame: 0, offset: self.at, problem });
            }
            self.at += line.len() as u64;
            self.bytes -= line.len() as u64;
        }
        Ok(())
    }
}

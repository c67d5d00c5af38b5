//! Writes header and pixels to temporary files until they are complete.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use tempfile::NamedTempFile;

use crate::image::data::BUFFER;
use crate::whole::{persist, persist_both, temporary};
use crate::{Error, Unwritable};

/// Level 3 compresses speckle to within 2 % of level 6 in half its time; level 1 gives files a
/// third larger.
const LEVEL: Compression = Compression::new(3);

/// Packing of the pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    Raw,
    Zlib,
    Gzip,
    /// Header and pixels compressed together.
    GzipWhole,
}

/// Bytes before the pixels.
pub(super) struct Head {
    pub(super) bytes: Vec<u8>,
    /// Position in `bytes` of the compressed data's length, written as digits.
    pub(super) size_at: Option<u64>,
    /// Name of a separate pixel file, if there is one.
    pub(super) data_file: Option<String>,
}

/// One or two files being written.
pub(super) struct PixelFile {
    path: PathBuf,
    head: Head,
    body: Body,
    expected: u64,
    written: u64,
}

enum Body {
    Raw(BufWriter<NamedTempFile>),
    Zlib(ZlibEncoder<BufWriter<NamedTempFile>>),
    Gzip(GzEncoder<BufWriter<NamedTempFile>>),
}

impl PixelFile {
    pub(super) fn create(path: &Path, head: Head, packing: Packing, expected: u64) -> Result<Self, Error> {
        let failed = |source| Error::Io { path: path.to_owned(), doing: "creating the file", source };
        let mut file = buffered(path).map_err(failed)?;
        let before = if head.data_file.is_none() { &head.bytes[..] } else { &[] };
        if packing != Packing::GzipWhole {
            file.write_all(before).map_err(failed)?;
        }
        let mut body = match packing {
            Packing::Raw => Body::Raw(file),
            Packing::Zlib => Body::Zlib(ZlibEncoder::new(file, LEVEL)),
            Packing::Gzip | Packing::GzipWhole => Body::Gzip(GzEncoder::new(file, LEVEL)),
        };
        if packing == Packing::GzipWhole {
            body.as_write().write_all(before).map_err(failed)?;
        }
        Ok(Self { path: path.to_owned(), head, body, expected, written: 0 })
    }

    pub(super) fn failed(&self, doing: &'static str, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), doing, source }
    }

    pub(super) fn unwritable(&self, source: Unwritable) -> Error {
        Error::Unwritable { path: self.path.clone(), source }
    }

    pub(super) fn finish(self) -> Result<(), Error> {
        if self.written != self.expected {
            let Self { written, expected, .. } = self;
            return Err(self.unwritable(Unwritable::Unfinished { written, expected }));
        }
        let Self { path, head, body, .. } = self;
        complete(&path, head, body).map_err(|source| Error::Io { path, doing: "completing the file", source })
    }
}

/// Creates a temporary file in the folder of `path`; it is renamed when complete.
fn buffered(path: &Path) -> io::Result<BufWriter<NamedTempFile>> {
    Ok(BufWriter::with_capacity(BUFFER, temporary(path)?))
}

fn complete(path: &Path, mut head: Head, body: Body) -> io::Result<()> {
    let buffered = match body {
        Body::Raw(file) => file,
        Body::Zlib(encoder) => encoder.finish()?,
        Body::Gzip(encoder) => encoder.finish()?,
    };
    let mut file = buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
    let Some(name) = &head.data_file else {
        if let Some(size_at) = head.size_at {
            let size = file.stream_position()? - head.bytes.len() as u64;
            file.seek(SeekFrom::Start(size_at))?;
            file.write_all(size.to_string().as_bytes())?;
        }
        return persist(file, path);
    };
    if let Some(size_at) = head.size_at {
        let digits = file.stream_position()?.to_string();
        head.bytes[size_at as usize..][..digits.len()].copy_from_slice(digits.as_bytes());
    }
    let mut header = temporary(path)?;
    header.write_all(&head.bytes)?;
    persist_both((file, &path.with_file_name(name)), (header, path))
}

impl Body {
    fn as_write(&mut self) -> &mut dyn Write {
        match self {
            Self::Raw(file) => file,
            Self::Zlib(encoder) => encoder,
            Self::Gzip(encoder) => encoder,
        }
    }
}

impl Write for PixelFile {
    fn write(&mut self, pixels: &[u8]) -> io::Result<usize> {
        if pixels.len() as u64 > self.expected - self.written {
            let problem = format!("more pixels were given than the {} bytes that the header promises", self.expected);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
        let written = self.body.as_write().write(pixels)?;
        self.written += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.body.as_write().flush()
    }
}

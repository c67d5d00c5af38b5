//! A header and the pixels behind it, under a temporary name until whole.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use tempfile::NamedTempFile;

use super::text::Text;
use crate::Error;
use crate::recording::image::BUFFER;

/// A header and the pixels behind it, under a temporary name until whole.
pub(super) struct PixelFile {
    path: PathBuf,
    body: Body,
    data_at: u64,
    size_at: Option<u64>,
    expected: u64,
    written: u64,
}

enum Body {
    Raw(BufWriter<NamedTempFile>),
    Zlib(ZlibEncoder<BufWriter<NamedTempFile>>),
}

impl PixelFile {
    pub(super) fn create(path: &Path, text: &Text, compressed: bool, expected: u64) -> Result<Self, Error> {
        let failed = |source| Error::Io { path: path.to_owned(), doing: "creating the file", source };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        builder.prefix(".sonoweave-").suffix(".part");
        // Temporary files are private by default; this one becomes the user's file and gets the rights of any other new file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = BufWriter::with_capacity(BUFFER, builder.tempfile_in(folder).map_err(failed)?);
        file.write_all(text.text.as_bytes()).map_err(failed)?;
        let body = if compressed {
            // On speckle within 2 % of level 6 at half its time; level 1 leaves files a third larger.
            Body::Zlib(ZlibEncoder::new(file, Compression::new(3)))
        } else {
            Body::Raw(file)
        };
        let data_at = text.text.len() as u64;
        Ok(Self { path: path.to_owned(), body, data_at, size_at: text.size_at, expected, written: 0 })
    }

    pub(super) fn failed(&self, doing: &'static str, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), doing, source }
    }

    pub(super) fn misuse(&self, problem: String) -> Error {
        Error::Misuse(format!("{}: {problem}", self.path.display()))
    }

    pub(super) fn finish(self) -> Result<(), Error> {
        if self.written != self.expected {
            return Err(self.misuse(format!(
                "{} of {} bytes of pixels were written; the file is not kept: write all before finishing",
                self.written, self.expected
            )));
        }
        let Self { path, body, data_at, size_at, .. } = self;
        complete(body, data_at, size_at)
            .and_then(|file| file.persist(&path).map_err(|error| error.error))
            .map(|_| ())
            .map_err(|source| Error::Io { path, doing: "completing the file", source })
    }
}

fn complete(body: Body, data_at: u64, size_at: Option<u64>) -> io::Result<NamedTempFile> {
    let buffered = match body {
        Body::Raw(file) => file,
        Body::Zlib(encoder) => encoder.finish()?,
    };
    let mut file = buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
    if let Some(size_at) = size_at {
        let size = file.stream_position()? - data_at;
        file.seek(SeekFrom::Start(size_at))?;
        file.write_all(size.to_string().as_bytes())?;
    }
    // Else a power cut could leave the name on an empty file.
    file.as_file().sync_all()?;
    Ok(file)
}

impl Write for PixelFile {
    fn write(&mut self, pixels: &[u8]) -> io::Result<usize> {
        if pixels.len() as u64 > self.expected - self.written {
            let problem =
                format!("more than the {} bytes of pixels that the header promises were given", self.expected);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, problem));
        }
        let written = match &mut self.body {
            Body::Raw(file) => file.write(pixels)?,
            Body::Zlib(encoder) => encoder.write(pixels)?,
        };
        self.written += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.body {
            Body::Raw(file) => file.flush(),
            Body::Zlib(encoder) => encoder.flush(),
        }
    }
}

//! Format of an image file, from its header.

use std::path::Path;

use crate::image::dicom;
use crate::image::layout::{Content, Encoding};
use crate::image::open::{Opened, open, open_nifti};
use crate::{Error, Limits};

/// Format information from an image file's header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct About {
    /// Sequence or volume, by the kinds of the axes (whether the last is a list). Without
    /// kinds, the per-frame fields decide.
    pub content: Content,
    /// Name of the format.
    pub format: &'static str,
    /// Encoding of the scalars, as text for the user.
    pub encoding: &'static str,
    /// Whether the scalars are compressed.
    pub compressed: bool,
    /// Whether the scalars are stored in big-endian byte order.
    pub big_endian: bool,
}

impl About {
    /// Reads only the header of an image file.
    ///
    /// # Errors
    /// [`Error`] when the file cannot be read, has an unknown format, or has an invalid header.
    pub fn read(path: &Path, limits: &Limits) -> Result<Self, Error> {
        let (format, layout) = if let Some(opened) = dicom::read::open(path, limits)? {
            ("DICOM", opened.layout)
        } else if let Some(opened) = open_nifti(path, limits)? {
            ("NIfTI", opened.layout)
        } else {
            let Opened { header, layout, .. } = open(path, limits)?;
            (header.grammar.name, layout)
        };
        let encoding = match layout.encoding {
            Encoding::Raw => "not compressed",
            Encoding::Zlib => "compressed (zlib)",
            Encoding::Gzip => "compressed (gzip)",
            Encoding::Text => "as text",
        };
        Ok(Self {
            content: layout.content,
            format,
            encoding,
            compressed: matches!(layout.encoding, Encoding::Zlib | Encoding::Gzip),
            big_endian: layout.big_endian,
        })
    }
}

/// Returns whether an image file is a sequence or a volume.
///
/// # Errors
/// The errors of [`About::read`].
pub fn content(path: &Path, limits: &Limits) -> Result<Content, Error> {
    About::read(path, limits).map(|about| about.content)
}

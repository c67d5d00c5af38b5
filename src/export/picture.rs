//! A rendered picture to a PNG file.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageEncoder as _, RgbImage, codecs::png::PngEncoder};

use super::whole::write_whole;
use crate::render::Picture;

/// Why a picture is not in its file.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The encoder's complaint.
    #[error("{path}: the picture cannot be encoded: {source}", path = path.display())]
    Encode {
        /// Where it should have gone.
        path: PathBuf,
        /// Why not.
        source: image::ImageError,
    },
    /// The file system's complaint; nothing was left at the place.
    #[error("{path}: writing the picture failed: {source}", path = path.display())]
    Write {
        /// Where it should have gone.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
}

/// Writes a picture before a background (red, green, blue, 0 to 1) as PNG of three channels of 8 bits, whole or not at all.
///
/// # Errors
/// [`PictureError`]; the place is as before then.
pub fn write_picture(picture: &Picture, background: [f32; 3], path: &Path) -> Result<(), PictureError> {
    write_bytes(&picture.over(background), picture.size, path)
}

/// Writes an 8 bit picture as PNG, whole or not at all.
///
/// # Errors
/// [`PictureError`]; the place is as before then.
pub fn write_rgb(picture: &RgbImage, path: &Path) -> Result<(), PictureError> {
    write_bytes(picture.as_raw(), [picture.width(), picture.height()], path)
}

fn write_bytes(values: &[u8], [width, height]: [u32; 2], path: &Path) -> Result<(), PictureError> {
    let mut png = Cursor::new(Vec::new());
    PngEncoder::new(&mut png)
        .write_image(values, width, height, ExtendedColorType::Rgb8)
        .map_err(|source| PictureError::Encode { path: path.to_owned(), source })?;
    write_whole(path, |to| to.write_all(png.get_ref()))
        .map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        let picture = Picture { size: [2, 1], pixels: vec![[0.5, 0.25, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]] };
        write_picture(&picture, [0.0, 0.0, 1.0], &path).unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        assert_eq!((read.dimensions(), read.into_raw()), ((2, 1), vec![128, 64, 128, 0, 0, 255]));
        let missing = folder.path().join("missing/p.png");
        assert!(write_picture(&picture, [0.0; 3], &missing).unwrap_err().to_string().contains("missing/p.png"));
    }
}

//! Writes a picture, rendered or as received from a device, to a PNG file.

use std::io::Cursor;
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder as _, RgbImage, codecs::png::PngEncoder};

use render::Picture;
use sonoweave_core::reading::PixelType;

use super::ExportError;
use formats::whole::write_whole;

/// Writes a picture over a background (red, green, blue, 0 to 1) as PNG of three channels of 8
/// bits, whole or not at all.
///
/// # Errors
/// [`ExportError`]; an existing file then stays unchanged.
pub fn write_picture(picture: &Picture, background: [f32; 3], path: &Path) -> Result<(), ExportError> {
    write_bytes(&picture.over(background), picture.size, path)
}

/// Writes an 8 bit picture as PNG, whole or not at all.
///
/// # Errors
/// [`ExportError`]; an existing file then stays unchanged.
pub fn write_rgb(picture: &RgbImage, path: &Path) -> Result<(), ExportError> {
    write_bytes(picture.as_raw(), [picture.width(), picture.height()], path)
}

/// Writes a picture as a device delivers it, without loss: 1 to 4 channels of 8 or 16 bits, in
/// native byte order.
///
/// # Errors
/// [`ExportError`], also for other types; an existing file then stays unchanged.
pub fn write_stored(
    values: &[u8],
    size: [u32; 2],
    pixel: PixelType,
    channels: u32,
    path: &Path,
) -> Result<(), ExportError> {
    use ExtendedColorType::{L8, L16, La8, La16, Rgb8, Rgb16, Rgba8, Rgba16};
    let kind = match (pixel, channels) {
        (PixelType::U8, 1) => L8,
        (PixelType::U8, 2) => La8,
        (PixelType::U8, 3) => Rgb8,
        (PixelType::U8, 4) => Rgba8,
        (PixelType::U16, 1) => L16,
        (PixelType::U16, 2) => La16,
        (PixelType::U16, 3) => Rgb16,
        (PixelType::U16, 4) => Rgba16,
        _ => return Err(ExportError::PixelType { path: path.to_owned(), pixel, channels }),
    };
    write_as(values, size, kind, path)
}

fn write_bytes(values: &[u8], size: [u32; 2], path: &Path) -> Result<(), ExportError> {
    write_as(values, size, ExtendedColorType::Rgb8, path)
}

fn write_as(values: &[u8], [width, height]: [u32; 2], kind: ExtendedColorType, path: &Path) -> Result<(), ExportError> {
    let mut png = Cursor::new(Vec::new());
    PngEncoder::new(&mut png)
        .write_image(values, width, height, kind)
        .map_err(|source| ExportError::Encode { path: path.to_owned(), source })?;
    write_whole(path, |to| to.write_all(png.get_ref()))
        .map_err(|source| ExportError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_picture_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        let picture = Picture { size: [2, 1], pixels: vec![[0.5, 0.25, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]] };
        write_picture(&picture, [0.0, 0.0, 1.0], &path).unwrap();
        let read = image::open(&path).unwrap().to_rgb8();
        assert_eq!((read.dimensions(), read.into_raw()), ((2, 1), vec![128, 64, 128, 0, 0, 255]));
        let missing = folder.path().join("missing/p.png");
        assert!(
            matches!(write_picture(&picture, [0.0; 3], &missing), Err(ExportError::Write { path, .. }) if path == missing)
        );
    }
}

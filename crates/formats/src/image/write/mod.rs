//! Writes image files: tracked sequences and volumes.
//!
//! The file name selects the format ([`Container`]). Both writers stream: first the header,
//! then pixels as they come. They write to a temporary file in the target's folder; `finish`
//! renames it to the target. A file of that name is therefore always complete: after an error,
//! or when a writer is dropped, the target is unchanged. A separate pixel file is renamed just
//! before the header, when both are complete. If renaming the header fails, the pixel file is
//! removed again.

mod file;
pub(crate) mod header;

use std::io::{self, Write};
use std::path::Path;

use crate::image::fault::Fault;
use crate::image::header::Parser;
use crate::image::layout::Layout;
use crate::image::nrrd::write::Habit;
use crate::image::sequence::Sequence;
pub use crate::image::sequence_header::{SequenceHeader, SequenceItem};
use crate::image::volume_header::VolumeHeader;
use crate::image::{Container, metaimage, nifti, nrrd};
use crate::{Error, Limits, Unwritable};
use file::{Head, Packing, PixelFile};
use header::Text;

/// Writes a tracked sequence.
pub struct SequenceWriter {
    file: PixelFile,
    frame_bytes: u64,
}

impl SequenceWriter {
    /// Begins a file. The format requires the metadata of all frames first.
    ///
    /// # Errors
    /// [`Error::Unwritable`] when the header would not read back the same (line ends in a text, an
    /// ambiguous frame name, no items, …). [`Error::Io`] when the folder is not writable.
    pub fn create(path: &Path, header: &SequenceHeader) -> Result<Self, Error> {
        let refuse = |source| Error::Unwritable { path: path.to_owned(), source };
        let images = header.size != [0, 0];
        if header.items.is_empty() || (images && header.size.contains(&0)) {
            return Err(refuse(Unwritable::EmptySequence));
        }
        let mut plain = VolumeHeader::new([header.size[0], header.size[1], 0], header.pixel);
        plain.channels = header.channels;
        let frame_bytes = plain.slice_bytes();
        let items = header.items.len() as u64;
        let expected = frame_bytes.and_then(|bytes| bytes.checked_mul(items));
        let (Some(frame_bytes), Some(expected)) = (frame_bytes, expected) else {
            return Err(refuse(Unwritable::TooLarge));
        };
        check_channels(header.channels).map_err(refuse)?;
        let container = Container::of_sequence(path).map_err(refuse)?;
        let compressed = header.compressed && images;
        let data_file = container.data_file(path, compressed);
        let beside = data_file.as_deref();
        let (text, packing) = match container {
            Container::Mha | Container::Mhd => (metaimage::write::sequence(header, compressed, beside), Packing::Zlib),
            Container::Nrrd | Container::Nhdr => {
                (nrrd::write::sequence(header, compressed, Habit::Plus, beside), Packing::Gzip)
            }
            // Names of volumes were refused above.
            Container::SeqNrrd | Container::Nifti | Container::NiftiGz => {
                (nrrd::write::sequence(header, compressed, Habit::Slicer, beside), Packing::Gzip)
            }
        };
        let text = text.map_err(refuse)?;
        check_reading(&text, header).map_err(refuse)?;
        let packing = if compressed { packing } else { Packing::Raw };
        let (bytes, size_at) = text.into_bytes();
        let head = Head { bytes, size_at, data_file };
        Ok(Self { file: PixelFile::create(path, head, packing, expected)?, frame_bytes })
    }

    /// Writes the next frame: scalars in native byte order, first axis fastest. Not called for
    /// a sequence without images.
    ///
    /// # Errors
    /// [`Error::Unwritable`] when the frame's size differs from the header or the frame is one too
    /// many. [`Error::Io`] when it cannot be written.
    pub fn write_frame(&mut self, pixels: &[u8]) -> Result<(), Error> {
        if pixels.len() as u64 != self.frame_bytes {
            let (given, expected) = (pixels.len(), self.frame_bytes);
            return Err(self.file.unwritable(Unwritable::FrameSize { given, expected }));
        }
        self.file.write_all(pixels).map_err(|source| self.file.failed("writing pixels", source))
    }

    /// Completes the file and renames it to the target.
    ///
    /// # Errors
    /// [`Error::Unwritable`] when frames are missing, [`Error::Io`] when the file cannot be
    /// written. The target is then unchanged.
    pub fn finish(self) -> Result<(), Error> {
        self.file.finish()
    }
}

/// Writes a volume. Voxels are passed through [`Write`], in native byte order, x fastest, in
/// pieces of any length.
pub struct VolumeWriter {
    file: PixelFile,
}

impl VolumeWriter {
    /// Begins a file. The world is not an anatomical one, and the file says so unless
    /// `header.fields` holds an `AnatomicalOrientation`.
    ///
    /// # Errors
    /// [`Error::Unwritable`] when the header would not read back the same, [`Error::Io`] when the
    /// folder is not writable.
    pub fn create(path: &Path, header: &VolumeHeader) -> Result<Self, Error> {
        let refuse = |source| Error::Unwritable { path: path.to_owned(), source };
        let expected = header.slice_bytes().and_then(|bytes| bytes.checked_mul(u64::from(header.size[2])));
        let Some(expected) = expected else { return Err(refuse(Unwritable::TooLarge)) };
        if expected == 0 {
            return Err(refuse(Unwritable::EmptyVolume));
        }
        let placed = header.axes.as_flattened().iter().chain(&header.origin).all(|v| v.is_finite());
        if !placed || !header.spacing.iter().all(|&mm| mm.is_finite() && mm > 0.0) {
            return Err(refuse(Unwritable::Place));
        }
        check_channels(header.channels).map_err(refuse)?;
        let container = Container::of_volume(path).map_err(refuse)?;
        let data_file = container.data_file(path, header.compressed);
        let beside = data_file.as_deref();
        let (head, packing) = match container {
            Container::Mha | Container::Mhd => {
                (metaimage::write::volume(header, beside).map(Text::into_bytes), Packing::Zlib)
            }
            Container::Nrrd | Container::Nhdr | Container::SeqNrrd => {
                (nrrd::write::volume(header, beside).map(Text::into_bytes), Packing::Gzip)
            }
            Container::Nifti => (nifti(header), Packing::Raw),
            Container::NiftiGz => (nifti(header), Packing::GzipWhole),
        };
        let (bytes, size_at) = head.map_err(refuse)?;
        let packing = if header.compressed || container == Container::NiftiGz { packing } else { Packing::Raw };
        Ok(Self { file: PixelFile::create(path, Head { bytes, size_at, data_file }, packing, expected)? })
    }

    /// Completes the file and renames it to the target.
    ///
    /// # Errors
    /// [`Error::Unwritable`] when voxels are missing, [`Error::Io`] when the file cannot be
    /// written. The target is then unchanged.
    pub fn finish(self) -> Result<(), Error> {
        self.file.finish()
    }
}

impl Write for VolumeWriter {
    /// Writes voxels; refuses more than the header promises.
    fn write(&mut self, voxels: &[u8]) -> io::Result<usize> {
        self.file.write(voxels)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

fn nifti(header: &VolumeHeader) -> Result<(Vec<u8>, Option<u64>), Unwritable> {
    let fields = metaimage::write::fields(&header.fields)?;
    nifti::write::header(header, &fields).map(|bytes| (bytes, None))
}

fn check_channels(channels: u32) -> Result<(), Unwritable> {
    if (1..=4).contains(&channels) { Ok(()) } else { Err(Unwritable::Channels(channels)) }
}

/// Reads the header back: a field's name may have a meaning that the caller did not intend.
fn check_reading(text: &Text, header: &SequenceHeader) -> Result<(), Unwritable> {
    let limits = Limits { header_bytes: u64::MAX, frame_bytes: u64::MAX, items: u64::MAX, transposed_bytes: u64::MAX };
    let refuse = |fault: Fault| Unwritable::Header(fault.sentence());
    let mut parser = Parser::new(text.style.grammar, limits);
    for line in text.text.split_inclusive('\n') {
        parser.line(line.as_bytes()).map_err(refuse)?;
    }
    let fields = parser.finish().map_err(refuse)?;
    let layout = Layout::to_be_written(header.items.len() as u64, header.size != [0, 0]);
    let read = Sequence::new(fields, &layout).map_err(refuse)?;
    let bits = |matrix: &[f64; 16]| matrix.map(|v| if v.is_nan() { f64::NAN } else { v }.to_bits());
    for (frame, put) in (0..).zip(&header.items) {
        let got = read.item(frame);
        let times = (got.source_s, got.unfiltered_s) == (put.stamp.source_s, put.stamp.unfiltered_s);
        let picture = (got.frame_number, &got.image) == (put.frame_number, &put.status);
        let transforms = got.transforms.len() == put.transforms.len()
            && got.transforms.iter().zip(&put.transforms).all(|(got, put)| {
                let (from, to) = &read.transforms[got.name as usize];
                (from, to, &got.status) == (&put.from, &put.to, &put.status) && bits(&got.matrix) == bits(&put.matrix)
            });
        let others = got.fields.iter().map(|(name, value)| (&*read.names[*name as usize], &**value));
        if !(times && picture && transforms && others.eq(put.fields.iter().map(|(name, value)| (&**name, &**value)))) {
            return Err(Unwritable::Meaning(frame));
        }
    }
    Ok(())
}

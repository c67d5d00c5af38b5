//! Reads a volume slice by slice.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use sonoweave_core::reading::PixelType;

use crate::image::dicom;
use crate::image::fault::Fault;
use crate::image::layout::Layout;
use crate::image::nifti;
use crate::image::open::{open, open_nifti};
use crate::image::scaling::Scaling;
use crate::image::stream::PixelStream;
use crate::image::volume_header::VolumeHeader;
use crate::{Error, Limits};

/// A volume that is read slice by slice.
pub trait VolumeSlices {
    /// Returns the volume's header.
    fn header(&self) -> &VolumeHeader;

    /// Returns the next slice along the third index axis: `size[0]·size[1]·channels` scalars in
    /// native byte order, x fastest. `None` after the last.
    ///
    /// # Errors
    /// [`Error`] when it cannot be read, or is damaged. No slices follow an error.
    fn next_slice(&mut self) -> Result<Option<&[u8]>, Error>;
}

impl VolumeSlices for VolumeReader {
    fn header(&self) -> &VolumeHeader {
        self.header()
    }

    fn next_slice(&mut self) -> Result<Option<&[u8]>, Error> {
        self.next_slice()
    }
}

/// Reads a volume slice by slice. Memory: the header and one slice.
///
/// ```no_run
/// # fn main() -> Result<(), formats::Error> {
/// use formats::{Limits, image::VolumeReader};
/// let mut volume = VolumeReader::open("volume.mha".as_ref(), &Limits::default())?;
/// while let Some(slice) = volume.next_slice()? {
///     // size[0]·size[1]·channels scalars, x fastest
///     let _ = slice.len();
/// }
/// # Ok(())
/// # }
/// ```
pub struct VolumeReader {
    header: VolumeHeader,
    stream: PixelStream<BufReader<File>>,
    left: u32,
    slice: Vec<u8>,
    bytes: usize,
    /// Stored scalar type and scaling, if the values are scaled.
    scaling: Option<(PixelType, Scaling)>,
    scaled: Vec<u8>,
}

impl VolumeReader {
    /// Opens a volume (3 axes, not a list of frames) and reads its header. `limits.frame_bytes`
    /// bounds a slice, `limits.items` the number of slices.
    ///
    /// # Errors
    /// [`Error`] when the file cannot be read, is no such volume, or has an invalid header.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self, Error> {
        if let Some(nifti::read::Opened { reader, header, layout, scaling }) = open_nifti(path, limits)? {
            let scaling = scaling.map(|scaling| (layout.pixel, scaling));
            return Ok(Self { scaling, ..Self::new(path, header, reader, &layout) });
        }
        if let Some(dicom::read::Opened { reader, header, layout }) = dicom::read::open(path, limits)? {
            let dicom::read::Header::Volume(header) = header else {
                let problem = "makes this a sequence of frames, not a volume; reconstruct it first";
                return Err(Fault::field("SOPClassUID", layout.data_at, problem).at(path));
            };
            return Ok(Self::new(path, header, reader, &layout));
        }
        let opened = open(path, limits)?;
        let header = VolumeHeader::new_from(opened.header, &opened.layout).map_err(|fault| fault.at(path))?;
        Ok(Self::new(&opened.data_path, header, opened.reader, &opened.layout))
    }

    fn new(path: &Path, header: VolumeHeader, reader: BufReader<File>, layout: &Layout) -> Self {
        let (left, stream) = (header.size[2], PixelStream::new(reader, path, layout));
        let (slice, scaled) = (Vec::new(), Vec::new());
        Self { header, stream, left, slice, bytes: layout.layer_bytes, scaling: None, scaled }
    }

    /// Returns the volume's header.
    pub fn header(&self) -> &VolumeHeader {
        &self.header
    }

    /// Returns the next slice along the third index axis: `size[0]·size[1]·channels` scalars in
    /// native byte order, x fastest. `None` after the last.
    ///
    /// # Errors
    /// [`Error::Data`] when the voxels do not match the header, [`Error::Io`] when the file
    /// cannot be read. No slices follow an error.
    pub fn next_slice(&mut self) -> Result<Option<&[u8]>, Error> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        self.slice.resize(self.bytes, 0);
        match self.stream.read(&mut self.slice) {
            Ok(()) => Ok(Some(match self.scaling {
                None => &self.slice,
                Some((stored, scaling)) => {
                    scaling.apply(&self.slice, stored, &mut self.scaled);
                    &self.scaled
                }
            })),
            Err(error) => {
                self.left = 0;
                Err(error)
            }
        }
    }
}

//! A volume: its position in space, and its voxels slice by slice.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use sonoweave_core::reading::PixelType;

use crate::image::header::{Fault, Header};
use crate::image::layout::{Content, Encoding, Layout, names_list};
use crate::image::nifti;
use crate::image::stream::PixelStream;
use crate::{Error, Limits};

/// Position of a volume in space: spacing and origin in mm, and the axes' directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub(crate) spacing: [f64; 3],
    pub(crate) origin: [f64; 3],
    pub(crate) axes: [[f64; 3]; 3],
}

impl Place {
    /// Spacing 1 mm, origin 0, axes along x, y, z.
    pub(crate) const PLAIN: Self =
        Self { spacing: [1.0; 3], origin: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };
}

/// Header of a volume file, without the voxels. The same struct is read and written.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeHeader {
    /// Number of voxels along each index axis, the fastest first.
    pub size: [u32; 3],
    /// Distance between the centres of neighbouring voxels along each index axis, mm. Positive.
    pub spacing: [f64; 3],
    /// Position of the centre of voxel (0, 0, 0), mm (`Offset`).
    pub origin: [f64; 3],
    /// Direction of each index axis in space: `axes[i]` is column `i` of ITK's direction
    /// matrix, and the `i`-th triple of `TransformMatrix`.
    pub axes: [[f64; 3]; 3],
    /// Scalar type.
    pub pixel: PixelType,
    /// Channels per voxel, interleaved, 1 to 4.
    pub channels: u32,
    /// Whether the file holds the voxels compressed. For NIfTI the name decides (`.nii.gz`).
    pub compressed: bool,
    /// Whether the file gives the volume's position. NIfTI may omit it; spacing, origin and
    /// axes are then 1, 0 and along x, y, z.
    pub placed: bool,
    /// Further fields of the file, in file order, with the file's names. Per-frame fields are
    /// left out, because they have no meaning in a volume.
    pub fields: Vec<(String, String)>,
}

impl VolumeHeader {
    /// Creates the header of a raw volume of this size and type: spacing 1 mm, origin 0, axes
    /// along x, y, z.
    pub fn new(size: [u32; 3], pixel: PixelType) -> Self {
        let Place { spacing, origin, axes } = Place::PLAIN;
        Self { size, spacing, origin, axes, pixel, channels: 1, compressed: false, placed: true, fields: Vec::new() }
    }

    /// Returns the bytes of one slice; `None` beyond 64 bits.
    pub fn slice_bytes(&self) -> Option<u64> {
        let pixel = self.pixel.bytes() as u64 * u64::from(self.channels);
        (u64::from(self.size[0]) * u64::from(self.size[1])).checked_mul(pixel)
    }

    fn new_from(header: Header, layout: &Layout) -> Result<Self, Fault> {
        let shape = &layout.shape;
        if layout.content == Content::Sequence {
            let list = header.kinds().filter(|kinds| names_list(&kinds.value));
            return Err(match list {
                Some(kinds) => kinds.fault("makes this a sequence of frames, not a volume; reconstruct it first"),
                None if layout.layers == 1 => {
                    shape.fault(format!("is {:?}: this is a single image; a volume has 3 axes", &*shape.value))
                }
                None => shape.fault(
                    "is that of a sequence of frames (fields Seq_Frame…), not of a volume; reconstruct it first",
                ),
            });
        }
        if !layout.has_images() {
            return Err(shape.fault("promises no voxels; the volume is empty"));
        }
        let Place { spacing, origin, axes } = (header.grammar.place)(&header)?;
        let slices = u32::try_from(layout.layers).map_err(|_| shape.fault("has more than 2³² slices"))?;
        Ok(Self {
            spacing,
            origin,
            axes,
            channels: layout.channels,
            compressed: matches!(layout.encoding, Encoding::Zlib | Encoding::Gzip),
            fields: header.further_fields(),
            ..Self::new([layout.size[0], layout.size[1], slices], layout.pixel)
        })
    }
}

/// Scaling of stored values: value = `slope` × stored + `offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scaling {
    pub(crate) slope: f64,
    pub(crate) offset: f64,
}

impl Scaling {
    /// Scalar type of scaled values.
    pub(crate) const PIXEL: PixelType = PixelType::F64;

    fn apply(self, stored: &[u8], pixel: PixelType, values: &mut Vec<u8>) {
        fn each<const N: usize>(stored: &[u8], values: &mut Vec<u8>, value: impl Fn([u8; N]) -> f64) {
            values.extend(stored.as_chunks::<N>().0.iter().flat_map(|word| value(*word).to_ne_bytes()));
        }
        let Self { slope, offset } = self;
        let of = |value: f64| value * slope + offset;
        values.clear();
        match pixel {
            PixelType::U8 => each(stored, values, |b| of(u8::from_ne_bytes(b).into())),
            PixelType::I8 => each(stored, values, |b| of(i8::from_ne_bytes(b).into())),
            PixelType::U16 => each(stored, values, |b| of(u16::from_ne_bytes(b).into())),
            PixelType::I16 => each(stored, values, |b| of(i16::from_ne_bytes(b).into())),
            PixelType::U32 => each(stored, values, |b| of(u32::from_ne_bytes(b).into())),
            PixelType::I32 => each(stored, values, |b| of(i32::from_ne_bytes(b).into())),
            PixelType::U64 => each(stored, values, |b| of(u64::from_ne_bytes(b) as f64)),
            PixelType::I64 => each(stored, values, |b| of(i64::from_ne_bytes(b) as f64)),
            PixelType::F32 => each(stored, values, |b| of(f32::from_ne_bytes(b).into())),
            PixelType::F64 => each(stored, values, |b| of(f64::from_ne_bytes(b))),
        }
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
        if let Some(nifti::read::Opened { reader, header, layout, scaling }) = crate::image::open_nifti(path, limits)? {
            let scaling = scaling.map(|scaling| (layout.pixel, scaling));
            return Ok(Self { scaling, ..Self::new(path, header, reader, &layout) });
        }
        let opened = crate::image::open(path, limits)?;
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

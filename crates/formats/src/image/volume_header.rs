//! Header of a volume file.

use sonoweave_core::reading::PixelType;

use crate::image::fault::Fault;
use crate::image::header::Header;
use crate::image::layout::{Content, Encoding, Layout, names_list};
use crate::image::place::Place;

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

    pub(super) fn new_from(header: Header, layout: &Layout) -> Result<Self, Fault> {
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

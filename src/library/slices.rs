//! A volume in memory, read slice by slice like a file.

use formats::image::{VolumeHeader, VolumeSlices};
use sonoweave_core::reading::PixelType;

/// Values of a volume with its place in space; slices along the third index axis.
#[derive(Debug, Clone)]
pub struct MemorySlices<'a> {
    header: VolumeHeader,
    values: &'a [u8],
}

impl<'a> MemorySlices<'a> {
    /// Takes values, x fastest, in native byte order. `axes` are the directions of the index axes.
    ///
    /// # Panics
    /// When the values are not as many as the size needs: the caller has checked both.
    pub fn new(
        size: [u32; 3],
        (spacing, origin, axes): ([f64; 3], [f64; 3], [[f64; 3]; 3]),
        values: &'a [f32],
        fields: Vec<(String, String)>,
    ) -> Self {
        let voxels: usize = size.iter().map(|n| *n as usize).product();
        assert_eq!(voxels, values.len(), "values do not fill the volume");
        let header = VolumeHeader { spacing, origin, axes, fields, ..VolumeHeader::new(size, PixelType::F32) };
        Self { header, values: bytemuck::cast_slice(values) }
    }
}

impl VolumeSlices for MemorySlices<'_> {
    fn header(&self) -> &VolumeHeader {
        &self.header
    }

    fn next_slice(&mut self) -> Result<Option<&[u8]>, formats::Error> {
        if self.values.is_empty() {
            return Ok(None);
        }
        let bytes = self.header.slice_bytes().and_then(|bytes| usize::try_from(bytes).ok()).unwrap_or(usize::MAX);
        let (slice, rest) = self.values.split_at(bytes.min(self.values.len()));
        self.values = rest;
        Ok(Some(slice))
    }
}

//! Small sequence files, valid and damaged, written by hand: the program's own writer cannot
//! write damaged ones.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::ZlibEncoder;

/// A sequence of parallel slices, 1 mm apart, with pixels of 0.5 mm. A test changes the fields
/// it concerns.
#[derive(Clone)]
pub(crate) struct Sequence {
    pub(crate) size: [u32; 2],
    pub(crate) frames: u32,
    pub(crate) element: &'static str,
    pub(crate) channels: u32,
    /// Further lines of the whole file.
    pub(crate) lines: String,
    pub(crate) zlib: bool,
    pub(crate) big_endian: bool,
    /// The transform's name and its numbers by frame.
    pub(crate) transform: &'static str,
    pub(crate) pose: fn(u32) -> String,
    /// Its status by frame.
    pub(crate) status: fn(u32) -> &'static str,
    /// A pixel's bytes by column, row and frame, little endian.
    pub(crate) pixel: fn(u32, u32, u32) -> Vec<u8>,
}

impl Default for Sequence {
    fn default() -> Self {
        Self {
            size: [40, 30],
            frames: 6,
            element: "MET_UCHAR",
            channels: 1,
            lines: "UltrasoundImageOrientation = MFA\nUltrasoundImageType = BRIGHTNESS\n".into(),
            zlib: false,
            big_endian: false,
            transform: "ImageToReference",
            pose: |frame| pose(f64::from(frame)),
            status: |_| "OK",
            pixel: |u, v, frame| vec![grey(u, v, frame)],
        }
    }
}

/// A smooth image without black pixels or repetition.
pub(crate) fn grey(u: u32, v: u32, frame: u32) -> u8 {
    (40 + 3 * u + v + 10 * frame) as u8
}

/// A slice across z, 0.5 mm per pixel.
pub(crate) fn pose(z: f64) -> String {
    format!("0.5 0 0 0 0 0.5 0 0 0 0 1 {z} 0 0 0 1")
}

impl Sequence {
    /// Returns the header up to the frames' fields.
    fn head(&self, compressed_bytes: Option<usize>) -> String {
        let Self { size: [width, height], frames, .. } = self;
        let order = if self.big_endian { "True" } else { "False" };
        let packing = compressed_bytes.map_or("CompressedData = False\n".to_owned(), |n| {
            format!("CompressedData = True\nCompressedDataSize = {n}\n")
        });
        format!(
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {order}\n{packing}DimSize = {width} {height} {frames}\n\
             Kinds = domain domain list\nElementNumberOfChannels = {}\nElementType = {}\n{}",
            self.channels, self.element, self.lines
        )
    }

    /// Returns all frames' pixels as stored, but not compressed.
    pub(crate) fn pixels(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        for frame in 0..self.frames {
            for v in 0..self.size[1] {
                for u in 0..self.size[0] {
                    let mut pixel = (self.pixel)(u, v, frame);
                    if self.big_endian {
                        pixel.reverse();
                    }
                    bytes.extend(pixel.repeat(self.channels as usize));
                }
            }
        }
        bytes
    }

    pub(crate) fn header(&self, compressed_bytes: Option<usize>) -> String {
        let mut text = self.head(compressed_bytes);
        for frame in 0..self.frames {
            let (name, pose, status) = (self.transform, (self.pose)(frame), (self.status)(frame));
            text += &format!(
                "Seq_Frame{frame:04}_{name}Transform = {pose}\nSeq_Frame{frame:04}_{name}TransformStatus = {status}\n\
                 Seq_Frame{frame:04}_Timestamp = {}\n",
                f64::from(frame) * 0.1
            );
        }
        text + "ElementDataFile = LOCAL\n"
    }

    /// Returns the file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut pixels = self.pixels();
        if self.zlib {
            pixels = deflated(&pixels);
        }
        let mut bytes = self.header(self.zlib.then_some(pixels.len())).into_bytes();
        bytes.extend(pixels);
        bytes
    }
}

pub(crate) fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

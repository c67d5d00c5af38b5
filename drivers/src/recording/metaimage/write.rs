//! Writing MetaImage: tracked sequences and volumes.
//!
//! Both writers stream: the header is written first, then pixels as they come. They write to a temporary file in the target's folder that takes the
//! target's name in `finish`, so that a file of that name is always whole: after an error, or when a writer is dropped, the target is as before.

use std::fmt::Write as _;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use tempfile::NamedTempFile;

use super::header::{Fault, Parser, full_name};
use super::layout::{Content, Layout, element_type};
use super::sequence::{Sequence, split_transform_name};
use super::volume::{STRUCTURE, VolumeHeader};
use crate::Error;
use crate::reading::{NamedTransform, PixelType, Stamp, Status};
use crate::recording::Limits;

/// Digits of the largest 64-bit number: room in which the compressed size is written when it is known.
const SIZE_DIGITS: usize = 20;

/// What a sequence file says before its pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceHeader {
    /// Pixels along the first (fastest) and second axis; both 0 for a sequence without images.
    pub size: [u32; 2],
    /// Scalar type.
    pub pixel: PixelType,
    /// Channels per pixel, interleaved, 1 to 4.
    pub channels: u32,
    /// Orientation code (`MFA`, …); not written if empty.
    pub orientation: String,
    /// Image type (`BRIGHTNESS`, …); not written if empty.
    pub image_type: String,
    /// Whether to compress the pixels with zlib.
    pub compressed: bool,
    /// Further fields of the whole file.
    pub fields: Vec<(String, String)>,
    /// What is known of each frame (or tracker sample).
    pub items: Vec<SequenceItem>,
}

/// What a sequence file says of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceItem {
    /// Its time; `source_s` and `unfiltered_s` are written, the rest is not.
    pub stamp: Stamp,
    /// The source's running number.
    pub frame_number: Option<u64>,
    /// Whether the source vouches for the picture.
    pub status: Status,
    /// Its transforms; their own stamps are not written.
    pub transforms: Vec<NamedTransform>,
    /// Further fields.
    pub fields: Vec<(String, String)>,
}

/// Writes a tracked sequence.
pub struct SequenceWriter {
    file: PixelFile,
    frame_bytes: u64,
}

impl SequenceWriter {
    /// Begins a file: all that is known of the frames comes first, as the format has it.
    ///
    /// # Errors
    /// [`Error::Misuse`] when the header cannot be written so that it reads back the same (line ends in a text, a frame name that cannot be told
    /// from its neighbour, no items, …); [`Error::Io`] when the folder cannot be written.
    pub fn create(path: &Path, header: &SequenceHeader) -> Result<Self, Error> {
        let refuse = |problem: String| Error::Misuse(format!("{}: {problem}", path.display()));
        let images = header.size != [0, 0];
        if header.items.is_empty() || (images && header.size.contains(&0)) {
            return Err(refuse("a sequence needs at least one item, and an image two axes that are not empty".into()));
        }
        let mut plain = VolumeHeader::new([header.size[0], header.size[1], 0], header.pixel);
        plain.channels = header.channels;
        let frame_bytes = plain.slice_bytes();
        let items = header.items.len() as u64;
        let expected = frame_bytes.and_then(|bytes| bytes.checked_mul(items));
        let (Some(frame_bytes), Some(expected)) = (frame_bytes, expected) else {
            return Err(refuse("the images would take more than 2⁶⁴ bytes".into()));
        };
        let mut text = Text::begin(header.compressed && images);
        text.line("TransformMatrix", "1 0 0 0 1 0 0 0 1");
        text.line("Offset", "0 0 0");
        text.line("ElementSpacing", "1 1 1");
        text.line("DimSize", &format!("{} {} {items}", header.size[0], header.size[1]));
        text.line("Kinds", "domain domain list");
        if !header.orientation.is_empty() {
            text.field("UltrasoundImageOrientation", &header.orientation).map_err(refuse)?;
        }
        if !header.image_type.is_empty() {
            text.field("UltrasoundImageType", &header.image_type).map_err(refuse)?;
        }
        text.extra(&header.fields).map_err(refuse)?;
        for (frame, item) in (0..).zip(&header.items) {
            text.item(frame, item).map_err(refuse)?;
        }
        text.end(header.channels, header.pixel).map_err(refuse)?;
        check_reading(&text.text, header).map_err(refuse)?;
        Ok(Self { file: PixelFile::create(path, &text, header.compressed && images, expected)?, frame_bytes })
    }

    /// Writes the next frame: scalars in native byte order, first axis fastest. A sequence without images has none to write.
    ///
    /// # Errors
    /// [`Error::Misuse`] when the frame has not the size of the header or is one too many, [`Error::Io`] when it cannot be written.
    pub fn write_frame(&mut self, pixels: &[u8]) -> Result<(), Error> {
        if pixels.len() as u64 != self.frame_bytes {
            let (got, wanted) = (pixels.len(), self.frame_bytes);
            return Err(self.file.misuse(format!("a frame of {got} bytes was given, the header promises {wanted}")));
        }
        self.file.write_all(pixels).map_err(|source| self.file.failed("writing pixels", source))
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`Error::Misuse`] when frames are missing, [`Error::Io`] when the file cannot be written. Nothing of that name is changed then.
    pub fn finish(self) -> Result<(), Error> {
        self.file.finish()
    }
}

/// Writes a volume: voxels go in through [`Write`], in native byte order, x fastest, in pieces of any length.
pub struct VolumeWriter {
    file: PixelFile,
}

impl VolumeWriter {
    /// Begins a file. The world is not an anatomical one, and the file says so unless `header.fields` holds an `AnatomicalOrientation`.
    ///
    /// # Errors
    /// [`Error::Misuse`] when the header cannot be written so that it reads back the same, [`Error::Io`] when the folder cannot
    /// be written.
    pub fn create(path: &Path, header: &VolumeHeader) -> Result<Self, Error> {
        let refuse = |problem: &str| Error::Misuse(format!("{}: {problem}", path.display()));
        let expected = header.slice_bytes().and_then(|bytes| bytes.checked_mul(u64::from(header.size[2])));
        let Some(expected) = expected else { return Err(refuse("the volume would take more than 2⁶⁴ bytes")) };
        if expected == 0 {
            return Err(refuse("a volume needs at least one voxel along each axis, of at least one channel"));
        }
        let placed = header.axes.as_flattened().iter().chain(&header.origin).all(|v| v.is_finite());
        if !placed || !header.spacing.iter().all(|&mm| mm.is_finite() && mm > 0.0) {
            return Err(refuse("a volume's spacing must be positive, and its origin and axes finite"));
        }
        let mut text = Text::begin(header.compressed);
        // MetaIO's matrix is the transpose of ITK's direction: each triple is the direction of an index axis.
        text.line("TransformMatrix", &list(header.axes.as_flattened()));
        text.line("Offset", &list(&header.origin));
        text.line("CenterOfRotation", "0 0 0");
        if !header.fields.iter().any(|(name, _)| name == "AnatomicalOrientation") {
            text.line("AnatomicalOrientation", "???");
        }
        text.line("ElementSpacing", &list(&header.spacing));
        text.line("DimSize", &format!("{} {} {}", header.size[0], header.size[1], header.size[2]));
        text.line("Kinds", "domain domain domain");
        text.extra(&header.fields).map_err(|problem| refuse(&problem))?;
        text.end(header.channels, header.pixel).map_err(|problem| refuse(&problem))?;
        Ok(Self { file: PixelFile::create(path, &text, header.compressed, expected)? })
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`Error::Misuse`] when voxels are missing, [`Error::Io`] when the file cannot be written. Nothing of that name is changed then.
    pub fn finish(self) -> Result<(), Error> {
        self.file.finish()
    }
}

impl Write for VolumeWriter {
    /// Refuses voxels beyond those that the header promises.
    fn write(&mut self, voxels: &[u8]) -> io::Result<usize> {
        self.file.write(voxels)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// A header under construction.
struct Text {
    text: String,
    /// Where the compressed size belongs.
    size_at: Option<u64>,
}

impl Text {
    fn begin(compressed: bool) -> Self {
        let mut text = Self { text: String::new(), size_at: None };
        let truth = |yes| if yes { "True" } else { "False" };
        text.line("ObjectType", "Image");
        text.line("NDims", "3");
        text.line("BinaryData", "True");
        text.line("BinaryDataByteOrderMSB", truth(cfg!(target_endian = "big")));
        text.line("CompressedData", truth(compressed));
        if compressed {
            text.line("CompressedDataSize", &" ".repeat(SIZE_DIGITS));
            text.size_at = Some((text.text.len() - SIZE_DIGITS - 1) as u64);
        }
        text
    }

    fn line(&mut self, name: &str, value: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{name} = {value}");
    }

    /// A line whose texts come from outside.
    fn field(&mut self, name: &str, value: &str) -> Result<(), String> {
        let clean = |text: &str| !text.contains(char::is_control) && text.trim() == text;
        if name.is_empty() || !clean(name) || name.contains('=') {
            return Err(format!(
                "{name:?} is no name of a field: it must not be empty, hold = or line ends, or begin or end in a space"
            ));
        }
        if !clean(value) {
            return Err(format!(
                "the value {value:?} of field {name} must not hold line ends or begin or end in a space"
            ));
        }
        self.line(name, value);
        Ok(())
    }

    fn extra(&mut self, fields: &[(String, String)]) -> Result<(), String> {
        for (n, (name, value)) in fields.iter().enumerate() {
            let own = STRUCTURE.contains(&&**name) || name.starts_with("Seq_Frame");
            let taken = ["UltrasoundImageOrientation", "UltrasoundImageType"].contains(&&**name)
                && self.text.contains(&format!("\n{name} = "));
            if own || taken || fields[..n].iter().any(|(earlier, _)| earlier == name) {
                return Err(format!("field {name} is given twice, or is one that the writer sets itself"));
            }
            self.field(name, value)?;
        }
        Ok(())
    }

    fn item(&mut self, frame: u64, item: &SequenceItem) -> Result<(), String> {
        for transform in &item.transforms {
            let base = if transform.to.is_empty() {
                transform.from.clone()
            } else {
                format!("{}To{}", transform.from, transform.to)
            };
            if split_transform_name(&base) != (transform.from.clone(), transform.to.clone()) {
                return Err(format!(
                    "the frame names {:?} and {:?} could not be told apart in {base}Transform; the second must begin with a capital letter",
                    transform.from, transform.to
                ));
            }
            self.field(&full_name(frame, &format!("{base}Transform")), &list(&transform.matrix))?;
            self.field(&full_name(frame, &format!("{base}TransformStatus")), word(&transform.status)?)?;
        }
        let times = [("Timestamp", item.stamp.source_s), ("UnfilteredTimestamp", item.stamp.unfiltered_s)];
        for (name, seconds) in times {
            let Some(seconds) = seconds else { continue };
            if !seconds.is_finite() {
                return Err(format!("the {name} {seconds} of frame {frame} is no time; it must be finite"));
            }
            self.line(&full_name(frame, name), &seconds.to_string());
        }
        if let Some(number) = item.frame_number {
            self.line(&full_name(frame, "FrameNumber"), &number.to_string());
        }
        self.field(&full_name(frame, "ImageStatus"), word(&item.status)?)?;
        for (name, value) in &item.fields {
            self.field(&full_name(frame, name), value)?;
        }
        Ok(())
    }

    fn end(&mut self, channels: u32, pixel: PixelType) -> Result<(), String> {
        if !(1..=4).contains(&channels) {
            return Err(format!("{channels} channels were asked for; MetaImages have 1 to 4"));
        }
        self.line("ElementNumberOfChannels", &channels.to_string());
        self.line("ElementType", element_type(pixel));
        self.line("ElementDataFile", "LOCAL");
        Ok(())
    }
}

/// Reads the header back: a field's name may take on a meaning that its writer did not have in mind.
fn check_reading(text: &str, header: &SequenceHeader) -> Result<(), String> {
    let mut parser = Parser::new(Limits { header_bytes: u64::MAX, frame_bytes: u64::MAX, items: u64::MAX });
    for line in text.split_inclusive('\n') {
        parser.line(line.as_bytes()).map_err(Fault::sentence)?;
    }
    let fields = parser.finish().map_err(Fault::sentence)?;
    let layout = Layout {
        content: Content::Sequence,
        size: header.size,
        layers: header.items.len() as u64,
        pixel: header.pixel,
        channels: header.channels,
        layer_bytes: usize::from(header.size != [0, 0]),
        big_endian: false,
        zlib: false,
        data_at: fields.end,
        data_bytes: 0,
    };
    let read = Sequence::new(fields, &layout).map_err(Fault::sentence)?;
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
            return Err(format!(
                "frame {frame} would not read back as given: one of its fields has a name that means something else; rename it"
            ));
        }
    }
    Ok(())
}

/// The shortest decimals that read back as the same numbers.
fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(f64::to_string).collect();
    values.join(" ")
}

fn word(status: &Status) -> Result<&str, String> {
    match status {
        Status::Ok => Ok("OK"),
        Status::Other(word) if word.eq_ignore_ascii_case("OK") => {
            Err(format!("the status {word:?} would read back as valid; use Status::Ok"))
        }
        Status::Other(word) => Ok(word),
    }
}

/// A header and the pixels behind it, under a temporary name until whole.
struct PixelFile {
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
    fn create(path: &Path, text: &Text, compressed: bool, expected: u64) -> Result<Self, Error> {
        let failed = |source| Error::Io { path: path.to_owned(), doing: "creating the file", source };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut builder = tempfile::Builder::new();
        builder.prefix(".sonoweave-").suffix(".part");
        // Temporary files are private by default; this one becomes the user's file and gets the rights of any other new file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = BufWriter::with_capacity(super::BUFFER, builder.tempfile_in(folder).map_err(failed)?);
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

    fn failed(&self, doing: &'static str, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), doing, source }
    }

    fn misuse(&self, problem: String) -> Error {
        Error::Misuse(format!("{}: {problem}", self.path.display()))
    }

    fn finish(self) -> Result<(), Error> {
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

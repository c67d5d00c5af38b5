//! Converts readings to messages and back, exactly: every bit of a number, and whether the
//! number was present.

use std::borrow::Cow;
use std::sync::Arc;

use sonoweave_core::clock::SECOND;
use sonoweave_core::pool::Pool;
use sonoweave_core::reading::{Counts, Frame, NamedTransform, PixelType, Pose, Raw, Reading, Recorded, Stamp, Status};

use crate::Unreadable;
use crate::session::names::{name_of, named_text, pixel_of, texts};
use crate::session::picture::{Decoder, Encoder, Shape};
use crate::session::proto::{Fields, Malformed, Reader, Value};
use crate::session::reader::Message;
use crate::session::schema::{self, OWN, Schema, VERSION};

/// The project's own fields that all messages with a reading have.
const STAMP: u32 = OWN + 1;
const STATUS: u32 = OWN + 2;

/// Frame name of positions, for viewers: each tracker's own frame.
const TRACKER: &str = "Tracker";
/// Frame name of pixels.
const IMAGE: &str = "Image";

/// A part of a frame, pixels as stored: first axis, second axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// First column and row kept.
    pub offset: [u32; 2],
    /// Numbers of columns and rows kept.
    pub size: [u32; 2],
}

impl Crop {
    /// Returns the part of `crop` within a frame of that size; the whole frame without a crop.
    pub(super) fn within(crop: Option<Self>, size: [u32; 2]) -> Self {
        let Some(crop) = crop else { return Self { offset: [0; 2], size } };
        let offset = [0, 1].map(|axis| crop.offset[axis].min(size[axis]));
        Self { offset, size: [0, 1].map(|axis| crop.size[axis].min(size[axis] - offset[axis])) }
    }
}

/// Returns the schema by which a reading is written.
pub(super) fn schema_of(reading: &Reading) -> &'static Schema {
    match reading {
        Reading::Frame(_) => &schema::FRAME,
        Reading::Counts(_) => &schema::COUNTS,
        Reading::Pose(_) => &schema::POSE_OF_STATION,
        Reading::NamedTransform(_) => &schema::TRANSFORM,
        Reading::Recorded(_) => &schema::NOTE,
        Reading::Raw(_) => &schema::RAW,
    }
}

/// Writes a reading as a message; `crop` limits the pixels of a frame.
pub(super) fn write(reading: &Reading, crop: Option<Crop>, encoder: &mut Encoder, to: &mut Vec<u8>) {
    let mut out = Fields::to(to);
    match reading {
        Reading::Frame(frame) => write_frame(frame, crop, encoder, &mut out),
        Reading::Counts(counts) => {
            out.uint(1, counts.first.into());
            out.uint(2, counts.axes.into());
            out.sints(3, &counts.counts);
            out.uint(4, counts.homed.into());
            out.uint(5, counts.buttons.into());
            own(&mut out, &counts.stamp, Some(&counts.status));
        }
        Reading::Pose(pose) => write_pose(pose, &mut out),
        Reading::NamedTransform(transform) => {
            out.text(1, &transform.from);
            out.text(2, &transform.to);
            out.doubles(3, &transform.matrix);
            own(&mut out, &transform.stamp, Some(&transform.status));
        }
        Reading::Recorded(recorded) => {
            out.text(1, &recorded.topic);
            out.text(2, &recorded.text);
            own(&mut out, &recorded.stamp, None);
        }
        Reading::Raw(raw) => {
            out.uint(1, raw.line.into());
            out.bytes(2, &raw.bytes);
            own(&mut out, &raw.stamp, None);
        }
    }
}

fn write_frame(frame: &Frame, crop: Option<Crop>, encoder: &mut Encoder, out: &mut Fields<'_>) {
    let crop = Crop::within(crop, frame.size);
    let shape = Shape::of(crop.size, frame.channels, frame.pixel);
    let pixel_bytes = frame.channels as usize * frame.pixel.bytes();
    let stride = frame.size[0] as usize * pixel_bytes;
    let [left, top] = crop.offset;
    timestamp(out, 1, &frame.stamp);
    // Frames of a device opened without images have no pixels.
    let begin = top as usize * stride + left as usize * pixel_bytes;
    let is_whole = frame.pixels.len() == frame.size[1] as usize * stride;
    let picture: &[u8] = match (&shape, frame.pixels.get(begin..)) {
        (Some(shape), Some(pixels)) if is_whole => encoder.encode(shape, pixels, stride),
        _ => &[],
    };
    out.bytes(2, picture);
    out.text(3, "png");
    out.text(4, IMAGE);
    own(out, &frame.stamp, Some(&frame.status));
    if let Some(number) = frame.frame_number {
        out.uint(1003, number);
    }
    let places = [frame.size, crop.offset, crop.size].into_iter().flatten();
    (1004..).zip(places).for_each(|(number, value)| out.uint(number, value.into()));
    out.uint(1010, frame.channels.into());
    out.text(1011, name_of(frame.pixel));
    out.text(1012, &frame.orientation);
    out.text(1013, &frame.image_type);
    texts(out, 1014, &frame.fields);
}

fn write_pose(pose: &Pose, out: &mut Fields<'_>) {
    timestamp(out, 1, &pose.stamp);
    out.text(2, TRACKER);
    let ([x, y, z], [w, i, j, k]) = (pose.position_cm, pose.quaternion_wxyz);
    let doubles = |out: &mut Fields<'_>, values: &[f64]| {
        (1..).zip(values).for_each(|(number, value)| out.double(number, *value));
    };
    out.message(3, |out| {
        // Viewers read these values in metres.
        out.message(1, |out| doubles(out, &[x / 100.0, y / 100.0, z / 100.0]));
        out.message(2, |out| doubles(out, &[i, j, k, w]));
    });
    own(out, &pose.stamp, Some(&pose.status));
    out.uint(1003, pose.station.into());
    out.doubles(1004, &pose.position_cm);
    out.doubles(1005, &pose.quaternion_wxyz);
    out.uint(1006, pose.buttons.into());
    if let Some(distortion) = pose.distortion {
        out.sint(1007, distortion.into());
    }
    if let Some(code) = pose.code {
        out.uint(1008, code.into());
    }
}

/// Writes version, stamp and status.
fn own(out: &mut Fields<'_>, stamp: &Stamp, status: Option<&Status>) {
    out.uint(OWN, VERSION);
    out.message(STAMP, |out| {
        out.uint(1, stamp.item);
        if let Some(host_ns) = stamp.host_ns {
            out.fixed(2, host_ns);
        }
        if let Some(ticks) = stamp.ticks {
            out.uint(3, ticks);
        }
        if let Some(source_s) = stamp.source_s {
            out.double(4, source_s);
        }
        if let Some(unfiltered_s) = stamp.unfiltered_s {
            out.double(5, unfiltered_s);
        }
    });
    if let Some(Status::Other(why)) = status {
        out.text(STATUS, why);
    }
}

/// Writes the time for viewers: the host's time, or the source's.
fn timestamp(out: &mut Fields<'_>, number: u32, stamp: &Stamp) {
    let ns = stamp.host_ns.unwrap_or_else(|| stamp.source_s.map_or(0, |s| (s * 1e9) as i64)).max(0);
    out.message(number, |out| {
        out.uint(1, (ns / SECOND).cast_unsigned());
        out.uint(2, (ns % SECOND).cast_unsigned());
    });
}

impl From<Malformed> for Unreadable {
    fn from(_: Malformed) -> Self {
        Self::Malformed
    }
}

/// Converts messages to readings, in reused memory.
pub struct Maker {
    decoder: Decoder,
    pool: Pool,
    pool_bytes: usize,
    /// Whether frames have pixels.
    images: bool,
    most_bytes: u64,
}

impl Maker {
    /// Creates a converter for frames of at most `most_bytes`, with or without pixels.
    pub fn new(images: bool, most_bytes: u64) -> Self {
        Self { decoder: Decoder::default(), pool: Pool::new(0), pool_bytes: 0, images, most_bytes }
    }

    /// Returns the reading in a message; `None` for messages that are no readings.
    ///
    /// # Errors
    /// [`Unreadable`]: the message has another version, or this version never writes such a
    /// message.
    pub fn read(&mut self, message: &Message<'_>) -> Result<Option<Reading>, Unreadable> {
        message.channel.known.map_or(Ok(None), |schema| self.of(schema, message.bytes))
    }

    /// Returns the reading in the bytes of a message of that schema.
    fn of(&mut self, schema: &Schema, message: &[u8]) -> Result<Option<Reading>, Unreadable> {
        let fields = || Reader(message);
        if let Some(version) = version_of(message)?
            && version != VERSION
        {
            return Err(Unreadable::Version(version));
        }
        let is = |one: &Schema| schema.name == one.name;
        Ok(Some(if is(&schema::FRAME) {
            Reading::Frame(self.frame(message)?)
        } else if is(&schema::POSE_OF_STATION) {
            Reading::Pose(pose(fields())?)
        } else if is(&schema::COUNTS) {
            Reading::Counts(counts(fields())?)
        } else if is(&schema::RAW) {
            Reading::Raw(raw(fields())?)
        } else if is(&schema::TRANSFORM) {
            Reading::NamedTransform(transform(fields())?)
        } else if is(&schema::NOTE) {
            Reading::Recorded(recorded(fields())?)
        } else {
            return Ok(None);
        }))
    }

    fn frame(&mut self, message: &[u8]) -> Result<Frame, Unreadable> {
        let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
        let mut frame = Frame {
            stamp,
            frame_number: None,
            status: Status::Ok,
            size: [0; 2],
            channels: 0,
            pixel: PixelType::U8,
            orientation: Cow::Borrowed(""),
            image_type: String::new(),
            pixels: Arc::default(),
            fields: Vec::new(),
        };
        let mut crop = Crop { offset: [0; 2], size: [0; 2] };
        let mut picture: &[u8] = &[];
        for field in Reader(message) {
            let (number, value) = field?;
            match number {
                2 => picture = value.bytes()?,
                STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
                1003 => frame.frame_number = Some(value.uint()?),
                1004 => frame.size[0] = value.small()?,
                1005 => frame.size[1] = value.small()?,
                1006 => crop.offset[0] = value.small()?,
                1007 => crop.offset[1] = value.small()?,
                1008 => crop.size[0] = value.small()?,
                1009 => crop.size[1] = value.small()?,
                1010 => frame.channels = value.small()?,
                1011 => frame.pixel = pixel_of(value.text()?).ok_or(Malformed)?,
                1012 => frame.orientation = Cow::Owned(value.text()?.to_owned()),
                1013 => value.text()?.clone_into(&mut frame.image_type),
                1014 => frame.fields.push(named_text(value)?),
                _ => {}
            }
        }
        (frame.stamp, frame.status) = (stamp, status);
        if self.images && !picture.is_empty() {
            frame.pixels = self.pixels(&frame, &crop, picture)?;
        }
        Ok(frame)
    }

    fn pixels(&mut self, frame: &Frame, crop: &Crop, picture: &[u8]) -> Result<Arc<[u8]>, Unreadable> {
        let shape = Shape::of(crop.size, frame.channels, frame.pixel).ok_or(Malformed)?;
        let fits =
            |axis: usize| crop.offset[axis].checked_add(crop.size[axis]).is_some_and(|end| end <= frame.size[axis]);
        if !fits(0) || !fits(1) {
            return Err(Unreadable::Malformed);
        }
        let pixel_bytes = u64::from(frame.channels) * frame.pixel.bytes() as u64;
        let row_bytes = u64::from(frame.size[0]).checked_mul(pixel_bytes).ok_or(Malformed)?;
        let bytes = row_bytes.checked_mul(frame.size[1].into()).ok_or(Malformed)?;
        if bytes > self.most_bytes {
            return Err(Unreadable::TooLarge(bytes));
        }
        let (bytes, stride) = (bytes as usize, row_bytes as usize);
        if bytes != self.pool_bytes {
            (self.pool, self.pool_bytes) = (Pool::new(bytes), bytes);
        }
        let begin = crop.offset[1] as usize * stride + crop.offset[0] as usize * pixel_bytes as usize;
        let Self { decoder, pool, .. } = self;
        pool.fill(|pixels| {
            // Pixels that were not recorded are black.
            if crop.size != frame.size {
                pixels.fill(0);
            }
            decoder.decode(&shape, picture, &mut pixels[begin..], stride)
        })
        .map_err(Unreadable::Picture)
    }
}

/// Returns the version stated in a message.
fn version_of(message: &[u8]) -> Result<Option<u64>, Malformed> {
    for field in Reader(message) {
        if let (OWN, value) = field? {
            return value.uint().map(Some);
        }
    }
    Ok(None)
}

fn read_own(number: u32, value: Value<'_>, stamp: &mut Stamp, status: &mut Status) -> Result<(), Malformed> {
    if number == STATUS {
        *status = Status::Other(Cow::Owned(value.text()?.to_owned()));
        return Ok(());
    }
    for field in Reader(value.bytes()?) {
        match field? {
            (1, value) => stamp.item = value.uint()?,
            (2, value) => stamp.host_ns = Some(value.fixed()?),
            (3, value) => stamp.ticks = Some(value.uint()?),
            (4, value) => stamp.source_s = Some(value.double()?),
            (5, value) => stamp.unfiltered_s = Some(value.double()?),
            _ => {}
        }
    }
    Ok(())
}

fn pose(fields: Reader<'_>) -> Result<Pose, Malformed> {
    let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
    let (mut position_cm, mut quaternion_wxyz) = (None, None);
    let (mut station, mut buttons, mut distortion, mut code) = (0, 0, None, None);
    for field in fields {
        let (number, value) = field?;
        match number {
            STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
            1003 => station = value.small()?,
            1004 => position_cm = Some(value.doubles()?),
            1005 => quaternion_wxyz = Some(value.doubles()?),
            1006 => buttons = value.small()?,
            1007 => distortion = Some(i32::try_from(value.sint()?).map_err(|_| Malformed)?),
            1008 => code = Some(value.small()?),
            _ => {}
        }
    }
    let (Some(position_cm), Some(quaternion_wxyz)) = (position_cm, quaternion_wxyz) else { return Err(Malformed) };
    Ok(Pose { stamp, station, position_cm, quaternion_wxyz, buttons, distortion, code, status })
}

fn counts(fields: Reader<'_>) -> Result<Counts, Malformed> {
    let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
    let (mut first, mut axes, mut counts, mut homed, mut buttons) = (0, 0, None, 0, 0);
    for field in fields {
        let (number, value) = field?;
        match number {
            STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
            1 => first = value.small()?,
            2 => axes = value.small()?,
            3 => counts = Some(value.sints()?),
            4 => homed = value.small()?,
            5 => buttons = value.small()?,
            _ => {}
        }
    }
    let counts = counts.ok_or(Malformed)?;
    Ok(Counts { stamp, first, axes, counts, homed, buttons, status })
}

fn raw(fields: Reader<'_>) -> Result<Raw, Malformed> {
    let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
    let (mut line, mut bytes): (_, Arc<[u8]>) = (0, Arc::default());
    for field in fields {
        let (number, value) = field?;
        match number {
            STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
            1 => line = value.small()?,
            2 => bytes = value.bytes()?.into(),
            _ => {}
        }
    }
    Ok(Raw { stamp, line, bytes })
}

fn transform(fields: Reader<'_>) -> Result<NamedTransform, Malformed> {
    let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
    let (mut from, mut to, mut matrix) = (String::new(), String::new(), None);
    for field in fields {
        let (number, value) = field?;
        match number {
            STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
            1 => value.text()?.clone_into(&mut from),
            2 => value.text()?.clone_into(&mut to),
            3 => matrix = Some(value.doubles()?),
            _ => {}
        }
    }
    let matrix = matrix.ok_or(Malformed)?;
    Ok(NamedTransform { stamp, from, to, matrix, status })
}

fn recorded(fields: Reader<'_>) -> Result<Recorded, Malformed> {
    let (mut stamp, mut status) = (Stamp::default(), Status::Ok);
    let (mut topic, mut text) = (String::new(), String::new());
    for field in fields {
        let (number, value) = field?;
        match number {
            STAMP | STATUS => read_own(number, value, &mut stamp, &mut status)?,
            1 => value.text()?.clone_into(&mut topic),
            2 => value.text()?.clone_into(&mut text),
            _ => {}
        }
    }
    Ok(Recorded { stamp, topic, text })
}

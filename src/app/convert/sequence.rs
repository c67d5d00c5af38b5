//! Conversion of a device's content to the header of a sequence.
//!
//! A sequence file is converted without loss. For a session, each frame becomes an item. A
//! sequence holds one pose per frame and sensor: the pose with which a replay of the session
//! pairs the frame ([`placing`](super::placing)), or the status MISSING or INVALID. The item's
//! time is the frame's acquisition time, without latencies, in seconds. This is exact to the
//! nanosecond for the first hundred days of a machine's uptime. A field holds the time of
//! receipt, in nanoseconds.

use std::path::Path;

use glam::DMat4;

use formats::image::write::{SequenceHeader, SequenceItem};
use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Stamp, Status};
use sonoweave_core::{Device, Next, Reading};
use sync::history::{Rigid, Unavailable};

use super::anonymous::Subject;
use super::arrange::Arrangement;
use super::blacken::Blackening;
use super::placing::Placing;
use super::{Changes, ConvertError, anonymous, identity};

/// Frame field with the host's time of receipt, ns.
pub const HOST_FIELD: &str = "SonoweaveHostNs";
/// Field with the part of the frame that was kept: first column and row in MF, width and height.
pub const CROP_FIELD: &str = "SonoweaveCrop";

/// A recording that was read through.
#[derive(Debug)]
pub struct Gathered {
    /// The header to be written.
    pub header: SequenceHeader,
    /// Rearrangement of each frame; `None` without pixels.
    pub arrangement: Option<Arrangement>,
    /// Size and orientation of the stored frames.
    pub stored: ([u32; 2], String),
    /// Whether times, words and numbers of the items replace those of the frames.
    pub anonymous: bool,
    /// Pixels that become black, before the rearrangement.
    pub blackening: Option<Blackening>,
    /// The first frame that is taken; as many follow as the header has items.
    pub first: u64,
    /// Names of the fields that were left out.
    pub removed: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Shape {
    size: [u32; 2],
    pixel: PixelType,
    channels: u32,
}

/// Collected data of a device's readings.
#[derive(Default)]
struct Walk {
    items: Vec<SequenceItem>,
    shape: Option<Shape>,
    orientation: String,
    image_type: String,
    waiting: Vec<NamedTransform>,
    /// The frames' numbers.
    numbers: Vec<u64>,
}

/// Reads through a device that was opened without images. Sentences name `path`; `placing` holds
/// a session's poses.
///
/// # Errors
/// [`ConvertError`] if it cannot be read, has no frames or frames of several kinds, or does not
/// permit the requested changes.
pub fn gather(
    device: &mut dyn Device,
    path: &Path,
    changes: &Changes,
    placing: &Placing,
) -> Result<Gathered, ConvertError> {
    let unfit = |why: String| ConvertError::Unfit { path: path.to_owned(), why };
    let mut walk = Walk::default();
    device.start()?;
    loop {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(Reading::Frame(frame)) => walk.frame(frame).map_err(unfit)?,
            Next::Reading(Reading::NamedTransform(transform)) => walk.waiting.push(transform),
            Next::Reading(_) | Next::Pending => {}
            Next::End => break,
        }
    }
    device.stop()?;
    let Walk { mut items, shape, orientation, mut image_type, numbers, .. } = walk;
    let Some(Shape { size, pixel, channels }) = shape else {
        return Err(unfit("holds no frames to write as a sequence".into()));
    };
    items.iter_mut().zip(numbers).for_each(|(item, number)| attach(item, number, placing));
    let range = changes.frames.clone().unwrap_or(0..u64::MAX);
    let count = items.len() as u64;
    if range.start >= count {
        return Err(unfit(format!(
            "has {count} frames, none of them in --frames {}..; choose earlier frames",
            range.start
        )));
    }
    let (first, last) = (range.start, range.end.min(count));
    items.truncate(last as usize);
    items.drain(..first as usize);
    let mut fields = device.describe().fields.clone();
    let mut removed = Vec::new();
    if changes.anonymize {
        identity::leave_out(&mut fields, &mut removed);
        items.iter_mut().for_each(|item| identity::leave_out(&mut item.fields, &mut removed));
        anonymous::clean(&mut items);
        anonymous::check_orientation(&orientation).map_err(unfit)?;
        image_type = anonymous::image_type(image_type);
        fields.extend(changes.subject.iter().flat_map(Subject::fields));
    }
    let stored = (size, orientation.clone());
    let images = size != [0, 0];
    let arrangement = if images {
        Some(Arrangement::new(size, &orientation, changes.crop, changes.orientation.as_deref()).map_err(unfit)?)
    } else if changes.crop.is_some() || changes.orientation.is_some() {
        return Err(unfit("holds no images, which --crop and --orientation need; leave these out".into()));
    } else {
        None
    };
    if let Some(crop) = changes.crop {
        if fields.iter().any(|(name, _)| name == CROP_FIELD) {
            return Err(unfit(format!("was cropped before (field {CROP_FIELD}); crop the original recording instead")));
        }
        fields.push((CROP_FIELD.into(), format!("{} {} {} {}", crop.x, crop.y, crop.width, crop.height)));
        items.iter_mut().for_each(|item| shift(item, [crop.x, crop.y].map(f64::from)));
    }
    let header = SequenceHeader {
        size: arrangement.as_ref().map_or([0, 0], |a| a.size),
        pixel,
        channels,
        orientation: arrangement.as_ref().map_or(orientation, |a| a.orientation.clone()),
        image_type,
        compressed: changes.compressed,
        fields,
        items,
    };
    Ok(Gathered { header, arrangement, stored, anonymous: changes.anonymize, blackening: None, first, removed })
}

impl Walk {
    fn frame(&mut self, frame: Frame) -> Result<(), String> {
        let shape = Shape { size: frame.size, pixel: frame.pixel, channels: frame.channels };
        let known = *self.shape.get_or_insert(shape);
        let n = self.items.len();
        if n == 0 {
            (self.orientation, self.image_type) = (frame.orientation.to_string(), frame.image_type.clone());
        }
        if known != shape || *frame.orientation != *self.orientation || frame.image_type != self.image_type {
            return Err(format!(
                "frame {n} differs in size, type or orientation from earlier frames; choose frames of one kind with --frames"
            ));
        }
        let mut fields = frame.fields;
        let mut stamp = frame.stamp;
        if let Some(host_ns) = stamp.host_ns {
            stamp.source_s = stamp.source_s.or(Some(host_ns as f64 / 1e9));
            fields.push((HOST_FIELD.into(), host_ns.to_string()));
        }
        let mut transforms: Vec<NamedTransform> = Vec::new();
        for transform in self.waiting.drain(..) {
            // If there were several since the last frame, the newest belongs to the frame.
            match transforms.iter_mut().find(|known| known.name() == transform.name()) {
                Some(known) => *known = transform,
                None => transforms.push(transform),
            }
        }
        self.numbers.push(stamp.item);
        self.items.push(SequenceItem {
            stamp,
            frame_number: frame.frame_number,
            status: frame.status,
            transforms,
            fields,
        });
        Ok(())
    }
}

/// Adds the poses of the session's sensors to a frame, and their time.
fn attach(item: &mut SequenceItem, number: u64, placing: &Placing) {
    let sensed = placing.of(number);
    if let Some(time_ns) = sensed.and_then(|sensed| sensed.time_ns) {
        item.stamp.source_s = Some(time_ns as f64 / 1e9);
    }
    for (at, [from, to]) in placing.sensors.iter().enumerate() {
        let pose = sensed.map_or(&Err(Unavailable::Nothing), |sensed| &sensed.poses[at]);
        let (rigid, status) = match pose {
            Ok(rigid) => (*rigid, Status::Ok),
            Err(why) => (Rigid::IDENTITY, status_of(why)),
        };
        // A server's own transform of that name is replaced by the one of this time.
        item.transforms.retain(|other| (&other.from, &other.to) != (from, to));
        let matrix = DMat4::from_rotation_translation(rigid.rotation, rigid.position_mm);
        item.transforms.push(NamedTransform {
            stamp: Stamp::default(),
            from: from.clone(),
            to: to.clone(),
            matrix: matrix.transpose().to_cols_array(),
            status,
        });
    }
}

/// Returns the status for sequences: the device's own word if it is valid there.
fn status_of(why: &Unavailable) -> Status {
    let is_word = |word: &str| word.bytes().all(|c| c.is_ascii_uppercase() || c == b'_') && !word.is_empty();
    Status::Other(match why {
        Unavailable::Invalid { word } if is_word(word) => word.clone(),
        Unavailable::Invalid { .. } => "INVALID".into(),
        _ => "MISSING".into(),
    })
}

/// Adapts transforms to the new pixel (0, 0). Transforms from the image refer to the new one.
/// Without any, each frame gets the offset in the old image, like PLUS.
fn shift(item: &mut SequenceItem, [x, y]: [f64; 2]) {
    let mut of_image = item.transforms.iter_mut().filter(|transform| transform.from == "Image").peekable();
    if of_image.peek().is_none() {
        let matrix = [1.0, 0.0, 0.0, -x, 0.0, 1.0, 0.0, -y, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        item.transforms.push(NamedTransform {
            stamp: Stamp::default(),
            from: "Image".into(),
            to: "CroppedImage".into(),
            matrix,
            status: Status::Ok,
        });
        return;
    }
    for transform in of_image {
        let m = &mut transform.matrix;
        for row in 0..4 {
            m[4 * row + 3] += m[4 * row] * x + m[4 * row + 1] * y;
        }
    }
}

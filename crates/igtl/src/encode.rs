//! Encodes slices, poses, volumes and the status as messages.

use std::sync::Arc;

use glam::DAffine3;

use drivers::openigtlink::{
    Content, Coordinates, Datum, Fixed, Image, Matrix, Message, Position, Status, TimeStamp, Tool, ToolKind,
    Unwritable, Version,
};
use pipeline::session::Snapshot;
use sonoweave_core::clock::{Clock as _, Monotonic, SECOND, wall_ns};
use sonoweave_core::reading::{PixelType, transform_name};
use sonoweave_core::slice::{Pixels, Slice};
use sync::history::{PoseSample, Rigid};

use super::outbox::Wire;

/// An older host time belongs to a recording. Such times, and future ones, are replaced by the
/// present.
const LIVE_NS: i64 = 60 * SECOND;

/// Returns a device name, truncated to the length that a message holds.
pub(super) fn device(name: &str) -> Fixed<20> {
    let end = (0..=name.len().min(20)).rev().find(|at| name.is_char_boundary(*at)).unwrap_or(0);
    Fixed::new(&name[..end]).unwrap_or(Fixed::EMPTY)
}

/// Converts a host time to the wall clock.
pub(super) fn stamp(host_ns: i64) -> TimeStamp {
    let now_ns = Monotonic.now_ns();
    let is_live = (0..LIVE_NS).contains(&(now_ns - host_ns));
    let wall_ns = wall_ns(if is_live { host_ns } else { now_ns });
    // A wall clock before 1970 is invalid.
    TimeStamp::of_unix_ns(u64::try_from(wall_ns).unwrap_or(0))
}

/// Returns the present time.
pub(super) fn now() -> TimeStamp {
    stamp(Monotonic.now_ns())
}

fn rows(affine: &DAffine3) -> [f64; 16] {
    let [x, y, z] = affine.matrix3.to_cols_array_2d();
    let t = affine.translation;
    [x[0], y[0], z[0], t.x, x[1], y[1], z[1], t.y, x[2], y[2], z[2], t.z, 0.0, 0.0, 0.0, 1.0]
}

/// A message for clients of either header version, encoded once for each.
#[derive(Debug, Clone)]
pub(super) struct Both {
    message: Message,
    wires: [Option<Wire>; 2],
}

impl Both {
    pub(super) fn new(message: Message) -> Self {
        Self { message, wires: [None, None] }
    }

    /// Returns the message's type and device.
    pub(super) fn name(&self) -> String {
        format!("{} {}", self.message.content.kind(), self.message.device)
    }

    /// Returns the encoded message.
    pub(super) fn wire(&mut self, version: Version) -> Result<Wire, Unwritable> {
        let place = version as usize - 1;
        if let Some(wire) = &self.wires[place] {
            return Ok(Arc::clone(wire));
        }
        self.message.version = version;
        let wire: Wire = self.message.bytes()?.into();
        self.wires[place] = Some(Arc::clone(&wire));
        Ok(wire)
    }
}

fn native<T: bytemuck::NoUninit>(values: &[T]) -> Arc<[u8]> {
    bytemuck::cast_slice(values).into()
}

/// Encodes a slice with its pose. Its third axis is that of its matrix, or its normal if there
/// is none; the slice is one millimetre thick.
pub(super) fn slice(world: &str, item: u64, slice: &Slice) -> Message {
    let affine = slice.world_from_image.affine();
    let [u, v] = [affine.matrix3.x_axis, affine.matrix3.y_axis];
    let mut place = affine;
    place.matrix3.z_axis = u.cross(v).normalize_or_zero();
    let (pixel, pixels) = match slice.image.pixels() {
        Pixels::U8(pixels) => (PixelType::U8, Arc::clone(pixels)),
        Pixels::U16(pixels) => (PixelType::U16, native(pixels)),
        Pixels::F32(pixels) => (PixelType::F32, native(pixels)),
    };
    // A size that does not fit becomes 0, which the encoder refuses.
    let size = [slice.image.width(), slice.image.height()].map(|n| u16::try_from(n).unwrap_or(0));
    let image = Image::whole([size[0], size[1], 1], (pixel, 1), pixels, &rows(&place), Coordinates::Ras);
    let mut message = Message::new(device(&format!("Image_{world}")), stamp(slice.time_ns), Content::Image(image));
    message.metadata = metadata(world);
    message.metadata.push(Datum::new("FrameNumber", &item.to_string()));
    message
}

/// Encodes the transform from pixels to the world.
pub(super) fn image_to(world: &str, slice: &Slice) -> Message {
    let matrix = Matrix::of(&slice.world_from_image.to_rows());
    let name = device(&transform_name("Image", world));
    let mut message = Message::new(name, stamp(slice.time_ns), Content::Transform(matrix));
    message.metadata = vec![Datum::new("Status", "OK")];
    message
}

/// Encodes a sensor's pose.
pub(super) fn pose(name: &str, sample: &PoseSample) -> Message {
    let matrix = Matrix::of(&rows(&sample.pose.affine()));
    let mut message = Message::new(device(name), stamp(sample.time_ns), Content::Transform(matrix));
    message.metadata = vec![Datum::new("Status", if sample.invalid.is_some() { "INVALID" } else { "OK" })];
    message
}

/// Encodes the same pose as a position and a quaternion.
pub(super) fn position(name: &str, sample: &PoseSample) -> Message {
    let Rigid { rotation, position_mm } = sample.pose;
    let position = position_mm.to_array().map(|x| x as f32);
    let quaternion_xyzw = rotation.to_array().map(|x| x as f32);
    let content = Content::Position(Position { position, quaternion_xyzw });
    Message { content, ..pose(name, sample) }
}

/// Encodes all sensors with valid poses.
pub(super) fn tools<'a>(poses: impl Iterator<Item = (&'a String, &'a PoseSample)>) -> Message {
    let mut newest = i64::MIN;
    let tools = poses.filter(|(_, sample)| sample.invalid.is_none()).map(|(name, sample)| {
        newest = newest.max(sample.time_ns);
        Tool { name: device(name), kind: ToolKind::Six, matrix: Matrix::of(&rows(&sample.pose.affine())) }
    });
    let tools = tools.collect();
    Message::new(device("Tracker"), stamp(newest), Content::Tools(tools))
}

/// Encodes the volume with its pose, in the lattice's own axes. Unseen voxels are 0, as a
/// message has no weights.
pub(super) fn volume(world: &str, snapshot: &Snapshot) -> Message {
    let grid = &snapshot.space.grid;
    let mut place = DAffine3::from_translation(grid.origin);
    place.matrix3 = grid.direction * glam::DMat3::from_diagonal(grid.spacing);
    let size = grid.size.map(|n| u16::try_from(n).unwrap_or(0));
    let bytes = Arc::clone(&snapshot.bytes);
    let image = Image::whole(size, (snapshot.scalar.pixel(), 1), bytes, &rows(&place), Coordinates::Ras);
    let mut message = Message::new(device(&format!("Volume_{world}")), now(), Content::Image(image));
    message.metadata = metadata(world);
    message.metadata.push(Datum::new("Slices", &snapshot.slices.to_string()));
    message
}

fn metadata(world: &str) -> Vec<Datum> {
    vec![
        Datum::new("Frame", &format!("{world} (mm, not anatomical)")),
        Datum::new("SonoweaveVersion", env!("CARGO_PKG_VERSION")),
    ]
}

/// Encodes the session's status.
pub(super) fn status(code: u16, sentence: &str) -> Message {
    let name = Fixed::new(if code == Status::OK { "OK" } else { "NOT_READY" }).unwrap_or(Fixed::EMPTY);
    let status = Status { code, subcode: 0, name, message: sentence.into() };
    Message::new(device("Sonoweave"), now(), Content::Status(status))
}

//! Frames with poses in memory, as a device that delivers them like a sequence file.

use std::borrow::Cow;
use std::sync::Arc;

use sonoweave_core::health::Health;
use sonoweave_core::reading::{Frame, NamedTransform, PixelType, Reading, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Next};

/// Frame of reference of the pictures.
const IMAGE: &str = "Image";
/// Frame of reference of the poses.
const WORLD: &str = "World";

/// Frames with poses; a copy shares them.
#[derive(Debug, Clone)]
pub struct PosedFrames {
    /// Name for errors and reports.
    pub name: String,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Scalar type of a pixel.
    pub pixel: PixelType,
    /// Pixels of each frame, in native byte order and MF orientation, u fastest.
    pub frames: Arc<[Arc<[u8]>]>,
    /// Pose of each frame, row major: maps pixels (u, v, 0) to world mm.
    pub world_from_image: Arc<[[f64; 16]]>,
    /// Time of each frame, s; `None` if they have none.
    pub times_s: Option<Arc<[f64]>>,
}

/// Makes the readings of one item: its transform, then its frame.
pub(super) fn readings(
    item: u64,
    time_s: Option<f64>,
    world_from_image: [f64; 16],
    (size, pixel, pixels): ([u32; 2], PixelType, Arc<[u8]>),
) -> [Reading; 2] {
    let stamp = Stamp { item, source_s: time_s, ..Stamp::default() };
    let transform =
        NamedTransform { stamp, from: IMAGE.into(), to: WORLD.into(), matrix: world_from_image, status: Status::Ok };
    let frame = Frame {
        stamp,
        frame_number: None,
        status: Status::Ok,
        size,
        channels: 1,
        pixel,
        orientation: Cow::Borrowed("MF"),
        image_type: String::new(),
        pixels,
        fields: Vec::new(),
    };
    [Reading::NamedTransform(transform), Reading::Frame(frame)]
}

/// The device.
pub(super) struct PosedFramesDevice {
    frames: PosedFrames,
    with_pixels: bool,
    description: Description,
    health: Health,
    /// Frames to deliver, in ascending order; `None` for all.
    only: Option<Arc<[u64]>>,
    /// Number of readings delivered; `None` if stopped.
    delivered: Option<usize>,
}

impl PosedFramesDevice {
    pub(super) fn new(frames: PosedFrames, with_pixels: bool) -> Self {
        let description = Description {
            name: frames.name.clone(),
            items: Some(frames.frames.len() as u64),
            image_size: Some(frames.size),
            pixel: Some((frames.pixel, 1)),
            ..Description::default()
        };
        Self { frames, with_pixels, description, health: Health::default(), only: None, delivered: None }
    }

    /// Limits it to some frames, in ascending order.
    pub(super) fn only(self, only: Arc<[u64]>) -> Self {
        Self { only: Some(only), ..self }
    }
}

impl Device for PosedFramesDevice {
    fn start(&mut self) -> Result<(), Error> {
        self.delivered = Some(0);
        Ok(())
    }

    fn next(&mut self, _deadline_ns: i64) -> Result<Next, Error> {
        let Some(delivered) = &mut self.delivered else { return Err(Error::Stopped(self.description.name.clone())) };
        let PosedFrames { frames, size, pixel, world_from_image, times_s, .. } = &self.frames;
        let at = *delivered / 2;
        let item = self.only.as_ref().map_or(Some(at), |only| usize::try_from(*only.get(at)?).ok());
        let Some(item) = item else { return Ok(Next::End) };
        let (Some(pixels), Some(pose)) = (frames.get(item), world_from_image.get(item)) else { return Ok(Next::End) };
        let pixels = if self.with_pixels { Arc::clone(pixels) } else { Arc::default() };
        let time_s = times_s.as_ref().and_then(|times| times.get(item).copied());
        let [transform, frame] = readings(item as u64, time_s, *pose, (*size, *pixel, pixels));
        let next = if *delivered % 2 == 0 { transform } else { frame };
        *delivered += 1;
        Ok(Next::Reading(next))
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.delivered = None;
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}

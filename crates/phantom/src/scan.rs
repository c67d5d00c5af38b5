//! A scan: a scene painted along a trajectory, as posed slices and as the records of a tracked
//! sequence.

use std::ops::Range;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use rayon::prelude::*;

use mask::Mask;
use sonoweave_core::frames::{Image as ImageFrame, Probe, Tracker, Transform, World};
use sonoweave_core::region::{BadRegion, Fan};
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::Grid;

use super::PhantomError;
use super::bmode::{BMode, Scanner, Workspace};
use super::elementary::sin_cos;
use super::grid::covering_grid;
use super::paint::{Painter, Sheet};
use super::random::{Draws, Purpose};
use super::scene::{Blobs, Scene};
use super::trajectory::{Motion, PictureMm, Trajectory, small_turn};

#[cfg(test)]
mod tests;

/// A quarter of a gigapixel: 2 GiB of work space per frame.
const MAX_PIXELS: u64 = 1 << 28;

/// One breath of the simulated patient, ns.
const BREATH_NS: i64 = 4_000_000_000;

/// Storage format of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Rounded to the nearest of 0…255, and clipped.
    U8,
    /// Neither rounded nor clipped.
    F32,
}

/// Returns the sector of ±35° that a convex probe shows in an image of the given size (pixels).
/// Its apex lies above the image.
///
/// # Errors
/// [`BadRegion`] if the image is too low for an arc.
pub fn convex_fan(image_size: [u32; 2]) -> Result<Fan, BadRegion> {
    let [width, height] = image_size.map(f64::from);
    let rise = 0.2 * height;
    Fan::new([0.5 * (width - 1.0), -rise], [1.3 * rise, height - 1.0 + rise], [-35.0, 35.0])
}

/// A tracker's errors: white and Gaussian, drawn for each frame, the same along each axis; none
/// by default.
///
/// They are errors of the image's pose about its middle, wherever the sensor is. Position
/// errors shift the image; rotation errors turn it about its middle.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrackerNoise {
    /// Standard deviation of the position along each axis, mm.
    pub position_mm: f64,
    /// Standard deviation of the rotation about each axis, degrees; small.
    pub rotation_degrees: f64,
}

/// Limit of the noise, in mm and in degrees: more than any tracker's error, and little enough
/// for small angles.
const MOST_TRACKER_NOISE: f64 = 10.0;

/// Settings that determine a scan, to the bit.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanSettings {
    /// The scanned scene.
    pub scene: Scene,
    /// The probe's motion.
    pub motion: Motion,
    /// Number of frames.
    pub frames: u32,
    /// Mean distance of neighbouring slices, mm.
    pub gap_mm: f64,
    /// Pixels along u and v.
    pub image_size: [u32; 2],
    /// Distance of neighbouring pixels along u and v, mm.
    pub pixel_mm: [f64; 2],
    /// Standard deviation of the noise, grey levels; white and Gaussian.
    pub noise_sd: f64,
    /// Storage format of pixels.
    pub depth: Depth,
    /// The scanner's sector; the other pixels are 0 and not data. `None` if the whole image is
    /// data.
    pub fan: Option<Fan>,
    /// The scanner that displays a body's echoes. Its field is then the data, and a fan is its
    /// own. `None` if frames show the scene's grey levels.
    pub scanner: Option<Scanner>,
    /// Difference of the recorded poses from those at which the frames were painted.
    pub tracker_noise: TrackerNoise,
    /// Seed of the probe's random walk and of all noise.
    pub seed: u64,
    /// Measurement time of the first frame, ns.
    pub first_ns: i64,
    /// Frame interval, ns.
    pub interval_ns: i64,
}

impl Default for ScanSettings {
    /// The scan on which reconstructions are compared: blobs, freehand, 120 frames 0.35 mm
    /// apart, 512×480 pixels of 0.1 mm, noise of 6 grey levels, 8 bits, 30 frames a second.
    fn default() -> Self {
        Self {
            scene: Scene::Blobs(Blobs::draw(1)),
            motion: Motion::Freehand,
            frames: 120,
            gap_mm: 0.35,
            image_size: [512, 480],
            pixel_mm: [0.1, 0.1],
            noise_sd: 6.0,
            depth: Depth::U8,
            fan: None,
            scanner: None,
            tracker_noise: TrackerNoise::default(),
            seed: 1,
            first_ns: 0,
            interval_ns: 33_333_333,
        }
    }
}

/// A scan ready to be painted, frame by frame in any order.
#[derive(Debug, Clone)]
pub struct Scan {
    settings: ScanSettings,
    trajectory: Trajectory,
    source: Source,
    mask: Mask,
}

/// Source of the frames.
#[derive(Debug, Clone)]
enum Source {
    /// The scene's grey levels.
    Greys(Painter),
    /// Its echoes, as displayed by a scanner.
    Echoes(Box<BMode>),
}

/// Record of one frame in a tracked sequence, besides the pixels. Names are those of the common
/// file formats; matrices are 16 numbers, row major, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPose {
    /// Measurement time, s.
    pub timestamp_s: f64,
    /// `ImageToReference`, the combination of all transforms.
    pub image_to_reference: [f64; 16],
    /// `ProbeToTracker`: the sensor on the transducer.
    pub probe_to_tracker: [f64; 16],
    /// `ReferenceToTracker`: the sensor on the patient, who breathes.
    pub reference_to_tracker: [f64; 16],
}

impl Scan {
    /// Prepares a scan.
    ///
    /// # Errors
    /// [`PhantomError`] names the invalid setting.
    pub fn new(settings: ScanSettings) -> Result<Self, PhantomError> {
        let [width, height] = settings.image_size;
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(PhantomError::PictureSize { width, height, limit: MAX_PIXELS });
        }
        for mm in settings.pixel_mm {
            PhantomError::check_length("the distance of pixels", mm)?;
        }
        if !(settings.noise_sd >= 0.0 && settings.noise_sd.is_finite()) {
            return Err(PhantomError::Noise { sd: settings.noise_sd });
        }
        let TrackerNoise { position_mm: mm, rotation_degrees: degrees } = settings.tracker_noise;
        if ![mm, degrees].iter().all(|sd| (0.0..=MOST_TRACKER_NOISE).contains(sd)) {
            return Err(PhantomError::TrackerNoise { mm, degrees, limit: MOST_TRACKER_NOISE });
        }
        let trajectory = Trajectory::new(settings.motion, settings.frames, settings.gap_mm, settings.seed)?;
        let mut settings = settings;
        let (mask, source) = match (&settings.scene, settings.scanner) {
            (Scene::Body(body), Some(scanner)) => {
                if settings.fan.is_some() {
                    return Err(PhantomError::NoEchoes("a scanner's field is its own fan; leave the other out"));
                }
                let bmode = BMode::new(scanner, body.clone(), settings.image_size, settings.pixel_mm)?;
                settings.fan = bmode.layout().fan();
                (bmode.mask().clone(), Source::Echoes(Box::new(bmode)))
            }
            (scene, None) => {
                let mask = settings.fan.map_or_else(|| Mask::full(width, height), |fan| Mask::fan(width, height, &fan));
                (mask, Source::Greys(Painter::new(scene.clone())))
            }
            (_, Some(_)) => {
                return Err(PhantomError::NoEchoes("only a body has echoes; leave the scanner out, or scan a body"));
            }
        };
        if mask.area() == 0 {
            return Err(PhantomError::EmptyFan { width, height });
        }
        Ok(Self { settings, trajectory, source, mask })
    }

    /// Returns the scanner over its body; `None` if frames show grey levels.
    pub fn bmode(&self) -> Option<&BMode> {
        match &self.source {
            Source::Echoes(bmode) => Some(bmode),
            Source::Greys(_) => None,
        }
    }

    /// Returns the settings.
    pub fn settings(&self) -> &ScanSettings {
        &self.settings
    }

    /// Returns the number of frames.
    pub fn frames(&self) -> u32 {
        self.settings.frames
    }

    /// Returns the measurement time of a frame, ns.
    pub fn time_ns(&self, frame: u32) -> i64 {
        self.settings.first_ns.saturating_add(self.settings.interval_ns.saturating_mul(i64::from(frame)))
    }

    /// Maps pixels of a frame to world mm, as recorded by the tracker: with its noise. The
    /// third column is the unit normal.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn world_from_image(&self, frame: u32) -> Transform<World, ImageFrame> {
        self.recorded_world_from_picture(frame) * self.picture_from_image()
    }

    /// Maps pixels of a frame to world mm, as painted: without the tracker's noise.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn true_world_from_image(&self, frame: u32) -> Transform<World, ImageFrame> {
        self.trajectory.world_from_picture(frame) * self.picture_from_image()
    }

    fn recorded_world_from_picture(&self, frame: u32) -> Transform<World, PictureMm> {
        let pose = self.trajectory.world_from_picture(frame);
        let TrackerNoise { position_mm, rotation_degrees } = self.settings.tracker_noise;
        if position_mm == 0.0 && rotation_degrees == 0.0 {
            return pose;
        }
        let mut draws = Draws::new(self.settings.seed, Purpose::Tracker, u64::from(frame));
        let [x, y, z, pitch, yaw, roll] = std::array::from_fn(|_| draws.normal());
        let affine = pose.affine();
        Transform::from_affine(DAffine3 {
            matrix3: affine.matrix3 * small_turn(DVec3::new(pitch, yaw, roll) * (0.5 * rotation_degrees.to_radians())),
            translation: affine.translation + DVec3::new(x, y, z) * position_mm,
        })
    }

    /// Returns the mask of data pixels.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Paints a frame's echoes as displayed by the scanner, at the true pose, u fastest.
    /// Returns `false` without painting if frames show grey levels.
    ///
    /// # Panics
    /// If there is no such frame, or `picture` does not have its size.
    pub fn paint_echoes(&self, frame: u32, room: &mut Workspace, picture: &mut [u8]) -> bool {
        let Source::Echoes(bmode) = &self.source else { return false };
        bmode.paint(&self.trajectory.world_from_picture(frame), frame, room, picture);
        true
    }

    /// Returns a frame's grey levels without noise, rounding or fan, u fastest: the scene at
    /// the frame's time and true pose. For a scanner, returns its image.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn clean(&self, frame: u32) -> Vec<f64> {
        self.clean_in(frame, &mut self.bmode().map(BMode::workspace))
    }

    fn clean_in(&self, frame: u32, room: &mut Option<Workspace>) -> Vec<f64> {
        self.clean_at(self.trajectory.world_from_picture(frame), self.time_ns(frame), frame, room)
    }

    /// Like [`Self::clean`], for any pose and time; `number` selects the noise, if a scanner
    /// has any.
    pub(super) fn clean_at(
        &self,
        world_from_picture: Transform<World, PictureMm>,
        time_ns: i64,
        number: u32,
        room: &mut Option<Workspace>,
    ) -> Vec<f64> {
        let affine = (world_from_picture * self.picture_from_image()).affine();
        let [width, height] = self.settings.image_size.map(|n| n as usize);
        let sheet = Sheet {
            origin: affine.translation,
            step_u: affine.matrix3.x_axis,
            step_v: affine.matrix3.y_axis,
            width,
            height,
        };
        let mut grey = vec![0.0; width * height];
        match (&self.source, room) {
            (Source::Echoes(bmode), Some(room)) => {
                let mut picture = vec![0; width * height];
                bmode.paint(&world_from_picture, number, room, &mut picture);
                return picture.into_iter().map(f64::from).collect();
            }
            (Source::Greys(painter), _) if !self.settings.scene.moves() => painter.paint(&sheet, &mut grey),
            _ => Painter::new(self.settings.scene.at_time(time_ns)).paint(&sheet, &mut grey),
        }
        grey
    }

    /// Returns a frame as displayed by the scanner, with the pose that the tracker recorded.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn slice(&self, frame: u32) -> Slice {
        self.slice_in(frame, &mut self.bmode().map(BMode::workspace))
    }

    fn slice_in(&self, frame: u32, room: &mut Option<Workspace>) -> Slice {
        let mut grey = self.clean_in(frame, room);
        if self.settings.noise_sd > 0.0 {
            let mut draws = Draws::new(self.settings.seed, Purpose::Noise, u64::from(frame));
            for value in &mut grey {
                *value += self.settings.noise_sd * draws.normal();
            }
        }
        // The noise is drawn for all pixels, so that a fan does not change it.
        for (row, v) in grey.chunks_exact_mut(self.settings.image_size[0] as usize).zip(0..) {
            let mut dark = 0;
            for span in self.mask.row(v) {
                row[dark..span.start as usize].fill(0.0);
                dark = span.end as usize;
            }
            row[dark..].fill(0.0);
        }
        let pixels = match self.settings.depth {
            // Adding 0.5 before `floor` rounds to nearest; the cast clips.
            Depth::U8 => Pixels::U8(grey.iter().map(|x| (x + 0.5).floor() as u8).collect()),
            Depth::F32 => Pixels::F32(grey.iter().map(|x| *x as f32).collect()),
        };
        let [width, height] = self.settings.image_size;
        Slice {
            image: Image::new(width, height, pixels),
            time_ns: self.time_ns(frame),
            world_from_image: self.world_from_image(frame),
        }
    }

    /// Returns frames painted in parallel, in order. Callers take a long scan in pieces, since
    /// all pixels are in memory.
    ///
    /// # Panics
    /// If the range exceeds the scan.
    pub fn slices(&self, frames: Range<u32>) -> Vec<Slice> {
        let room = || self.bmode().map(BMode::workspace);
        frames.into_par_iter().map_init(room, |room, frame| self.slice_in(frame, room)).collect()
    }

    /// Returns the image calibration for readers of [`Scan::tracked`]: maps pixels to mm in the
    /// axes of the sensor on the transducer (`ImageToProbe`).
    pub fn probe_from_image(&self) -> Transform<Probe, ImageFrame> {
        probe_from_picture() * self.picture_from_image()
    }

    /// Returns a frame's record in a tracked sequence. `ReferenceToTracker⁻¹ · ProbeToTracker ·
    /// ImageToProbe` is `ImageToReference`, to rounding.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn tracked(&self, frame: u32) -> TrackedPose {
        let time_ns = self.time_ns(frame);
        let tracker_from_reference = tracker_from_reference(time_ns);
        let tracker_from_probe =
            tracker_from_reference * self.recorded_world_from_picture(frame) * probe_from_picture().inverse();
        TrackedPose {
            timestamp_s: time_ns as f64 / 1e9,
            image_to_reference: self.world_from_image(frame).to_rows(),
            probe_to_tracker: tracker_from_probe.to_rows(),
            reference_to_tracker: tracker_from_reference.to_rows(),
        }
    }

    /// Returns the grid of all lattice points within `margin_mm` of the box around all slices
    /// at their true poses; see [`covering_grid`].
    ///
    /// # Errors
    /// See [`covering_grid`].
    pub fn grid(&self, spacing: DVec3, margin_mm: f64) -> Result<Grid, PhantomError> {
        covering_grid(
            (0..self.frames()).map(|frame| (self.true_world_from_image(frame), self.settings.image_size)),
            spacing,
            margin_mm,
        )
    }

    pub(super) fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    pub(super) fn picture_from_image(&self) -> Transform<PictureMm, ImageFrame> {
        let [width, height] = self.settings.image_size.map(f64::from);
        let [pitch_u, pitch_v] = self.settings.pixel_mm;
        Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::new(pitch_u, pitch_v, 1.0)),
            translation: DVec3::new(-0.5 * (width - 1.0) * pitch_u, -0.5 * (height - 1.0) * pitch_v, 0.0),
        })
    }
}

/// Returns the mounting of the sensor on the simulated transducer: turned by about 30° and 70
/// mm above the image's middle. An omitted or inverted calibration is therefore detected.
pub(super) fn probe_from_picture() -> Transform<Probe, PictureMm> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_quat(DQuat::from_xyzw(0.1, -0.2, 0.15, 1.0).normalize()),
        translation: DVec3::new(6.0, 70.0, -11.0),
    })
}

/// Returns the pose of the patient's sensor: turned, some 30 cm from the transmitter, and
/// breathing by ±2 mm.
pub(super) fn tracker_from_reference(time_ns: i64) -> Transform<Tracker, World> {
    let phase = time_ns.rem_euclid(BREATH_NS) as f64 / BREATH_NS as f64 * std::f64::consts::TAU;
    let breath = DVec3::new(0.0, 2.0, 0.5) * sin_cos(phase).0;
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_quat(DQuat::from_xyzw(-0.3, 0.1, 0.4, 0.8).normalize()),
        translation: DVec3::new(180.0, -60.0, 240.0) + breath,
    })
}

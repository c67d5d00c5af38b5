//! A scan: a scene, painted along a trajectory, as posed slices and as what a tracked sequence records of them.

use std::ops::Range;

use calibration::frames::{Image as ImageFrame, Probe, Tracker, Transform, World};
use calibration::region::{BadRegion, Fan};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::elementary::sin_cos;
use super::paint::{Painter, Sheet};
use super::random::{Draws, Purpose};
use super::scene::{Blobs, Scene};
use super::trajectory::{Motion, PictureMm, Trajectory};
use super::{PhantomError, truth};
use crate::mask::Mask;
use crate::slice::{Image, Pixels, Slice};
use crate::volume::Grid;

/// A quarter of a gigapixel: 2 GiB of work space a frame.
const MAX_PIXELS: u64 = 1 << 28;

/// One breath of the simulated patient, ns.
const BREATH_NS: i64 = 4_000_000_000;

/// What a pixel is stored as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Rounded to the nearest of 0…255; what lies beyond is clipped.
    U8,
    /// Neither rounded nor clipped.
    F32,
}

/// The sector of ±35° that a convex probe shows in a picture of the given size (pixels); the apex lies above the picture.
///
/// # Errors
/// [`BadRegion`] when the picture is too low for an arc.
pub fn convex_fan(image_size: [u32; 2]) -> Result<Fan, BadRegion> {
    let [width, height] = image_size.map(f64::from);
    let rise = 0.2 * height;
    Fan::new([0.5 * (width - 1.0), -rise], [1.3 * rise, height - 1.0 + rise], [-35.0, 35.0])
}

/// What determines a scan, to the bit.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanSettings {
    /// What is scanned.
    pub scene: Scene,
    /// How the probe moves.
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
    /// What pixels are stored as.
    pub depth: Depth,
    /// The scanner's sector: the other pixels are 0 and are no data. `None` when the whole picture is data.
    pub fan: Option<Fan>,
    /// Seed of the hand's walk and the noise.
    pub seed: u64,
    /// Measurement time of the first frame, ns.
    pub first_ns: i64,
    /// From one frame to the next, ns.
    pub interval_ns: i64,
}

impl Default for ScanSettings {
    /// The scan on which reconstructions are compared: blobs, by hand, 120 frames 0.35 mm apart, 512×480 pixels of 0.1 mm, noise of 6 grey
    /// levels, 8 bits, 30 frames a second.
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
    painter: Painter,
    mask: Mask,
}

/// What a tracked sequence records of one frame besides the pixels: names as in the field's files, 16 numbers row major, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPose {
    /// Measurement time, s.
    pub timestamp_s: f64,
    /// `ImageToReference`, all in one: what remains when the others are combined.
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
    /// [`PhantomError`] names the setting that makes no scan.
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
        let mask = settings.fan.map_or_else(|| Mask::full(width, height), |fan| Mask::fan(width, height, &fan));
        if mask.area() == 0 {
            return Err(PhantomError::EmptyFan { width, height });
        }
        let trajectory = Trajectory::new(settings.motion, settings.frames, settings.gap_mm, settings.seed)?;
        let painter = Painter::new(settings.scene.clone());
        Ok(Self { settings, trajectory, painter, mask })
    }

    /// What determines it.
    pub fn settings(&self) -> &ScanSettings {
        &self.settings
    }

    /// Number of frames.
    pub fn frames(&self) -> u32 {
        self.settings.frames
    }

    /// Measurement time of a frame, ns.
    pub fn time_ns(&self, frame: u32) -> i64 {
        self.settings.first_ns.saturating_add(self.settings.interval_ns.saturating_mul(i64::from(frame)))
    }

    /// Maps pixels of a frame to world mm; the third column is the unit normal.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn world_from_image(&self, frame: u32) -> Transform<World, ImageFrame> {
        self.trajectory.world_from_picture(frame) * self.picture_from_image()
    }

    /// Which pixels are data.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// A frame's grey levels without noise, rounding or fan, u fastest.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn clean(&self, frame: u32) -> Vec<f64> {
        let affine = self.world_from_image(frame).affine();
        let [width, height] = self.settings.image_size.map(|n| n as usize);
        let sheet = Sheet {
            origin: affine.translation,
            step_u: affine.matrix3.x_axis,
            step_v: affine.matrix3.y_axis,
            width,
            height,
        };
        let mut grey = vec![0.0; width * height];
        self.painter.paint(&sheet, &mut grey);
        grey
    }

    /// A frame as the scanner shows it.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn slice(&self, frame: u32) -> Slice {
        let mut grey = self.clean(frame);
        if self.settings.noise_sd > 0.0 {
            let mut draws = Draws::new(self.settings.seed, Purpose::Noise, u64::from(frame));
            for value in &mut grey {
                *value += self.settings.noise_sd * draws.normal();
            }
        }
        // The noise is drawn for all pixels, so that a fan does not move it.
        for (row, v) in grey.chunks_exact_mut(self.settings.image_size[0] as usize).zip(0..) {
            let mut dark = 0;
            for span in self.mask.row(v) {
                row[dark..span.start as usize].fill(0.0);
                dark = span.end as usize;
            }
            row[dark..].fill(0.0);
        }
        let pixels = match self.settings.depth {
            // Half a level up, then down: rounds to nearest; the cast clips.
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

    /// Frames painted in parallel, in order. A long scan is taken in pieces: each frame is as large as its pixels.
    ///
    /// # Panics
    /// When the range leaves the scan.
    pub fn slices(&self, frames: Range<u32>) -> Vec<Slice> {
        frames.into_par_iter().map(|frame| self.slice(frame)).collect()
    }

    /// The image calibration that a reader of [`Scan::tracked`] needs: maps pixels to mm of the sensor on the transducer (`ImageToProbe`).
    pub fn probe_from_image(&self) -> Transform<Probe, ImageFrame> {
        probe_from_picture() * self.picture_from_image()
    }

    /// What a tracked sequence records of a frame. `ReferenceToTracker⁻¹ · ProbeToTracker · ImageToProbe` is `ImageToReference`, to rounding.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn tracked(&self, frame: u32) -> TrackedPose {
        let time_ns = self.time_ns(frame);
        let tracker_from_reference = tracker_from_reference(time_ns);
        let tracker_from_probe =
            tracker_from_reference * self.trajectory.world_from_picture(frame) * probe_from_picture().inverse();
        TrackedPose {
            timestamp_s: time_ns as f64 / 1e9,
            image_to_reference: self.world_from_image(frame).to_rows(),
            probe_to_tracker: tracker_from_probe.to_rows(),
            reference_to_tracker: tracker_from_reference.to_rows(),
        }
    }

    /// The grid of all lattice points within `margin_mm` of the box that holds every slice; see [`truth::covering_grid`].
    ///
    /// # Errors
    /// As [`truth::covering_grid`].
    pub fn grid(&self, spacing: DVec3, margin_mm: f64) -> Result<Grid, PhantomError> {
        truth::covering_grid(
            (0..self.frames()).map(|frame| (self.world_from_image(frame), self.settings.image_size)),
            spacing,
            margin_mm,
        )
    }

    fn picture_from_image(&self) -> Transform<PictureMm, ImageFrame> {
        let [width, height] = self.settings.image_size.map(f64::from);
        let [pitch_u, pitch_v] = self.settings.pixel_mm;
        Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::new(pitch_u, pitch_v, 1.0)),
            translation: DVec3::new(-0.5 * (width - 1.0) * pitch_u, -0.5 * (height - 1.0) * pitch_v, 0.0),
        })
    }
}

/// How the sensor sits on the simulated transducer: turned by about 30° and 70 mm above the picture's middle, so that a calibration left out or
/// inverted cannot pass unseen.
fn probe_from_picture() -> Transform<Probe, PictureMm> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_quat(DQuat::from_xyzw(0.1, -0.2, 0.15, 1.0).normalize()),
        translation: DVec3::new(6.0, 70.0, -11.0),
    })
}

/// Where the patient's sensor is: turned, some 30 cm from the transmitter, and breathing by ±2 mm.
fn tracker_from_reference(time_ns: i64) -> Transform<Tracker, World> {
    let phase = time_ns.rem_euclid(BREATH_NS) as f64 / BREATH_NS as f64 * std::f64::consts::TAU;
    let breath = DVec3::new(0.0, 2.0, 0.5) * sin_cos(phase).0;
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_quat(DQuat::from_xyzw(-0.3, 0.1, 0.4, 0.8).normalize()),
        translation: DVec3::new(180.0, -60.0, 240.0) + breath,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn small(change: impl FnOnce(&mut ScanSettings)) -> Scan {
        let mut settings =
            ScanSettings { frames: 12, image_size: [90, 70], pixel_mm: [0.5, 0.6], ..ScanSettings::default() };
        change(&mut settings);
        Scan::new(settings).unwrap()
    }

    fn values(slice: &Slice) -> Vec<f64> {
        match slice.image.pixels() {
            Pixels::U8(p) => p.iter().map(|x| f64::from(*x)).collect(),
            Pixels::U16(p) => p.iter().map(|x| f64::from(*x)).collect(),
            Pixels::F32(p) => p.iter().map(|x| f64::from(*x)).collect(),
        }
    }

    #[test]
    fn a_ramps_pixel_holds_the_scene_at_its_centre() {
        let scan = small(|s| (s.scene, s.noise_sd, s.depth) = (Scene::standard_ramp(), 0.0, Depth::F32));
        let Scene::Ramp(ramp) = scan.settings().scene else { panic!("a ramp") };
        for frame in [0, 7] {
            let slice = scan.slice(frame);
            let grey = values(&slice);
            for (i, j) in [(0, 0), (89, 0), (0, 69), (41, 23)] {
                // The middle of the picture is pixel (44.5, 34.5); its pose is the trajectory's.
                let mm = DVec3::new((i as f64 - 44.5) * 0.5, (j as f64 - 34.5) * 0.6, 0.0);
                let world = scan.trajectory.world_from_picture(frame).point(mm);
                let expected = ramp.at_origin + ramp.gradient.dot(world);
                assert!((grey[j * 90 + i] - expected).abs() < 1e-5);
                let posed = slice.world_from_image.point(DVec3::new(i as f64, j as f64, 0.0));
                assert!(posed.distance(world) < 1e-12);
            }
        }
    }

    #[test]
    fn noise_has_its_deviation_and_no_correlation() {
        let scan = small(|s| {
            (s.scene, s.noise_sd, s.depth) = (Scene::Constant(100.0), 6.0, Depth::F32);
            (s.image_size, s.frames) = ([400, 300], 2);
        });
        let [a, b] = [0, 1].map(|f| values(&scan.slice(f)).iter().map(|x| x - 100.0).collect::<Vec<_>>());
        let mean_product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>() / x.len() as f64;
        // 120 000 samples: a correlation's standard error is 0.0029, a deviation's 0.2 %.
        assert!((mean_product(&a, &a).sqrt() / 6.0 - 1.0).abs() < 0.01);
        assert!(a.iter().sum::<f64>().abs() / 120_000.0 < 0.09);
        for (what, product) in [
            ("neighbours in u", mean_product(&a[..119_999], &a[1..])),
            ("neighbours in v", mean_product(&a[..119_600], &a[400..])),
            ("frames", mean_product(&a, &b)),
        ] {
            assert!((product / 36.0).abs() < 0.0145, "{what}: {product}");
        }
    }

    #[test]
    fn rounding_is_to_nearest_and_clips() {
        for (grey, expected) in [(99.5, 100.0), (99.49, 99.0), (-3.0, 0.0), (300.0, 255.0)] {
            let scan = small(|s| (s.scene, s.noise_sd) = (Scene::Constant(grey), 0.0));
            assert!(values(&scan.slice(0)).iter().all(|x| *x == expected), "{grey}");
        }
    }

    #[test]
    fn same_bits_for_any_order_and_number_of_threads_and_others_for_another_seed() {
        let scan = small(|_| ());
        let reference: Vec<Slice> = (0..12).map(|f| scan.slice(f)).collect();
        let backwards: Vec<Slice> = (0..12).rev().map(|f| scan.slice(f)).collect();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let all = pool.install(|| scan.slices(0..12));
            for (frame, slice) in all.iter().enumerate() {
                assert!(slice.image.pixels().same_bits(reference[frame].image.pixels()));
                assert!(slice.image.pixels().same_bits(backwards[11 - frame].image.pixels()));
                assert_eq!(slice.world_from_image, reference[frame].world_from_image);
            }
        }
        let other = small(|s| s.seed = 2);
        assert!(!other.slice(3).image.pixels().same_bits(reference[3].image.pixels()));
        assert_ne!(other.world_from_image(3), scan.world_from_image(3));
        assert_ne!(Blobs::draw(1), Blobs::draw(2));
    }

    #[test]
    fn the_bits_of_the_standard_scan_stay_what_they_are() {
        // A digest of one small frame: a change of the draws or of an elementary function shows here, on any machine.
        use sha2::Digest;
        let Pixels::U8(pixels) = small(|_| ()).slice(5).image.pixels().clone() else { panic!("8 bits") };
        let digest: String = sha2::Sha256::digest(&pixels).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(&digest[..16], "07a487165329c465");
    }

    #[test]
    fn recorded_transforms_combine_to_the_slices_pose() {
        let scan = small(|s| (s.first_ns, s.interval_ns) = (5_000_000_000, 50_000_000));
        let mut references = Vec::new();
        for frame in 0..12 {
            let tracked = scan.tracked(frame);
            let tracker_from_probe = Transform::<Tracker, Probe>::from_rows(&tracked.probe_to_tracker).unwrap();
            let tracker_from_world = Transform::<Tracker, World>::from_rows(&tracked.reference_to_tracker).unwrap();
            let combined = tracker_from_world.inverse() * tracker_from_probe * scan.probe_from_image();
            for (a, b) in combined.to_rows().iter().zip(tracked.image_to_reference) {
                assert!((a - b).abs() < 1e-10, "{a} {b}");
            }
            for rigid in [tracker_from_probe.affine().matrix3, tracker_from_world.affine().matrix3] {
                let gram = rigid.transpose() * rigid - DMat3::IDENTITY;
                assert!(gram.to_cols_array().iter().all(|x| x.abs() < 1e-13));
            }
            assert_eq!(tracked.image_to_reference, scan.slice(frame).world_from_image.to_rows());
            assert!((tracked.timestamp_s - (5.0 + 0.05 * f64::from(frame))).abs() < 1e-9);
            references.push(tracked.reference_to_tracker);
        }
        assert_ne!(references[0], references[11], "the patient breathes");
    }

    #[test]
    fn a_fan_leaves_its_sector_and_does_not_move_the_noise() {
        let fan = convex_fan([90, 70]).unwrap();
        let (masked, whole) = (small(|s| s.fan = Some(fan)), small(|_| ()));
        let mask = masked.mask();
        assert!(whole.mask().is_full());
        let (a, b) = (values(&masked.slice(2)), values(&whole.slice(2)));
        for k in 0..a.len() {
            let data = mask.contains((k % 90) as u32, (k / 90) as u32);
            assert_eq!(a[k], if data { b[k] } else { 0.0 });
            let x = (k % 90) as f64 - 44.5;
            let y = (k / 90) as f64 + 14.0;
            let expected = x.atan2(y).to_degrees().abs() <= 35.0 && (18.2..=83.0).contains(&x.hypot(y));
            assert_eq!(data, expected, "pixel {k}");
        }
        let share = mask.area() as f64 / a.len() as f64;
        assert!((0.3..0.9).contains(&share), "{share}");
    }

    #[test]
    fn settings_that_make_no_scan_are_refused_with_a_sentence() {
        let refuse = |change: fn(&mut ScanSettings)| {
            let mut settings = ScanSettings::default();
            change(&mut settings);
            Scan::new(settings).unwrap_err().to_string()
        };
        for error in [
            refuse(|s| s.image_size = [0, 10]),
            refuse(|s| s.image_size = [u32::MAX, u32::MAX]),
            refuse(|s| s.pixel_mm = [0.1, f64::INFINITY]),
            refuse(|s| s.noise_sd = -1.0),
            refuse(|s| s.frames = 0),
            refuse(|s| s.fan = Some(Fan::new([0.0, -900.0], [3.0, 9.0], [-30.0, 30.0]).unwrap())),
        ] {
            assert!(error.len() > 30, "{error}");
        }
        assert!(convex_fan([9, 1]).is_err(), "a line has no room for an arc");
    }
}

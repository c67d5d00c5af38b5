//! The virtual bedside: a probe swept to and fro without end, observed by virtual devices at
//! arbitrary times.
//!
//! A [`Scan`] has one pose per frame. Here the probe also moves between them: linearly in
//! position, and by the shortest rotation. At the end of the sweep it goes back. A virtual
//! tracker queries the sensor poses ([`Bedside::motion`]), a virtual arm its encoder counts
//! ([`arm::BedsideArm::joints`]), and a virtual grabber the scanner's frames
//! ([`Bedside::pictures`]). All observe the same motion at their times of measurement, so that
//! pairing can be checked against the truth.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};

use drivers::simulated::grabber::Pictures;
use drivers::simulated::{Motion, Placed};
use sonoweave_core::frames::{Image as ImageFrame, Probe, Stylus, Tracker, Transform, World};
use sonoweave_core::rotation::slerp;

use super::bmode::BMode;
use super::elementary::sin_cos;
use super::scan::{Scan, ScanSettings, probe_from_picture, tracker_from_reference};
use super::trajectory::PictureMm;
use stylus::StylusMotion;

pub mod arm;
pub mod stylus;

/// Station of the sensor on the transducer.
pub const PROBE_STATION: u8 = 1;
/// Station of the sensor on the patient.
pub const REFERENCE_STATION: u8 = 2;
/// Station of the sensor on the stylus.
pub const STYLUS_STATION: u8 = 3;

/// A scan that continues in time.
#[derive(Debug, Clone)]
pub struct Bedside {
    scan: Scan,
    begin_ns: i64,
    stylus: StylusMotion,
    /// Points that the stylus touches, world mm.
    landmarks: Vec<DVec3>,
    disturbance: Disturbance,
}

/// Period of the drift, ns.
const DRIFT_NS: i64 = 60_000_000_000;

/// Slow errors of a scan; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disturbance {
    /// Displacement of the recorded sensor on the transducer: from 0 to so many mm and back, each
    /// minute.
    pub drift_mm: f64,
    /// Displacement of the skin into the image in all sweeps but the first, mm. Tissue below it is
    /// displaced less, and that at the image's bottom is not.
    pub pressure_mm: f64,
}

impl Disturbance {
    /// Returns the drift at a time after the first frame.
    fn drift(&self, after_ns: i64) -> DVec3 {
        let phase = after_ns.max(0) as f64 / DRIFT_NS as f64 * std::f64::consts::TAU;
        DVec3::new(0.6, 0.0, 0.8) * (0.5 * self.drift_mm * (1.0 - sin_cos(phase).1))
    }

    /// Displaces an image's tissue by pressure; rows are `mm` apart. Tissue of depth v is shown at
    /// v + p·(1 − v/h)², for an image of height h. Above the skin is what is seen there.
    fn press(&self, grey: &mut [f64], width: usize, mm: f64) {
        let rows = grey.len() / width;
        let (p, h) = (self.pressure_mm, (rows - 1) as f64 * mm);
        if p == 0.0 || rows < 2 {
            return;
        }
        let before = grey.to_vec();
        for (row, grey) in grey.chunks_exact_mut(width).enumerate() {
            // The share x of the height with h·x + p·(1 − x)² = depth of the row.
            let (half, above) = (0.5 * (h - 2.0 * p), p - row as f64 * mm);
            let x = ((half * half - p * above).max(0.0).sqrt() - half) / p;
            let at = (x * h / mm).clamp(0.0, (rows - 1) as f64);
            let (first, share) = (at as usize, at.fract());
            let second = (first + 1).min(rows - 1);
            for (u, grey) in grey.iter_mut().enumerate() {
                *grey = (1.0 - share) * before[first * width + u] + share * before[second * width + u];
            }
        }
    }
}

impl Bedside {
    /// Creates a bedside whose first frame is at `begin_ns`, host ns; before it the probe is
    /// static. The scan gives the frame interval.
    pub fn new(scan: Scan, begin_ns: i64) -> Self {
        let landmarks = scan.settings().scene.landmarks();
        Self { scan, begin_ns, stylus: StylusMotion::default(), landmarks, disturbance: Disturbance::default() }
    }

    /// Has these slow errors.
    #[must_use]
    pub fn with_disturbance(self, disturbance: Disturbance) -> Self {
        Self { disturbance, ..self }
    }

    /// Moves the stylus in this way.
    #[must_use]
    pub fn with_stylus(self, stylus: StylusMotion) -> Self {
        Self { stylus, ..self }
    }

    /// Returns the scan.
    pub fn scan(&self) -> &Scan {
        &self.scan
    }

    /// Returns the last scan frame passed at a time, host ns, and the fraction of the way to
    /// the next one.
    fn left(&self, at_ns: i64) -> (u32, f64) {
        let last = self.scan.frames() - 1;
        let interval = self.scan.settings().interval_ns.max(1);
        let way = self.way_ns();
        let gone = at_ns.saturating_sub(self.begin_ns).max(0) % way.saturating_mul(2);
        let gone = gone.min(way.saturating_mul(2) - gone);
        // Both are within the scan.
        let frame = ((gone / interval) as u32).min(last.saturating_sub(1));
        (frame, (gone - i64::from(frame) * interval) as f64 / interval as f64)
    }

    /// Returns the time for one way of the sweep, ns.
    fn way_ns(&self) -> i64 {
        let interval = self.scan.settings().interval_ns.max(1);
        interval.saturating_mul(i64::from(self.scan.frames() - 1)).max(1)
    }

    /// Returns how many times the sweep has been finished.
    fn pass(&self, at_ns: i64) -> i64 {
        at_ns.saturating_sub(self.begin_ns).max(0) / self.way_ns()
    }

    /// Returns the pose of the image plane at a time, host ns.
    pub fn world_from_picture(&self, at_ns: i64) -> Transform<World, PictureMm> {
        let (frame, share) = self.left(at_ns);
        let last = self.scan.frames() - 1;
        let [from, to] =
            [frame, (frame + 1).min(last)].map(|frame| self.scan.trajectory().world_from_picture(frame).affine());
        let [a, b] = [from, to].map(|pose| DQuat::from_mat3(&pose.matrix3).normalize());
        Transform::from_affine(DAffine3::from_rotation_translation(
            slerp(a, b, share),
            from.translation.lerp(to.translation, share),
        ))
    }

    /// Maps pixels of the frame at a time to world mm.
    pub fn world_from_image(&self, at_ns: i64) -> Transform<World, ImageFrame> {
        self.world_from_picture(at_ns) * self.scan.picture_from_image()
    }

    /// Returns the recorded pose of the sensor on the transducer at a time.
    pub fn tracker_from_probe(&self, at_ns: i64) -> Transform<Tracker, Probe> {
        let mut recorded = self.world_from_picture(at_ns);
        if self.disturbance.drift_mm > 0.0 {
            let drift = self.disturbance.drift(at_ns.saturating_sub(self.begin_ns));
            recorded = Transform::from_affine(DAffine3::from_translation(drift) * recorded.affine());
        }
        self.tracker_from_reference(at_ns) * recorded * probe_from_picture().inverse()
    }

    /// Returns the pose of the sensor on the patient at a time; the patient breathes. Its frame
    /// is the world.
    pub fn tracker_from_reference(&self, at_ns: i64) -> Transform<Tracker, World> {
        tracker_from_reference(at_ns)
    }

    /// Returns the pose of the sensor on the stylus at a time.
    pub fn tracker_from_stylus(&self, at_ns: i64) -> Transform<Tracker, Stylus> {
        let after_s = at_ns.saturating_sub(self.begin_ns).max(0) as f64 * 1e-9;
        self.tracker_from_reference(at_ns) * self.stylus.world_from_stylus(after_s, &self.landmarks)
    }

    /// Returns the motion for a virtual tracker: the probe at station [`PROBE_STATION`], the
    /// stylus at [`STYLUS_STATION`], the patient at any other.
    pub fn motion(self: &Arc<Self>) -> Motion {
        let bedside = Arc::clone(self);
        Arc::new(move |station, at_ns| {
            let pose = match station {
                PROBE_STATION => bedside.tracker_from_probe(at_ns).affine(),
                STYLUS_STATION => bedside.tracker_from_stylus(at_ns).affine(),
                _ => bedside.tracker_from_reference(at_ns).affine(),
            };
            let q = DQuat::from_mat3(&pose.matrix3).normalize();
            Placed { position_cm: (pose.translation / 10.0).to_array(), quaternion_wxyz: [q.w, q.x, q.y, q.z] }
        })
    }

    /// Returns frames rendered beforehand, one for each frame of the scan; at each time the
    /// nearest is shown. They serve to time the processing of frames without the rendering.
    /// Between two scan frames, the image is that of one of them.
    pub fn painted(self: &Arc<Self>) -> Pictures {
        let mut paint = self.pictures();
        let [width, height] = self.scan.settings().image_size;
        let interval = self.scan.settings().interval_ns.max(1);
        let painted: Vec<Vec<u8>> = (0..self.scan.frames())
            .map(|frame| {
                let mut pixels = vec![0; width as usize * height as usize];
                paint(self.begin_ns + i64::from(frame) * interval, &mut pixels);
                pixels
            })
            .collect();
        let bedside = Arc::clone(self);
        Box::new(move |at_ns, pixels| {
            let (frame, share) = bedside.left(at_ns);
            let nearest = frame as usize + usize::from(share >= 0.5);
            pixels.copy_from_slice(&painted[nearest.min(painted.len() - 1)]);
        })
    }

    /// Returns the memory of the scanner's tables, bytes.
    pub fn table_bytes(&self) -> u64 {
        self.scan.bmode().map_or(0, BMode::bytes)
    }

    /// Returns the frames for a virtual grabber: the B-mode image at each time.
    pub fn pictures(self: &Arc<Self>) -> Pictures {
        let bedside = Arc::clone(self);
        let mut room = bedside.scan.bmode().map(BMode::workspace);
        let interval = bedside.scan.settings().interval_ns.max(1);
        Box::new(move |at_ns, pixels| {
            let pose = bedside.world_from_picture(at_ns);
            // Each frame has other noise; which one does not matter.
            let number = (at_ns.saturating_sub(bedside.begin_ns) / interval) as u32;
            if let (Some(bmode), Some(room)) = (bedside.scan.bmode(), &mut room) {
                bmode.paint(&pose, number, room, pixels);
                return;
            }
            let mut grey = bedside.scan.clean_at(pose, at_ns, number, &mut room);
            if bedside.pass(at_ns) > 0 {
                let ScanSettings { image_size, pixel_mm, .. } = bedside.scan.settings();
                bedside.disturbance.press(&mut grey, image_size[0] as usize, pixel_mm[1]);
            }
            // Adding 0.5 before `floor` rounds to nearest; the cast clips.
            pixels.iter_mut().zip(grey).for_each(|(pixel, grey)| *pixel = (grey + 0.5).floor() as u8);
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use drivers::connection::Connection;
    use drivers::simulated::grabber::Grabber;
    use drivers::simulated::{Faults, fastrak::Twin};
    use drivers::tracker::polhemus::{Settings, fastrak};
    use drivers::transport::MemoryOpener;
    use glam::DVec3;
    use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
    use sonoweave_core::reading::{Frame, Pose, Reading};
    use sonoweave_core::{Device, Next};

    use super::super::{Scanner, body};
    use super::*;

    const BEGIN: i64 = 7 * SECOND;

    fn bedside(settings: ScanSettings) -> Arc<Bedside> {
        Arc::new(Bedside::new(Scan::new(settings).unwrap(), BEGIN))
    }

    fn small() -> ScanSettings {
        ScanSettings { frames: 60, gap_mm: 0.5, image_size: [64, 48], pixel_mm: [0.8, 0.8], ..ScanSettings::default() }
    }

    #[test]
    fn prerendered_frames_equal_scan_frames() {
        let bedside = bedside(small());
        let (mut painted, mut paint) = (bedside.painted(), bedside.pictures());
        let interval = bedside.scan.settings().interval_ns;
        let (mut one, mut other) = (vec![0; 64 * 48], vec![0; 64 * 48]);
        for (after, frame) in
            [(0, 0), (interval * 2 / 5, 0), (interval * 3 / 5, 1), (interval * 59, 59), (interval * 60, 58)]
        {
            painted(BEGIN + after, &mut one);
            paint(BEGIN + interval * frame, &mut other);
            assert!(one == other, "{after}");
        }
    }

    #[test]
    fn probe_matches_scan_at_frame_times_and_returns() {
        let bedside = bedside(small());
        let interval = bedside.scan().settings().interval_ns;
        for frame in 0..60_u32 {
            let there = bedside.scan().true_world_from_image(frame).to_rows();
            for at in [i64::from(frame), 118 - i64::from(frame), 118 + i64::from(frame)] {
                let found = bedside.world_from_image(BEGIN + at * interval).to_rows();
                let off = there.iter().zip(found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < 1e-9, "{frame} {at}: {off}");
            }
        }
        let rest = bedside.world_from_image(0).to_rows();
        assert_eq!(rest, bedside.world_from_image(BEGIN).to_rows(), "before it begins it rests");
        // Between frames the probe moves evenly.
        let z = |ns: i64| bedside.world_from_picture(BEGIN + ns).affine().translation;
        let [a, half, b] = [10 * interval, 10 * interval + interval / 2, 11 * interval].map(z);
        assert!((half - a.midpoint(b)).length() < 1e-6);
    }

    #[test]
    fn drift_moves_recorded_poses_and_pressure_later_images() {
        let plain = bedside(small());
        let disturbance = Disturbance { drift_mm: 2.0, pressure_mm: 1.5 };
        let disturbed = Arc::new(Bedside::new(plain.scan.clone(), BEGIN).with_disturbance(disturbance));
        let moved = |after_ns: i64| {
            let [a, b] = [&plain, &disturbed].map(|of| of.tracker_from_probe(BEGIN + after_ns).affine().translation);
            a.distance(b)
        };
        assert!(moved(0) < 1e-12 && (moved(30 * SECOND) - 2.0).abs() < 1e-9 && (moved(15 * SECOND) - 1.0).abs() < 1e-9);
        // Images of the first sweep are the same. Later ones show the skin 1.5 mm deeper, where
        // rows are 0.8 mm apart, and the bottom where it was.
        let image = |of: &Arc<Bedside>, after_ns: i64| {
            let mut pixels = vec![0; 64 * 48];
            of.pictures()(BEGIN + after_ns, &mut pixels);
            pixels
        };
        let interval = plain.scan.settings().interval_ns;
        assert!(image(&plain, 10 * interval) == image(&disturbed, 10 * interval));
        let [light, pressed] = [&plain, &disturbed].map(|of| image(of, 70 * interval));
        assert!(light != pressed && light[47 * 64..] == pressed[47 * 64..]);
        for row in 4..44 {
            let (v, h) = (0.8 * row as f64, 0.8 * 47.0);
            let shown = (v + 1.5 * (1.0 - v / h).powi(2)) / 0.8;
            let (first, share) = (shown as usize, shown.fract());
            for u in 0..64 {
                let there = |row: usize| f64::from(pressed[row * 64 + u]);
                let off = (1.0 - share) * there(first) + share * there(first + 1) - f64::from(light[row * 64 + u]);
                assert!(off.abs() < 4.0, "{row} {u}: {off}");
            }
        }
    }

    /// Interpolates the pose of a station at a time between its neighbours.
    fn between(poses: &[Pose], station: u8, at_ns: i64, delay_ns: i64) -> Option<DAffine3> {
        let own: Vec<&Pose> = poses.iter().filter(|pose| pose.station == station).collect();
        let time = |pose: &Pose| pose.stamp.host_ns.unwrap() - delay_ns;
        let two = own.windows(2).find(|two| time(two[0]) <= at_ns && at_ns < time(two[1]))?;
        let share = (at_ns - time(two[0])) as f64 / (time(two[1]) - time(two[0])) as f64;
        let pose = |pose: &Pose| {
            let [w, x, y, z] = pose.quaternion_wxyz;
            (DQuat::from_xyzw(x, y, z, w).normalize(), DVec3::from_array(pose.position_cm) * 10.0)
        };
        let [(a, from), (b, to)] = [pose(two[0]), pose(two[1])];
        Some(DAffine3::from_rotation_translation(slerp(a, b, share), from.lerp(to, share)))
    }

    #[test]
    fn tracker_and_grabber_observe_same_motion_at_stamped_times() {
        let settings = ScanSettings {
            scene: super::super::Scene::Body(Arc::new(body::doll::doll())),
            scanner: Some(Scanner::abdominal(105.0).in_water()),
            image_size: [96, 80],
            pixel_mm: [1.4, 1.4],
            ..small()
        };
        let bedside = bedside(settings);
        let clock = Manual::at(BEGIN - SECOND / 2);
        let twin = Arc::new(Mutex::new(Twin::new(bedside.motion(), Faults::default())));
        let opener = MemoryOpener::new(twin, clock.clone(), 115_200);
        let stations = Settings { stations: vec![PROBE_STATION, REFERENCE_STATION], ..Settings::default() };
        let unit = fastrak::Unit::new("a line", stations, None).unwrap();
        let mut tracker = Connection::new(Box::new(opener), Arc::new(clock.clone()), unit, false);
        let latency = 40 * MS;
        let faults = Faults { latency_ns: latency, ..Faults::default() };
        let size = bedside.scan().settings().image_size;
        let mut grabber = Grabber::new(bedside.pictures(), size, 30.0, faults, Arc::new(clock.clone())).unwrap();
        tracker.start().unwrap();
        grabber.start().unwrap();
        let (mut poses, mut frames): (Vec<Pose>, Vec<Frame>) = (Vec::new(), Vec::new());
        while clock.now_ns() < BEGIN + 3 * SECOND {
            let deadline = clock.now_ns() + MS;
            if let Next::Reading(Reading::Pose(pose)) = tracker.next(deadline).unwrap() {
                poses.push(pose);
            }
            // Frames due by now.
            if let Next::Reading(Reading::Frame(frame)) = grabber.next(clock.now_ns()).unwrap() {
                frames.push(frame);
            }
        }
        let timing = tracker.describe().timing;
        let probe_from_image = bedside.scan().probe_from_image().affine();
        let mut paint = bedside.pictures();
        let (mut worst, mut compared, mut shown) = (0.0_f64, 0, 0);
        for frame in &frames {
            let seen_ns = frame.stamp.host_ns.unwrap() - latency;
            // The second station's record waits for the first one's.
            let wire = |station: u8| timing.sampling_ns + i64::from(station) * timing.wire_ns;
            let [probe, reference] =
                [PROBE_STATION, REFERENCE_STATION].map(|station| between(&poses, station, seen_ns, wire(station)));
            let (Some(probe), Some(reference)) = (probe, reference) else { continue };
            let found = reference.inverse() * probe * probe_from_image;
            let truth = bedside.world_from_image(seen_ns).affine();
            for corner in [[0.0, 0.0], [95.0, 0.0], [0.0, 79.0], [95.0, 79.0]] {
                let at = DVec3::new(corner[0], corner[1], 0.0);
                worst = worst.max((found.transform_point3(at) - truth.transform_point3(at)).length());
            }
            let mut picture = vec![0; frame.pixels.len()];
            paint(seen_ns, &mut picture);
            assert!(*frame.pixels == picture, "the picture is that of {seen_ns}");
            compared += 1;
            shown += u32::from(picture.iter().any(|grey| *grey > 60));
        }
        assert!(compared > 70 && shown > 60, "{compared} {shown}");
        // Interpolation spans two frames, and the speed changes at each of them.
        assert!(worst < 0.05, "{worst} mm");
    }
}

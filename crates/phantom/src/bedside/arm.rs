//! The bedside's probe in a measuring arm, with the counts of its encoders.
//!
//! The arm stands beside the static patient: its base is the world, up to a constant transform.
//! The image's u axis lies along the base's z. An arm can therefore follow a motion that only
//! shifts the image along v and its normal, and turns it about u.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use calibration::arm::{Arm, Elbow, Joint, PlanarPose, Sign, Values};
use calibration::error::CalibrationError;
use calibration::file::CalibrationFile;
use drivers::simulated::Joints;
use sonoweave_core::frames::{Image as ImageFrame, Probe, Tracker, Transform, World};
use sonoweave_core::reading::AXES;

use super::super::PhantomError;
use super::super::bmode::BMode;
use super::super::trajectory::PictureMm;
use super::Bedside;

/// Height of the image's middle above the arm's plane of motion, mm.
const ABOVE: f64 = 12.0;
/// Rounding error of a planar motion, mm and degrees.
const PLANAR: f64 = 1e-6;

/// Returns an arm of two revolute joints and a wrist, with encoders of `counts_per_turn`; its
/// reach is half a metre. Signs and lengths differ, so that exchanged joints are detected.
///
/// # Errors
/// [`CalibrationError::Arm`] for an invalid number of counts.
pub fn standard_arm(counts_per_turn: f64) -> Result<Arm, CalibrationError> {
    let [shoulder, elbow, wrist] = [250.0, 220.0, 60.0].map(|length| Joint::revolute(length, counts_per_turn));
    Arm::new([shoulder, Joint { sign: Sign::Minus, ..elbow }, wrist])
}

/// An arm that carries the bedside's probe. Its encoders are zeroed at its home position, which
/// is the probe's position before the sweep.
pub struct BedsideArm {
    bedside: Arc<Bedside>,
    arm: Arm,
    /// Joint values at each frame of the scan.
    values: Vec<Values>,
}

impl fmt::Debug for BedsideArm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Omits the scan, whose scene has thousands of numbers.
        f.debug_struct("BedsideArm").field("arm", &self.arm).finish_non_exhaustive()
    }
}

/// Returns the patient's position: u along the base's z, v along its x, away from the base, the
/// sweep along its y. The middle of the sweep is in front of the arm and a little above it.
pub fn tracker_from_world() -> Transform<Tracker, World> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        translation: DVec3::new(350.0, 40.0, ABOVE),
    })
}

/// Returns the mounting of the transducer on the last link: v along it, u along the base's z,
/// the image's middle ahead and a little aside.
fn probe_from_picture() -> Transform<Probe, PictureMm> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        translation: DVec3::new(45.0, -3.0, ABOVE),
    })
}

impl BedsideArm {
    /// Mounts the probe on an arm. The arm's zeros are set at home, whatever they were.
    ///
    /// # Errors
    /// [`PhantomError::NotPlanar`] for a motion that leaves a plane,
    /// [`PhantomError::Unreachable`] if the links are too short or too long for it.
    pub fn new(bedside: Arc<Bedside>, arm: Arm) -> Result<Self, PhantomError> {
        let scan = bedside.scan();
        let mut values: Vec<Values> = Vec::with_capacity(scan.frames() as usize);
        for frame in 0..scan.frames() {
            let there = tracker_from_probe(&scan.trajectory().world_from_picture(frame));
            let pose =
                PlanarPose::nearest(&there, PLANAR, PLANAR).map_err(|why| PhantomError::NotPlanar { frame, why })?;
            let reached = match values.last() {
                None => arm.inverse(&pose, Elbow::Up),
                Some(before) => arm.inverse_near(&pose, before),
            };
            values.push(reached.map_err(|why| PhantomError::Unreachable { frame, why })?);
        }
        // A scan has at least one frame.
        let arm = arm.zeroed_at(&values[0]);
        Ok(Self { bedside, arm, values })
    }

    /// Returns the arm, with its encoders' zeros.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the bedside.
    pub fn bedside(&self) -> &Arc<Bedside> {
        &self.bedside
    }

    /// Returns the pose of the last link at a time, host ns.
    pub fn tracker_from_probe(&self, at_ns: i64) -> Transform<Tracker, Probe> {
        tracker_from_probe(&self.bedside.world_from_picture(at_ns))
    }

    /// Maps pixels of the frame at a time to mm in the base's axes.
    pub fn tracker_from_image(&self, at_ns: i64) -> Transform<Tracker, ImageFrame> {
        tracker_from_world() * self.bedside.world_from_image(at_ns)
    }

    /// Returns the probe calibration: maps pixels to mm at the last link.
    pub fn probe_from_image(&self) -> Transform<Probe, ImageFrame> {
        probe_from_picture() * self.bedside.scan().picture_from_image()
    }

    /// Returns the calibration file of the arm, the probe and the image.
    pub fn calibration(&self) -> CalibrationFile {
        let scan = self.bedside.scan();
        CalibrationFile {
            provenance: "simulated: a probe in an arm".into(),
            probe_from_image: Some(self.probe_from_image()),
            arm: Some(self.arm),
            fan: scan.settings().fan,
            clip: scan.bmode().map(BMode::layout).and_then(|layout| layout.clip()),
            ..CalibrationFile::default()
        }
    }

    /// Returns the encoders' resolution at the image, mm: the largest displacement of a corner if
    /// each count is off by half a count. A joint turns the corner about itself, at a distance of
    /// at most the lengths of the links from there, and of the corner's lever on the last link.
    pub fn resolution_mm(&self) -> f64 {
        let [right, bottom] = self.bedside.scan().settings().image_size.map(|n| f64::from(n) - 1.0);
        let probe_from_image = self.probe_from_image();
        // The axes are along z, so heights have no effect.
        let lever = |[u, v]: [f64; 2]| probe_from_image.point(DVec3::new(u, v, 0.0)).truncate().length();
        let lever =
            [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(lever).into_iter().fold(0.0, f64::max);
        let (mut distance, mut sum) = (lever, 0.0);
        for joint in self.arm.joints().iter().rev() {
            distance += joint.length_mm;
            sum += distance * PI / joint.counts_per_unit;
        }
        sum
    }

    /// Returns the joint values at a time.
    pub fn values(&self, at_ns: i64) -> Values {
        let (frame, share) = self.bedside.left(at_ns);
        let from = &self.values[frame as usize];
        let reached = PlanarPose::nearest(&self.tracker_from_probe(at_ns), PLANAR, PLANAR)
            .ok()
            .and_then(|pose| self.arm.inverse_near(&pose, from).ok());
        // Poses between two frames may be out of reach; the joints are interpolated there.
        reached.unwrap_or_else(|| {
            let to = self.values.get(frame as usize + 1).unwrap_or(from);
            std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
        })
    }

    /// Returns the encoder counts for a virtual arm, each rounded to nearest.
    pub fn joints(self: &Arc<Self>) -> Joints {
        let this = Arc::clone(self);
        Arc::new(move |at_ns| {
            let mut counts = [0; AXES];
            let exact = this.arm.counts(&this.values(at_ns));
            // Counts of an arm are far below the range of an i64.
            counts.iter_mut().zip(exact).for_each(|(count, exact)| *count = exact.round() as i64);
            counts
        })
    }
}

fn tracker_from_probe(world_from_picture: &Transform<World, PictureMm>) -> Transform<Tracker, Probe> {
    tracker_from_world() * *world_from_picture * probe_from_picture().inverse()
}

#[cfg(test)]
mod tests;

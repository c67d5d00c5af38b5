//! The bedside's probe in an arm: what its encoders show of the one hand.
//!
//! The arm stands beside the patient, who lies still: its base is the world, but for a constant transform. The image's u axis lies along the base's z, so that a hand that only
//! shifts the picture along v and its normal, and turns it about u, is one that an arm can follow.

use std::fmt;
use std::sync::Arc;

use calibration::arm::{Arm, BadArm, Elbow, Joint, PlanarPose, Sign, Values};
use calibration::file::CalibrationFile;
use calibration::frames::{Image as ImageFrame, Probe, Tracker, Transform, World};
use drivers::reading::AXES;
use drivers::simulated::Joints;
use glam::{DAffine3, DMat3, DVec3};

use super::super::PhantomError;
use super::super::bmode::BMode;
use super::super::trajectory::PictureMm;
use super::Bedside;

/// The picture's middle above the plane that the arm moves in, mm.
const ABOVE: f64 = 12.0;
/// What rounding leaves of a motion in a plane, mm and degrees.
const PLANAR: f64 = 1e-6;

/// Of two joints that turn, and a wrist, with encoders of so many counts a turn: reaches half a metre. Signs and lengths differ, lest joints that are mistaken for each other go unseen.
///
/// # Errors
/// [`BadArm`] for a number of counts that is none.
pub fn standard_arm(counts_per_turn: f64) -> Result<Arm, BadArm> {
    let [shoulder, elbow, wrist] = [250.0, 220.0, 60.0].map(|length| Joint::revolute(length, counts_per_turn));
    Arm::new([shoulder, Joint { sign: Sign::Minus, ..elbow }, wrist])
}

/// An arm that carries the bedside's probe. Its encoders are zeroed where the hand rests before the sweep: there it is at home.
pub struct BedsideArm {
    bedside: Arc<Bedside>,
    arm: Arm,
    /// Values of the joints at each frame of the scan.
    values: Vec<Values>,
}

impl fmt::Debug for BedsideArm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A scan's scene has thousands of numbers.
        f.debug_struct("BedsideArm").field("arm", &self.arm).finish_non_exhaustive()
    }
}

/// Where the patient lies: u along the base's z, v along its x, away from the base, the sweep along its y; the middle of the sweep before the arm and a little above it.
pub fn tracker_from_world() -> Transform<Tracker, World> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        translation: DVec3::new(350.0, 40.0, ABOVE),
    })
}

/// How the transducer sits at the end of the last link: v along it, u along the base's z, the picture's middle ahead and a little aside.
fn probe_from_picture() -> Transform<Probe, PictureMm> {
    Transform::from_affine(DAffine3 {
        matrix3: DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y),
        translation: DVec3::new(45.0, -3.0, ABOVE),
    })
}

impl BedsideArm {
    /// Has the arm carry the probe. Its zeros are set at home, whatever they were.
    ///
    /// # Errors
    /// [`PhantomError::NotPlanar`] for a motion that leaves a plane, [`PhantomError::Unreachable`] where the links are too short or too long for it.
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
        // There is a frame.
        let arm = arm.zeroed_at(&values[0]);
        Ok(Self { bedside, arm, values })
    }

    /// The arm, with its zeros as its encoders have them.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// The bedside that it stands at.
    pub fn bedside(&self) -> &Arc<Bedside> {
        &self.bedside
    }

    /// Where its last link is at a time, host ns.
    pub fn tracker_from_probe(&self, at_ns: i64) -> Transform<Tracker, Probe> {
        tracker_from_probe(&self.bedside.world_from_picture(at_ns))
    }

    /// Maps pixels of the picture that is seen at a time to mm of the base.
    pub fn tracker_from_image(&self, at_ns: i64) -> Transform<Tracker, ImageFrame> {
        tracker_from_world() * self.bedside.world_from_image(at_ns)
    }

    /// The probe's calibration: maps pixels to mm at the last link.
    pub fn probe_from_image(&self) -> Transform<Probe, ImageFrame> {
        probe_from_picture() * self.bedside.scan().picture_from_image()
    }

    /// All that a calibration would find of the arm, the probe and the picture.
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

    /// The joints' values at a time.
    pub fn values(&self, at_ns: i64) -> Values {
        let (frame, share) = self.bedside.left(at_ns);
        let from = &self.values[frame as usize];
        let reached = PlanarPose::nearest(&self.tracker_from_probe(at_ns), PLANAR, PLANAR)
            .ok()
            .and_then(|pose| self.arm.inverse_near(&pose, from).ok());
        // Between two poses at the edge of its reach an arm gives way to the hand.
        reached.unwrap_or_else(|| {
            let to = self.values.get(frame as usize + 1).unwrap_or(from);
            std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
        })
    }

    /// What an arm's twin measures: the counts that its encoders show, each the nearest.
    pub fn joints(self: &Arc<Self>) -> Joints {
        let this = Arc::clone(self);
        Arc::new(move |at_ns| {
            let mut counts = [0; AXES];
            let exact = this.arm.counts(&this.values(at_ns));
            // An arm's counts fit an i64 many times.
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

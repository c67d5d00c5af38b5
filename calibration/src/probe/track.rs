//! Interpolated poses of the probe and of the phantom's sensor.

use glam::{DAffine3, DQuat};

use sonoweave_core::frames::{Probe, Reference, Tracker, Transform};
use sonoweave_core::rotation::slerp;

/// Default longest gap between poses for interpolation, s.
const LONGEST_GAP_S: f64 = 0.5;

/// The poses at one time; rigid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poses {
    /// Time, s.
    pub time_s: f64,
    /// Pose of the probe.
    pub tracker_from_probe: Transform<Tracker, Probe>,
    /// Pose of the sensor that the phantom is held on; `None` if it is held on the tracker
    /// itself.
    pub tracker_from_reference: Option<Transform<Tracker, Reference>>,
}

impl Poses {
    /// Returns the probe's pose relative to the sensor that the phantom is held on.
    pub fn reference_from_probe(&self) -> Transform<Reference, Probe> {
        self.tracker_from_reference.unwrap_or(Transform::IDENTITY).inverse() * self.tracker_from_probe
    }
}

/// Poses in the order of their times.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    poses: Vec<Poses>,
    longest_gap_s: f64,
}

impl Track {
    /// Takes poses in any order; of two at the same time the first is kept. Poses up to half a
    /// second apart are interpolated.
    pub fn new(mut poses: Vec<Poses>) -> Self {
        poses.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        poses.dedup_by(|later, first| later.time_s == first.time_s);
        Self { poses, longest_gap_s: LONGEST_GAP_S }
    }

    /// Returns the same poses with another longest gap for interpolation, s.
    pub fn with_longest_gap(self, longest_gap_s: f64) -> Self {
        Self { longest_gap_s, ..self }
    }

    /// Returns all poses.
    pub fn poses(&self) -> &[Poses] {
        &self.poses
    }

    /// Returns the same poses with scaled positions.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        let longer = |mut affine: DAffine3| {
            affine.translation *= factor;
            affine
        };
        let poses = self.poses.iter().map(|poses| Poses {
            tracker_from_probe: Transform::from_affine(longer(poses.tracker_from_probe.affine())),
            tracker_from_reference: poses.tracker_from_reference.map(|t| Transform::from_affine(longer(t.affine()))),
            ..*poses
        });
        Self { poses: poses.collect(), ..*self }
    }

    /// Returns the poses at a time, interpolated between two neighbours; `None` before the
    /// first, after the last, and in gaps that are too long.
    pub fn at(&self, time_s: f64) -> Option<Poses> {
        let after = self.poses.partition_point(|poses| poses.time_s < time_s);
        let later = self.poses.get(after)?;
        if later.time_s == time_s {
            return Some(*later);
        }
        let earlier = self.poses.get(after.checked_sub(1)?)?;
        let gap = later.time_s - earlier.time_s;
        if gap > self.longest_gap_s {
            return None;
        }
        let share = (time_s - earlier.time_s) / gap;
        let between = |a: DAffine3, b: DAffine3| {
            let turn = slerp(DQuat::from_mat3(&a.matrix3), DQuat::from_mat3(&b.matrix3), share);
            DAffine3::from_rotation_translation(turn, a.translation.lerp(b.translation, share))
        };
        let probe = between(earlier.tracker_from_probe.affine(), later.tracker_from_probe.affine());
        let reference = match (earlier.tracker_from_reference, later.tracker_from_reference) {
            (Some(a), Some(b)) => Some(Transform::from_affine(between(a.affine(), b.affine()))),
            (None, None) => None,
            _ => return None,
        };
        Some(Poses { time_s, tracker_from_probe: Transform::from_affine(probe), tracker_from_reference: reference })
    }

    /// Returns the derivative of the map from the probe to the reference, 1/s. The span is long
    /// against the poses' noise and short against the operator's motion. `None` without poses.
    pub(super) fn rate(&self, time_s: f64) -> Option<DAffine3> {
        const HALF_S: f64 = 0.12;
        let map = |time: f64| self.at(time).map(|poses| poses.reference_from_probe().affine());
        let here = map(time_s)?;
        let (before, after) = (map(time_s - HALF_S), map(time_s + HALF_S));
        let span = HALF_S * f64::from(u8::from(before.is_some()) + u8::from(after.is_some()));
        let (before, after) = (before.unwrap_or(here), after.unwrap_or(here));
        let scale = if span > 0.0 { 1.0 / span } else { 0.0 };
        Some(DAffine3 {
            matrix3: (after.matrix3 - before.matrix3) * scale,
            translation: (after.translation - before.translation) * scale,
        })
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn pose(time_s: f64, x: f64, turn: f64) -> Poses {
        let probe = DAffine3::from_rotation_translation(DQuat::from_rotation_z(turn), DVec3::new(x, 2.0, 3.0));
        let reference = DAffine3::from_translation(DVec3::new(0.0, 0.0, 10.0));
        Poses {
            time_s,
            tracker_from_probe: Transform::from_affine(probe),
            tracker_from_reference: Some(Transform::from_affine(reference)),
        }
    }

    #[test]
    fn poses_are_interpolated_between_neighbours_only() {
        let track = Track::new(vec![pose(1.2, 8.0, 0.2), pose(1.0, 4.0, 0.0), pose(2.0, 9.0, 0.3)]);
        assert_eq!(track.at(1.0), Some(pose(1.0, 4.0, 0.0)));
        let middle = track.at(1.05).unwrap();
        let at = middle.tracker_from_probe.affine();
        assert!((at.translation.x - 5.0).abs() < 1e-12);
        assert!(at.matrix3.abs_diff_eq(glam::DMat3::from_rotation_z(0.05), 1e-12));
        assert!((middle.reference_from_probe().point(DVec3::ZERO).z + 7.0).abs() < 1e-12);
        assert_eq!((track.at(0.9), track.at(2.1), track.at(1.5)), (None, None, None), "outside, and in a gap");
        assert_eq!(track.clone().with_longest_gap(0.1).at(1.05), None);
        assert!(track.with_longest_gap(1.0).scaled(2.0).at(1.5).is_some());
    }

    #[test]
    fn rate_is_derivative_of_map_to_reference() {
        let track = Track::new((0..40).map(|i| 0.05 * f64::from(i)).map(|t| pose(t, 20.0 * t, 0.0)).collect());
        for time in [0.0, 1.0, 1.95] {
            assert!(track.rate(time).unwrap().translation.distance(DVec3::X * 20.0) < 1e-9);
        }
        assert_eq!(Track::new(vec![pose(1.0, 3.0, 0.0)]).rate(1.0).unwrap().translation, DVec3::ZERO);
        assert_eq!(track.rate(5.0), None);
    }
}

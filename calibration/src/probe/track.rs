//! Where the probe was, and the phantom's sensor, from pose to pose.

use glam::{DAffine3, DQuat};

use crate::frames::{Probe, Reference, Tracker, Transform};

/// Between poses that are further apart nothing is interpolated unless it is said otherwise, s.
const LONGEST_GAP_S: f64 = 0.5;

/// The poses of a moment; rigid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Poses {
    /// When, s.
    pub time_s: f64,
    /// The probe's.
    pub tracker_from_probe: Transform<Tracker, Probe>,
    /// That of the sensor that the phantom is held on; `None` where it is held on the tracker itself.
    pub tracker_from_reference: Option<Transform<Tracker, Reference>>,
}

impl Poses {
    /// Where the probe was for the sensor that the phantom is held on.
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
    /// Of poses in any order; of two of the same time the first is kept. Between poses up to half a second apart it is interpolated.
    pub fn new(mut poses: Vec<Poses>) -> Self {
        poses.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        poses.dedup_by(|later, first| later.time_s == first.time_s);
        Self { poses, longest_gap_s: LONGEST_GAP_S }
    }

    /// The same, interpolated between poses up to so far apart, s.
    pub fn with_longest_gap(self, longest_gap_s: f64) -> Self {
        Self { longest_gap_s, ..self }
    }

    /// All of them.
    pub fn poses(&self) -> &[Poses] {
        &self.poses
    }

    /// The same poses, with positions so many times as large.
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

    /// The poses at a time, between two neighbours; `None` before the first, after the last, and in gaps that are too long.
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
            let turn = DQuat::from_mat3(&a.matrix3).slerp(DQuat::from_mat3(&b.matrix3), share);
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

    /// How the way from the probe to the reference changes with time, 1/s: over a span that is long against the poses' noise and short against a hand's motion. `None` where there are no poses.
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
    fn poses_lie_between_their_neighbours_and_nowhere_else() {
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
    fn the_rate_is_that_of_the_way_to_the_reference() {
        let track = Track::new((0..40).map(|i| 0.05 * f64::from(i)).map(|t| pose(t, 20.0 * t, 0.0)).collect());
        for time in [0.0, 1.0, 1.95] {
            assert!(track.rate(time).unwrap().translation.distance(DVec3::X * 20.0) < 1e-9);
        }
        assert_eq!(Track::new(vec![pose(1.0, 3.0, 0.0)]).rate(1.0).unwrap().translation, DVec3::ZERO);
        assert_eq!(track.rate(5.0), None);
    }
}

//! Light slices in the plane of another slice.

use glam::{DAffine3, DMat3, DVec2, DVec3};

use crate::slices::Slices;

/// Cosine of the angle within which slices have one direction: 5°.
const ALIKE: f64 = 0.996_194_698_091_745_5;

/// A slice at its place.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    slice: usize,
    /// From columns and rows of the reduced image, and mm along its normal.
    world: DAffine3,
}

impl Placed {
    /// Returns a slice at its place; `None` without poses around its time.
    pub(super) fn of(slices: &Slices, slice: usize) -> Option<Self> {
        let DAffine3 { matrix3: m, translation } = slices.placed(slice, 0.0)?;
        let matrix3 = DMat3::from_cols(m.x_axis, m.y_axis, m.x_axis.cross(m.y_axis).normalize());
        Some(Self { slice, world: DAffine3 { matrix3, translation } })
    }

    /// Whether this slice and another one have one direction: that of their normals, either way,
    /// and that of depth.
    fn is_along(&self, other: &Self) -> bool {
        let [a, b] = [self, other].map(|placed| placed.world.matrix3);
        a.z_axis.dot(b.z_axis).abs() >= ALIKE && a.y_axis.normalize().dot(b.y_axis.normalize()) >= ALIKE
    }

    /// Returns the map from columns and rows of another slice to this one's, and the distance, mm.
    fn from(&self, other: &Self) -> DAffine3 {
        self.world.inverse() * other.world
    }
}

/// Slices that others are compared with.
pub(super) struct Reference<'a> {
    slices: &'a Slices,
    placed: Vec<Placed>,
    /// Largest distance of a plane, mm.
    near_mm: f64,
}

impl<'a> Reference<'a> {
    pub(super) fn new(slices: &'a Slices, placed: Vec<Placed>, near_mm: f64) -> Self {
        Self { slices, placed, near_mm }
    }

    /// Returns the distance of the nearest slice of the same direction at the middle of another
    /// one, mm; infinite if there is none.
    pub(super) fn distance_mm(&self, to: &Placed) -> f64 {
        let [u, v] = self.slices.bounds.map(|[low, high]| 0.5 * (low + high));
        let distance = |placed: &Placed| placed.from(to).transform_point3(DVec3::new(u, v, 0.0)).z.abs();
        self.placed.iter().filter(|placed| placed.is_along(to)).map(distance).fold(f64::INFINITY, f64::min)
    }

    /// Whether a slice lies near another one.
    pub(super) fn is_near(&self, to: &Placed) -> bool {
        self.distance_mm(to) <= self.near_mm
    }

    /// Returns the grey values in the plane of another slice: between those of the nearest slices
    /// on either side, or those of the only near one.
    pub(super) fn seen_from(&self, to: &Placed) -> Vec<Option<f64>> {
        let [[left, right], [first, last]] = self.slices.bounds;
        let corners = [[left, first], [right, first], [left, last], [right, last]];
        let reaches = |map: &DAffine3| {
            let heights = corners.map(|[u, v]| map.transform_point3(DVec3::new(u, v, 0.0)).z);
            heights.iter().any(|mm| *mm >= -self.near_mm) && heights.iter().any(|mm| *mm <= self.near_mm)
        };
        let along = self.placed.iter().filter(|placed| placed.is_along(to));
        let near: Vec<(&[u16], DAffine3)> = along
            .map(|placed| (&self.slices.pixels[placed.slice].1[..], placed.from(to)))
            .filter(|(_, map)| reaches(map))
            .collect();
        let width = self.slices.width;
        (0..width * self.slices.height)
            .map(|at| self.slices.is_data[at].then(|| self.grey(&near, [at % width, at / width].map(|x| x as f64)))?)
            .collect()
    }

    fn grey(&self, near: &[(&[u16], DAffine3)], [u, v]: [f64; 2]) -> Option<f64> {
        let mut sides = [(f64::INFINITY, None); 2];
        for (pixels, map) in near {
            let [x, y, z] = [map.matrix3.x_axis, map.matrix3.y_axis, map.translation].map(|axis| axis.z);
            let height = x * u + y * v + z;
            let side = &mut sides[usize::from(height > 0.0)];
            if height.abs() <= self.near_mm && height.abs() < side.0 {
                *side = (height.abs(), Some((pixels, map)));
            }
        }
        let read = sides.map(|(mm, found)| {
            let (pixels, map) = found?;
            let p: DVec2 = map.transform_point3(DVec3::new(u, v, 0.0)).truncate();
            Some((mm, self.slices.grey(pixels, p)?))
        });
        match read {
            [Some((a, p)), Some((b, q))] => Some(if a + b > 0.0 { (b * p + a * q) / (a + b) } else { p }),
            [one, other] => one.or(other).map(|(_, grey)| grey),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::trajectory::PoseSample;
    use crate::trajectory::pose_spline::PoseSpline;

    /// Slices of one grey value each, at places along the normal, turned about v.
    fn slices(of: &[(f64, f64, u8)]) -> Slices {
        let rest = of.iter().enumerate().flat_map(|(k, (z, turn, _))| {
            [-0.04, 0.04].map(|off| PoseSample {
                time_s: k as f64 + off,
                rotation: DQuat::from_rotation_y(*turn),
                position_mm: DVec3::new(0.0, 0.0, *z),
            })
        });
        let poses = PoseSpline::new(&rest.collect::<Vec<_>>()).unwrap();
        let mut slices = Slices::new(16, 16, &[true; 256], DAffine3::IDENTITY, poses);
        of.iter().enumerate().for_each(|(k, (.., grey))| slices.push(k as f64, &[*grey; 256], 16, 16));
        slices
    }

    #[test]
    fn grey_values_lie_between_those_of_nearest_slices() {
        let slices = slices(&[(0.0, 0.0, 40), (1.0, 0.0, 60), (3.0, 0.0, 200), (0.25, 0.0, 0), (1.25, 0.1, 0)]);
        let placed = |slice: usize| Placed::of(&slices, slice).unwrap();
        let seen = |near_mm: f64, from: usize| {
            let reference = Reference::new(&slices, (0..3).map(placed).collect(), near_mm);
            (reference.is_near(&placed(from)), reference.seen_from(&placed(from))[8 * 16 + 8])
        };
        let is_about = |grey: Option<f64>, expected: f64| grey.is_some_and(|grey| (grey - expected).abs() < 1e-6);
        let (is_near, between) = seen(0.8, 3);
        assert!(is_near && is_about(between, 45.0), "{between:?}");
        // The further one does not count, and then neither does.
        let (is_near, nearest) = seen(0.3, 3);
        assert!(is_near && is_about(nearest, 40.0), "{nearest:?}");
        assert_eq!(seen(0.2, 3), (false, None));
        assert_eq!(seen(0.8, 4), (false, None), "planes 6° apart");
    }
}

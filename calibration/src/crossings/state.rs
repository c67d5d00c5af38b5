//! The nine numbers of a calibration, and slices placed by them.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use nalgebra::SVector;

use crate::slices::Slices;

/// Count of the numbers: displacement along u, v and the normal, mm; turns about these, rad; change
/// of the scale along u and v; change of the lag, s.
pub(crate) const COUNT: usize = 9;

/// A change of the numbers.
pub(crate) type Change = SVector<f64, COUNT>;

/// Time over which a slice's velocity is taken, s.
const STEP_S: f64 = 0.002;

/// A calibration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct State {
    /// Rigid: from mm of the image, about its middle, to the probe.
    pub(crate) probe_from_picture: DAffine3,
    /// From reduced pixels to mm of the image.
    pub(crate) picture_from_pixel: DAffine3,
    /// Delay of the tracker behind the video.
    pub(super) lag_s: f64,
}

/// A slice at its place.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    /// Rigid: from mm of the image to the world.
    pub(crate) world_from_picture: DAffine3,
    /// Its change, per s.
    pub(crate) rate: DAffine3,
}

/// All slices at their places.
#[derive(Debug, Clone)]
pub(crate) struct Placing {
    /// None of a slice without poses around its time.
    pub(crate) slices: Vec<Option<Placed>>,
    /// From reduced pixels to mm of the image.
    pub(crate) picture_from_pixel: DAffine3,
}

impl State {
    /// Returns the calibration of the slices, without a lag.
    pub(crate) fn of(slices: &Slices) -> Self {
        let probe_from_pixel = slices.probe_from_pixel;
        let [u, v] = slices.bounds.map(|[low, high]| 0.5 * (low + high));
        let m = probe_from_pixel.matrix3;
        let x = m.x_axis.normalize();
        let z = m.x_axis.cross(m.y_axis).normalize();
        let probe_from_picture = DAffine3 {
            matrix3: DMat3::from_cols(x, z.cross(x), z),
            translation: probe_from_pixel.transform_point3(DVec3::new(u, v, 0.0)),
        };
        let picture_from_pixel = probe_from_picture.inverse() * probe_from_pixel;
        Self { probe_from_picture, picture_from_pixel, lag_s: 0.0 }
    }

    /// Returns the calibration after a change.
    pub(super) fn changed(&self, by: &Change) -> Self {
        let rigid = rigid(by.as_slice());
        let scale = DAffine3::from_scale(DVec3::new(1.0 + by[6], 1.0 + by[7], 1.0));
        Self {
            probe_from_picture: self.probe_from_picture * rigid,
            picture_from_pixel: scale * self.picture_from_pixel,
            lag_s: self.lag_s + by[8],
        }
    }

    /// Returns the map from reduced pixels to the probe.
    pub(super) fn probe_from_pixel(&self) -> DAffine3 {
        self.probe_from_picture * self.picture_from_pixel
    }

    /// Returns the rigid map from mm of a slice's image, about its middle, to the world; `None`
    /// without poses at its time.
    pub(crate) fn world_from_picture(&self, slices: &Slices, slice: usize) -> Option<DAffine3> {
        Some(slices.poses.at(slices.pixels[slice].0 + self.lag_s)? * self.probe_from_picture)
    }

    /// Returns the place of a slice; `None` without poses around its time.
    pub(super) fn placed(&self, slices: &Slices, slice: usize) -> Option<Placed> {
        let time_s = slices.pixels[slice].0 + self.lag_s;
        let [before, after] = [-STEP_S, STEP_S].map(|step| slices.poses.at(time_s + step));
        let [before, after] = [before? * self.probe_from_picture, after? * self.probe_from_picture];
        let per_s = 0.5 / STEP_S;
        let rate = DAffine3 {
            matrix3: (after.matrix3 - before.matrix3) * per_s,
            translation: (after.translation - before.translation) * per_s,
        };
        Some(Placed { world_from_picture: self.world_from_picture(slices, slice)?, rate })
    }

    /// Returns all slices at their places.
    pub(crate) fn placing(&self, slices: &Slices) -> Placing {
        let placed = (0..slices.pixels.len()).map(|slice| self.placed(slices, slice));
        Placing { slices: placed.collect(), picture_from_pixel: self.picture_from_pixel }
    }

    /// Returns the points of the image at which displacements are stated, reduced pixels: the
    /// middle, and eight on the border.
    pub(crate) fn points(slices: &Slices) -> [DVec3; 9] {
        let [u, v] = slices.bounds.map(|[low, high]| [low, 0.5 * (low + high), high]);
        std::array::from_fn(|k| DVec3::new(u[k % 3], v[k / 3], 0.0))
    }
}

/// Returns the rigid motion by the first six numbers of a change.
pub(crate) fn rigid(by: &[f64]) -> DAffine3 {
    let vector = |first: usize| DVec3::new(by[first], by[first + 1], by[first + 2]);
    DAffine3::from_rotation_translation(DQuat::from_scaled_axis(vector(3)), vector(0))
}

/// Returns a slope of the image per pixel as one per mm.
pub(crate) fn slope_mm(pixel_from_picture: &DAffine3, slope: DVec2) -> DVec2 {
    let m = pixel_from_picture.matrix3;
    DVec2::new(m.x_axis.truncate().dot(slope), m.y_axis.truncate().dot(slope))
}

/// Returns the displacements of a point of the image per unit of each number but the lag, mm.
pub(crate) fn displacements(p: DVec3) -> [DVec3; COUNT - 1] {
    let turned = |axis: DVec3| axis.cross(p);
    [
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        turned(DVec3::X),
        turned(DVec3::Y),
        turned(DVec3::Z),
        DVec3::new(p.x, 0.0, 0.0),
        DVec3::new(0.0, p.y, 0.0),
    ]
}

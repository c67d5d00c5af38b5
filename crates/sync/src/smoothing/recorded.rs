//! Smoothed transforms of a recording, which has the transforms of each frame beside it.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use sonoweave_core::frames::{affine_from_rows, nearest_rigid};
use sonoweave_core::reading::{NamedTransform, Stamp, Status};

use super::{FastNoise, NotSmoothed, Smoothed, Smoothing, noise_of, smoothed};
use crate::clock::TimeFlags;
use crate::graph::{Names, is_image_frame};
use crate::history::{PoseHistory, PoseSample, Rigid};
use crate::ingest::{RIGID_TOLERANCE, stamp_ns};

/// The pixels' size and skew, which a transform from an image has beside its pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pixels(DAffine3);

/// The poses of a recording's transforms, before all are known.
#[derive(Debug, Default)]
pub(crate) struct RecordedPoses(Vec<(Names, Option<Pixels>, Vec<PoseSample>)>);

/// The poses of a recording's transforms, for smoothing.
#[derive(Debug)]
pub struct SmoothedTransforms {
    settings: Smoothing,
    histories: Vec<(Names, Option<Pixels>, PoseHistory)>,
}

impl Pixels {
    /// Returns those of a map from pixels to mm; `None` if u and v are parallel.
    fn of(affine: &DAffine3) -> Option<Self> {
        let [u, v] = [affine.matrix3.x_axis, affine.matrix3.y_axis];
        let (x, z) = (u.normalize_or_zero(), u.cross(v).normalize_or_zero());
        let axes = DMat3::from_cols(x, z.cross(x), z);
        (z != DVec3::ZERO).then(|| Self(DAffine3::from_mat3(axes.transpose() * affine.matrix3)))
    }

    /// Maps pixels to mm in the image's plane, the first one at the origin.
    pub(crate) fn affine(&self) -> DAffine3 {
        self.0
    }
}

/// Returns the pose in a transform; `None` if it is not rigid but for the pixels.
fn rigid(affine: &DAffine3, pixels: Option<&Pixels>) -> Option<Rigid> {
    let affine = pixels.map_or(*affine, |pixels| *affine * pixels.0.inverse());
    let (affine, _) = nearest_rigid(&affine, RIGID_TOLERANCE).ok()?;
    Some(Rigid { rotation: DQuat::from_mat3(&affine.matrix3).normalize(), position_mm: affine.translation })
}

impl RecordedPoses {
    /// Adds a transform between sensors, or from an image of this name. One without a time, invalid
    /// or not rigid is left out.
    pub(crate) fn take(&mut self, transform: &NamedTransform, image: &str) {
        let time_ns = stamp_ns(&transform.stamp).filter(|_| transform.status == Status::Ok);
        let affine = affine_from_rows(&transform.matrix);
        let (Some(time_ns), Ok(affine), false) = (time_ns, affine, is_image_frame(image, &transform.to)) else {
            return;
        };
        let at = self.0.iter().position(|((from, to), ..)| *from == transform.from && *to == transform.to);
        let at = at.unwrap_or_else(|| {
            let pixels = is_image_frame(image, &transform.from).then(|| Pixels::of(&affine)).flatten();
            self.0.push(((transform.from.clone(), transform.to.clone()), pixels, Vec::new()));
            self.0.len() - 1
        });
        let (_, pixels, samples) = &mut self.0[at];
        if let Some(pose) = rigid(&affine, pixels.as_ref()) {
            samples.push(PoseSample { time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None });
        }
    }

    /// Returns the poses for smoothing.
    pub(crate) fn smoothed(self, settings: Smoothing) -> SmoothedTransforms {
        let histories = self.0.into_iter().map(|(names, pixels, samples)| {
            let mut history = PoseHistory::new(samples.len(), i64::MAX);
            samples.into_iter().for_each(|sample| history.insert(sample));
            (names, pixels, history)
        });
        SmoothedTransforms { settings, histories: histories.collect() }
    }
}

impl SmoothedTransforms {
    /// Returns the settings.
    pub fn settings(&self) -> Smoothing {
        self.settings
    }

    /// Returns each transform's names, with the number of its poses and their noise, as
    /// [`noise_of`] gives them.
    pub fn noise(&self) -> impl Iterator<Item = ([&str; 2], Option<(usize, [FastNoise; 2])>)> {
        self.histories.iter().map(|((from, to), _, history)| ([from.as_str(), to.as_str()], noise_of(history)))
    }

    /// Returns the pose in a transform of a frame, its pixels' size, and the smoothed pose; `None`
    /// for a transform that is not smoothed.
    pub(crate) fn at(
        &self,
        names: &Names,
        stamp: &Stamp,
        affine: &DAffine3,
    ) -> Option<(Rigid, Option<Pixels>, Result<Smoothed, NotSmoothed>)> {
        let (_, pixels, history) = self.histories.iter().find(|(own, ..)| own == names)?;
        let pose = rigid(affine, pixels.as_ref())?;
        let smoothed = match stamp_ns(stamp) {
            Some(time_ns) => smoothed(history, time_ns, &self.settings),
            None => Err(NotSmoothed::FewSamples { samples: 0 }),
        };
        Some((pose, *pixels, smoothed))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use sonoweave_core::frames::{Image, Transform, World};
    use sonoweave_core::named::StaticTransform;

    use super::*;
    use crate::pairing::PairingOptions;
    use crate::pairing::stamped::{Pose, StampedPairing};

    const MS: i64 = 1_000_000;
    const SETTINGS: Smoothing = Smoothing { half_width_ns: 300 * MS, ahead_ns: 300 * MS };
    /// Pixels of 0.2 mm, 100 mm from the sensor.
    const ROWS: [f64; 16] = [0.2, 0.0, 0.0, -10.0, 0.0, 0.2, 0.0, 100.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0];

    /// The true pose of the probe's sensor at an item, 50 a second.
    fn truth(item: u64) -> DAffine3 {
        let s = item as f64 * 0.02;
        let rotation = DQuat::from_rotation_y(0.3 * s) * DQuat::from_rotation_x(0.1 * s * s);
        DAffine3::from_rotation_translation(rotation, DVec3::new(10.0 * s, 3.0 * s * s, 50.0))
    }

    /// Returns three numbers between −0.5 and 0.5 without order.
    fn noise(item: u64, kind: u64) -> DVec3 {
        let one = |axis: u64| (((item * 7919 + kind * 104_729 + axis * 1_299_709) as f64).sqrt() * 1e4).fract() - 0.5;
        DVec3::new(one(1), one(2), one(3))
    }

    fn measured(item: u64) -> DAffine3 {
        let turn = DAffine3::from_quat(DQuat::from_scaled_axis(noise(item, 1) * 0.01));
        DAffine3 { translation: truth(item).translation + noise(item, 2), ..truth(item) * turn }
    }

    fn transform(item: u64, [from, to]: [&str; 2], affine: DAffine3) -> NamedTransform {
        let stamp = Stamp { item, source_s: Some(1000.0 + item as f64 * 0.02), ..Stamp::default() };
        let matrix = Transform::<World, Image>::from_affine(affine).to_rows();
        NamedTransform { stamp, from: from.into(), to: to.into(), matrix, status: Status::Ok }
    }

    /// Returns the smoothed poses of frames, from transforms of these names.
    fn poses(names: [&str; 2], of: impl Fn(u64) -> DAffine3) -> Vec<Pose> {
        let is_image = names[0] == "Image";
        let statics = if is_image { Vec::new() } else { vec![StaticTransform::new("Image", "Probe", &ROWS).unwrap()] };
        let options = PairingOptions { statics, ..PairingOptions::default() };
        let all: Vec<NamedTransform> = (0..100).map(|item| transform(item, names, of(item))).collect();
        let mut recorded = RecordedPoses::default();
        all.iter().for_each(|one| recorded.take(one, "Image"));
        let named = [(names[0].to_owned(), names[1].to_owned())];
        let smoothed = Some(Arc::new(recorded.smoothed(SETTINGS)));
        let mut pairing = StampedPairing::with_names(options, &named).unwrap().with_smoothed(smoothed);
        let pose = |one: NamedTransform| {
            let stamp = one.stamp;
            pairing.transform(one);
            pairing.pose_of(&stamp).unwrap()
        };
        all.into_iter().map(pose).collect()
    }

    /// Returns the root mean squares of a pixel's error without and with smoothing, mm.
    fn errors(poses: &[Pose], probe_from_image: DAffine3) -> [f64; 2] {
        let at = DVec3::new(50.0, 40.0, 0.0);
        let mut sums = [0.0; 2];
        for (item, pose) in (0..).zip(poses).skip(15).take(70) {
            let place = (truth(item) * probe_from_image).transform_point3(at);
            let effect = pose.smoothing.unwrap();
            for (sum, found) in sums.iter_mut().zip([effect.unsmoothed, pose.world_from_image]) {
                *sum += (found.point(at) - place).length_squared() / 70.0;
            }
        }
        sums.map(f64::sqrt)
    }

    #[test]
    fn recorded_poses_of_a_sensor_are_smoothed() {
        let found = poses(["Probe", "Tracker"], measured);
        let [before, after] = errors(&found, affine_from_rows(&ROWS).unwrap());
        assert!(before > 0.4 && after < 0.5 * before, "{before} {after}");
        assert!(found.iter().filter(|pose| pose.smoothing.unwrap().not_smoothed.is_none()).count() > 90);
    }

    #[test]
    fn transforms_of_images_are_smoothed_without_their_scale() {
        let calibration = affine_from_rows(&ROWS).unwrap();
        let found = poses(["Image", "Reference"], |item| measured(item) * calibration);
        let [before, after] = errors(&found, calibration);
        assert!(before > 0.4 && after < 0.5 * before, "{before} {after}");
        let columns = |pose: &Pose| pose.world_from_image.affine().matrix3.x_axis.length();
        assert!(found.iter().all(|pose| (columns(pose) - 0.2).abs() < 1e-9));
    }

    #[test]
    fn untimed_transforms_are_used_as_recorded() {
        let mut recorded = RecordedPoses::default();
        let untimed = |item: u64| {
            let one = transform(item, ["Probe", "Tracker"], measured(item));
            NamedTransform { stamp: Stamp { item, ..Stamp::default() }, ..one }
        };
        (0..100).for_each(|item| recorded.take(&untimed(item), "Image"));
        let smoothed = recorded.smoothed(SETTINGS);
        let one = untimed(50);
        let names = ("Probe".to_owned(), "Tracker".to_owned());
        assert!(smoothed.at(&names, &one.stamp, &measured(50)).is_none(), "no sample has a time");
        // A chain without a sensor has no samples, and says so.
        let options = PairingOptions {
            statics: vec![StaticTransform::new("Image", "Probe", &ROWS).unwrap()],
            ..PairingOptions::default()
        };
        let pairing = StampedPairing::with_names(options, &[names]).unwrap();
        let mut pairing = pairing.with_smoothed(Some(Arc::new(smoothed)));
        pairing.transform(one.clone());
        let effect = pairing.pose_of(&one.stamp).unwrap().smoothing.unwrap();
        assert_eq!(effect.not_smoothed, Some(NotSmoothed::FewSamples { samples: 0 }));
        assert_eq!(effect.moved_mm, 0.0);
    }
}

//! The effect of smoothing on a frame's pose, gathered along the chain from the image to the world.

use glam::{DAffine3, DVec3};

use sonoweave_core::frames::{Image, Transform, World};

use crate::history::Rigid;
use crate::smoothing::{NotSmoothed, Smoothed};

/// Effect of smoothing on a frame's pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothingEffect {
    /// Maps pixels to world mm by the poses before smoothing.
    pub unsmoothed: Transform<World, Image>,
    /// Largest distance by which a corner of the image has moved, mm.
    pub moved_mm: f64,
    /// Root mean square error of a corner, mm, the largest of the four: the standard errors of the
    /// smoothed poses with their lever arms, if their noise is white.
    pub error_mm: f64,
    /// Reason why a source's pose is not smoothed.
    pub not_smoothed: Option<NotSmoothed>,
}

/// A frame on its way from the image to the world.
pub(super) struct Way {
    in_image: [DVec3; 4],
    /// The corners of the image in the frame that has been reached, mm.
    pub(super) corners: [DVec3; 4],
    /// Maps pixels to the frame that has been reached.
    pub(super) reached: DAffine3,
    unsmoothed: DAffine3,
    /// Variances of the corners by the standard errors of smoothed poses, mm².
    variances: [f64; 4],
    not_smoothed: Option<NotSmoothed>,
    /// Whether there was a pose to smooth.
    is_sensed: bool,
}

impl Way {
    /// Begins at an image of this size, pixels.
    pub(super) fn new(size: [u32; 2]) -> Self {
        let [right, bottom] = size.map(|n| f64::from(n) - 1.0);
        let in_image = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[u, v]| DVec3::new(u, v, 0.0));
        Self {
            in_image,
            corners: in_image,
            reached: DAffine3::IDENTITY,
            unsmoothed: DAffine3::IDENTITY,
            variances: [0.0; 4],
            not_smoothed: None,
            is_sensed: false,
        }
    }

    /// Takes a step that smoothing does not change.
    pub(super) fn step(&mut self, affine: DAffine3) {
        self.steps([affine; 2]);
    }

    /// Takes a step by a pose, and by its smoothed pose, if there is one. `inverted` is whether the
    /// step leads from the tracker to the sensor.
    pub(super) fn smoothed_step(&mut self, pose: &Rigid, inverted: bool, smoothed: Result<Smoothed, NotSmoothed>) {
        self.is_sensed = true;
        let taken = match smoothed {
            Ok(smoothed) => {
                for (corner, variance) in self.corners.iter().zip(&mut self.variances) {
                    *variance += smoothed.variance_mm2(lever_mm(*corner, pose, inverted));
                }
                smoothed.pose
            }
            Err(why) => {
                self.not_smoothed.get_or_insert(why);
                *pose
            }
        };
        self.steps([&taken, pose].map(|pose| if inverted { pose.inverse() } else { *pose }.affine()));
    }

    fn steps(&mut self, [affine, unsmoothed]: [DAffine3; 2]) {
        self.corners = self.corners.map(|corner| affine.transform_point3(corner));
        self.reached = affine * self.reached;
        self.unsmoothed = unsmoothed * self.unsmoothed;
    }

    /// Returns the effect of smoothing, at the way's end.
    pub(super) fn effect(&self) -> SmoothingEffect {
        let most = |each: [f64; 4]| each.into_iter().fold(0.0, f64::max);
        let moved = |at: DVec3| (self.reached.transform_point3(at) - self.unsmoothed.transform_point3(at)).length();
        SmoothingEffect {
            unsmoothed: Transform::from_affine(self.unsmoothed),
            moved_mm: most(self.in_image.map(moved)),
            error_mm: most(self.variances).sqrt(),
            // Without a sensor on the way there are no samples.
            not_smoothed: self.not_smoothed.or((!self.is_sensed).then_some(NotSmoothed::FewSamples { samples: 0 })),
        }
    }
}

/// Distance of a point from the sensor about which a pose turns it, mm.
pub(super) fn lever_mm(point: DVec3, pose: &Rigid, inverted: bool) -> f64 {
    if inverted { point - pose.position_mm } else { point }.length()
}

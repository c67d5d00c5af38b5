//! Pairing by stamp: combines images and the transforms of their stamp into posed slices, as
//! recorded sequences have them.

use std::sync::Arc;

use glam::DAffine3;

use sonoweave_core::frames::{Image as ImageFrame, Transform, World, affine_from_rows, nearest_rigid};
use sonoweave_core::reading::{NamedTransform, Stamp, Status, transform_name};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::Slice;

use super::PairingOptions;
use super::smoothed::{SmoothingEffect, Way};
use crate::graph::{Edge, Names, NoPath, Route, is_image_frame};
use crate::ingest::{Head, Picture, RIGID_TOLERANCE};
use crate::smoothing::recorded::SmoothedTransforms;

/// Deviations up to this are rounding; they are repaired without being counted.
const COUNTED: f64 = 1e-9;
/// Largest number of named transforms of a source; a header may claim any number.
pub(crate) const MAX_NAMES: usize = 1024;

/// Pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Maps pixels to world mm.
    pub world_from_image: Transform<World, ImageFrame>,
    /// Tracker poses used that were replaced by the nearest rigid one.
    pub projected: u64,
    /// Largest deviation among them: max |RᵀR − I|.
    pub deviation: f64,
    /// The effect of smoothing; `None` if the poses are not smoothed.
    pub smoothing: Option<SmoothingEffect>,
}

/// A slice, and the corrections to its pose.
#[derive(Debug, Clone)]
pub struct Paired {
    /// The slice.
    pub slice: Slice,
    /// Its pose.
    pub pose: Pose,
}

/// The newest transform with a name.
#[derive(Debug)]
struct NewestTransform {
    names: Names,
    /// Whether neither side is an image frame: then the transform must be rigid.
    tracker: bool,
    /// `None` until delivered, if only the name is known from a survey.
    newest: Option<NamedTransform>,
}

/// The pairing stage.
#[derive(Debug)]
pub struct StampedPairing {
    options: PairingOptions,
    held: Vec<NewestTransform>,
    route: Option<Route>,
    /// Whether names have been added since the last search for a chain.
    names_changed: bool,
    /// Size of the first slice; all must have it.
    size: Option<[u32; 2]>,
    /// Smoothed poses of the sensors; `None` if they are used as recorded.
    smoothed: Option<Arc<SmoothedTransforms>>,
    notes: Vec<String>,
}

impl StampedPairing {
    /// Returns a stage that learns the source's transforms as they arrive. Until a chain to the
    /// world is known, frames are refused; see [`Self::finish`].
    pub fn new(options: PairingOptions) -> Self {
        Self {
            options,
            held: Vec::new(),
            route: None,
            names_changed: true,
            size: None,
            smoothed: None,
            notes: Vec::new(),
        }
    }

    /// Returns a stage that knows the names of the source's transforms in advance (see
    /// [`crate::survey()`]). The choice of the world then does not depend on the content of the
    /// first frame.
    ///
    /// # Errors
    /// [`NoPath`] when no chain leads from the image to the world.
    pub fn with_names(options: PairingOptions, names: &[Names]) -> Result<Self, NoPath> {
        let mut pairing = Self::new(options);
        for (from, to) in names {
            pairing.known(from, to);
        }
        pairing.resolve();
        pairing.finish()?;
        Ok(pairing)
    }

    /// Uses smoothed poses of the sensors.
    pub fn with_smoothed(self, smoothed: Option<Arc<SmoothedTransforms>>) -> Self {
        Self { smoothed, ..self }
    }

    /// Adds a transform. It is kept until the next with its name, and belongs to frames of its
    /// own stamp only.
    pub fn transform(&mut self, transform: NamedTransform) {
        if let Some(index) = self.known(&transform.from, &transform.to) {
            self.held[index].newest = Some(transform);
        }
    }

    /// Returns the pose of the frame of a stamp, by the transforms of that stamp.
    ///
    /// # Errors
    /// A [`Refusal`] when no chain is known yet, or a transform of the chain is missing,
    /// invalid or unfit. Other transforms do not matter.
    pub fn pose(&mut self, head: &Head) -> Result<Pose, Refusal> {
        self.pose_at(&head.stamp, head.size)
    }

    /// Same as [`Self::pose`], for a stamp whose item may have no image. The configured image
    /// frame may then be any tracked frame.
    ///
    /// # Errors
    /// Those of [`Self::pose`].
    pub fn pose_of(&mut self, stamp: &Stamp) -> Result<Pose, Refusal> {
        self.pose_at(stamp, [1; 2])
    }

    /// Returns the pose of a frame of this size.
    fn pose_at(&mut self, stamp: &Stamp, size: [u32; 2]) -> Result<Pose, Refusal> {
        self.resolve();
        let item = stamp.item;
        let Some(route) = &self.route else {
            let why = self.search().map_or_else(|none| none.to_string(), |route| route.describe());
            return Err(Refusal::new(item, Reason::NoPath, why));
        };
        let mut way = Way::new(size);
        let (mut projected, mut worst) = (0, 0.0_f64);
        for step in &route.steps {
            let (affine, deviation) = match step.edge {
                Edge::Static(index) => (self.options.statics[index].affine, 0.0),
                Edge::PerFrame(index) => self.held[index].affine(stamp)?,
            };
            if deviation > COUNTED {
                projected += 1;
                worst = worst.max(deviation);
            }
            let smoothed = match (step.edge, &self.smoothed) {
                (Edge::PerFrame(index), Some(smoothed)) => smoothed.at(&self.held[index].names, stamp, &affine),
                _ => None,
            };
            match smoothed {
                None => way.step(if step.inverted { affine.inverse() } else { affine }),
                Some((pose, pixels, smoothed)) => {
                    let pixels = pixels.map(|pixels| pixels.affine());
                    pixels.filter(|_| !step.inverted).into_iter().for_each(|affine| way.step(affine));
                    way.smoothed_step(&pose, step.inverted, smoothed);
                    pixels.filter(|_| step.inverted).into_iter().for_each(|affine| way.step(affine.inverse()));
                }
            }
        }
        if !way.reached.is_finite() {
            let detail = format!("the product of the transforms {} overflows", route.describe());
            return Err(Refusal::new(item, Reason::PoseNotFinite, detail));
        }
        let smoothing = self.smoothed.as_ref().map(|_| way.effect());
        let world_from_image = Transform::from_affine(way.reached);
        Ok(Pose { world_from_image, projected, deviation: worst, smoothing })
    }

    /// Combines an image with its pose.
    ///
    /// # Errors
    /// A [`Refusal`] as in [`Self::pose`], or for a size other than the first slice's. A
    /// refused frame has no effect on later ones.
    pub fn frame(&mut self, picture: Picture) -> Result<Paired, Refusal> {
        let item = picture.head.stamp.item;
        let pose = self.pose(&picture.head)?;
        let size = picture.head.size;
        if let Some(first) = self.size
            && first != size
        {
            let detail = format!("{}×{} pixels after frames of {}×{}", size[0], size[1], first[0], first[1]);
            return Err(Refusal::new(item, Reason::SizeChanged, detail));
        }
        self.size = Some(size);
        let slice =
            Slice { image: picture.image, time_ns: picture.head.time_ns, world_from_image: pose.world_from_image };
        Ok(Paired { slice, pose })
    }

    /// The chain to the world, once known. It is then kept, whatever transforms arrive later.
    pub fn route(&self) -> Option<&Route> {
        self.route.as_ref()
    }

    /// Notes for the user: sentences, each given once.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Checks that a chain to the world was found. Call it when a stream ends without a slice,
    /// or before it begins.
    ///
    /// # Errors
    /// [`NoPath`], with the transforms known and advice.
    pub fn finish(&self) -> Result<(), NoPath> {
        if self.route.is_some() { Ok(()) } else { self.search().map(drop) }
    }

    /// Index of a transform's name in the list; `None` when there are too many.
    fn known(&mut self, from: &str, to: &str) -> Option<usize> {
        let place = self.held.iter().position(|held| held.names.0 == from && held.names.1 == to);
        if place.is_some() {
            return place;
        }
        if self.held.len() == MAX_NAMES {
            let note = format!("more than {MAX_NAMES} transforms: those that came later are not looked at");
            if self.notes.last() != Some(&note) {
                self.notes.push(note);
            }
            return None;
        }
        let [image_from, image_to] = [from, to].map(|name| self.is_image(name));
        if image_from && image_to && from != to {
            self.notes.push(format!(
                "the sequence relates {from} and {to}: its pixels may be those of the latter, while a calibration of {} is applied",
                self.options.image
            ));
        }
        let names = (from.to_owned(), to.to_owned());
        self.held.push(NewestTransform { names, tracker: !(image_from || image_to), newest: None });
        self.names_changed = true;
        Some(self.held.len() - 1)
    }

    fn is_image(&self, name: &str) -> bool {
        is_image_frame(&self.options.image, name)
    }

    fn resolve(&mut self) {
        if self.route.is_some() || !std::mem::replace(&mut self.names_changed, false) {
            return;
        }
        let Ok(route) = self.search() else { return };
        if self.options.world.is_none()
            && let Some(first) = PairingOptions::worlds(&self.names()).first()
            && *first != route.world()
        {
            let note =
                format!("the sequence names {first}, but no way leads there: the volume lives in {}", route.world());
            self.notes.push(note);
        }
        for (index, unused) in self.options.statics.iter().enumerate() {
            let on_the_way = route.steps.iter().any(|step| step.edge == Edge::Static(index));
            if !on_the_way && unused.from == self.options.image && !self.is_image(&unused.to) {
                let note =
                    format!("{} of the configuration is not used: the way is {}", unused.name(), route.describe());
                self.notes.push(note);
            }
        }
        self.route = Some(route);
    }

    fn names(&self) -> Vec<Names> {
        self.held.iter().map(|held| held.names.clone()).collect()
    }

    fn search(&self) -> Result<Route, NoPath> {
        self.options.route(&self.names())
    }
}

impl NewestTransform {
    fn name(&self) -> String {
        transform_name(&self.names.0, &self.names.1)
    }

    /// Returns the transform of a stamp, checked, and its deviation from a rigid one.
    fn affine(&self, stamp: &Stamp) -> Result<(DAffine3, f64), Refusal> {
        let refusal = |reason, detail: String| Refusal::new(stamp.item, reason, format!("{} {detail}", self.name()));
        let transform = match &self.newest {
            Some(transform) if belongs(&transform.stamp, stamp) => transform,
            Some(_) | None => return Err(refusal(Reason::PoseMissing, "was not delivered with this frame".into())),
        };
        if let Status::Other(word) = &transform.status {
            return Err(refusal(Reason::PoseInvalid, format!("has status {word}")));
        }
        let affine = affine_from_rows(&transform.matrix)
            .map_err(|bad| refusal(Reason::from(&bad), format!("cannot be used: {bad}")))?;
        if !self.tracker {
            return Ok((affine, 0.0));
        }
        nearest_rigid(&affine, RIGID_TOLERANCE)
            .map_err(|bad| refusal(Reason::from(&bad), format!("cannot be used: {bad}")))
    }
}

/// Same item and same times. The unfiltered time is ignored.
fn belongs(transform: &Stamp, frame: &Stamp) -> bool {
    transform.item == frame.item && transform.host_ns == frame.host_ns && transform.source_s == frame.source_s
}

#[cfg(test)]
mod tests;

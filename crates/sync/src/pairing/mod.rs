//! Pairing: gives images their poses in the world, by the chain of transforms that leads there.
//!
//! - [`stamped`]: by the transforms of the image's own stamp, as recorded sequences have them.
//! - [`smoothed`]: the effect of smoothing on a pose.
//! - [`timed`]: by poses around the image's time, as devices deliver them; interpolated.

pub mod smoothed;
pub mod stamped;
pub mod timed;

use sonoweave_core::named::StaticTransform;
use sonoweave_core::reading::transform_name;

use crate::graph::{Names, NoPath, Route, WORLDS, find};

/// The names of the frames, and the constant transforms.
#[derive(Debug, Clone, PartialEq)]
pub struct PairingOptions {
    /// Name of the image frame.
    pub image: String,
    /// Name of the world frame, in which the volume is placed. `None`: Reference if a transform
    /// of the source names it, else Tracker, else World; the first of these that can be
    /// reached.
    pub world: Option<String>,
    /// Constant transforms, including the probe calibration.
    pub statics: Vec<StaticTransform>,
}

impl Default for PairingOptions {
    fn default() -> Self {
        Self { image: "Image".into(), world: None, statics: Vec::new() }
    }
}

impl PairingOptions {
    /// Returns the chain from the image to the world for a source with these transforms.
    ///
    /// # Errors
    /// [`NoPath`] when no chain leads there.
    pub(crate) fn route(&self, per_frame: &[Names]) -> Result<Route, NoPath> {
        let statics: Vec<Names> = self.statics.iter().map(|t| (t.from.clone(), t.to.clone())).collect();
        let goals = self.world.as_ref().map_or_else(|| Self::worlds(per_frame), |world| vec![world]);
        goals.iter().find_map(|goal| find(per_frame, &statics, &self.image, goal)).ok_or_else(|| NoPath {
            image: self.image.clone(),
            world: if goals.is_empty() { WORLDS.join(" or ") } else { goals.join(" or ") },
            sequence: per_frame.iter().map(|(from, to)| transform_name(from, to)).collect(),
            configuration: self.statics.iter().map(StaticTransform::name).collect(),
        })
    }

    /// Returns the preferred worlds that a source's transforms name.
    fn worlds(per_frame: &[Names]) -> Vec<&str> {
        let named = |world: &&str| per_frame.iter().any(|(from, to)| from == *world || to == *world);
        WORLDS.into_iter().filter(named).collect()
    }
}

//! Standard errors for plane images of the growing volume, and the voxel that is read out.

use std::time::{Duration, Instant};

use glam::DVec3;

use reconstruct::standard_error::{Edge, Noise, VoxelError};
use reconstruct::{PathReconstructor, StandardErrors};
use render::section::{Box3, Planar, Sampled, Section};
use volume::brick::BrickIndex;
use volume::lattice::Shifted;
use volume::read::SEEN;

use super::brick_subset::{BrickCopy, BrickSubset};
use super::shared_volume::Shared;
use super::status::StatusCollector;

/// Voxels from which the noise is taken while insertion waits: about 1 ms.
const MOST: usize = 1 << 14;
/// Cost of a brick with its errors, as a multiple of that of its values.
const COSTS: usize = 8;
/// Time after which the noise is taken anew.
const AFRESH: Duration = Duration::from_secs(2);

/// A voxel's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readout {
    /// Grey level.
    pub value: f32,
    /// Its error, if the volume keeps it.
    pub error: Option<VoxelError>,
    /// Further slices that halve the error, if these are no more than reach most other voxels:
    /// another sweep gives as many.
    pub halved_by: Option<f64>,
}

/// Properties of the volume that planes show, and its voxel at a place.
pub(super) struct VolumeReadout {
    pub(super) keeps_errors: bool,
    pub(super) weighs_shadows: bool,
    pub(super) voxel: Option<Readout>,
}

/// The errors' copied bricks, and the noise that they depend on.
#[derive(Default)]
pub(super) struct PlaneErrors {
    /// Copies of the planes' bricks whose values are standard errors; empty unless they are shown.
    pub(super) subset: BrickSubset,
    is_shown: bool,
    noise: Option<(Noise, Instant)>,
    pose_mm: f64,
}

impl PlaneErrors {
    /// Reads the error of the poses.
    pub(super) fn pose_mm(&mut self, status: Option<&StatusCollector>) {
        self.pose_mm = status.and_then(|status| status.lock().pose_error_mm()).unwrap_or(self.pose_mm);
    }

    /// Sets whether errors are shown; returns whether that has changed.
    pub(super) fn toggle(&mut self, is_shown: bool) -> bool {
        std::mem::replace(&mut self.is_shown, is_shown) != is_shown
    }

    /// Returns the standard errors of a volume that keeps them, if there is any noise to tell.
    fn of<'a>(&mut self, reconstructor: &'a PathReconstructor) -> Option<StandardErrors<'a>> {
        let general = reconstructor.keeping_errors()?;
        if self.noise.is_none_or(|(_, at)| at.elapsed() > AFRESH) {
            self.noise = StandardErrors::noise_of(general, MOST).map(|noise| (noise, Instant::now()));
        }
        self.noise.map(|(noise, _)| StandardErrors::with_noise(general, noise, self.pose_mm))
    }

    /// Returns the edges at places, world mm; `None` for those that are unseen, and for all if the
    /// volume keeps no errors.
    pub(super) fn edges(&mut self, shared: &Shared, places: &[DVec3]) -> Vec<Option<Edge>> {
        let state = shared.lock();
        let found = state.inserter.reconstructor();
        let Some((errors, found)) = found.and_then(|found| Some((self.of(found)?, found))) else {
            return vec![None; places.len()];
        };
        places.iter().map(|place| errors.edge(voxel_at(found, *place))).collect()
    }

    /// Returns the bricks that are read while insertion waits: fewer with errors, out of `without`.
    pub(super) fn part(&self, without: usize) -> usize {
        if self.is_shown { without / COSTS } else { without }
    }

    /// Copies the errors of bricks, if they are shown. `offset` is that of the canonical lattice.
    pub(super) fn read(&mut self, reconstructor: &PathReconstructor, offset: [i64; 3], bricks: &[BrickIndex]) {
        if !self.is_shown {
            return;
        }
        let Some(errors) = self.of(reconstructor) else { return };
        let errors = Shifted::new(&errors, offset);
        bricks.iter().for_each(|brick| self.subset.put(*brick, BrickCopy::of(&errors, *brick)));
    }

    /// Reads the volume's properties, and the voxel around a place, world mm.
    pub(super) fn readout(&mut self, shared: &Shared, place: DVec3) -> VolumeReadout {
        let state = shared.lock();
        let Some(reconstructor) = state.inserter.reconstructor() else {
            return VolumeReadout { keeps_errors: false, weighs_shadows: false, voxel: None };
        };
        let voxel = voxel_at(reconstructor, place);
        let (r, w) = reconstructor.volume().voxel(voxel);
        let error = if w > SEEN { self.of(reconstructor).and_then(|errors| errors.at(voxel)) } else { None };
        let halved_by = error.and_then(|error| error.halved_by(&self.noise?.0));
        VolumeReadout {
            keeps_errors: reconstructor.keeping_errors().is_some(),
            weighs_shadows: reconstructor.settings().shadow_weights.is_some(),
            voxel: (w > SEEN).then(|| Readout { value: r / w, error, halved_by }),
        }
    }

    /// Samples the errors in a plane; empty unless they are shown.
    pub(super) fn sample(&self, section: &Section, place: Box3) -> Vec<Sampled> {
        if !self.is_shown {
            return Vec::new();
        }
        Planar { volume: &self.subset, place, team: None }.sample(section).0
    }

    /// Samples some pixels of them again; returns whether one has changed.
    pub(super) fn sample_again(
        &self,
        section: &Section,
        place: Box3,
        pixels: [[u32; 2]; 2],
        errors: &mut [Sampled],
    ) -> bool {
        let planar = Planar { volume: &self.subset, place, team: None };
        !errors.is_empty() && planar.sample_again(section, pixels, errors)
    }
}

/// Returns the voxel around a place, world mm.
fn voxel_at(reconstructor: &PathReconstructor, place: DVec3) -> [i64; 3] {
    let lattice = reconstructor.world_from_lattice().affine().inverse().transform_point3(place);
    lattice.round().to_array().map(|x| x as i64)
}

//! Brick viewer: bricks of the growing volume for viewers that draw it themselves, in a thread of
//! its own.
//!
//! Insertion waits only while bricks are read, a few at a time. A brick is read when a viewer has
//! room for it, as it is then. Without a viewer, nothing is noted or read.

use std::time::Duration;

use render::Crop;
use render::crop::{Cropped, LatticeCrop};
use volume::brick::BrickIndex;
use volume::lattice::Shifted;
use volume::read::Values as _;

use super::brick_subset::BrickCopy;
use super::changes::Changes;
use super::shared_volume::{Shared, SharedVolume};

/// Interval at which the thread checks for a viewer.
const IDLE: Duration = Duration::from_millis(50);
/// Interval at which changes are passed on, and viewers with room are served.
const TURN: Duration = Duration::from_millis(10);

/// Viewers that draw the volume from its bricks. Bricks are named by lattice index divided by 8,
/// on the canonical lattice.
pub trait BrickViewer: Send + Sync {
    /// Returns whether any viewer draws the volume.
    fn is_watched(&self) -> bool;

    /// Returns the parts of the volume that are hidden: their voxels are read as unseen.
    fn crop(&self) -> Crop;

    /// Receives the bricks that have changed, each at least once; or, if any may have changed,
    /// `all` of the volume's.
    fn changed(&self, bricks: &[BrickIndex], all: bool);

    /// Asks for bricks by `read`, for those viewers that have room. Insertion waits during each of
    /// its calls. Bricks that the volume does not have are unseen.
    fn serve(&self, read: &mut dyn FnMut(&[BrickIndex]) -> Vec<Box<BrickCopy>>);
}

/// Serves viewers until no slice follows, and a last time then.
pub(super) fn run(shared: &Shared, viewer: &dyn BrickViewer) {
    let mut crop = Crop::default();
    loop {
        if viewer.is_watched() {
            if turn(shared, viewer, &mut crop) {
                return;
            }
            shared.rest(TURN);
            continue;
        }
        let mut volume = shared.lock();
        volume.pending.for_bricks = None;
        let ended = volume.ended;
        drop(volume);
        if ended {
            return;
        }
        shared.rest(IDLE);
    }
}

/// Passes changes on, and serves viewers; returns whether no slice follows.
fn turn(shared: &Shared, viewer: &dyn BrickViewer, crop: &mut Crop) -> bool {
    let hidden = viewer.crop();
    let is_cropped = std::mem::replace(crop, hidden) != *crop;
    let mut volume = shared.lock();
    let SharedVolume { inserter, pending, ended, .. } = &mut *volume;
    let changes = pending.for_bricks.replace(Changes::default()).unwrap_or_else(Changes::unknown);
    let (first, ended) = (pending.first, *ended);
    let all = changes.all || is_cropped;
    let bricks = match (inserter.reconstructor(), first) {
        (Some(reconstructor), Some(first)) if all => {
            Shifted::new(reconstructor.volume(), first.lattice.offset).bricks().collect()
        }
        _ => changes.bricks,
    };
    drop(volume);
    if all || !bricks.is_empty() {
        viewer.changed(&bricks, all);
    }
    let shapes = first.map(|first| LatticeCrop::new(crop.present(), first.lattice.world_from_lattice.affine()));
    viewer.serve(&mut |bricks| {
        let volume = shared.lock();
        match (volume.inserter.reconstructor(), volume.pending.first, &shapes) {
            (Some(reconstructor), Some(first), Some(shapes)) => {
                let volume = Shifted::new(reconstructor.volume(), first.lattice.offset);
                let volume = Cropped::new(&volume, shapes);
                bricks.iter().map(|brick| BrickCopy::of(&volume, *brick)).collect()
            }
            _ => bricks.iter().map(|_| BrickCopy::unseen()).collect(),
        }
    });
    ended
}

//! When a slice leaves the plane: the general path takes over what there is.

use super::PlanarReconstructor;
use crate::reconstruct::{Reconstructor, Refused};
use crate::volume::brick::{Brick, EDGE, offset};
use crate::volume::{BrickVolume, Voxels};

impl PlanarReconstructor {
    /// A general reconstructor on the same lattice with all that this one holds: numerator and weight of every voxel as they are read here, and the work
    /// done. Columns and bricks are both in memory until this one is dropped.
    ///
    /// # Errors
    /// [`Refused::Memory`] when bricks, of twice the bytes, go beyond the limit.
    pub fn upgraded(&self) -> Result<Reconstructor, Refused> {
        let mut bricks = BrickVolume::new();
        let count = self.volume.blocks().count();
        let (bytes, limit_bytes) = ((count * size_of::<Brick>()) as u64, self.settings.memory_bytes);
        if bytes > limit_bytes {
            return Err(Refused::memory(bytes - limit_bytes, limit_bytes));
        }
        if bricks.reserve(count).is_err() {
            return Err(Refused::memory(bytes, self.volume.bytes()));
        }
        let (mut r, mut w) = ([0.0; EDGE], [0.0; EDGE]);
        for index in self.volume.blocks() {
            let (slot, _) = bricks.find_or_insert(index);
            let first = index.map(|i| i64::from(i) * EDGE as i64);
            for (y, z) in (0..EDGE * EDGE).map(|i| (i % EDGE, i / EDGE)) {
                self.volume.row([first[0], first[1] + y as i64, first[2] + z as i64], &mut r, &mut w);
                let brick = bricks.brick_mut(slot);
                for x in 0..EDGE {
                    let place = offset(x, y, z);
                    (brick.r[place], brick.w[place]) = (r[x], w[x]);
                }
            }
        }
        let last = self.last.clone();
        Ok(Reconstructor::taking_over(self.settings.clone(), self.mask.clone(), bricks, last, self.work)?)
    }
}

//! Upgrade when a slice leaves the plane: the general path takes over the volume.

use volume::brick::{EDGE, VOXELS, offset};
use volume::brick_volume::Slot;
use volume::memory::Epoch;
use volume::{BrickVolume, Voxels};

use super::PlanarReconstructor;
use crate::compounding::Entry;
use crate::decay::Fading;
use crate::{Reconstructor, Refused};

impl PlanarReconstructor {
    /// Returns a general reconstructor on the same lattice with the content of this one. The
    /// content is the numerator and weight of every voxel, and the work done; with decay, also
    /// the age of each voxel. Columns and bricks are both in memory until this one is dropped.
    ///
    /// # Errors
    /// [`Refused::Memory`] when the bricks, which take twice the bytes, exceed the limit.
    pub fn upgraded(&self) -> Result<Reconstructor, Refused> {
        let entry = self.settings.entry()?;
        let mut bricks = BrickVolume::remembering(entry.memory());
        let count = self.volume.blocks().count();
        let (bytes, limit_bytes) = (count as u64 * bricks.brick_bytes(), self.settings.memory_bytes);
        if bytes > limit_bytes {
            return Err(Refused::memory(bytes - limit_bytes, limit_bytes));
        }
        if bricks.reserve(count).is_err() {
            return Err(Refused::memory(bytes, self.volume.bytes()));
        }
        let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
        for index in self.volume.blocks() {
            let (slot, _) = bricks.find_or_insert(index);
            self.volume.block(index, &mut r, &mut w);
            let brick = bricks.brick_mut(slot);
            for at in 0..VOXELS {
                let place = offset(at % EDGE, at / EDGE % EDGE, at / (EDGE * EDGE));
                (brick.r[place], brick.w[place]) = (r[at], w[at]);
            }
            if let Entry::Decay(fading) = entry {
                self.date(&mut bricks, slot, [index[0], index[1]].map(|i| i64::from(i) * EDGE as i64), &fading);
            }
        }
        let (settings, mask, admission) = (self.settings.clone(), self.mask.clone(), self.admission.clone());
        Ok(Reconstructor::taking_over(settings, mask, bricks, admission, self.clock, (self.work, self.normals))?)
    }

    /// Gives a brick, whose first column is `first`, the times of its columns.
    fn date(&self, bricks: &mut BrickVolume, slot: Slot, first: [i64; 2], fading: &Fading) {
        let now_ns = self.clock.elapsed_ns();
        bricks.set_epoch(slot, Epoch::at(now_ns));
        for (x, y) in (0..EDGE * EDGE).map(|i| (i % EDGE, i / EDGE)) {
            let Some(written_ns) = self.volume.written_ns(first[0] + x as i64, first[1] + y as i64) else { continue };
            let places = (0..EDGE).map(|z| offset(x, y, z));
            if fading.keeps_ages() {
                let (epoch, age) = fading.dated(written_ns, now_ns);
                bricks.set_epoch(slot, epoch);
                let ages = bricks.ages_mut(slot);
                places.for_each(|place| ages.0[place] = age);
            } else {
                let brick = bricks.brick_mut(slot);
                for place in places {
                    if brick.w[place] > 0.0 {
                        let left = fading.left(written_ns, now_ns, brick.w[place]);
                        (brick.r[place], brick.w[place]) = (brick.r[place] * left, brick.w[place] * left);
                    }
                }
            }
        }
    }
}

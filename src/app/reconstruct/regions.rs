//! Reconstruction in regions: a volume that is larger than memory, as OME-Zarr.

use pipeline::regions::{RegionGrid, SweepPlan};
use reconstruct::Work;
use statistics::{RegionNumbers, Statistics, WorkNumbers};
use volume::Voxels;
use volume::brick::{BrickBox, EDGE};

use super::outputs::{Reconstructed, Request, Written};
use super::zarr::{Description, Target};
use crate::app::reporter::Steps;
use crate::failure::Failure;

impl Request {
    /// Checks that the requested files can be written region by region.
    ///
    /// # Errors
    /// [`Failure`] with the first that cannot.
    pub(crate) fn check_regions(&self) -> Result<(), Failure> {
        let options = self.options();
        if options.ome_zarr().is_none() {
            return Err(Failure(
                "--out-of-core: writes OME-Zarr only; give -o NAME.ome.zarr, and `sonoweave convert` makes other \
                 formats of it"
                    .into(),
            ));
        }
        let beside = &options.beside;
        let given = [
            ("--weights", beside.weights.is_some()),
            ("--planes", beside.planes.is_some()),
            ("--fill", options.filling.is_some()),
        ];
        if let Some((flag, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
            fail!("{flag}: needs the whole volume in memory; leave it out with --out-of-core");
        }
        if options.size.is_some() && !options.has_origin {
            return Err(Failure(
                "--size: begins at the lowest voxel seen, which is known at the end only; give --origin, too, with \
                 --out-of-core"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Reconstructs a planned sweep region by region, writes the volume, and returns the report.
    /// Regions that an interrupted run has written are kept.
    ///
    /// # Errors
    /// [`Failure`]: an earlier volume is unchanged, and finished regions are kept for another run.
    pub(crate) fn finish_in_regions(&self, mut plan: SweepPlan, steps: Steps<'_>) -> Result<Reconstructed, Failure> {
        let options = self.options();
        let Some(path) = options.ome_zarr() else { return self.check_regions().and(Err(nothing())) };
        plan.outcome.notes.extend(options.note.clone());
        let encoding = options.encoding(plan.outcome.pixels)?;
        let bounds = match (options.size, plan.outcome.reached) {
            (Some(size), _) => [[0; 3], size.map(|n| n as i64 - 1)],
            (None, Some(reached)) => reached,
            (None, None) => return Err(nothing()),
        };
        let hash = self.origin.hash(&plan.outcome)?;
        let description = Description::of(&plan.outcome, bounds, encoding, options.size.is_some());
        let space = description.space();
        let fields = self.provenance(&plan.outcome, &space, &encoding, &hash)?;

        let settings = plan.outcome.reconstructor.settings();
        let within = bricks_of(bounds);
        let met = plan.slices.iter().map(|slice| slice.entered.bricks.within(&within));
        let met: Vec<BrickBox> = met.filter(|bricks| !bricks.is_empty()).collect();
        let shard_bricks = (description.extent().shard / EDGE as u64) as i32;
        let grid = RegionGrid::new(&met, shard_bricks, settings.brick_bytes()?, settings.memory_bytes)?;
        let (target, _) = Target::create(path, &description, &fields)?;
        let regions: Vec<BrickBox> = grid.regions(&met).collect();
        let step = steps("reconstructing regions", regions.len() as u64);
        let mut numbers = RegionNumbers { count: regions.len() as u64, kept: 0, meetings: grid.meetings() };
        let (mut work, mut bricks, mut bytes) = (Work::default(), 0, 0);
        for (done, region) in (1..).zip(&regions) {
            if target.has(region) {
                numbers.kept += 1;
            } else {
                let reconstructor = plan.reconstruct(region)?;
                let volume = reconstructor.volume();
                target.write(volume, Some(region))?;
                work += reconstructor.work();
                bricks += volume.len() as u64;
                bytes = volume.bytes().max(bytes);
            }
            step(done);
        }
        drop(step);
        target.finish()?;

        let mut outcome = plan.outcome;
        outcome.voxels_updated = work.voxels_updated;
        // Times of planning.
        outcome.insert_ms.clear();
        let mut statistics = Statistics::new(&outcome, &space, Some(encoding.scalar.name()), self.began.elapsed());
        (statistics.bricks, statistics.bytes, statistics.w_clamped) = (bricks, bytes, work.weights_clamped);
        (statistics.work, statistics.regions) = (WorkNumbers::of(&work), Some(numbers));
        let document = self.document(&statistics, &hash, None::<&()>)?;
        Ok(Reconstructed { outcome, written: Written { statistics, document, filled: None } })
    }
}

/// Returns the failure of a volume without any voxel.
fn nothing() -> Failure {
    Failure("no slice reaches a voxel; check the poses' unit and --spacing".into())
}

/// Returns the bricks that hold voxels of a box.
fn bricks_of(bounds: [[i64; 3]; 2]) -> BrickBox {
    let [low, high] = bounds.map(|corner| corner.map(|voxel| voxel.div_euclid(EDGE as i64) as i32));
    BrickBox { low, high }
}

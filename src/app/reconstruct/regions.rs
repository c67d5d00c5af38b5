//! Reconstruction in regions: a volume that is larger than memory, as OME-Zarr.

pub(crate) mod plan;
pub(crate) mod processes;

use ome_zarr::OmeZarrWriter;
use pipeline::Outcome;
use pipeline::regions::{RegionGrid, SweepPlan};
use statistics::{RegionWork, Statistics};
use volume::brick::{BrickBox, EDGE};

use super::outputs::{Reconstructed, Request, Written};
use super::zarr::Description;
use crate::app::reporter::Steps;
use crate::failure::{Failure, FailureKind};
use plan::RegionsPlan;

impl Request {
    /// Checks that the requested files can be written region by region.
    ///
    /// # Errors
    /// [`Failure`] with the first that cannot.
    pub(crate) fn check_regions(&self) -> Result<(), Failure> {
        let options = self.options();
        if options.ome_zarr().is_none() {
            return Err(Failure::usage(
                "--out-of-core: writes OME-Zarr only; give -o NAME.ome.zarr, and `sonoweave convert` makes other \
                 formats of it",
            ));
        }
        let beside = &options.beside;
        let given = [
            ("--weights", beside.weights.is_some()),
            ("--error", beside.errors.is_some()),
            ("--planes", beside.planes.is_some()),
            ("--first-moment", options.first_moment),
            ("--fill", options.filling.is_some()),
        ];
        if let Some((flag, _)) = given.into_iter().find(|(_, is_given)| *is_given) {
            fail_usage!("{flag}: needs the whole volume in memory; leave it out with --out-of-core");
        }
        if options.size.is_some() && !options.has_origin {
            return Err(Failure::usage(
                "--size: begins at the lowest voxel seen, which is known at the end only; give --origin, too, with \
                 --out-of-core",
            ));
        }
        Ok(())
    }

    /// Reconstructs a planned sweep region by region, writes the volume, and returns the report.
    /// Regions that an interrupted run has written are kept.
    ///
    /// # Errors
    /// [`Failure`]: an earlier volume is unchanged, and finished regions are kept for another run.
    pub(crate) fn finish_in_regions(
        &self,
        (sweep, mut outcome): (SweepPlan, Outcome),
        steps: Steps<'_>,
    ) -> Result<Reconstructed, Failure> {
        let plan = self.plan_regions(sweep, &mut outcome)?;
        let target = plan.target()?;
        let (writer, _) = OmeZarrWriter::create(plan.path(), &plan.described.meta)?;
        let step = steps("reconstructing regions", plan.regions.len() as u64);
        let (mut numbers, mut work) = (plan.numbers(), RegionWork::default());
        for (done, region) in (1..).zip(&plan.regions) {
            match plan.reconstruct(&target, writer.shards(), region)? {
                Some(added) => work.add(&added),
                None => numbers.kept += 1,
            }
            step(done);
        }
        drop(step);
        target.finish(writer)?;
        let mut statistics = self.planned_statistics(&plan, &outcome);
        statistics.enter_regions(numbers, work);
        let document = self.document(&statistics, &plan.sha256, None::<&()>)?;
        Ok(Reconstructed { outcome, written: Written { statistics, document, filled: None } })
    }

    /// Divides a planned sweep's volume into regions.
    ///
    /// # Errors
    /// [`Failure`] when no slice reaches a voxel, or a region does not fit into memory.
    pub(super) fn plan_regions(&self, sweep: SweepPlan, outcome: &mut Outcome) -> Result<RegionsPlan, Failure> {
        self.check_regions()?;
        let options = self.options();
        let Some(path) = options.ome_zarr() else { return Err(nothing()) };
        outcome.notes.extend(options.note.clone());
        // Times of planning.
        outcome.insert_ms.clear();
        let encoding = options.encoding(outcome.pixels)?;
        let bounds = match (options.size, outcome.reached) {
            (Some(size), _) => [[0; 3], size.map(|n| n as i64 - 1)],
            (None, Some(reached)) => reached,
            (None, None) => return Err(nothing()),
        };
        let sha256 = self.origin.hash(outcome)?;
        let description = Description::of(outcome, bounds, encoding, options.size.is_some()).with_label(options.label);
        let space = description.space();
        let fields = self.provenance(outcome, &space, &encoding, &sha256)?;
        let described = description.described(fields, self.origin.data_hash()?.as_deref());

        let within = bricks_of(bounds);
        let met = sweep.slices.iter().map(|slice| slice.entered.bricks.within(&within));
        let met: Vec<BrickBox> = met.filter(|bricks| !bricks.is_empty()).collect();
        let shard_bricks = (described.meta.extent.shard / EDGE as u64) as i32;
        let settings = &sweep.settings;
        let grid = RegionGrid::new(&met, shard_bricks, settings.brick_bytes()?, settings.memory_bytes)?;
        let regions = grid.regions(&met).collect();
        let (path, meetings) = (path.to_owned(), grid.meetings());
        Ok(RegionsPlan::new(path, sha256, described, regions, meetings, sweep))
    }

    /// Returns the numbers of a planned reconstruction, without those of its regions.
    pub(super) fn planned_statistics(&self, plan: &RegionsPlan, outcome: &Outcome) -> Statistics {
        let space = plan.described.space(outcome);
        Statistics::new(outcome, &space, Some(plan.described.encoding.scalar.name()), self.began.elapsed())
    }
}

/// Returns the failure of a volume without any voxel.
fn nothing() -> Failure {
    Failure::new("no slice reaches a voxel; check the poses' unit and --spacing").of(FailureKind::NoFrame)
}

/// Returns the bricks that hold voxels of a box.
fn bricks_of(bounds: [[i64; 3]; 2]) -> BrickBox {
    let [low, high] = bounds.map(|corner| corner.map(|voxel| voxel.div_euclid(EDGE as i64) as i32));
    BrickBox { low, high }
}

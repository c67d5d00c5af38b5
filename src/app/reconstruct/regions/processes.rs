//! A volume that several processes reconstruct, each some of its regions: in turn or at once, on
//! one machine or on several that share the folder.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use ome_zarr::{OmeZarrWriter, RegionWriter, Verified};
use statistics::{RegionWork, WorkNumbers};
use volume::brick::BrickBox;

use super::plan::RegionsPlan;
use crate::app::part::Part;
use crate::app::reconstruct::outputs::Request;
use crate::app::reconstruct::sweep::Sweep;
use crate::app::reconstruct::zarr::Target;
use crate::app::reporter::Steps;
use crate::failure::Failure;

/// Choice of regions.
#[derive(Debug, Clone)]
pub(crate) enum Choice {
    /// These, by their numbers from 0.
    Only(Vec<usize>),
    /// One of parts of about equal work.
    Part(Part),
}

/// State of the regions of a volume.
#[derive(Debug, Serialize)]
pub(crate) struct RegionsStatus {
    /// Regions that are written.
    pub(crate) done: usize,
    /// All regions, by their numbers.
    pub(crate) regions: Vec<RegionStatus>,
}

/// State of a region.
#[derive(Debug, Serialize)]
pub(crate) struct RegionStatus {
    /// Lowest and highest voxel of the lattice, both inclusive.
    pub(crate) voxels: [[i64; 3]; 2],
    /// Slices that meet it.
    pub(crate) slices: usize,
    /// Whether it is written.
    pub(crate) done: bool,
}

/// Plans a volume in regions, and begins it. Finished regions of an earlier plan of the same
/// volume are kept.
///
/// # Errors
/// [`Failure`] when no frame can be used, or the volume cannot be written region by region.
pub(crate) fn plan(request: &Request, sweep: Sweep, steps: Steps<'_>) -> Result<RegionsPlan, Failure> {
    request.check_regions()?;
    let (sweep, mut outcome) = sweep.plan(steps)?;
    let mut plan = request.plan_regions(sweep, &mut outcome)?;
    let statistics = request.planned_statistics(&plan, &outcome);
    plan.report = serde_json::from_str(&request.document(&statistics, &plan.sha256, None::<&()>)?)?;
    let (_writer, _) = OmeZarrWriter::create(plan.path(), &plan.described.meta)?;
    plan.write()?;
    Ok(plan)
}

/// Reconstructs and writes chosen regions of a planned volume, and returns how many were written
/// and how many were written already.
///
/// # Errors
/// [`Failure`] when the plan or the recording cannot be used, there is no such region, or a file
/// cannot be written. Regions that are written stay.
pub(crate) fn run(path: &Path, choice: &Choice, threads: usize, steps: Steps<'_>) -> Result<[usize; 2], Failure> {
    let plan = RegionsPlan::read(path, threads)?;
    plan.check_recording()?;
    let numbers = choose(&plan, choice)?;
    let target = plan.target()?;
    let mut writer = RegionWriter::join(path, &plan.described.meta)?;
    let step = steps("reconstructing regions", numbers.len() as u64);
    let mut written = 0;
    for (done, region) in (1..).zip(numbers.iter().map(|number| &plan.regions[*number])) {
        if let Some(work) = plan.reconstruct(&target, writer.shards(), region)? {
            writer.finish(&name(region), &serde_json::to_string(&work)?)?;
            written += 1;
        }
        step(done);
    }
    Ok([written, numbers.len() - written])
}

/// Returns the state of the regions of a planned volume.
///
/// # Errors
/// [`Failure`] when the plan cannot be used, or the volume is being finished.
pub(crate) fn status(path: &Path) -> Result<RegionsStatus, Failure> {
    let plan = RegionsPlan::read(path, 1)?;
    let (target, writer) = (plan.target()?, RegionWriter::join(path, &plan.described.meta)?);
    let regions = plan.regions.iter().zip(plan.slices()).map(|(region, slices)| RegionStatus {
        voxels: region.voxels(),
        slices,
        done: target.has(writer.shards(), region),
    });
    let regions: Vec<RegionStatus> = regions.collect();
    Ok(RegionsStatus { done: regions.iter().filter(|region| region.done).count(), regions })
}

/// Result of a comparison of a volume's files with their hashes.
#[derive(Debug, Serialize)]
pub(crate) struct RegionsVerified {
    /// Shards whose file has its hash.
    pub(crate) whole: usize,
    /// Files of damaged shards.
    pub(crate) damaged: Vec<String>,
    /// Numbers of the regions that are not written.
    pub(crate) missing: Vec<usize>,
    /// Numbers of the regions with a damaged shard.
    pub(crate) regions: Vec<usize>,
}

/// Compares the files of a planned volume with their hashes. With `is_repaired`, damaged ones are
/// deleted, so that their regions are not written any more.
///
/// # Errors
/// [`Failure`] when the plan cannot be used, the volume is being finished, or a file cannot be read
/// or deleted.
pub(crate) fn verify(path: &Path, threads: usize, is_repaired: bool) -> Result<RegionsVerified, Failure> {
    let plan = RegionsPlan::read(path, threads)?;
    let (target, writer) = (plan.target()?, RegionWriter::join(path, &plan.described.meta)?);
    let before = plan.missing(&target, &writer);
    let Verified { whole, damaged } = writer.verify()?;
    let mut regions = Vec::new();
    if is_repaired {
        writer.remove(&damaged)?;
        regions = plan.missing(&target, &writer);
        regions.retain(|number| !before.contains(number));
    }
    Ok(RegionsVerified { whole, damaged, missing: before, regions })
}

/// Writes the pyramid of a volume whose regions are all written, gives it its name, and returns
/// its report.
///
/// # Errors
/// [`Failure`] when a region is missing or being written, or a file cannot be written. An earlier
/// volume is unchanged.
pub(crate) fn finish(path: &Path, threads: usize) -> Result<Value, Failure> {
    let plan = RegionsPlan::read(path, threads)?;
    let (target, writer) = (plan.target()?, RegionWriter::join(path, &plan.described.meta)?);
    let missing = plan.missing(&target, &writer);
    if let Some(first) = missing.first() {
        fail!(
            "{}: {} of {} regions are missing, such as number {}; reconstruct them by `sonoweave regions run`",
            path.display(),
            missing.len(),
            plan.regions.len(),
            first,
        );
    }
    drop(writer);
    let (writer, _) = OmeZarrWriter::create(path, &plan.described.meta)?;
    let report = plan.report(&writer.notes()?)?;
    target.finish(writer)?;
    Ok(report)
}

/// Returns the chosen regions' numbers. Parts have about equal numbers of slices: regions are
/// dealt in the order of theirs.
fn choose(plan: &RegionsPlan, choice: &Choice) -> Result<Vec<usize>, Failure> {
    match choice {
        Choice::Only(numbers) => match numbers.iter().find(|number| **number >= plan.regions.len()) {
            Some(number) => Err(Failure::new(format!(
                "--only {number}: there are {} regions; give numbers from 0 to {}",
                plan.regions.len(),
                plan.regions.len().saturating_sub(1)
            ))),
            None => Ok(numbers.clone()),
        },
        Choice::Part(Part { number, of }) => {
            let slices = plan.slices();
            let mut order: Vec<usize> = (0..plan.regions.len()).collect();
            order.sort_by_key(|number| std::cmp::Reverse(slices[*number]));
            let dealt = (1..=*of).cycle().zip(order).filter(|(part, _)| part == number).map(|(_, region)| region);
            Ok(dealt.collect())
        }
    }
}

/// Returns the name of a region's log. Plans that divide the volume otherwise have other names.
fn name(BrickBox { low, high }: &BrickBox) -> String {
    let corner = |corner: &[i32; 3]| corner.map(|at| at.to_string()).join(",");
    format!("{}_{}", corner(low), corner(high))
}

impl RegionsPlan {
    /// Returns the numbers of the regions that are not written.
    fn missing(&self, target: &Target<'_>, writer: &RegionWriter) -> Vec<usize> {
        (0..self.regions.len()).filter(|number| !target.has(writer.shards(), &self.regions[*number])).collect()
    }

    /// Returns the report of the finished volume: that of the plan, with the work of the regions.
    fn report(&self, notes: &BTreeMap<String, String>) -> Result<Value, Failure> {
        let (mut numbers, mut sum) = (self.numbers(), RegionWork::default());
        for region in &self.regions {
            match notes.get(&name(region)) {
                Some(note) => sum.add(&serde_json::from_str(note)?),
                // Written by one process for the whole, which keeps no account of each.
                None => numbers.kept += 1,
            }
        }
        let RegionWork { voxels_updated, w_clamped, bricks, bytes, work } = sum;
        let mut report = self.report.clone();
        if let Value::Object(report) = &mut report {
            for (name, count) in
                [("voxels_updated", voxels_updated), ("w_clamped", w_clamped), ("bricks", bricks), ("bytes", bytes)]
            {
                report.insert(name.into(), count.into());
            }
            report.insert("work".into(), serde_json::to_value::<WorkNumbers>(work)?);
            report.insert("regions".into(), serde_json::to_value(numbers)?);
            // The time of the command that planned.
            report.remove("wall_s");
        }
        Ok(report)
    }
}

//! Counters of work: of a reconstruction, and of its regions.

use serde::{Deserialize, Serialize};

use reconstruct::{Reconstructor, Work};
use volume::Voxels;

/// Work counters, which show the work that was skipped.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WorkNumbers {
    /// Pixels read by the in-plane filter.
    pub pixels_filtered: u64,
    /// Nodes that it computed.
    pub nodes: u64,
    /// Products that it summed.
    pub taps: u64,
    /// Bricks that intervals could not exclude, summed over slices.
    pub bricks_considered: u64,
    /// Columns that intervals could not exclude, summed over slices, on the planar path.
    pub columns_considered: u64,
    /// Columns that changed, summed over slices, on the planar path.
    pub columns_touched: u64,
    /// Bricks that changed, summed over slices.
    pub bricks_touched: u64,
    /// Voxels sampled, in whole vectors.
    pub voxels_sampled: u64,
}

impl WorkNumbers {
    /// Returns the numbers of the work done.
    pub fn of(work: &Work) -> Self {
        Self {
            pixels_filtered: work.filter.pixels,
            nodes: work.filter.nodes,
            taps: work.filter.taps,
            bricks_considered: work.bricks_considered,
            columns_considered: work.columns_considered,
            columns_touched: work.columns_touched,
            bricks_touched: work.bricks_touched,
            voxels_sampled: work.voxels_sampled,
        }
    }

    /// Adds other numbers.
    fn add(&mut self, other: &Self) {
        self.pixels_filtered += other.pixels_filtered;
        self.nodes += other.nodes;
        self.taps += other.taps;
        self.bricks_considered += other.bricks_considered;
        self.columns_considered += other.columns_considered;
        self.columns_touched += other.columns_touched;
        self.bricks_touched += other.bricks_touched;
        self.voxels_sampled += other.voxels_sampled;
    }
}

/// Reconstruction in regions, each by itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegionNumbers {
    /// Regions that slices meet.
    pub count: u64,
    /// Those of them that an interrupted run had finished.
    pub kept: u64,
    /// Regions that each slice meets, summed over slices: how often a slice was read and filtered.
    pub meetings: u64,
}

/// Work of regions, each in a reconstructor of its own.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RegionWork {
    /// Voxels that gained weight, summed over slices.
    pub voxels_updated: u64,
    /// Voxels whose weight was clamped, summed over slices.
    pub w_clamped: u64,
    /// Stored blocks of 8³ voxels.
    pub bricks: u64,
    /// Memory of the largest region, bytes.
    pub bytes: u64,
    /// Work counters.
    pub work: WorkNumbers,
}

impl RegionWork {
    /// Returns the work of one region.
    pub fn of(region: &Reconstructor) -> Self {
        let (work, volume) = (region.work(), region.volume());
        Self {
            voxels_updated: work.voxels_updated,
            w_clamped: work.weights_clamped,
            bricks: volume.len() as u64,
            bytes: volume.bytes(),
            work: WorkNumbers::of(&work),
        }
    }

    /// Adds another region's work.
    pub fn add(&mut self, other: &Self) {
        self.voxels_updated += other.voxels_updated;
        self.w_clamped += other.w_clamped;
        self.bricks += other.bricks;
        self.bytes = self.bytes.max(other.bytes);
        self.work.add(&other.work);
    }
}

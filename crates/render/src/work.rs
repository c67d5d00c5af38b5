//! Counters of the work done, which show that only changed parts were rendered, and of memory. The
//! statistics contain them unchanged.

use serde::Serialize;

/// Work of one update, or summed over many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RenderWork {
    /// Bricks read because a slice touched them.
    pub bricks_read: u64,
    /// Bricks that a thread had to make when it needed them, as none was ready: it waited for fresh
    /// memory. The first updates find none ready. A picture in parts counts none.
    pub bricks_unprepared: u64,
    /// Bricks read in which a value or a weight had changed.
    pub bricks_changed: u64,
    /// Voxels classified and lit.
    pub voxels_shaded: u64,
    /// Pixels tested for samples that a change may have reached: those in its outline, counted
    /// once per box if boxes were tested.
    pub pixels_met: u64,
    /// Samples that a change may have reached.
    pub samples_marked: u64,
    /// Rays with at least one sample taken or composited again.
    pub rays: u64,
    /// Samples interpolated.
    pub samples: u64,
    /// Samples skipped because their brick has nothing visible.
    pub samples_skipped: u64,
    /// Kept blocks that had to be composited again from their samples.
    pub blocks_resolved: u64,
    /// Blocks composited into pixels.
    pub blocks_folded: u64,
    /// Pixels whose value differs in any bit from before.
    pub pixels_changed: u64,
    /// Pixels interpolated between rays.
    pub pixels_interpolated: u64,
    /// Regions of adaptive rays that were evaluated.
    pub regions: u64,
    /// Evaluated regions that were split.
    pub regions_split: u64,
    /// Evaluated regions that were split because something small may lie in them.
    pub regions_small: u64,
    /// Coarse rays of a new view; they light their samples themselves.
    pub coarse_rays: u64,
}

impl std::ops::AddAssign for RenderWork {
    fn add_assign(&mut self, other: Self) {
        self.bricks_read += other.bricks_read;
        self.bricks_unprepared += other.bricks_unprepared;
        self.bricks_changed += other.bricks_changed;
        self.voxels_shaded += other.voxels_shaded;
        self.pixels_met += other.pixels_met;
        self.samples_marked += other.samples_marked;
        self.rays += other.rays;
        self.samples += other.samples;
        self.samples_skipped += other.samples_skipped;
        self.blocks_resolved += other.blocks_resolved;
        self.blocks_folded += other.blocks_folded;
        self.pixels_changed += other.pixels_changed;
        self.pixels_interpolated += other.pixels_interpolated;
        self.regions += other.regions;
        self.regions_split += other.regions_split;
        self.regions_small += other.regions_small;
        self.coarse_rays += other.coarse_rays;
    }
}

/// Memory in use, bytes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RenderMemory {
    /// Values, weights and shaded voxels.
    pub voxels: u64,
    /// Rays and their caches.
    pub rays: u64,
}

//! What was done, counted: the proof that nothing else was. Statistics hold it as it is.

use serde::Serialize;

/// Work of one update, or summed over many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RenderWork {
    /// Bricks that were looked at because a slice touched them.
    pub bricks_read: u64,
    /// Of those, the bricks in which a value or a weight had changed.
    pub bricks_changed: u64,
    /// Voxels classified and lit.
    pub voxels_shaded: u64,
    /// Pixels for which it was found out which of their samples a change may have reached: those in its outline, once for each box where boxes were asked.
    pub pixels_met: u64,
    /// Samples that it may have reached.
    pub samples_marked: u64,
    /// Rays of which anything was sampled or composited.
    pub rays: u64,
    /// Samples interpolated.
    pub samples: u64,
    /// Samples passed over because nothing of their brick can be seen.
    pub samples_skipped: u64,
    /// Blocks that were kept and had to be folded again of their samples.
    pub blocks_resolved: u64,
    /// Blocks that were folded into pixels.
    pub blocks_folded: u64,
    /// Pixels whose value is other bits than before.
    pub pixels_changed: u64,
    /// Pixels that were drawn between rays.
    pub pixels_interpolated: u64,
    /// Regions of adaptive rays that were looked at.
    pub regions: u64,
    /// Of those, the regions that were split.
    pub regions_split: u64,
    /// Of those, the regions that were split because something small may lie in them.
    pub regions_small: u64,
    /// Coarse rays, which light their samples themselves, of a new view.
    pub coarse_rays: u64,
}

impl std::ops::AddAssign for RenderWork {
    fn add_assign(&mut self, other: Self) {
        self.bricks_read += other.bricks_read;
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

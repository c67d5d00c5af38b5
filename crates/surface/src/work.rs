//! Counters of the work done, which show that only changed parts were meshed.

use serde::Serialize;

/// Work of one update, or summed over many.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct SurfaceWork {
    /// Bricks whose range of grey values was read because they are new or changed.
    pub bricks_read: u64,
    /// Bricks that no surface crosses, by their range and that of the voxels beside them.
    pub bricks_skipped: u64,
    /// Bricks whose cells were visited.
    pub bricks_meshed: u64,
    /// Cells visited: those of the meshed bricks.
    pub cells_visited: u64,
    /// Vertices made.
    pub vertices: u64,
}

impl std::ops::AddAssign for SurfaceWork {
    fn add_assign(&mut self, other: Self) {
        self.bricks_read += other.bricks_read;
        self.bricks_skipped += other.bricks_skipped;
        self.bricks_meshed += other.bricks_meshed;
        self.cells_visited += other.cells_visited;
        self.vertices += other.vertices;
    }
}

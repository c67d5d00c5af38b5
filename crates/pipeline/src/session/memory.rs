//! Memory of a session, by owner.

use serde::Serialize;

/// Memory in use by owner, bytes. It omits the program itself, its threads' stacks, and readers'
/// copies of the volume while they are written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct MemoryByOwner {
    /// The volume: sums and weights of its bricks or columns.
    pub volume_bytes: u64,
    /// Memory that is prepared for the volume to grow.
    pub growth_bytes: u64,
    /// The renderer's values, weights and shaded voxels.
    pub render_voxel_bytes: u64,
    /// The renderer's rays and their caches.
    pub render_ray_bytes: u64,
    /// Frames that wait for pairing or insertion.
    pub queue_bytes: u64,
    /// Messages that wait in the recorder for the disk.
    pub recorder_bytes: u64,
    /// Observers' records of the session: positions of slices, for measurements.
    pub observer_bytes: u64,
    /// Frames that a virtual grabber rendered before the session.
    pub prepared_bytes: u64,
}

impl MemoryByOwner {
    /// Returns names and values of the owners.
    pub fn owners(&self) -> [(&'static str, u64); 8] {
        [
            ("volume", self.volume_bytes),
            ("growth", self.growth_bytes),
            ("render_voxels", self.render_voxel_bytes),
            ("render_rays", self.render_ray_bytes),
            ("queues", self.queue_bytes),
            ("recorder", self.recorder_bytes),
            ("observers", self.observer_bytes),
            ("prepared", self.prepared_bytes),
        ]
    }

    /// Returns the sum.
    pub fn total(&self) -> u64 {
        self.owners().into_iter().map(|(_, bytes)| bytes).sum()
    }
}

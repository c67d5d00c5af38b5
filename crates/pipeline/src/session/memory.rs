//! Memory of a session, by owner.

use crossbeam_channel::Sender;
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
    /// Queues before pairing, insertion and the recorder: their places, and the frames that wait
    /// for pairing or insertion.
    pub queue_bytes: u64,
    /// Messages that wait in the recorder for the disk.
    pub recorder_bytes: u64,
    /// Observers' records of the session: positions of slices, for measurements.
    pub observer_bytes: u64,
    /// Bricks that planes are sampled from, and their pixels.
    pub plane_bytes: u64,
    /// Tables of a virtual scanner, and frames that it rendered before the session.
    pub prepared_bytes: u64,
}

/// Returns the memory of a queue's places, bytes: each holds an entry and its turn.
pub(super) fn places<T>(queue: &Sender<T>) -> usize {
    queue.capacity().unwrap_or(0) * (size_of::<T>() + size_of::<usize>())
}

impl MemoryByOwner {
    /// Returns names and values of the owners.
    pub fn owners(&self) -> [(&'static str, u64); 9] {
        [
            ("volume", self.volume_bytes),
            ("growth", self.growth_bytes),
            ("render_voxels", self.render_voxel_bytes),
            ("render_rays", self.render_ray_bytes),
            ("queues", self.queue_bytes),
            ("recorder", self.recorder_bytes),
            ("observers", self.observer_bytes),
            ("planes", self.plane_bytes),
            ("prepared", self.prepared_bytes),
        ]
    }

    /// Returns the sum.
    pub fn total(&self) -> u64 {
        self.owners().into_iter().map(|(_, bytes)| bytes).sum()
    }
}

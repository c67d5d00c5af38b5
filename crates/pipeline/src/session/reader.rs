//! Readers of the growing volume. Each has its own thread, which reads a few planes at a time;
//! insertion continues in between.

use std::sync::Arc;
use std::time::Duration;

use export::volume::{DenseBox, Encoding, Part, Scalar, write_values_of, write_weights_of};

use super::shared_volume::Shared;

/// Longest wait before the thread checks whether a volume is requested.
const TURN: Duration = Duration::from_millis(50);
/// Voxels that are read while insertion waits: a few milliseconds.
const PART: u64 = 1 << 19;
/// Pause between two reads, during which insertion can continue.
const PAUSE: Duration = Duration::from_micros(200);

/// Reads the volume on request.
pub trait Reader: Send + Sync {
    /// Returns whether a volume is requested.
    fn request(&self) -> VolumeRequest;

    /// Receives the present volume, or the reason why there is none.
    fn volume(&self, volume: Result<Snapshot, NoVolume>);

    /// Returns whether the weights are requested too.
    fn with_weights(&self) -> bool {
        false
    }

    /// Receives the share of a requested volume that is read, 0 to 1.
    fn progress(&self, _share: f64) {}

    /// Returns the largest size of a volume, bytes; a larger one is not made.
    fn max_bytes(&self) -> u64;
}

/// A reader's request for a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VolumeRequest {
    /// No volume now.
    None,
    /// A volume if it has changed.
    IfChanged,
    /// A volume, changed or not.
    Now,
}

/// Reason why there is no volume.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoVolume {
    /// No slice has reached a voxel.
    #[error("no voxel was seen yet; wait for the first slices")]
    Unseen,
    /// It exceeds the reader's limit.
    #[error("the volume has {}×{}×{} voxels, more than {max_bytes} bytes; choose a coarser volume.spacing_mm", size[0], size[1], size[2])]
    TooLarge {
        /// Its size, voxels.
        size: [u64; 3],
        /// The limit.
        max_bytes: u64,
    },
}

/// A volume at a certain time. Slices that arrived while it was read may be in parts of it.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Its position.
    pub space: DenseBox,
    /// Scalar type.
    pub scalar: Scalar,
    /// Values, x fastest, in native byte order; 0 if unseen.
    pub bytes: Arc<[u8]>,
    /// Weights, if requested: single precision, in the same order; 0 if unseen.
    pub weights: Option<Arc<[u8]>>,
    /// Slices in it.
    pub slices: u64,
    /// Grey values of black and white in the scanner's frames.
    pub grey_levels: [f32; 2],
}

/// Passes volumes to the reader until no slice follows; then the last one, if it is requested.
pub(super) fn run(shared: &Shared, reader: &dyn Reader) {
    let mut seen = None;
    loop {
        let (inserted, ended) = {
            let shared = shared.lock();
            ((shared.pending.inserted, shared.pending.cleared), shared.ended)
        };
        let is_requested = match reader.request() {
            VolumeRequest::None => false,
            VolumeRequest::IfChanged => Some(inserted) != seen,
            VolumeRequest::Now => true,
        };
        if is_requested {
            let taken = loop {
                if let Some(taken) = snapshot(shared, reader) {
                    break taken;
                }
            };
            seen = Some(inserted);
            reader.volume(taken);
        }
        if ended {
            return;
        }
        shared.rest(TURN);
    }
}

/// Returns the volume, or the reason why there is none; `None` if the lattice was replaced
/// meanwhile.
fn snapshot(shared: &Shared, reader: &dyn Reader) -> Option<Result<Snapshot, NoVolume>> {
    let nothing = || Some(Err(NoVolume::Unseen));
    let max_bytes = reader.max_bytes();
    let (space, encoding, lattice, slices, grey_levels) = {
        let shared = shared.lock();
        let (Some(reconstructor), Some(first)) = (shared.inserter.reconstructor(), shared.pending.first) else {
            return nothing();
        };
        let Some((low, high)) = reconstructor.volume().seen_bounds() else { return nothing() };
        let space = DenseBox::around([low, high], reconstructor.world_from_lattice(), reconstructor.settings());
        let encoding = Encoding { scalar: first.pixels.scalar(), window: None, unseen: 0.0 };
        (space, encoding, reconstructor.world_from_lattice(), shared.pending.slices(), first.pixels.grey_levels())
    };
    let [nx, ny, nz] = space.grid.size;
    let of_weights = if reader.with_weights() { Scalar::F32.bytes() } else { 0 };
    let of_voxel = encoding.scalar.bytes() + of_weights;
    let bytes = space.grid.voxels().and_then(|voxels| voxels.checked_mul(of_voxel));
    let Some(bytes) = bytes.filter(|bytes| *bytes <= max_bytes) else {
        return Some(Err(NoVolume::TooLarge { size: [nx, ny, nz], max_bytes }));
    };
    // The cast is safe: `bytes` is within the checked limit.
    let voxels = (bytes / of_voxel) as usize;
    let mut values = vec![0; voxels * encoding.scalar.bytes() as usize];
    let mut weights = vec![0; voxels * of_weights as usize];
    let parts: Vec<Part> = space.parts(PART).collect();
    for (done, part) in parts.iter().enumerate() {
        let shared = shared.lock();
        let reconstructor =
            shared.inserter.reconstructor().filter(|reconstructor| reconstructor.world_from_lattice() == lattice)?;
        write_values_of(reconstructor.volume(), &space, &encoding, part, &mut values);
        if of_weights > 0 {
            write_weights_of(reconstructor.volume(), &space, part, &mut weights);
        }
        drop(shared);
        reader.progress((done + 1) as f64 / parts.len() as f64);
        // Threads that wait for the volume get it before it is locked again.
        std::thread::sleep(PAUSE);
    }
    let weights = (of_weights > 0).then(|| weights.into());
    Some(Ok(Snapshot { space, scalar: encoding.scalar, bytes: values.into(), weights, slices, grey_levels }))
}

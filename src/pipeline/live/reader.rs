//! Who reads the volume while it grows. Each has a thread of its own, which reads a few planes at a time, between which the volume is woven on.

use std::sync::Arc;
use std::time::Duration;

use super::fabric::Shared;
use crate::export::volume::{DenseBox, Encoding, Scalar, planes, planes_of_weights};

/// The longest that the thread waits before it looks whether a volume is wanted.
const TURN: Duration = Duration::from_millis(50);
/// Voxels that are read while weaving waits: a few milliseconds'.
const PART: u64 = 1 << 19;
/// For how long weaving does not wait between two of them.
const PAUSE: Duration = Duration::from_micros(200);

/// Reads the volume whenever it wants to.
pub trait Reader: Send + Sync {
    /// Whether a volume is wanted.
    fn wants(&self) -> Wants;

    /// The volume as it is, or why there is none to be shown.
    fn volume(&self, volume: Result<Snapshot, String>);

    /// Whether the weights are wanted, too.
    fn weighs(&self) -> bool {
        false
    }

    /// So much of a volume that was wanted is read, 0 to 1.
    fn taking(&self, _share: f64) {}

    /// The most bytes that a volume may have; a larger one is not made.
    fn most_bytes(&self) -> u64;
}

/// Whether a volume is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wants {
    /// Not now.
    Nothing,
    /// If it has changed.
    Changed,
    /// Whether it has changed or not.
    Any,
}

/// A volume at a time. Slices that came while it was made may be in parts of it.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// Where it lies.
    pub space: DenseBox,
    /// Scalar type.
    pub scalar: Scalar,
    /// Values, x fastest, in native byte order; 0 where nothing was seen.
    pub bytes: Arc<[u8]>,
    /// Weights, if they were wanted: single precision, in the same order; 0 where nothing was seen.
    pub weights: Option<Arc<[u8]>>,
    /// Slices in it.
    pub slices: u64,
    /// Black and white of the scanner's picture.
    pub grey_levels: [f32; 2],
}

/// Shows volumes until no slice follows; the last one is shown if it is wanted at all.
pub(super) fn run(shared: &Shared, reader: &dyn Reader) {
    let mut seen = None;
    loop {
        let (woven, ended) = {
            let fabric = shared.lock();
            ((fabric.news.woven, fabric.news.cleared), fabric.ended)
        };
        let is_wanted = match reader.wants() {
            Wants::Nothing => false,
            Wants::Changed => Some(woven) != seen,
            Wants::Any => true,
        };
        if is_wanted {
            let taken = loop {
                if let Some(taken) = snapshot(shared, reader) {
                    break taken;
                }
            };
            seen = Some(woven);
            reader.volume(taken);
        }
        if ended {
            return;
        }
        shared.rest(TURN);
    }
}

/// The volume, or why there is none to be shown; `None` where the lattice has become another one meanwhile.
fn snapshot(shared: &Shared, reader: &dyn Reader) -> Option<Result<Snapshot, String>> {
    let nothing = || Some(Err("no voxel was seen yet".to_owned()));
    let most_bytes = reader.most_bytes();
    let (space, encoding, lattice, slices, grey_levels) = {
        let fabric = shared.lock();
        let (Some(weaver), Some(begun)) = (fabric.loom.weaver(), fabric.news.begun) else { return nothing() };
        let Some((low, high)) = weaver.volume().seen_bounds() else { return nothing() };
        let space = DenseBox::around([low, high], weaver.world_from_lattice(), weaver.settings());
        let encoding = Encoding { scalar: begun.pixels.scalar(), window: None, unseen: 0.0 };
        (space, encoding, weaver.world_from_lattice(), fabric.news.slices(), begun.pixels.grey_levels())
    };
    let [nx, ny, nz] = space.grid.size;
    let of_weights = if reader.weighs() { Scalar::F32.bytes() } else { 0 };
    let of_voxel = encoding.scalar.bytes() + of_weights;
    let bytes = space.grid.voxels().and_then(|voxels| voxels.checked_mul(of_voxel));
    let Some(bytes) = bytes.filter(|bytes| *bytes <= most_bytes) else {
        return Some(Err(format!(
            "the volume has {nx}×{ny}×{nz} voxels, more than {most_bytes} bytes; choose a coarser volume.spacing_mm"
        )));
    };
    // No more than the limit, which was looked at.
    let voxels = (bytes / of_voxel) as usize;
    let mut values = Vec::with_capacity(voxels * encoding.scalar.bytes() as usize);
    let mut weights = Vec::with_capacity(voxels * of_weights as usize);
    let at_once = (PART / (nx * ny).max(1)).max(1);
    let mut z = 0;
    while z < nz {
        let until = (z + at_once).min(nz);
        let fabric = shared.lock();
        let weaver = fabric.loom.weaver().filter(|weaver| weaver.world_from_lattice() == lattice)?;
        planes(weaver.volume(), &space, &encoding, z..until, &mut values);
        if of_weights > 0 {
            planes_of_weights(weaver.volume(), &space, z..until, &mut weights);
        }
        drop(fabric);
        z = until;
        reader.taking(z as f64 / nz as f64);
        // Who has waited for the volume gets it before it is asked for again.
        std::thread::sleep(PAUSE);
    }
    let weights = (of_weights > 0).then(|| weights.into());
    Some(Ok(Snapshot { space, scalar: encoding.scalar, bytes: values.into(), weights, slices, grey_levels }))
}

//! Digests of a volume and a picture. The recording stores the result digest, and a replay
//! verifies it.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use render::Renderer;
use volume::brick::VOXELS;
use volume::read::Voxels;

/// Kind of the note.
pub(super) const DIGEST: &str = "seal";

/// Digest of a session's result.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResultDigest {
    /// Slices in the volume.
    pub slices: u64,
    /// SHA-256 of the volume: its blocks with their positions, numerators and weights bit by
    /// bit. `None` without a volume.
    pub volume_sha256: Option<String>,
    /// SHA-256 of the picture of all slices: its size, colours and transmittances bit by bit.
    /// `None` without a viewer.
    pub picture_sha256: Option<String>,
}

/// Returns the digest of a volume, independent of the order in which its blocks were touched.
pub(super) fn of_volume(volume: &dyn Voxels) -> String {
    let mut places: Vec<_> = volume.blocks().collect();
    places.sort_unstable();
    let mut hash = Sha256::new();
    let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
    for place in places {
        volume.block(place, &mut r, &mut w);
        place.iter().for_each(|at| hash.update(at.to_le_bytes()));
        [&r, &w].into_iter().for_each(|values| hash.update(bytemuck::bytes_of(values)));
    }
    text(hash)
}

/// Returns the digest of a renderer's picture.
pub(super) fn of_picture(renderer: &Renderer) -> String {
    let picture = renderer.picture();
    let mut hash = Sha256::new();
    picture.size.iter().for_each(|n| hash.update(n.to_le_bytes()));
    hash.update(bytemuck::cast_slice::<[f32; 4], u8>(&picture.pixels));
    text(hash)
}

fn text(hash: Sha256) -> String {
    hash.finalize().iter().fold(String::with_capacity(64), |mut text, byte| {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}

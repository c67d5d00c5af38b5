//! Saves growing volumes into a folder, each under a free name.

use std::path::{Path, PathBuf};

use export::volume::{Scalar, write_taken};
use volume::dense::{RANGE_FIELD, UNSEEN_FIELD};

use super::refusal::SaveError;
use crate::session::Snapshot;

/// Largest number in a folder's file names.
const MOST: u32 = 100_000;

/// Writes a volume as `volume-001.mha`, or with the next free number. Its weights, if any, go
/// beside it as `volume-001-weights.mha`. `input` describes the source of the volume.
///
/// # Errors
/// [`SaveError`]; no file is left then.
pub fn volume(folder: &Path, input: &str, world: &str, snapshot: &Snapshot) -> Result<PathBuf, SaveError> {
    std::fs::create_dir_all(folder).map_err(|source| SaveError::Folder { folder: folder.to_owned(), source })?;
    let Snapshot { space, scalar, bytes, weights, slices, grey_levels } = snapshot;
    let fields = [
        ("SonoweaveVersion".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("SonoweaveFrame".to_owned(), format!("{world} (mm, not anatomical)")),
        ("SonoweaveInput".to_owned(), input.to_owned()),
        ("SonoweaveFrames".to_owned(), format!("{slices} so far")),
        // Only the weights show whether a value of 0 is unseen.
        (UNSEEN_FIELD.to_owned(), "0".to_owned()),
        (RANGE_FIELD.to_owned(), grey_levels.map(|level| level.to_string()).join(" ")),
    ];
    let [path, beside] = free(folder)?;
    if let Some(weights) = weights {
        write_taken(space, Scalar::F32, weights, &beside, &fields)?;
    }
    write_taken(space, *scalar, bytes, &path, &fields).inspect_err(|_| {
        // Weights without a volume are useless.
        let _ = std::fs::remove_file(&beside);
    })?;
    Ok(path)
}

/// Returns the next pair of free names.
fn free(folder: &Path) -> Result<[PathBuf; 2], SaveError> {
    (1..=MOST)
        .map(|number| ["", "-weights"].map(|what| folder.join(format!("volume-{number:03}{what}.mha"))))
        .find(|names| names.iter().all(|name| !name.exists()))
        .ok_or_else(|| SaveError::Full { folder: folder.to_owned(), most: MOST })
}

//! Volumes into a folder while they grow, each by a name that is free.

use std::path::{Path, PathBuf};

use crate::export::volume::{Scalar, write_taken};
use crate::pipeline::live::Snapshot;
use crate::volume::dense::{RANGE_FIELD, UNSEEN_FIELD};

/// Names that are tried in a folder.
const MOST: u32 = 100_000;

/// Writes a volume as `volume-001.mha`, or by the next number that is free, and its weights beside it, where it has any, as `volume-001-weights.mha`. `input` says what it was
/// made of.
///
/// # Errors
/// A sentence; there is no file then.
pub fn volume(folder: &Path, input: &str, world: &str, snapshot: &Snapshot) -> Result<PathBuf, String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let Snapshot { space, scalar, bytes, weights, slices, grey_levels } = snapshot;
    let fields = [
        ("SonoweaveVersion".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("SonoweaveFrame".to_owned(), format!("{world} (mm, not anatomical)")),
        ("SonoweaveInput".to_owned(), input.to_owned()),
        ("SonoweaveFrames".to_owned(), format!("{slices} so far")),
        // What a value of 0 means only the weights tell for certain.
        (UNSEEN_FIELD.to_owned(), "0".to_owned()),
        (RANGE_FIELD.to_owned(), grey_levels.map(|level| level.to_string()).join(" ")),
    ];
    let [path, beside] = free(folder)?;
    let said = |error: crate::export::volume::ExportError| error.to_string();
    if let Some(weights) = weights {
        write_taken(space, Scalar::F32, weights, &beside, &fields).map_err(said)?;
    }
    write_taken(space, *scalar, bytes, &path, &fields).map_err(|error| {
        // Weights alone are no volume.
        let _ = std::fs::remove_file(&beside);
        said(error)
    })?;
    Ok(path)
}

/// The next names of which neither is there.
fn free(folder: &Path) -> Result<[PathBuf; 2], String> {
    (1..=MOST)
        .map(|number| ["", "-weights"].map(|what| folder.join(format!("volume-{number:03}{what}.mha"))))
        .find(|names| names.iter().all(|name| !name.exists()))
        .ok_or_else(|| format!("{}: has {MOST} volumes; choose another folder", folder.display()))
}

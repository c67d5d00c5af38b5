//! Filling of holes in the written files.

use export::ExportError;
use export::fill::{Filled, Filling};
use export::volume::DenseBox;
use reconstruct::Settings;
use volume::Voxels;
use volume::dense::{FILL_FIELD, FILLED_FIELD};

use crate::failure::{Failure, Reason};

/// Refuses, before the work, a filling that is impossible on such a lattice, or without
/// written files.
///
/// # Errors
/// [`Failure`] with the flag to change.
pub(crate) fn check(filling: Option<&Filling>, settings: &Settings, is_written: bool) -> Result<(), Failure> {
    let Some(filling) = filling else { return Ok(()) };
    if !is_written {
        return Err(Failure::usage(
            "--fill: applies to written files, and none is written; give a volume, --weights or --planes",
        ));
    }
    filling.check(settings.spacing_mm).map_err(|e| Failure::usage(format!("--fill-radius: {e}")))
}

/// Returns the volume to write; `None` if holes are not filled.
///
/// # Errors
/// [`Failure`] when memory or threads do not suffice.
pub(crate) fn fill<'a>(
    filling: Option<&Filling>,
    volume: &'a dyn Voxels,
    space: &DenseBox,
    settings: &Settings,
) -> Result<Option<Filled<'a>>, Failure> {
    let Some(filling) = filling else { return Ok(None) };
    let filled = filling.fill(volume, space, settings.threads, settings.memory_bytes);
    Ok(Some(filled.map_err(advised)?))
}

/// Adds the flags that help to the error of a volume's export.
pub(crate) fn advised(error: ExportError) -> Failure {
    let flags = match error {
        ExportError::VolumeTooLarge { .. } | ExportError::DicomTooLarge { .. } | ExportError::DicomTooLong { .. } => {
            "--origin and --size, or --spacing"
        }
        ExportError::Memory { .. } => "--fill-radius, --size or --max-memory",
        ExportError::FloatingPoint => "--type u8 or u16, and --window LO,HI",
        _ => return error.into(),
    };
    let sentence = format!("{error}: {flags}");
    let Failure(reason) = error.into();
    Failure(Reason { sentence, ..reason })
}

/// Returns the header fields of a filled volume.
pub(crate) fn fields(filled: &Filled<'_>) -> [(String, String); 2] {
    [(FILL_FIELD.into(), filled.filling().to_string()), (FILLED_FIELD.into(), filled.work().filled.to_string())]
}

/// Describes the filling, in a line.
pub(crate) fn sentence(filled: &Filled<'_>) -> String {
    format!(
        "filled: {} of {} unseen voxels near seen ones, {}",
        filled.work().filled,
        filled.work().holes,
        filled.filling()
    )
}

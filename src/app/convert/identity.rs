//! Fields that may tell who made a recording, of whom, or where.
//!
//! Programs may write anything into fields of their own, so all of these are removed. Only the
//! data needed for the frames' position and time are kept: transforms, their status, times,
//! frame numbers, and the frames' status, orientation and type. Volumes keep their position, and
//! the numbers that rendering needs. Names of files and of calibrations are removed, as they are
//! often a patient's. Text within the image stays; `--crop` cuts it off.

use formats::image::ELEMENT_SPACING;
use volume::dense::{RANGE_FIELD, SLICE_AXES_FIELD, SLICES_BOX_FIELD, UNSEEN_FIELD};

/// Numeric fields, most of them ours, which identify nobody.
const NUMBERS: [&str; 15] = [
    ELEMENT_SPACING,
    UNSEEN_FIELD,
    RANGE_FIELD,
    SLICES_BOX_FIELD,
    SLICE_AXES_FIELD,
    "SonoweaveVersion",
    "SonoweaveMethod",
    "SonoweaveCompounding",
    "SonoweavePath",
    "SonoweaveSigmaMm",
    "SonoweaveSupportMm",
    "SonoweaveFrames",
    "SonoweaveTruthKernel",
    "SonoweaveTruthTime",
    "AnatomicalOrientation",
];

/// Removes fields that may identify a person; adds their names to `removed`, each once.
pub fn leave_out(fields: &mut Vec<(String, String)>, removed: &mut Vec<String>) {
    fields.retain(|(name, _)| {
        let stays = NUMBERS.contains(&&**name);
        if !stays && !removed.contains(name) {
            removed.push(name.clone());
        }
        stays
    });
}

/// Returns our own fields of a volume that identify nobody.
pub fn numeric(fields: &[(String, String)]) -> Vec<(String, String)> {
    fields.iter().filter(|(name, _)| NUMBERS.contains(&&**name) && name.starts_with("Sonoweave")).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_fields_and_file_names_go_numbers_stay() {
        let mut fields: Vec<(String, String)> =
            ["Patient", "SonoweaveUnseen", "SonoweaveInput", "ElementSpacing", "Comment", "Patient"]
                .map(|name| (name.into(), "x".into()))
                .to_vec();
        let mut removed = Vec::new();
        leave_out(&mut fields, &mut removed);
        assert_eq!(fields, ["SonoweaveUnseen", "ElementSpacing"].map(|name| (name.to_owned(), "x".to_owned())));
        assert_eq!(removed, ["Patient", "SonoweaveInput", "Comment"]);
    }
}

//! What may tell of whom, by whom or where a recording was made.
//!
//! Nobody knows what programs write into fields of their own, so these all go: what stays is what the pictures' place and time need. Left are transforms, their status,
//! times, frame numbers, the pictures' status, orientation and type; of volumes the place, and the numbers that rendering needs. Names of files and of calibrations
//! go, as they are often a patient's. What is written into the pictures stays: `--crop` cuts it off.

use drivers::recording::image::ELEMENT_SPACING;

use crate::volume::dense::{RANGE_FIELD, SLICE_AXES_FIELD, SLICES_BOX_FIELD, UNSEEN_FIELD};

/// Fields that are numbers, most of them ours, and say nothing of anybody.
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

/// Leaves out fields that may identify somebody; their names are added to `removed`, each once.
pub fn leave_out(fields: &mut Vec<(String, String)>, removed: &mut Vec<String>) {
    fields.retain(|(name, _)| {
        let stays = NUMBERS.contains(&&**name);
        if !stays && !removed.contains(name) {
            removed.push(name.clone());
        }
        stays
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_fields_and_names_of_files_go_and_numbers_stay() {
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

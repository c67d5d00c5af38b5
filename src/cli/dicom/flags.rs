//! Who and what a DICOM file is of.

use std::path::Path;

use clap::Args;

use crate::cli::Failure;
use crate::export::dicom::Identifiers;

/// What is given is in the file, and nothing else is.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "DICOM")]
pub(in crate::cli) struct DicomFlags {
    /// Patient's name in a DICOM file: family^given [default: empty]
    #[arg(long, value_name = "NAME")]
    patient_name: Option<String>,
    /// Patient's ID in a DICOM file [default: empty]
    #[arg(long, value_name = "ID")]
    patient_id: Option<String>,
    /// The study's unique identifier, to add to one that is there [default: derived from the recording]
    #[arg(long, value_name = "UID")]
    study_uid: Option<String>,
    /// The study's description [default: none]
    #[arg(long, value_name = "TEXT")]
    study_description: Option<String>,
    /// The series' description [default: none]
    #[arg(long, value_name = "TEXT")]
    series_description: Option<String>,
    /// When it was recorded, as fourteen digits [default: unknown, which a volume has as 1900-01-01]
    #[arg(long, value_name = "YYYYMMDDHHMMSS")]
    acquired: Option<String>,
}

impl DicomFlags {
    /// What they say.
    ///
    /// # Errors
    /// [`Failure`] for what the standard does not allow.
    pub(in crate::cli) fn identifiers(&self) -> Result<Identifiers, Failure> {
        let Self { patient_name, patient_id, study_uid, study_description, series_description, acquired } =
            self.clone();
        let identifiers =
            Identifiers { patient_name, patient_id, study_uid, study_description, series_description, acquired };
        identifiers.check()?;
        Ok(identifiers)
    }
}

/// Whether a name is that of a DICOM file.
pub(in crate::cli) fn is_dicom(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"))
}

//! Identifiers of the patient, study and series of a DICOM file.

use clap::Args;

use export::dicom::Identifiers;

/// Identifiers for a DICOM file; it contains only the ones that are given.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "DICOM")]
pub(in crate::cli) struct DicomFlags {
    /// Patient's name in a DICOM file: family^given [default: empty]
    #[arg(long, value_name = "NAME")]
    patient_name: Option<String>,
    /// Patient's ID in a DICOM file [default: empty]
    #[arg(long, value_name = "ID")]
    patient_id: Option<String>,
    /// Unique identifier of the study, to add to an existing one [default: derived from the
    /// recording]
    #[arg(long, value_name = "UID")]
    study_uid: Option<String>,
    /// Description of the study [default: none]
    #[arg(long, value_name = "TEXT")]
    study_description: Option<String>,
    /// Description of the series [default: none]
    #[arg(long, value_name = "TEXT")]
    series_description: Option<String>,
    /// Time of the recording, as fourteen digits [default: unknown, written as 1900-01-01 for a
    /// volume]
    #[arg(long, value_name = "YYYYMMDDHHMMSS")]
    acquired: Option<String>,
}

impl DicomFlags {
    /// Returns the identifiers, still to be checked.
    pub(in crate::cli) fn identifiers(&self) -> Identifiers {
        let Self { patient_name, patient_id, study_uid, study_description, series_description, acquired } =
            self.clone();
        Identifiers { patient_name, patient_id, study_uid, study_description, series_description, acquired }
    }
}

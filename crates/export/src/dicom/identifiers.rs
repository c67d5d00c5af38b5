//! Identifiers of the patient and the study: only what the user gives.

use sonoweave_core::date::Second;

use super::ExportError;

/// Largest number of characters of a description or an identifier (value representation LO), and
/// of a group of a name (PN).
const LONGEST: usize = 64;
/// Largest number of characters of a unique identifier.
const LONGEST_UID: usize = 64;

/// Data about the patient and the study. Missing ones are empty in the file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Identifiers {
    /// Patient's Name, its parts separated by carets: family^given^middle.
    pub patient_name: Option<String>,
    /// Patient ID.
    pub patient_id: Option<String>,
    /// Study Instance UID; if missing it is derived, the same for all images of one recording
    /// with the same other identifiers.
    pub study_uid: Option<String>,
    /// Study Description.
    pub study_description: Option<String>,
    /// Series Description.
    pub series_description: Option<String>,
    /// Date and time of acquisition as fourteen digits: year, month, day, hour, minute, second.
    pub acquired: Option<String>,
}

impl Identifiers {
    /// Returns whether nothing is given.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Checks that the standard allows all of it.
    ///
    /// # Errors
    /// [`ExportError::Identifier`] with the first invalid one.
    pub fn check(&self) -> Result<(), ExportError> {
        let texts = [
            ("patient name", &self.patient_name),
            ("patient ID", &self.patient_id),
            ("study description", &self.study_description),
            ("series description", &self.series_description),
        ];
        for (what, text) in texts.into_iter().filter_map(|(what, text)| Some((what, text.as_ref()?))) {
            let refuse = |problem| Err(ExportError::Identifier { what, given: text.clone(), problem });
            if text.chars().count() > LONGEST {
                return refuse("has more than 64 characters; shorten it");
            }
            if text.chars().any(|c| c == '\\' || c.is_control()) {
                return refuse("has a backslash or a control character; leave it out");
            }
        }
        if let Some(uid) = &self.study_uid {
            let is_number = |part: &str| {
                !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit()) && (part == "0" || !part.starts_with('0'))
            };
            if uid.len() > LONGEST_UID || !uid.contains('.') || !uid.split('.').all(is_number) {
                let problem =
                    "is no unique identifier; give at most 64 digits and points, and no number with a leading zero";
                return Err(ExportError::Identifier { what: "study UID", given: uid.clone(), problem });
            }
        }
        if let Some(acquired) = self.acquired.as_ref().filter(|text| Second::parse(text).is_none()) {
            let problem = "is no date and time; give fourteen digits such as 20261121213000";
            return Err(ExportError::Identifier { what: "time of acquisition", given: acquired.clone(), problem });
        }
        Ok(())
    }

    /// Returns the date and time of acquisition, or a placeholder if unknown.
    pub(super) fn acquired(&self) -> (&str, &str) {
        self.acquired.as_deref().unwrap_or("19000101000000").split_at(8)
    }
}

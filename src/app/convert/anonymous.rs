//! Rules for recordings that tell nobody's name: times, words and numbers.
//!
//! Fields are left out by [`identity`](super::identity), pixels beside the picture by
//! [`blacken`](super::blacken).

use formats::image::write::SequenceItem;
use sonoweave_core::date::Second;
use sonoweave_core::reading::Status;
use sync::ingest::mf_size;

/// Field with the subject's pseudonym.
pub const SUBJECT_FIELD: &str = "SonoweaveSubject";
/// Field with the time of acquisition, moved by the subject's shift, as fourteen digits.
pub const ACQUIRED_FIELD: &str = "SonoweaveAcquired";

/// Words of a status that PLUS and this program write.
const WORDS: [&str; 9] = [
    "INVALID",
    "MISSING",
    "OUT_OF_VIEW",
    "OUT_OF_WINDOW",
    "DISABLED",
    "TOOL_OUT_OF_VIEW",
    "TOOL_MISSING",
    "REQ_TIMEOUT",
    "UNKNOWN",
];
/// Types of images that PLUS knows.
const IMAGE_TYPES: [&str; 6] = ["", "BRIGHTNESS", "RF_REAL", "RF_IQ_LINE", "RF_I_LINE_Q_LINE", "RGB_COLOR"];

/// The subject of a recording, under a pseudonym.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    /// Its pseudonym.
    pub pseudonym: String,
    /// Time of acquisition, already shifted, if it is known.
    pub acquired: Option<Second>,
}

impl Subject {
    /// Returns the fields that tell it.
    pub fn fields(&self) -> Vec<(String, String)> {
        let acquired = self.acquired.map(|time| (ACQUIRED_FIELD.to_owned(), time.to_string()));
        std::iter::once((SUBJECT_FIELD.to_owned(), self.pseudonym.clone())).chain(acquired).collect()
    }
}

/// Lets times and frame numbers begin at 0, and replaces free words of a status.
pub fn clean(items: &mut [SequenceItem]) {
    let time = items.iter().find_map(|item| item.stamp.source_s.or(item.stamp.unfiltered_s)).unwrap_or(0.0);
    let number = items.iter().find_map(|item| item.frame_number).unwrap_or(0);
    for item in items {
        let stamp = &mut item.stamp;
        (stamp.host_ns, stamp.ticks) = (None, None);
        stamp.source_s = stamp.source_s.map(|s| s - time);
        stamp.unfiltered_s = stamp.unfiltered_s.map(|s| s - time);
        item.frame_number = item.frame_number.and_then(|n| n.checked_sub(number));
        clean_status(&mut item.status);
        item.transforms.iter_mut().for_each(|transform| clean_status(&mut transform.status));
    }
}

fn clean_status(status: &mut Status) {
    if let Status::Other(word) = status
        && !WORDS.contains(&&**word)
    {
        *word = "INVALID".into();
    }
}

/// Checks that a text is an orientation, or empty.
///
/// # Errors
/// A sentence for other texts: with another orientation, the frames would be other ones.
pub fn check_orientation(code: &str) -> Result<(), String> {
    if code.trim().is_empty() || mf_size([1, 1], code).is_some() {
        return Ok(());
    }
    Err(format!("the orientation {code:?} is unknown, and may be a name; correct it in the recording"))
}

/// Returns a type of images; a free text becomes UNKNOWN, which is no brightness either.
pub fn image_type(name: String) -> String {
    if IMAGE_TYPES.contains(&name.trim().to_ascii_uppercase().as_str()) { name } else { "UNKNOWN".into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::reading::Stamp;

    #[test]
    fn times_and_numbers_keep_only_their_differences() {
        let item = |source_s, frame_number, word: &'static str| SequenceItem {
            stamp: Stamp { source_s, host_ns: Some(1), ..Stamp::default() },
            frame_number,
            status: Status::Other(word.into()),
            transforms: Vec::new(),
            fields: Vec::new(),
        };
        let mut items = [
            item(None, Some(40), "MISSING"),
            item(Some(1.75e9), Some(41), "Jane Doe"),
            item(Some(1.75e9 + 0.5), Some(43), "INVALID"),
        ];
        clean(&mut items);
        assert_eq!(items.each_ref().map(|item| item.stamp.source_s), [None, Some(0.0), Some(0.5)]);
        assert_eq!(items.each_ref().map(|item| item.frame_number), [Some(0), Some(1), Some(3)]);
        let words = ["MISSING", "INVALID", "INVALID"].map(|word| Status::Other(word.into()));
        assert_eq!(items.each_ref().map(|item| item.status.clone()), words);
        assert!(items.iter().all(|item| item.stamp.host_ns.is_none()));
    }

    #[test]
    fn free_texts_in_place_of_codes_do_not_pass() {
        assert_eq!(["MFA", "UN", " ", "Doe"].map(|code| check_orientation(code).is_ok()), [true, true, true, false]);
        assert_eq!(["BRIGHTNESS", "", "Doe"].map(|name| image_type(name.into())), ["BRIGHTNESS", "", "UNKNOWN"]);
    }
}

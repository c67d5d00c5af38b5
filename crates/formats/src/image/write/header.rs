//! A header under construction: the parts common to all grammars.

use std::fmt::Write as _;

use sonoweave_core::reading::{Status, split_transform_name};

use crate::Unwritable;
use crate::image::header::{Grammar, full_name};
use crate::image::numbers::list;
use crate::image::sequence::{IMAGE_TYPE, ORIENTATION};
use crate::image::sequence_header::SequenceItem;

/// Format-specific spelling of fields outside the format's own structure.
pub(crate) struct Style {
    pub(crate) grammar: &'static Grammar,
    /// Text between name and value.
    pub(crate) separator: &'static str,
    /// Character not allowed in a name.
    pub(crate) reserved: char,
    /// Field name of a frame's image status.
    pub(crate) image_status: &'static str,
    /// Escapes names and values that would otherwise be misread.
    pub(crate) escape: fn(&str) -> String,
}

/// A header, and the position in it of the compressed data's length.
pub(crate) struct Text {
    pub(crate) style: &'static Style,
    pub(crate) text: String,
    /// Position of the space for [`SIZE_DIGITS`] digits.
    pub(crate) size_at: Option<u64>,
}

/// Digits of the largest 64-bit number: space for the compressed size, which is known only at
/// the end.
pub(crate) const SIZE_DIGITS: usize = 20;

impl Text {
    /// Returns the header's bytes, and the position of the compressed data's length.
    pub(crate) fn into_bytes(self) -> (Vec<u8>, Option<u64>) {
        (self.text.into_bytes(), self.size_at)
    }

    pub(crate) fn new(style: &'static Style) -> Self {
        Self { style, text: String::new(), size_at: None }
    }

    pub(crate) fn line(&mut self, name: &str, value: &str) {
        let Style { separator, escape, .. } = self.style;
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{}{separator}{}", escape(name), escape(value));
    }

    /// Appends a line of externally supplied texts, after checking them.
    pub(crate) fn field(&mut self, name: &str, value: &str) -> Result<(), Unwritable> {
        let clean = |text: &str| !text.contains(char::is_control) && text.trim() == text;
        let reserved = self.style.reserved;
        if name.is_empty() || !clean(name) || name.contains(reserved) || name.starts_with('#') {
            return Err(Unwritable::FieldName { name: name.to_owned(), reserved });
        }
        if !clean(&(self.style.escape)(value)) || value.trim() != value {
            return Err(Unwritable::FieldValue { name: name.to_owned(), value: value.to_owned() });
        }
        self.line(name, value);
        Ok(())
    }

    /// Appends orientation and type of a sequence's images, if given.
    pub(crate) fn pictures(&mut self, [orientation, image_type]: [(&str, &str); 2]) -> Result<(), Unwritable> {
        for (name, value) in [orientation, image_type].into_iter().filter(|(_, value)| !value.is_empty()) {
            self.field(name, value)?;
        }
        Ok(())
    }

    /// Appends further global fields; `taken` are the names already written.
    pub(crate) fn extra(&mut self, fields: &[(String, String)], taken: &[&str]) -> Result<(), Unwritable> {
        for (n, (name, value)) in fields.iter().enumerate() {
            let own = (self.style.grammar.is_structure)(name) || name.starts_with("Seq_Frame");
            if own || taken.contains(&&**name) || fields[..n].iter().any(|(earlier, _)| earlier == name) {
                return Err(Unwritable::FieldTwice(name.clone()));
            }
            self.field(name, value)?;
        }
        Ok(())
    }

    pub(crate) fn item(&mut self, frame: u64, item: &SequenceItem) -> Result<(), Unwritable> {
        for transform in &item.transforms {
            let base = if transform.to.is_empty() {
                transform.from.clone()
            } else {
                format!("{}To{}", transform.from, transform.to)
            };
            if split_transform_name(&base) != (transform.from.clone(), transform.to.clone()) {
                let (from, to) = (transform.from.clone(), transform.to.clone());
                return Err(Unwritable::FrameNames { from, to });
            }
            self.field(&full_name(frame, &format!("{base}Transform")), &list(&transform.matrix))?;
            self.field(&full_name(frame, &format!("{base}TransformStatus")), word(&transform.status)?)?;
        }
        let times = [("Timestamp", item.stamp.source_s), ("UnfilteredTimestamp", item.stamp.unfiltered_s)];
        for (name, seconds) in times {
            let Some(seconds) = seconds else { continue };
            if !seconds.is_finite() {
                return Err(Unwritable::Time { name, frame, seconds });
            }
            self.line(&full_name(frame, name), &seconds.to_string());
        }
        if let Some(number) = item.frame_number {
            self.line(&full_name(frame, "FrameNumber"), &number.to_string());
        }
        self.field(&full_name(frame, self.style.image_status), word(&item.status)?)?;
        for (name, value) in &item.fields {
            self.field(&full_name(frame, name), value)?;
        }
        Ok(())
    }
}

fn word(status: &Status) -> Result<&str, Unwritable> {
    match status {
        Status::Ok => Ok("OK"),
        Status::Other(word) if word.eq_ignore_ascii_case("OK") => Err(Unwritable::Status(word.to_string())),
        Status::Other(word) => Ok(word),
    }
}

/// Returns the field names that a sequence's orientation and image type occupy. Names of values
/// not given stay free.
pub(crate) fn taken(orientation: &str, image_type: &str) -> Vec<&'static str> {
    let given =
        [(ORIENTATION, orientation), (IMAGE_TYPE, image_type)].into_iter().filter(|(_, value)| !value.is_empty());
    given.map(|(name, _)| name).collect()
}

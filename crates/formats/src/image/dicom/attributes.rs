//! Attributes of a data set, with faults that name them.

use dicom_core::value::PrimitiveValue;
use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use dicom_object::mem::InMemElement;

use super::private;
use super::walk::name;
use crate::image::fault::Fault;

/// Attributes of a data set, or of an item of a sequence.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attributes<'a> {
    object: &'a InMemDicomObject,
    /// Position of the data set in the file, for faults.
    at: u64,
}

impl<'a> Attributes<'a> {
    pub(super) fn new(object: &'a InMemDicomObject, at: u64) -> Self {
        Self { object, at }
    }

    /// Returns a fault of an attribute.
    pub(super) fn fault(&self, tag: Tag, problem: impl ToString) -> Fault {
        Fault::field(name(tag), self.at, problem)
    }

    /// Returns an attribute's text without padding; `None` if it is absent or empty.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let text = text_of(self.object.get(tag)?)?;
        let text = text.trim_matches([' ', '\0']);
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// Returns a whole number; `None` if the attribute is absent.
    ///
    /// # Errors
    /// [`Fault`] for any other value.
    pub(super) fn whole(&self, tag: Tag) -> Result<Option<u64>, Fault> {
        let Some(element) = self.object.get(tag) else { return Ok(None) };
        let number = element.value().primitive().and_then(|value| value.to_int::<u64>().ok());
        let fault = || self.fault(tag, "is no whole number; the file is damaged: copy it again");
        number.ok_or_else(fault).map(Some)
    }

    /// Returns a required whole number.
    ///
    /// # Errors
    /// [`Fault`] for any other value, and if it is absent.
    pub(super) fn needed(&self, tag: Tag) -> Result<u64, Fault> {
        let missing = || self.fault(tag, "is missing, but images need it; export the image again");
        self.whole(tag)?.ok_or_else(missing)
    }

    /// Returns finite numbers; `None` if the attribute is absent.
    ///
    /// # Errors
    /// [`Fault`] for other values.
    pub(super) fn numbers(&self, tag: Tag) -> Result<Option<Vec<f64>>, Fault> {
        let Some(element) = self.object.get(tag) else { return Ok(None) };
        let numbers = element.value().primitive().and_then(|value| value.to_multi_float64().ok());
        match numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite())) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.fault(tag, "holds no finite numbers; the file is damaged: copy it again")),
        }
    }

    /// Returns `N` finite numbers; `None` if the attribute is absent.
    ///
    /// # Errors
    /// [`Fault`] for other values, or another number of them.
    pub(super) fn array<const N: usize>(&self, tag: Tag) -> Result<Option<[f64; N]>, Fault> {
        let Some(numbers) = self.numbers(tag)? else { return Ok(None) };
        let count = numbers.len();
        let array =
            numbers.try_into().map_err(|_| self.fault(tag, format!("holds {count} numbers, not {N}; correct it")));
        array.map(Some)
    }

    /// Returns the items of a sequence; none if it is absent.
    pub(super) fn items(&self, tag: Tag) -> impl Iterator<Item = Attributes<'a>> + use<'a> {
        let items = self.object.get(tag).and_then(|element| element.value().items()).unwrap_or_default();
        let at = self.at;
        items.iter().map(move |object| Attributes { object, at })
    }

    /// Returns the first item of a functional group's macro, of a frame or else shared by all.
    pub(super) fn group(&self, frame: usize, tag: Tag) -> Option<Attributes<'a>> {
        let own = self.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).nth(frame);
        let shared = || self.items(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE).next();
        own.and_then(|own| own.items(tag).next()).or_else(|| shared()?.items(tag).next())
    }

    fn private(&self, element: u8) -> Option<&'a InMemElement> {
        self.object.private_element(private::GROUP, private::CREATOR, element).ok()
    }

    /// Returns the doubles of a private element; `None` if it is absent.
    ///
    /// # Errors
    /// [`Fault`] unless there are `count` of them.
    pub(super) fn private_doubles(&self, element: u8, count: usize) -> Result<Option<Vec<f64>>, Fault> {
        let Some(found) = self.private(element) else { return Ok(None) };
        let fault = |what: &str| {
            let problem = format!("{what}, not {count} doubles; the file is damaged: copy it again");
            Fault::field(private_name(element), self.at, problem)
        };
        let value = found.value().primitive().ok_or_else(|| fault("is a sequence"))?;
        let doubles = match value {
            // Doubles (OD, FD), or bytes after a transfer without value representations (UN).
            PrimitiveValue::F64(doubles) => doubles.to_vec(),
            PrimitiveValue::Empty => Vec::new(),
            other if matches!(found.header().vr(), VR::UN | VR::OB) => {
                let bytes = other.to_bytes();
                bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
            }
            _ => return Err(fault("has another type")),
        };
        if doubles.len() != count {
            return Err(fault(&format!("holds {}", doubles.len())));
        }
        Ok(Some(doubles))
    }

    /// Returns the text of a private element; `None` if it is absent.
    pub(super) fn private_text(&self, element: u8) -> Option<String> {
        text_of(self.private(element)?).map(|text| text.trim_end_matches([' ', '\0']).to_owned())
    }

    /// Returns the lines of a private element; `None` if it is absent.
    ///
    /// # Errors
    /// [`Fault`] unless there are `count` of them.
    pub(super) fn private_lines(&self, element: u8, count: usize) -> Result<Option<Vec<String>>, Fault> {
        let Some(text) = self.private_text(element) else { return Ok(None) };
        let lines: Vec<String> = text.split('\n').map(|line| line.trim_matches([' ', '\0']).to_owned()).collect();
        if lines.len() == count {
            return Ok(Some(lines));
        }
        let problem = format!("holds {} lines, not {count}; the file is damaged: copy it again", lines.len());
        Err(Fault::field(private_name(element), self.at, problem))
    }
}

fn private_name(element: u8) -> String {
    format!("({:04x},xx{element:02x}) of {}", private::GROUP, private::CREATOR)
}

fn text_of(element: &InMemElement) -> Option<String> {
    match element.value().primitive()? {
        PrimitiveValue::U8(bytes) => String::from_utf8(bytes.to_vec()).ok(),
        other => Some(other.to_raw_str().into_owned()),
    }
}

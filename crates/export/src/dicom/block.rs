//! Our block of private elements.

use dicom_core::{PrimitiveValue, Tag, VR};

use formats::image::dicom::private;

use super::dataset::Dataset;

/// Elements of the creator SONOWEAVE, in the block from (0009,1000) on.
#[derive(Debug, Default)]
pub(super) struct PrivateBlock(Vec<(u8, VR, PrimitiveValue)>);

impl PrivateBlock {
    /// Adds doubles. Their type (OD) has a length of 32 bits, which that of the public ones (FD)
    /// has not.
    pub(super) fn doubles(&mut self, element: u8, doubles: Vec<f64>) {
        self.0.push((element, VR::OD, PrimitiveValue::F64(doubles.into())));
    }

    /// Adds a text.
    pub(super) fn text(&mut self, element: u8, vr: VR, text: &str) {
        self.0.push((element, vr, text.into()));
    }

    /// Returns the values' bytes, from which the identifier of the instance follows.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.0.iter().flat_map(|(_, _, value)| value.to_bytes().into_owned()).collect()
    }

    /// Adds the block to a data set.
    pub(super) fn put(self, dataset: Dataset) -> Dataset {
        let dataset = dataset.put(Tag(private::GROUP, 0x0010), VR::LO, private::CREATOR);
        self.0.into_iter().fold(dataset, |dataset, (element, vr, value)| {
            dataset.put(Tag(private::GROUP, 0x1000 | u16::from(element)), vr, value)
        })
    }
}

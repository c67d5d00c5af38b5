//! Pixel spacing of a sequence: read from every format, reported as a field, and refused if the
//! field holds no lengths.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

use std::fs;

use drivers::replay::{Replay, SequenceSettings};
use formats::image::ELEMENT_SPACING;
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter};
use formats::{Error, Unwritable};
use sonoweave_core::Device;
use sonoweave_core::reading::{PixelType, Stamp, Status};

#[test]
fn spacing_is_read_from_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let stated = |name: &str, header: &str| {
        let path = folder.path().join(name);
        fs::write(&path, [header.as_bytes(), &[0; 4]].concat()).unwrap();
        let device = Replay::open(&SequenceSettings::new(&path)).unwrap();
        let found = device.describe().fields.iter().find(|(name, _)| name == ELEMENT_SPACING).cloned();
        found.map(|(_, text)| text)
    };
    let mha = |line: &str| {
        stated(
            "a.mha",
            &format!(
                "NDims = 3\nDimSize = 2 1 2\n{line}Kinds = domain domain list\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
            ),
        )
    };
    assert_eq!(mha("ElementSpacing = 0.2 0.10 1\n").unwrap(), "0.2 0.1");
    assert_eq!(mha("ElementSize = 0.2 1 3\n").unwrap(), "0.2 1 3");
    for nothing in [
        "",
        "ElementSpacing = 1 1 1\n",
        "ElementSpacing = 0 0 0\n",
        "ElementSpacing = a b c\n",
        "ElementSpacing = nan 1 1\n",
        "ElementSpacing = 2\n",
    ] {
        assert_eq!(mha(nothing), None, "{nothing}");
    }
    let nrrd = |sizes: &str, kinds: &str, line: &str| {
        let dimension = sizes.split(' ').count();
        stated(
            "a.nrrd",
            &format!(
                "NRRD0004\ntype: uint8\ndimension: {dimension}\nsizes: {sizes}\nkinds: {kinds}\nencoding: raw\n{line}\n\n"
            ),
        )
    };
    let flat = ("2 1 2", "domain domain list");
    assert_eq!(nrrd(flat.0, flat.1, "space dimension: 2\nspace directions: (0.2,0) (0,0.3) none").unwrap(), "0.2 0.3");
    assert_eq!(nrrd(flat.0, flat.1, "spacings: 0.2 0.3 nan").unwrap(), "0.2 0.3");
    assert_eq!(nrrd(flat.0, flat.1, "space directions: (1,0) (0,1) none\nspace dimension: 2"), None);
    assert_eq!(nrrd(flat.0, flat.1, "space dimension: 2\nspace directions: (x,0) (0,1) none"), None);
    let slicer = ("2 1 1 2", "domain domain domain list");
    let turned = "space: left-posterior-superior\nspace directions: (0,-0.2,0) (0.3,0.4,0) (0,0,2) none";
    assert_eq!(nrrd(slicer.0, slicer.1, turned).unwrap(), "0.2 0.5 2");
    let path = folder.path().join("b.mha");
    let field = |text: &str| vec![(ELEMENT_SPACING.to_owned(), text.to_owned())];
    let item = || SequenceItem {
        stamp: Stamp::default(),
        frame_number: None,
        status: Status::Ok,
        transforms: Vec::new(),
        fields: Vec::new(),
    };
    for bad in ["", "1", "0 1", "a b", "1 2 3 4", "1 inf"] {
        let header = SequenceHeader {
            size: [2, 1],
            pixel: PixelType::U8,
            channels: 1,
            orientation: String::new(),
            image_type: String::new(),
            compressed: false,
            fields: field(bad),
            items: vec![item()],
        };
        let error = SequenceWriter::create(&path, &header).err().unwrap();
        assert!(matches!(error, Error::Unwritable { source: Unwritable::Spacing(_), .. }), "{bad}: {error}");
    }
}

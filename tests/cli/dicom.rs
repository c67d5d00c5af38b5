//! DICOM output: volumes and sweeps, as requested by flags.

use super::place::Place;
use super::sequence::Sequence;

fn place() -> Place {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place
}

const RECONSTRUCT: &str = "reconstruct s.mha --path general --clip none --spacing 0.5 --sigma 0.5,0.5,0.7";

/// Returns whether bytes contain others.
fn holds(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[test]
fn dicom_from_reconstruct_equals_converted_volume() {
    let place = place();
    let who = "--patient-id 4711 --patient-name Doe^Jane --study-description Knee --series-description Sweep";
    place.does(&format!("{RECONSTRUCT} -o v.dcm {who}"));
    place.does(&format!("{RECONSTRUCT} -o v.mha"));
    let said = place.does(&format!("dicom v.mha -o w.dcm {who}"));
    assert!(said.contains("an enhanced ultrasound volume"), "{said}");
    assert!(place.get("v.dcm") == place.get("w.dcm"));
    let bytes = place.get("v.dcm");
    assert_eq!(&bytes[128..132], b"DICM");
    for text in ["1.2.840.10008.5.1.4.1.1.6.2", "Doe^Jane", "4711", "Knee", "Sweep"] {
        assert!(holds(&bytes, text.as_bytes()), "{text}");
    }
    // The voxels of the other file come last.
    let voxels: Vec<u8> = place.volume("v.mha").values.iter().map(|v| *v as u8).collect();
    assert!(bytes.ends_with(&voxels) || bytes[..bytes.len() - 1].ends_with(&voxels));
}

#[test]
fn sweep_has_poses_if_a_route_to_the_world_exists() {
    let place = place();
    let said = place.does("dicom s.mha -o s.dcm --frames 1..4");
    assert!(said.contains("3 frames of 40×30 pixels, 3 of them placed in Reference"), "{said}");
    assert!(holds(&place.get("s.dcm"), b"1.2.840.10008.5.1.4.1.1.3.1") && holds(&place.get("s.dcm"), b"SONOWEAVE"));
    place.put("t.mha", Sequence { transform: "ProbeToTracker", ..Sequence::default() }.bytes());
    let said = place.does("dicom t.mha -o t.dcm");
    assert!(said.contains("6 frames of 40×30 pixels, without poses"), "{said}");
    place.refuses("dicom t.mha -o u.dcm --world Table", &["t.mha: ", "Table"]);
}

#[test]
fn content_unsupported_by_dicom_is_refused() {
    let place = place();
    place.refuses(&format!("{RECONSTRUCT} -o v.dcm --type f32"), &["no floating point", "--type u8 or u16"]);
    place.refuses(&format!("{RECONSTRUCT} -o v.mha --patient-id 4711"), &["DICOM files only", "-o VOL.dcm"]);
    place.refuses(
        &format!("{RECONSTRUCT} -o v.dcm --acquired 2024"),
        &["time of acquisition \"2024\"", "fourteen digits"],
    );
    place.refuses("dicom s.mha -o s.dcm --study-uid 1.02", &["study UID \"1.02\""]);
    let long = "x".repeat(65);
    place.refuses(&format!("dicom s.mha -o s.dcm --series-description {long}"), &["series description", &long]);
    place.refuses("dicom s.mha -o s.png", &["s.png", ".dcm"]);
    place.refuses("dicom s.mha -o none/s.dcm", &["none"]);
    place.refuses("dicom none.mha -o s.dcm", &["none.mha"]);
    place.refuses("dicom s.mha -o s.dcm --frames 90..95", &["no frame"]);
    let deep = Sequence { element: "MET_USHORT", pixel: |_, _, _| vec![1, 2], ..Sequence::default() };
    place.put("d.mha", deep.bytes());
    place.refuses("dicom d.mha -o d.dcm", &["d.mha: ", "more than 8 bits"]);
    place.does(&format!("{RECONSTRUCT} -o f.mha --type f32"));
    place.refuses("dicom f.mha -o f.dcm", &["f.mha: ", "8 or 16 bit"]);
    place.refuses("dicom f.mha -o f.dcm --frames 0..1", &["which are for sequences"]);
}

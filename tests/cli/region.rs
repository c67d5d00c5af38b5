//! Regions of volumes from a seed: their volume, label volumes and meshes.

use std::f64::consts::PI;

use formats::Limits;
use formats::image::{VolumeHeader, VolumeReader};
use sonoweave_core::reading::PixelType;

use super::ome_zarr::succeeds;
use super::place::Place;
use super::render::put;

/// Voxels along each edge, and their spacing, mm.
const SIZE: [u32; 3] = [60, 40, 40];
const SPACING: f64 = 0.5;
/// Centre of the first voxel, and of the balls about ±7 mm from the middle along x, mm.
const ORIGIN: [f64; 3] = [100.0, -20.0, 5.0];
const CENTRES: [[f64; 3]; 2] = [[107.75, -10.25, 14.75], [121.75, -10.25, 14.75]];
const RADIUS: f64 = 5.0;

/// A volume of two dark balls with a thin bridge between them. Its last planes are unseen: they
/// have a value of the balls, and no weight.
fn balls() -> Place {
    let place = Place::new();
    let fields = [("SonoweaveFrame", "Reference (mm, not anatomical)"), ("SonoweaveInput", "s.mha sha256 abc")];
    let header = VolumeHeader {
        spacing: [SPACING; 3],
        origin: ORIGIN,
        fields: fields.map(|(name, value)| (name.to_owned(), value.to_owned())).to_vec(),
        ..VolumeHeader::new(SIZE, PixelType::F32)
    };
    let voxels = || (0..SIZE[2]).flat_map(|z| (0..SIZE[1]).flat_map(move |y| (0..SIZE[0]).map(move |x| [x, y, z])));
    let value = |voxel: [u32; 3]| {
        let at: [f64; 3] = std::array::from_fn(|a| ORIGIN[a] + SPACING * f64::from(voxel[a]));
        let distance = |c: &[f64; 3]| (0..3).map(|a| (at[a] - c[a]).powi(2)).sum::<f64>().sqrt();
        let to_bridge = (at[1] - CENTRES[0][1]).hypot(at[2] - CENTRES[0][2]);
        let is_bridge = to_bridge < 1.0 && at[0] > CENTRES[0][0] && at[0] < CENTRES[1][0];
        let ripple = f64::from((voxel[0] + 2 * voxel[1] + 3 * voxel[2]) % 7) - 3.0;
        let is_in = CENTRES.iter().any(|c| distance(c) <= RADIUS) || is_bridge || voxel[2] >= 38;
        (if is_in { 40.0 + 5.0 * ripple } else { 150.0 + 5.0 * ripple }) as f32
    };
    let bytes = |of: &dyn Fn([u32; 3]) -> f32| voxels().flat_map(|v| of(v).to_ne_bytes()).collect::<Vec<u8>>();
    put(&place, "v.mha", &header, &bytes(&value));
    put(&place, "w.mha", &header, &bytes(&|voxel| if voxel[2] >= 38 { 0.0 } else { 1.0 }));
    place
}

const COMMAND: &str = "region v.mha --weights w.mha --seed 107,-10,15 --range 0,95";

/// Reads a label volume.
fn labels(place: &Place, name: &str) -> (VolumeHeader, Vec<u8>) {
    let mut reader = VolumeReader::open(&place.path(name), &Limits::default()).unwrap();
    let header = reader.header().clone();
    let mut all = Vec::new();
    while let Some(slice) = reader.next_slice().unwrap() {
        all.extend_from_slice(slice);
    }
    (header, all)
}

#[test]
fn region_has_volume_of_its_ball_and_labels_all_voxels() {
    let place = balls();
    let said = place.run(&format!("{COMMAND} --open 1.2 -o r.nrrd --json=r.json"));
    assert!(said.code == 0 && said.stdout.contains("if its border lies half a voxel elsewhere"), "{}", said.stderr);
    let r = place.json("r.json");
    let (volume, error) = (r["volume_mm3"].as_f64().unwrap(), r["border_error_mm3"].as_f64().unwrap());
    let truth = 4.0 / 3.0 * PI * RADIUS.powi(3);
    assert!((volume - truth).abs() < error && error < 0.25 * truth, "{volume} ± {error} for {truth}");
    let (header, first) = labels(&place, "r.nrrd");
    assert_eq!((header.size, header.spacing, header.origin), (SIZE, [SPACING; 3], ORIGIN));
    let count = |label: u8| first.iter().filter(|l| **l == label).count() as u64;
    let unseen = u64::from(2 * SIZE[0] * SIZE[1]);
    assert_eq!((count(1), count(255)), (r["voxels"].as_u64().unwrap(), unseen));
    assert_eq!(count(0) + count(1) + unseen, first.len() as u64);
    let field = |name: &str| header.fields.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str());
    assert_eq!(field("SonoweaveFrame"), Some("Reference (mm, not anatomical)"));
    assert_eq!((field("SonoweaveInput"), field("Segment0_LabelValue")), (Some("s.mha sha256 abc"), Some("1")));
    assert!(field("SonoweaveRegion").is_some_and(|text| text.contains("opened by 1.2 mm")), "{:?}", header.fields);
    for name in ["r.mha", "r.nhdr", "r.nii", "r.nii.gz"] {
        for threads in [1, 3] {
            succeeds(&place, &format!("{COMMAND} --open 1.2 -o {name} --threads {threads}"));
            let (other, found) = labels(&place, name);
            assert!(found == first && other.size == SIZE && other.spacing == [SPACING; 3], "{name}");
        }
    }
}

#[test]
fn region_leaks_through_bridge_but_not_to_unseen_voxels() {
    let place = balls();
    succeeds(&place, &format!("{COMMAND} -o r.nrrd --json=r.json"));
    let r = place.json("r.json");
    assert!(r["volume_mm3"].as_f64().unwrap() > 1.8 * 4.0 / 3.0 * PI * RADIUS.powi(3), "{r}");
    assert_eq!((&r["unseen_faces"], &r["mesh"]), (&0.into(), &serde_json::Value::Null));
    // The background reaches the unseen voxels.
    let notes = succeeds(&place, "region v.mha --weights w.mha --seed 101,-19,6 --json=b.json");
    assert!(notes.contains("ends at unseen voxels by") && notes.contains("may continue there"), "{notes}");
}

#[test]
fn region_as_mesh_encloses_its_volume() {
    let place = balls();
    succeeds(&place, &format!("{COMMAND} --open 1.2 -o r.stl --json=r.json"));
    let r = place.json("r.json");
    assert_eq!((&r["mesh"]["closed"], &r["mesh"]["parts"]), (&true.into(), &1.into()));
    let ratio = r["mesh"]["volume_mm3"].as_f64().unwrap() / r["volume_mm3"].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    assert_eq!(place.get("r.stl").len() as u64, 84 + 50 * r["mesh"]["triangles"].as_u64().unwrap());
}

#[test]
fn region_as_dicom_has_the_given_identifiers() {
    let place = balls();
    let written = |flags: &str| {
        succeeds(&place, &format!("{COMMAND} -o r.dcm {flags}"));
        place.get("r.dcm")
    };
    let has = |bytes: &[u8], text: &str| bytes.windows(text.len()).any(|found| found == text.as_bytes());
    let plain = written("");
    assert!(&plain[128..132] == b"DICM" && has(&plain, "1.2.840.10008.5.1.4.1.1.66.4") && has(&plain, "BINARY"));
    assert!(plain == written("--threads 1") && !has(&plain, "4711") && has(&written("--patient-id 4711"), "4711"));
}

#[test]
fn impossible_regions_are_refused() {
    let place = balls();
    for (words, code, says) in [
        ("--seed 0,0,0", 2, "lies outside of the volume, or at a voxel that no slice reached"),
        ("--seed 107,-10,24.25", 2, "lies outside of the volume, or at a voxel that no slice reached"),
        ("--seed 107,-10", 2, "must hold 3 numbers, not 2"),
        ("--seed 107,-10,nan", 2, "must be finite"),
        ("--seed 107,-10,15 --range 60,90", 2, "lies outside of the range 60 to 90"),
        ("--seed 107,-10,15 --range 90,60", 2, "not below its begin"),
        ("--seed 107,-10,15 --radius 0.1", 2, "widen it, or give the range"),
        ("--seed 107,-10,15 --limit 0.1", 2, "grew beyond the limit of 0.1 ml"),
        ("--seed 107,-10,15 --open 6", 2, "leaves nothing at the seed"),
        ("--seed 107,-10,15 --max-memory 0.00072", 6, "raise the limit"),
        (
            "--seed 107,-10,15 -o r.txt",
            2,
            "the name of a region's file must end in .mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .dcm, .stl",
        ),
        ("--seed 107,-10,15 -o r.dcm --acquired now", 2, "is no date and time"),
        ("--seed 107,-10,15 -o v.mha", 2, "is the input"),
        ("--seed 107,-10,15 -o none/r.nrrd", 7, "the folder none does not exist"),
    ] {
        let run = place.run(&format!("region v.mha --weights w.mha {words}"));
        assert!(run.code == code && run.stderr.contains(says), "{words}: {} {}", run.code, run.stderr);
    }
    assert_eq!(place.names().into_iter().collect::<Vec<_>>(), ["v.mha", "w.mha"]);
}

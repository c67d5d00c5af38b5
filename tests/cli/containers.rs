//! Image files of every kind, in and out of the commands: the same sweep, volume and picture in
//! every file format.

use drivers::replay::{Replay, SequenceSettings};
use sonoweave_core::{Device as _, Next, Reading};

use super::place::{Place, SMALL_BEDSIDE, Volume};
use super::sequence::Sequence;

const SEQUENCES: [&str; 5] = ["s.igs.mha", "s.mhd", "s.igs.nrrd", "s.seq.nrrd", "s.nhdr"];
const VOLUMES: [&str; 6] = ["v.mha", "v.mhd", "v.nrrd", "v.nhdr", "v.nii", "v.nii.gz"];
const SWEEP: &str = "--frames 6 --image-size 40x30 --pixel 0.5 --gap 0.6";

/// Runs a reconstruction; notes on planes, kernels and unseen voxels are permitted.
fn succeeds(place: &Place, words: &str) {
    let run = place.run(words);
    assert_eq!(run.code, 0, "{words}: {}", run.stderr);
}

#[test]
fn sweep_gives_the_same_volume_from_every_container() {
    let place = Place::new();
    let mut first = None;
    for (name, packed) in SEQUENCES.iter().flat_map(|name| [(name, ""), (name, "--compress")]) {
        place.does(&format!("phantom -o {name} {SWEEP} {packed}"));
        succeeds(&place, &format!("reconstruct {name} -o v.mha --spacing 0.5"));
        let volume = place.volume("v.mha");
        let (header, values) = first.get_or_insert_with(|| (volume.header.clone(), volume.values.clone()));
        assert!(*values == volume.values, "{name} {packed}");
        assert_eq!(
            (header.size, header.origin, header.axes),
            (volume.header.size, volume.header.origin, volume.header.axes)
        );
        let said = place.does(&format!("inspect {name}"));
        assert!(said.contains("tracked sequence") && said.contains("SonoweavePhantom = "), "{said}");
    }
}

#[test]
fn volume_keeps_geometry_and_provenance_in_every_format() {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha {SWEEP} --trajectory freehand"));
    let mut pictures = Vec::new();
    succeeds(&place, "reconstruct s.mha -o first.mha --spacing 0.5 --type f32");
    let first = place.volume("first.mha");
    for name in VOLUMES {
        succeeds(&place, &format!("reconstruct s.mha -o {name} --spacing 0.5 --type f32"));
        let volume = place.volume(name);
        assert!(volume.values == first.values, "{name}");
        for (got, put) in [(volume.header.spacing, first.header.spacing), (volume.header.origin, first.header.origin)] {
            // NIfTI has single precision.
            assert!((0..3).all(|a| (got[a] - put[a]).abs() < 1e-5), "{name}: {got:?} is not {put:?}");
        }
        for field in ["SonoweaveFrame", "SonoweaveInput", "SonoweaveUnseen", "SonoweaveSlicesBox"] {
            assert_eq!(volume.field(field), first.field(field), "{name}");
        }
        succeeds(&place, &format!("render {name} -o p.png --image-size 40x30"));
        pictures.push(place.get("p.png"));
        let said = place.does(&format!("inspect {name} --against first.mha"));
        assert!(said.contains("volume") && said.contains("RMSE"), "{said}");
    }
    assert!(pictures.iter().all(|picture| *picture == pictures[0]), "one picture of all files");
}

#[test]
fn colour_sweep_uses_luma_and_says_so() {
    let place = Place::new();
    place.put("grey.mha", Sequence::default().bytes());
    let lines = "UltrasoundImageOrientation = MFA\nUltrasoundImageType = RGB_COLOR\n";
    place.put("colour.mha", Sequence { channels: 3, lines: lines.into(), ..Sequence::default() }.bytes());
    succeeds(&place, "reconstruct grey.mha -o grey-v.mha --spacing 0.5");
    let run = place.run("reconstruct colour.mha -o colour-v.mha --spacing 0.5 --json=s.json");
    assert!(run.code == 0 && run.stderr.contains("the luma is the grey value (ITU-R BT.601)"), "{}", run.stderr);
    assert!(place.volume("grey-v.mha").values == place.volume("colour-v.mha").values, "grey stays what it was");
    assert!(place.json("s.json")["notes"].to_string().contains("BT.601"));
    let said = place.does("inspect colour.mha");
    assert!(said.contains("3 channels") && said.contains("the luma is the grey value"), "{said}");
}

#[test]
fn nifti_without_geometry_can_only_be_inspected() {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha {SWEEP} --truth t.nii --spacing 1"));
    place.does("inspect t.nii --against t.nii");
    let mut bytes = place.get("t.nii");
    bytes[252..256].fill(0);
    place.put("t.nii", bytes);
    let said = place.does("inspect t.nii");
    assert!(said.contains("not given: neither sform nor qform"), "{said}");
    place.refuses("render t.nii -o p.png", &["t.nii: has no place in space", "sform"]);
    place.refuses("inspect t.nii --against t.nii", &["does not say where it lies"]);
    place.refuses("reconstruct t.nii -o v.mha", &["t.nii: field sizeof_hdr", "not a sequence of frames"]);
}

/// Checks that two sequences have the same frames: all readings, and the fields of the whole
/// file.
fn same(place: &Place, names: [&str; 2]) {
    let [first, second] = names.map(|name| {
        let mut device = Replay::open(&SequenceSettings::new(place.path(name))).unwrap();
        device.start().unwrap();
        let mut readings = Vec::new();
        while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE).unwrap() {
            readings.push(match reading {
                Reading::Frame(frame) => format!("{frame:?}"),
                other => format!("{other:?}"),
            });
        }
        (readings, device.describe().fields.clone())
    });
    assert!(first == second, "{names:?} differ");
    assert!(!first.0.is_empty());
}

#[test]
fn sequence_survives_every_container_and_a_session() {
    let place = Place::new();
    place.does(&format!("phantom -o s.igs.mha {SWEEP} --calibration c.toml"));
    let mut last = "s.igs.mha".to_owned();
    for (n, name) in ["a.igs.nrrd", "b.seq.nrrd", "c.mhd", "d.nhdr", "e.mcap", "f.igs.mha"].iter().enumerate() {
        let packed = if n % 2 == 0 { "" } else { "--compress" };
        let said = place.does(&format!("convert {last} -o {name} {packed}"));
        assert!(said.starts_with(name) && said.contains("6 frames"), "{said}");
        last = (*name).to_owned();
    }
    // A session gives each frame its arrival time; the rest is unchanged.
    same(&place, ["s.igs.mha", "d.nhdr"]);
    same(&place, ["s.igs.mha", "f.igs.mha"]);
}

#[test]
fn parts_of_a_recording_keep_their_position() {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha {SWEEP}"));
    place.does("convert s.mha -o part.nrrd --frames 1..5 --crop 10,5,20,15 --orientation FU");
    succeeds(&place, "reconstruct s.mha -o whole.mha --spacing 0.5 --frames 1..5 --clip 10,5,20,15 --path general");
    succeeds(&place, "reconstruct part.nrrd -o part.mha --spacing 0.5 --path general --clip none");
    let (whole, part) = (place.volume("whole.mha"), place.volume("part.mha"));
    assert_eq!((whole.header.size, whole.header.origin), (part.header.size, part.header.origin));
    let worst = whole.values.iter().zip(&part.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= 1.0, "a voxel differs by {worst} grey levels");
    assert!(place.does("inspect part.nrrd").contains("SonoweaveCrop = 10 5 20 15"));
    place.refuses("convert s.mha -o x.mha --crop 30,0,20,5", &["s.mha: the crop of 20×5 pixels", "40×30"]);
    place.refuses("convert s.mha -o x.mha --frames 6..", &["s.mha: has 6 frames, none of them"]);
    place.refuses("convert s.mha -o x.mha --orientation XX", &["the orientation \"XX\" is unknown"]);
    place.refuses("convert part.nrrd -o x.mha --crop 0,0,5,5", &["was cropped before"]);
    place.refuses("convert s.mha -o s.mha", &["is the input"]);
    place.refuses("convert s.mha -o x.nii", &["x.nii: sequences are written as .mha"]);
    place.refuses("convert s.mha -o x.mha --station 1=Probe", &["is not a session"]);
    place.refuses("convert s.mha -o x.dcm", &["x.dcm: use `sonoweave dicom` to write DICOM"]);
}

#[test]
fn exported_images_equal_the_frames() {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha {SWEEP}"));
    place.does("convert s.mha -o f%03d.png --frames 2..4");
    let names: Vec<_> = place.names().into_iter().collect();
    assert_eq!(names, ["f002.png", "f003.png", "s.mha"]);
    let bytes = place.get("s.mha");
    let pixels = &bytes[bytes.len() - 6 * 1200..];
    let picture = image::load_from_memory(&place.get("f003.png")).unwrap();
    assert_eq!(picture.to_luma8().into_raw(), pixels[3 * 1200..4 * 1200]);
    std::fs::create_dir(place.path("out")).unwrap();
    place.does("convert s.mha -o out --crop 1,2,3,4");
    let picture = image::open(place.path("out/frame-0005.png")).unwrap().to_luma8();
    assert_eq!((picture.dimensions(), picture.get_pixel(0, 0).0[0]), ((3, 4), pixels[5 * 1200 + 2 * 40 + 1]));
}

#[test]
fn numbered_images_convert_back_to_a_sequence() {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha {SWEEP}"));
    place.does("convert s.mha -o f%03d.png --frames 2..5");
    std::fs::create_dir(place.path("out")).unwrap();
    place.does("convert s.mha -o out --frames 2..5");
    place.does("convert f%03d.png -o back.mha --rate 20");
    place.does("convert out -o folder.mha");
    place.does("convert s.mha -o part.mha --frames 2..5");
    let pixels = |name: &str| {
        let bytes = place.get(name);
        bytes[bytes.len() - 3 * 1200..].to_vec()
    };
    assert!(pixels("back.mha") == pixels("part.mha") && pixels("folder.mha") == pixels("part.mha"));
    let text = |name: &str| String::from_utf8_lossy(&place.get(name)).into_owned();
    assert!(text("back.mha").contains("Seq_Frame0002_Timestamp = 0.1\n"), "{}", text("back.mha"));
    assert!(!text("folder.mha").contains("Timestamp"), "{}", text("folder.mha"));
    place.refuses_with("convert g%03d.png -o x.mha", &["matches no file"]);
    place.refuses_with("convert s.mha -o x.mha --rate 30", &["leave out --rate, which is for numbered pictures"]);
    place.put("f004.png", &place.get("f004.png")[..60]);
    place.refuses_with("convert f%03d.png -o x.mha", &["f004.png", "cannot be read as PNG"]);
    std::fs::remove_file(place.path("f003.png")).unwrap();
    place.refuses_with("convert f%03d.png -o x.mha", &["f002.png and ", "f004.png", "add the missing frame"]);
}

#[test]
fn identifying_fields_are_left_out_and_named() {
    let place = Place::new();
    let lines = "UltrasoundImageOrientation = MFA\nPatientName = B. Doe\n";
    place.put("s.mha", Sequence { lines: lines.into(), ..Sequence::default() }.bytes());
    let said = place.does("convert s.mha -o a.seq.nrrd --anonymize --clip none");
    assert!(said.contains("left out: PatientName\n"), "{said}");
    assert!(!String::from_utf8_lossy(&place.get("a.seq.nrrd")).contains("Doe"));
    succeeds(&place, "reconstruct s.mha -o v.mha --spacing 0.5");
    place.does("convert v.mha -o a.nii.gz --anonymize");
    let (before, after) = (place.volume("v.mha"), place.volume("a.nii.gz"));
    assert_eq!(before.field("SonoweaveUnseen"), after.field("SonoweaveUnseen"));
    assert!(!after.header.fields.iter().any(|(name, value)| name == "SonoweaveInput" || value.contains("s.mha")));
    assert!(before.values == after.values);
    place.refuses("convert v.mha -o x.mha --frames 1..2", &["v.mha: is a volume; leave out --frames"]);
}

/// Returns the small configuration with latencies, and with a given image pose.
fn late() -> String {
    let latency = "size = \"96x80\"\nlatency_ms = 40.0\n";
    let late = SMALL_BEDSIDE
        .replace("size = \"96x80\"\n", latency)
        .replace("reference_station = 2\n", "reference_station = 2\nlatency_ms = 15.0\n");
    let matrix = IMAGE_TO_PROBE.replace(',', ", ");
    format!(
        "{late}[virtual.grabber]\nlatency_ms = 40.0\n[calibration]\nclip_px = \"none\"\nimage_to_probe = [{matrix}]\n"
    )
}

const IMAGE_TO_PROBE: &str = "1.8,0.0,0.0,-86.0,0.0,1.8,0.0,12.0,0.0,0.0,1.8,0.0,0.0,0.0,0.0,1.0";

#[test]
fn converted_session_has_the_poses_of_its_replay() {
    let place = Place::new();
    let session = place.recorded(&late(), 2);
    place.does(&format!("convert {session} -o s.igs.mha"));
    let mut device = Replay::open(&SequenceSettings::new(place.path("s.igs.mha"))).unwrap();
    device.start().unwrap();
    let (mut frames, mut found, mut last) = (0, std::collections::BTreeMap::new(), 0);
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE).unwrap() {
        match reading {
            Reading::Frame(frame) => {
                let host = frame.fields.iter().find(|(name, _)| name == "SonoweaveHostNs").unwrap();
                let host: i64 = host.1.parse().unwrap();
                // Acquired 40 ms before it was received.
                let before_ns = host - (frame.stamp.source_s.unwrap() * 1e9).round() as i64;
                assert!((before_ns - 40_000_000).abs() < 3_000_000 && host > last, "{before_ns} ns before {host}");
                assert_eq!(frame.pixels.len(), 96 * 80);
                (last, frames) = (host, frames + 1);
            }
            Reading::NamedTransform(transform) => {
                let count: &mut u32 = found.entry(transform.name()).or_default();
                *count += u32::from(transform.status == sonoweave_core::reading::Status::Ok);
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(frames > 30, "{frames} frames");
    assert_eq!(found.keys().collect::<Vec<_>>(), ["ProbeToTracker", "ReferenceToTracker"]);
    assert!(found.values().all(|ok| *ok + 8 >= frames), "{found:?} of {frames}: only the first have none");
    // The volume is the same both ways.
    let run = place.run(&format!("replay {session} --all -o replayed.mha"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    succeeds(
        &place,
        &format!(
            "reconstruct s.igs.mha -o reconstructed.mha --image-to-probe {IMAGE_TO_PROBE} --clip none --spacing 1"
        ),
    );
    let (replayed, reconstructed) = (place.volume("replayed.mha"), place.volume("reconstructed.mha"));
    let place_of = |volume: &Volume| (volume.header.size, volume.header.origin, volume.header.spacing);
    assert_eq!(place_of(&replayed), place_of(&reconstructed));
    assert!(replayed.values.iter().any(|value| *value > 0.0) && replayed.values == reconstructed.values);
    // Both record the unseen value and the settings.
    for name in ["SonoweaveUnseen", "SonoweaveMethod", "SonoweaveFrames"] {
        assert_eq!(replayed.field(name), reconstructed.field(name), "{name}");
    }
    let input = replayed.field("SonoweaveInput");
    assert!(input.starts_with("SESSION-") && input.ends_with(".mcap"), "{input}");
    let said = place.does("inspect s.igs.mha");
    assert!(said.contains("ProbeToTracker"), "{said}");
    place.does(&format!("convert {session} -o named.nrrd --station 2=Patient --frames 0..9"));
    assert!(String::from_utf8_lossy(&place.get("named.nrrd")).contains("Seq_Frame0008_PatientToTrackerTransform:="));
    // There and back again, nothing is lost that a sequence can hold.
    place.does("convert s.igs.mha -o back.mcap");
    place.does("convert back.mcap -o again.seq.nrrd");
    same(&place, ["s.igs.mha", "again.seq.nrrd"]);
}

#[test]
fn session_frames_are_compressed_on_request() {
    let place = Place::new();
    let session = place.recorded(SMALL_BEDSIDE, 1);
    for (plain, small) in [("p.igs.mha", "c.igs.mha"), ("p.seq.nrrd", "c.seq.nrrd")] {
        place.does(&format!("convert {session} -o {plain}"));
        place.does(&format!("convert {session} -o {small} --compress"));
        let [of_plain, of_small] = [plain, small].map(|name| place.get(name).len());
        assert!(of_small < of_plain * 9 / 10, "{small}: {of_small} bytes, {of_plain} without");
        assert!(place.does(&format!("inspect {small}")).contains("compressed ("), "{small}");
        same(&place, [plain, small]);
    }
    same(&place, ["p.igs.mha", "c.seq.nrrd"]);
}

#[test]
fn pixel_spacing_survives_containers_session_and_rotation() {
    let place = Place::new();
    let lines = "UltrasoundImageOrientation = MFA\nElementSpacing = 0.2 0.125 1\nPatientName = B. Doe\n";
    place.put("s.igs.mha", Sequence { lines: lines.into(), ..Sequence::default() }.bytes());
    let mut last = "s.igs.mha";
    for name in ["a.igs.nrrd", "b.seq.nrrd", "c.mhd", "d.mcap", "e.nhdr", "f.igs.mha"] {
        place.does(&format!("convert {last} -o {name}"));
        last = name;
    }
    let text = |name: &str| String::from_utf8_lossy(&place.get(name)).into_owned();
    assert!(text("f.igs.mha").contains("\nElementSpacing = 0.2 0.125 1\n"));
    assert!(text("e.nhdr").contains("\nspace directions: (0.2,0) (0,0.125) none\n"), "{}", text("e.nhdr"));
    assert!(place.does("inspect e.nhdr").contains("ElementSpacing = 0.2 0.125"));
    place.does("convert e.nhdr -o t.mha --orientation FM --anonymize --clip none");
    assert!(text("t.mha").contains("\nElementSpacing = 0.125 0.2 1\n") && !text("t.mha").contains("Doe"));
}

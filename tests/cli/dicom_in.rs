//! DICOM input: our own images come back as the recording and the volume that were written.

use drivers::replay::{Replay, SequenceSettings};
use sonoweave_core::reading::{Frame, NamedTransform};
use sonoweave_core::{Device as _, Next, Reading};

use super::place::Place;
use super::sequence::{Sequence, pose};

const RECONSTRUCT: &str = "--path general --clip none --spacing 0.5 --sigma 0.5,0.5,0.7";

/// Returns all readings of a sequence.
pub(super) fn readings(place: &Place, name: &str) -> (Vec<Frame>, Vec<NamedTransform>) {
    let mut device = Replay::open(&SequenceSettings::new(place.path(name))).unwrap();
    device.start().unwrap();
    let (mut frames, mut transforms) = (Vec::new(), Vec::new());
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE).unwrap() {
        match reading {
            Reading::Frame(frame) => frames.push(frame),
            Reading::NamedTransform(transform) => transforms.push(transform),
            other => panic!("{other:?}"),
        }
    }
    (frames, transforms)
}

#[test]
fn written_sweep_is_read_back_to_the_bit() {
    let place = Place::new();
    // Poses and times that no short decimal number equals, and two frames without pose.
    let turned = |frame: u32| {
        let (sin, cos) = (0.1 * f64::from(frame) + 0.7).sin_cos();
        let [a, b, z] = [cos / 3.0, sin / 3.0, f64::from(frame) / 7.0];
        format!("{a} {} 0 {z} {b} {a} 0 1e-7 0 0 {} {z} 0 0 0 1", -b, 1.0 / 3.0)
    };
    let status = |frame| if frame == 2 { "INVALID" } else { "OK" };
    let numbered: String =
        (0..6).map(|frame| format!("Seq_Frame{frame:04}_FrameNumber = {}\n", 7 * frame + 3)).collect();
    let whole = Sequence { pose: turned, status, ..Sequence::default() };
    let text = String::from_utf8_lossy(&whole.bytes()[..whole.header(None).len()]).into_owned();
    let bytes = [text.replace("ElementDataFile", &format!("{numbered}ElementDataFile")).into_bytes(), whole.pixels()];
    place.put("s.mha", bytes.concat());
    place.does("dicom s.mha -o s.dcm");
    let said = place.does("inspect s.dcm");
    assert!(said.contains("tracked sequence") && said.contains("ImageToReference  5 OK, 1 INVALID"), "{said}");
    place.does("convert s.dcm -o back.mha");
    let (frames, transforms) = readings(&place, "s.mha");
    for name in ["s.dcm", "back.mha"] {
        let (now, poses) = readings(&place, name);
        assert_eq!((now.len(), poses.len()), (6, 6));
        for (a, b) in frames.iter().zip(&now) {
            assert!(a.pixels == b.pixels && a.status == b.status, "{name}");
            assert_eq!(a.stamp.source_s.map(f64::to_bits), b.stamp.source_s.map(f64::to_bits), "{name}");
            assert_eq!((a.size, a.frame_number, a.stamp.item), (b.size, b.frame_number, b.stamp.item), "{name}");
        }
        for (a, b) in transforms.iter().zip(&poses) {
            assert_eq!((a.name(), &a.status), (b.name(), &b.status), "{name}");
            let is_known = a.status == sonoweave_core::reading::Status::Ok;
            assert!(!is_known || a.matrix.map(f64::to_bits) == b.matrix.map(f64::to_bits), "{name} {a:?} {b:?}");
        }
    }
    for name in ["s.mha", "s.dcm", "back.mha"] {
        let run = place.run(&format!("reconstruct {name} -o v-{name}.mha {RECONSTRUCT} --json=j-{name}.json"));
        assert!(run.code == 0 && run.stderr.contains("5 of 6 frames used"), "{}", run.stderr);
    }
    for name in ["s.dcm", "back.mha"] {
        let [one, other] = ["s.mha", name].map(|name| place.volume(&format!("v-{name}.mha")));
        assert!(one.values == other.values && one.header.origin == other.header.origin, "{name}");
        let [one, other] = ["s.mha", name].map(|name| place.json(&format!("j-{name}.json"))["frames"].clone());
        assert_eq!(one, other);
        assert!(one.to_string().contains("pose"), "a frame is refused: {one}");
    }
}

#[test]
fn written_volume_is_read_back_to_the_bit() {
    let place = Place::new();
    place.does("phantom -o s.mha --frames 9 --image-size 40x30 --pixel 0.5 --gap 0.6 --trajectory fan");
    for (name, kind) in [("a", "u8"), ("b", "u16")] {
        let run = place.run(&format!(
            "reconstruct s.mha -o {name}.mha --path planar --spacing 0.37 --type {kind} --window 3,201 --unseen 5"
        ));
        assert_eq!(run.code, 0, "{}", run.stderr);
        place.does(&format!("dicom {name}.mha -o {name}.dcm"));
        place.does(&format!("convert {name}.dcm -o {name}-back.mha"));
        let first = place.volume(&format!("{name}.mha"));
        for other in [format!("{name}.dcm"), format!("{name}-back.mha")] {
            let volume = place.volume(&other);
            assert!(volume.values == first.values && volume.header.pixel == first.header.pixel, "{other}");
            let bits = |header: &formats::image::VolumeHeader| {
                let place = [header.spacing, header.origin].into_iter().chain(header.axes);
                place.flatten().map(f64::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(bits(&volume.header), bits(&first.header), "{other}");
            for field in
                ["SonoweaveUnseen", "SonoweaveRange", "SonoweaveFrame", "SonoweaveSlicesBox", "SonoweaveFrames"]
            {
                assert_eq!(volume.field(field), first.field(field), "{other}");
            }
        }
        let bytes = place.get(&format!("{name}-back.mha"));
        assert!(!bytes.windows(5).any(|part| part == b"s.mha"), "a DICOM file names no recording");
        let said = place.does(&format!("inspect {name}.dcm --against {name}.mha"));
        assert!(said.contains("RMSE            0.000"), "{said}");
        for file in [format!("{name}.mha"), format!("{name}.dcm")] {
            let run = place.run(&format!("render {file} -o {file}.png --image-size 40x30"));
            assert_eq!(run.code, 0, "{}", run.stderr);
        }
        assert!(place.get(&format!("{name}.mha.png")) == place.get(&format!("{name}.dcm.png")));
        let shown = place.run(&format!("compare {name}.mha {name}.dcm -o {name}.png --json={name}.json"));
        assert_eq!(shown.code, 0, "{}", shown.stderr);
        assert!(place.json(&format!("{name}.json")).to_string().contains("\"rmse\":0.0"), "{}", shown.stdout);
    }
}

#[test]
fn long_sweep_is_written_and_read_back() {
    let place = Place::new();
    let long = Sequence {
        size: [4, 3],
        frames: 9000,
        pose: |frame| pose(f64::from(frame) / 7.0),
        pixel: |u, v, frame| vec![(u + 4 * v + frame % 200) as u8],
        ..Sequence::default()
    };
    place.put("s.mha", long.bytes());
    place.does("dicom s.mha -o s.dcm");
    let [(frames, transforms), (now, poses)] = ["s.mha", "s.dcm"].map(|name| readings(&place, name));
    assert_eq!((now.len(), poses.len()), (9000, 9000));
    assert!(frames.iter().zip(&now).all(|(a, b)| a.pixels == b.pixels && a.stamp.source_s == b.stamp.source_s));
    assert!(transforms.iter().zip(&poses).all(|(a, b)| a.matrix == b.matrix));
}

#[test]
fn sweep_without_poses_is_converted_but_not_inserted() {
    let place = Place::new();
    place.put("s.mha", Sequence { transform: "ProbeToTracker", ..Sequence::default() }.bytes());
    place.does("dicom s.mha -o s.dcm");
    let (frames, transforms) = readings(&place, "s.dcm");
    assert!(frames.len() == 6 && transforms.is_empty());
    place.does("convert s.dcm -o f%02d.png");
    assert!(place.names().contains("f05.png"));
    place.refuses("reconstruct s.dcm -o v.mha", &["a sequence without transforms cannot be placed"]);
    let cut = place.get("s.dcm");
    place.put("cut.dcm", &cut[..cut.len() - 100]);
    place.refuses("reconstruct cut.dcm -o v.mha", &["cut.dcm: field NumberOfFrames", "cut short"]);
    place.refuses("render s.dcm -o p.png", &["s.dcm: field SOPClassUID", "reconstruct it first"]);
}

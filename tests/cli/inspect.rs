//! `inspect`: every kind of file is recognised by its content, as text and as JSON.

use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::place::Place;
use super::sequence::{Sequence, pose};

fn report(place: &Place, words: &str) -> Value {
    serde_json::from_str(&place.does(&format!("inspect --json {words}"))).unwrap()
}

#[test]
fn sequence_is_described() {
    let place = Place::new();
    let sequence = Sequence {
        zlib: true,
        status: |frame| if frame < 2 { "INVALID" } else { "OK" },
        lines: "UltrasoundImageOrientation = FM\nUltrasoundImageType = BRIGHTNESS\nWard = 7\n".into(),
        ..Sequence::default()
    };
    // The file name is irrelevant.
    place.put("anything.dat", sequence.bytes());
    let r = report(&place, "anything.dat");
    assert_eq!((&r["kind"], &r["items"]), (&json!("sequence"), &json!(6)));
    assert_eq!(
        r["picture"],
        json!({
            "size": [40, 30], "scalar": "u8", "channels": 1, "format": "MetaImage", "encoding": "compressed (zlib)", "compressed": true,
            "big_endian": false
        })
    );
    assert_eq!((&r["orientation"], &r["image_type"]), (&json!("FM"), &json!("BRIGHTNESS")));
    assert_eq!(r["transforms"], json!([{ "name": "ImageToReference", "status": { "INVALID": 2, "OK": 4 } }]));
    assert_eq!(r["image_status"], json!({ "OK": 6 }));
    assert_eq!((&r["time"]["first_s"], &r["time"]["last_s"]), (&json!(0.0), &json!(0.5)));
    assert!((r["time"]["rate_hz"].as_f64().unwrap() - 10.0).abs() < 1e-9);
    assert!((r["time"]["interval_s"]["median"].as_f64().unwrap() - 0.1).abs() < 1e-9);
    assert_eq!(r["header_fields"], json!([["Ward", "7"]]));
    let p = &r["placement"];
    assert_eq!(
        (&p["route"], &p["world"], &p["problem"]),
        (&json!("Image → Reference"), &json!("Reference"), &Value::Null)
    );
    assert_eq!(p["pixel_mm"], json!([0.5, 0.5]));
    assert_eq!((&p["sweep_mm"], &p["gap_mm"]["max"]), (&json!(3.0), &json!(1.0)));
    // Slices 1 mm apart every 0.1 s, at the default spacing of 0.5 mm; six transforms, of which
    // four are valid.
    let h = &r["histograms"];
    let filled = |name: &str| {
        let [from, width] = ["from", "width"].map(|key| h[name][key].as_f64().unwrap());
        let counts = h[name]["counts"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap());
        let bins = counts.enumerate().filter(|(_, n)| *n > 0).map(|(i, n)| (from + i as f64 * width, width, n));
        bins.collect::<Vec<_>>()
    };
    for (name, value, n) in
        [("interval_ms", 100.0, 5), ("speed_mm_s", 10.0, 3), ("gap_mm", 1.0, 15), ("gap_voxels", 2.0, 15)]
    {
        let (from, width, count) =
            (filled(name)[0].0, filled(name)[0].1, filled(name).iter().map(|b| b.2).sum::<u64>());
        assert!(count == n && (from - value).abs() <= width * 1.01, "{name}: {:?}", filled(name));
    }
    assert_eq!((&h["status"], &h["spacing_mm"]), (&json!({ "INVALID": 2, "OK": 4 }), &json!(0.5)));
    // FM: the first stored axis is depth.
    assert_eq!(p["bounds_mm"], json!([[0.0, 0.0, 2.0], [14.5, 19.5, 5.0]]));
    assert_eq!(p["frames"], json!({ "total": 6, "used": 4, "waiting": 0, "refused": { "pose_invalid": 2 } }));

    let text = place.does("inspect anything.dat");
    for line in [
        "anything.dat: tracked sequence, ",
        "  frames          6\n",
        "  picture         40×30 pixels, u8, 1 channel, compressed (zlib)\n",
        "  transforms      ImageToReference  4 OK, 2 INVALID\n",
        "  gaps            1.000 mm between slices on average; 90 % up to 1.000, the largest 1.000\n",
        "2 × pose_invalid, first frame 0: ",
        "the sweep\n  intervals, ms   ",
        "  speed, mm/s     ",
        "voxels of 0.500 mm\n",
        "  status          INVALID  2 ████████████████████\n                       OK  4 ████████████████████████████████████████\n",
    ] {
        assert!(text.contains(line), "{text} lacks {line:?}");
    }
}

#[test]
fn unplaced_sequence_reports_reason_and_refusals() {
    let place = Place::new();
    place.put("s.mha", Sequence { transform: "ProbeToTracker", ..Sequence::default() }.bytes());
    let p = &report(&place, "s.mha")["placement"];
    assert!(p["problem"].as_str().unwrap().contains("give a configuration with ImageToProbe"), "{p}");
    assert_eq!(p["frames"]["refused"], json!({ "no_path": 6 }));
    let rf = Sequence {
        transform: "ProbeToTracker",
        lines: "UltrasoundImageType = RF_REAL\n".into(),
        ..Sequence::default()
    };
    place.put("s.mha", rf.bytes());
    assert_eq!(report(&place, "s.mha")["placement"]["frames"]["refused"], json!({ "image_type": 6 }));
    // A calibration places it, in another world if one is named.
    place.put("s.mha", Sequence { transform: "ProbeToTracker", ..Sequence::default() }.bytes());
    place.put(
        "c.toml",
        "format = \"sonoweave-calibration\"\nversion = 1\n[image_to_probe]\nmatrix = [0.1,0,0,0, 0,0.1,0,0, 0,0,0.1,0, 0,0,0,1]\n\
         [[transform]]\nfrom = \"Tracker\"\nto = \"Table\"\nmatrix = [1,0,0,5, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n",
    );
    let p = &report(&place, "s.mha --config c.toml --world Table")["placement"];
    assert_eq!(p["route"], "Image → Probe → Tracker → Table");
}

#[test]
fn volume_is_described_with_values_and_provenance() {
    let place = Place::new();
    place.put("s.mha", Sequence { pixel: |_, _, f| vec![50 + f as u8], ..Sequence::default() }.bytes());
    place.does_narrowly("reconstruct s.mha -o v.mha --type f32 --spacing 0.5,0.5,1 --sigma 0.5,0.5,0.3 --clip none");
    let r = report(&place, "v.mha");
    let volume = place.volume("v.mha");
    assert_eq!(r["kind"], "volume");
    assert_eq!((&r["size"], &r["origin"]), (&json!(volume.header.size), &json!(volume.header.origin)));
    assert_eq!((&r["spacing"], &r["scalar"]), (&json!([0.5, 0.5, 1.0]), &json!("f32")));
    let mean = volume.values.iter().map(|v| f64::from(*v)).sum::<f64>() / volume.values.len() as f64;
    assert!((r["values"]["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
    let zeros = volume.values.iter().filter(|v| **v == 0.0).count();
    assert_eq!(r["values"]["zero"], json!(zeros));
    assert_eq!(r["values"]["max"].as_f64().unwrap() as f32, volume.values.iter().copied().fold(0.0, f32::max));
    let text = place.does("inspect v.mha");
    assert!(text.contains("SonoweaveRoute = Image → Reference"), "{text}");
}

#[test]
fn volumes_are_compared_where_both_seen() {
    let place = Place::new();
    let at = |grey: fn(u32, u32, u32) -> Vec<u8>, z: fn(u32) -> String, flags: &str, name: &str| {
        place.put("s.mha", Sequence { pixel: grey, pose: z, ..Sequence::default() }.bytes());
        place.does(&format!(
            "reconstruct s.mha --path general -o {name} --weights w_{name} --clip none --spacing 0.5 {flags}"
        ));
    };
    at(|_, _, _| vec![103], |f| pose(f64::from(f)), "", "a.mha");
    at(|_, _, _| vec![100], |f| pose(f64::from(f) + 2.0), "", "b.mha");
    let c = &report(&place, "a.mha --against b.mha")["comparison"];
    assert_eq!((&c["rmse"], &c["bias"], &c["max"]), (&json!(3.0), &json!(3.0), &json!(3.0)));
    assert!(c["voxels"].as_u64().unwrap() > 1000 && c["voxels"].as_u64() <= c["overlap"].as_u64(), "{c}");
    // Half of this frame is black: with the weights, black is a value.
    at(|u, _, _| vec![if u < 20 { 0 } else { 103 }], |f| pose(f64::from(f)), "", "h.mha");
    let c = &report(&place, "h.mha --against a.mha")["comparison"];
    assert!(c["bias"].as_f64().unwrap() > -15.0, "{c}");
    let c = &report(&place, "h.mha --against a.mha --weights w_h.mha")["comparison"];
    assert!((c["bias"].as_f64().unwrap() + 51.5).abs() < 3.0 && c["max"] == json!(103.0), "{c}");

    // If the header notes another unseen value, black is a value without weights too.
    at(|u, _, _| vec![if u < 20 { 0 } else { 103 }], |f| pose(f64::from(f)), "--unseen 255", "u.mha");
    at(|_, _, _| vec![103], |f| pose(f64::from(f)), "--unseen 255", "v.mha");
    let c = &report(&place, "u.mha --against v.mha")["comparison"];
    assert!((c["bias"].as_f64().unwrap() + 51.5).abs() < 3.0 && c["max"] == json!(103.0), "{c}");

    at(|_, _, _| vec![100], |f| pose(f64::from(f)), "--origin 0.2,0,0", "c.mha");
    place.refuses(
        "inspect a.mha --against c.mha",
        &["a.mha and c.mha cannot be compared", "of a voxel apart along axis 0"],
    );
    place.refuses("inspect a.mha --against none.mha", &["none.mha: "]);
    place.refuses("inspect a.mha --against b.mha --weights w_b.mha", &["not those of this volume"]);
    place.refuses("inspect s.mha --against a.mha", &["s.mha: is no volume"]);
}

#[test]
fn configurations_are_described() {
    let place = Place::new();
    place.put(
        "plus",
        "<PlusConfiguration><CoordinateDefinitions><Transform From=\"Image\" To=\"Probe\" \
         Matrix=\"0 0.2 0 1 0.1 0 0 2 0 0 1 3 0 0 0 1\"/></CoordinateDefinitions>\
         <VolumeReconstruction OutputSpacing=\"1 1 2\" ClipRectangleOrigin=\"5 6\" ClipRectangleSize=\"7 8\" FillHoles=\"ON\"/></PlusConfiguration>",
    );
    let r = report(&place, "plus");
    assert_eq!((&r["kind"], &r["source"]), (&json!("configuration"), &json!("plus")));
    assert_eq!(r["pixel_mm"], json!([0.1, 0.2]));
    assert_eq!(r["clip"], json!({ "x": 5, "y": 6, "width": 7, "height": 8 }));
    assert_eq!(r["transforms"][0]["from"], "Image");
    let text = place.does("inspect plus");
    assert!(text.starts_with("plus: PLUS configuration\n") && text.contains("FillHoles=\"ON\""), "{text}");
    assert!(text.contains("\nImageToProbe\n") && text.contains("7×8 pixels from column 5, row 6"), "{text}");

    place.does("phantom -o s.mha --frames 2 --image-size 64x48 --fan --calibration c.toml");
    let r = report(&place, "c.toml");
    assert_eq!((&r["kind"], &r["source"]), (&json!("configuration"), &json!("sonoweave")));
    assert!(r["provenance"].as_str().unwrap().starts_with("simulated: scene blobs"), "{r}");
    assert!(r["fan"]["radii_px"].is_array() && r["arm"].is_null(), "{r}");

    let turn = "[[arm.joint]]\ntype = \"revolute\"\nlength_mm = 250\ncounts_per_turn = 40000\nsign = -1\n";
    let slide = "[[arm.joint]]\ntype = \"prismatic\"\ndirection_deg = 90\nlength_mm = 40\ncounts_per_mm = 100\n";
    place.put("a.toml", format!("format = \"sonoweave-calibration\"\nversion = 1\n{turn}{slide}{turn}"));
    let r = report(&place, "a.toml");
    assert_eq!((&r["arm"][0]["type"], &r["arm"][0]["sign"]), (&json!("revolute"), &json!(-1)));
    assert_eq!((&r["arm"][1]["type"], &r["arm"][1]["direction_deg"]), (&json!("prismatic"), &json!(90.0)));
    let text = place.does("inspect a.toml");
    assert!(text.contains("revolute, link of 250 mm, 40000 counts a turn backwards, zero at 0"), "{text}");
    assert!(text.contains("prismatic at 90°, 40 mm at zero, 100 counts a mm, zero at 0"), "{text}");
}

#[test]
fn unknown_files_are_refused() {
    let place = Place::new();
    place.put("empty", "");
    place.put("text", "Dear diary,\n");
    place.put("bytes", [0xff, 0xd8, 0xff, 0xe0, 0, 16]);
    place.put("n.nrrd", "NRRD0004\ntype: uchar\n");
    place.put("broken.xml", "<CoordinateDefinitions>");
    place.put("short.mha", "ObjectType = Image\nNDims = 3\n");
    place.refuses("inspect empty", &["empty: is empty; copy or record it again"]);
    for name in ["text", "bytes"] {
        place.refuses(&format!("inspect {name}"), &[&format!("{name}: is of no known kind: neither MetaImage")]);
    }
    place.refuses("inspect n.nrrd", &["n.nrrd: ", "NRRD"]);
    place.refuses("inspect broken.xml", &["broken.xml: line 1"]);
    place.refuses("inspect short.mha", &["short.mha: field ElementDataFile (byte 29)"]);
    place.refuses("inspect none", &["none: reading failed: No such file"]);
    place.refuses("inspect .", &[".: is a folder"]);
    place.put("s.mha", Sequence::default().bytes());
    place.refuses("inspect s.mha --config none.xml", &["none.xml: "]);
}

#[test]
fn pixels_are_not_read() {
    let place = Place::new();
    let mut bytes = Sequence { zlib: true, ..Sequence::default() }.bytes();
    let length = bytes.len();
    // Damage that every reader of pixels would detect.
    bytes[length - 40..].fill(0xff);
    place.put("s.mha", bytes);
    assert_eq!(report(&place, "s.mha")["items"], 6);
}

#[test]
fn closed_stdout_is_not_an_error() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let mut child = Command::new(env!("CARGO_BIN_EXE_sonoweave"))
        .args(["inspect", "s.mha"])
        .current_dir(place.path("."))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// A session of two seconds with poses, frames and notes.
fn session(place: &Place) -> Vec<u8> {
    use formats::session::{About, SessionWriter, WriterOptions};
    use sonoweave_core::reading::{Frame, PixelType, Pose, Reading, Stamp, Status};

    let path = place.path("session.mcap");
    let file = std::fs::File::create_new(&path).unwrap();
    let second = 1_000_000_000;
    let about = About { monotonic_ns: second, realtime_ns: 1_795_303_817 * second, program: "sonoweave 1.2".into() };
    let mut session = SessionWriter::on(Box::new(file), &path, about, WriterOptions::new("sonoweave 1.2")).unwrap();
    let said = sonoweave_core::Description { name: "a unit".into(), ..sonoweave_core::Description::default() };
    let tracker = session.device("tracker", None, &said, None).unwrap();
    let grabber = session.device("grabber", None, &sonoweave_core::Description::default(), None).unwrap();
    session.note("settings", "{\"spacing_mm\": 0.5}", second).unwrap();
    for n in 0..200 {
        let at_ns = second + n * 10_000_000;
        let stamp = Stamp { item: n.cast_unsigned(), host_ns: Some(at_ns), ..Stamp::default() };
        let pose = Pose {
            stamp,
            station: 1,
            position_cm: [1.0, 2.0, 3.0],
            quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
            buttons: 0,
            distortion: None,
            code: None,
            status: Status::Ok,
        };
        session.write(tracker, &Reading::Pose(pose), at_ns).unwrap();
        if n % 4 == 0 {
            let frame = Frame {
                stamp,
                frame_number: None,
                status: Status::Ok,
                size: [20, 10],
                channels: 1,
                pixel: PixelType::U8,
                orientation: "".into(),
                image_type: String::new(),
                pixels: vec![n as u8; 200].into(),
                fields: Vec::new(),
            };
            session.write(grabber, &Reading::Frame(frame), at_ns).unwrap();
            session.note("decision", "{}", at_ns).unwrap();
        }
    }
    session.finish(3 * second).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn session_is_described_and_repaired() {
    let place = Place::new();
    let bytes = session(&place);
    let r = report(&place, "session.mcap");
    assert_eq!(
        (&r["kind"], &r["began"], &r["finished"]),
        (&json!("session"), &json!("2026-11-21 23:30:17"), &json!(true))
    );
    assert_eq!((&r["program"], &r["duration_s"]), (&json!("sonoweave 1.2"), &json!(2.0)));
    let topic = |r: &Value, name: &str| {
        let topics = r["topics"].as_array().unwrap();
        topics.iter().find(|topic| topic["topic"] == *name).cloned().unwrap_or_default()
    };
    let poses = topic(&r, "/tracker/pose/1");
    assert_eq!((&poses["messages"], &poses["missing"]), (&json!(200), &json!(0)));
    assert!((poses["rate_hz"].as_f64().unwrap() - 100.0).abs() < 1e-9);
    assert!((poses["longest_gap_s"].as_f64().unwrap() - 0.01).abs() < 1e-12);
    assert_eq!(topic(&r, "/grabber/image")["messages"], json!(50));
    assert_eq!(r["notes"], json!({ "decision": 50, "settings": 1 }));
    assert_eq!((&r["damage"], &r["losses"], &r["repaired"]), (&json!([]), &json!([]), &Value::Null));
    let text = place.does("inspect session.mcap");
    for line in [
        "session.mcap: session\n  began           2026-11-21 23:30:17 UTC\n  written by      sonoweave 1.2\n",
        "  duration        2.000 s\n",
        "  end             ended in order\n  notes           50 decision, 1 settings\n",
        "tracker: a unit\n  pose/1          200, 100.000 Hz, 0.010 s between two at most; ",
        "  image           50, 25.000 Hz, 0.040 s between two at most; ",
        "settings\n                  {\"spacing_mm\": 0.5}\n",
    ] {
        assert!(text.contains(line), "{text} lacks {line:?}");
    }
    assert!(!text.contains("missing"), "{text}");

    // One damaged byte in a frame, and a truncated end.
    let mut harmed = bytes.clone();
    let pictures: Vec<usize> =
        bytes.windows(4).enumerate().filter(|(_, four)| *four == b"IDAT").map(|(at, _)| at).collect();
    harmed[pictures[20]] ^= 1;
    harmed.truncate(pictures[45]);
    place.put("harmed.mcap", &harmed);
    let text = place.does("repair harmed.mcap -o whole.mcap");
    for line in ["broken off", "missing\n", " of /tracker/pose/1\n", "a chunk with a wrong checksum", "repaired\n"] {
        assert!(text.contains(line), "{text} lacks {line:?}");
    }
    let [harmed, whole] = ["harmed.mcap", "whole.mcap"].map(|file| report(&place, file));
    assert_eq!((&harmed["finished"], &whole["finished"], &whole["damage"]), (&json!(false), &json!(true), &json!([])));
    for name in ["/tracker/pose/1", "/grabber/image", "/note/decision"] {
        assert_eq!(topic(&harmed, name)["messages"], topic(&whole, name)["messages"]);
        assert!(topic(&whole, name)["missing"].as_u64().unwrap() > 5);
    }
    let why = whole["losses"][0]["why"].as_str().unwrap();
    assert_eq!(why, "repaired: the session was broken off; 1 damaged part is left out");
    place.put("none.mcap", "nothing");
    place.put("text.txt", "nothing");
    for (words, said) in [
        ("repair harmed.mcap -o whole.mcap", "exists"),
        ("inspect Cargo.mcap", "reading failed"),
        ("inspect none.mcap", "is not a session: the file has no complete chunk of MCAP; give a recorded session"),
        ("inspect text.txt", "neither MetaImage"),
        ("repair text.txt -o x.mcap", "only sessions are repaired"),
    ] {
        place.refuses(words, &[said]);
    }
}

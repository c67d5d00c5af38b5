//! Anonymous recordings: planted identifiers are in no output, and subjects have pseudonyms.

use super::place::{Place, SMALL_BEDSIDE};
use super::sequence::{Sequence, grey};

/// Identifiers planted in a recording: patient's name and id, birth date, accession number,
/// institution, serial number, file name, folder, operator, study date, comment, and a word in a
/// status. The twelfth, letters burned into the picture's border, is planted in the pixels.
const PLANTED: [&str; 12] = [
    "DOE^JANE",
    "PID-4711",
    "19700102",
    "ACC-998877",
    "General-Hospital",
    "SN-20-31415",
    "jane-doe",
    "ward-seven",
    "Dr-Operator",
    "20260304",
    "remark-on-jane",
    "SEEN-BY-DOE",
];

/// Frame of 40×30 pixels whose picture is 24×20 pixels from (8, 5); letters in the border.
fn pixel(u: u32, v: u32, frame: u32) -> Vec<u8> {
    let is_picture = (8..32).contains(&u) && (5..25).contains(&v);
    let is_letter = v == 2 && u.is_multiple_of(3);
    vec![if is_picture { grey(u, v, frame) } else { u8::from(is_letter) * 255 }]
}

fn recording() -> Vec<u8> {
    let names = ["PatientName", "PatientID", "BirthDate", "Accession", "Institution", "SerialNumber"];
    let more = ["SonoweaveInput", "SourcePath", "Operator", "StudyDate", "Comment"];
    let lines: String =
        names.iter().chain(&more).zip(PLANTED).map(|(name, text)| format!("{name} = {text}\n")).collect();
    let lines = format!("UltrasoundImageOrientation = MFA\nUltrasoundImageType = BRIGHTNESS\n{lines}");
    let status = |frame| if frame == 1 { "SEEN-BY-DOE" } else { "OK" };
    let whole = Sequence { lines, status, pixel, ..Sequence::default() };
    let text = String::from_utf8(whole.header(None).into_bytes()).unwrap();
    // Seconds since 1970, and a field of a frame.
    let text = text.replace("Timestamp = ", "Timestamp = 17726112").replace(
        "ElementDataFile",
        "Seq_Frame0000_Remark = remark-on-jane\nSeq_Frame0000_FrameNumber = 20260304\nElementDataFile",
    );
    [text.into_bytes(), whole.pixels()].concat()
}

/// Asserts that none of the planted texts is in any file's bytes: as UTF-8, UTF-16 and
/// hexadecimal digits.
fn holds_none(place: &Place, names: &[&str], said: &str) {
    let forms = |text: &str| -> Vec<Vec<u8>> {
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let little: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let hexes = [hex(text.as_bytes()), hex(&little), hex(text.as_bytes()).to_uppercase()];
        [text.as_bytes().to_vec(), text.to_lowercase().into_bytes(), little, big]
            .into_iter()
            .chain(hexes.map(String::into_bytes))
            .collect()
    };
    let files = names.iter().map(|name| (*name, place.get(name))).chain([("the output", said.as_bytes().to_vec())]);
    for (name, bytes) in files {
        for (text, form) in PLANTED.iter().flat_map(|text| forms(text).into_iter().map(move |form| (text, form))) {
            assert!(!bytes.windows(form.len()).any(|part| part == form), "{name} holds {text}");
        }
    }
}

#[test]
fn planted_identifiers_are_in_no_output() {
    let place = Place::new();
    std::fs::create_dir_all(place.path("ward-seven")).unwrap();
    place.put("ward-seven/jane-doe.mha", recording());
    place.put("study.key", [7; 32]);
    let input = "ward-seven/jane-doe.mha";
    let who = "--subject PID-4711 --key study.key --acquired 20260304101112";
    let clip = "--anonymize --clip 8,5,24,20";
    let mut names = Vec::new();
    let mut heard = String::new();
    for name in ["a.mha", "a.seq.nrrd", "a.mcap", "a.nhdr", "f%03d.png"] {
        heard += &place.does(&format!("convert {input} -o {name} {clip} {who} --json=a.json"));
        names.extend([name, "a.json"].iter().filter(|name| !name.contains('%')).copied());
        holds_none(&place, &["a.json"], &heard);
    }
    names.extend(["a.raw", "f000.png", "f005.png"]);
    assert!(
        heard.contains("left out: PatientName, PatientID, BirthDate, Accession") && heard.contains("black: 720 pixels")
    );
    place.does("dicom a.mha -o a.dcm");
    let run = place.run("reconstruct a.mha -o v.mha --path general --spacing 0.5 --sigma 0.5,0.5,0.7 --clip none");
    assert_eq!(run.code, 0, "{}", run.stderr);
    place.does("convert v.mha -o v.nii.gz --anonymize");
    place.does("inspect a.mha --sidecar side.json");
    names.extend(["a.dcm", "v.mha", "side.json"]);
    holds_none(&place, &names, &heard);
    // All files of the place, but the recording, its folder and the key.
    let made: Vec<String> =
        place.names().into_iter().filter(|name| name != "ward-seven" && name != "study.key").collect();
    holds_none(&place, &made.iter().map(String::as_str).collect::<Vec<_>>(), "");
    let frames = super::dicom_in::readings(&place, "a.mha").0;
    for (n, frame) in (0_u32..).zip(&frames) {
        for (at, value) in (0_u32..).zip(frame.pixels.iter()) {
            let (u, v) = (at % 40, at / 40);
            let is_picture = (8..32).contains(&u) && (5..25).contains(&v);
            assert_eq!(*value, if is_picture { grey(u, v, n) } else { 0 }, "pixel ({u}, {v}) of frame {n}");
        }
    }
    let times: Vec<f64> = frames.iter().map(|frame| frame.stamp.source_s.unwrap()).collect();
    assert!(times[0] == 0.0 && times.is_sorted(), "{times:?}");
    let report = place.json("a.json");
    assert_eq!(
        (report["blackened"]["pixels"].as_u64(), report["blackened"]["changed"].as_u64()),
        (Some(720), Some(6 * 14))
    );
    assert!(report.get("input").is_none(), "{report}");
}

#[test]
fn subjects_keep_pseudonym_and_intervals() {
    let place = Place::new();
    place.put("s.mha", recording());
    place.put("one.key", [7; 32]);
    place.put("two.key", [8; 32]);
    let run = |subject: &str, key: &str, time: &str| {
        let who = format!("--subject {subject} --key {key} --acquired {time}");
        place.does(&format!("convert s.mha -o a.mha --anonymize --clip none {who} --json=a.json"));
        let report = place.json("a.json");
        let text = String::from_utf8_lossy(&place.get("a.mha")).into_owned();
        for (field, key) in [("SonoweaveSubject", "subject"), ("SonoweaveAcquired", "acquired")] {
            assert!(text.contains(&format!("{field} = {}\n", report[key].as_str().unwrap())), "{report}");
        }
        let time = sonoweave_core::date::Second::parse(report["acquired"].as_str().unwrap()).unwrap();
        (report["subject"].as_str().unwrap().to_owned(), time.unix_s())
    };
    let first = run("anna", "one.key", "20260101120000");
    let again = run("anna", "one.key", "20260103130005");
    assert_eq!((&first.0, again.1 - first.1), (&again.0, 2 * 86_400 + 3605));
    let others = [run("ben", "one.key", "20260101120000"), run("anna", "two.key", "20260101120000")];
    assert!(others.iter().all(|other| other.0 != first.0 && other.1 != first.1), "{others:?}");
    place.put("short.key", [7; 31]);
    let words = "convert s.mha -o x.mha --anonymize --clip none --subject anna";
    place.refuses(&format!("{words} --key short.key"), &["short.key: has 31 bytes", "head -c 32"]);
    place.refuses(&format!("{words} --key none.key"), &["none.key"]);
    assert_eq!(place.run(words).code, 2, "a subject needs a key");
    assert_eq!(place.run("convert s.mha -o x.mha --clip none").code, 2, "a clip is for --anonymize");
}

#[test]
fn unknown_picture_is_refused_and_found_one_is_used() {
    let place = Place::new();
    place.put("s.mha", recording());
    let said = place.does("convert s.mha -o a.mha --anonymize");
    assert!(said.contains("a.mha: anonymous sequence of 6 frames\n"), "{said}");
    assert!(said.contains("black: 720 pixels of each frame; 84 of all frames were not black"), "{said}");
    // The letters touch the picture: what is not black has no plain edge.
    let letters = |u, v, n| if (9..14).contains(&u) && v < 5 { vec![200] } else { pixel(u, v, n) };
    place.put("t.mha", Sequence { pixel: letters, ..Sequence::default() }.bytes());
    place.refuses("convert t.mha -o x.mha --anonymize", &["t.mha: names beside the picture may remain", "--clip none"]);
    place.refuses("convert s.mha -o x.mha --anonymize --clip 30,0,20,5", &["--clip 30,0,20,5 is not within", "40×30"]);
    // A crop leaves nothing beside itself; a full frame has no border to find.
    place.does("convert s.mha -o c.mha --anonymize --crop 8,5,24,20");
    place.put("full.mha", Sequence::default().bytes());
    place.refuses("convert full.mha -o f.mha --anonymize", &["full.mha: names beside the picture may remain"]);
    place.does("convert full.mha -o f.mha --anonymize --clip none");
    assert_eq!(
        super::dicom_in::readings(&place, "f.mha").0[3].pixels,
        super::dicom_in::readings(&place, "full.mha").0[3].pixels
    );
}

#[test]
fn orientation_and_depth_of_pixels_do_not_matter() {
    let place = Place::new();
    let deep = Sequence { element: "MET_USHORT", pixel: |u, v, n| vec![pixel(u, v, n)[0], 1], ..Sequence::default() };
    place.put("s.mha", deep.bytes());
    place.does("convert s.mha -o turned.mha --orientation FU");
    place.does("convert s.mha -o a.mha --anonymize --clip 8,5,24,20");
    place.does("convert turned.mha -o b.mha --anonymize --clip 8,5,24,20 --orientation MFA");
    let [a, b] = ["a.mha", "b.mha"].map(|name| super::dicom_in::readings(&place, name).0);
    assert!(a.iter().zip(&b).all(|(a, b)| a.pixels == b.pixels));
    assert_eq!(a[0].pixels.iter().filter(|byte| **byte == 0).count(), 2 * 720);
}

#[test]
fn session_becomes_anonymous_with_its_own_date_moved() {
    let place = Place::new();
    let session = place.recorded(SMALL_BEDSIDE, 1);
    place.put("study.key", [7; 32]);
    let said = place.run(&format!(
        "convert {session} -o a.mcap --anonymize --clip none --subject anna --key study.key --json=a.json"
    ));
    assert_eq!(said.code, 0, "{}", said.stderr);
    let acquired = place.json("a.json")["acquired"].as_str().unwrap().to_owned();
    let years_ago: i64 = acquired[..4].parse().unwrap();
    let bytes = place.get("a.mcap");
    for text in ["SESSION", "bedside", "fastrak", "/home", "/tmp"] {
        assert!(!bytes.windows(text.len()).any(|part| part == text.as_bytes()), "{text}");
    }
    assert!(bytes.windows(14).any(|part| part == acquired.as_bytes()));
    assert!((2000..2100).contains(&years_ago));
}

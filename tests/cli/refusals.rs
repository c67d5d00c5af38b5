//! Bad input: a sentence naming file, field and offset, exit code 1, no output files, bounded
//! memory.

use super::place::Place;
use super::sequence::{Sequence, deflated, pose};

/// One thread: each further one reserves address space, which is limited below.
const RECONSTRUCT: &str = "reconstruct s.mha -o v.mha --weights w.mha --planes p.png --json=s.json --threads 1";

/// Address space that suffices for every refusal here, kB.
const MODEST: u64 = 400_000;

fn refused(bytes: impl AsRef<[u8]>, says: &[&str]) {
    let place = Place::new();
    place.put("s.mha", bytes);
    place.refuses(RECONSTRUCT, says);
}

fn with(change: impl FnOnce(&mut Sequence)) -> Sequence {
    let mut sequence = Sequence::default();
    change(&mut sequence);
    sequence
}

fn position(bytes: &[u8], text: &str) -> usize {
    bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap()
}

/// Returns a field and the position of its line, in the form of error messages.
fn offset(bytes: &[u8], field: &str) -> String {
    format!("field {field} (byte {})", position(bytes, &format!("{field} =")))
}

#[test]
fn undamaged_sequence_is_accepted() {
    let place = Place::new();
    for (zlib, big_endian) in [(false, false), (true, false)] {
        place.put("s.mha", with(|s| (s.zlib, s.big_endian) = (zlib, big_endian)).bytes());
        let said = place.run("reconstruct s.mha -o v.mha");
        assert_eq!(said.code, 0, "{}", said.stderr);
    }
}

#[test]
fn truncated_header_is_refused() {
    let bytes = Sequence::default().bytes();
    let says = |at: usize| {
        format!("s.mha: field ElementDataFile (byte {at}): was not reached: the file ends inside its header")
    };
    let line = position(&bytes, "Seq_Frame0002_Timestamp");
    refused(&bytes[..line], &[&says(line)]);
    refused([], &["s.mha: is empty; copy or record it again"]);
    refused(
        &bytes[..line + 10],
        &[&format!("s.mha: line 20 (byte {line}): has no `=`; this is not a MetaImage header")],
    );
}

#[test]
fn truncated_pixels_are_refused() {
    let bytes = Sequence::default().bytes();
    let cut = &bytes[..bytes.len() - 1];
    refused(cut, &["s.mha: ", &offset(cut, "DimSize"), "promises 7200 bytes of pixels, but the file holds 7199"]);
    let bytes = with(|s| s.zlib = true).bytes();
    let cut = &bytes[..bytes.len() - 9];
    refused(cut, &["s.mha: ", &offset(cut, "CompressedDataSize"), "cut short"]);
    // The size is not stated: the error appears when the frame is reached.
    let sequence = with(|s| s.zlib = true);
    let stream = deflated(&sequence.pixels());
    let header = sequence.header(Some(0)).replace("CompressedDataSize = 0\n", "");
    let cut = &stream[..stream.len() - 9];
    refused([header.as_bytes(), cut].concat(), &["s.mha: pixel data of frame 5 (byte "]);
}

#[test]
fn corrupt_compression_is_refused() {
    let sequence = with(|s| s.zlib = true);
    let mut stream = deflated(&sequence.pixels());
    let middle = stream.len() / 2;
    for byte in &mut stream[middle..middle + 8] {
        *byte ^= 0xff;
    }
    let bytes = [sequence.header(Some(stream.len())).as_bytes(), &stream].concat();
    refused(bytes, &["s.mha: pixel data of frame ", "(byte "]);
}

#[test]
fn contradictory_fields_are_refused() {
    let bytes = with(|s| s.lines += "ElementByteOrderMSB = True\n").bytes();
    refused(&bytes, &["s.mha: ", &offset(&bytes, "ElementByteOrderMSB"), "contradicts BinaryDataByteOrderMSB"]);
    let text = String::from_utf8(Sequence::default().header(None).into_bytes()).unwrap();
    let fewer = text.replace("DimSize = 40 30 6", "DimSize = 40 30 4");
    let file = [fewer.as_bytes(), &[1; 40 * 30 * 4]].concat();
    refused(&file, &["s.mha: field Seq_Frame0004_", "belongs to frame 4, but DimSize promises only 4"]);
    let none = text.replace("DimSize = 40 30 6", "DimSize = 40 30 0");
    refused(&none, &["s.mha: ", &offset(none.as_bytes(), "DimSize"), "no frames"]);
    let twice = text.replace("Kinds =", "DimSize = 1 2 3\nKinds =");
    refused(twice, &["s.mha: field DimSize (byte "]);
}

#[test]
fn matrix_of_fifteen_numbers_is_refused() {
    fn fifteen(frame: u32) -> String {
        if frame == 2 { "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0".into() } else { pose(f64::from(frame)) }
    }
    let bytes = with(|s| s.pose = fifteen).bytes();
    refused(
        &bytes,
        &[
            "s.mha: ",
            &offset(&bytes, "Seq_Frame0002_ImageToReferenceTransform"),
            "holds 15 numbers, but must hold exactly 16",
        ],
    );
    let place = Place::new();
    place.put("s.mha", with(|s| s.transform = "ProbeToTracker").bytes());
    let run = place.output(std::process::Command::new(env!("CARGO_BIN_EXE_sonoweave")).args([
        "reconstruct",
        "s.mha",
        "-o",
        "v.mha",
        "--image-to-probe",
        "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0",
    ]));
    place.check_refusal(&run, "--image-to-probe", &["--image-to-probe", "must hold 16 numbers, not 15"]);
}

#[test]
fn non_finite_pose_refuses_its_frame_only() {
    let place = Place::new();
    let nan: fn(u32) -> String =
        |frame| if frame == 2 { pose(2.0).replacen("0.5", "nan", 1) } else { pose(f64::from(frame)) };
    place.put("s.mha", with(|s| s.pose = nan).bytes());
    let run = place.run("reconstruct s.mha -o v.mha --json=s.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("1 × pose_not_finite, first frame 2: "), "{}", run.stderr);
    let frames = &place.json("s.json")["frames"];
    assert_eq!((&frames["total"], &frames["used"]), (&6.into(), &5.into()));
    assert_eq!(frames["refused"], serde_json::json!({ "pose_not_finite": 1 }));
}

#[test]
fn impossible_sizes_take_no_memory() {
    let text = Sequence::default().header(None);
    for (dims, says) in [
        ("100000 100000 100000", "the size of one frame"),
        ("40 30 1000000000000", "the number of frames"),
        ("18446744073709551615 18446744073709551615 6", "the size of one frame"),
        ("99999999999999999999 1 6", "64 bits"),
        ("8000 8000 6", "promises 384000000 bytes of pixels, but the file holds 7"),
    ] {
        let place = Place::new();
        place.put("s.mha", text.replace("DimSize = 40 30 6", &format!("DimSize = {dims}")) + "pixels\n");
        let before = place.names();
        let run = place.run_within(MODEST, RECONSTRUCT);
        place.check_refusal(&run, dims, &["s.mha: field DimSize (byte ", says]);
        assert_eq!(place.names(), before, "{dims}");
    }
}

#[test]
fn decompression_bomb_takes_no_memory() {
    // A gigabyte of zeros in a megabyte; the header promises 7200 bytes.
    let bomb = deflated(&vec![0; 1 << 30]);
    let place = Place::new();
    let sequence = with(|s| s.zlib = true);
    place.put("s.mha", [sequence.header(Some(bomb.len())).as_bytes(), &bomb].concat());
    let before = place.names();
    let run = place.run_within(MODEST, RECONSTRUCT);
    place.check_refusal(&run, "a bomb behind the frames", &["s.mha: pixel data of frame "]);
    assert_eq!(place.names(), before);
    // The same if the header promises more than any stream of that length can hold.
    let text = sequence.header(Some(bomb.len())).replace("DimSize = 40 30 6", "DimSize = 8192 8192 240");
    place.put("s.mha", [text.as_bytes(), &bomb].concat());
    let run = place.run_within(MODEST, RECONSTRUCT);
    place.check_refusal(
        &run,
        "a bomb of frames",
        &["s.mha: field DimSize (byte ", "compressed bytes of data in the file can hold"],
    );
    assert_eq!(place.names(), before);
}

#[test]
fn frames_of_other_image_types_are_refused() {
    let colour = with(|s| s.lines = "UltrasoundImageOrientation = MFA\nUltrasoundImageType = RGB_COLOR\n".into());
    refused(colour.bytes(), &["no frame could be used", "6 × image_type", "RGB_COLOR, not BRIGHTNESS"]);
    for kind in ["RF_REAL", "RF_IQ_LINE", "RF_I_LINE_Q_LINE"] {
        let lines = format!("UltrasoundImageOrientation = FM\nUltrasoundImageType = {kind}\n");
        let rf = with(|s| (s.element, s.pixel, s.lines) = ("MET_SHORT", |u, _, _| vec![u as u8, 0], lines));
        refused(rf.bytes(), &["no frame could be used", "6 × image_type", kind, "not BRIGHTNESS"]);
    }
}

#[test]
fn invalid_poses_are_refused() {
    refused(
        with(|s| s.status = |_| "INVALID").bytes(),
        &["no frame could be used", "6 × pose_invalid", "first frame 0"],
    );
    refused(with(|s| s.pose = |_| pose(0.0).replacen("0.5", "inf", 1)).bytes(), &["6 × pose_not_finite"]);
}

#[test]
fn absent_frame_range_is_refused() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let says = |range: &str| format!("the frames {range} hold none that can be used; give a range within 0 to 5");
    place.refuses("reconstruct s.mha -o v.mha --frames 6..9", &[&says("6..9")]);
    place.refuses("reconstruct s.mha -o v.mha --frames 1000..", &["the frames 1000..", "give a range within 0 to 5"]);
}

#[test]
fn stray_poses_with_huge_box_are_refused() {
    let far: fn(u32) -> String = |frame| pose(f64::from(frame) * 1e8);
    refused(with(|s| s.pose = far).bytes(), &["strays", "--size"]);
}

#[test]
fn volume_beyond_memory_limit_is_refused() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place.refuses("reconstruct s.mha -o v.mha --spacing 0.05 --max-memory 0.001", &["frame 0: "]);
    place.refuses(
        "reconstruct s.mha -o v.mha --size 100000,100000,100000",
        &["--size 100000,100000,100000: is more than", "give a smaller size"],
    );
}

#[test]
fn foreign_configurations_are_refused() {
    let place = Place::new();
    place.put("s.mha", with(|s| s.transform = "ProbeToTracker").bytes());
    let cases = [
        (
            "<PlusConfiguration version=\"2.3\"><Nothing/></PlusConfiguration>",
            vec!["c: ", "holds no CoordinateDefinitions"],
        ),
        ("<CoordinateDefinitions>\n<Transform From=\"Image\"", vec!["c: line ", "not readable as XML"]),
        (
            "<CoordinateDefinitions>\n<Transform From=\"Image\" To=\"Probe\" Matrix=\"1 2 3\"/></CoordinateDefinitions>",
            vec!["c: Transform Matrix (line 2): ", "16 numbers"],
        ),
        ("format = \"sonoweave-calibration\"\nversion = 1\n[image_to_prob]\n", vec!["c: ", "image_to_prob"]),
        ("format = \"sonoweave-calibration\"\nversion = 2\n", vec!["c: ", "version 2 is newer"]),
        ("\u{0}\u{1}", vec!["c: "]),
    ];
    for (text, says) in cases {
        place.put("c", text);
        place.refuses("reconstruct s.mha -o v.mha --config c", &says);
    }
    place.refuses("reconstruct s.mha -o v.mha --config s.mha", &["s.mha: "]);
    place.refuses("reconstruct s.mha -o v.mha --config none.xml", &["none.xml: "]);
    place
        .refuses("reconstruct s.mha -o v.mha", &["no way from Image to Tracker", "ProbeToTracker", "--image-to-probe"]);
    place.refuses("reconstruct s.mha -o v.mha --world Moon", &["no way from Image to Moon"]);
}

#[test]
fn missing_inputs_and_impossible_outputs_are_refused() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    place.refuses("reconstruct none.mha -o v.mha", &["none.mha: ", "No such file"]);
    place.refuses("reconstruct . -o v.mha", &[".: "]);
    place.refuses("reconstruct s.mha -o none/v.mha", &["none/v.mha: the folder none does not exist"]);
    place.refuses("reconstruct s.mha -o v.mha --json=none/s.json", &["none/s.json: the folder none does not exist"]);
    place.refuses("reconstruct s.mha -o s.mha", &["s.mha: is the input"]);
    place.refuses("reconstruct s.mha -o ./s.mha", &["./s.mha: is the input"]);
    place.refuses("reconstruct s.mha -o v.mha --json=s.mha", &["s.mha: is the input"]);
    place.refuses("reconstruct s.mha -o v.tif", &["v.tif: volumes are written as .mha"]);
}

#[test]
fn existing_output_survives_a_failure() {
    let place = Place::new();
    place.put("v.mha", "precious");
    place.put("s.mha", with(|s| s.status = |_| "INVALID").bytes());
    place.refuses(RECONSTRUCT, &["no frame could be used"]);
    assert_eq!(place.get("v.mha"), b"precious");
}

#[test]
fn values_outside_the_scalar_type_are_refused() {
    let place = Place::new();
    let float: fn(u32, u32, u32) -> Vec<u8> = |u, _, _| (u as f32).to_le_bytes().to_vec();
    place.put("s.mha", with(|s| (s.element, s.pixel) = ("MET_FLOAT", float)).bytes());
    place.refuses("reconstruct s.mha -o v.mha --type u8", &["--type u8: the input is f32", "--window LO,HI"]);
    place.refuses("reconstruct s.mha -o v.mha --type u16", &["--type u16", "--window LO,HI"]);
    place.refuses(
        "reconstruct s.mha -o v.mha --type u8 --window 0,1 --unseen 300",
        &["--unseen 300: is not a value of type u8"],
    );
    place.refuses("reconstruct s.mha -o v.mha --sigma 0.00001,0.00001,0.00001", &[]);
    place.refuses("reconstruct s.mha -o v.mha --clip 100,100,5,5", &["leaves nothing of the 40×30 picture"]);
}

#[test]
fn invalid_commands_print_usage() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    for words in [
        "",
        "weave",
        "reconstruct s.mha",
        "reconstruct s.mha -o v.mha --spacing 0",
        "reconstruct s.mha -o v.mha --spacing -1",
        "reconstruct s.mha -o v.mha --size 1,2",
        "reconstruct s.mha -o v.mha --frames 5..5",
        "reconstruct s.mha -o v.mha --threads 0",
        "reconstruct s.mha -o v.mha --simd mmx",
        "reconstruct s.mha -o v.mha --window 5,5",
        "reconstruct s.mha -o v.mha --sigma 1,1,1 --resolution 1,1,1",
        "phantom",
        "phantom -o p.mha --scene moon",
        "phantom -o p.mha --image-size 0x5",
        "inspect",
        "compare a.mha",
    ] {
        let run = place.run(words);
        assert_eq!((run.code, run.stdout.as_str()), (2, ""), "{words}: {}", run.stderr);
        assert!(run.stderr.contains("--help") || run.stderr.contains("Usage"), "{words}: {}", run.stderr);
    }
    assert_eq!(place.names().len(), 1);
    for words in ["--help", "--version", "reconstruct --help", "inspect --help", "phantom --help"] {
        assert!(place.does(words).len() > 10, "{words}");
    }
}

#[test]
fn negative_numbers_and_output_folders_are_refused_by_name() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let said = place.run("reconstruct s.mha -o v.mha --spacing -1").stderr;
    assert!(said.contains("invalid value '-1' for '--spacing") && !said.contains("-- -1"), "{said}");
    // The temporary name is ours.
    let said = place.run("reconstruct s.mha -o /proc/v.mha").stderr;
    assert!(said.contains("/proc/v.mha: creating the file failed") && !said.contains(".part"), "{said}");
    assert!(said.ends_with("No such file or directory (os error 2); check the name\n"), "{said}");
    place.put("b.toml", [0xff, 0xd8, 0xff]);
    place.refuses("live --check --config b.toml", &["b.toml: holds bytes that are no text"]);
}

#[test]
fn files_of_other_kinds_are_named_as_such() {
    let place = Place::new();
    place.put("empty.mha", "");
    place.put("text.mha", "hello\nthis is text\n");
    place.put("binary.mha", [7, 0, 1, 10, 3]);
    place.put("page.mha", "<html></html>\n");
    place.put("setting.mha", "format = \"sonoweave-calibration\"\nversion = 1\n[image]\n");
    let images = "give one in MetaImage, NRRD, NIfTI or DICOM";
    for (name, kind) in [
        ("empty", "is empty; copy or record it again"),
        ("text", "is a text and no image file"),
        ("binary", "is binary data of another kind and no image file"),
        ("page", "is an XML file and no image file"),
        ("setting", "is a configuration or calibration file and no image file"),
    ] {
        let says = [format!("{name}.mha: {kind}"), if name == "empty" { String::new() } else { images.into() }];
        let says = says.each_ref().map(String::as_str);
        place.refuses(&format!("render {name}.mha -o p.png"), &says);
        place.refuses(&format!("reconstruct {name}.mha -o v.mha"), &says);
        // Not that nothing is to be drawn.
        place.refuses(&format!("animate {name}.mha"), &says);
    }
    place.put("text.txt", "hello\nthis is text\n");
    place.put("text.mcap", "hello\nthis is text\n");
    for name in ["text.txt", "empty.mha", "page.mha"] {
        let says = format!("{name}: is not a session; use `sonoweave animate` to draw");
        place.refuses(&format!("replay {name}"), &[&says, "`sonoweave reconstruct`"]);
    }
    let says = ["text.mcap: is not a session: the file has no complete chunk of MCAP", "give a recorded session"];
    place.refuses("replay text.mcap", &says);
}

#[test]
fn exchanged_and_missing_configurations_are_explained() {
    let place = Place::new();
    place.put("bed.toml", place.does("live --example fastrak"));
    let missing = "bed.toml: calibration.file (line 14): names probe.toml, but reading failed: No such file";
    place.refuses("live --config bed.toml", &[missing, "correct the name, or make the file"]);
    let other = "must be \"sonoweave-calibration\" for a calibration file; give another file";
    place.put("s.mha", Sequence::default().bytes());
    place.refuses("calibrate pivot --sequence s.mha -o bed.toml", &["bed.toml: format (line ", other]);
    place.put("virtual.toml", place.does("live --example virtual"));
    let open = "status.listen: other machines can reach 0.0.0.0:0, and [status] has no certificate";
    place.refuses("live --config virtual.toml --headless --console 0.0.0.0:0", &[open, "or listen at 127.0.0.1"]);
}

#[test]
fn help_ends_with_notice() {
    let place = Place::new();
    for words in ["--help", "-h", "help"] {
        assert!(place.does(words).trim_end().ends_with(sonoweave_core::NOTICE), "{words}");
    }
}

use proptest::prelude::*;

use sonoweave_core::date::Date;

use super::*;
use crate::arm::{Joint, Sign};
use crate::error::PresetError;
use crate::file::origin::Input;
use crate::tracker::noise::TrackerNoise;
use crate::tracker::zones::Zone;

fn parse(text: &str) -> Result<CalibrationFile, String> {
    CalibrationFile::parse(Path::new("probe.toml"), text).map_err(|e| e.to_string())
}

const HEAD: &str = "format = \"sonoweave-calibration\"\nversion = 1\n";

fn refusal(rest: &str) -> String {
    parse(&format!("{HEAD}{rest}")).expect_err("a bad file")
}

fn arm() -> Arm {
    let last = Joint { zero_counts: -120.25, sign: Sign::Minus, ..Joint::revolute(60.0, 8192.0) };
    Arm::new([Joint::revolute(250.0, 4e4), Joint::prismatic(17.3, -4.5, 100.5), last]).unwrap()
}

/// Returns the origin of a result of that name.
fn origin(name: &str) -> Origin {
    let input = |file: String| Input { file, sha256: "0123456789abcdef".repeat(4) };
    let inputs = vec![input(format!("{name}.mha")), input("phantom.xml".into())];
    Origin { made: Date::parse("2026-11-23"), inputs }
}

fn full() -> CalibrationFile {
    let rows = [-0.001, 0.078, -0.008, 15.4, -0.084, 0.0037, 0.015, 49.6, 0.016, 0.007, 0.08, -8.6, 0.0, 0.0, 0.0, 1.0];
    CalibrationFile {
        provenance: "N-wire \"phantom\",\n140 frames".into(),
        probe_from_image: Some(Transform::from_rows(&rows).unwrap()),
        arm: Some(arm()),
        arm_fit_rms_mm: Some(0.132_7),
        clip: Some(ClipRect::new(192, 16, 420, 580).unwrap()),
        fan: Some(Fan::new([380.0, 20.0], [120.0, 360.0], [-45.0, 45.0]).unwrap()),
        hwhm_mm: Some([0.3, 0.2, 1.1]),
        spacing_mm: Some([0.5, 0.5, 0.25]),
        latency: Some(Latency { video_ms: 40.0, tracker_ms: -24.826_600_000_1, lag_se_ms: Some(0.7) }),
        distortion: Some(Zones::new(
            33.3,
            1.5,
            Date::parse("2026-11-22"),
            [[33.3 * 3.0, 0.0, -33.3], [-66.6, 33.3, 0.0]]
                .map(|low| Zone { low_mm: low.into(), rms_mm: 2.75 })
                .to_vec(),
        )),
        tracker_noise: Some(RestNoise {
            whole: TrackerNoise { position_mm: 0.051, rotation_deg: 0.03 },
            fast: Some(TrackerNoise { position_mm: 0.04, rotation_deg: 0.01 }),
        }),
        transforms: vec![StaticTransform::new("Phantom \"1\"", "Reference", &rows).unwrap()],
        origins: ["arm", "latency", "distortion", "tracker_noise", "Phantom \"1\"ToReference"]
            .map(|name| (name.to_owned(), origin(name)))
            .into(),
        record: Record::default(),
        presets: Vec::new(),
    }
}

#[test]
fn everything_written_is_read_back() {
    assert_eq!(parse(&full().to_text()).unwrap(), full());
    assert_eq!(parse(HEAD).unwrap(), CalibrationFile::default());
    let bare = RestNoise { fast: None, ..full().tracker_noise.unwrap() };
    let bare = CalibrationFile { tracker_noise: Some(bare), ..full() };
    assert_eq!(parse(&bare.to_text()).unwrap(), bare);
}

#[test]
fn documented_example_is_read() {
    let identity = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]";
    let text = format!(
        "{HEAD}[image_to_probe]\nmatrix = {identity}\n[image]\nclip_px = {{ x = 192, y = 16, width = 420, height = 580 }}\n\
         [image.fan]\norigin_px = [380, 20.0]\nradii_px = [120.0, 360.0]\nangles_deg = [-45.0, 45.0]\n\
         [[arm.joint]]\ntype = \"revolute\"\nlength_mm = 250.0\ncounts_per_turn = 40000\nzero_counts = -120.5\nsign = -1\n\
         [[arm.joint]]\ntype = \"prismatic\"\ndirection_deg = 90.0\nlength_mm = 40.0\ncounts_per_mm = 100\n\
         [[arm.joint]]\ntype = \"revolute\"\nlength_mm = 60\ncounts_per_turn = 8192\n\
         [[transform]]\nfrom = \"Phantom\"\nto = \"Reference\"\nmatrix = {identity}\n"
    );
    let file = parse(&text).unwrap();
    assert_eq!(file.fan.unwrap().origin_px(), [380.0, 20.0]);
    let joints = [Joint::revolute(250.0, 4e4), Joint::prismatic(90.0, 40.0, 100.0), Joint::revolute(60.0, 8192.0)];
    let first = Joint { zero_counts: -120.5, sign: Sign::Minus, ..joints[0] };
    assert_eq!(file.arm, Some(Arm::new([first, joints[1], joints[2]]).unwrap()));
    let names: Vec<_> = file.named_transforms().iter().map(StaticTransform::name).collect();
    assert_eq!(names, ["ImageToProbe", "PhantomToReference"]);
}

#[test]
fn file_is_written_atomically_and_read_from_disk() {
    let folder = std::env::temp_dir().join(format!("sonoweave-calibration-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("probe.toml");
    full().write(&path).unwrap();
    assert_eq!(CalibrationFile::read(&path).unwrap(), full());
    let names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["probe.toml"]);
    std::fs::remove_dir_all(&folder).unwrap();
    let error = CalibrationFile::read(&path).unwrap_err().to_string();
    assert!(error.contains("probe.toml") && error.contains("reading failed"), "{error}");
}

#[test]
fn unknown_key_is_refused_with_line_and_nearest_name() {
    assert_eq!(
        refusal("[image_to_probe]\nmatirx = []\n"),
        "probe.toml: image_to_probe.matirx (line 4): unknown key; did you mean matrix?"
    );
    assert_eq!(
        refusal("[imge_to_probe]\n"),
        "probe.toml: imge_to_probe (line 3): unknown key; did you mean image_to_probe?"
    );
    assert_eq!(
        refusal("[image]\nclip_px = { x = 1, y = 2, wdth = 3, height = 4 }\n"),
        "probe.toml: image.clip_px.wdth (line 4): unknown key; did you mean width?"
    );
    assert!(refusal("[volume]\ncolour = 1\n").ends_with("known here: spacing_mm"));
}

#[test]
fn wrong_count_or_value_names_key_and_line() {
    let fifteen = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0]";
    let cases = [
        (
            format!("[image_to_probe]\nmatrix = {fifteen}\n"),
            "image_to_probe.matrix (line 4): must hold 16 numbers, not 15",
        ),
        (
            "[image_to_probe]\nmatrix = [1,0,0,0,\n 0,nan,0,0, 0,0,1,0, 0,0,0,1]\n".into(),
            "image_to_probe.matrix[5] (line 5): is not a finite number",
        ),
        (
            "[image_to_probe]\nmatrix = [1,0,0,0, 0,\"x\",0,0, 0,0,1,0, 0,0,0,1]\n".into(),
            "image_to_probe.matrix[5] (line 4): must be a number, not a text",
        ),
        (
            "[image_to_probe]\nmatrix = [1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]\n".into(),
            "image_to_probe.matrix (line 4): the matrix cannot be inverted",
        ),
        ("[image_to_probe]\n".into(), "image_to_probe.matrix (line 3): is missing"),
        (
            "[volume]\nspacing_mm = [0.5, 0, 0.5]\n".into(),
            "volume.spacing_mm (line 4): must hold numbers above 0, not 0",
        ),
        (
            "[volume]\nspacing_mm = 0.5\n".into(),
            "volume.spacing_mm (line 4): must be a list of 3 numbers, not a number",
        ),
        (
            "[resolution]\nhwhm_mm = [1, 1, -1]\n".into(),
            "resolution.hwhm_mm (line 4): must hold numbers above 0, not -1",
        ),
        (
            "[image]\nclip_px = { x = -1, y = 2, width = 3, height = 4 }\n".into(),
            "image.clip_px.x (line 4): must be a whole number from 0",
        ),
        (
            "[image]\nclip_px = { x = 1, y = 2, width = 0, height = 4 }\n".into(),
            "image.clip_px (line 4): a clip rectangle of 0×4 pixels is empty",
        ),
        (
            "[image.fan]\norigin_px = [0, 0]\nradii_px = [9, 3]\nangles_deg = [-1, 1]\n".into(),
            "image.fan (line 3): a fan's radii must grow",
        ),
        ("[image.fan]\norigin_px = [0, 0]\nradii_px = [0, 3]\n".into(), "image.fan.angles_deg (line 3): is missing"),
        ("[latency]\nvideo_ms = 3\n".into(), "latency.tracker_ms (line 3): is missing"),
        (
            "[latency]\nvideo_ms = 3\ntracker_ms = 1001\n".into(),
            "latency.tracker_ms (line 5): must lie between -1000 and 1000, not at 1001",
        ),
        (
            "[latency]\nvideo_ms = 3\ntracker_ms = 1\nlag_se_ms = -1\n".into(),
            "latency.lag_se_ms (line 6): must be 0 or more, not -1",
        ),
        ("provenance = 3\n".into(), "provenance (line 3): must be a text, not a whole number"),
        ("transform = 3\n".into(), "transform (line 3): must be a list of tables"),
        ("image = [\n".into(), "probe.toml: line "),
    ];
    for (text, expected) in cases {
        let error = refusal(&text);
        assert!(error.starts_with("probe.toml: ") && error.contains(expected), "{text}\n{error}");
    }
}

#[test]
fn bad_arm_is_refused_by_joint_and_line() {
    let whole = CalibrationFile { arm: Some(arm()), ..CalibrationFile::default() }.to_text();
    let refusal = |from: &str, to: &str| {
        assert!(whole.contains(from), "{whole}");
        parse(&whole.replacen(from, to, 1)).unwrap_err()
    };
    let cases = [
        ("\"revolute\"", "\"hinge\"", "arm.joint[0].type (line 5): must be \"revolute\" or \"prismatic\""),
        (
            "counts_per_mm = 100.5",
            "counts_per_turn = 100.5",
            "arm.joint[1].counts_per_turn (line 15): is not for a joint of this type; give counts_per_mm",
        ),
        ("counts_per_turn = 40000.0\n", "", "arm.joint[0].counts_per_turn (line 4): is missing"),
        ("counts_per_turn = 40000.0", "counts_per_turn = 0", "arm (line 4): joint 1 has 0 counts a turn"),
        (
            "length_mm = 250.0",
            "length_mm = 250.0\ndirection_deg = 3",
            "arm.joint[0].direction_deg (line 7): is not for a joint that turns",
        ),
        ("sign = -1", "sign = 2", "arm.joint[2].sign (line 24): must be 1 or -1, not 2"),
        ("length_mm = 60.0", "lenght_mm = 60.0", "did you mean length_mm?"),
    ];
    for (from, to, expected) in cases {
        let error = refusal(from, to);
        assert!(error.contains(expected), "{expected}\n{error}");
    }
    let two = whole.rsplit_once("\n[[arm.joint]]").unwrap().0;
    let error = parse(two).unwrap_err();
    assert!(error.contains("must hold 3 joints, base first, not 2"), "{error}");
    let error = parse(&format!("{HEAD}[arm]\njoint = 3\n")).unwrap_err();
    assert!(error.contains("arm.joint (line 4): must be a list of tables, each headed [[arm.joint]]"), "{error}");
}

#[test]
fn two_transforms_between_same_frames_are_refused() {
    let identity = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]";
    let error = refusal(&format!(
        "[image_to_probe]\nmatrix = {identity}\n[[transform]]\nfrom = \"Probe\"\nto = \"Image\"\nmatrix = {identity}\n"
    ));
    assert!(error.contains("transform[0] (line 5): Probe and Image are already related"), "{error}");
}

#[test]
fn other_format_or_newer_version_is_refused() {
    let error = parse("format = \"something\"\nversion = 1\n").unwrap_err();
    let expected =
        "probe.toml: format (line 1): must be \"sonoweave-calibration\" for a calibration file; give another";
    assert!(error.starts_with(expected), "{error}");
    let error = parse("format = \"sonoweave-calibration\"\nversion = 2\n").unwrap_err();
    assert!(error.contains("version (line 2): version 2 is newer than this program reads (1)"), "{error}");
    assert!(parse("version = 1\n").unwrap_err().contains("format (line 1): is missing"));
    assert!(parse("").unwrap_err().contains("format"));
}

proptest! {
    #[test]
    fn numbers_round_trip_bit_for_bit(m in prop::array::uniform9(-1e6..1e6_f64), t in prop::array::uniform3(-1e9..1e9_f64)) {
        let rows = [m[0], m[1], m[2], t[0], m[3], m[4], m[5], t[1], m[6], m[7], m[8], t[2], 0.0, 0.0, 0.0, 1.0];
        let Ok(transform) = Transform::from_rows(&rows) else { return Ok(()) };
        let file = CalibrationFile { probe_from_image: Some(transform), ..Default::default() };
        prop_assert_eq!(parse(&file.to_text()).unwrap(), file);
    }

    #[test]
    fn any_text_does_not_panic(text in "\\PC{0,80}", cut in 0_usize..700) {
        let _ = parse(&text);
        let whole = full().to_text();
        let cut = (0..=cut.min(whole.len())).rev().find(|&at| whole.is_char_boundary(at)).unwrap();
        let _ = parse(&whole[..cut]);
    }
}

#[test]
fn preset_is_chosen_by_name_or_if_alone() {
    let preset = |name: &str, mm: f64| preset::Preset {
        name: name.into(),
        probe_from_image: Transform::from_affine(glam::DAffine3::from_scale(glam::DVec3::splat(mm))),
        ruler: None,
        clip: ClipRect::new(1, 2, 30, 40).ok(),
        fan: None,
        record: Record { picture_px: Some([3, 4]), ..Record::default() },
    };
    let mut one = CalibrationFile { presets: vec![preset("near", 0.1)], ..CalibrationFile::default() };
    let chosen = one.choose(None).unwrap().unwrap();
    assert_eq!((one.probe_from_image, one.clip), (Some(chosen.probe_from_image), chosen.clip));
    assert_eq!(one.record, chosen.record, "the preset's accuracy goes with its image plane");
    let both = || CalibrationFile {
        presets: vec![preset("near", 0.1), preset("far", 0.2)],
        clip: ClipRect::new(0, 0, 9, 9).ok(),
        ..CalibrationFile::default()
    };
    let mut two = both();
    assert_eq!(two.choose(Some("far")).unwrap().unwrap().name, "far");
    assert_eq!(
        (two.probe_from_image.unwrap().affine().matrix3.x_axis.x, two.clip),
        (0.2, ClipRect::new(1, 2, 30, 40).ok())
    );
    let known = vec!["near".to_owned(), "far".to_owned()];
    assert_eq!(both().choose(None), Err(PresetError::Unnamed { known: known.clone() }));
    let unknown = PresetError::Unknown { name: "deep".into(), known };
    assert_eq!(unknown.to_string(), "there is no preset \"deep\"; give one of \"near\", \"far\"");
    assert_eq!(both().choose(Some("deep")), Err(unknown));
    let none = PresetError::Unknown { name: "deep".into(), known: Vec::new() };
    assert_eq!(CalibrationFile::default().choose(Some("deep")), Err(none));
    // A file's own `image_to_probe` counts until a preset is requested by name.
    let mut own = CalibrationFile { probe_from_image: Some(Transform::IDENTITY), ..both() };
    assert_eq!(own.choose(None).unwrap(), None);
    assert_eq!(own.probe_from_image, Some(Transform::IDENTITY));
}

#[test]
fn bad_zones_and_lengths_are_refused() {
    let head = "[distortion]\nmeasured = \"2026-11-22\"\ncell_mm = 50\nlimit_mm = 1\n";
    let clean = parse(&format!("{HEAD}{head}")).unwrap().distortion.unwrap();
    assert_eq!((clean.count(), clean.measured()), (0, Date::parse("2026-11-22")));
    let zone = |low: &str| refusal(&format!("{head}[[distortion.zone]]\nlow_mm = {low}\nrms_mm = 2\n"));
    assert!(zone("[50, 10, 0]").contains("distortion.zone[0].low_mm (line 8): must be a corner of a cell"));
    assert!(zone("[50, 0]").contains("must hold 3 numbers"));
    assert!(refusal(&head.replace("50", "-50")).contains("distortion.cell_mm (line 5): must be above 0, not -50"));
    assert!(refusal(&head.replace("11-22", "11-32")).contains("must be a day as"));
    assert!(refusal("[distortion]\ncell_mm = 5\n").contains("distortion.limit_mm (line 3): is missing"));
    assert!(refusal("[arm]\nfit_rms_mm = -1\n").contains("arm.fit_rms_mm (line 4): must be 0 or more"));
}

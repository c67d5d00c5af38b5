use std::path::Path;

use mask::{Clip, MaskPlan, MaskSettings, MaskShape};
use sonoweave_core::region::{ClipRect, Fan};

use super::*;

fn parse(text: &str) -> Result<Settings, String> {
    Settings::parse(Path::new("scan.xml"), text, None).map_err(|e| e.to_string())
}

const PROBE: &str = r#"<Transform From="Image" To="Probe"
  Matrix="-0.0015 0.0785 -0.0080 15.39
          -0.0839 0.0037  0.0153 49.57
           0.0159 0.0071  0.0803 -8.63
           0 0 0 1" Error="1.68" Date="022312_110631"/>"#;

fn plus(definitions: &str, reconstruction: &str) -> String {
    format!(
        "<PlusConfiguration version=\"2.1\">\n<CoordinateDefinitions>\n{definitions}\n</CoordinateDefinitions>\n\
         {reconstruction}\n</PlusConfiguration>"
    )
}

#[test]
fn plus_file_gives_transforms_spacing_clip_fan() {
    let text = plus(
        PROBE,
        r#"<VolumeReconstruction OutputSpacing="0.5 0.5 0.25" ClipRectangleOrigin="192 16" ClipRectangleSize="420 580"
           FanAnglesDeg="-45 45" FanOriginPixel="380 20" FanRadiusStartPixel="120" FanRadiusStopPixel="360"
           Interpolation="LINEAR" CompoundingMode="MEAN" ReferenceCoordinateFrame="Reference"/>"#,
    );
    let settings = parse(&text).unwrap();
    assert_eq!(settings.source, SourceKind::Plus);
    assert_eq!(settings.transforms.len(), 1);
    assert_eq!(settings.transforms[0].name(), "ImageToProbe");
    assert_eq!(settings.transforms[0].rows()[..4], [-0.0015, 0.0785, -0.0080, 15.39]);
    assert_eq!(settings.spacing_mm, Some([0.5, 0.5, 0.25]));
    assert_eq!(settings.clip, Some(ClipRect::new(192, 16, 420, 580).unwrap()));
    assert_eq!(settings.fan, Some(Fan::new([380.0, 20.0], [120.0, 360.0], [-45.0, 45.0]).unwrap()));
    assert_eq!(settings.world.as_deref(), Some("Reference"));
    assert_eq!(settings.notes, ["read but not taken over: Interpolation=\"LINEAR\", CompoundingMode=\"MEAN\""]);
    assert!(matches!(settings.mask().clip, Clip::RectOrAuto(_)));
}

#[test]
fn calibration_results_and_byte_order_mark_accepted() {
    let text = format!(
        "\u{feff}\n<ProbeCalibrationResult><CalibrationResults>{PROBE}</CalibrationResults></ProbeCalibrationResult>"
    );
    let settings = parse(&text).unwrap();
    assert_eq!(settings.transforms[0].name(), "ImageToProbe");
    assert_eq!(settings.mask(), MaskSettings::default());
}

#[test]
fn deprecated_names_and_defaults_match_plus() {
    let fan = |attributes: &str| parse(&plus("", &format!("<VolumeReconstruction {attributes}/>"))).unwrap();
    let old = fan(r#"FanAngles="30 -30" FanOrigin="10 20" FanDepth="100""#);
    assert_eq!(old.fan, Some(Fan::new([10.0, 20.0], [0.0, 100.0], [-30.0, 30.0]).unwrap()));
    let bare = fan(r#"FanAnglesDeg="-30 30""#);
    assert_eq!(bare.fan, Some(Fan::new([0.0, 0.0], [0.0, 500.0], [-30.0, 30.0]).unwrap()));
    assert_eq!(bare.notes.len(), 2, "{:?}", bare.notes);
    assert_eq!(fan(r#"FanAnglesDeg="0 0" ClipRectangleSize="0 0""#).fan, None);
    assert_eq!(fan(r#"FanAnglesDeg="0 0" ClipRectangleSize="0 0""#).clip, None);
    let shifted = fan(r#"ClipRectangleOrigin="-10 5" ClipRectangleSize="100 50""#);
    assert_eq!(shifted.clip, Some(ClipRect::new(0, 5, 90, 50).unwrap()));
}

#[test]
fn errors_name_file_element_attribute_line() {
    let matrix = |numbers: &str| plus(&format!("<Transform From=\"Image\" To=\"Probe\"\n Matrix=\"{numbers}\"/>"), "");
    let recon = |attributes: &str| plus("", &format!("<VolumeReconstruction\n {attributes}/>"));
    let cases = [
        (matrix("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0"), "scan.xml: Transform Matrix (line 4): must hold 16 numbers, not 15"),
        (
            matrix("1 0 0 0 0 nan 0 0 0 0 1 0 0 0 0 1"),
            "scan.xml: Transform Matrix (line 4): number 6 must be finite, not nan",
        ),
        (matrix("1 0 0 0 0 x 0 0 0 0 1 0 0 0 0 1"), "Transform Matrix (line 4): \"x\" is not a number"),
        (matrix("1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 1"), "Transform Matrix (line 4): the matrix cannot be inverted"),
        (plus("<Transform From=\"Image\" To=\"Probe\"/>", ""), "Transform Matrix (line 3): is missing"),
        (plus("<Transform From=\"Image\" Matrix=\"1\"/>", ""), "Transform To (line 3): is missing"),
        (plus("<Transform From=\"A\" To=\"A\" Matrix=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"/>", ""), "from A to itself"),
        (
            plus(
                &format!(
                    "{PROBE}\n<Transform From=\"Probe\" To=\"Image\" Matrix=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"/>"
                ),
                "",
            ),
            "Transform Matrix (line 8): Probe and Image are already related, with other numbers, on line 4",
        ),
        (recon("OutputSpacing=\"0.5 0.5\""), "VolumeReconstruction OutputSpacing (line 6): must hold 3 numbers, not 2"),
        (recon("OutputSpacing=\"0.5 0.5 0\""), "must hold numbers above 0, not 0"),
        (recon("ClipRectangleSize=\"1.5 2\""), "ClipRectangleSize (line 6): must hold whole numbers of pixels"),
        (recon("ClipRectangleOrigin=\"-50 0\" ClipRectangleSize=\"20 20\""), "is empty"),
        (
            recon("FanAnglesDeg=\"-30 30\" FanRadiusStartPixel=\"9\" FanRadiusStopPixel=\"3\""),
            "a fan's radii must grow",
        ),
        (
            recon("FanAnglesDeg=\"-30 30\" FanRadiusStopPixel=\"inf\""),
            "FanRadiusStopPixel (line 6): number 1 must be finite, not inf",
        ),
        ("<PlusConfiguration/>".into(), "holds no CoordinateDefinitions"),
        ("<PlusConfiguration>".into(), "scan.xml: line 1: not readable as XML"),
        ("<a>\n<b></a>".into(), "line 2: not readable as XML"),
    ];
    for (text, expected) in cases {
        let error = parse(&text).expect_err(&text);
        assert!(error.contains(expected), "{text}\n{error}");
        assert!(error.starts_with("scan.xml: "), "{error}");
    }
}

#[test]
fn equal_transform_twice_is_accepted() {
    assert_eq!(parse(&plus(&format!("{PROBE}{PROBE}"), "")).unwrap().transforms.len(), 1);
}

#[test]
fn several_reconstructions_top_level_one_used() {
    let text = plus(
        "",
        "<Device><VolumeReconstruction OutputSpacing=\"2 2 2\"/></Device>\n<VolumeReconstruction OutputSpacing=\"1 1 1\"/>",
    );
    let settings = parse(&text).unwrap();
    assert_eq!(settings.spacing_mm, Some([1.0; 3]));
    assert!(settings.notes[0].contains("the one on line 6 is taken"), "{:?}", settings.notes);
}

#[test]
fn entity_bombs_deep_nests_giant_tags_refused() {
    let bomb = "<!DOCTYPE a [<!ENTITY x \"xxxxxxxxxx\"><!ENTITY y \"&x;&x;&x;&x;\">]><a>&y;</a>";
    assert!(parse(bomb).unwrap_err().contains("not readable as XML"));
    let deep = format!("{}{}", "<a>\n".repeat(200_000), "</a>".repeat(200_000));
    assert!(parse(&deep).unwrap_err().contains("line 65: not readable as XML: elements are nested more than 64 deep"));
    let wide = format!("<a {}/>", (0..20_000).map(|i| format!("a{i}='' ")).collect::<String>());
    assert!(parse(&wide).unwrap_err().contains("a tag of more than"));
    let commented =
        format!("<!-- {} --><PlusConfiguration>{}</PlusConfiguration>", "<a>".repeat(100), "<CoordinateDefinitions/>");
    assert!(parse(&commented).is_ok(), "what is commented out does not count");
}

#[test]
fn own_files_recognised_by_content() {
    let text = "format = \"sonoweave-calibration\"\nversion = 1\n[image_to_probe]\nmatrix = [0.1,0,0,0, 0,0.1,0,0, 0,0,1,0, 0,0,0,1]\n\
                [image]\nclip_px = { x = 0, y = 0, width = 820, height = 616 }\n[resolution]\nhwhm_mm = [0.3, 0.2, 1.1]\n";
    let settings = parse(text).unwrap();
    assert_eq!(settings.source, SourceKind::Sonoweave);
    assert_eq!(settings.hwhm_mm, Some([0.3, 0.2, 1.1]));
    assert!(matches!(settings.mask().clip, Clip::Rect(_)), "said on purpose");
    assert!(parse("").unwrap_err().contains("format"));
    let json = serde_json::to_value(&settings).unwrap();
    assert_eq!(json["transforms"][0]["matrix"][0], 0.1);
    assert_eq!(json["source"], "sonoweave");
}

#[test]
fn command_line_calibration_replaces_file() {
    let mut settings = parse(&plus(PROBE, "")).unwrap();
    settings.set_image_to_probe("0.1 0 0 1, 0 0.1 0 2, 0 0 0.1 3, 0 0 0 1").unwrap();
    assert_eq!(settings.transforms.len(), 1);
    assert_eq!(settings.transforms[0].rows()[3], 1.0);
    assert_eq!(settings.set_image_to_probe("1 2 3").unwrap_err().to_string(), "must hold 16 numbers, not 3");
    assert!(
        settings
            .set_image_to_probe("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 NaN")
            .unwrap_err()
            .to_string()
            .contains("must be finite")
    );
}

#[test]
fn file_beyond_limit_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.xml");
    std::fs::File::create(&path).unwrap().set_len(MAX_BYTES + 1).unwrap();
    let error = Settings::read(&path, None).unwrap_err().to_string();
    assert!(error.contains("big.xml: holds more than 16777216 bytes"), "{error}");
}

proptest::proptest! {
    #[test]
    fn any_text_parses_without_panic(text in "\\PC{0,120}", cut in 0_usize..600) {
        let _ = parse(&text);
        let _ = parse(&format!("<{text}"));
        let whole = plus(PROBE, "<VolumeReconstruction OutputSpacing=\"1 1 1\"/>");
        let _ = parse(&whole[..cut.min(whole.len())]);
    }
}

#[test]
fn command_line_precedes_configuration() {
    let settings = Settings { world: Some("Reference".into()), ..Settings::default() };
    assert_eq!(settings.pairing_options(None).world.as_deref(), Some("Reference"));
    assert_eq!(settings.pairing_options(Some("Tracker")).world.as_deref(), Some("Tracker"));
    assert_eq!(settings.pairing_options(None).image, "Image");
}

#[test]
fn keys_of_mask_shape_give_that_mask() {
    let head = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"/dev/ttyUSB0\"\n\
                [grabber]\ndevice = \"/dev/video0\"\n[calibration]\n";
    let fan = Fan::new([320.25, -41.5], [100.0, 412.75], [-33.125, 34.0]).unwrap();
    for shape in [MaskShape::Whole, MaskShape::Rectangle(ClipRect::new(12, 3, 400, 300).unwrap()), MaskShape::Fan(fan)]
    {
        let text = format!("{head}{}\n", shape.config().unwrap());
        let settings = crate::bedside::Bedside::parse(Path::new("bed.toml"), &text).unwrap().mask;
        let MaskPlan::Fixed(mask) = settings.plan(640, 480).unwrap() else { panic!("{text}") };
        assert_eq!(settings.known(mask).shape, shape, "{text}");
    }
}

//! Presets and latencies of the calibration file.

use super::*;

/// Parses a configuration that names a calibration file of two presets, one of them old.
fn with_presets(calibration: &str, more: &str) -> Result<Bedside, String> {
    let preset = |name: &str, made: &str, mm: f64| {
        format!(
            "[[preset]]\nname = \"{name}\"\nmade = \"{made}\"\npicture_px = [64, 48]\nruler = {{ px = 400, mm = {} }}\nimage_to_probe = [{mm}, 0, 0, 0, 0, {mm}, 0, 0, 0, 0, {mm}, 0, 0, 0, 0, 1]\n",
            400.0 * mm
        )
    };
    let probe = format!(
        "format = \"sonoweave-calibration\"\nversion = 1\n{}{}",
        preset("near", "2001-02-03", 0.1),
        preset("far", &Date::today().to_string(), 0.2)
    );
    let bed = format!("{LEAST}[calibration]\nfile = \"probe.toml\"\n{calibration}\n{more}");
    let texts = [("bed.toml".into(), bed), ("probe.toml".into(), probe)];
    Bedside::of_texts(Path::new("bed.toml"), texts.into_iter().collect()).map_err(|e| e.to_string())
}

#[test]
fn preset_chosen_by_name_refused_if_unfit() {
    let far = with_presets("preset = \"far\"", "").unwrap();
    assert_eq!((pixel_mm(&far.calibration).unwrap(), far.mask.picture_px), ([0.2; 2], Some([64, 48])));
    assert!(far.notes.is_empty(), "{:?}", far.notes);
    let old = with_presets("preset = \"near\"", "").unwrap();
    assert!(
        old.notes.iter().any(|note| note.contains("\"near\" was made") && note.contains("(2001-02-03)")),
        "{:?}",
        old.notes
    );
    let patient = with_presets("preset = \"near\"\nwarn_after_days = 36500", "").unwrap();
    assert!(patient.notes.is_empty(), "{:?}", patient.notes);
    let message = with_presets("", "").unwrap_err();
    assert!(message.contains("probe.toml") && message.contains("\"near\", \"far\""), "{message}");
    assert!(with_presets("preset = \"deep\"", "").unwrap_err().contains("no preset \"deep\""));
    // Checks the scanner's present depth by its ruler.
    let ruler = |px: f64| with_presets("preset = \"far\"", &format!("[scanner]\nruler = {{ px = {px}, mm = 40 }}\n"));
    assert!(ruler(200.5).is_ok());
    let message = ruler(400.0).unwrap_err();
    assert!(
        message.contains("ruler") && message.contains("0.2000 mm a pixel, but the scanner's has 0.1000"),
        "{message}"
    );
    assert!(ruler(0.0).unwrap_err().contains("above 0"));
    // A different image size shows only with the first frame.
    let message = far.mask.plan(640, 480).unwrap_err().to_string();
    assert!(message.contains("64×48 pixels, and these have 640×480"), "{message}");
    assert!(with("[calibration]\npreset = \"far\"\n").unwrap_err().contains("give file"));
}

#[test]
fn latencies_default_to_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = CalibrationFile {
        probe_from_image: Some(Transform::IDENTITY),
        latency: Some(Latency { video_ms: 40.0, tracker_ms: -24.5, lag_se_ms: Some(0.7) }),
        ..CalibrationFile::default()
    };
    calibration.write(&folder.path().join("probe.toml")).unwrap();
    let read = |tracker: &str, grabber: &str| {
        let text = format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[calibration]\nfile = \"probe.toml\"\n[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\n{tracker}\n[grabber]\ndevice = \"/dev/video0\"\n{grabber}\n"
        );
        let bedside = Bedside::parse(&folder.path().join("bedside.toml"), &text).unwrap();
        let effective =
            ["tracker.latency_ms", "grabber.latency_ms"].map(|key| bedside.effective[key].as_f64().unwrap());
        let ns = [bedside.tracking.latency_ns(), bedside.grabber.latency_ns];
        let doubts = bedside.notes.iter().filter(|note| note.contains("in the calibration file")).count();
        (ns, effective, doubts)
    };
    assert_eq!(read("", ""), ([-24_500_000, 40_000_000], [-24.5, 40.0], 0));
    assert_eq!(
        read("latency_ms = 3.0", "latency_ms = 67.5"),
        ([3_000_000, 67_500_000], [3.0, 67.5], 0),
        "the same lag"
    );
    assert_eq!(read("latency_ms = 3.0", ""), ([3_000_000, 40_000_000], [3.0, 40.0], 1), "another one");
}

//! Real recordings through the program, with no flag but `--config`.

use std::path::Path;
use std::process::Command;

use libtest_mimic::Failed;
use serde_json::{Value, json};
use tempfile::TempDir;

use formats::Limits;
use formats::image::VolumeReader;

use crate::Test;

pub(crate) const SPINE: &str = "freehand/SpinePhantomFreehand.igs.mha";
pub(crate) const SPINE_XML: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml";
const FAN_XML: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SonixRP_TRUS_D70mm_LN_MEAN.xml";
const NEAREST: &str = "freehand/vtkVolumeReconstructorTestNNMEANvolumeRef.mha";
const LINEAR: &str = "freehand/vtkVolumeReconstructorTestLNMEANvolumeRef.mha";
const NWIRE: &str = "freehand/NwirePhantomFreehand.igs.mha";
pub(crate) const CALIBRATION: &str = "nwire/fCal_Test_Calibration_3NWires.igs.mha";
const VALIDATION: &str = "nwire/fCal_Test_Validation_3NWires.igs.mha";
pub(crate) const RESULTS_XML: &str = "nwire/FreehandCalibration3NWires.results.xml";
const RF: &str = "formats/UltrasonixLinearRfData.igs.mha";
const SAMPLES: &str = "latency/WaterTankBottomTranslationTrackerBuffer.igs.mha";

pub(crate) const TESTS: &[Test] = &[
    Test::of_folder("spine_reconstructs_without_its_black_frame", &[SPINE, SPINE_XML], spine),
    Test::of_folder("spine_agrees_with_plus_nearest", &[SPINE, SPINE_XML, NEAREST], spine_against_nearest),
    Test::of_folder("spine_in_a_fan_agrees_with_plus_linear", &[SPINE, FAN_XML, LINEAR], spine_against_linear),
    Test::of_folder("spine_is_the_same_bits_by_any_path", &[SPINE, SPINE_XML], spine_bits),
    Test::of_folder("nwire_freehand_reconstructs", &[NWIRE, SPINE_XML], nwire_freehand),
    Test::of_folder("nwire_calibration_reconstructs", &[CALIBRATION, RESULTS_XML], nwire_calibration),
    Test::of_folder("nwire_validation_reconstructs", &[VALIDATION, RESULTS_XML], nwire_validation),
    Test::of_folder("rf_is_read_and_refused", &[RF], rf),
    Test::of_folder("tracker_samples_are_described_and_refused", &[SAMPLES, SPINE_XML], samples),
    Test::of_folder("spine_is_described", &[SPINE, SPINE_XML], spine_described),
];

/// Returns the program's exit code and messages.
fn sonoweave(place: &TempDir, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_sonoweave")).args(arguments).current_dir(place.path()).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Result of a reconstruction with default settings.
struct Reconstructed {
    place: TempDir,
    statistics: Value,
    values: Vec<u8>,
    weights: Vec<f32>,
}

impl Reconstructed {
    fn new(folder: &Path, sequence: &str, config: &str, flags: &[&str]) -> Result<Self, Failed> {
        let place = tempfile::tempdir()?;
        let [sequence, config] =
            [sequence, config].map(|f| folder.join(f).canonicalize().unwrap().display().to_string());
        let mut arguments = vec!["reconstruct", &sequence, "--config", &config];
        arguments.extend(["-o", "v.mha", "--weights", "w.mha", "--json=s.json"]);
        arguments.extend(flags);
        let (code, _, stderr) = sonoweave(&place, &arguments);
        assert_eq!(code, Some(0), "{stderr}");
        let statistics = serde_json::from_slice(&std::fs::read(place.path().join("s.json"))?)?;
        let values = bytes(&place.path().join("v.mha"))?;
        let weights =
            bytes(&place.path().join("w.mha"))?.as_chunks().0.iter().map(|w| f32::from_ne_bytes(*w)).collect();
        Ok(Self { place, statistics, values, weights })
    }

    fn seen(&self) -> impl Iterator<Item = u8> + '_ {
        self.values.iter().zip(&self.weights).filter(|(_, w)| **w > 0.0).map(|(v, _)| *v)
    }

    /// Returns the share of the seen voxels up to this grey value.
    fn share_up_to(&self, grey: u8) -> f64 {
        self.seen().filter(|v| *v <= grey).count() as f64 / self.seen().count() as f64
    }

    /// Checks that all frames were used, and that the number of seen voxels fits the sweep's
    /// volume.
    fn check(&self, frames: u64, seen: std::ops::Range<usize>) {
        assert_eq!(self.statistics["frames"]["total"], frames);
        assert_eq!(self.statistics["frames"]["used"], frames);
        assert_eq!(self.statistics["world"], "Reference");
        assert_eq!(self.statistics["route"], "Image → Probe → Tracker → Reference");
        assert!(seen.contains(&self.seen().count()), "{} voxels seen", self.seen().count());
    }

    fn against(&self, reference: &Path) -> Result<Value, Failed> {
        let (code, out, stderr) = sonoweave(
            &self.place,
            &["inspect", "v.mha", "--json", "--against", &reference.canonicalize()?.display().to_string()],
        );
        assert_eq!(code, Some(0), "{stderr}");
        Ok(serde_json::from_str::<Value>(&out)?["comparison"].take())
    }
}

pub(crate) fn bytes(volume: &Path) -> Result<Vec<u8>, Failed> {
    let mut reader = VolumeReader::open(volume, &Limits::default())?;
    let mut bytes = Vec::new();
    while let Some(slice) = reader.next_slice()? {
        bytes.extend_from_slice(slice);
    }
    Ok(bytes)
}

fn spine(folder: &Path) -> Result<(), Failed> {
    let reconstructed = Reconstructed::new(folder, SPINE, SPINE_XML, &[])?;
    reconstructed.check(21, 500_000..600_000);
    // The scanner's image: columns 187 to 631, rows 12 to 601 of 820×616.
    assert_eq!(reconstructed.statistics["data_rectangle"], json!([187, 12, 445, 590]));
    assert_eq!(reconstructed.statistics["data_pixels"], 445 * 590);
    assert_eq!(reconstructed.statistics["grid"]["spacing"], json!([0.5, 0.5, 0.5]));
    let brightest = reconstructed.seen().max().ok_or("nothing seen")?;
    assert!((200..=255).contains(&brightest), "{brightest}");
    let with_frame = Reconstructed::new(folder, SPINE, SPINE_XML, &["--clip", "none"])?;
    let (without, with) = (reconstructed.seen().count(), with_frame.seen().count());
    assert!(with * 10 > without * 15, "the frame's border would fill {with} voxels instead of {without}");
    // Black is a value in the vertebrae's shadow, but the border would have been black
    // throughout.
    assert!(reconstructed.share_up_to(0) < 0.04, "{}", reconstructed.share_up_to(0));
    assert!(with_frame.share_up_to(0) > 0.3, "{}", with_frame.share_up_to(0));
    Ok(())
}

fn spine_against_nearest(folder: &Path) -> Result<(), Failed> {
    // On the lattice that PLUS chose for this recording.
    let flags = ["--origin", "-74.5217,165.573,29.072", "--size", "147,106,105"];
    let reconstructed = Reconstructed::new(folder, SPINE, SPINE_XML, &flags)?;
    let c = reconstructed.against(&folder.join(NEAREST))?;
    assert!(c["voxels"].as_u64() > Some(300_000), "{c}");
    assert!(c["correlation"].as_f64() > Some(0.95), "{c}");
    // PLUS's volume is darker: it rounds down at every insertion, and its border is overwritten.
    let bias = c["bias"].as_f64().ok_or("no bias")?;
    assert!((2.0..15.0).contains(&bias), "{c}");
    Ok(())
}

fn spine_against_linear(folder: &Path) -> Result<(), Failed> {
    let flags = ["--origin", "-57.0272,168.545,30.5384", "--size", "80,93,98"];
    let reconstructed = Reconstructed::new(folder, SPINE, FAN_XML, &flags)?;
    reconstructed.check(21, 100_000..400_000);
    let c = reconstructed.against(&folder.join(LINEAR))?;
    assert!(c["voxels"].as_u64() > Some(80_000) && c["correlation"].as_f64() > Some(0.95), "{c}");
    Ok(())
}

fn spine_bits(folder: &Path) -> Result<(), Failed> {
    let reference = Reconstructed::new(folder, SPINE, SPINE_XML, &["--threads", "1", "--simd", "portable"])?;
    for flags in [["--threads", "1", "--simd", "auto"], ["--threads", "2", "--simd", "auto"]] {
        let other = Reconstructed::new(folder, SPINE, SPINE_XML, &flags)?;
        assert!(other.values == reference.values && other.weights == reference.weights, "{flags:?}");
    }
    Ok(())
}

fn nwire_freehand(folder: &Path) -> Result<(), Failed> {
    let reconstructed = Reconstructed::new(folder, NWIRE, SPINE_XML, &[])?;
    reconstructed.check(97, 400_000..1_200_000);
    nwire(&reconstructed);
    Ok(())
}

fn nwire_calibration(folder: &Path) -> Result<(), Failed> {
    let reconstructed = Reconstructed::new(folder, CALIBRATION, RESULTS_XML, &[])?;
    reconstructed.check(188, 200_000..1_100_000);
    nwire(&reconstructed);
    Ok(())
}

fn nwire_validation(folder: &Path) -> Result<(), Failed> {
    let reconstructed = Reconstructed::new(folder, VALIDATION, RESULTS_XML, &[])?;
    reconstructed.check(94, 200_000..1_100_000);
    nwire(&reconstructed);
    Ok(())
}

/// Checks for bright wires in black water, with no part of the frame taken for its border.
fn nwire(reconstructed: &Reconstructed) {
    assert_eq!(reconstructed.statistics["data_pixels"], 820 * 616);
    let brightest = reconstructed.seen().max().unwrap_or(0);
    assert!((100..=255).contains(&brightest), "{brightest}");
    let bright = 1.0 - reconstructed.share_up_to(40);
    assert!((1e-4..0.02).contains(&bright), "{bright}");
}

fn rf(folder: &Path) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    let file = folder.join(RF).canonicalize()?.display().to_string();
    let matrix = "0.1 0 0 0 0 0.1 0 0 0 0 1 0 0 0 0 1";
    let (code, _, stderr) = sonoweave(&place, &["reconstruct", &file, "-o", "v.mha", "--image-to-probe", matrix]);
    assert_eq!(code, Some(4));
    assert!(stderr.contains("cannot be placed in space"), "{stderr}");
    assert_eq!(std::fs::read_dir(place.path())?.count(), 0);
    let (_, out, _) = sonoweave(&place, &["inspect", "--json", &file]);
    let report: Value = serde_json::from_str(&out)?;
    assert_eq!((&report["image_type"], &report["picture"]["scalar"]), (&json!("RF_I_LINE_Q_LINE"), &json!("i16")));
    assert_eq!(report["placement"]["frames"]["refused"], json!({ "image_type": 1 }));
    Ok(())
}

fn samples(folder: &Path) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    let [file, config] = [SAMPLES, SPINE_XML].map(|f| folder.join(f).canonicalize().unwrap().display().to_string());
    let (code, _, stderr) = sonoweave(&place, &["reconstruct", &file, "-o", "v.mha", "--config", &config]);
    assert_eq!(code, Some(5));
    assert!(stderr.contains("no frame could be used"), "{stderr}");
    let (_, out, _) = sonoweave(&place, &["inspect", "--json", &file, "--config", &config]);
    let report: Value = serde_json::from_str(&out)?;
    assert_eq!((&report["items"], &report["picture"]), (&json!(5000), &Value::Null));
    Ok(())
}

fn spine_described(folder: &Path) -> Result<(), Failed> {
    let place = tempfile::tempdir()?;
    let [file, config] = [SPINE, SPINE_XML].map(|f| folder.join(f).canonicalize().unwrap().display().to_string());
    let (code, out, stderr) = sonoweave(&place, &["inspect", "--json", &file, "--config", &config]);
    assert_eq!((code, stderr.as_str()), (Some(0), ""));
    let r: Value = serde_json::from_str(&out)?;
    assert_eq!(
        (&r["items"], &r["picture"]["size"], &r["orientation"]),
        (&json!(21), &json!([820, 616]), &json!("MFA"))
    );
    let p = &r["placement"];
    let near = |value: &Value, expected: f64, within: f64| {
        assert!((value.as_f64().unwrap() - expected).abs() < within, "{value} is not {expected}");
    };
    // Known properties of the recording: a sweep of 33 mm, 0.09 s from frame to frame.
    near(&p["sweep_mm"], 33.0, 1.0);
    near(&r["time"]["interval_s"]["median"], 0.09, 0.005);
    near(&p["pixel_mm"][0], 0.085, 0.001);
    near(&p["bounds_mm"][0][0], -74.5217, 0.001);
    assert_eq!(p["frames"]["used"], 21);
    Ok(())
}

//! Flags of `calibrate probe` that name a preset, its ruler, and the phantom's pose: their effect,
//! and values that are wrong, absent, huge or contradictory.

use std::process::Command;

use glam::{DMat4, DVec3};

use calibration::file::CalibrationFile;
use calibration::file::preset::Ruler;

use super::place::{Place, matrix};

/// A scan of N-wires, the phantom with its true pose (`held.toml`), the phantom without
/// (`phantom.toml`), and the true calibration.
fn scanned() -> Place {
    let place = Place::new();
    place.does(
        "phantom -o scan.mha --scene n-wire --frames 60 --image-size 320x240 --phantom held.toml --calibration truth.toml",
    );
    let held = String::from_utf8(place.get("held.toml")).unwrap();
    place.put("phantom.toml", held.split("[phantom_to_reference]").next().unwrap());
    place
}

/// Writes a calibration file with one transform.
fn put_transform(place: &Place, name: &str, [from, to]: [&str; 2], pose: DMat4) {
    let rows = pose.transpose().to_cols_array();
    place.put(
        name,
        format!(
            "format = \"sonoweave-calibration\"\nversion = 1\n[[transform]]\nfrom = \"{from}\"\nto = \"{to}\"\nmatrix = {rows:?}\n"
        ),
    );
}

/// Asserts that a command line is not understood, with a sentence, and changes nothing.
fn misused(place: &Place, words: &str, says: &str) {
    let before = place.names();
    let run = place.run(words);
    assert!(run.code == 2 && run.stderr.contains(says), "{words}: {} {}", run.code, run.stderr);
    assert_eq!(before, place.names(), "{words}");
}

#[test]
fn preset_keeps_others_and_is_refused_without_name_or_file() {
    let place = scanned();
    let words = "calibrate probe --phantom held.toml --sequence scan.mha";
    let pixel_mm = matrix(&place.toml("truth.toml")["image_to_probe"]["matrix"]).y_axis.length();
    // Read to a pixel: 40 mm are some 180 pixels.
    let px = (40.0 / pixel_mm).round();
    place.does(&format!("{words} --preset near --ruler {px},40 -o presets.toml"));
    place.does(&format!("{words} --preset far -o presets.toml"));
    let one = place.get("presets.toml");
    place.does(&format!("{words} --preset far -o presets.toml"));
    assert_eq!(place.get("presets.toml"), one, "the same preset once more");
    let file = CalibrationFile::read(&place.path("presets.toml")).unwrap();
    let listed: Vec<_> = file.presets.iter().map(|preset| (preset.name.as_str(), preset.ruler)).collect();
    assert_eq!(listed, [("near", Ruler::new(px, 40.0)), ("far", None)]);
    assert_eq!(file.probe_from_image, None);

    // A session at another depth does not use it.
    let bedside = |ruler: &str| {
        format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"320x240\"\n[calibration]\nfile = \"presets.toml\"\npreset = \"near\"\nclip_px = \"none\"\n[scanner]\nruler = {ruler}\n[virtual]\nscene = \"n-wire\"\n"
        )
    };
    place.put("deeper.toml", bedside("{ px = 100.0, mm = 60.0 }"));
    place.refuses(
        "live --config deeper.toml --duration 1",
        &["the preset \"near\" is for a ruler of 0.2", "but the scanner's has 0.6000; choose the preset of this depth"],
    );

    let long = "x".repeat(81);
    for (flags, says) in [
        (format!("--preset {long} -o p.toml"), "must be a name of 1 to 80 characters"),
        ("--preset near".to_owned(), "--output <CAL.toml>"),
        ("-o p.toml --preset near --preset far".to_owned(), "cannot be used multiple times"),
        ("-o p.toml --preset".to_owned(), "a value is required"),
    ] {
        misused(&place, &format!("{words} {flags}"), says);
    }
    for blank in ["", "  ", "a\nb"] {
        let words = words.split(' ').chain(["-o", "p.toml", "--preset", blank]);
        let run = place.output(Command::new(env!("CARGO_BIN_EXE_sonoweave")).args(words));
        assert!(
            run.code == 2 && run.stderr.contains("must be a name of 1 to 80 characters in one line"),
            "{}",
            run.stderr
        );
    }
    assert!(!place.names().contains("p.toml"));
}

#[test]
fn ruler_must_be_two_lengths_of_the_calibrated_scale() {
    let place = scanned();
    let words = "calibrate probe --phantom held.toml --sequence scan.mha -o p.toml";
    for ruler in [
        "512",
        "512,0",
        "-512,40",
        "nan,40",
        "inf,40",
        "1e400,40",
        "1e300,1e-300",
        "1e-300,1e300",
        "a,b",
        "512,40,3",
        "512;40",
    ] {
        misused(
            &place,
            &format!("{words} --preset near --ruler={ruler}"),
            "must be two lengths above 0, at most 100000: pixels,mm",
        );
    }
    misused(&place, &format!("{words} --ruler 180,40"), "--preset <NAME>");
    // A ruler of another depth, exchanged lengths, and a tiny scale.
    for ruler in ["180,80", "40,180", "99999,0.00001"] {
        place.refuses(
            &format!("{words} --preset near --ruler {ruler}"),
            &[
                &format!("--ruler {ruler}: gives "),
                "mm a pixel, but the recording's pixels have 0.2",
                "read both lengths",
            ],
        );
    }
}

#[test]
fn registration_takes_the_place_of_the_phantoms_pose() {
    let place = scanned();
    let held = matrix(&place.toml("held.toml")["phantom_to_reference"]["matrix"]);
    let between = ["Phantom", "Reference"];
    put_transform(&place, "there.toml", between, held);
    put_transform(&place, "back.toml", ["Reference", "Phantom"], held.inverse());
    put_transform(&place, "moved.toml", between, DMat4::from_translation(DVec3::new(0.0, 0.0, 8.0)) * held);
    let by = |phantom: &str, registration: &str, to: &str| {
        place.does(&format!(
            "calibrate probe --phantom {phantom} --sequence scan.mha --registration {registration} -o {to} --limit 50"
        ));
        place.pixels_apart([to, "truth.toml"], [320, 240])
    };
    for registration in ["there.toml", "back.toml"] {
        let [middle, corner] = by("phantom.toml", registration, "found.toml");
        // Twice 0.082 and 0.093 mm.
        assert!(middle < 0.17 && corner < 0.19, "{registration}: {middle} {corner}");
    }
    // It counts before the pose in the phantom's file: the plane is as far off as the phantom, but
    // for 0.52 mm.
    let [middle, _] = by("held.toml", "moved.toml", "off.toml");
    assert!((middle - 8.0).abs() < 1.1, "{middle}");

    put_transform(&place, "tip.toml", ["StylusTip", "Stylus"], held);
    put_transform(&place, "mirrored.toml", between, held * DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)));
    put_transform(&place, "large.toml", between, held * DMat4::from_scale(DVec3::splat(10.0)));
    put_transform(&place, "far.toml", between, DMat4::from_translation(DVec3::splat(1e6)) * held);
    put_transform(&place, "huge.toml", between, DMat4::from_translation(DVec3::splat(1e200)) * held);
    let words = "calibrate probe --phantom phantom.toml --sequence scan.mha -o p.toml";
    place.refuses(words, &["phantom.toml: lacks the phantom's position (PhantomToReference)", "--registration"]);
    for (file, says) in [
        ("nowhere.toml", ["nowhere.toml: ", "No such file"]),
        ("tip.toml", ["tip.toml: holds no PhantomToReference", "`calibrate landmarks`"]),
        ("mirrored.toml", ["mirrored.toml: ", "mirrors"]),
        ("large.toml", ["large.toml: ", "the pose is no rotation"]),
        ("phantom.toml", ["phantom.toml: ", "for a calibration file"]),
        ("far.toml", ["far.toml: PhantomToReference is 2e6 mm", "check that its numbers are in mm"]),
        ("huge.toml", ["huge.toml: PhantomToReference is ", "more than 10000; check"]),
    ] {
        place.refuses(&format!("{words} --registration {file}"), &says);
    }
    place.refuses(
        "calibrate probe --method point --sequence scan.mha --registration there.toml -o p.toml",
        &["--registration: has no effect with --method point", "leave it out"],
    );
}

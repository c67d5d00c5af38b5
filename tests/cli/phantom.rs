//! `phantom`: what it writes, and that the rest of the program can use it.

use super::place::Place;

const SMALL: &str = "phantom --image-size 60x50 --pixel 0.5 --frames 20 --gap 0.5";

#[test]
fn the_same_flags_give_the_same_bits_and_others_do_not() {
    let place = Place::new();
    place.does(&format!("{SMALL} -o a.mha --truth ta.mha --seed 3"));
    place.does(&format!("{SMALL} -o b.mha --truth tb.mha --seed 3"));
    place.does(&format!("{SMALL} -o c.mha --truth tc.mha --seed 4"));
    assert!(place.get("a.mha") == place.get("b.mha") && place.get("ta.mha") == place.get("tb.mha"));
    assert!(place.get("a.mha") != place.get("c.mha") && place.get("ta.mha") != place.get("tc.mha"));
}

#[test]
fn the_truth_lies_on_the_lattice_of_the_reconstruction() {
    let place = Place::new();
    for spacing in ["0.5", "0.7", "0.4,0.5,1.1"] {
        place.does(&format!("{SMALL} -o s.mha --truth t.mha --spacing {spacing}"));
        place.does(&format!("reconstruct s.mha -o v.mha --spacing {spacing}"));
        let report = place.does("inspect v.mha --against t.mha --json");
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        assert!(report["comparison"]["correlation"].as_f64().unwrap() > 0.95, "{report}");
    }
}

#[test]
fn a_tracker_s_poses_and_the_calibration_lead_to_the_same_volume() {
    let place = Place::new();
    for flags in ["", "--fan --compress --type f32 --scene ramp --noise 1"] {
        place.does(&format!("{SMALL} {flags} -o direct.mha"));
        place.does(&format!("{SMALL} {flags} -o tracked.mha --calibration c.toml"));
        place.refuses("reconstruct tracked.mha -o v.mha", &["no way from Image to Reference", "ImageToProbe"]);
        place.does("reconstruct tracked.mha --config c.toml -o t.mha --type f32 --clip none --unseen -1000");
        // It says that the file's calibration is not needed; the file's fan is.
        let run = place.run("reconstruct direct.mha --config c.toml -o d.mha --type f32 --clip none --unseen -1000");
        assert_eq!(run.code, 0, "{}", run.stderr);
        let (direct, tracked) = (place.volume("d.mha"), place.volume("t.mha"));
        assert_eq!(direct.header.size, tracked.header.size);
        let far = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 0.01;
        let differing = direct.values.iter().zip(&tracked.values).filter(far).count();
        // Rounding may take a voxel at the support's end from one of the two.
        assert!(differing * 1000 < direct.values.len(), "{differing} of {}", direct.values.len());
    }
}

#[test]
fn every_scene_and_trajectory_is_made() {
    let place = Place::new();
    for scene in ["constant", "ramp", "blobs", "sphere"] {
        for trajectory in ["parallel", "fan", "freehand"] {
            let said = place.does(&format!(
                "phantom -o s.mha --truth t.mha --image-size 20x16 --pixel 1.5 --frames 5 --gap 2 --spacing 2 --scene {scene} --trajectory {trajectory}"
            ));
            assert!(
                said.contains(&format!("scene {scene}")) && said.contains(&format!("trajectory {trajectory}")),
                "{said}"
            );
            place.does_narrowly("reconstruct s.mha -o v.mha --spacing 2 --clip none");
        }
    }
    let truth = place.volume("t.mha");
    assert!(truth.field("SonoweavePhantom").starts_with("scene sphere, trajectory freehand, 5 frames"));
}

#[test]
fn a_phantom_that_cannot_be_is_refused_and_nothing_is_written() {
    let place = Place::new();
    for (flags, says) in [
        ("-o s.mha --frames 0", "a scan of 0 frames cannot be made"),
        ("-o s.mha --gap 0", "the gap between slices is 0 mm"),
        ("-o s.mha --pixel 0", "the distance of pixels is 0 mm"),
        ("-o s.mha --noise nan", "the noise has a standard deviation of NaN"),
        ("-o s.mha --grey inf --scene constant", "--grey inf: must be finite"),
        ("-o s.mha --rate 0", "--rate 0: must lie between"),
        ("-o s.mha --trajectory fan --axis-distance 1", "the fan would turn by"),
        ("-o s.mha --image-size 100000x100000", "cannot be painted"),
        ("-o s.mha --image-size 9x1 --fan", "--fan: "),
        ("-o s.mha --truth t.mha --spacing 0.001", "larger than the limit"),
        ("-o s.mha --truth s.mha", "s.mha: is named for two outputs"),
        ("-o s.mha --calibration none/c.toml", "none/c.toml: the folder none does not exist"),
        ("-o none/s.mha", "none/s.mha: the folder none does not exist"),
        ("-o s.nrrd", "s.nrrd: sequences are written as .mha"),
        ("-o s.mha --truth t.nii", "t.nii: volumes are written as .mha"),
        ("-o .", "is no file"),
    ] {
        place.refuses(&format!("phantom {flags}"), &[says]);
    }
}

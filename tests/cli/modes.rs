//! View settings on the command line: the result of each mode, the flags that it accepts, and
//! that an incremental picture equals the one rendered afterwards.

use std::io::Write as _;

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use sonoweave_core::reading::PixelType;

use super::place::Place;

/// A bright ball in a dim box, grey values 40 and 220.
fn ball() -> Place {
    let place = Place::new();
    let size = [24_u32; 3];
    let mut file = VolumeWriter::create(&place.path("v.mha"), &VolumeHeader::new(size, PixelType::U8)).unwrap();
    for i in 0..24_u32.pow(3) {
        let off: f64 = [i % 24, i / 24 % 24, i / 576].map(|i| (f64::from(i) - 11.5).powi(2)).iter().sum();
        file.write_all(&[if off < 49.0 { 220 } else { 40 }]).unwrap();
    }
    file.finish().unwrap();
    place
}

const SMALL: &str = "--image-size 40x40 --threads 1 --json=s.json";

fn middle_and_edge(place: &Place) -> [u8; 2] {
    let picture = image::load_from_memory(&place.get("p.png")).unwrap().to_rgb8();
    [(20, 20), (7, 7)].map(|(x, y)| picture.get_pixel(x, y).0[0])
}

#[test]
fn each_mode_gives_its_expected_picture() {
    let place = ball();
    let draw = |flags: &str| {
        let said = place.does(&format!("render v.mha -o p.png --view 0,0 {SMALL} {flags}"));
        let mode = flags.split(' ').nth(1).unwrap();
        assert!(said.contains(&format!(", {mode}, ")), "{said}");
        assert_eq!(place.json("s.json")["mode"], mode);
        middle_and_edge(&place)
    };
    assert_eq!(draw("--mode mip"), [220, 40]);
    // 14 of 24 voxels, and half a voxel at either end, where the values are interpolated.
    let [middle, edge] = draw("--mode average");
    assert!((i32::from(middle) - (40 + 180 * 14 / 24)).abs() < 6 && edge == 40, "{middle} {edge}");
    let [middle, edge] = draw("--mode iso");
    assert!(middle > 240 && edge == 0, "a white ball, lit from the front: {middle} {edge}");
    assert_eq!(place.json("s.json")["pictures"][0]["isovalue"], 127.5);
    let [_, edge] = draw("--mode iso --isovalue 30");
    assert_eq!(edge, 76, "the box itself, evenly grey: it has no slope, and gets the ambient light only");
    let [middle, edge] = draw("--mode opacity --transfer xray");
    assert!(middle == edge && middle > 80, "as much everywhere: {middle} {edge}");
    let [middle, edge] = draw("--mode opacity --transfer phantom");
    assert!(middle == 255 && edge == 0, "{middle} {edge}");
    assert_eq!(place.json("s.json")["pictures"][0]["light"], serde_json::Value::Null);
    // All modes share the same window.
    assert_eq!(draw("--mode mip --window 40,400"), [128, 0]);
}

#[test]
fn shading_flag_selects_samples() {
    let place = ball();
    let draw = |flags: &str| {
        place.does(&format!("render v.mha -o p.png {SMALL} --transfer phantom {flags}"));
        place.get("p.png")
    };
    let voxels = draw("");
    assert!(draw("--shading voxel") == voxels);
    let samples = draw("--shading sample");
    assert!(samples != voxels);
    assert_eq!(place.json("s.json")["pictures"][0]["shading"], "sample");
    assert!(draw("--mode opacity") != draw("--mode opacity --shading sample"));
}

#[test]
fn light_flags_take_effect_and_appear_in_statistics() {
    let place = ball();
    for mode in ["--transfer phantom", "--mode iso"] {
        let draw = |flags: &str| {
            place.does(&format!("render v.mha -o p.png {SMALL} {mode} {flags}"));
            place.get("p.png")
        };
        let plain = draw("");
        let light = place.json("s.json")["pictures"][0]["light"].clone();
        let usual = serde_json::json!({
            "direction": null, "ambient": 0.3, "diffuse": 0.7, "specular": 0.2, "shininess": 16, "two_sided": true, "depth_cue": null
        });
        assert_eq!(light, usual);
        for same in ["--light headlight", "--ambient 0.3 --diffuse 0.7 --specular 0.2 --shininess 16 --two-sided true"]
        {
            assert!(draw(same) == plain, "{same}");
        }
        for other in [
            "--light 1,-1,0.5",
            "--ambient 0.1",
            "--diffuse 0.4",
            "--specular 0.6",
            "--shininess 3",
            "--depth-cue 1,0.4",
            "--light 0,1,0 --two-sided false",
        ] {
            assert!(draw(other) != plain, "{mode} {other}");
        }
        let light = place.json("s.json")["pictures"][0]["light"].clone();
        assert_eq!((&light["direction"], &light["two_sided"]), (&serde_json::json!([0.0, 1.0, 0.0]), &false.into()));
        assert!(draw("--light 0,1,0") != draw("--light 0,1,0 --two-sided false"), "{mode}");
    }
}

#[test]
fn replay_picture_equals_volume_picture_in_every_mode() {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 40x32 --pixel 0.5 --frames 10 --gap 0.7 --noise 3");
    for view_flags in [
        "--mode mip",
        "--mode mip --perspective 40 --step 0.7 --arity 5",
        "--mode average",
        "--mode iso --isovalue 80",
        "--mode iso --isovalue 60 --step 0.6 --light 1,1,1 --depth-cue 1,0.4",
        "--mode opacity --transfer phantom",
        "--mode shaded --shading sample --transfer phantom",
        "--mode shaded --transfer phantom --light 0,0,1 --specular 0.5",
    ] {
        for cache in ["none --threads 2", "linear --threads 1", "two-level --threads 3", "one-level"] {
            let view_flags = format!("--image-size 48x40 --view 40,25 {view_flags}");
            place.does(&format!(
                "animate s.mha --clip none --picture p.png -o v.mha --type f32 --weights w.mha --json=s.json --cache {cache} {view_flags}"
            ));
            place.does(&format!("render v.mha --weights w.mha -o q.png {view_flags}"));
            assert!(place.get("p.png") == place.get("q.png"), "{cache} {view_flags}: not the same picture");
            let picture = image::load_from_memory(&place.get("p.png")).unwrap().to_rgb8();
            assert!(picture.pixels().filter(|p| p.0[0] > 20).count() > 50, "{view_flags}: something is seen");
            assert!(view_flags.contains(place.json("s.json")["picture"]["mode"].as_str().unwrap()), "{view_flags}");
        }
    }
}

#[test]
fn flags_unused_by_mode_are_refused() {
    let place = ball();
    for command in ["render v.mha -o p.png", "animate s.mha --picture p.png"] {
        if command.starts_with("animate") {
            place.does("phantom -o s.mha --image-size 20x16 --pixel 1 --frames 4 --gap 1");
        }
        for (flags, says) in [
            ("--mode mip --isovalue 9", &["--isovalue", "the mode mip", "leave it out"][..]),
            ("--isovalue 9", &["--isovalue", "the mode shaded"]),
            ("--mode iso --isovalue nan", &["--isovalue", "finite"]),
            ("--mode iso --shading sample", &["--shading", "the mode iso"]),
            ("--mode average --shading voxel", &["--shading", "the mode average"]),
            ("--mode mip --stop 0.5", &["--stop", "the mode mip"]),
            ("--mode iso --stop 0", &["--stop", "the mode iso"]),
            ("--mode opacity --ambient 0.3", &["--ambient", "the mode opacity", "no light"]),
            ("--mode average --light headlight", &["--light", "the mode average"]),
            ("--mode mip --depth-cue 1,0.5", &["--depth-cue", "the mode mip"]),
            ("--ambient 2", &["ambient part of the light", "not 2"]),
            ("--mode iso --light 0,0,0", &["direction towards the light"]),
            ("--shininess 0", &["exponent", "1 or more"]),
            ("--depth-cue 0.2,0.5", &["brightness must fall"]),
        ] {
            place.refuses(&format!("{command} {flags}"), says);
        }
        for (flags, says) in [
            ("--mode maximum", "mip"),
            ("--shading glossy", "sample"),
            ("--light sun", "headlight"),
            ("--depth-cue 1", "2 numbers"),
            ("--isovalue bright", "--isovalue"),
            ("--two-sided perhaps", "--two-sided"),
        ] {
            let run = place.run(&format!("{command} {flags}"));
            assert_eq!(run.code, 2, "{flags}: {}", run.stderr);
            assert!(run.stderr.contains(says), "{flags}: {}", run.stderr);
        }
        assert!(!place.names().contains("p.png"));
    }
}

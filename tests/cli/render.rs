//! Pictures of volume files: effect of flags, refusals, and messages.

use std::io::Write as _;

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use sonoweave_core::reading::PixelType;

use super::place::Place;

pub(super) fn put(place: &Place, name: &str, header: &VolumeHeader, bytes: &[u8]) {
    let mut file = VolumeWriter::create(&place.path(name), header).unwrap();
    file.write_all(bytes).unwrap();
    file.finish().unwrap();
}

/// A bright ball in the dark, off the middle.
fn ball() -> Place {
    let place = Place::new();
    let size = [24_u32, 20, 16];
    let header =
        VolumeHeader { origin: [3.0, -2.0, 1.0], spacing: [0.5, 0.5, 1.0], ..VolumeHeader::new(size, PixelType::U8) };
    let mut bytes = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let off = [(x, 9.0), (y, 11.0), (z, 7.0)].map(|(i, middle)| (f64::from(i) - middle).powi(2));
                bytes.push(if off.iter().sum::<f64>() < 36.0 { 220 } else { 10 });
            }
        }
    }
    put(&place, "v.mha", &header, &bytes);
    place
}

fn pixels(place: &Place, name: &str) -> image::RgbImage {
    image::load_from_memory(&place.get(name)).unwrap().to_rgb8()
}

#[test]
fn ball_is_rendered_with_statistics() {
    let place = ball();
    let said = place.does("render v.mha -o p.png --image-size 60x50 --transfer phantom --json=s.json --threads 2");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.starts_with("p.png: 60×50 pixels of v.mha, shaded, phantom, from 30°, 20°, in ")
            && said.ends_with(" ms\n"),
        "{said}"
    );
    let picture = pixels(&place, "p.png");
    assert_eq!(picture.dimensions(), (60, 50));
    assert!(picture.pixels().filter(|p| p.0[0] > 60).count() > 50, "a ball is seen");
    assert_eq!(picture.get_pixel(0, 0).0, [0; 3]);
    let s = place.json("s.json");
    assert_eq!(s["size"], serde_json::json!([24, 20, 16]));
    assert_eq!((s["voxels_seen"].as_u64(), s["threads"].as_u64()), (Some(24 * 20 * 16), Some(2)));
    assert_eq!(
        (&s["mode"], &s["transfer"], &s["window"]),
        (&"shaded".into(), &"phantom".into(), &serde_json::json!([0.0, 255.0]))
    );
    let drawn = &s["pictures"][0];
    assert_eq!((&drawn["view"], &drawn["cache"]), (&serde_json::json!([30.0, 20.0, 0.0]), &"none".into()));
    assert_eq!(drawn["image_size"], serde_json::json!([60, 50]));
    for key in ["prepare_ms", "shade_ms", "rays_ms", "write_ms"] {
        assert!(drawn[key].as_f64().unwrap() >= 0.0, "{key}");
    }
    assert!(drawn["samples_per_ray"].as_u64().unwrap() > 20 && drawn["arity"].as_u64().unwrap() >= 4);
    assert!(drawn["cache_bytes"].is_u64() && drawn["voxel_bytes"].is_u64());
    for key in ["bricks_read", "bricks_changed", "voxels_shaded", "rays", "samples", "blocks_folded", "pixels_changed"]
    {
        assert!(drawn["work"][key].as_u64().unwrap() > 0, "{key}: {drawn}");
    }
    assert!(drawn["work"]["samples_skipped"].is_u64());
}

#[test]
fn every_flag_takes_effect() {
    let place = ball();
    let draw = |flags: &str| {
        place.does(&format!("render v.mha -o p.png --image-size 40x40 --threads 1 {flags}"));
        place.get("p.png")
    };
    let plain = draw("--transfer phantom");
    assert!(draw("--transfer xray") != plain);
    for other in [
        "--view 120,20",
        "--view 30,-20",
        "--view 30,20,45",
        "--perspective 50",
        "--window 0,2000",
        "--step 0.37",
        "--stop 0.9",
        "--background 1,1,1",
    ] {
        assert!(draw(&format!("--transfer phantom {other}")) != plain, "{other}");
    }
    for same in ["--view 30,20,0", "--mode shaded", "--window 0,255", "--stop 0.0009765625", "--adaptive 0"] {
        assert!(draw(&format!("--transfer phantom {same}")) == plain, "{same}");
    }
    place.does("render v.mha -o p.png --image-size 40x40 --transfer phantom --threads 3");
    assert!(place.get("p.png") == plain);
    let s = |flags: &str| {
        draw(&format!("--json=s.json {flags}"));
        place.json("s.json")["pictures"][0].clone()
    };
    assert_eq!(s("--arity 3")["arity"], 3);
    assert_eq!(s("--perspective 50")["image_size"], serde_json::json!([40, 40]));
    let (one, half) = (s("--step 1"), s("--step 0.5"));
    assert!(half["samples_per_ray"].as_u64() > one["samples_per_ray"].as_u64());
    let adaptive = s("--adaptive 0.03");
    assert!(adaptive["adaptive"].as_f64() > Some(0.02) && adaptive["work"]["regions"].as_u64() > Some(0));
    draw("--background 0,0.5,1");
    assert_eq!(pixels(&place, "p.png").get_pixel(0, 0).0, [0, 128, 255]);
}

#[test]
fn any_parts_give_same_picture_and_are_counted() {
    let place = ball();
    let draw = |flags: &str| {
        place.does(&format!("render v.mha -o p.png --image-size 40x40 --transfer phantom --json=s.json {flags}"));
        (place.get("p.png"), place.json("s.json")["pictures"][0].clone())
    };
    let (plain, s) = draw("--parts 1 --threads 1");
    assert_eq!((&s["parts"], &s["cache"]), (&1.into(), &"none".into()));
    // The volume's 16 layers of voxels meet three of bricks; the region has one more on each side.
    for parts in 1..=8 {
        for threads in [1, 2] {
            let (picture, s) = draw(&format!("--parts {parts} --threads {threads}"));
            assert!(picture == plain, "{parts} parts on {threads} threads");
            assert_eq!(s["parts"], parts.min(5), "{s}");
            assert_eq!(s["cache"], if parts > 1 { "one-level" } else { "none" });
            let noted = s["notes"].as_array().unwrap().iter().any(|note| note.as_str().unwrap().contains("5 layers"));
            assert_eq!(noted, parts > 5, "{s}");
        }
    }
    assert!(draw("").0 == plain, "by the measured rule");
}

#[test]
fn weights_distinguish_unseen_from_dark() {
    let place = ball();
    let header = place.volume("v.mha").header;
    let floats = VolumeHeader { pixel: PixelType::F32, ..header };
    // Only the far half of the ball was seen.
    let weights: Vec<u8> =
        (0..24 * 20 * 16).flat_map(|i| if i % 24 > 9 { 1.0_f32 } else { 0.0 }.to_ne_bytes()).collect();
    put(&place, "w.mha", &floats, &weights);
    let flags = "-o p.png --image-size 40x40 --transfer phantom --json=s.json";
    place.does(&format!("render v.mha {flags}"));
    let all = place.get("p.png");
    place.does(&format!("render v.mha --weights w.mha {flags}"));
    assert!(place.get("p.png") != all);
    assert_eq!(place.json("s.json")["voxels_seen"], 14 * 20 * 16);
}

#[test]
fn turntable_covers_full_circle() {
    let place = ball();
    let flags = "--image-size 32x32 --transfer phantom --threads 1";
    let said = place.does(&format!("render v.mha -o t.png --turntable 4 --json=s.json --view 10,15 {flags}"));
    assert!(said.contains("t-000.png and on, 4 pictures"), "{said}");
    let names: Vec<String> = place.names().into_iter().filter(|n| n.ends_with(".png")).collect();
    assert_eq!(names, ["t-000.png", "t-001.png", "t-002.png", "t-003.png"]);
    let views: Vec<f64> =
        place.json("s.json")["pictures"].as_array().unwrap().iter().map(|p| p["view"][0].as_f64().unwrap()).collect();
    assert_eq!(views, [10.0, 100.0, 190.0, 280.0]);
    // All have one scale: another turntable that begins there has the same picture. A single
    // picture is scaled to fit.
    place.does(&format!("render v.mha -o u.png --turntable 2 --view 100,15 {flags}"));
    assert!(place.get("u-000.png") == place.get("t-001.png") && place.get("u-001.png") == place.get("t-003.png"));
    place.does(&format!("render v.mha -o p.png --view 100,15 {flags}"));
    assert!(place.get("p.png") != place.get("t-001.png"));
}

#[test]
fn empty_volume_gives_background_and_a_message() {
    let place = Place::new();
    let header = VolumeHeader {
        fields: vec![("SonoweaveUnseen".into(), "0".into())],
        ..VolumeHeader::new([8, 8, 8], PixelType::U8)
    };
    put(&place, "v.mha", &header, &[0; 512]);
    let run = place.run("render v.mha -o p.png --image-size 9x7 --background 0,0,1");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.stderr.contains("no voxel was seen") && run.stderr.contains("512 voxels of the value 0"),
        "{}",
        run.stderr
    );
    assert!(pixels(&place, "p.png").pixels().all(|p| p.0 == [0, 0, 255]));
}

#[test]
fn soft_light_has_colours_and_opacities_of_its_preset() {
    let place = ball();
    let render = |words: &str| {
        place.does(&format!("render v.mha -o p.png --image-size 60x50 --json=s.json {words}"));
        (pixels(&place, "p.png"), place.json("s.json"))
    };
    let (skin, said) = render("--soft portrait --threads 1");
    assert_eq!((&said["soft"], &said["transfer"]), (&"portrait".into(), &"portrait".into()));
    assert!(said["pictures"][0]["bricks_smoothed"].as_u64().unwrap() > 0, "{said}");
    let coloured = skin.pixels().filter(|p| p.0[0] > p.0[2] + 20).count();
    assert!(coloured > 50, "skin is redder than blue: {coloured} pixels");
    let (again, _) = render("--soft portrait --threads 3");
    assert!(again == skin, "any threads");
    let (direct, said) = render("--transfer phantom");
    assert!(said["soft"].is_null() && said["pictures"][0]["bricks_smoothed"].is_null());
    assert!(direct.pixels().all(|p| p.0[0] == p.0[2]));
    let (other, said) = render("--soft portrait --transfer xray");
    assert_eq!(said["transfer"], "xray");
    assert!(other != skin, "opacities of --transfer");
    // The light follows the view: a turntable's picture does not depend on those before it.
    place.does("render v.mha -o t.png --image-size 60x50 --soft portrait --turntable 4 --view 30,20");
    place.does("render v.mha -o u.png --image-size 60x50 --soft portrait --turntable 2 --view 120,20");
    assert!(place.get("u-000.png") == place.get("t-001.png"));
}

#[test]
fn impossible_pictures_are_refused() {
    let place = ball();
    let header = VolumeHeader { channels: 2, ..VolumeHeader::new([2, 2, 2], PixelType::U8) };
    put(&place, "two.mha", &header, &[1; 16]);
    put(&place, "other.mha", &VolumeHeader::new([2, 2, 2], PixelType::U8), &[1; 8]);
    place.put("bad.toml", "opacity = 3\n");
    for (words, says) in [
        ("render v.mha -o p.png --image-size 100000x10", &["100000×10", "8192"][..]),
        ("render v.mha -o none/p.png", &["none/p.png", "the folder none does not exist"]),
        ("render v.mha -o p.jpg", &["p.jpg", ".png"]),
        ("render v.mha -o p.png --json=none/s.json", &["the folder none does not exist"]),
        ("render two.mha -o p.png", &["two.mha", "2 channels"]),
        ("render v.mha --weights other.mha -o p.png", &["other.mha", "not the weights", "the size"]),
        ("render none.mha -o p.png", &["none.mha"]),
        (
            "render v.mha -o p.png --transfer muscle",
            &["--transfer: no transfer function", "tissue", "bone", "xray", ".toml"],
        ),
        ("render v.mha -o p.png --transfer none.toml", &["none.toml"]),
        ("render v.mha -o p.png --transfer bad.toml", &["bad.toml"]),
        ("render v.mha -o p.png --perspective 180", &["170"]),
        ("render v.mha -o p.png --step 0", &["--step"]),
        ("render v.mha -o p.png --step nan", &["--step"]),
        ("render v.mha -o p.png --step 1e-5", &["--step"]),
        ("render v.mha -o p.png --stop 1.5", &["--stop"]),
        ("render v.mha -o p.png --adaptive=-1", &["--adaptive"]),
        ("render v.mha -o p.png --adaptive 2", &["--adaptive"]),
        ("render v.mha -o p.png --parts 2 --adaptive 0.02", &["--parts: ", "2 parts", "adaptive 0"]),
        ("render v.mha -o p.png --mode slice --parts 2", &["--parts"]),
        ("render v.mha -o p.png --max-memory 1e-6", &["v.mha", "--max-memory"]),
        ("render v.mha -o p.png --soft skin", &["--soft: no soft light", "portrait, bone, vessel and glass"]),
        ("render v.mha -o p.png --soft bone --mode mip", &["--soft: applies to --mode shaded only"]),
        ("render v.mha -o p.png --soft bone --max-memory 2e-4", &["--soft: ", "--max-memory"]),
    ] {
        place.refuses(words, says);
    }
    for (words, says) in [
        ("render v.mha -o p.png --image-size 0x10", "--image-size"),
        ("render v.mha -o p.png --view nan,0", "must be finite"),
        ("render v.mha -o p.png --view 1", "must hold 2 numbers"),
        ("render v.mha -o p.png --arity 0", "--arity"),
        ("render v.mha -o p.png --parts 0", "--parts"),
        ("render v.mha -o p.png --parts 1025", "1..=1024"),
        ("render v.mha -o p.png --background 0,0,2", "between 0 and 1"),
        ("render v.mha -o p.png --window 5,5", "LO must lie below HI"),
        ("render v.mha -o p.png --mode glossy", "shaded"),
        ("render v.mha", "--output"),
    ] {
        let run = place.run(words);
        assert_eq!(run.code, 2, "{words}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{words}: {}", run.stderr);
        assert!(!place.names().contains("p.png"), "{words}");
    }
}

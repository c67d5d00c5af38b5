//! An incremental picture equals the one rendered from the finished volume.

use super::place::Place;

/// A sweep of the phantom; as a fan it uses the planar path.
fn sweep(flags: &str) -> Place {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha --image-size 48x40 --pixel 0.4 --frames 14 --gap 0.5 --noise 3 {flags}"));
    place
}

const VIEW_FLAGS: &str = "--image-size 64x48 --transfer phantom --view 40,25";

/// Replays with a picture and a volume, renders the volume, and returns both pictures.
fn both(place: &Place, replay: &str, view_flags: &str) -> (Vec<u8>, Vec<u8>) {
    let run = place.run(&format!(
        "animate s.mha --clip none --picture p.png -o v.mha --type f32 --weights w.mha --json=s.json {replay} {view_flags}"
    ));
    assert_eq!(run.code, 0, "{replay}: {}", run.stderr);
    place.does(&format!("render v.mha --weights w.mha -o q.png {view_flags}"));
    (place.get("p.png"), place.get("q.png"))
}

fn check(place: &Place, path: &str, replay: &str, view_flags: &str) -> Vec<u8> {
    let (live, still) = both(place, replay, view_flags);
    assert!(live == still, "{path} {replay} {view_flags}: not the same picture");
    assert_eq!(place.json("s.json")["path"], path, "{replay}");
    let picture = image::load_from_memory(&live).unwrap().to_rgb8();
    assert!(picture.pixels().filter(|p| p.0[0] > 20).count() > 100, "{path} {replay}: something is seen");
    live
}

#[test]
fn general_path_picture_equals_its_volume_bitwise() {
    let place = sweep("");
    let first = check(&place, "general", "--cache none --threads 1", VIEW_FLAGS);
    for replay in [
        "--cache linear --threads 1",
        "--cache none --threads 3",
        "--cache linear --threads 3",
        "--cache two-level --threads 3",
        "--cache one-level --threads 1",
        "--cache linear --cache-bytes 1000",
        "--parts 2 --threads 1",
        "--parts 3 --threads 2",
    ] {
        assert!(check(&place, "general", replay, VIEW_FLAGS) == first, "{replay}");
    }
    let in_parts = place.json("s.json")["picture"].clone();
    assert_eq!((&in_parts["parts"], &in_parts["cache"]), (&3.into(), &"one-level".into()), "{in_parts}");
    check(&place, "general", "--cache linear", &format!("{VIEW_FLAGS} --perspective 40 --step 0.7 --arity 5"));
    check(&place, "general", "", &format!("{VIEW_FLAGS} --adaptive 0.02"));
    // The equality is not trivial: without weights, and without the box of the slices, the
    // picture differs.
    let (live, _) = both(&place, "", VIEW_FLAGS);
    place.does(&format!("render v.mha --weights w.mha -o q.png {VIEW_FLAGS} --threads 1"));
    assert!(place.get("q.png") == live);
    let run = place.run(&format!("render v.mha -o q.png {VIEW_FLAGS}"));
    assert!(run.code == 0 && run.stderr.contains("count as not seen") && place.get("q.png") != live, "{}", run.stderr);
    let mut bytes = place.get("v.mha");
    let at = bytes.windows(18).position(|w| w == b"SonoweaveSlicesBox").unwrap();
    bytes[at + 17] = b'y';
    place.put("v.mha", bytes);
    place.does(&format!("render v.mha --weights w.mha -o q.png {VIEW_FLAGS}"));
    assert!(place.get("q.png") != live);
    // On a lattice with an offset from the world's origin, its bricks differ from the
    // inserter's.
    check(&place, "general", "--cache linear --origin 0.13,-7.31,3.7", VIEW_FLAGS);
    check(&place, "general", "--cache linear --compound maximum", VIEW_FLAGS);
    check(&place, "general", "--cache linear --compound decay --decay exp", VIEW_FLAGS);
}

#[test]
fn planar_path_picture_equals_its_volume_bitwise() {
    let place = sweep("--trajectory fan");
    let first = check(&place, "planar", "--cache none --threads 1", VIEW_FLAGS);
    for replay in ["--cache linear --threads 1", "--cache linear --threads 3", "--cache one-level", "--cache two-level"]
    {
        assert!(check(&place, "planar", replay, VIEW_FLAGS) == first, "{replay}");
    }
    check(&place, "planar", "--cache linear --compound decay", VIEW_FLAGS);
}

#[test]
fn path_change_does_not_change_the_picture() {
    let place = Place::new();
    let pose = |frame: u32| match frame {
        3 => format!("0.49990 0 0 0 0 0.5 0 0 -0.01 0 1 {frame} 0 0 0 1"),
        _ => super::sequence::pose(f64::from(frame)),
    };
    place.put("s.mha", super::sequence::Sequence { pose, ..Default::default() }.bytes());
    let view_flags = "--image-size 64x48 --transfer xray";
    for cache in ["none", "linear", "two-level", "one-level"] {
        check(&place, "planar, then general", &format!("--cache {cache} --path planar --spacing 0.5"), view_flags);
    }
}

#[test]
fn rendered_box_is_known_before_the_first_slice() {
    let place = sweep("");
    place.does(&format!("animate s.mha --clip none --pictures . {VIEW_FLAGS} -o v.mha"));
    place.does("reconstruct s.mha --clip none -o r.mha");
    let (followed, plain) = (place.volume("v.mha"), place.volume("r.mha"));
    let text = plain.field("SonoweaveSlicesBox").to_owned();
    assert_eq!(followed.field("SonoweaveSlicesBox"), text);
    let numbers: Vec<i64> = text.split(' ').map(|n| n.parse().unwrap()).collect();
    let [lx, ly, lz, hx, hy, hz] = numbers[..] else { panic!("{text}") };
    let size = plain.header.size.map(i64::from);
    // It contains the file, and little more: the kernels' corners and a margin of one voxel.
    for (low, high, size) in [(lx, hx, size[0]), (ly, hy, size[1]), (lz, hz, size[2])] {
        assert!((-8..=0).contains(&low) && (size - 1..size + 8).contains(&high), "{text} about {size}");
    }
    assert_eq!(plain.field("SonoweaveRange"), "0 255");
    assert_eq!(place.names().iter().filter(|n| n.starts_with("frame-000") && n.ends_with(".png")).count(), 14);
    // For a cropped volume, the picture shows the remainder.
    place.does("reconstruct s.mha --clip none -o c.mha --size 9,9,9");
    assert!(place.volume("c.mha").header.fields.iter().all(|(name, _)| name != "SonoweaveSlicesBox"));
}

#[test]
fn intermediate_pictures_and_statistics_are_written() {
    let place = sweep("");
    std::fs::create_dir(place.path("way")).unwrap();
    let said = place.does(&format!(
        "animate s.mha --clip none --speed max --picture p.png --pictures way --every 5 --json=s.json --arity 4 --threads 1 {VIEW_FLAGS}"
    ));
    assert!(
        said.contains("p.png: 64×48 pixels")
            && said.contains("ms from slice to picture")
            && said.contains("one-level cache"),
        "{said}"
    );
    let mut way: Vec<_> = std::fs::read_dir(place.path("way")).unwrap().map(|e| e.unwrap().file_name()).collect();
    way.sort();
    assert_eq!(way, ["frame-00004.png", "frame-00009.png"]);
    let s = place.json("s.json");
    for stage in ["slice_to_picture_ms", "insert_ms", "shade_ms", "rays_ms"] {
        let [median, p95, p99, max] = ["median", "p95", "p99", "max"].map(|q| s[stage][q].as_f64().unwrap());
        assert!(0.0 < median && median <= p95 && p95 <= p99 && p99 <= max, "{stage}");
    }
    assert!(s["slice_to_picture_ms"]["total"].as_f64() > s["insert_ms"]["total"].as_f64());
    let picture = &s["picture"];
    assert_eq!((&picture["cache"], &picture["arity"]), (&"one-level".into(), &4.into()));
    assert!(picture["cache_bytes"].as_u64().unwrap() > 64 * 48 * 8 && picture["notes"].as_array().unwrap().is_empty());
    for key in ["bricks_read", "voxels_shaded", "rays", "samples", "pixels_changed"] {
        assert!(picture["work"][key].as_u64().unwrap() > 0, "{key}");
    }
    assert_eq!((&s["scalar"], &s["frames"]["used"]), (&serde_json::Value::Null, &14.into()));
    assert!(!place.names().contains("v.mha"));
    // Too little memory for the cache: this is reported, and nothing else changes.
    let before = place.get("p.png");
    let run = place.run(&format!(
        "animate s.mha --clip none --picture p.png --cache-bytes 1000 --json=s.json --arity 4 {VIEW_FLAGS}"
    ));
    assert!(run.code == 0 && run.stderr.contains("--cache-bytes"), "{}", run.stderr);
    assert!(place.get("p.png") == before && place.json("s.json")["picture"]["cache"] == "none");
}

#[test]
fn impossible_replays_are_refused() {
    let place = sweep("");
    for (words, says) in [
        ("animate s.mha", &["nothing to draw", "--picture", "reconstruct"][..]),
        ("animate s.mha -o v.mha --json=s.json", &["nothing to draw"]),
        ("animate s.mha --picture none/p.png", &["the folder none does not exist"]),
        ("animate s.mha --picture p.jpg", &[".png"]),
        ("animate s.mha --pictures none", &["--pictures none", "the folder does not exist"]),
        ("animate s.mha --picture p.png --image-size 100000x100000", &["100000"]),
        ("animate s.mha --picture p.png --transfer muscle", &["muscle", "tissue"]),
        ("animate s.mha --picture p.png --perspective -3", &["view"]),
        ("animate s.mha --picture p.png -o v.vtk", &["v.vtk", ".mha"]),
        ("animate s.mha --picture p.png --step 1e-4", &["--step"]),
    ] {
        let words = words.replace("--perspective -3", "--perspective=-3");
        place.refuses(&words, says);
    }
    for (words, says) in [
        ("animate s.mha --picture p.png --speed 0", "1 is the recorded speed"),
        ("animate s.mha --picture p.png --cache all", "linear"),
        ("animate s.mha --picture p.png --every 2", "--pictures"),
        ("animate s.mha --pictures . --every 0", "--every"),
        ("animate s.mha --picture p.png --view 1,nan", "must be finite"),
    ] {
        let run = place.run(words);
        assert_eq!(run.code, 2, "{words}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{words}: {}", run.stderr);
    }
}

//! Plane images, and overlays on pictures.

use std::io::Write as _;

use image::RgbImage;
use serde_json::Value;

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use sonoweave_core::reading::PixelType;

use super::place::Place;

/// The colour of unseen voxels.
const UNSEEN: [u8; 3] = [46, 64, 96];

fn put(place: &Place, name: &str, header: &VolumeHeader, bytes: &[u8]) {
    let mut file = VolumeWriter::create(&place.path(name), header).unwrap();
    file.write_all(bytes).unwrap();
    file.finish().unwrap();
}

/// Grey values 10·x + 5 of voxels at 0 to 19 mm. They are seen for y < 10 mm, with a weight of
/// 3, and of 6 from z = 8 mm on.
fn ramp() -> Place {
    let place = Place::new();
    let size = [20_u32, 16, 12];
    let header = VolumeHeader::new(size, PixelType::U8);
    let (mut values, mut weights) = (Vec::new(), Vec::new());
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                values.push(u8::try_from(10 * x + 5).unwrap());
                let weight: f32 = if y >= 10 {
                    0.0
                } else if z < 8 {
                    3.0
                } else {
                    6.0
                };
                weights.extend(weight.to_ne_bytes());
            }
        }
    }
    put(&place, "v.mha", &header, &values);
    put(&place, "w.mha", &VolumeHeader { pixel: PixelType::F32, ..header }, &weights);
    place
}

fn picture(place: &Place, name: &str) -> RgbImage {
    image::load_from_memory(&place.get(name)).unwrap().to_rgb8()
}

fn three(value: &Value) -> [f64; 3] {
    std::array::from_fn(|k| value[k].as_f64().unwrap())
}

/// Calls `of` with every plane pixel's world position and colour, according to the statistics.
fn walk(picture: &RgbImage, plane: &Value, mut of: impl FnMut([f64; 3], [u8; 3])) {
    let whole = |key: &str, k: usize| u32::try_from(plane[key][k].as_u64().unwrap()).unwrap();
    let (first, right, down) = (three(&plane["first_mm"]), three(&plane["right_mm"]), three(&plane["down_mm"]));
    for j in 0..whole("size_px", 1) {
        for i in 0..whole("size_px", 0) {
            let at = std::array::from_fn(|a| first[a] + right[a] * f64::from(i) + down[a] * f64::from(j));
            of(at, picture.get_pixel(whole("corner_px", 0) + i, whole("corner_px", 1) + j).0);
        }
    }
}

/// Returns the interpolation weight of seen voxels at a position, if voxels are seen up to
/// `last` along y.
fn share([x, y, z]: [f64; 3], last: f64) -> f64 {
    let along = |at: f64, last: f64| (1.0 + at).min(1.0 + last - at).clamp(0.0, 1.0);
    along(x, 19.0) * along(y, last) * along(z, 11.0)
}

#[test]
fn three_planes_show_ramp_values_at_stated_positions() {
    let place = ramp();
    let said = place.does("render v.mha --weights w.mha -o p.png --mode slice --image-size 400x360 --json=s.json");
    assert!(
        said.starts_with("p.png: 400×360 pixels, xy at z = 5.5 mm; xz at y = 7.5 mm; zy at x = 9.5 mm, ")
            && said.contains(" mm a pixel, of v.mha, in "),
        "{said}"
    );
    let s = place.json("s.json");
    assert_eq!((&s["mode"], &s["window"]), (&"slice".into(), &serde_json::json!([0.0, 255.0])));
    assert_eq!((&s["picture"]["drawn"], &s["picture"]["overlay"]), (&serde_json::json!(["scale"]), &Value::Null));
    let drawn = picture(&place, "p.png");
    assert_eq!(drawn.dimensions(), (400, 360));
    let (mut seen, mut unseen, mut counted) = (0_u64, 0_u64, 0);
    for plane in s["picture"]["planes"].as_array().unwrap() {
        counted += plane["pixels_seen"].as_u64().unwrap();
        walk(&drawn, plane, |at, colour| {
            let share = share(at, 9.0);
            if share < 0.5 - 1e-6 {
                assert_eq!(colour, UNSEEN, "{at:?}");
                unseen += 1;
            } else if share > 0.5 + 1e-6 {
                // The ramp between the outermost voxels' centres, and their own values beyond.
                let grey = (10.0 * at[0].clamp(0.0, 19.0) + 5.0).round();
                assert!((f64::from(colour[0]) - grey).abs() <= 1.0 && colour[0] == colour[2], "{at:?}: {colour:?}");
                seen += 1;
            }
        });
    }
    assert!(seen > 10_000 && unseen > 5000 && counted >= seen, "{seen} {unseen} {counted}");
    let work = &s["work"];
    assert!(work["voxels_read"].as_u64().unwrap() >= 8 * seen && work["pixels_outside"] == 0, "{work}");
    // At another position, and with any number of threads.
    place.does("render v.mha --weights w.mha -o q.png --mode slice --image-size 400x360 --threads 3");
    assert!(place.get("q.png") == place.get("p.png"));
    let said =
        place.does("render v.mha -o q.png --mode slice --at 3,4.5,-0.5 --draw none --image-size 400x360 --json=s.json");
    assert!(said.contains("xy at z = -0.5 mm; xz at y = 4.5 mm; zy at x = 3 mm"), "{said}");
    assert_eq!(place.json("s.json")["picture"]["drawn"], serde_json::json!([]));
    let across = place.json("s.json")["picture"]["planes"][2].clone();
    walk(&picture(&place, "q.png"), &across, |at, colour| {
        let seen = share(at, 15.0);
        assert!((seen - 0.5).abs() < 1e-6 || colour == if seen > 0.5 { [35; 3] } else { UNSEEN }, "{at:?}: {colour:?}");
    });
}

#[test]
fn free_plane_shows_ramp_values() {
    let place = ramp();
    let view_flags = "--mode slice --image-size 300x300 --json=s.json";
    let said = place
        .does(&format!("render v.mha --weights w.mha -o p.png {view_flags} --plane 9,5,5,0.5,-1,0.7 --window 0,200"));
    assert!(said.contains("through 9, 5, 5 mm, across 0.38, -0.76, 0.53"), "{said}");
    let s = place.json("s.json");
    let mut seen = 0;
    walk(&picture(&place, "p.png"), &s["picture"]["planes"][0], |at @ [x, y, z], colour| {
        let off = 0.5 * (at[0] - 9.0) - (at[1] - 5.0) + 0.7 * (at[2] - 5.0);
        assert!(off.abs() < 1e-9, "{at:?} lies in the plane");
        let inside = (0.0..=19.0).contains(&x) && (0.0..=9.0).contains(&y) && (0.0..=11.0).contains(&z);
        let near = [(x, 19.51), (y, 9.51), (z, 11.51)].iter().all(|(at, last)| (-0.51..=*last).contains(at));
        if inside {
            let grey = ((10.0 * x + 5.0) / 200.0 * 255.0).round();
            assert!((f64::from(colour[0]) - grey).abs() <= 1.0, "{at:?}: {colour:?}");
            seen += 1;
        }
        assert!(near || colour == UNSEEN, "{at:?}: {colour:?}");
    });
    assert!(seen > 5000 && s["work"]["pixels_outside"].as_u64().unwrap() > 1000, "{seen} {}", s["work"]);
    // The requested up direction: +x.
    place.does(&format!("render v.mha -o p.png {view_flags} --plane 9,5,5,0,0,1,1,0,0"));
    let [dx, dy, dz] = three(&place.json("s.json")["picture"]["planes"][0]["down_mm"]);
    assert!(dx < 0.0 && dy.abs() < 1e-12 && dz.abs() < 1e-12);
}

#[test]
fn overlays_tint_the_pixels_they_concern() {
    let place = ramp();
    let draw = |flags: &str| {
        place.does(&format!(
            "render v.mha --weights w.mha -o p.png --mode slice --image-size 300x280 --at 9,5,5 --json=s.json {flags}"
        ));
        (picture(&place, "p.png"), place.json("s.json")["picture"].clone())
    };
    let (plain, _) = draw("");
    let (coverage, said) = draw("--overlay coverage");
    assert_eq!(said["overlay"], "coverage");
    walk(&coverage, &said["planes"][0], |[x, y, _], colour| {
        // Completely unseen is orange; completely seen is grey.
        if y > 10.01 {
            assert!(colour[0] > 180 && colour[2] < 80, "{y}: {colour:?}");
        }
        if y < 8.99 && y > 0.01 && (0.0..=19.0).contains(&x) {
            assert_eq!(colour[0], colour[2], "{y}");
        }
    });
    let (weight, said) = draw("--overlay weight");
    let (mut sums, mut counts) = ([[0_u64; 3]; 2], [0_u64; 2]);
    walk(&weight, &said["planes"][1], |[x, _, z], colour| {
        if (0.0..19.0).contains(&x) && ((1.0..6.0).contains(&z) || (9.0..11.0).contains(&z)) {
            (0..3).for_each(|c| sums[usize::from(z > 8.0)][c] += u64::from(colour[c]));
            counts[usize::from(z > 8.0)] += 1;
        }
    });
    assert!(weight != plain && weight != coverage && counts.iter().all(|n| *n > 500), "{counts:?}");
    // Both are coloured, and the part with the larger weight is paler.
    let mean = |part: usize| sums[part].iter().sum::<u64>() / (3 * counts[part]);
    assert!(sums.iter().all(|[r, _, b]| r > b) && mean(1) > mean(0) + 20, "{sums:?} {counts:?}");
}

/// A sweep of the phantom.
fn sweep() -> Place {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 48x40 --pixel 0.4 --frames 14 --gap 0.5 --noise 3");
    place
}

#[test]
fn replay_planes_equal_volume_planes() {
    let place = sweep();
    for flags in ["", "--plane 0,0,0,1,1,1", "--overlay weight --origin 0.13,-7.31,3.7"] {
        let (view_flags, lattice) =
            flags.split_once(" --origin").map_or((flags, String::new()), |(l, o)| (l, format!("--origin{o}")));
        let view_flags = format!("--mode slice --image-size 260x250 {view_flags}");
        place.does(&format!(
            "animate s.mha --clip none --picture p.png -o v.mha --type f32 --weights w.mha --json=s.json {view_flags} {lattice}"
        ));
        let s = place.json("s.json");
        assert_eq!((&s["from"], &s["nearest_work"]), (&"volume".into(), &Value::Null));
        assert!(s["planar_work"]["voxels_read"].as_u64().unwrap() > 1000);
        place.does(&format!("render v.mha --weights w.mha -o q.png {view_flags}"));
        assert!(place.get("p.png") == place.get("q.png"), "{flags}");
    }
}

#[test]
fn raw_planes_show_the_nearest_slices() {
    let place = sweep();
    std::fs::create_dir(place.path("way")).unwrap();
    let flags = "--clip none --picture p.png --mode slice --from raw --image-size 260x250 --json=s.json";
    let said = place.does(&format!("animate s.mha {flags} --pictures way --every 7"));
    assert!(said.contains("p.png: 260×250 pixels") && said.contains("of the nearest slices"), "{said}");
    let s = place.json("s.json");
    let work = &s["nearest_work"];
    let [pixels, considered, taken] =
        ["pixels", "pixels_considered", "pixels_taken"].map(|key| work[key].as_u64().unwrap());
    assert_eq!(work["slices"], 3 * 14);
    assert!(0 < taken && taken <= considered && 2 * considered < pixels, "{work}");
    assert!(s["reach_mm"].as_f64().unwrap() > 0.2 && s["from"] == "raw" && s["planar_work"].is_null());
    let seen = s["picture"]["planes"][0]["pixels_seen"].as_u64().unwrap();
    assert!(seen > 500, "{seen}");
    // The last intermediate picture has seen every slice.
    let last = std::fs::read(place.path("way/frame-00013.png")).unwrap();
    assert!(last == place.get("p.png") && std::fs::read(place.path("way/frame-00006.png")).unwrap() != last);
    // It differs from the volume's.
    place.does("animate s.mha --clip none --picture q.png --mode slice --image-size 260x250");
    assert!(place.get("q.png") != place.get("p.png"));
}

#[test]
fn overlays_leave_other_pixels_unchanged() {
    let place = sweep();
    std::fs::create_dir(place.path("way")).unwrap();
    let view_flags = "--image-size 240x200 --transfer phantom --view 40,25 --clip none --threads 1 --json=s.json";
    let replay = |name: &str, flags: &str| {
        place.does(&format!("animate s.mha --picture {name} {view_flags} {flags}"));
        (picture(&place, name), place.json("s.json")["drawn"].clone())
    };
    let (plain, none) = replay("p.png", "--pictures way --every 14");
    assert_eq!(none, serde_json::json!([]));
    // Intermediate pictures show slice and probe; the final one does so on request.
    let (over, drawn) = replay("q.png", "--draw probe,slice");
    assert_eq!(drawn, serde_json::json!(["slice", "probe"]));
    assert!(std::fs::read(place.path("way/frame-00013.png")).unwrap() == place.get("q.png"));
    let (none, _) = replay("n.png", "--draw none --pictures way --every 14");
    assert!(none == plain && std::fs::read(place.path("way/frame-00013.png")).unwrap() == place.get("p.png"));
    let differing = |other: &RgbImage| plain.pixels().zip(other.pixels()).filter(|(a, b)| a != b).count();
    let yellow = over.pixels().filter(|p| p.0[0] > 200 && p.0[2] < 120).count();
    assert!(yellow > 100 && (yellow..240 * 200 / 6).contains(&differing(&over)), "{yellow} {}", differing(&over));
    let (all, drawn) = replay("q.png", "--draw slice,probe,scale,cube");
    assert_eq!(drawn, serde_json::json!(["slice", "probe", "scale", "cube"]));
    assert!(differing(&all) > differing(&over));
    // A volume's picture has a scale and a cube, in their corners.
    place.does("reconstruct s.mha --clip none -o v.mha --weights w.mha");
    let render = "render v.mha --weights w.mha --image-size 240x200 --transfer phantom --json=s.json";
    place.does(&format!("{render} -o p.png"));
    place.does(&format!("{render} -o q.png --draw scale,cube"));
    assert_eq!(place.json("s.json")["pictures"][0]["drawn"], serde_json::json!(["scale", "cube"]));
    let (plain, over) = (picture(&place, "p.png"), picture(&place, "q.png"));
    let corners = plain.enumerate_pixels().filter(|(x, y, p)| *p != over.get_pixel(*x, *y));
    let (mut left, mut right) = (0, 0);
    for (x, y, _) in corners {
        assert!(y > 140 && !(90..=180).contains(&x), "{x} {y}");
        (left, right) = (left + u32::from(x < 90), right + u32::from(x > 180));
    }
    assert!(left > 100 && right > 400, "{left} {right}");
}

#[test]
fn impossible_planes_are_refused() {
    let place = ramp();
    for (flags, says) in [
        ("--plane 1,2,3,0,0,0 --mode slice", &["--plane", "normal 0, 0, 0", "no direction"][..]),
        ("--plane 1,2,3,0,0,1,0,0,2 --mode slice", &["--plane", "along its normal"]),
        (
            "--plane 1,2,300,0,0,1 --mode slice",
            &["--plane", "misses the volume", "-0.50, -0.50, -0.50 to 19.50, 15.50, 11.50"],
        ),
        ("--at 1,2,300 --mode slice", &["--at", "misses the volume"]),
        ("--at 1,2,3 --plane 1,2,3,0,0,1 --mode slice", &["--at, --plane", "or --plane for a free one"]),
        ("--at 1,2,3", &["--at", "--mode slice"]),
        ("--plane 1,2,3,0,0,1", &["--plane", "--mode slice"]),
        ("--overlay coverage", &["--overlay", "--mode slice"]),
        ("--overlay weight --mode slice", &["--overlay weight", "--weights"]),
        ("--view 1,2 --mode slice", &["--view", "does not apply"]),
        ("--transfer bone --mode slice", &["--transfer", "does not apply", "--window"]),
        ("--step 0.5 --mode slice", &["--step"]),
        ("--perspective 30 --mode slice", &["--perspective"]),
        ("--background 1,1,1 --mode slice", &["--background"]),
        ("--turntable 3 --mode slice", &["--turntable"]),
        ("--draw cube --mode slice", &["--draw cube", "scale or none"]),
        ("--draw slice", &["--draw slice", "replay"]),
        ("--draw scale,none", &["--draw none"]),
        ("--mode slice --image-size 9x9", &["9×9", "no room"]),
    ] {
        place.refuses(&format!("render v.mha -o p.png {flags}"), says);
    }
    for (flags, says) in [
        ("--plane 1,2,3,0,nan,0 --mode slice", "must be finite"),
        ("--plane 1,2,3,0 --mode slice", "a point, a normal"),
        ("--at inf,0,0 --mode slice", "must be finite"),
        ("--draw rulers", "scale"),
        ("--overlay red --mode slice", "coverage"),
    ] {
        let run = place.run(&format!("render v.mha -o p.png {flags}"));
        assert_eq!(run.code, 2, "{flags}: {}", run.stderr);
        assert!(run.stderr.contains(says), "{flags}: {}", run.stderr);
    }
    let place = sweep();
    for (flags, says) in [
        ("--from raw", &["--from raw", "--mode slice"][..]),
        ("--from raw --mode slice --overlay weight", &["--overlay weight", "--from volume"]),
        ("--mode slice --cache none", &["--cache", "no"]),
        ("--mode slice --at 999,0,0", &["--at", "misses the volume"]),
    ] {
        place.refuses(&format!("animate s.mha --clip none --picture p.png {flags}"), says);
    }
}

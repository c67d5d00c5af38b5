//! Surfaces of volumes: meshes, their measures and files.

use std::f64::consts::PI;

use formats::image::VolumeHeader;
use sonoweave_core::reading::PixelType;

use super::ome_zarr::succeeds;
use super::place::Place;
use super::render::put;

/// Voxels along each edge, and their spacing, mm.
const EDGE: i32 = 60;
const SPACING: f64 = 0.5;
/// Radius of the large ball about (14, 15, 15) mm, and of the small one about (27.5, 15, 15).
const RADII: [f64; 2] = [10.0, 1.5];

/// A volume with two balls of the value 100, whose borders are 2 mm wide.
fn balls() -> Place {
    let place = Place::new();
    let header = VolumeHeader { spacing: [SPACING; 3], ..VolumeHeader::new([EDGE as u32; 3], PixelType::F32) };
    let value = |i: i32| {
        let at = [i % EDGE, i / EDGE % EDGE, i / (EDGE * EDGE)].map(|n| f64::from(n) * SPACING);
        let inside = [14.0, 27.5]
            .into_iter()
            .zip(RADII)
            .map(|(x, radius)| radius - ((at[0] - x).powi(2) + (at[1] - 15.0).powi(2) + (at[2] - 15.0).powi(2)).sqrt());
        (50.0 * (inside.fold(f64::MIN, f64::max) + 1.0)).clamp(0.0, 100.0) as f32
    };
    let values: Vec<u8> = (0..EDGE.pow(3)).flat_map(|i| value(i).to_ne_bytes()).collect();
    put(&place, "v.mha", &header, &values);
    place
}

fn near(value: &serde_json::Value, expected: f64, share: f64) {
    let value = value.as_f64().unwrap();
    assert!((value / expected - 1.0).abs() < share, "{value} for {expected}");
}

#[test]
fn surface_of_balls_has_their_area_and_volume() {
    let place = balls();
    let volume = |radius: f64| 4.0 / 3.0 * PI * radius.powi(3);
    let area = |radius: f64| 4.0 * PI * radius * radius;
    let said = place.run("surface v.mha -o all.stl --json=s.json");
    assert_eq!(said.code, 0, "{}", said.stderr);
    assert!(said.stdout.contains("all.stl: ") && said.stdout.contains("triangles in 2 parts, area"), "{}", said.stdout);
    let s = place.json("s.json");
    assert_eq!((&s["isovalue"], &s["parts"], &s["euler_number"]), (&50.0.into(), &2.into(), &4.into()));
    assert_eq!((&s["closed"], &s["open_edges"]), (&true.into(), &0.into()));
    near(&s["volume_mm3"], RADII.map(volume).iter().sum(), 0.01);
    near(&s["area_mm2"], RADII.map(area).iter().sum(), 0.01);
    let triangles = s["triangles"].as_u64().unwrap() as usize;
    assert_eq!(place.get("all.stl").len(), 84 + 50 * triangles);
    succeeds(&place, "surface v.mha -o one.ply --largest --blur 0 --json=s.json");
    let s = place.json("s.json");
    assert_eq!(s["parts"], 1);
    near(&s["volume_mm3"], volume(RADII[0]), 0.005);
    // The ball's own border is straight, so that only the lattice's share is given back.
    near(&s["compensated"]["volume_mm3"], volume(RADII[0]), 0.001);
    assert_eq!((&s["blur_mm"], &s["unmoved"]), (&0.0.into(), &0.into()));
    for (name, begins) in [("one.ply", &b"ply\n"[..]), ("two.obj", b"#"), ("two.glb", b"glTF")] {
        succeeds(&place, &format!("surface v.mha -o {name} --threads 1"));
        let first = place.get(name);
        assert!(first.starts_with(begins), "{name}");
        succeeds(&place, &format!("surface v.mha -o {name} --threads 3"));
        assert!(place.get(name) == first, "{name}: other threads");
    }
    let text = String::from_utf8_lossy(&place.get("two.obj")[..400]).into_owned();
    assert!(text.contains("grey value 50 of v.mha") && text.contains("Not a medical device"), "{text}");
}

#[test]
fn surface_that_coverage_or_a_cut_ends_has_no_volume() {
    let place = balls();
    let cut = "format = \"sonoweave-crop\"\nversion = 1\n[[operation]]\nhide = \"beyond_plane\"\npoint = [14, 0, 0]\n";
    place.put("c.toml", format!("{cut}normal = [1, 0, 0]\n"));
    let said = place.run("surface v.mha --crop c.toml --json=s.json");
    assert!(said.code == 0 && said.stdout.contains("it encloses no volume"), "{} {}", said.stdout, said.stderr);
    let s = place.json("s.json");
    assert_eq!((&s["closed"], &s["volume_mm3"]), (&false.into(), &serde_json::Value::Null));
    assert!(s["open_edges"].as_u64().unwrap() > 50);
    near(&s["area_mm2"], 2.0 * PI * RADII[0] * RADII[0], 0.05);
}

#[test]
fn surface_of_reconstruction_is_moved_back_by_its_kernel() {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 96x80 --pixel 0.4 --frames 60 --gap 0.4");
    succeeds(&place, "reconstruct s.mha --clip none -o v.mha --type f32 --weights w.mha");
    succeeds(&place, "surface v.mha --weights w.mha -o m.stl --largest --blur kernel --json=s.json");
    let s = place.json("s.json");
    let sigma = place.volume("v.mha").field("SonoweaveSigmaMm").to_owned();
    let squares: f64 = sigma.split(' ').map(|n| n.parse::<f64>().unwrap().powi(2)).sum();
    near(&s["blur_mm"], (squares / 3.0).sqrt(), 1e-9);
    assert!(s["moved"].as_u64().unwrap() > 100, "{s}");
}

#[test]
fn impossible_surfaces_are_refused() {
    let place = balls();
    for (words, code, says) in [
        ("surface v.mha -o m.off", 2, "must end in .stl, .ply, .obj or .glb"),
        ("surface v.mha -o m.stl --isovalue 200", 2, "no surface lies at this grey value"),
        ("surface v.mha -o m.stl --isovalue nan", 2, "must be a finite number"),
        ("surface v.mha -o m.stl --blur -1", 2, "not negative, or kernel"),
        ("surface v.mha -o m.stl --blur 9", 2, "take larger voxels"),
        ("surface v.mha -o m.stl --blur kernel", 2, "SonoweaveSigmaMm"),
        ("surface v.mha -o m.stl --max-memory 0.0013", 6, "raise the limit"),
        ("surface v.mha -o none/m.stl", 7, "the folder none does not exist"),
        ("surface none.mha -o m.stl", 3, "none.mha"),
        ("surface v.mha -o v.mha", 2, "must end in .stl"),
    ] {
        let run = place.run(words);
        assert!(run.code == code && run.stderr.contains(says), "{words}: {} {}", run.code, run.stderr);
    }
    assert_eq!(place.names().into_iter().collect::<Vec<_>>(), ["v.mha"]);
}

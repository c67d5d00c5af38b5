//! Parts of the volume that a crop file hides: in pictures, sweeps and sessions.

use super::ome_zarr::succeeds;
use super::place::{Place, SMALL_BEDSIDE};

const HEAD: &str = "format = \"sonoweave-crop\"\nversion = 1\n";

/// A sweep of the phantom and its volume; it lies about the world's origin.
fn place() -> Place {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 48x40 --pixel 0.4 --frames 14 --gap 0.5 --noise 3");
    succeeds(&place, "reconstruct s.mha --clip none -o v.mha --type f32 --weights w.mha");
    let ball = "[[operation]]\nhide = \"ball\"\ncentre = [2, 1.0, 3]\nradius = 2.5\n";
    let plane = "[[operation]]\nhide = \"beyond_plane\"\npoint = [0, 0, 0]\nnormal = [1, 0.2, 0]\n";
    place.put("c.toml", format!("{HEAD}{ball}{plane}"));
    place.put("all.toml", format!("{HEAD}{ball}{plane}[[operation]]\nhide = \"nothing\"\n"));
    place
}

const FLAGS: &str = "--image-size 64x48 --transfer phantom --view 40,25";

#[test]
fn crop_hides_parts_of_pictures_and_following_ones_alike() {
    let place = place();
    let render = |name: &str, more: &str| {
        succeeds(&place, &format!("render v.mha --weights w.mha -o {name} --json={name}.json {FLAGS} {more}"));
        place.get(name)
    };
    let whole = render("whole.png", "");
    let cut = render("cut.png", "--crop c.toml");
    assert!(cut != whole);
    assert_eq!(place.json("cut.png.json")["crop"], 2);
    let pixels = |png: &[u8]| image::load_from_memory(png).unwrap().to_luma8().pixels().filter(|p| p.0[0] > 20).count();
    assert!(2 * pixels(&cut) < pixels(&whole) && pixels(&cut) > 30, "{} of {}", pixels(&cut), pixels(&whole));
    assert!(render("all.png", "--crop all.toml") == whole, "all is shown again");
    assert_eq!(place.json("all.png.json")["crop"], 0);
    assert!(render("parts.png", "--crop c.toml --parts 3 --threads 2") == cut);
    succeeds(&place, &format!("animate s.mha --clip none --picture last.png --crop c.toml {FLAGS}"));
    assert!(place.get("last.png") == cut, "the picture that followed the sweep");
}

#[test]
fn messages_of_parts_are_of_one_crop() {
    let place = place();
    succeeds(&place, "reconstruct s.mha --clip none -o v.ome.zarr --type f32");
    succeeds(&place, &format!("render v.ome.zarr -o whole.png {FLAGS} --crop c.toml"));
    for (number, crop) in [(1, "c"), (2, "c"), (3, "all")] {
        let part = format!("{}/2", number.min(2));
        succeeds(&place, &format!("render v.ome.zarr -o {number}.part --part {part} {FLAGS} --crop {crop}.toml"));
    }
    succeeds(&place, &format!("render v.ome.zarr -o p.png --composite 1.part 2.part {FLAGS} --crop c.toml"));
    assert!(place.get("p.png") == place.get("whole.png"));
    let run = place.run(&format!("render v.ome.zarr -o q.png --composite 1.part 3.part {FLAGS} --crop c.toml"));
    assert!(run.code != 0 && run.stderr.contains("is of another picture"), "{}", run.stderr);
}

#[test]
fn session_keeps_the_crop_of_its_configuration() {
    let place = Place::new();
    let half = "[[operation]]\nhide = \"beyond_plane\"\npoint = [0, 0, 0]\nnormal = [1, 0, 0]\n";
    place.put("c.toml", format!("{HEAD}{half}"));
    let picture = "[picture]\nimage_size = \"64x64\"\ntransfer = \"phantom\"\n";
    place.put("b.toml", SMALL_BEDSIDE.replace("[virtual]", &format!("{picture}crop = \"c.toml\"\n[virtual]")));
    place.put("plain.toml", SMALL_BEDSIDE.replace("[virtual]", &format!("{picture}[virtual]")));
    succeeds(&place, "live --config b.toml --record rec --duration 3 --picture live.png --headless");
    let session = std::fs::read_dir(place.path("rec")).unwrap().next().unwrap().unwrap().path();
    std::fs::rename(session, place.path("s.mcap")).unwrap();
    std::fs::remove_file(place.path("c.toml")).unwrap();
    succeeds(&place, "replay s.mcap --picture again.png");
    assert!(place.get("again.png") == place.get("live.png"));
    succeeds(&place, "replay s.mcap --config plain.toml --picture whole.png");
    assert!(place.get("whole.png") != place.get("live.png"), "something was hidden");
}

#[test]
fn impossible_crops_are_refused() {
    let place = place();
    for (content, says) in [
        ("format = \"sonoweave-transfer\"\nversion = 1\n".into(), &["format (line 1)", "sonoweave-crop"][..]),
        ("format = \"sonoweave-crop\"\nversion = 2\n".into(), &["version (line 2)", "reads version 1"]),
        (format!("{HEAD}[[operation]]\nhide = \"cube\"\n"), &["operation[0]", "(line 4)", "cube", "outside_box"]),
        (format!("{HEAD}[[operation]]\nhide = \"ball\"\ncentre = [1, 2, 3]\n"), &["operation[0]", "radius"]),
        (
            format!(
                "{HEAD}[[operation]]\nhide = \"nothing\"\n[[operation]]\nhide = \"ball\"\ncentre = [1, 2, 3]\nradius = 0\n"
            ),
            &["operation[1] (line 5)", "operation 2 of the crop", "a radius above 0"],
        ),
        (format!("{HEAD}colour = 3\n"), &["colour"]),
    ] {
        place.put("bad.toml", content);
        let run = place.run(&format!("render v.mha -o p.png {FLAGS} --crop bad.toml"));
        assert!(run.code != 0);
        says.iter().for_each(|say| assert!(run.stderr.contains(say), "{say}: {}", run.stderr));
        assert!(!place.names().contains("p.png"));
    }
    for (words, says) in [
        ("render v.mha -o p.png --crop none.toml", "none.toml"),
        ("render v.mha -o p.png --crop c.toml --mode slice", "--crop: does not apply to --mode slice"),
    ] {
        let run = place.run(words);
        assert!(run.code != 0 && run.stderr.contains(says), "{words}: {}", run.stderr);
    }
}

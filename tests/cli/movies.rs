//! Movies: of a turntable, of a sweep and of a session.

use std::io::Cursor;

use image::codecs::png::PngDecoder;
use image::{AnimationDecoder as _, RgbImage};

use super::ome_zarr::succeeds;
use super::place::{Place, SMALL_BEDSIDE};
use super::sequence::Sequence;

/// The pictures of an animated PNG, and the time that each is shown, ms.
fn frames(place: &Place, name: &str) -> Vec<(RgbImage, f64)> {
    let decoder = PngDecoder::new(Cursor::new(place.get(name))).unwrap();
    let frames = decoder.apng().unwrap().into_frames().collect_frames().unwrap();
    let of = |frame: image::Frame| {
        let (numerator, denominator) = frame.delay().numer_denom_ms();
        let pixels = image::DynamicImage::ImageRgba8(frame.into_buffer()).to_rgb8();
        (pixels, f64::from(numerator) / f64::from(denominator))
    };
    frames.into_iter().map(of).collect()
}

fn picture(place: &Place, name: &str) -> RgbImage {
    image::load_from_memory(&place.get(name)).unwrap().to_rgb8()
}

/// A volume of a phantom, and its sweep.
fn phantom() -> Place {
    let place = Place::new();
    place.does("phantom -o s.mha --image-size 48x40 --pixel 0.4 --frames 14 --gap 0.5");
    succeeds(&place, "reconstruct s.mha --clip none -o v.mha");
    place
}

const TURNTABLE: &str = "--turntable 5 --image-size 40x30 --transfer phantom --threads 2";

#[test]
fn turntable_movie_has_pictures_of_numbered_files() {
    let place = phantom();
    succeeds(&place, &format!("render v.mha -o t.png {TURNTABLE}"));
    let run = place.run(&format!("render v.mha -o t.apng --movie-rate 12.5 --json=s.json {TURNTABLE}"));
    assert!(run.code == 0 && run.stdout.contains("t.apng, 5 pictures: 40×30"), "{} {}", run.stdout, run.stderr);
    let movie = frames(&place, "t.apng");
    assert_eq!(movie.len(), 5);
    for (number, (frame, shown_ms)) in movie.iter().enumerate() {
        assert!(*frame == picture(&place, &format!("t-00{number}.png")), "picture {number}");
        assert_eq!(*shown_ms, 80.0);
    }
    assert!(movie[0].0 != movie[2].0, "it turns");
    let s = place.json("s.json");
    assert_eq!(s["movie"]["hz"], 12.5);
    assert_eq!(s["movie"]["bytes"].as_u64().unwrap() as usize, place.get("t.apng").len());
    assert_eq!(s["pictures"].as_array().unwrap().len(), 5);
    for (name, begins) in [("t.gif", "GIF89a"), ("t.avi", "RIFF")] {
        succeeds(&place, &format!("render v.mha -o {name} {TURNTABLE}"));
        assert!(place.get(name).starts_with(begins.as_bytes()), "{name}");
    }
    let other = TURNTABLE.replace("threads 2", "threads 1");
    succeeds(&place, &format!("render v.mha -o again.apng --movie-rate 12.5 {other}"));
    assert!(place.get("again.apng") == place.get("t.apng"), "other threads");
}

#[test]
fn sweep_movie_shows_what_was_known_at_its_times() {
    let place = Place::new();
    // Two slices come within 20 ms, and then none for half a second.
    let times_ms = [1000, 1020, 1100, 1600, 1700, 1790];
    let sequence = Sequence::default();
    let mut text = sequence.header(None);
    for (number, ms) in times_ms.iter().enumerate() {
        let old = format!("Seq_Frame{number:04}_Timestamp = {}\n", number as f64 * 0.1);
        assert!(text.contains(&old), "{old}");
        text = text.replace(&old, &format!("Seq_Frame{number:04}_Timestamp = {}\n", f64::from(*ms) / 1e3));
    }
    place.put("s.mha", [text.into_bytes(), sequence.pixels()].concat());
    std::fs::create_dir(place.path("way")).unwrap();
    let flags = "--clip none --image-size 48x40 --transfer xray";
    succeeds(&place, &format!("animate s.mha --pictures way {flags}"));
    let said = place.run(&format!("animate s.mha --movie m.apng --movie-rate 10 {flags}"));
    assert!(said.code == 0 && said.stderr.contains("m.apng: 9 pictures, 0.9 s"), "{}", said.stderr);
    // Pictures at 1.0, 1.1 and up to 1.8 s: each of the last slice until then.
    let expected = [0, 2, 2, 2, 2, 2, 3, 4, 5];
    let movie = frames(&place, "m.apng");
    assert_eq!(movie.len(), expected.len());
    for (at, ((frame, shown_ms), slice)) in movie.iter().zip(expected).enumerate() {
        assert!(*frame == picture(&place, &format!("way/frame-{slice:05}.png")), "at {at} tenths");
        assert_eq!(*shown_ms, 100.0);
    }
}

#[test]
fn session_movie_has_pictures_at_fixed_times() {
    let place = Place::new();
    place.put("b.toml", SMALL_BEDSIDE);
    succeeds(&place, "live --config b.toml --record rec --duration 3 --headless");
    let session = std::fs::read_dir(place.path("rec")).unwrap().next().unwrap().unwrap().path();
    std::fs::rename(session, place.path("s.mcap")).unwrap();
    std::fs::create_dir(place.path("way")).unwrap();
    succeeds(&place, "replay s.mcap --pictures way");
    let mut names: Vec<_> = std::fs::read_dir(place.path("way")).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    let slices: Vec<RgbImage> = names.iter().map(|name| picture(&place, &format!("way/{}", name.display()))).collect();
    let said = place.run("replay s.mcap --movie m.apng --movie-rate 7 --json=s.json");
    assert_eq!(said.code, 0, "{}", said.stderr);
    let movie = frames(&place, "m.apng");
    assert!(said.stderr.contains(&format!("m.apng: {} pictures", movie.len())), "{}", said.stderr);
    // Each is the picture after a slice, and slices do not go back.
    let mut at = 0;
    for (number, (frame, shown_ms)) in movie.iter().enumerate() {
        let further = slices[at..].iter().position(|slice| slice == frame);
        at += further.unwrap_or_else(|| panic!("picture {number} is after no slice behind {at}"));
        assert!((shown_ms - 1e3 / 7.0).abs() < 1e-3);
        if number == 0 {
            assert_eq!(at, 0, "the first slice");
        }
    }
    assert!(movie[movie.len() - 1].0 == slices[slices.len() - 1], "the last slice");
    // 30 slices a second, so about four between two pictures, which are not rendered.
    assert!(slices.len() > 4 * (movie.len() - 2), "{} slices, {} pictures", slices.len(), movie.len());
    assert!(slices.len() < 5 * (movie.len() + 1), "{} slices, {} pictures", slices.len(), movie.len());
    let rendered = place.json("s.json")["pictures"].as_u64().unwrap();
    assert!(rendered <= movie.len() as u64 + 1, "{rendered} were rendered for {}", movie.len());
    succeeds(&place, "replay s.mcap --movie again.apng --movie-rate 7");
    assert!(place.get("again.apng") == place.get("m.apng"));
}

#[test]
fn impossible_movies_are_refused() {
    let place = phantom();
    for (words, says) in [
        ("render v.mha -o t.gif", &["t.gif", "a movie needs the number of its pictures", "--turntable", ".png"][..]),
        ("render v.mha -o t.mp4 --turntable 5", &["t.mp4", ".png"]),
        ("render v.mha -o t.png --turntable 5 --movie-rate 9", &["--movie-rate", "no movie is written", ".apng"]),
        ("render v.mha -o t.gif --turntable 5 --movie-rate 60", &["--movie-rate", "60 pictures a second", "0.1 to 50"]),
        ("render v.mha -o t.avi --turntable 5 --movie-rate 0", &["--movie-rate", "0.1 to 60"]),
        ("render v.mha -o none/t.avi --turntable 5", &["the folder none does not exist"]),
        ("animate s.mha --clip none --movie m.mov", &["m.mov", ".apng, .gif or .avi"]),
        ("animate s.mha --clip none --picture p.png --movie-rate 9", &["--movie-rate", "give --movie"]),
        ("animate s.mha --clip none --movie m.gif --mode slice", &["--movie", "applies to rays"]),
        ("animate s.mha --clip none --movie m.gif --pictures .", &["--pictures", "cannot be used with"]),
    ] {
        let run = place.run(words);
        assert!(run.code != 0, "{words}");
        says.iter().for_each(|say| assert!(run.stderr.contains(say), "{words}: {say}: {}", run.stderr));
    }
    let left: Vec<String> = place.names().into_iter().collect();
    assert_eq!(left, ["s.mha", "v.mha"], "nothing is left");
}

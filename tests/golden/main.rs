//! Golden pictures: small pictures of phantoms, each inspected when it was made, that may not
//! change unnoticed.
//!
//! `PICTURES` lists them; a further mode is a further line. The program itself makes the
//! phantoms, the volumes and the pictures; the pictures are compared with
//! `tests/golden/NAME.png`. No grey value may differ by more than [`MOST`], nor all of them by
//! more than [`RMS`] (root mean square). The bits are the same on every machine, but a changed
//! order of summation is permitted.
//!
//! If pictures are meant to change, or there is a new one: `SONOWEAVE_GOLDEN=renew cargo test
//! --test golden` writes those beyond the tolerance. Inspect each one enlarged before it is
//! committed: direction of the light, completeness, seams, speckles. Deviating pictures are
//! written to `out/golden`.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

#[path = "../cli/place.rs"]
#[allow(dead_code, reason = "another suite's helper, used in part")]
mod place;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use image::RgbImage;

use render::camera::View;
use render::classify::light::{DepthCue, Light};
use render::classify::transfer::Transfer;
use render::{RenderRegion, RenderSettings, Renderer};
use volume::DenseVolume;

use place::Place;

/// Returns the program, for [`place`].
fn program() -> std::process::Command {
    std::process::Command::new(env!("CARGO_BIN_EXE_sonoweave"))
}

/// Largest difference of a grey value, of 255.
const MOST: u8 = 2;
/// Root mean square of all differences, of 255.
const RMS: f64 = 0.5;
/// Pixels along each side.
const SIDE: u32 = 64;

/// Origin of a picture.
enum Drawn {
    /// Rendered by `sonoweave render` with these flags.
    By(&'static str),
    /// Rendered by the library, if there is no flag.
    With(fn(RenderSettings) -> RenderSettings),
}
use Drawn::{By, With};

/// Name, phantom and origin.
const PICTURES: [(&str, &str, Drawn); 17] = [
    ("tissue", "blobs", By("--transfer tissue --view 30,20")),
    ("bone", "sphere", By("--transfer bone --view 30,20")),
    ("surface", "blobs", By("--transfer surface --window 20,200 --view -60,-15")),
    ("xray", "blobs", By("--transfer xray --window 0,100 --view 100,10")),
    ("phantom", "blobs", By("--transfer phantom --view 30,20")),
    ("perspective", "blobs", By("--transfer tissue --view 210,35,20 --perspective 60")),
    ("background", "blobs", By("--transfer phantom --view 0,90 --background 0.3,0.1,0.5")),
    ("colours", "blobs", By("--transfer colours.toml --view 30,20")),
    ("coarse", "sphere", By("--transfer tissue --view 30,20 --step 3")),
    ("depth-cue", "blobs", With(fading)),
    ("maximum", "blobs", By("--mode mip --view 30,20")),
    ("average", "blobs", By("--mode average --window 40,140 --view 30,20")),
    ("isosurface", "blobs", By("--mode iso --isovalue 100 --view 30,20 --light 1,-1,1")),
    ("opacity", "blobs", By("--mode opacity --transfer phantom --view 30,20")),
    ("by-samples", "sphere", By("--shading sample --transfer surface --view 30,20")),
    ("adaptive", "blobs", By("--transfer tissue --view 30,20 --adaptive 0.03")),
    ("planes", "blobs", By("--mode slice --draw none")),
];

/// A transfer file with all of its parts.
const COLOURS: &str = "\
format = \"sonoweave-transfer\"
version = 1
unit_mm = 2
gradient = [[0, 0.2], [30, 1]]
[opacity]
curve = [[50, 0], [90, 0.5], [160, 0.95]]
[colour]
list = [[50, 0.1, 0.2, 0.7], [90, 0.2, 0.8, 0.4], [130, 1, 0.8, 0.1], [180, 1, 0.2, 0.1]]
";

fn fading(settings: RenderSettings) -> RenderSettings {
    let cue = DepthCue::new(1.0, 0.35).unwrap();
    let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
    RenderSettings { view, light: Light::default().with_depth_cue(Some(cue)), ..settings }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

/// Makes the volumes: reconstructed sweeps of phantoms with noise.
fn volumes() -> Place {
    let place = Place::new();
    let phantoms: BTreeSet<&str> = PICTURES.iter().map(|(_, phantom, _)| *phantom).collect();
    for phantom in phantoms {
        place.does(&format!("phantom -o s.mha --scene {phantom} --image-size 60x60 --pixel 0.5 --frames 40 --gap 0.75 --noise 4 --seed 5"));
        place.does(&format!(
            "reconstruct s.mha --clip none --spacing 0.6 -o {phantom}.mha --weights {phantom}-weights.mha"
        ));
    }
    place.put("colours.toml", COLOURS);
    place
}

fn draw(place: &Place, phantom: &str, drawn: &Drawn) -> RgbImage {
    match drawn {
        By(flags) => {
            place.does(&format!(
                "render {phantom}.mha --weights {phantom}-weights.mha -o p.png --image-size {SIDE}x{SIDE} {flags}"
            ));
            image::load_from_memory(&place.get("p.png")).unwrap().to_rgb8()
        }
        With(change) => {
            let [volume, weights] =
                [phantom.to_owned(), format!("{phantom}-weights")].map(|n| place.path(&format!("{n}.mha")));
            let volume = DenseVolume::open(&volume, Some(&weights), 1 << 30).unwrap();
            let transfer = Transfer::preset("tissue", volume.range().map(f64::from)).unwrap();
            let [low, high] = volume.bounds();
            let region = RenderRegion::new(volume.world_from_lattice(), low, high).unwrap();
            let mut renderer = Renderer::new(&change(RenderSettings::new([SIDE; 2], transfer)), region).unwrap();
            renderer.update_all(&volume);
            RgbImage::from_raw(SIDE, SIDE, renderer.picture().over([0.0; 3])).unwrap()
        }
    }
}

/// Returns the largest difference and the root mean square.
fn difference(a: &RgbImage, b: &RgbImage) -> (u8, f64) {
    if a.dimensions() != b.dimensions() {
        return (u8::MAX, f64::from(u8::MAX));
    }
    let off: Vec<u8> = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
    let squares: f64 = off.iter().map(|x| f64::from(*x).powi(2)).sum();
    (off.iter().copied().max().unwrap_or(0), (squares / off.len() as f64).sqrt())
}

#[test]
fn pictures_match_golden_files() {
    let renew = match std::env::var("SONOWEAVE_GOLDEN").as_deref() {
        Ok("renew") => true,
        Err(_) => false,
        Ok(other) => panic!("SONOWEAVE_GOLDEN is renew or absent, not {other:?}"),
    };
    let place = volumes();
    let mut failures = Vec::new();
    for (name, phantom, drawn) in &PICTURES {
        let picture = draw(&place, phantom, drawn);
        let golden = folder().join(format!("{name}.png"));
        let before = image::open(&golden).map(|picture| picture.to_rgb8());
        let fault = match &before {
            Ok(before) => match difference(&picture, before) {
                (most, rms) if most <= MOST && rms <= RMS => continue,
                (most, rms) => format!("off by up to {most} of 255, rms {rms:.2}"),
            },
            Err(error) => error.to_string(),
        };
        let instead = if renew {
            golden
        } else {
            let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/golden");
            std::fs::create_dir_all(&out).unwrap();
            out.join(format!("{name}.png"))
        };
        picture.save(&instead).unwrap();
        failures.push(format!("{name}: {fault}; what was drawn is {}", instead.display()));
    }
    assert!(
        failures.is_empty() || renew,
        "{}\nif this is meant, look at the pictures and run SONOWEAVE_GOLDEN=renew cargo test --test golden",
        failures.join("\n")
    );
}

#[test]
fn golden_files_are_listed_small_and_not_blank() {
    let listed: BTreeSet<String> = PICTURES.iter().map(|(name, ..)| format!("{name}.png")).collect();
    assert_eq!(listed.len(), PICTURES.len(), "two pictures of one name");
    let names = std::fs::read_dir(folder()).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned());
    let there: BTreeSet<String> = names.filter(|name| name.ends_with(".png")).collect();
    assert_eq!(there, listed, "files in tests/golden against the list");
    for name in there {
        let bytes = std::fs::read(folder().join(&name)).unwrap();
        assert!(bytes.len() < 12_000, "{name} has {} bytes", bytes.len());
        let picture = image::load_from_memory(&bytes).unwrap().to_rgb8();
        let corner = picture.get_pixel(0, 0).0;
        let seen = picture.pixels().filter(|p| (0..3).any(|c| p.0[c].abs_diff(corner[c]) > 15)).count();
        assert!(picture.dimensions() == (SIDE, SIDE) && seen > 200, "{name}: {seen} pixels show something");
    }
}

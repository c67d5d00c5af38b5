//! Fixed SHA-256 hashes of volumes and pictures that the libraries make, for every compounding,
//! kernel, insertion path and render mode.
//!
//! `bits.txt` lists them. Every number of threads and every instruction set of a machine must give
//! them, as must other processors: `scripts/arm64.sh` runs this test in an emulator. Slices are
//! made of integers and exact operations, so that they have the same bits everywhere, too. The
//! hashes of the whole program are in `tests/recordings`.
//!
//! A change that is meant to change results renews the list:
//! `SONOWEAVE_GOLDEN=renew cargo test -p sonoweave -p sonoweave-bits --test bits`.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

use std::fmt::Write;
use std::path::Path;
use std::sync::{Arc, Mutex};

use glam::{DAffine3, DMat3, DQuat, DVec3};
use sha2::{Digest, Sha256};

use mask::Mask;
use reconstruct::kernel::Method;
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::{Compounding, Decay, PathReconstructor, Settings, ShadowWeights};
use render::camera::View;
use render::classify::transfer::Transfer;
use render::{Mode, Picture, RenderRegion, RenderSettings, Renderer, Shading};
use simd::Simd;
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};
use volume::Voxels;
use volume::brick::VOXELS;

const LIST: &str = "bits.txt";
const SIZE: [u32; 2] = [40, 32];
const PIXEL_MM: f64 = 0.4;
const SLICES: u32 = 24;
const GAP_MM: f64 = 0.45;

/// Threads and instruction sets of this machine.
fn settings() -> impl Iterator<Item = (usize, Simd)> {
    let sets = Simd::ALL.into_iter().filter(|simd| simd.is_available());
    sets.flat_map(|simd| [(1, simd), (2, simd)])
}

/// Grey levels with edges and noise.
fn image(number: u32) -> Image {
    let grey = |u: u32, v: u32| {
        let mut noise = (number << 20) ^ (v << 10) ^ u;
        for _ in 0..3 {
            noise = (noise ^ (noise >> 15)).wrapping_mul(0x2C1B_3C6D);
            noise ^= noise >> 12;
        }
        let far = u.abs_diff(19).pow(2) + v.abs_diff(14).pow(2) + number.abs_diff(11).pow(2);
        (if far < 90 { 150 } else { u + v }) + noise % 32
    };
    let [width, height] = SIZE;
    let pixels: Vec<u8> = (0..width * height).map(|i| grey(i % width, i / width) as u8).collect();
    Image::new(width, height, Pixels::U8(Arc::from(pixels)))
}

/// A sweep at angles that no lattice has and that change from slice to slice; or one as an arm
/// makes it, along the lattice's y.
fn sweep(is_planar: bool) -> Vec<Slice> {
    let slice = |number: u32| {
        let along = f64::from(number) * GAP_MM;
        let axes = if is_planar {
            DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y)
        } else {
            DMat3::from_quat(DQuat::from_xyzw(0.1 + 0.002 * along, -0.2, 0.3, 0.9 - 0.003 * along).normalize())
        };
        let middle =
            axes.x_axis * (0.5 * PIXEL_MM * f64::from(SIZE[0])) + axes.y_axis * (0.5 * PIXEL_MM * f64::from(SIZE[1]));
        let scale = DMat3::from_diagonal(DVec3::new(PIXEL_MM, PIXEL_MM, 1.0));
        let pose = DAffine3 { matrix3: axes * scale, translation: axes.z_axis * along - middle };
        Slice {
            image: image(number),
            time_ns: i64::from(number) * 33_000_000,
            world_from_image: Transform::from_affine(pose),
        }
    };
    (0..SLICES).map(slice).collect()
}

/// The scans: name, whether the path is planar, and settings.
fn scans() -> Vec<(String, bool, Settings)> {
    let usual = Settings::new(DVec3::splat(0.6));
    let fading = Compounding::Decay(Decay::Exponential { rate_per_s: 0.7 });
    let mut scans = Vec::new();
    for compounding in [Compounding::Mean, Compounding::Maximum, Compounding::Latest, fading] {
        scans.push((compounding.name().to_owned(), false, Settings { compounding, ..usual.clone() }));
    }
    for compounding in [Compounding::Mean, fading] {
        scans.push((format!("{}-planar", compounding.name()), true, Settings { compounding, ..usual.clone() }));
    }
    for method in Method::ALL {
        scans.push((format!("mean-{}", method.name()), false, Settings { method, ..usual.clone() }));
    }
    scans.push(("mean-gap-weights".to_owned(), false, Settings { gap_weights: true, ..usual.clone() }));
    let shadow_weights = Some(ShadowWeights { tail_mm: 4.0, ..ShadowWeights::default() });
    scans.push(("mean-shadow-weights".to_owned(), false, Settings { shadow_weights, ..usual }));
    scans
}

fn reconstructor(is_planar: bool, settings: Settings) -> PathReconstructor {
    let mask = Mask::full(SIZE[0], SIZE[1]);
    if !is_planar {
        return PathReconstructor::general(settings, mask).unwrap();
    }
    let planar = PlanarSettings {
        direction: Some(DMat3::IDENTITY),
        on_departure: OnDeparture::Refuse,
        ..PlanarSettings::default()
    };
    PathReconstructor::planar(settings, planar, mask).unwrap()
}

/// Inserts a sweep.
fn reconstructed(is_planar: bool, settings: Settings) -> PathReconstructor {
    let gaps = settings.weights_by_gaps();
    let mut reconstructor = reconstructor(is_planar, settings);
    let slices = sweep(is_planar);
    let poses = slices.iter().map(|slice| slice.world_from_image);
    let weights = gaps.map_or_else(|| vec![1.0; slices.len()], |gaps| gaps.of_sweep(poses, SIZE));
    for (slice, weight) in slices.iter().zip(weights) {
        reconstructor.insert_weighted(slice, weight).unwrap();
    }
    reconstructor
}

fn hash(bytes: impl IntoIterator<Item = [u8; 4]>) -> String {
    let mut sha = Sha256::new();
    bytes.into_iter().for_each(|word| sha.update(word));
    sha.finalize().iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

/// The hash of a volume's numerators and weights, and of their places.
fn content(volume: &dyn Voxels) -> String {
    let mut blocks: Vec<_> = volume.blocks().collect();
    blocks.sort_unstable();
    assert!(blocks.len() > 40, "{} blocks hold too little of a sweep", blocks.len());
    let (mut r, mut w) = ([0.0; VOXELS], [0.0; VOXELS]);
    let mut words = Vec::new();
    for block in blocks {
        volume.block(block, &mut r, &mut w);
        // A brick that only the path has created holds nothing.
        if w.iter().any(|w| *w > 0.0) {
            words.extend(block.map(i32::to_le_bytes));
            words.extend(r.iter().chain(&w).map(|number| number.to_le_bytes()));
        }
    }
    hash(words)
}

/// The settings of pictures.
fn pictures() -> Vec<(&'static str, RenderSettings)> {
    let preset = |name| Transfer::preset(name, [0.0, 255.0]).unwrap();
    let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
    let usual = RenderSettings { view, ..RenderSettings::new([72, 64], preset("tissue")) };
    let mode = |mode| RenderSettings { mode, ..usual.clone() };
    vec![
        ("picture-tissue", usual.clone()),
        ("picture-surface", RenderSettings { transfer: preset("surface"), ..usual.clone() }),
        ("picture-by-samples", mode(Mode::Shaded(Shading::Sample))),
        ("picture-opacity", mode(Mode::Opacity(Shading::Voxel))),
        ("picture-maximum", mode(Mode::Maximum)),
        ("picture-average", mode(Mode::Average)),
        ("picture-isosurface", mode(Mode::Isosurface(100.0))),
        ("picture-adaptive", RenderSettings { adaptive: 0.03, ..usual.clone() }),
    ]
}

fn region(reconstructor: &PathReconstructor) -> RenderRegion {
    let (low, high) = reconstructor.volume().seen_bounds().unwrap();
    RenderRegion::new(reconstructor.world_from_lattice(), low, high).unwrap()
}

fn bits(picture: &Picture) -> String {
    assert!(picture.pixels.iter().any(|[.., left]| *left < 0.5), "the picture is empty");
    hash(picture.pixels.iter().flatten().map(|x| x.to_bits().to_le_bytes()))
}

/// Compares a hash with the list, or renews it there.
fn check(name: &str, setting: (usize, Simd), found: &str) {
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(LIST);
    let list = std::fs::read_to_string(&path).unwrap_or_default();
    let line = format!("{name} {found}");
    if std::env::var_os("SONOWEAVE_GOLDEN").is_some_and(|how| how == "renew") {
        let others = list.lines().filter(|line| line.split(' ').next() != Some(name));
        let mut lines: Vec<&str> = others.chain([line.as_str()]).collect();
        lines.sort_unstable();
        std::fs::write(&path, lines.join("\n") + "\n").unwrap();
        return;
    }
    let (threads, simd) = setting;
    assert!(
        list.lines().any(|known| known == line),
        "{threads} threads, {}: {line} is not in tests/bits/{LIST}",
        simd.name()
    );
}

#[test]
fn volumes_have_fixed_bits() {
    for (name, is_planar, scan) in scans() {
        for (threads, simd) in settings() {
            let made = reconstructed(is_planar, Settings { threads, simd, ..scan.clone() });
            check(&name, (threads, simd), &content(made.volume()));
        }
    }
}

#[test]
fn pictures_have_fixed_bits() {
    let made = reconstructed(false, Settings::new(DVec3::splat(0.6)));
    for (name, picture) in pictures() {
        for (threads, simd) in settings() {
            let mut renderer =
                Renderer::new(&RenderSettings { threads, simd, ..picture.clone() }, region(&made)).unwrap();
            renderer.update_all(made.volume());
            check(name, (threads, simd), &bits(&renderer.picture()));
        }
    }
}

/// The picture follows the volume slice by slice, to the bits of the whole one.
#[test]
fn picture_updated_slice_by_slice_has_the_same_bits() {
    let settings_of_scan = Settings::new(DVec3::splat(0.6));
    let region = region(&reconstructed(false, settings_of_scan.clone()));
    for (threads, simd) in settings() {
        let mut growing = reconstructor(false, Settings { threads, simd, ..settings_of_scan.clone() });
        let (name, picture) = pictures().swap_remove(0);
        let mut renderer = Renderer::new(&RenderSettings { threads, simd, ..picture }, region).unwrap();
        for slice in sweep(false) {
            let touched = growing.insert(&slice).unwrap();
            renderer.update(growing.volume(), &touched.bricks);
        }
        check(name, (threads, simd), &bits(&renderer.picture()));
    }
}

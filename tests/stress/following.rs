//! Tests of incremental rendering: the same bits as a full rendering after every slice, and no
//! unnecessary work.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde_json::Value;

use reconstruct::{PathReconstructor, Refused, Settings, Simd};
use render::camera::View;
use render::classify::light::{DepthCue, Light, Source};
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::{Cache, RenderRegion, RenderSettings, RenderWork, Renderer, reference};
use sonoweave_core::slice::Slice;
use volume::Values;
use volume::brick::BrickIndex;

use crate::figures::{Sheet, Test};
use crate::insertion::{image, posed, turned};
use crate::pictures::{Field, lattice, other_bits, random};
use crate::place::Place;
use crate::sequence::{Sequence, grey, pose};

const SLICES: u32 = 100;
const SIZE: [u32; 2] = [30, 26];
const PIXEL_MM: f64 = 0.5;
const VOXEL_MM: f64 = 0.6;

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("07", "after each of 100 random slices the picture that followed is the whole's, bit for bit", |s| {
            follow(s, DMat3::IDENTITY, &looks()[..3]);
        }),
        Test::new("07", "the same on a turned lattice", |s| follow(s, turned(0.3, -0.5, 0.9), &looks()[3..])),
        Test::new("35", "what has not changed is read and nothing else, by every cache and on every way", idle),
        Test::new("35", "slices beside the region or too dark to be seen cast no ray", unseen),
        Test::new("35", "a parked probe updates no voxel and casts no ray, in a replay too", parked),
    ]
}

/// A slice with its own position and angle. Every other one is dark, so that visible content
/// fades again.
fn slice(number: u32) -> Slice {
    let r = |k: u32| random(7 + k, number) * 2.0 - 1.0;
    let axes = DMat3::from_quat(DQuat::from_xyzw(r(0), r(1), r(2), r(3)).normalize());
    let [u, v] = [axes.x_axis * PIXEL_MM, axes.y_axis * PIXEL_MM];
    let centre = DVec3::new(r(4), r(5), r(6)) * 6.0;
    let middle = SIZE.map(|n| 0.5 * (f64::from(n) - 1.0));
    let translation = centre - u * middle[0] - v * middle[1];
    let pose = DAffine3 { matrix3: DMat3::from_cols(u, v, axes.z_axis), translation };
    let light = if number.is_multiple_of(2) { 1.0 } else { 0.25 };
    let scene = |i: u32, j: u32| {
        let [x, y, z] = pose.transform_point3(DVec3::new(f64::from(i), f64::from(j), 0.0)).to_array();
        let wave = (0.9 * x).sin() + (0.7 * y + 1.0).sin() + (0.8 * z - x).cos();
        let speckle = 24.0 * random(number, j * 1000 + i);
        (light * (70.0 * wave + 60.0) + speckle).clamp(0.0, 255.0) as f32
    };
    Slice { time_ns: i64::from(number) * 40_000_000, ..posed(&image(SIZE, scene), pose) }
}

fn reconstructor(direction: DMat3) -> PathReconstructor {
    let settings = Settings { lattice_direction: direction, ..Settings::new(DVec3::splat(VOXEL_MM)) };
    PathReconstructor::general(settings, mask::Mask::full(SIZE[0], SIZE[1])).unwrap()
}

/// Slices extend beyond it on all sides.
fn region(direction: DMat3) -> RenderRegion {
    RenderRegion::new(lattice(direction, DVec3::splat(VOXEL_MM), DVec3::ZERO), [-17, -15, -13], [16, 17, 14]).unwrap()
}

/// View settings: grey, colour, perspective; depth cue and a light from one side, borders, a
/// view along an axis.
fn looks() -> [(&'static str, RenderSettings); 6] {
    let preset = |name| Transfer::preset(name, [0.0, 255.0]).unwrap();
    let view = View { azimuth: 30.0, elevation: 25.0, roll: 5.0, perspective: None, turns: false, ..View::default() };
    let base = RenderSettings { view, ..RenderSettings::new([36, 30], preset("tissue")) };
    let curve = |points: &[(f64, f64)]| Curve::new(points).unwrap();
    let coloured = Opacity::Curve(curve(&[(40.0, 0.0), (160.0, 0.7)]));
    let coloured = Transfer::new(coloured, 1.0, Colour::perceptual([0.0, 255.0]).unwrap()).unwrap();
    let borders = Opacity::Region(curve(&[(30.0, 0.2), (120.0, 0.9), (200.0, 0.4)]));
    let borders = Transfer::new(borders, 1.0, Colour::grey([0.0, 200.0]).unwrap()).unwrap();
    let aside = Light::default().with_source(Source::Fixed(DVec3::new(1.0, -2.0, 0.5))).unwrap();
    let aside = aside.with_two_sided(false).with_depth_cue(Some(DepthCue::new(1.0, 0.3).unwrap()));
    [
        // Pixels half as wide as voxels: a footprint has no margin for errors.
        ("grey", RenderSettings { size: [96, 80], ..base.clone() }),
        ("colour", RenderSettings { transfer: coloured, step: 0.6, arity: Some(5), ..base.clone() }),
        (
            "perspective",
            RenderSettings {
                view: View { perspective: Some(45.0), ..view },
                transfer: preset("surface"),
                arity: Some(1),
                stop: 0.0,
                ..base.clone()
            },
        ),
        ("depth cue", RenderSettings { light: aside, transfer: preset("bone"), step: 1.7, ..base.clone() }),
        ("borders", RenderSettings { transfer: borders, arity: Some(7), stop: 0.0, ..base.clone() }),
        (
            "along an axis",
            RenderSettings {
                view: View { azimuth: 90.0, ..View::default() },
                transfer: preset("xray"),
                arity: Some(64),
                ..base
            },
        ),
    ]
}

/// Renderers with all caches for one view setting, with 1 to 3 threads and every available
/// instruction set.
fn following(look: usize, settings: &RenderSettings, region: RenderRegion) -> Vec<Renderer> {
    let sets: Vec<Simd> = Simd::ALL.into_iter().filter(|simd| simd.is_available()).collect();
    let with = |(i, cache): (usize, Cache)| {
        let settings = RenderSettings {
            cache,
            threads: 1 + (look + i) % 3,
            simd: sets[(2 * look + i) % sets.len()],
            ..settings.clone()
        };
        Renderer::new(&settings, region).unwrap()
    };
    Cache::ALL.into_iter().enumerate().map(with).collect()
}

/// Counters that may not depend on the cache, the threads or the instruction set.
fn common(work: &RenderWork) -> [u64; 5] {
    [work.bricks_read, work.bricks_changed, work.voxels_shaded, work.rays, work.pixels_changed]
}

fn follow(sheet: &mut Sheet, direction: DMat3, looks: &[(&'static str, RenderSettings)]) {
    let region = region(direction);
    let mut reconstructor = reconstructor(direction);
    let mut all: Vec<Vec<Renderer>> =
        looks.iter().enumerate().map(|(i, (_, settings))| following(i, settings, region)).collect();
    let mut differ = vec![[0_usize; 4]; looks.len()];
    let (mut absurd, mut disagree) = (0, 0);
    let mut shaded = vec![[0_u64; 2]; looks.len()];
    for number in 0..SLICES {
        let touched = reconstructor.insert(&slice(number)).unwrap();
        for (look, (_, settings)) in looks.iter().enumerate() {
            // The picture for comparison comes from a renderer without kept data.
            let alone = RenderSettings { cache: Cache::ALL[number as usize % 4], ..settings.clone() };
            let mut whole = Renderer::new(&alone, region).unwrap();
            let from_scratch = whole.update_all(reconstructor.volume()).work;
            let expected = whole.picture();
            let mut first = None;
            for (cache, renderer) in all[look].iter_mut().enumerate() {
                let before = renderer.picture();
                let work = renderer.update(reconstructor.volume(), &touched.bricks).work;
                let after = renderer.picture();
                differ[look][cache] += other_bits(&after, &expected);
                let changed = other_bits(&before, &after);
                let sane = work.bricks_read == touched.bricks.len() as u64
                    && work.bricks_changed <= work.bricks_read
                    && work.voxels_shaded <= from_scratch.voxels_shaded
                    && work.rays <= u64::from(settings.size[0] * settings.size[1])
                    && work.pixels_changed == changed as u64;
                absurd += u32::from(!sane);
                disagree += u32::from(*first.get_or_insert(common(&work)) != common(&work));
            }
            shaded[look][0] += first.map_or(0, |work| work[2]);
            shaded[look][1] += from_scratch.voxels_shaded;
        }
    }
    for (look, (name, settings)) in looks.iter().enumerate() {
        for (cache, differ) in Cache::ALL.into_iter().zip(differ[look]) {
            sheet.equal(&format!("{name}, {}: pixels of other bits, of all slices", cache.name()), differ, 0);
        }
        let [followed, whole] = shaded[look].map(|n| n as f64);
        sheet.at_most(&format!("{name}: voxels shaded, a share of those from scratch"), followed / whole, 0.5);
        let picture = all[look][0].picture();
        let seen = picture.pixels.iter().filter(|p| p[3] < 0.99).count();
        sheet.above(&format!("{name}: pixels in which something is seen"), seen as f64, 150.0);
        let exact = reference::render(reconstructor.volume(), settings, &region).unwrap();
        let [most, _] = exact.difference(&picture);
        sheet.at_most(&format!("{name}: off the reference"), most, f64::from(settings.stop) + 3e-4);
    }
    sheet.equal("updates whose counters exceed what there is, or miscount changed pixels", absurd, 0);
    sheet.equal("updates whose counters depend on cache, threads or instructions", disagree, 0);
}

fn read(bricks: usize) -> RenderWork {
    RenderWork { bricks_read: bricks as u64, ..RenderWork::default() }
}

fn idle(sheet: &mut Sheet) {
    for (name, settings) in &looks()[..3] {
        for cache in Cache::ALL {
            let what = |said: &str| format!("{name}, {}: {said}", cache.name());
            let settings = RenderSettings { cache, ..settings.clone() };
            let region = region(DMat3::IDENTITY);
            let mut reconstructor = reconstructor(DMat3::IDENTITY);
            let mut renderer = Renderer::new(&settings, region).unwrap();
            let mut plain = Renderer::new(&settings, region).unwrap();
            let mut again = RenderWork::default();
            for number in 0..5 {
                let touched = reconstructor.insert(&slice(number)).unwrap().bricks;
                renderer.update(reconstructor.volume(), &touched);
                plain.update(reconstructor.volume(), &touched);
                again += renderer.update(reconstructor.volume(), &touched).work;
            }
            let followed = renderer.picture();
            sheet.equal(&what("the same slices again"), again, read(again.bricks_read as usize));
            sheet.above(&what("bricks read for it"), again.bricks_read as f64, 100.0);
            let all: Vec<BrickIndex> = Values::bricks(reconstructor.volume()).collect();
            let work = renderer.update_all(reconstructor.volume()).work;
            sheet.equal(&what("the same volume whole"), work, read(all.len()));
            let backwards: Vec<BrickIndex> = all.iter().rev().chain(&all).copied().collect();
            let work = renderer.update(reconstructor.volume(), &backwards).work;
            sheet.equal(&what("backwards and twice"), work, read(backwards.len()));
            // The same values from another volume, which requests all bricks of the box.
            let volume = reconstructor.volume();
            let value = |at: [i64; 3]| {
                let (mut value, mut weight) = ([0.0], [0.0]);
                volume.values(at, &mut value, &mut weight);
                (weight[0] > 0.0).then_some(value[0])
            };
            let [low, high] = region.bounds();
            let copy = Field { low, high, value };
            let mut of_copy = Renderer::new(&settings, region).unwrap();
            of_copy.update_all(&copy);
            let work = of_copy.update_all(&copy).work;
            sheet.equal(&what("another volume twice"), work, read(Values::bricks(&copy).count()));
            sheet.equal(&what("pixels changed by all that"), other_bits(&renderer.picture(), &followed), 0);
            // A later slice costs as much as if nothing had happened.
            let touched = reconstructor.insert(&slice(5)).unwrap().bricks;
            let [a, b] = [&mut renderer, &mut plain].map(|r| r.update(reconstructor.volume(), &touched).work);
            sheet.equal(&what("the next slice's work"), a, b);
            sheet.above(&what("rays of it"), a.rays as f64, 0.0);
        }
    }
}

fn unseen(sheet: &mut Sheet) {
    let (_, settings) = &looks()[0];
    let mut reconstructor = reconstructor(DMat3::IDENTITY);
    let touched = reconstructor.insert(&slice(0)).unwrap().bricks;
    let aside =
        RenderRegion::new(lattice(DMat3::IDENTITY, DVec3::splat(VOXEL_MM), DVec3::ZERO), [60; 3], [90; 3]).unwrap();
    for cache in Cache::ALL {
        let settings = RenderSettings { cache, ..settings.clone() };
        let mut renderer = Renderer::new(&settings, aside).unwrap();
        let work = renderer.update(reconstructor.volume(), &touched).work;
        sheet.equal(&format!("{}: beside the region", cache.name()), work, read(touched.len()));
        // In bricks that the box meets, but outside the box.
        let near =
            RenderRegion::new(lattice(DMat3::IDENTITY, DVec3::splat(VOXEL_MM), DVec3::ZERO), [-2; 3], [2; 3]).unwrap();
        let beside = Field { low: [-8; 3], high: [7; 3], value: |[x, _, _]: [i64; 3]| (x > 2).then_some(200.0) };
        let work = Renderer::new(&settings, near).unwrap().update_all(&beside).work;
        sheet.equal(&format!("{}: in the region's bricks, beside its box", cache.name()), work, read(8));
        let dark = Field { low: [-9; 3], high: [9; 3], value: |_: [i64; 3]| Some(20.0) };
        let mut renderer = Renderer::new(&settings, region(DMat3::IDENTITY)).unwrap();
        let work = renderer.update_all(&dark).work;
        sheet.equal(&format!("{}: too dark to be seen", cache.name()), work, read(64));
        sheet.equal(&format!("{}: bricks held of it", cache.name()), renderer.bricks(), 0);
    }
}

fn parked(sheet: &mut Sheet) {
    let (_, settings) = &looks()[0];
    let mut reconstructor = reconstructor(DMat3::IDENTITY);
    let mut renderer = Renderer::new(settings, region(DMat3::IDENTITY)).unwrap();
    let (mut refused, mut touched) = (0, Vec::new());
    for number in [0, 1, 2, 2, 2, 2, 2, 2] {
        match reconstructor.insert(&slice(number)) {
            Ok(by) => {
                touched = by.bricks;
                renderer.update(reconstructor.volume(), &touched);
            }
            Err(Refused::Repeated) => refused += 1,
            Err(other) => sheet.holds(&format!("slice {number}: {other}"), false),
        }
    }
    sheet.equal("slices refused as no news", refused, 5);
    sheet.equal("were their bricks given", renderer.update(reconstructor.volume(), &touched).work, read(touched.len()));
    // In a replay: 6 frames, and 6 followed by 14 copies of the last.
    let place = Place::new();
    let run = |name: &str, sequence: &Sequence| -> Value {
        place.put("s.mha", sequence.bytes());
        let words = format!(
            "animate s.mha --clip none --picture {name}.png --image-size 40x30 --transfer xray --json=s.json --threads 1"
        );
        let run = place.run(&words);
        assert_eq!(run.code, 0, "{}", run.stderr);
        place.json("s.json")
    };
    let moving = Sequence { frames: 6, pose: |frame| pose(f64::from(frame)), ..Sequence::default() };
    let still = Sequence {
        frames: 20,
        pose: |frame| pose(f64::from(frame.min(5))),
        pixel: |u, v, frame| vec![grey(u, v, frame.min(5))],
        ..moving.clone()
    };
    let (once, parked) = (run("once", &moving), run("parked", &still));
    sheet.equal("frames used", &parked["frames"]["used"], &Value::from(6));
    sheet.equal("frames refused", &parked["frames"]["refused"]["repeated"], &Value::from(14));
    sheet.equal("work for the pictures", &parked["picture"]["work"], &once["picture"]["work"]);
    sheet.above("rays of it", once["picture"]["work"]["rays"].as_f64().unwrap_or(0.0), 100.0);
    sheet.holds("the same picture", place.get("once.png") == place.get("parked.png"));
}

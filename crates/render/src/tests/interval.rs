//! Skipped bricks outside the visible interval: the picture keeps the same bits, and work is
//! saved.

use simd::Simd;
use simd::sharing::Sharing;

use super::super::classify::classifier::SampleReader;
use super::super::classify::interval::Interval;
use super::super::classify::shade::{Lit, Shader};
use super::super::rays::composite::Accumulated;
use super::super::rays::line::Line;
use super::super::rays::run::Reader;
use super::super::shaded::Shaded;
use super::super::snapshot::VoxelSnapshot;
use super::super::voxels::Sampler;
use super::*;

const SAMPLED: Mode = Mode::Shaded(Shading::Sample);
const SIZE: i64 = 48;
const SHOWN: [f64; 2] = [80.0, 150.0];

/// Returns a number from 0 up to 1 for a voxel.
fn random(seed: u64, at: [i64; 3]) -> f64 {
    let [x, y, z] = at.map(i64::cast_unsigned);
    let hash = (seed << 40 ^ z << 24 ^ y << 12 ^ x).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let hash = (hash ^ hash >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (hash >> 11) as f64 / (1_u64 << 53) as f64
}

/// Shows intensities between two limits, most strongly close to them.
fn band() -> Transfer {
    let [low, high] = SHOWN;
    let curve = Curve::new(&[(low, 0.0), (low + 1e-4, 0.5), (high - 1e-4, 0.9), (high, 0.0)]).unwrap();
    Transfer::new(Opacity::Curve(curve), 1.0, Colour::perceptual([0.0, 255.0]).unwrap()).unwrap()
}

/// All settings that classify samples, for steps within a brick and beyond it.
fn all_settings() -> Vec<RenderSettings> {
    let view = View { azimuth: 33.0, elevation: 21.0, roll: 4.0, ..View::default() };
    let base = RenderSettings { view, stop: 0.0, ..RenderSettings::new([48, 44], band()) };
    let far = View { perspective: Some(40.0), ..view };
    let straight = View { azimuth: 90.0, ..View::default() };
    vec![
        RenderSettings { mode: Mode::Isosurface(SHOWN[0]), ..base.clone() },
        RenderSettings { mode: Mode::Isosurface(SHOWN[0]), step: 0.4, view: far, ..base.clone() },
        RenderSettings { mode: Mode::Isosurface(SHOWN[0]), step: 9.5, ..base.clone() },
        RenderSettings { mode: Mode::Isosurface(SHOWN[0]), view: straight, ..base.clone() },
        RenderSettings { mode: SAMPLED, ..base.clone() },
        RenderSettings { mode: SAMPLED, step: 0.4, view: straight, ..base.clone() },
        RenderSettings { mode: Mode::Opacity(Shading::Sample), view: far, ..base },
    ]
}

/// Returns the voxels of a volume, skipping bricks outside an interval, and their shader and
/// camera.
fn kept(
    settings: &RenderSettings,
    region: &RenderRegion,
    volume: &impl Values,
    interval: Interval,
) -> (Shaded<4>, Shader<f32>, Camera) {
    let camera = Camera::new(&settings.view, settings.size, settings.step, region).unwrap();
    let shader = Shader::<f32>::new(settings, &camera, region);
    let (mut snapshot, mut shaded) = (VoxelSnapshot::new(region, 0), Shaded::<4>::new(region, interval, 0));
    let (mut changed, mut dirty) = (Vec::new(), Vec::new());
    let (simd, alone) = (Simd::detect(), Sharing::Alone);
    snapshot.read(
        volume,
        &volume.bricks().collect::<Vec<_>>(),
        |_| true,
        shader.visible(),
        (simd, alone),
        &mut changed,
    );
    let mut voxels = Vec::new();
    snapshot.dilated(&mut changed, &mut voxels, Sharing::Alone);
    shaded.update(&snapshot, &voxels, &shader, (simd, alone), &mut dirty, &mut Vec::new());
    (shaded, shader, camera)
}

/// Casts each ray of a picture by itself, skipping bricks outside an interval; returns also the
/// work.
fn cast(
    settings: &RenderSettings,
    region: &RenderRegion,
    volume: &impl Values,
    interval: Interval,
) -> (Vec<Accumulated<3>>, RenderWork) {
    let (voxels, shader, camera) = kept(settings, region, volume, interval);
    let mut work = RenderWork::default();
    let fold = settings.fold(camera.samples()).unwrap();
    let sampler = Sampler::SampleClassifier(SampleReader::new(&voxels, &shader));
    let [low, high] = region.bounds().map(|at| std::array::from_fn(|a| at[a] - region.first()[a]));
    let pixels = (0..settings.size[1])
        .flat_map(|j| (0..settings.size[0]).map(move |i| (i, j)))
        .map(|(i, j)| sampler.cast(&Line::new(&camera.ray(i, j), low, high, camera.samples()), None, fold, &mut work))
        .collect();
    (pixels, work)
}

fn same(a: &Picture, b: &Picture) -> bool {
    a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits))
}

/// Intensities next to the interval's ends and far from them, in layers of one kind each, which
/// were seen completely, by half, or hardly.
fn treacherous(seed: u64) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    let value = move |at: [i64; 3]| {
        let layer = [0, 0, at[2] / 16];
        let seen = [1.0, 1.0, 1.0, 0.97, 0.02][(5.0 * random(seed + 1, layer)) as usize];
        let [low, high] = SHOWN;
        // The smallest distance that counts as outside the interval, and the half, the tenth and
        // the double of it.
        let margin =
            [1.0, 0.5, 0.1, 2.0][(4.0 * random(seed + 2, layer)) as usize] * (high * 64.0) / f64::from(1 << 18);
        let [pick, share] = [3, 4].map(|k| random(seed + k, at));
        let value = match (10.0 * random(seed + 5, layer)) as u32 {
            0..3 if pick < 0.7 => low - margin,
            0..2 => low - margin - 60.0 * share,
            // The largest negative one that can count.
            2 => -low * 64.0,
            3..5 if pick < 0.7 => high + margin,
            3 => high + margin + 60.0 * share,
            4 => high * 64.0,
            5 if pick < 0.1 => -1e6,
            5 => low - margin,
            6 if pick < 0.01 => low + 20.0,
            6 => 30.0 * share,
            7 if pick < 0.5 => high + 50.0,
            7 => low - 40.0,
            8 => 100.0 * share,
            _ => 20.0,
        };
        (random(seed + 6, at) < seen).then_some(value as f32)
    };
    Field { low: [0; 3], high: [SIZE - 1; 3], value }
}

#[test]
fn skipping_hidden_bricks_changes_no_bit() {
    for (n, settings) in (0..).zip(all_settings()) {
        let (mut seen, mut passed, mut whole) = (0, 0, 0);
        for seed in 0..10 {
            let volume = treacherous(100 * seed + 10 * n);
            let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
            let (by_interval, work) = cast(&settings, &region, &volume, Interval::of(&settings));
            let (of_all, all) = cast(&settings, &region, &volume, Interval::ALL);
            let differ = by_interval.iter().zip(&of_all).filter(|(a, b)| !a.same_bits(b)).count();
            assert_eq!(differ, 0, "{:?}, step {}, seed {seed}", settings.mode, settings.step);
            assert_eq!(work.samples + work.samples_skipped, all.samples + all.samples_skipped);
            seen += of_all.iter().filter(|pixel| pixel.transmittance < 0.9).count();
            (passed, whole) = (passed + all.samples - work.samples, whole + all.samples);
        }
        assert!(seen > 2000 && passed * 32 > whole, "{:?}: {seen} pixels, {passed} of {whole}", settings.mode);
    }
}

#[test]
fn small_seen_share_raises_value_within_bound() {
    let mut worst = 0.0_f32;
    for seed in 0..400 {
        let value = |at: [i64; 3]| (random(seed, at) < 0.5).then(|| 0.6 + 0.4 * random(seed + 500, at) as f32);
        let volume = Field { low: [0; 3], high: [1; 3], value };
        let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
        let most = (0..8).filter_map(|i| value([i & 1, i >> 1 & 1, i >> 2])).fold(0.0, f32::max);
        let (voxels, ..) = kept(&all_settings()[4], &region, &volume, Interval::ALL);
        let reader = Reader::of_all(&voxels);
        for n in 0..1000 {
            // Positions within a cell whose first voxel has the coordinate 8: next to its
            // voxels, before and behind, and anywhere.
            let at = [0, 1, 2].map(|axis| {
                let [pick, share] = [0, 1].map(|k| random(seed + 1000 + k, [n, axis, 0]));
                let off = (40.0 * pick) as u32 % 4;
                match (8.0 * pick) as u32 {
                    0..4 => f32::from_bits(8.0_f32.to_bits() + off),
                    4..7 => f32::from_bits(9.0_f32.to_bits() - 1 - off),
                    _ => 8.0 + 0.99 * share as f32,
                }
            });
            let Some(Lit { colour: [value, ..], alpha: seen }) = reader.at(at) else { continue };
            if seen > 0.0 {
                worst = worst.max(value / seen / most);
            }
        }
    }
    // The bound is three times 9/7; and rounding alone raises the value above the true one.
    assert!(worst > 1.0001 && worst < 2.126, "{worst}");
}

/// A bright ball in grey, all of it seen; and some voxels of a given brightness.
fn ball(grey: f32, spot: [i64; 3], size: i64, bright: f32) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    let value = move |at: [i64; 3]| {
        let off: i64 = at.iter().map(|x| (x - 40).pow(2)).sum();
        Some(match (0..3).all(|a| (at[a] - spot[a]).abs() <= size) {
            true => bright,
            false if off < 64 => 120.0,
            false => grey + 20.0 * random(7, at) as f32,
        })
    };
    Field { low: [0; 3], high: [79; 3], value }
}

#[test]
fn ball_in_grey_skips_most_samples() {
    let classified = [SAMPLED, Mode::Opacity(Shading::Sample)];
    // Classified samples are evaluated at the region's end, because bricks there were not seen
    // completely; but not if all is much darker than the visible interval.
    for (mode, grey, expected) in [
        (Mode::Isosurface(80.0), 40.0, 0.95),
        (classified[0], 40.0, 0.6),
        (classified[1], 40.0, 0.6),
        (classified[0], 12.0, 0.95),
    ] {
        let settings = RenderSettings { mode, cache: Cache::None, ..all_settings()[0].clone() };
        let volume = ball(grey, [0; 3], -1, 0.0);
        let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
        let work = Renderer::new(&settings, region).unwrap().update_all(&volume).work;
        let (_, all) = cast(&settings, &region, &volume, Interval::ALL);
        let share = 1.0 - work.samples as f64 / all.samples as f64;
        assert!(share > expected, "{mode:?}: {share} of {work:?}, {all:?}");
    }
}

#[test]
fn hidden_grey_changes_cast_no_ray_until_visible() {
    for (n, mode) in [Mode::Isosurface(80.0), SAMPLED].into_iter().enumerate() {
        for cache in Cache::ALL {
            let settings = RenderSettings { mode, cache, threads: 1 + n, ..all_settings()[0].clone() };
            let region = RenderRegion::new(half_mm(), [0; 3], [79; 3]).unwrap();
            let mut renderer = Renderer::new(&settings, region).unwrap();
            renderer.update_all(&ball(40.0, [0; 3], -1, 0.0));
            for (spot, size, bright, is_seen) in [
                ([30, 20, 20], 3, 55.0, false),
                // Next to the ball, so that its cells hold some of it.
                ([35, 20, 22], 1, 110.0, true),
                ([35, 20, 22], 1, 30.0, true),
                ([35, 20, 22], 2, 45.0, false),
                ([40, 40, 30], 3, 20.0, true),
            ] {
                let volume = ball(40.0, spot, size, bright);
                let work = renderer.update_all(&volume).work;
                let cast = [work.pixels_met, work.rays, work.samples, work.samples_skipped, work.pixels_changed];
                assert!(work.bricks_changed > 0 && work.voxels_shaded > 20, "{work:?}");
                assert_eq!(cast != [0; 5], is_seen, "{mode:?}, {cache:?}, {spot:?}: {work:?}");
                let mut whole = Renderer::new(&settings, region).unwrap();
                whole.update_all(&volume);
                assert!(same(&renderer.picture(), &whole.picture()), "{mode:?}, {cache:?}, {spot:?}");
            }
        }
    }
}

//! Vector lanes against one voxel at a time, bit for bit, for any volume content.

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::Transform;
use volume::Values;
use volume::brick::BrickIndex;

use super::*;
use crate::RenderSettings;
use crate::camera::{Camera, View};
use crate::classify::light::{DepthCue, Light, Source};
use crate::classify::shade::Lit;
use crate::classify::transfer::{Colour, Curve, Opacity, Transfer};

const SIZE: [i64; 3] = [21, 18, 26];

/// Random values and weights, including invalid ones.
struct Anything(u64);

impl Values for Anything {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let [i, j, k] = [start[0] + x as i64, start[1], start[2]].map(i64::cast_unsigned);
            let hash = (self.0 ^ [k, j, i].into_iter().fold(0_u64, |hash, at| hash.wrapping_mul(64).wrapping_add(at)))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15);
            let hash = (hash ^ hash >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 16;
            let share = |of: u64| (of & 0xFFFF) as f32 / 65536.0;
            *value = match hash & 63 {
                0 => f32::NAN,
                1 => f32::INFINITY,
                2 => f32::NEG_INFINITY,
                3 => 127.5,
                // Flat, or nearly so.
                4..32 => 120.0 + 1e-5 * share(hash >> 6),
                _ => 280.0 * share(hash >> 6) - 10.0,
            };
            *weight = match hash >> 22 & 15 {
                0..3 => 0.0,
                3 => 1e-3,
                _ => 4.0 * share(hash >> 26),
            };
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new((0..4).flat_map(|z| (0..3).flat_map(move |y| (0..3).map(move |x| [x, y, z]))))
    }
}

fn all_settings() -> Vec<RenderSettings> {
    let curve = |points: &[(f64, f64)]| Curve::new(points).unwrap();
    let grey = || Colour::grey([10.0, 250.0]).unwrap();
    let transfer = |opacity, unit_mm, colour| Transfer::new(opacity, unit_mm, colour).unwrap();
    let region = Opacity::Region(curve(&[(0.0, 0.0), (90.0, 0.5), (200.0, 1.0)]));
    let isovalue = Opacity::Isovalue { value: 127.5, thickness_mm: 0.8, opacity: 1.0 };
    let rising = || Opacity::Curve(curve(&[(40.0, 1e-8), (90.0, 0.2), (160.0, 1.0)]));
    let listed = Colour::list(&[(0.0, [0.1, 0.9, 0.3]), (99.5, [0.4, 0.2, 1.0]), (255.0, [1.0, 0.0, 0.5])]).unwrap();
    let mut transfers: Vec<_> =
        Transfer::PRESETS.iter().map(|(name, _)| Transfer::preset(name, [0.0, 255.0]).unwrap()).collect();
    transfers.extend([
        transfer(region, 0.7, grey()),
        transfer(isovalue, 1.3, grey()),
        transfer(rising(), 1.0, grey()).with_gradient(curve(&[(0.0, 0.0), (30.0, 0.3), (200.0, 1.0)])).unwrap(),
        transfer(rising(), 0.5, Colour::perceptual([0.0, 255.0]).unwrap()),
        transfer(rising(), 2.0, listed),
    ]);
    let light = Light::default();
    let aside = light.with_source(Source::Fixed(DVec3::new(0.3, -1.0, 0.5))).unwrap().with_two_sided(false);
    let lights = [light, aside.with_depth_cue(Some(DepthCue::new(1.0, 0.4).unwrap()))];
    let view = View { azimuth: 33.0, elevation: 12.0, ..View::default() };
    transfers
        .into_iter()
        .flat_map(|transfer| {
            lights.map(|light| RenderSettings { light, view, ..RenderSettings::new([64, 64], transfer.clone()) })
        })
        .collect()
}

#[test]
fn lanes_match_single_voxel_bits() {
    let mut seen = 0;
    for settings in all_settings() {
        seen += match settings.transfer.is_grey() {
            true => compare::<1>(&settings, [1, 2].map(Anything)),
            false => compare::<3>(&settings, [1, 2].map(Anything)),
        }[0];
    }
    assert!(seen > 100_000, "{seen}");
}

/// Intensities that rise only a little, except for a jump between two bricks.
struct Gentle {
    jump_before: i64,
}

impl Values for Gentle {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in (start[0]..).zip(value.iter_mut().zip(weight)) {
            let [_, y, z] = start;
            let step = if x >= 8 && y < self.jump_before { 20.0 } else { 0.0 };
            (*value, *weight) = (100.0 + 0.5 * z as f32 + step, if (x + 3 * y + z) % 11 == 0 { 0.0 } else { 0.6 });
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new((0..4).flat_map(|z| (0..3).flat_map(move |y| (0..3).map(move |x| [x, y, z]))))
    }
}

#[test]
fn flat_voxels_are_skipped_and_others_keep_bits() {
    let volumes = || [9, 14].map(|jump_before| Gentle { jump_before });
    let steep = |opacity| {
        let curve = |points: &[(f64, f64)]| Curve::new(points).unwrap();
        let transfer = Transfer::new(opacity, 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
        transfer.with_gradient(curve(&[(17.0, 0.0), (19.0, 1.0)])).unwrap()
    };
    let surface = || Opacity::Isovalue { value: 127.5, thickness_mm: 0.8, opacity: 1.0 };
    let all = Opacity::Curve(Curve::new(&[(0.0, 1.0)]).unwrap());
    for transfer in [Transfer::preset("surface", [0.0, 255.0]).unwrap(), steep(surface()), steep(all)] {
        let settings = RenderSettings::new([64, 64], transfer);
        let [seen, shaded, given] = compare::<1>(&settings, volumes());
        // One in eleven was not seen. Two of three bricks are at the jump, or next to it.
        assert!(seen > 100 && shaded * 5 < given * 4, "{seen} seen and {shaded} shaded of {given}");
    }
}

/// Lights voxels again for another view, and compares them with those shaded for it.
fn relit_equals_shaded<const C: usize>(
    shaded: &mut Shaded<C>,
    snapshot: &VoxelSnapshot,
    settings: &RenderSettings,
    region: &RenderRegion,
    simd: Simd,
) {
    let view = View { azimuth: -120.0, elevation: 51.0, ..View::default() };
    let camera = Camera::new(&view, settings.size, settings.step, region).unwrap();
    let shader = Shader::<f32>::new(settings, &camera, region);
    let (places, threads) = (Vec::from_iter(shaded.places()), (simd, Sharing::Alone));
    let lit = shaded.relight(snapshot, &places, &shader, threads);
    let mut made = Shaded::<C>::new(region, Interval::ALL, 0);
    let voxels: Vec<Changed> = places.iter().map(|at| Changed { at: *at, voxels: [u64::MAX; EDGE] }).collect();
    made.update(snapshot, &voxels, &shader, threads, &mut Vec::new(), &mut Vec::new());
    let mut seen = 0;
    for at in places {
        let (relit, made) = (shaded.filled(at).unwrap(), made.filled(at));
        for place in 0..CELLS {
            let of = |brick: &ShadedBrick<C>| {
                let Lit { colour, alpha } = &brick.cells[place];
                (colour.map(f32::to_bits), alpha.to_bits())
            };
            let expected = made.map_or(([0; C], 0), of);
            assert_eq!(of(relit), expected, "{} at {at:?}, {place}", simd.name());
            let is_own = [place % SIDE, place / SIDE % SIDE, place / (SIDE * SIDE)].iter().all(|x| *x < EDGE);
            seen += u64::from(is_own && expected.1 != 0);
        }
    }
    assert_eq!(lit, seen, "each visible voxel once");
}

/// Shades the voxels of some volumes one after the other. Returns the numbers of visible, shaded
/// and given voxels.
fn compare<const C: usize>(settings: &RenderSettings, volumes: [impl Values; 2]) -> [usize; 3] {
    let lattice = DAffine3 { matrix3: DMat3::from_diagonal(DVec3::new(0.5, 0.4, 0.7)), translation: DVec3::ZERO };
    let region = RenderRegion::new(Transform::from_affine(lattice), [0; 3], SIZE.map(|n| n - 1)).unwrap();
    let camera = Camera::new(&settings.view, settings.size, settings.step, &region).unwrap();
    let shader = Shader::<f32>::new(settings, &camera, &region);
    let (mut seen, mut shaded_in_all, mut given) = (0, 0, 0);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
        let (mut snapshot, mut shaded) = (VoxelSnapshot::new(&region, 0), Shaded::<C>::new(&region, Interval::ALL, 0));
        // Earlier content must not matter.
        for volume in &volumes {
            let (mut changed, mut dirty, mut appeared) = (Vec::new(), Vec::new(), Vec::new());
            let before = Vec::from_iter(shaded.places());
            snapshot.read(
                volume,
                &volume.bricks().collect::<Vec<_>>(),
                |_| true,
                shader.visible(),
                (simd, Sharing::Alone),
                &mut changed,
            );
            let mut voxels = Vec::new();
            snapshot.dilated(&mut changed, &mut voxels, Sharing::Alone);
            let threads = (simd, Sharing::Alone);
            let work = shaded.update(&snapshot, &voxels, &shader, threads, &mut dirty, &mut appeared);
            let lit = work.voxels_shaded as usize;
            assert!(lit > 0);
            appeared.sort_unstable();
            appeared.dedup();
            let mut new: Vec<[i64; 3]> = shaded.places().filter(|at| !before.contains(at)).collect();
            new.sort_unstable();
            assert!(new.iter().all(|at| appeared.binary_search(at).is_ok()), "each visible brick has appeared");
            shaded_in_all += lit;
            given +=
                voxels.iter().flat_map(|voxels| voxels.voxels).map(|bits| bits.count_ones() as usize).sum::<usize>();
            let inside = |x: i64, a: usize| (0..SIZE[a]).contains(&(x + region.first()[a]));
            for d in dirty {
                assert!((0..3).all(|a| inside(d.low[a], a) && d.low[a] <= d.high[a] && inside(d.high[a], a)), "{d:?}");
            }
        }
        relit_equals_shaded(&mut shaded, &snapshot, settings, &region, simd);
        let places = Vec::from_iter(shaded.places());
        shaded.relight(&snapshot, &places, &shader, (simd, Sharing::Alone));
        let of = |voxel: [i64; 3]| {
            let at = voxel.map(|x| x.div_euclid(EDGE as i64));
            let place = voxel.iter().rev().fold(0, |place, x| place * EDGE + x.rem_euclid(EDGE as i64) as usize);
            snapshot.neighbourhood(at).map_or((0.0, 0.0), |(brick, _)| (brick.value[place], brick.weight[place]))
        };
        for index in 0..shaded.table.slots().len() {
            let at = shaded.table.place(index);
            for place in 0..CELLS {
                let inside = [place % SIDE, place / SIDE % SIDE, place / (SIDE * SIDE)];
                let voxel: [i64; 3] = std::array::from_fn(|a| at[a] * EDGE as i64 + inside[a] as i64);
                let beside = |axis: usize, side: i64| {
                    let mut voxel = voxel;
                    voxel[axis] += side;
                    of(voxel)
                };
                let around = [0, 1, 2].map(|axis| [beside(axis, -1), beside(axis, 1)]);
                let expected: Lit<f32, C> = shader.shade(of(voxel), around, voxel);
                let got = match shaded.table.get(at) {
                    Some(slot) => shaded.bricks[slot].cells[place],
                    None => Lit { colour: [0.0; C], alpha: 0.0 },
                };
                let bits = |lit: &Lit<f32, C>| (lit.colour.map(f32::to_bits), lit.alpha.to_bits());
                assert_eq!(bits(&got), bits(&expected), "{} at {voxel:?}: {got:?}, {expected:?}", simd.name());
                assert!((0.0..=1.0).contains(&got.alpha) && got.colour.iter().all(|c| *c <= got.alpha), "{got:?}");
                seen += usize::from(got.alpha > 0.0);
            }
        }
    }
    [seen, shaded_in_all, given]
}

//! Tests of gradients where coverage ends, and where there are none.

use glam::DVec3;

use mask::Mask;
use reconstruct::{PathReconstructor, Settings};
use render::camera::View;
use render::classify::gradient::{FLAT_PER_MM, gradient};
use render::classify::light::{Light, Source};
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::{RenderRegion, RenderSettings, reference};
use volume::Values;

use crate::figures::{Sheet, Test};
use crate::insertion::{Probe, constant, turned};
use crate::pictures::{Field, drawn, lattice, millimetres, random_at, sane};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("19", "beside what was not seen a slope is finite and no steeper than inside", slopes),
        Test::new("19", "the end of coverage and holes in it draw no shell", shells),
        Test::new("20", "evenly grey: the ambient picture, without NaN, whatever light, view and lattice", ambient),
        Test::new("20", "evenly grey out of a reconstruction is ambient, too", reconstructed),
    ]
}

const REACH: i64 = 20;

fn ramp([x, y, z]: [i64; 3]) -> f64 {
    90.0 + 2.0 * x as f64 - 1.0 * y as f64 + 0.5 * z as f64
}

fn waves([x, y, z]: [i64; 3]) -> f64 {
    let [x, y, z] = [x as f64, y as f64, z as f64];
    120.0 + 40.0 * (0.5 * x + 0.2 * y).sin() + 30.0 * (0.4 * z - 0.3 * y).cos()
}

fn slopes(sheet: &mut Sheet) {
    // The content of an unseen voxel must not matter.
    let garbage = [0.0, 1e30, f32::NAN, f32::NEG_INFINITY];
    let pitch = [0.5_f32, 0.2, 1.9];
    for (name, value, exact) in
        [("a ramp", ramp as fn([i64; 3]) -> f64, Some([2.0, -1.0, 0.5])), ("waves", waves as fn([i64; 3]) -> f64, None)]
    {
        let (mut worst, mut bad, mut seen) = ([0.0_f64; 3], 0, 0);
        let mut inside = [0.0_f64; 3];
        for i in 0..REACH.pow(3) {
            let at = [i % REACH, i / REACH % REACH, i / (REACH * REACH)];
            let voxel = |at: [i64; 3]| {
                let weight = random_at(8, at);
                match weight < 0.6 {
                    true => (value(at) as f32, weight as f32),
                    false => (garbage[(weight * 1e6) as usize % 4], 0.0),
                }
            };
            for a in 0..3 {
                let beside = |by: i64| {
                    let mut at = at;
                    at[a] += by;
                    at
                };
                // The steepest slope of the volume if all of it is seen, to either side.
                let rise = (value(beside(1)) - value(at)) / f64::from(pitch[a]);
                inside[a] = inside[a].max(rise.abs()).max((value(at) - value(beside(-1))).abs() / f64::from(pitch[a]));
                let slope = f64::from(gradient(voxel(at), [voxel(beside(-1)), voxel(beside(1))], pitch[a]));
                bad += u32::from(!slope.is_finite());
                worst[a] = worst[a].max(slope.abs());
                let neighbours = voxel(beside(-1)).1 > 0.0 || voxel(beside(1)).1 > 0.0;
                if voxel(at).1 > 0.0 && neighbours {
                    seen += 1;
                    if let Some(exact) = exact {
                        bad += u32::from((slope - exact[a] / f64::from(pitch[a])).abs() > 2e-3);
                    }
                }
            }
        }
        sheet.equal(&format!("{name}: slopes that are not finite, or not the ramp's"), bad, 0);
        sheet.above(&format!("{name}: slopes with a neighbour seen"), f64::from(seen), 10_000.0);
        for a in 0..3 {
            let most = worst[a] / inside[a];
            sheet.at_most(&format!("{name}: steepest along axis {a}, of that inside"), most, 1.0 + 1e-4);
        }
    }
}

/// Opaque wherever it is steeper than a ramp of 2.3 grey levels per mm.
fn steep_only() -> Transfer {
    let all = Opacity::Curve(Curve::new(&[(0.0, 1.0)]).unwrap());
    let steep = Curve::new(&[(2.4, 0.0), (2.5, 1.0)]).unwrap();
    Transfer::new(all, 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap().with_gradient(steep).unwrap()
}

fn shells(sheet: &mut Sheet) {
    let [low, high] = [[0; 3], [REACH + 9; 3]];
    let ends = |at: [i64; 3]| at[0] + at[1] < 45 && at[2] % 11 != 5;
    let holes = |at: [i64; 3]| random_at(9, at) < 0.7;
    for (name, seen) in
        [("the whole box", (|_| true) as fn([i64; 3]) -> bool), ("planes missing", ends), ("holes", holes)]
    {
        let part = Field { low, high, value: |at: [i64; 3]| seen(at).then(|| ramp(at) as f32) };
        let region = part.region(millimetres());
        for perspective in [None, Some(60.0)] {
            let view = View { azimuth: 33.0, elevation: 21.0, perspective, ..View::default() };
            let settings = RenderSettings { view, stop: 0.0, ..RenderSettings::new([32, 30], steep_only()) };
            let picture = drawn(&settings, region, &part);
            let opaque = picture.pixels.iter().filter(|p| **p != [0.0, 0.0, 0.0, 1.0]).count();
            sheet.equal(&format!("{name}, {perspective:?}: pixels that see a shell"), opaque, 0);
        }
    }
    // The same transfer function does show a step inside.
    let wall = Field { low, high, value: |at: [i64; 3]| Some(ramp(at) as f32 + if at[1] > 12 { 40.0 } else { 0.0 }) };
    let settings = RenderSettings::new([32, 30], steep_only());
    let seen = drawn(&settings, wall.region(millimetres()), &wall).pixels.iter().filter(|p| p[3] < 0.5).count();
    sheet.above("a wall inside: pixels that see it", seen as f64, 500.0);
}

fn ambient(sheet: &mut Sheet) {
    let even = Field { low: [0; 3], high: [24, 19, 30], value: |at: [i64; 3]| (at[0] + at[2] != 30).then_some(180.0) };
    let curve = Opacity::Curve(Curve::new(&[(0.0, 0.1)]).unwrap());
    let transfer = Transfer::new(curve, 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    let light = Light::default().with_parts(0.35, 0.9, 0.8, 3).unwrap();
    let fixed = light.with_source(Source::Fixed(DVec3::new(0.3, -1.0, 2.0))).unwrap();
    for (name, light) in [("headlight", light), ("from aside", fixed), ("one side", fixed.with_two_sided(false))] {
        for (placed, world_from_lattice) in [
            ("straight", millimetres()),
            ("turned", lattice(turned(0.4, 0.1, -0.8), DVec3::new(0.4, 1.0, 0.7), DVec3::ONE)),
        ] {
            for perspective in [None, Some(70.0)] {
                let view = View { azimuth: -50.0, elevation: 12.0, perspective, ..View::default() };
                let settings =
                    RenderSettings { light, view, stop: 0.0, ..RenderSettings::new([24, 20], transfer.clone()) };
                let region = even.region(world_from_lattice);
                let picture = drawn(&settings, region, &even);
                let what = |said: &str| format!("{name}, {placed}, {perspective:?}: {said}");
                sheet.holds(&what("all within 0 and 1"), sane(&picture, 1e-6));
                let off = |[r, _, _, t]: [f64; 4]| (r - 0.35 * 180.0 / 255.0 * (1.0 - t)).abs();
                let worst = picture.pixels.iter().map(|p| off(p.map(f64::from))).fold(0.0, f64::max);
                sheet.at_most(&what("brightness off ambient light"), worst, 2e-6);
                let exact = reference::render(&even, &settings, &region).unwrap();
                let worst = exact.pixels.iter().map(|p| off(*p)).fold(0.0, f64::max);
                sheet.at_most(&what("the reference's off ambient light"), worst, 1e-13);
            }
        }
    }
}

fn reconstructed(sheet: &mut Sheet) {
    let probe = Probe::oblique([40, 36], 0.3);
    let mut reconstructor = PathReconstructor::general(Settings::new(DVec3::splat(0.5)), Mask::full(40, 36)).unwrap();
    for i in 0..20_u8 {
        reconstructor.insert(&probe.put(&constant(probe.size, 200.0), 0.4 * f64::from(i))).unwrap();
    }
    // Every voxel is a separate sum with separate rounding.
    let (mut steepest, mut places) = (0.0_f64, 0);
    for i in 0..49_i64.pow(3) {
        let at = [i % 49 - 24, i / 49 % 49 - 24, i / (49 * 49) - 24];
        let voxel = |axis: usize, by: i64| {
            let (mut value, mut weight, mut at) = ([0.0_f32], [0.0_f32], at);
            at[axis] += by;
            reconstructor.volume().values(at, &mut value, &mut weight);
            (value[0], weight[0])
        };
        let slope = [0, 1, 2].map(|a| f64::from(gradient(voxel(a, 0), [voxel(a, -1), voxel(a, 1)], 0.5_f32)));
        steepest = steepest.max(slope.iter().map(|s| s * s).sum::<f64>().sqrt());
        places += i32::from(voxel(0, 0).1 > 0.0);
    }
    sheet.above("voxels seen", f64::from(places), 5_000.0);
    sheet.at_most("steepest slope, of what counts as flat", steepest / FLAT_PER_MM, 0.5);
    let region =
        RenderRegion::new(lattice(glam::DMat3::IDENTITY, DVec3::splat(0.5), DVec3::ZERO), [-24; 3], [24; 3]).unwrap();
    let curve = Opacity::Curve(Curve::new(&[(0.0, 0.3)]).unwrap());
    let transfer = Transfer::new(curve, 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    let view = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
    let settings = RenderSettings { view, stop: 0.0, ..RenderSettings::new([40, 40], transfer) };
    let picture = drawn(&settings, region, reconstructor.volume());
    let seen = picture.pixels.iter().filter(|p| p[3] < 0.5).count();
    sheet.above("pixels that see it", seen as f64, 200.0);
    let off = |[r, _, _, t]: [f64; 4]| (r - 0.3 * 200.0 / 255.0 * (1.0 - t)).abs();
    let worst = picture.pixels.iter().map(|p| off(p.map(f64::from))).fold(0.0, f64::max);
    sheet.at_most("brightness off ambient light", worst, 1e-5);
}

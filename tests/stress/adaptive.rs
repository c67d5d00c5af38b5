//! Tests of adaptive rays, which are omitted in even regions: their error, and details that
//! they must not miss.

use glam::DVec3;

use render::camera::View;
use render::{Cache, RenderSettings, Renderer};
use volume::Values;

use crate::figures::{Sheet, Test};
use crate::pictures::{Field, drawn, millimetres, other_bits, random_at, rising, whole};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "32",
            "no region is examined at ε = 0; at the least ε the picture is whole, and at a tiny one within a grey level",
            exact,
        ),
        Test::new(
            "32",
            "a bright dot of one pixel between the corners of a region is found by the bound of opacity",
            dot,
        ),
    ]
}

const EDGE: i64 = 60;
/// One grey level, as a fraction of the full range.
const GREY: f64 = 1.0 / 255.0;

/// A cloud that thins out towards its border, with grain relative to its intensity.
fn cloud(grain: f64) -> impl Fn([i64; 3]) -> f64 {
    move |at: [i64; 3]| {
        let off = (DVec3::from_array(at.map(|x| x as f64)) - DVec3::splat(30.0)).length();
        let part = ((26.0 - off) / 18.0).clamp(0.0, 1.0);
        200.0 * part * part * (3.0 - 2.0 * part) * (1.0 + grain * (random_at(32, at) - 0.5))
    }
}

fn views() -> [View; 3] {
    [
        View::default(),
        View { azimuth: 33.0, elevation: 21.0, roll: 7.0, ..View::default() },
        View { azimuth: -71.0, elevation: 40.0, perspective: Some(40.0), ..View::default() },
    ]
}

fn field(value: impl Fn([i64; 3]) -> f64 + Sync) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    Field { low: [0; 3], high: [EDGE - 1; 3], value: move |at: [i64; 3]| Some(value(at) as f32) }
}

/// Returns the numbers of rays cast and of regions examined.
fn counted(settings: &RenderSettings, volume: &(impl Values + ?Sized), region: render::RenderRegion) -> [u64; 2] {
    let work = Renderer::new(settings, region).unwrap().update_all(volume).work;
    [work.rays, work.regions]
}

fn exact(sheet: &mut Sheet) {
    let (mut differ, mut regions, mut cast_twice, mut fewest) = (0, 0, 0, u64::MAX);
    let (mut most, mut saved) = (0, f64::INFINITY);
    for (view, grain) in views().into_iter().flat_map(|view| [0.0, 0.5].map(|grain| (view, grain))) {
        let volume = field(cloud(grain));
        let region = volume.region(millimetres());
        let settings = RenderSettings { view, ..whole([150, 131], rising(&[(0.0, 0.0), (255.0, 0.2)])) };
        let full = drawn(&settings, region, &volume);
        let [all, _] = counted(&settings, &volume, region);
        for cache in Cache::ALL {
            // Without regions, each ray is cast once.
            let zero = RenderSettings { adaptive: 0.0, cache, ..settings.clone() };
            let [rays, split] = counted(&zero, &volume, region);
            regions += split;
            cast_twice += rays - all;
            // The least ε divides all regions in which anything differs, with the code that a
            // larger one uses.
            let least = RenderSettings { adaptive: f32::MIN_POSITIVE, cache, ..settings.clone() };
            differ += other_bits(&full, &drawn(&least, region, &volume));
            fewest = fewest.min(counted(&least, &volume, region)[1]);
        }
        // Far below the resolution of eight bits.
        let tiny = drawn(&RenderSettings { adaptive: 1e-6, ..settings.clone() }, region, &volume);
        let off = full.over([0.0; 3]).iter().zip(tiny.over([0.0; 3])).map(|(a, b)| a.abs_diff(b)).max().unwrap();
        most = most.max(off);
        let [few, _] = counted(&RenderSettings { adaptive: 4.0 * GREY as f32, ..settings }, &volume, region);
        saved = saved.min(1.0 - few as f64 / all as f64);
    }
    sheet.equal("pixels of other bits at the least ε, all caches and views", differ, 0);
    sheet.above("fewest regions looked at, at the least ε", fewest as f64, 40.0);
    sheet.equal("regions looked at, at 0", regions, 0);
    sheet.equal("rays cast twice, at 0", cast_twice, 0);
    sheet.at_most("grey levels off at 10⁻⁶", f64::from(most), 1.0);
    sheet.above("least share of rays left out at 4/255", saved, 0.0);
}

fn dot(sheet: &mut Sheet) {
    let epsilon = 8.0 * GREY;
    let (mut worst, mut faintest, mut saved) = (0.0_f64, f64::INFINITY, f64::INFINITY);
    for view in views() {
        // A pixel is about as large as the voxel that is the dot, and the corners of regions
        // are eight pixels apart.
        let settings = RenderSettings { view, ..whole([104, 104], rising(&[(0.0, 0.0), (200.0, 0.02), (255.0, 0.9)])) };
        let adaptive = RenderSettings { adaptive: epsilon as f32, ..settings.clone() };
        let behind = cloud(0.0);
        let without = field(&behind);
        let region = without.region(millimetres());
        let even = drawn(&settings, region, &without);
        for place in 0..16_i64 {
            let at = [22 + place, 25 + place * 5 % 11, 24 + place * 7 % 13];
            let volume = field(|voxel| if voxel == at { 255.0 } else { behind(voxel) });
            let full = drawn(&settings, region, &volume);
            let found = drawn(&adaptive, region, &volume);
            let off = |a: &[f32; 4], b: &[f32; 4]| (0..4).map(|c| f64::from((a[c] - b[c]).abs())).fold(0.0, f64::max);
            faintest = faintest.min(full.difference(&even)[0]);
            for ((full, found), even) in full.pixels.iter().zip(&found.pixels).zip(&even.pixels) {
                if off(full, even) > epsilon {
                    worst = worst.max(off(full, found));
                }
            }
            let [[all, _], [few, _]] = [&settings, &adaptive].map(|settings| counted(settings, &volume, region));
            saved = saved.min(1.0 - few as f64 / all as f64);
        }
    }
    sheet.above("what the faintest of 48 dots changes", faintest, 0.1);
    sheet.at_most("off the whole picture where a dot shows, ε = 8/255", worst, epsilon);
    sheet.above("least share of rays left out", saved, 0.3);
}

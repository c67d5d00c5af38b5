//! Tests of slabs and boxes with known pictures: views in their plane, samples on voxels and
//! bricks, absorption, entry and exit of rays.

use std::collections::BTreeSet;

use glam::DVec3;

use render::camera::{Camera, View};
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::{RenderRegion, RenderSettings, reference};

use crate::figures::{Sheet, Test};
use crate::insertion::turned;
use crate::pictures::{Field, drawn, fog, lattice, millimetres, random_at, rising, sane, whole};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("15", "samples on voxels and on the faces of bricks: the closed form, no seam, no NaN", aligned),
        Test::new("15", "a sheet that is looked at along its plane is a line, as bright as it is long", along_a_sheet),
        Test::new("15", "views along an axis but for 10⁻⁹°, and along diagonals: the reference", nearly_aligned),
        Test::new(
            "R1",
            "a slab absorbs as its thickness along each ray says, aslant, in parallel and in perspective",
            absorption,
        ),
        Test::new("R2", "rays enter and leave a box where geometry says, to a twentieth of a voxel", entry_and_exit),
    ]
}

/// Views from the front, from the side and from above: view, size of a picture, and axes to the
/// right, down and away.
const ALONG: [(View, [u32; 2], [usize; 3]); 3] = {
    const FRONT: View =
        View { azimuth: 0.0, elevation: 0.0, roll: 0.0, perspective: None, turns: false, zoom: 0.0, aim: None };
    [
        (FRONT, [13, 21], [0, 2, 1]),
        (View { azimuth: 90.0, ..FRONT }, [17, 21], [1, 2, 0]),
        (View { elevation: 90.0, ..FRONT }, [3, 5], [0, 1, 2]),
    ]
};

/// Half of this box with a voxel around it is 12, 16, 21 mm, with a diagonal of 29 mm. Samples
/// 1 mm apart thus lie exactly on voxels, and with pixels of 2 or 8 mm all rays do. Its start
/// is chosen so that some rays run in the faces of bricks.
const LOW: [i64; 3] = [1, 1, 0];
const SIZE: [i64; 3] = [23, 31, 41];

fn exact_box<F: Fn([i64; 3]) -> Option<f32> + Sync>(value: F) -> Field<F> {
    Field { low: LOW, high: std::array::from_fn(|a| LOW[a] + SIZE[a] - 1), value }
}

fn aligned(sheet: &mut Sheet) {
    let alpha = 0.02;
    for (view, size, axes) in ALONG {
        let settings = RenderSettings { view, ..whole(size, fog(alpha)) };
        let even = exact_box(|_| Some(1.0));
        let region = even.region(millimetres());
        let camera = Camera::new(&view, size, 1.0, &region).unwrap();
        let off = |i, j| {
            let ray = camera.ray(i, j);
            (ray.base - ray.base.round()).abs().max_element()
        };
        let worst =
            (0..size[0]).flat_map(|i| (0..size[1]).map(move |j| (i, j))).map(|(i, j)| off(i, j)).fold(0.0, f64::max);
        let what = |said: &str| format!("along axis {}: {said}", axes[2]);
        sheet.at_most(&what("samples off the voxels"), worst, 1e-12);
        let in_a_face = |i, j, a: usize| camera.ray(i, j).base[axes[a]].round().rem_euclid(8.0) == 0.0;
        let columns = (0..size[0]).filter(|i| in_a_face(*i, 0, 0)).count();
        let rows = (0..size[1]).filter(|j| in_a_face(0, *j, 1)).count();
        sheet.above(&what("columns and rows of rays in the faces of bricks"), (columns + rows) as f64, 0.0);
        let picture = drawn(&settings, region, &even);
        sheet.holds(&what("all within 0 and 1"), sane(&picture, 1e-6));
        let inside: BTreeSet<u32> =
            picture.pixels.iter().map(|p| p[3]).filter(|t| *t < 1.0).map(f32::to_bits).collect();
        sheet.equal(&what("transmittances, all of which are one"), inside.len(), 1);
        let closed = (1.0 - alpha).powi(i32::try_from(SIZE[axes[2]]).unwrap());
        let t = inside.first().map_or(0.0, |bits| f64::from(f32::from_bits(*bits)));
        sheet.near(&what("transmittance"), t, closed, 2e-6);
        // Uneven: each sample equals its voxel.
        let uneven = exact_box(|at| (random_at(3, at) < 0.9).then(|| (255.0 * random_at(4, at)) as f32));
        let settings = RenderSettings { transfer: rising(&[(60.0, 0.0), (255.0, 0.2)]), ..settings };
        let exact = reference::render(&uneven, &settings, &region).unwrap();
        let [most, _] = exact.difference(&drawn(&settings, region, &uneven));
        sheet.at_most(&what("speckle, off the reference"), most, 1e-5);
    }
}

fn along_a_sheet(sheet: &mut Sheet) {
    let alpha = 0.04;
    for (view, size, axes) in ALONG {
        let [right, down, into] = axes;
        // One voxel thick, through the middle of the picture, parallel to the line of sight.
        let level = LOW[down] + SIZE[down] / 2;
        let thin = exact_box(move |at: [i64; 3]| (at[down] == level).then_some(1.0));
        let settings = RenderSettings { view, ..whole(size, fog(alpha)) };
        let picture = drawn(&settings, thin.region(millimetres()), &thin);
        let what = |said: &str| format!("along axis {into}, across {right}: {said}");
        let closed = (1.0 - alpha).powi(i32::try_from(SIZE[into]).unwrap());
        let (mut worst, mut beside) = (0.0_f64, 0);
        let width = size[0] as usize;
        for (n, pixel) in picture.pixels.iter().enumerate() {
            if n / width == size[1] as usize / 2 {
                // All but the outermost pixels see the box.
                if (1..width - 1).contains(&(n % width)) {
                    worst = worst.max((f64::from(pixel[3]) - closed).abs());
                }
            } else {
                beside += usize::from(*pixel != [0.0, 0.0, 0.0, 1.0]);
            }
        }
        sheet.at_most(&what("transmittance off the closed form"), worst, 2e-6);
        sheet.equal(&what("pixels beside the line that see it"), beside, 0);
        let exact = reference::render(&thin, &settings, &thin.region(millimetres())).unwrap();
        sheet.at_most(&what("off the reference"), exact.difference(&picture)[0], 2e-6);
    }
}

fn nearly_aligned(sheet: &mut Sheet) {
    let uneven = exact_box(|at| (random_at(3, at) < 0.9).then(|| (255.0 * random_at(4, at)) as f32));
    let region = uneven.region(millimetres());
    let diagonal = (1.0_f64 / 3.0_f64.sqrt()).asin().to_degrees();
    for (azimuth, elevation, step) in [
        (1e-9, 0.0, 1.0),
        (90.0, 1e-9, 1.0),
        (1e-5, 90.0 - 1e-9, 1.0),
        (0.0, 1e-4, 0.5),
        (45.0, 0.0, 1.0),
        (45.0, diagonal, 1.0),
    ] {
        for perspective in [None, Some(1e-6), Some(25.0)] {
            let view = View { azimuth, elevation, perspective, ..View::default() };
            let settings = RenderSettings { view, step, ..whole([13, 21], rising(&[(60.0, 0.0), (255.0, 0.2)])) };
            let exact = reference::render(&uneven, &settings, &region).unwrap();
            let picture = drawn(&settings, region, &uneven);
            let what = |said: &str| format!("{azimuth}°, {elevation:.4}°, {perspective:?}: {said}");
            sheet.holds(&what("all within 0 and 1"), sane(&picture, 1e-6));
            // In a perspective of nearly 0° the eye is so far away that f64 resolves a voxel
            // only coarsely.
            sheet.at_most(&what("off the reference"), exact.difference(&picture)[0], 2e-5);
        }
    }
}

/// Crossings of a ray with two planes across axis 1 of the render region, in samples; `None`
/// near the other four faces of the box.
fn crossing(camera: &Camera, region: &RenderRegion, [i, j]: [u32; 2], margin: f64) -> Option<[f64; 2]> {
    let ray = camera.ray(i, j);
    let [low, high] =
        region.bounds().map(|at| DVec3::from_array(std::array::from_fn(|a| (at[a] - region.first()[a]) as f64)));
    let mut at = [low.y - 0.5, high.y + 0.5].map(|y| (y - ray.base.y) / ray.step.y);
    at.sort_by(f64::total_cmp);
    let away = at.iter().all(|k| {
        let p = ray.base + ray.step * *k;
        [0, 2].into_iter().all(|a| p[a] > low[a] + margin && p[a] < high[a] - margin)
    });
    (away && at.iter().all(|k| k.is_finite())).then_some(at)
}

/// Optical depth of a slab of n voxels between two trilinear flanks, sampled `h` mm apart. Over
/// a flank the opacity of a sample rises linearly from 0 to a. It adds ∫ −ln(1 − a f) df = 1 +
/// (1 − a) ln(1 − a) / a instead of half the last voxel's depth.
fn absorption(sheet: &mut Sheet) {
    let (alpha, pitch, n) = (0.05, 0.5, 20_u8);
    let even = Field { low: [0; 3], high: [119, i64::from(n) - 1, 119], value: |_: [i64; 3]| Some(1.0) };
    let region = even.region(lattice(turned(0.2, 0.4, -0.3), DVec3::splat(pitch), DVec3::new(3.0, -5.0, 40.0)));
    for (azimuth, elevation, perspective) in [
        (-17.0, 12.0, None),
        (20.0, 30.0, None),
        (-40.0, 0.0, None),
        (-17.0, 12.0, Some(50.0)),
        (-20.0, 40.0, Some(90.0)),
    ] {
        for step in [0.25, 0.5, 1.0, 2.0] {
            let view = View { azimuth, elevation, roll: 10.0, perspective, turns: false, ..View::default() };
            let settings = RenderSettings { view, step, ..whole([25, 25], fog(alpha)) };
            let camera = Camera::new(&view, settings.size, step, &region).unwrap();
            let picture = drawn(&settings, region, &even);
            let h = camera.step_mm();
            let depth = -h * (-alpha).ln_1p();
            let a = -(-depth).exp_m1();
            let flank = 1.0 + (1.0 - a) * (-a).ln_1p() / a;
            let (mut worst, mut sum, mut rays) = (0.0_f64, 0.0, 0);
            for (number, pixel) in (0_u32..).zip(&picture.pixels) {
                let Some([enter, leave]) = crossing(&camera, &region, [number % 25, number / 25], 3.0) else {
                    continue;
                };
                // Samples per voxel of thickness.
                let a_voxel = (leave - enter) / f64::from(n);
                let closed = a_voxel * (f64::from(n - 1) * depth + 2.0 * flank);
                let off = -f64::from(pixel[3]).ln() - closed;
                // For sums over a function with four kinks, the error of the integral is at
                // most s²/3 voxels, s voxels per sample.
                worst = worst.max(off.abs() / (0.4 * depth / a_voxel + 1e-5));
                sum += off / closed;
                rays += 1;
            }
            let what = |said: &str| format!("{azimuth}°, {elevation}°, {perspective:?}, step {step}: {said}");
            sheet.above(&what("rays through both faces"), f64::from(rays), 20.0);
            sheet.at_most(&what("optical depth, off in what sampling may be"), worst, 1.0);
            sheet.at_most(&what("mean of it, relative"), (sum / f64::from(rays)).abs(), 2e-3 * step);
        }
    }
}

/// Thin matter whose brightness rises with depth gives the length of a ray in it (by the
/// transmittance) and the ray's middle (by the brightness).
fn entry_and_exit(sheet: &mut Sheet) {
    let (alpha, pitch) = (0.002, 0.5);
    let value = |[_, y, _]: [i64; 3]| Some(20.0 + 5.0 * y as f32);
    let cube = Field { low: [-3, 0, 5], high: [36, 39, 44], value };
    let region = cube.region(lattice(turned(0.1, -0.2, 0.15), DVec3::splat(pitch), DVec3::new(-20.0, 7.0, 1.0)));
    let curve = Opacity::Curve(Curve::new(&[(0.0, alpha)]).unwrap());
    let transfer = Transfer::new(curve, 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    let first = region.first()[1] as f64;
    for (azimuth, elevation, perspective) in
        [(12.0, 9.0, None), (20.0, -22.0, None), (12.0, 9.0, Some(40.0)), (5.0, -8.0, Some(75.0))]
    {
        let view = View { azimuth, elevation, perspective, ..View::default() };
        let settings = RenderSettings { view, step: 0.25, ..whole([31, 31], transfer.clone()) };
        let camera = Camera::new(&view, settings.size, settings.step, &region).unwrap();
        let picture = drawn(&settings, region, &cube);
        let (mut entry, mut exit, mut rays) = (0.0_f64, 0.0_f64, 0);
        for (number, pixel) in (0_u32..).zip(&picture.pixels) {
            let at = [number % 31, number / 31];
            let Some(expected) = crossing(&camera, &region, at, 3.0) else { continue };
            let [brightness, _, _, t] = pixel.map(f64::from);
            let per_sample = -camera.step_mm() * (-alpha).ln_1p();
            let samples = -t.ln() / per_sample;
            // Middle of the visible part, from the entry on: the rear is a little darker.
            let middle = 1.0 / per_sample - samples * t / (1.0 - t);
            let y = (255.0 * brightness / (1.0 - t) - 20.0) / 5.0;
            let ray = camera.ray(at[0], at[1]);
            let enter = (y - first - ray.base.y) / ray.step.y - middle;
            let in_voxels = camera.step_mm() / pitch;
            entry = entry.max((enter - expected[0]).abs() * in_voxels);
            exit = exit.max((enter + samples - expected[1]).abs() * in_voxels);
            rays += 1;
        }
        let what = |said: &str| format!("{azimuth}°, {elevation}°, {perspective:?}: {said}");
        sheet.above(&what("rays through both faces"), f64::from(rays), 20.0);
        sheet.at_most(&what("entry off the box, voxels"), entry, 0.05);
        sheet.at_most(&what("exit off the box, voxels"), exit, 0.05);
    }
}

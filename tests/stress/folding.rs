//! Tests of compositing along a ray: order, rounding, and the limits of single precision.

use render::camera::View;
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::{Cache, Picture, RenderRegion, RenderSettings, Renderer, reference};
use volume::Values;

use crate::figures::{Sheet, Test};
use crate::pictures::{Field, drawn, flat, fog, millimetres, other_bits, random_at, rising, sane, whole};

/// Half a unit in the last place for numbers from 1 to 2: the rounding of one operation.
const ROUNDING: f64 = 1.0 / (1 << 24) as f64;

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("08", "every cache gives the same bits for every arity; arities and f64 agree to 2N·2⁻²⁴", short),
        Test::new("08", "so they do along rays of hundreds of samples, in perspective and in parallel views", long),
        Test::new("09", "1024 samples of opacity 0.5: transmittance is 0 exactly and never below", halves),
        Test::new(
            "09",
            "behind what is opaque nothing is seen, exactly; opacities next to 0 and 1 stay in range",
            opaque,
        ),
        Test::new("10", "10⁴ samples of opacity 1e-8 and on: transmittance within N·2⁻²⁵, brightness by share", thin),
        Test::new("31", "blocks of 1, of N, of no divisor of N; rays of one sample: the closed form", blocks),
        Test::new("31", "rays that miss the volume are clear and are not cast", missed),
        Test::new("33", "a ray that ends at T leaves out no more than T of the brightest", stops),
    ]
}

/// Speckle, a third of it unseen or transparent.
fn speckle(size: [i64; 3]) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    let value = |at: [i64; 3]| (random_at(1, at) < 0.8).then(|| (255.0 * random_at(2, at)) as f32);
    Field { low: [0; 3], high: size.map(|n| n - 1), value }
}

/// Renders a volume that arrives in two parts with every cache. Returns the number of pixels
/// whose bits differ from the first cache's, and the first picture.
fn of_all_caches(settings: &RenderSettings, region: RenderRegion, volume: &(impl Values + ?Sized)) -> (usize, Picture) {
    let (mut differ, mut first) = (0, None);
    for cache in Cache::ALL {
        let mut renderer = Renderer::new(&RenderSettings { cache, ..settings.clone() }, region).unwrap();
        let bricks: Vec<_> = volume.bricks().collect();
        let (some, others) = bricks.split_at(bricks.len() / 2);
        renderer.update(volume, some);
        renderer.update(volume, others);
        let picture = renderer.picture();
        differ += other_bits(&picture, first.get_or_insert_with(|| picture.clone()));
    }
    (differ, first.unwrap())
}

fn arities(
    sheet: &mut Sheet,
    settings: &RenderSettings,
    volume: &(impl Values + ?Sized),
    region: RenderRegion,
    of: &[u32],
) {
    let samples = Renderer::new(settings, region).unwrap().samples();
    let exact = reference::render(volume, settings, &region).unwrap();
    // One block for all samples: the plain sequential composite in single precision.
    let sequential = drawn(&RenderSettings { arity: Some(samples + 1), ..settings.clone() }, region, volume);
    let (mut differ, mut from_sequential, mut from_exact) = (0, 0.0_f64, 0.0_f64);
    for &arity in of {
        let (other, picture) =
            of_all_caches(&RenderSettings { arity: Some(arity), ..settings.clone() }, region, volume);
        differ += other;
        from_sequential = from_sequential.max(picture.difference(&sequential)[0]);
        from_exact = from_exact.max(exact.difference(&picture)[0]);
    }
    let seen = sequential.pixels.iter().filter(|p| p[3] < 0.5).count();
    let what = |said: &str| format!("{samples} samples, {} arities: {said}", of.len());
    sheet.above(&what("pixels half opaque"), seen as f64, 10.0);
    sheet.equal(&what("pixels of other bits in other caches"), differ, 0);
    let bound = 2.0 * f64::from(samples) * ROUNDING;
    sheet.at_most(&what("off the sequential fold"), from_sequential, bound);
    sheet.at_most(&what("off the fold in f64"), from_exact, bound);
}

fn short(sheet: &mut Sheet) {
    let volume = speckle([7, 9, 6]);
    let region = volume.region(millimetres());
    for (step, perspective) in [(1.0, None), (0.7, Some(30.0))] {
        let view = View { azimuth: 33.0, elevation: 17.0, perspective, ..View::default() };
        let settings = RenderSettings { view, step, ..whole([12, 11], rising(&[(80.0, 0.0), (255.0, 0.9)])) };
        let samples = Renderer::new(&settings, region).unwrap().samples();
        let all: Vec<u32> = (1..=samples + 1).collect();
        arities(sheet, &settings, &volume, region, &all);
    }
}

fn long(sheet: &mut Sheet) {
    let volume = speckle([30, 200, 30]);
    let region = volume.region(millimetres());
    for (step, perspective) in [(0.5, None), (1.0, Some(40.0))] {
        let view = View { azimuth: 11.0, elevation: 5.0, perspective, ..View::default() };
        // Thin enough for the far end to matter.
        let settings = RenderSettings { view, step, ..whole([20, 16], rising(&[(80.0, 0.0), (255.0, 0.09)])) };
        let samples = Renderer::new(&settings, region).unwrap().samples();
        let some = [1, 2, 3, 5, 8, 16, 31, 64, 157, samples - 1, samples, samples + 1, u32::MAX];
        arities(sheet, &settings, &volume, region, &some);
    }
}

/// View along y through a box 3 voxels wide, at its middle and beside it: one sample per voxel.
fn along(transfer: Transfer) -> RenderSettings {
    whole([5, 5], transfer)
}

/// Pixel (2, 2) of 5×5.
fn middle(picture: &Picture) -> [f32; 4] {
    picture.pixels[12]
}

fn halves(sheet: &mut Sheet) {
    let volume = Field { low: [0; 3], high: [2, 1023, 2], value: |_: [i64; 3]| Some(1.0) };
    let region = volume.region(millimetres());
    for perspective in [None, Some(0.2)] {
        for arity in [None, Some(1), Some(16), Some(100), Some(2000)] {
            let settings = RenderSettings { arity, view: View { perspective, ..View::default() }, ..along(fog(0.5)) };
            let (differ, picture) = of_all_caches(&settings, region, &volume);
            let what = |said: &str| format!("perspective {perspective:?}, arity {arity:?}: {said}");
            sheet.equal(&what("pixels of other bits in other caches"), differ, 0);
            sheet.equal(&what("transmittance, its bits"), middle(&picture)[3].to_bits(), 0);
            sheet.holds(&what("all within 0 and 1"), sane(&picture, 4.0 * ROUNDING as f32));
            sheet.near(&what("brightness"), f64::from(middle(&picture)[0]), 1.0, 4.0 * ROUNDING);
        }
    }
}

fn opaque(sheet: &mut Sheet) {
    // White and opaque in front, black and opaque behind.
    let volume =
        Field { low: [0; 3], high: [2, 99, 2], value: |[_, y, _]: [i64; 3]| Some(if y < 4 { 200.0 } else { 100.0 }) };
    let curve = Curve::new(&[(0.0, 1.0)]).unwrap();
    let window = Colour::grey([100.0, 200.0]).unwrap();
    let opaque = Transfer::new(Opacity::Curve(curve), 1.0, window).unwrap();
    let region = volume.region(millimetres());
    for (step, arity) in [(1.0, Some(1)), (1.0, None), (0.3, Some(7)), (2.0, Some(500))] {
        let settings = RenderSettings { step, arity, ..along(opaque.clone()) };
        let picture = drawn(&settings, region, &volume);
        let [r, _, _, t] = middle(&picture);
        let what = |said: &str| format!("step {step}, arity {arity:?}: {said}");
        sheet.equal(&what("transmittance behind what is opaque, its bits"), t.to_bits(), 0);
        sheet.near(&what("brightness, that of the first layer"), f64::from(r), 1.0, 2.0 * ROUNDING);
        // The layers behind change no bit.
        let front = Field { low: [0; 3], high: [2, 3, 2], value: |_: [i64; 3]| Some(200.0) };
        sheet.equal(
            &what("the bits of the front alone"),
            r.to_bits(),
            middle(&drawn(&settings, region, &front))[0].to_bits(),
        );
    }
    // Opacities near 0, near 1, and 1, side by side: trilinear samples between them stay within
    // range.
    let ends = [0.0, 1e-38, 1e-9, 3e-8, 0.5, 1.0 - 6e-8, 1.0 - 1.2e-7, 1.0];
    let points: Vec<(f64, f64)> = (0_u8..).zip(ends).map(|(i, alpha)| (f64::from(i), alpha)).collect();
    let value = |at: [i64; 3]| Some((random_at(5, at) * 8.0).floor() as f32);
    let mixed = Field { low: [0; 3], high: [19; 3], value };
    for step in [1.0, 0.21, 1.9] {
        let view = View { azimuth: 21.0, elevation: 34.0, ..View::default() };
        let settings = RenderSettings { step, view, ..whole([24, 24], rising(&points)) };
        let picture = drawn(&settings, mixed.region(millimetres()), &mixed);
        sheet
            .holds(&format!("extremes mixed, step {step}: all within 0 and 1"), sane(&picture, 40.0 * ROUNDING as f32));
        let zero = picture.pixels.iter().filter(|p| p[3] == 0.0).count();
        sheet.record(&format!("extremes mixed, step {step}: pixels of transmittance 0 exactly"), zero);
    }
}

/// 1 − α is 1 in single precision below α = 2⁻²⁵. Compositing then leaves T unchanged, so that
/// 1 − T lacks at most 2⁻²⁵ per sample. The colour is a sum from 0 on and loses nothing. A
/// picture holds colours, and 10⁴ samples omit less than a tenth of a grey level of the
/// background.
fn thin(sheet: &mut Sheet) {
    let volume = Field { low: [0; 3], high: [2, 9999, 2], value: |_: [i64; 3]| Some(1.0) };
    let region = volume.region(millimetres());
    for alpha in [1e-8, 2.9e-8, 3.1e-8, 1e-7, 1e-6, 1e-5, 1e-3] {
        let settings = along(fog(alpha));
        let samples = f64::from(Renderer::new(&settings, region).unwrap().samples());
        let picture = drawn(&settings, region, &volume);
        let exact = reference::render(&volume, &settings, &region).unwrap().pixels[12];
        let [r, _, _, t] = middle(&picture).map(f64::from);
        let what = |said: &str| format!("opacity {alpha:e}: {said}");
        let closed = -(1e4 * (-alpha).ln_1p()).exp_m1();
        sheet.near(&what("1 − T in f64 over the closed form"), (1.0 - exact[3]) / closed, 1.0, 1e-6);
        sheet.at_most(&what("T off f64"), (t - exact[3]).abs(), samples * 0.5 * ROUNDING);
        sheet.record(&what("1 − T off f64, relative"), format!("{:.3e}", ((1.0 - t) / (1.0 - exact[3]) - 1.0).abs()));
        sheet.at_most(&what("brightness off f64, relative"), (r / exact[0] - 1.0).abs(), samples * 0.5 * ROUNDING);
        if alpha < 2.9e-8 {
            sheet.equal(&what("T"), t, 1.0);
        }
    }
}

fn blocks(sheet: &mut Sheet) {
    // Half the box with a voxel around it is 12, 16, 21, with a diagonal of 29. Samples 1 apart
    // thus lie exactly on voxels.
    let volume = Field { low: [0; 3], high: [22, 30, 40], value: |_: [i64; 3]| Some(1.0) };
    let region = volume.region(millimetres());
    let alpha = 0.03;
    let settings = whole([13, 21], fog(alpha));
    let samples = Renderer::new(&settings, region).unwrap().samples();
    sheet.equal("samples of a ray of 58 mm", samples, 59);
    let closed = (1.0 - alpha).powi(31);
    for arity in [1, 2, 31, 32, 40, 58, 59, 60, 1000] {
        let (differ, picture) =
            of_all_caches(&RenderSettings { arity: Some(arity), ..settings.clone() }, region, &volume);
        let [r, _, _, t] = picture.pixels[10 * 13 + 6].map(f64::from);
        sheet.equal(&format!("blocks of {arity}: pixels of other bits in other caches"), differ, 0);
        sheet.near(&format!("blocks of {arity}: transmittance of 31 voxels"), t, closed, 62.0 * ROUNDING);
        sheet.near(&format!("blocks of {arity}: brightness"), r, 1.0 - closed, 62.0 * ROUNDING);
    }
    // A single voxel, of which a ray has one sample.
    let single = Field { low: [0; 3], high: [0; 3], value: |_: [i64; 3]| Some(1.0) };
    let region = single.region(millimetres());
    let step = 3.0_f64.sqrt();
    for arity in [1, 2, 3, 4, 1000] {
        let settings = RenderSettings { step, arity: Some(arity), ..whole([1, 1], fog(alpha)) };
        let (differ, picture) = of_all_caches(&settings, region, &single);
        let samples = Renderer::new(&settings, region).unwrap().samples();
        sheet.equal(&format!("one voxel, blocks of {arity}: samples, most of them beside it"), samples <= 4, true);
        sheet.equal(&format!("one voxel, blocks of {arity}: pixels of other bits in other caches"), differ, 0);
        let t = f64::from(picture.pixels[0][3]);
        sheet.near(&format!("one voxel, blocks of {arity}: transmittance"), t, (1.0 - alpha).powf(step), 1e-6);
    }
}

fn missed(sheet: &mut Sheet) {
    let volume = Field { low: [0; 3], high: [9, 29, 4], value: |_: [i64; 3]| Some(1.0) };
    let region = volume.region(millimetres());
    // All around the box; from the front, rays can hit only its narrow side.
    let settings = RenderSettings { view: View { turns: true, ..View::default() }, ..whole([64, 48], fog(0.1)) };
    let radius = (5.5_f64.powi(2) + 15.5_f64.powi(2) + 3.0_f64.powi(2)).sqrt();
    sheet.near("radius of the box and a voxel about it, mm", region.radius_mm(), radius, 1e-9);
    for cache in Cache::ALL {
        let mut renderer = Renderer::new(&RenderSettings { cache, ..settings.clone() }, region).unwrap();
        let work = renderer.update_all(&volume).work;
        let picture = renderer.picture();
        let pixel = 2.0 * radius / 48.0;
        let (mut wrong, mut hits) = (0, 0_u64);
        for (i, p) in picture.pixels.iter().enumerate() {
            let x = ((i % 64) as f64 - 31.5) * pixel + 4.5;
            let z = (23.5 - (i / 64) as f64) * pixel + 2.0;
            let inside = x > -1.0 && x < 10.0 && z > -1.0 && z < 5.0;
            hits += u64::from(x > -1.1 && x < 10.1 && z > -1.1 && z < 5.1);
            wrong += usize::from(inside != (p[3] < 1.0));
            wrong += usize::from(!inside && *p != [0.0, 0.0, 0.0, 1.0]);
        }
        let what = |said: &str| format!("{}: {said}", cache.name());
        sheet.equal(&what("pixels not as the box says"), wrong, 0);
        sheet.above(&what("pixels that miss"), 64.0 * 48.0 - hits as f64, 2500.0);
        sheet.at_most(&what("rays cast, of those that hit"), work.rays as f64 / hits as f64, 1.0);
    }
}

fn stops(sheet: &mut Sheet) {
    let volume = speckle([40, 50, 30]);
    let region = volume.region(millimetres());
    // No reflection exceeds 0.4.
    let curve = Opacity::Curve(Curve::new(&[(60.0, 0.0), (255.0, 0.5)]).unwrap());
    let dim = Transfer::new(curve, 1.0, Colour::grey([0.0, 637.5]).unwrap()).unwrap();
    for (perspective, arity) in [(None, None), (Some(50.0), Some(3))] {
        let view = View { azimuth: 40.0, elevation: -20.0, perspective, ..View::default() };
        let with = |stop: f32| RenderSettings {
            light: flat(),
            view,
            arity,
            stop,
            // Caches nothing, so that every sample is counted.
            cache: Cache::None,
            ..RenderSettings::new([40, 36], dim.clone())
        };
        let mut all = Renderer::new(&with(0.0), region).unwrap();
        let every = all.update_all(&volume).work.samples;
        let mut last = every;
        for stop in [1.0 / 1024.0, 0.01, 0.05, 0.1, 0.3, 0.6, 1.0] {
            let mut renderer = Renderer::new(&with(stop), region).unwrap();
            let samples = renderer.update_all(&volume).work.samples;
            let picture = renderer.picture();
            let (mut colour, mut rest) = (0.0_f64, 0.0_f64);
            for (a, b) in picture.pixels.iter().zip(&all.picture().pixels) {
                colour = colour.max(f64::from(b[0]) - f64::from(a[0]));
                rest = rest.max(f64::from(a[3]) - f64::from(b[3]));
                // The omitted amount is never negative.
                rest = if b[0] < a[0] - 1e-6 || a[3] < b[3] - 1e-6 { f64::INFINITY } else { rest };
            }
            let what = |said: &str| format!("perspective {perspective:?}, T = {stop:.4}: {said}");
            let stop = f64::from(stop);
            sheet.at_most(&what("brightness left out"), colour, stop * 0.4 + 1e-6);
            sheet.at_most(&what("transmittance left out"), rest, stop);
            sheet.holds(&what("samples, no more than before"), samples <= last);
            last = samples;
        }
        sheet.at_most(
            &format!("perspective {perspective:?}: samples at T = 1, a share of all"),
            last as f64 / every as f64,
            0.3,
        );
    }
}

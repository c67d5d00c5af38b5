//! A ramp reveals a shift of half a pixel, a flipped axis and a transposed image.

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use phantom::Scene;
use reconstruct::Settings;
use reconstruct::kernel::Method;
use sonoweave_core::slice::{Image, Pixels, Slice};

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, half_mm, posed, positions, reconstruct_all, seen, turned};

pub(crate) fn tests() -> Vec<Test> {
    vec![Test::new(
        "30",
        "ramp: no shift beyond 0.003 mm; half a pixel, a flipped axis or a transposed picture would show",
        ramp,
    )]
}

/// Returns the error of the inner voxels against the ramp, grey levels: magnitude of the mean,
/// and the largest.
fn off_ramp(settings: Settings, probe: &Probe, scene: &Scene, spoil: impl Fn(Slice) -> Slice) -> (f64, f64) {
    let slices: Vec<Slice> = positions(9.0, 0.3).map(|along| spoil(probe.scan(along, |p| scene.value(p)))).collect();
    let r = reconstruct_all(settings, &probe.mask(), &slices);
    let inside: Vec<_> = seen(&r).into_iter().filter(|voxel| voxel.at.length() < 6.0).collect();
    assert!(inside.len() > 5_000, "{} voxels", inside.len());
    let errors = || inside.iter().map(|voxel| voxel.value - scene.value(voxel.at));
    (errors().sum::<f64>().abs() / inside.len() as f64, errors().map(f64::abs).fold(0.0, f64::max))
}

fn ramp(sheet: &mut Sheet) {
    let scene = Scene::standard_ramp();
    let Scene::Ramp(gradient) = &scene else { unreachable!() };
    let slope = gradient.gradient.length();
    let pixel = 0.25;
    let shifted = |u: f64, v: f64| {
        move |slice: Slice| {
            let pose = slice.world_from_image.affine();
            posed(&slice.image, pose * DAffine3::from_translation(DVec3::new(u, v, 0.0)))
        }
    };
    let rearranged = |from: fn(usize, usize, usize) -> usize| {
        move |slice: Slice| {
            let n = slice.image.width() as usize;
            let Pixels::F32(pixels) = slice.image.pixels() else { unreachable!() };
            let moved: Vec<f32> = (0..n * n).map(|i| pixels[from(n, i % n, i / n)]).collect();
            let image = Image::new(slice.image.width(), slice.image.height(), Pixels::F32(Arc::from(moved)));
            Slice { image, ..slice }
        }
    };
    for (name, axes) in [("straight", turned(0.0, 0.0, 0.0)), ("oblique", turned(0.7, -0.4, 0.3))] {
        for method in METHODS {
            // If straight, voxels lie on pixels.
            let probe = Probe { axes, ..Probe::straight([73, 73], pixel) };
            let settings = || Settings { method, sigma_mm: [Some(0.4), Some(0.4), Some(0.5)], ..half_mm() };
            let what = format!("{}, {name}", method.name());
            let (mean, worst) = off_ramp(settings(), &probe, &scene, |slice| slice);
            sheet.at_most(&format!("{what}: mean shift, mm"), mean / slope, 0.003);
            // The nearest pixel's middle lies up to half its diagonal away.
            let most = if method == Method::Nearest { 0.5_f64.sqrt() * pixel + 0.05 } else { 0.05 };
            sheet.at_most(&format!("{what}: largest shift, mm"), worst / slope, most);
            // The measure must detect these. If voxels lie on pixels, nearest rounds a shift of
            // half a pixel too far back to the right pixel.
            let half_u = off_ramp(settings(), &probe, &scene, shifted(-0.5, 0.0)).0;
            sheet.above(&format!("{what}, origin half a pixel off along u: mean shift, mm"), half_u / slope, 0.006);
            let half_v = off_ramp(settings(), &probe, &scene, shifted(0.0, -0.5)).0;
            sheet.above(&format!("{what}, origin half a pixel off along v: mean shift, mm"), half_v / slope, 0.006);
            for (spoilt, from) in [
                ("u the wrong way round", (|n, u, v| v * n + (n - 1 - u)) as fn(usize, usize, usize) -> usize),
                ("v the wrong way round", |n, u, v| (n - 1 - v) * n + u),
                ("transposed", |n, u, v| u * n + v),
            ] {
                let off = off_ramp(settings(), &probe, &scene, rearranged(from)).1;
                sheet.above(&format!("{what}, {spoilt}: largest shift, mm"), off / slope, 0.5);
            }
        }
    }
}

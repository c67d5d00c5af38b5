//! Tests of slices too far apart: the ripple of the weights, holes, and the error for a gap of
//! two σ.

use std::f64::consts::TAU;
use volume::Voxels;

use glam::{DMat3, DVec3};

use phantom::Scene;
use phantom::scene::Blobs;
use reconstruct::kernel::{Shape, Support};
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::slice::Slice;

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, constant, half_mm, positions, reconstruct_all, seen};
use crate::kernels::passed;

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "27",
            "slices 1, 2 and 3 σ apart: the weights ripple by twice the kernel's transform, a Gaussian's by 2 exp(−2π²σ²/s²), ± 1 %",
            ripple,
        ),
        Test::new("27", "slices more than two supports apart: holes exactly in the gaps", gaps),
        Test::new("28", "slices 2 σ apart, support 2.576 σ: no holes; the error is recorded", undersampled),
    ]
}

/// Weights along the normal through the middle of the image, for planes of voxels within
/// `reach` mm.
fn weights_along(r: &Reconstructor, reach: f64) -> Vec<f64> {
    let spacing = r.settings().spacing_mm.z;
    let planes = (reach / spacing) as i64;
    (-planes..=planes).map(|z| f64::from(r.volume().voxel([0, 0, z]).1)).collect()
}

/// The first harmonic of the weights relative to their mean, over whole gaps. Nearest's box has
/// equally large higher harmonics, which sixteen planes per gap cannot separate. Its weights
/// are the exact number of slices within √3 σ.
fn ripple(sheet: &mut Sheet) {
    let sigma = 1.0;
    for method in METHODS {
        for gap in [1.0, 2.0, 3.0] {
            // Sixteen voxels between slices, on slices and midway. The formula is that of an
            // unbounded kernel.
            let settings = Settings {
                method,
                sigma_mm: [None, None, Some(sigma)],
                support: [Some(Support::Energy(1e-12)); 2],
                ..Settings::new(DVec3::new(0.5, 0.5, gap / 16.0))
            };
            let probe = Probe::straight([5, 5], 0.5);
            let picture = constant(probe.size, 100.0);
            let slices: Vec<Slice> = positions(12.0 + 3.0 * gap, gap).map(|along| probe.put(&picture, along)).collect();
            let r = reconstruct_all(settings, &probe.mask(), &slices);
            let weights = weights_along(&r, 2.0 * gap);
            let kernel = r.kernels().unwrap()[2];
            let what = format!("{}, s = {gap} σ: ripple of the weights", method.name());
            if kernel.shape == Shape::Box {
                let at = |plane: usize| (plane as f64 / 16.0 - 2.0) * gap;
                let slices =
                    |z: f64| (-20..=20).filter(|k| (z - f64::from(*k) * gap).abs() <= 3.0_f64.sqrt() * sigma).count();
                let off =
                    (0..).zip(&weights).map(|(plane, w)| (w - slices(at(plane)) as f64).abs()).fold(0.0, f64::max);
                sheet.at_most(&format!("{what}: weights off the count of slices"), off, 1e-4);
                continue;
            }
            // Two gaps on either side; the last plane equals the first.
            let planes = &weights[..weights.len() - 1];
            let wave = |plane: usize| (plane as f64 / 16.0 * TAU).cos();
            let sum: f64 = planes.iter().sum();
            let harmonic = (0..).zip(planes).map(|(plane, w)| 2.0 * w * wave(plane)).sum::<f64>();
            let amplitude = (harmonic / sum).abs();
            let expected = if kernel.shape == Shape::Gaussian {
                2.0 * (-2.0 * (std::f64::consts::PI * sigma / gap).powi(2)).exp()
            } else {
                2.0 * passed(&kernel, 1.0 / gap).abs()
            };
            if expected < 1e-6 {
                // Below the resolution of f32 sums.
                sheet.at_most(&what, amplitude, expected + 1e-6);
            } else {
                sheet.near(&what, amplitude, expected, 0.01 * expected);
            }
        }
    }
}

fn gaps(sheet: &mut Sheet) {
    for method in METHODS {
        let settings = Settings { method, ..Settings::new(DVec3::new(0.5, 0.5, 0.1)) };
        let probe = Probe::straight([9, 9], 0.5);
        // Supports of 1.7 to 3.5 mm, slices 8 mm apart.
        let slices: Vec<Slice> =
            positions(24.0, 8.0).map(|along| probe.put(&constant(probe.size, 100.0), along)).collect();
        let r = reconstruct_all(settings, &probe.mask(), &slices);
        let kernel = r.kernels().unwrap()[2];
        sheet.above(&format!("{}: gap / support", method.name()), 8.0 / kernel.support_mm, 2.0);
        let (mut wrong, mut holes) = (0, 0);
        for (z, weight) in (-240_i64..).zip(weights_along(&r, 24.0)) {
            let at = 0.1 * z as f64;
            let from_slice = (at - (at / 8.0).round() * 8.0).abs();
            wrong += u32::from((weight > 0.0) != (kernel.weight(from_slice) > 0.0));
            holes += u32::from(weight == 0.0);
        }
        sheet.above(&format!("{}: planes of voxels in the gaps", method.name()), f64::from(holes), 40.0);
        sheet.equal(&format!("{}: planes that are seen and should not be, or the reverse", method.name()), wrong, 0);
    }
}

fn undersampled(sheet: &mut Sheet) {
    let mut blobs = Blobs::draw(5);
    blobs.sphere = None;
    let scene = Scene::Blobs(blobs);
    for gap in [0.5, 1.0, 2.0] {
        let probe = Probe::straight([96, 96], 0.2);
        let slices: Vec<Slice> = positions(12.0, gap).map(|along| probe.scan(along, |p| scene.value(p))).collect();
        for method in METHODS {
            let settings = Settings { method, sigma_mm: [Some(0.5), Some(0.5), Some(1.0)], ..half_mm() };
            let r = reconstruct_all(settings, &probe.mask(), &slices);
            let widths = DVec3::from_array(r.kernels().unwrap().map(|k| k.sigma_effective_mm().powi(2)));
            let blur = DMat3::from_diagonal(widths);
            let inside: Vec<_> = seen(&r).into_iter().filter(|voxel| voxel.at.abs().max_element() <= 7.0).collect();
            let what = format!("{}, s = {gap} σ", method.name());
            sheet.equal(&format!("{what}: voxels of 29³ not seen"), 29_usize.pow(3) - inside.len(), 0);
            let rms = |truth: &dyn Fn(DVec3) -> f64| {
                let some = || inside.iter().step_by(5);
                let sum: f64 = some().map(|voxel| (voxel.value - truth(voxel.at)).powi(2)).sum();
                (sum / some().count() as f64).sqrt()
            };
            sheet.record(
                &format!("{what}: rms error against the scene, grey levels"),
                format!("{:.3}", rms(&|p| scene.value(p))),
            );
            let blurred = rms(&|p| scene.blurred(p, &blur).unwrap());
            sheet.record(&format!("{what}: against the blurred scene"), format!("{blurred:.3}"));
        }
    }
}

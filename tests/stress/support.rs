//! Tests of kernel supports at extreme settings, and of kernels too narrow for the lattice.

use reconstruct::kernel::{AxisKernel, KernelError, Support};
use reconstruct::{Reconstructor, Refused, Settings, SettingsError};

use crate::figures::{Sheet, Test};
use crate::insertion::{METHODS, Probe, half_mm, noise, seen, state};
use crate::place::Place;
use crate::sequence::{Sequence, pose};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("11", "supports at E = 1e-12 and σ = 1e-6 and 1e6: finite, in proportion", extremes),
        Test::new("11", "criteria without a root, σ = 0, leakage outside (0, 1): refused, never NaN", no_root),
        Test::new("12", "σ narrower than half a pixel: refused, nothing changed", narrower_than_a_pixel),
        Test::new(
            "12",
            "σ across the plane of a tenth of a voxel: holes exactly where no voxel is reached, no panic",
            holes,
        ),
        Test::new("12", "σ below 0.75 voxel: the program says so, but not of one taken from the slices' gaps", warned),
    ]
}

fn extremes(sheet: &mut Sheet) {
    for sigma in [1e-6, 1.0, 1e6] {
        let d = Support::Energy(1e-12).half_width_mm(sigma).unwrap();
        sheet.near(&format!("d/σ at energy 1e-12, σ = {sigma}"), d / sigma, 7.130_506, 1e-5);
        for method in METHODS {
            let kernel = AxisKernel::new(method, sigma, Support::Energy(1e-12)).unwrap();
            let numbers =
                [kernel.weight(0.0), kernel.weight(d), kernel.weight(2.0 * d), kernel.sigma_effective_mm() / sigma];
            sheet.holds(
                &format!("{}, σ = {sigma}: weights and width are finite", method.name()),
                numbers.iter().all(|x| x.is_finite()),
            );
            sheet.near(&format!("{}, σ = {sigma}: effective σ / σ", method.name()), numbers[3], 1.0, 1e-6);
        }
    }
    // The root of the gradient criterion is the outer one: the slope falls there.
    let d = Support::Gradient(0.01).half_width_mm(1.0).unwrap();
    let slope = |x: f64| x * (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    sheet.near("slope at the gradient criterion's root, σ = 1", slope(d), 0.01, 1e-9);
    sheet.above("that root / σ", d, 1.0);
    let widest = Support::Gradient(0.01).half_width_mm(4.918);
    sheet.holds("gradient 0.01 has a root up to σ = 4.919", widest.is_ok_and(|d| d.is_finite()));
}

fn no_root(sheet: &mut Sheet) {
    for (support, sigma) in [
        (Support::Gradient(0.01), 4.92),
        (Support::Gradient(0.01), 1e6),
        (Support::Amplitude(0.01), 40.0),
        (Support::Amplitude(2.0), 1.0),
    ] {
        let result = support.half_width_mm(sigma);
        sheet.holds(&format!("{support:?} at σ = {sigma}: no root"), matches!(result, Err(KernelError::NoRoot { .. })));
    }
    for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let result = Support::Energy(0.01).half_width_mm(sigma);
        sheet.holds(&format!("σ = {sigma}: refused"), matches!(result, Err(KernelError::Sigma(_))));
    }
    for leakage in [0.0, 1.0, -0.1, 1.5, f64::NAN, f64::INFINITY] {
        for support in [Support::Energy(leakage), Support::Peak(leakage)] {
            let result = support.half_width_mm(1.0);
            sheet.holds(&format!("{support:?}: refused"), matches!(result, Err(KernelError::Criterion(_))));
        }
    }
}

fn narrower_than_a_pixel(sheet: &mut Sheet) {
    let probe = Probe::oblique([20, 20], 0.5);
    let settings = Settings { sigma_mm: [Some(0.24), Some(0.5), Some(1.0)], ..half_mm() };
    let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
    let refused = r.insert(&probe.put(&noise(probe.size, 1), 0.0));
    let named = matches!(&refused, Err(Refused::Settings(SettingsError::Spline { axis: 'u', .. })));
    sheet.holds("refused, along u", named);
    sheet.holds("the sentence names what to change", refused.is_err_and(|e| e.to_string().contains("larger σ")));
    sheet.equal("bricks", r.volume().len(), 0);
}

fn holes(sheet: &mut Sheet) {
    // Voxel planes 0.5 mm apart, slices 0.7 mm apart, a slab of ±0.129 mm: most planes are
    // missed.
    let probe = Probe::straight([20, 20], 0.5);
    for method in METHODS {
        let settings = Settings { method, sigma_mm: [None, None, Some(0.05)], ..half_mm() };
        let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
        let slices: Vec<f64> = (0..10).map(|i| 0.7 * f64::from(i)).collect();
        for along in &slices {
            r.insert(&probe.put(&noise(probe.size, 1), *along)).unwrap();
        }
        let reach = r.kernels().unwrap()[2].support_mm;
        let reached = |plane: i64| slices.iter().any(|s| (s - 0.5 * plane as f64).abs() <= reach);
        let planes: std::collections::BTreeSet<i64> = seen(&r).iter().map(|voxel| voxel.index[2]).collect();
        let expected: std::collections::BTreeSet<i64> = (-5..20).filter(|plane| reached(*plane)).collect();
        sheet.equal(&format!("{}: voxel planes that were seen", method.name()), planes, expected);
        let finite = seen(&r).iter().all(|voxel| voxel.value.is_finite());
        sheet.holds(&format!("{}: every value is finite", method.name()), finite);
        // A slice entirely between the planes is inserted and changes nothing.
        let before = state(r.volume());
        let touched = r.insert(&probe.put(&noise(probe.size, 2), 10.25)).unwrap();
        sheet.equal(&format!("{}: voxels of a slice between two planes", method.name()), touched.voxels, 0);
        sheet.equal(&format!("{}: state after it", method.name()), state(r.volume()), before);
    }
}

fn warned(sheet: &mut Sheet) {
    let place = Place::new();
    place.put("s.mha", Sequence { pose: |frame| pose(0.5 * f64::from(frame)), ..Sequence::default() }.bytes());
    for (sigma, expected) in [("0.5,0.5,0.1", true), ("0.3,0.5,1", true), ("0.5,0.5,0.5", false), ("auto", false)] {
        let run = place.run(&format!("reconstruct s.mha -o v.mha --clip none --sigma {sigma} --json=s.json"));
        assert_eq!(run.code, 0, "{}", run.stderr);
        let notes = place.json("s.json")["notes"].to_string();
        let said = run.stderr.contains("0.75 voxel") && notes.contains("0.75 voxel");
        sheet.equal(
            &format!("--sigma {sigma}, voxels of 0.5 mm: a note on stderr and in the statistics"),
            said,
            expected,
        );
    }
}

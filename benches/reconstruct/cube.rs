//! Large slices in every orientation: 512×512 pixels of 0.25 mm, 128 mm square, into voxels of
//! 0.5 mm, as for a volume of 256³.
//!
//! A slice has the same number of operations in every orientation. Times therefore differ only
//! through the effect of orientation on memory, vectors and skipping.

use std::error::Error;

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use phantom::scan::convex_fan;
use phantom::{Motion, Scan, ScanSettings};
use reconstruct::{Settings, Simd};
use sonoweave_core::frames::{Transform, World};
use sonoweave_core::slice::Slice;

use crate::Effort;
use crate::check::{against_equations, same_bits};
use crate::report::{Cell, Goal, Report, Table};
use crate::timing::{Contestant, Times, arithmetic, interleaved, ours, reconstructed};

const SPACING_MM: f64 = 0.5;
const SIGMA_N_MM: f64 = 1.0;
const PIXELS: [u32; 2] = [512, 512];
const PIXEL_MM: f64 = 0.25;
const GAP_MM: f64 = 0.5;
/// Offset that keeps planes of pixels off planes of voxels, mm: they would not coincide in a
/// freehand scan.
const OFFSET_MM: DVec3 = DVec3::new(0.13, 0.21, 0.17);

/// Slice normals, and the rotation of the frame about them in degrees.
const ORIENTATIONS: [(&str, DVec3, f64); 9] = [
    ("x", DVec3::X, 0.0),
    ("y", DVec3::Y, 0.0),
    ("z", DVec3::Z, 0.0),
    ("z, turned by 30°", DVec3::Z, 30.0),
    ("(1,1,0)", DVec3::new(1.0, 1.0, 0.0), 0.0),
    ("(1,0,1)", DVec3::new(1.0, 0.0, 1.0), 0.0),
    ("(0,1,1)", DVec3::new(0.0, 1.0, 1.0), 0.0),
    ("(1,1,1)", DVec3::new(1.0, 1.0, 1.0), 0.0),
    ("(3,-2,1), turned by 20°", DVec3::new(3.0, -2.0, 1.0), 20.0),
];
/// Index of the orientation in which instruction sets and threads are compared.
const DIAGONAL: usize = 7;

pub(crate) fn bench(effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        motion: Motion::Parallel,
        frames: effort.cube_slices,
        gap_mm: GAP_MM,
        image_size: PIXELS,
        pixel_mm: [PIXEL_MM; 2],
        ..ScanSettings::default()
    })?;
    let level = scan.slices(0..scan.frames());
    let sweeps: Vec<Vec<Slice>> = ORIENTATIONS.iter().map(|(_, normal, turn)| turned(&level, *normal, *turn)).collect();
    let settings = Settings { sigma_mm: [None, None, Some(SIGMA_N_MM)], ..Settings::new(DVec3::splat(SPACING_MM)) };
    let masks =
        [("full", Mask::full(PIXELS[0], PIXELS[1])), ("fan", Mask::fan(PIXELS[0], PIXELS[1], &convex_fan(PIXELS)?))];
    orientations(effort, &settings, &masks, &sweeps, report)?;
    instruction_sets(effort, &settings, &masks[0].1, &sweeps[DIAGONAL], report)?;
    threads(effort, &settings, &masks, &sweeps[DIAGONAL], report)?;
    standard_errors(effort, &settings, &masks[0].1, &sweeps[DIAGONAL], report)
}

/// Returns the sweep with its slices' normal, z, along another direction, after a rotation about
/// it.
fn turned(level: &[Slice], normal: DVec3, turn_degrees: f64) -> Vec<Slice> {
    let n = normal.normalize();
    let (u, v) = n.any_orthonormal_pair();
    // The pair may be left-handed. A mirrored sweep would still be a sweep of planes, but no
    // scanner makes one.
    let v = if u.cross(v).dot(n) < 0.0 { -v } else { v };
    let turn = DAffine3 { matrix3: DMat3::from_cols(u, v, n), translation: OFFSET_MM }
        * DAffine3::from_axis_angle(DVec3::Z, turn_degrees.to_radians());
    let turn = Transform::<World, World>::from_affine(turn);
    let place = |slice: &Slice| Slice { world_from_image: turn * slice.world_from_image, ..slice.clone() };
    level.iter().map(place).collect()
}

fn orientations(
    effort: Effort,
    settings: &Settings,
    masks: &[(&'static str, Mask); 2],
    sweeps: &[Vec<Slice>],
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let title = format!(
        "256³: {} slices of {}×{} pixels of {PIXEL_MM} mm, {GAP_MM} mm apart; voxels of {SPACING_MM} mm, σ_n {SIGMA_N_MM} mm; 1 thread, {}; ms a slice",
        effort.cube_slices,
        PIXELS[0],
        PIXELS[1],
        settings.simd.name()
    );
    let columns = [
        "normal", "mask", "median", "p25", "p75", "p95", "voxels", "ns/voxel", "rms dev", "max dev", "goal", "verdict",
    ];
    let mut table = Table::new("cube-orientations", title, &columns);
    let mut contestants: Vec<Contestant<'_>> = Vec::new();
    let mut checks = Vec::new();
    for (mask_name, mask) in masks {
        for (sweep, (name, ..)) in sweeps.iter().zip(ORIENTATIONS) {
            let reconstructor = reconstructed(settings, mask, sweep)?;
            let deviation = against_equations(&reconstructor, sweep, mask)?;
            deviation.note(&format!("256³, normal {name}, {mask_name}"), report);
            let voxels = reconstructor.work().voxels_updated as f64 / sweep.len() as f64;
            checks.push((name, *mask_name, voxels, deviation));
            contestants.push(ours(settings, mask, sweep));
        }
    }
    let times = interleaved(effort.rounds, &mut contestants)?;
    for ((name, mask, voxels, deviation), t) in checks.iter().zip(&times) {
        let limit = if *mask == "full" { 2.0 } else { 2.8 };
        let met = t.median() <= limit;
        let mut row = vec![Cell::text(*name), Cell::text(*mask), Cell::Number(t.median(), 3)];
        row.extend([0.25, 0.75, 0.95].map(|q| Cell::Number(t.quantile(q), 3)));
        row.extend([Cell::Number(*voxels, 0), Cell::Number(t.median() * 1e6 / voxels, 2)]);
        report.figure(&format!("cube/{mask}/rms dev"), deviation.rms, f64::max);
        row.extend([Cell::Number(deviation.rms, 4), Cell::Number(deviation.max, 3)]);
        row.extend([Cell::Text(format!("≤ {limit}")), Cell::text(if met { "met" } else { "not met" })]);
        table.row(row);
    }
    table.note("Deviations, grey levels, are from the equations in f64 at sampled voxels; voxels are those that a slice updates on average.");
    report.add(table);

    for ((mask, _), times) in masks.iter().zip(times.chunks(sweeps.len())) {
        let medians: Vec<f64> = times.iter().map(Times::median).collect();
        let worst = medians.iter().copied().fold(f64::NAN, f64::max);
        let best = medians.iter().copied().fold(f64::NAN, f64::min);
        report.figure(&format!("cube/{mask}/best median"), best, f64::min);
        report.figure(&format!("cube/{mask}/worst median"), worst, f64::max);
        println!("  {mask}: worst {worst:.3} ms, best {best:.3} ms, worst/best {:.2}", worst / best);
        if *mask == "full" {
            report.judge("256³, full mask, worst orientation: ms a slice", Goal::AtMost(2.0), worst);
            report.judge("256³, full mask, worst orientation, stretch: ms a slice", Goal::AtMost(1.5), worst);
        } else {
            report.judge("256³, fan, worst orientation: ms a slice", Goal::AtMost(2.8), worst);
        }
        report.judge(format!("256³, {mask}: worst over best orientation"), Goal::AtMost(1.6), worst / best);
    }
    Ok(())
}

fn instruction_sets(
    effort: Effort,
    settings: &Settings,
    mask: &Mask,
    sweep: &[Slice],
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    // Without fused multiply-add instructions, portable code is some ten times slower, so few
    // slices are used.
    let sweep = &sweep[..sweep.len().min(6)];
    let available: Vec<Settings> = Simd::ALL
        .into_iter()
        .filter(|simd| simd.is_available())
        .map(|simd| Settings { simd, ..settings.clone() })
        .collect();
    let first = reconstructed(&available[0], mask, sweep)?;
    let mut checks = Vec::new();
    for settings in &available {
        let reconstructor = reconstructed(settings, mask, sweep)?;
        let deviation = against_equations(&reconstructor, sweep, mask)?;
        let (name, same) = (settings.simd.name(), same_bits(&first, &reconstructor));
        deviation.note(&format!("256³, {name}"), report);
        if !same {
            report.wrong(format!("256³, {name}: other bits than {}", available[0].simd.name()));
        }
        checks.push((name, same, deviation));
    }
    let mut contestants: Vec<Contestant<'_>> = available.iter().map(|settings| ours(settings, mask, sweep)).collect();
    let times = interleaved(effort.rounds, &mut contestants)?;
    let title = format!("256³: instruction sets, normal {}, full mask, 1 thread; ms a slice", ORIENTATIONS[DIAGONAL].0);
    let columns = ["set", "median", "p25", "p75", "× of best", "same bits", "rms dev", "max dev"];
    let mut table = Table::new("cube-simd", title, &columns);
    for ((name, same, deviation), t) in checks.iter().zip(&times) {
        let mut row = vec![Cell::text(*name), Cell::Number(t.median(), 3)];
        row.extend([0.25, 0.75].map(|q| Cell::Number(t.quantile(q), 3)));
        row.extend([Cell::Number(t.over(&times[0])[1], 2), Cell::text(if *same { "yes" } else { "NO" })]);
        row.extend([Cell::Number(deviation.rms, 4), Cell::Number(deviation.max, 3)]);
        table.row(row);
    }
    report.add(table);
    Ok(())
}

fn threads(
    effort: Effort,
    settings: &Settings,
    masks: &[(&'static str, Mask); 2],
    sweep: &[Slice],
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let two = Settings { threads: 2, ..settings.clone() };
    for (name, mask) in masks {
        let (a, b) = (reconstructed(settings, mask, sweep)?, reconstructed(&two, mask, sweep)?);
        if !same_bits(&a, &b) {
            report.wrong(format!("256³, {name}: other bits with 2 threads than with 1"));
        }
        let deviation = against_equations(&b, sweep, mask)?;
        deviation.note(&format!("256³, {name}, 2 threads"), report);
        drop((a, b));
        let mut contestants = [ours(settings, mask, sweep), ours(&two, mask, sweep), arithmetic(1), arithmetic(2)];
        let times = interleaved(effort.rounds, &mut contestants)?;
        report.threads(&format!("256³, {name}"), [&times[0], &times[1]], [&times[2], &times[3]]);
    }
    Ok(())
}

/// Compares insertion with and without the sums for standard errors.
fn standard_errors(
    effort: Effort,
    settings: &Settings,
    mask: &Mask,
    sweep: &[Slice],
    report: &mut Report,
) -> Result<(), Box<dyn Error>> {
    let title = format!("256³: sums for standard errors, normal {}, full mask; ms a slice", ORIENTATIONS[DIAGONAL].0);
    let columns = ["threads", "sums", "median", "p25", "p75", "p99", "× median", "× p99", "same mean"];
    let mut table = Table::new("cube-standard-errors", title, &columns);
    for threads in [1, 2] {
        let without = Settings { threads, ..settings.clone() };
        let with = Settings { standard_error: true, ..without.clone() };
        let same = same_bits(&reconstructed(&without, mask, sweep)?, &reconstructed(&with, mask, sweep)?);
        if !same {
            report.wrong("256³: another mean with sums for standard errors".to_owned());
        }
        let mut contestants = [ours(&without, mask, sweep), ours(&with, mask, sweep)];
        let times = interleaved(effort.rounds, &mut contestants)?;
        for (t, sums) in times.iter().zip(["no", "yes"]) {
            let mut row = vec![Cell::count(threads as u64), Cell::text(sums), Cell::Number(t.median(), 3)];
            row.extend([0.25, 0.75, 0.99].map(|q| Cell::Number(t.quantile(q), 3)));
            row.push(Cell::Number(t.over(&times[0])[1], 2));
            row.push(Cell::Number(t.quantile(0.99) / times[0].quantile(0.99), 2));
            row.push(Cell::text(if same { "yes" } else { "NO" }));
            table.row(row);
        }
    }
    report.add(table);
    Ok(())
}

//! The comparison scan of reconstructions, 512×480 pixels of 0.1 mm into voxels of 0.5 mm, with
//! known truth: speed and error.

use std::error::Error;
use volume::Voxels;

use glam::DVec3;

use mask::Mask;
use phantom::{Errors, Scan, ScanSettings, truth};
use reconstruct::settings::IN_PLANE_SIGMA;
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::region::ClipRect;
use sync::FramePose;
use sync::survey::gap;
use volume::Grid;
use volume::brick_volume::SEEN;

use crate::Effort;
use crate::baselines::{Drop, Splat};
use crate::check::{Deviation, against_equations};
use crate::igsio::{self, Igsio};
use crate::report::{Cell, Goal, Report, Table};
use crate::timing::{Contestant, Times, arithmetic, each, interleaved, ours, reconstructed};

const SPACING_MM: f64 = 0.5;
const SIGMA_MM: f64 = 0.3;
/// Only voxels within this distance of a slice count, mm.
const REACH_MM: f64 = 0.25;
/// An RMSE above this counts as a wrong result; the peers' worst is 7.0.
const ABSURD_RMSE: f64 = 15.0;

/// A method with its results.
struct Method {
    name: String,
    threads: u64,
    single: Errors,
    bytes: Errors,
    deviation: Option<Deviation>,
}

/// The truth, and the voxels that count.
struct Truth {
    grid: Grid,
    values: Vec<f32>,
    counts: Vec<bool>,
}

impl Truth {
    fn errors(&self, value: impl Fn(usize) -> Option<f32>) -> [Errors; 2] {
        let rounded = |i: usize| value(i).map(|x| (x + 0.5).floor().clamp(0.0, 255.0));
        [
            Errors::over(&self.values, &value, |i| self.counts[i]),
            Errors::over(&self.values, rounded, |i| self.counts[i]),
        ]
    }

    fn of_bricks(&self, reconstructor: &Reconstructor) -> [Errors; 2] {
        let first = (self.grid.origin / self.grid.spacing).round().to_array().map(|x| x as i64);
        let [nx, ny, _] = self.grid.size.map(|n| n as usize);
        self.errors(|i| {
            let at = [i % nx, i / nx % ny, i / (nx * ny)];
            let (r, w) = reconstructor.volume().voxel([0, 1, 2].map(|a| first[a] + at[a] as i64));
            (w > SEEN).then(|| r / w)
        })
    }
}

pub(crate) fn bench(effort: Effort, report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings { frames: effort.blob_frames, ..ScanSettings::default() })?;
    let slices = scan.slices(0..scan.frames());
    let mask = scan.mask();
    let spacing = DVec3::splat(SPACING_MM);
    let grid = scan.grid(spacing, 2.0)?;
    let truth = Truth {
        grid,
        values: truth::sample(&scan.settings().scene, &grid)?,
        counts: truth::near_slices(&scan, &grid, REACH_MM)?,
    };

    let fixed = Settings { sigma_mm: [Some(SIGMA_MM); 3], ..Settings::new(spacing) };
    let poses: Vec<FramePose> = slices
        .iter()
        .zip(0..)
        .map(|(slice, item)| FramePose {
            item,
            time_ns: slice.time_ns,
            size: scan.settings().image_size,
            world_from_image: slice.world_from_image,
        })
        .collect();
    // The gap that `--sigma auto` uses.
    let widest = gap(&poses).ok_or("the scan has no gap")?;
    let auto = Settings { sigma_mm: [None, None, Some(0.5 * widest)], ..Settings::new(spacing) };
    let two = Settings { threads: 2, ..fixed.clone() };
    let kernels = [
        (format!("sonoweave, σ {SIGMA_MM} mm"), &fixed),
        (format!("sonoweave, σ {SIGMA_MM} mm"), &two),
        ("sonoweave, σ auto".to_owned(), &auto),
    ];
    let drops = [Drop::Nearest, Drop::Trilinear, Drop::NearestInBytes];

    let mut methods = Vec::new();
    for (name, settings) in &kernels {
        let reconstructor = reconstructed(settings, mask, &slices)?;
        let deviation = against_equations(&reconstructor, &slices, mask)?;
        deviation.note(&format!("comparison scan, {name}, {} threads", settings.threads), report);
        let [single, bytes] = truth.of_bricks(&reconstructor);
        let (name, threads) = (name.clone(), settings.threads as u64);
        methods.push(Method { name, threads, single, bytes, deviation: Some(deviation) });
    }
    for drop in drops {
        let mut splat = Splat::new(drop, &grid)?;
        for slice in &slices {
            splat.insert(slice, mask)?;
        }
        let [single, bytes] = truth.errors(|i| splat.value(i, 0.0));
        methods.push(Method { name: drop.name().into(), threads: 1, single, bytes, deviation: None });
    }
    let igsio = Igsio::start("comparison scan", &grid, &slices)?;
    let whole = ClipRect { x: 0, y: 0, width: mask.width(), height: mask.height() };
    let theirs = [(Drop::Nearest, "IGSIO, nearest"), (Drop::Trilinear, "IGSIO, linear")];
    if let Some(igsio) = &igsio {
        report.peer("IGSIO", igsio::source()?);
        for (drop, name) in theirs {
            igsio.insert(drop, whole)?;
            let values = igsio.values()?;
            let [single, bytes] = truth.errors(|i| values[i]);
            methods.push(Method { name: name.into(), threads: 1, single, bytes, deviation: None });
        }
    }
    for method in &methods {
        // A NaN lies in no range.
        if !(0.0..=ABSURD_RMSE).contains(&method.single.rmse) {
            report.wrong(format!("comparison scan, {}: {:?}", method.name, method.single));
        }
    }

    let mut contestants: Vec<Contestant<'_>> =
        kernels.iter().map(|(_, settings)| ours(settings, mask, &slices)).collect();
    for drop in drops {
        let slices = &slices;
        contestants.push(Box::new(move || {
            let mut splat = Splat::new(drop, &grid)?;
            each(slices, |slice| splat.insert(slice, mask))
        }));
    }
    if let Some(igsio) = &igsio {
        for (drop, _) in theirs {
            contestants.push(Box::new(move || igsio.insert(drop, whole)));
        }
    }
    contestants.extend([arithmetic(1), arithmetic(2)]);
    let times = interleaved(effort.rounds, &mut contestants)?;
    let [.., alone, both] = &times[..] else { return Err("no times".into()) };

    report_speed(&methods, &times, mask, slices.len(), report);
    report.threads("comparison scan, 512×480", [&times[0], &times[1]], [alone, both]);
    report_accuracy(&methods, &truth, widest, report);
    Ok(())
}

fn report_speed(methods: &[Method], times: &[Times], mask: &Mask, frames: usize, report: &mut Report) {
    let title = format!(
        "Comparison scan: {frames} frames of {}×{} pixels of 0.1 mm, voxels of 0.5 mm; ms a frame",
        mask.width(),
        mask.height()
    );
    let columns = [
        "method",
        "threads",
        "median",
        "p25",
        "p75",
        "p95",
        "min",
        "× of ours",
        "× p25",
        "× p75",
        "RMSE",
        "goal",
        "verdict",
    ];
    let mut table = Table::new("scan-speed", title, &columns);
    for (c, (method, times_of)) in methods.iter().zip(times).enumerate() {
        let verdict = match c {
            0 => report.judge(
                "512×480, 0.1 mm pixels, 0.5 mm voxels, σ 0.3 mm: ms a frame",
                Goal::AtMost(0.5),
                times_of.median(),
            ),
            _ => Report::no_goal(),
        };
        let mut row = vec![Cell::text(&method.name), Cell::count(method.threads), Cell::Number(times_of.median(), 3)];
        row.extend([0.25, 0.75, 0.95, 0.0].map(|q| Cell::Number(times_of.quantile(q), 3)));
        let [low, ratio, high] = times_of.over(&times[0]);
        row.extend([ratio, low, high].map(|times| Cell::Number(times, 2)));
        row.push(Cell::Number(method.single.rmse, 3));
        row.extend(verdict);
        table.row(row);
    }
    report.add(table);
}

fn report_accuracy(methods: &[Method], truth: &Truth, widest: f64, report: &mut Report) {
    let selected = truth.counts.iter().filter(|c| **c).count();
    let title = format!(
        "Comparison scan: error against the truth, grey levels, at the {selected} voxels within {REACH_MM} mm of a slice"
    );
    let columns =
        ["method", "threads", "type", "RMSE", "max", "bias", "unseen", "rms dev", "max dev", "goal", "verdict"];
    let mut table = Table::new("scan-accuracy", title, &columns);
    for (c, method) in methods.iter().enumerate() {
        for (kind, errors) in [("f32", method.single), ("u8", method.bytes)] {
            let goal = match (c, kind) {
                (0, "f32") => Some(("RMSE at σ 0.3 mm, f32", 0.55)),
                (0, "u8") => Some(("RMSE at σ 0.3 mm, u8", 0.65)),
                (2, "f32") => Some(("RMSE at σ auto, f32", 0.75)),
                _ => None,
            };
            let verdict = match goal {
                Some((what, limit)) => report.judge(what, Goal::AtMost(limit), errors.rmse),
                None => Report::no_goal(),
            };
            let mut row = vec![Cell::text(&method.name), Cell::count(method.threads), Cell::text(kind)];
            row.extend([errors.rmse, errors.max, errors.bias].map(|x| Cell::Number(x, 3)));
            row.push(Cell::count(errors.unseen));
            let deviation =
                |x: fn(&Deviation) -> f64| method.deviation.as_ref().map_or(Cell::Empty, |d| Cell::Number(x(d), 4));
            row.extend([deviation(|d| d.rms), deviation(|d| d.max)]);
            row.extend(verdict);
            table.row(row);
        }
    }
    table.note(format!(
        "90 % of neighbouring slices' gaps are within {widest:.3} mm; half of that is σ auto across the plane, {:.3} mm in it.",
        IN_PLANE_SIGMA * SPACING_MM
    ));
    table.note(
        "u8 is rounded to the nearest; IGSIO has no other. Deviations are from the equations in f64 at sampled voxels.",
    );
    report.add(table);
}
